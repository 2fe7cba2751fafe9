"""The drives' own arithmetic as laws: look-ups cell by cell, order of limit and table, figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from drives.drive_bench import TURN
from drives.moteus_stand_in import Moteus as MoteusDrive

from cogless.drives import firmware_laws
from cogless.drives.firmware_laws import Moteus, MoteusTable, Odrive, OdriveMap, SimpleFoc, SimpleFocTable
from cogless.run.simulate import run_study
from cogless.study.base import Source
from cogless.study.reading import checked

LAW_FILE = Path(firmware_laws.__file__)


@dataclass
class Step:
    """A step's inputs; the rotor is at rest where it is asked to be."""

    ts: float = 1e-4
    theta_m: float = 0.0
    theta_ref: float = 0.0
    omega_ref: float = 0.0
    i_limit: float = 5.0


@dataclass
class Known:
    torque_constant: float = 0.03


def test_moteus_looks_up_as_its_stand_in_does() -> None:
    random = np.random.default_rng(4)
    drive = MoteusDrive(scale=float(np.float32(0.003)), comp=random.integers(-128, 128, 1024).tolist())
    table = MoteusTable(0.003, drive.comp)
    angles = [*random.uniform(-40, 40, 300).tolist(), 0.0, -1e-18, TURN, -TURN, 1023.5 / 1024 * TURN]
    assert [table.current(a) for a in angles] == pytest.approx([drive.table(a) for a in angles], abs=1e-12)


def test_an_entry_beyond_an_int8_wraps() -> None:
    entries = [0] * 1024
    entries[3], entries[9] = 128, -129
    table = MoteusTable(1.0, entries)
    assert (table.current(3 / 1024 * TURN), table.current(9 / 1024 * TURN)) == pytest.approx((-128.0, 127.0))


def test_odrive_cuts_its_index_toward_zero() -> None:
    """At negative angles each cell acts one cell later, and cell 0 is two cells wide."""
    odrive_map = OdriveMap(range(3600))
    cells = {
        place: odrive_map.torque(place / 3600 * TURN) for place in (0.5, 1.5, -0.5, -1.5, -3599.5, 3600.5)
    }
    assert cells == {0.5: 0, 1.5: 1, -0.5: 0, -1.5: 3599, -3599.5: 1, 3600.5: 0}


def test_simplefoc_looks_up_any_turn() -> None:
    table = SimpleFocTable([0.0, 1.0, 0.0, -1.0])
    places = {0.25: 1.0, 0.125: 0.5, -0.25: -1.0, -0.125: -0.5, 7.25: 1.0, -7.875: 0.5}
    for turns, current in places.items():
        assert table.current(turns * TURN) == pytest.approx(current, abs=1e-6)


def test_moteus_and_simplefoc_add_the_table_behind_their_limit_and_odrive_before_it() -> None:
    limited = Moteus(Known(), kp=1.0, kd=0.1, torque_limit=0.0, scale=0.1, entries=[10] * 1024)
    assert limited.step(Step(omega_ref=50.0)) == pytest.approx(1.0)
    ramped = SimpleFoc(P=1.0, I=0.0, entries=[0.7], Tf=0.0)
    ramped.step(Step())
    assert ramped.step(Step(omega_ref=50.0)) == pytest.approx(5.7)
    mapped = Odrive(Known(), pos_gain=20.0, vel_gain=1.0, vel_integrator_gain=0.0, cells=[0.06] * 3600)
    assert mapped.step(Step()) == pytest.approx(2.0)
    assert mapped.step(Step(omega_ref=50.0)) == pytest.approx(5.0)


def test_a_share_scales_the_table() -> None:
    for share in (0.0, 0.3, -1.0):
        moteus = Moteus(Known(), kp=1.0, kd=0.1, scale=0.1, entries=[10] * 1024, share=share)
        simplefoc = SimpleFoc(P=1.0, I=1.0, entries=[1.0], share=share)
        odrive = Odrive(Known(), 20.0, 1.0, 1.0, cells=[0.03] * 3600, share=share)
        for law in (moteus, simplefoc, odrive):
            assert law.step(Step()) == pytest.approx(share, abs=1e-6)


COGGING = {
    12: (6e-3, 0.4),
    84: (4e-3, 1.1),
    24: (2e-3, -2.0),
}  # N m, rad: the motor of the firmware's own runs
CONSTANT = 0.03  # N m/A


def holding(angle: np.ndarray) -> np.ndarray:
    return -sum(size / CONSTANT * np.sin(n * angle + phase) for n, (size, phase) in COGGING.items())


def simulated(turns_a_second: float, tables: dict[str, np.ndarray], law: str) -> dict[str, np.ndarray]:
    """Ripple, and speed's orders as in COGGING, r/min, of moteus's motor with these tables of currents, A."""
    duration, speed = max(1.0, 2 / turns_a_second), f"{60 * turns_a_second:g} rpm"
    gains: dict[str, float] = {"kp": 4.0, "kd": 0.05, "ki": 1.0}

    def params(values: np.ndarray) -> dict[str, object]:
        scale = float(np.max(np.abs(values))) / 127 or 1.0
        return {**gains, "scale": scale, "entries": np.round(values / scale).astype(int).tolist()}

    metric = {"signal": "omega_m", "unit": "rpm", "last": f"{duration / 2} s"}
    study = checked(
        Source(
            Path("moteus.toml"),
            {
                "title": "moteus",
                "motor": {
                    **{"pole_pairs": 7, "R_s": "0.1 ohm", "L_d": "0.1 mH", "L_q": "0.1 mH"},
                    "K_t": f"{CONSTANT} N*m/A",
                    "cogging": [
                        {"order": n, "torque": f"{size} N*m", "phase": f"{phase} rad"}
                        for n, (size, phase) in COGGING.items()
                    ],
                },
                "mechanics": {"inertia": "4e-5 kg*m^2", "coulomb_friction": "2 mN*m"},
                "drive": {
                    "rates": {"current_loop": "30 kHz", "speed_loop": "30 kHz"},
                    "current_loop": {"kind": "ideal", "current_limit": "20 A"},
                    "position_sensor": {"kind": "absolute", "bits": 18},
                },
                "trace": {"rate": "5 kHz"},
                "scenario": {
                    "run": {"duration": f"{duration} s", "reference": speed, "initial_speed": speed}
                },
                "controller": {
                    name: {"law": "python", "object": f"{LAW_FILE}:{law}", "params": params(values)}
                    for name, values in tables.items()
                },
                "metric": [
                    {"name": "ripple", "kind": "ripple-rms", **metric},
                    {"name": "order", "kind": "order", "order": list(COGGING), **metric},
                ],
            },
        )
    )
    return {
        run.controller: np.array([run.metrics["ripple_rad_s"], *run.metrics["order_rad_s"]]) * 60 / TURN
        for run in run_study(study).runs
    }


# Ripple that the firmware's own code left, by turns a second, over that without a table: with the exact one,
# half an entry late, of the wrong sign.
FIRMWARE = {0.5: (0.025 / 3.79, 0.593 / 3.79, 7.80 / 3.79), 2.0: (0.094 / 5.27, 0.251 / 5.27, 10.6 / 5.27)}


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_moteus_leaves_what_the_firmware_own_code_left(speed: float) -> None:
    """Inertia and gains of that motor are not known, so shares of the ripple are compared."""
    index = TURN / 1024 * np.arange(1024)
    exact = holding(index)
    tables = {"none": 0 * exact, "exact": exact, "late": holding(index + TURN / 2048), "turned": -exact}
    ripple = simulated(speed, tables, "Moteus")
    none, left = ripple["none"], {name: rows[0] / ripple["none"][0] for name, rows in ripple.items()}
    exact_share, late_share, turned_share = FIRMWARE[speed]
    assert left["turned"] == pytest.approx(turned_share, rel=0.1)
    assert left["exact"] < 0.05 and exact_share < 0.05
    # Half an entry late leaves 2 sin(n pi / 2048) of the order n.
    rest = [2 * math.sin(n * math.pi / 2048) * size for n, size in zip(COGGING, none[1:], strict=True)]
    expected = math.hypot(*rest) / math.sqrt(2) / none[0]
    assert left["late"] == pytest.approx(expected, rel=0.1, abs=1.5 * left["exact"])
    assert left["late"] == pytest.approx(late_share, rel=0.25) and left["late"] > 2 * left["exact"]


def test_the_file_stands_alone() -> None:
    """A study has a copy of it beside it, so nothing of the package is imported."""
    lines = LAW_FILE.read_text().splitlines()
    imports = [line for line in lines if line.startswith(("import ", "from "))]
    assert imports and not any("cogless" in line for line in imports)
