"""Logs that the simulator makes under a firmware's law tell the motor; the table goes back into that law."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives import oracle, test_odrive, test_simplefoc, test_vesc
from drives.drive_bench import RATE, TURN, Plant, Tracker
from drives.oracle import motions, played, ripples

PLANT = Plant()
SIMPLEFOC_GAINS = {"P": 0.06, "I": 0.9, "output_ramp": 300.0, "Tf": 3e-3}
ODRIVE_GAINS = {"pos_gain": 20.0, "vel_gain": 2.2e-3 * TURN, "vel_integrator_gain": 0.03 * TURN}
JOINT_ERROR = 1.35  # 2.64 over 1.96 standard deviations: six values at once lie within it in 95 %
LOOP_ROWS = RATE // 1000  # of the trace for one step of SimpleFOC's loop


def simplefoc_log(trace: dict[str, np.ndarray], speeds: np.ndarray, path: Path) -> Path:
    """The monitor's lines at 500 Hz of a loop of 1 kHz. The drive's angle is the rotor's."""
    turned = np.unwrap(trace["theta_m"])[::LOOP_ROWS]
    angle = np.floor(turned / TURN * 2**14) / 2**14 * TURN
    share = SIMPLEFOC_GAINS["Tf"] / (SIMPLEFOC_GAINS["Tf"] + 1e-3)
    velocity, filtered = [], float(speeds[0])
    for speed in np.diff(angle, prepend=angle[0]) * 1e3:
        filtered = share * filtered + (1 - share) * speed
        velocity.append(filtered)
    noise = 2e-3 * np.random.default_rng(5).standard_normal(len(angle))
    log = {
        "t": np.arange(len(angle)) * 1e-3,
        "target": speeds[::LOOP_ROWS],
        "Iq": 1e3 * (trace["i_q"][::LOOP_ROWS] + noise),
        "velocity": np.array(velocity),
        "angle": angle,
    }
    return test_simplefoc.monitor(log, path, every=2)


def odrive_log(trace: dict[str, np.ndarray], path: Path) -> Path:
    """A BulkCapture over USB, some 500 rows a second."""
    tracker = Tracker(8192, 1000 / TURN)
    pairs = zip(np.unwrap(trace["theta_m"]), trace["omega_m"], strict=True)
    angle, speed = np.array([tracker.step(theta, omega) for theta, omega in pairs]).T
    noise = 2e-3 * np.random.default_rng(4).standard_normal(len(angle))
    log = {
        "t": np.arange(len(angle)) / RATE,
        "position": angle / TURN,
        "velocity": speed / TURN,
        "Iq": trace["i_q"] + noise,
    }
    return test_odrive.old_csv(log, path)


def check_values(folder: Path, plant: Plant = PLANT) -> None:
    """Inertia, friction and cogging, each within its error; as many orders as stand out."""
    values = json.loads((folder / "identified.json").read_text())
    for key, truth in (("j", plant.inertia), ("c", plant.coulomb), ("b", plant.viscous)):
        entry = values["values"][key]
        assert abs(entry["value"] - truth / plant.K_t) < JOINT_ERROR * entry["error"], (key, entry)
    sizes = {n: size for n, size, _ in plant.cogging}
    for part in values["cogging"]:
        error = JOINT_ERROR * part["amplitude_error"]
        assert abs(part["amplitude_N_m"] - sizes[part["order"]]) < error, part


def cogging_orders(folder: Path) -> set[int]:
    return {part["order"] for part in json.loads((folder / "identified.json").read_text())["cogging"]}


@pytest.fixture(scope="module", params=["simplefoc", "odrive"])
def bench(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """The drive, and the folder of its logs and its configuration."""
    drive, folder = request.param, tmp_path_factory.mktemp(request.param)
    if drive == "simplefoc":
        for run in played(motions(), {"own": oracle.law("SimpleFoc", **SIMPLEFOC_GAINS)}, "1 kHz"):
            simplefoc_log(run.trace, run.trace["omega_ref"], folder / f"{run.scenario}.csv")
        (folder / "config").write_text(test_simplefoc.MONITOR_TOML)
    else:
        for run in played(motions(), {"own": oracle.law("Odrive", **ODRIVE_GAINS)}, "8 kHz"):
            odrive_log(run.trace, folder / f"{run.scenario}.csv")
        loop = {"config": ODRIVE_GAINS}
        axis = {**test_odrive.OLD, "controller": loop}
        axis["encoder"] = {"config": {"cpr": 8192, "bandwidth": 1000.0}}
        (folder / "config").write_text(json.dumps({"axis0": axis}))
    return drive, folder


def own_law(drive: str, current: np.ndarray) -> dict[str, object]:
    """The firmware's law with the current at evenly spaced angles, A, as its table."""
    if drive == "simplefoc":
        return oracle.law("SimpleFoc", **SIMPLEFOC_GAINS, entries=current.tolist())
    return oracle.law("Odrive", **ODRIVE_GAINS, cells=(PLANT.K_t * current).tolist())


def test_logs_of_the_oracle_give_a_table_for_the_oracle(
    bench: tuple[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """ODrive takes no table from outside, but its law has one: the CSV's currents become its torques."""
    drive, folder = bench
    logs, found = sorted(folder.glob("*.csv")), tmp_path / "found"
    code, _, err = cogless(
        capsys, "identify", *logs, "--drive", drive, "--drive-config", folder / "config", "-o", found
    )
    assert (code, err) == (0, "")
    check_values(found)
    assert cogging_orders(found) == {n for n, _, _ in PLANT.cogging}
    if drive == "simplefoc":
        table = tmp_path / "cogging.h"
        code, _, err = cogless(capsys, "table", found, "--to", drive, "-o", table)
        body = re.search(r"\{([^{}]*)\}", table.read_text())
        assert (code, err) == (0, "") and body is not None
        mine = np.array([float(word) for word in re.findall(r"[-+]?\d+\.\d*(?:e[-+]?\d+)?", body[1])])
    else:
        table = tmp_path / "cogging.csv"
        code, _, err = cogless(capsys, "table", found, "--to", "csv", "-o", table)
        assert (code, err) == (0, "")
        angle, current = np.loadtxt(table, delimiter=",", skiprows=1).T
        cells = TURN * (np.arange(3600) + 0.5) / 3600
        mine = np.interp(cells, np.radians(angle), current, period=TURN)
    true = PLANT.holding(TURN * (np.arange(len(mine)) + (0.5 if drive == "odrive" else 0.0)) / len(mine))
    laws = {
        name: own_law(drive, values) for name, values in (("none", 0 * true), ("true", true), ("mine", mine))
    }
    left = ripples(laws, "1 kHz" if drive == "simplefoc" else "8 kHz")
    assert left["true"] < 0.1 * left["none"], left
    assert left["mine"] < 1.5 * left["true"], left


def test_logs_of_vesc_give_inertia_and_friction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its rows show no order of cogging at these speeds, and it takes no table."""
    gains = {"law": "pi", "kp": "0.15 A*s/rad", "ki": "0.9 A/rad"}
    logs = []
    for run in played(motions(test_vesc.motions()), {"pi": gains}, plant=test_vesc.PLANT):
        turned = np.unwrap(run.trace["theta_m"])
        log = {"t": np.arange(len(turned)) / RATE, "phi": turned}
        log |= {"omega": run.trace["omega_m"], "i": run.trace["i_q"]}
        logs.append(test_vesc.log(log, tmp_path / f"{run.scenario}.csv"))
    config, found = tmp_path / "motor.xml", tmp_path / "found"
    config.write_text(test_vesc.XML)
    code, out, err = cogless(
        capsys, "identify", *logs, "--drive", "vesc", "--drive-config", config, "-o", found
    )
    assert (code, err) == (0, "") and "50 rows a second of mean currents" in out
    check_values(found, test_vesc.PLANT)
    assert not cogging_orders(found)
