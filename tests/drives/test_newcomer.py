"""A newcomer with a moteus: logs and a dump, two commands, and less ripple under the firmware's own law."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import RATE, RUNS, TURN, Plant, Tracker
from drives.moteus_stand_in import CPR, GAINS, Moteus, tview_csv

from cogless.drives import firmware_laws
from cogless.run.simulate import run_study
from cogless.study.base import Source
from cogless.study.reading import checked

DRIVE = Moteus(encoder_zero=0.0)
PLANT = Plant()
SLOW = f"{0.5 * TURN} rad/s"


def law(lines: str = "") -> dict[str, object]:
    """Position mode with the gains of the dump and a table as `--restore-config` takes it."""
    drive = Moteus()
    drive.restore(lines)
    gains = dict(zip(("kp", "kd", "ki"), (TURN * gain for gain in GAINS), strict=True))
    params = {**gains, "ilimit": 10.0, "scale": drive.scale, "entries": drive.comp}
    return {"law": "python", "object": f"{firmware_laws.__file__}:Moteus", "params": params}


def played(scenarios: dict[str, dict[str, object]], laws: dict[str, dict[str, object]]) -> list:
    """Runs of the motor in the simulator, as the firmware turns it."""
    cogging = [{"order": n, "torque": f"{a} N*m", "phase": f"{p} rad"} for n, a, p in PLANT.cogging]
    motor = {"pole_pairs": 7, "R_s": "0.8 ohm", "L_d": "0.45 mH", "L_q": "0.45 mH"}
    friction = {"coulomb_friction": f"{PLANT.coulomb} N*m", "viscous_friction": f"{PLANT.viscous} N*m*s/rad"}
    tables = {
        "title": "moteus",
        "motor": {**motor, "K_t": f"{PLANT.K_t} N*m/A", "cogging": cogging},
        "mechanics": {"inertia": f"{PLANT.inertia} kg*m^2", **friction},
        "drive": {
            "rates": {"current_loop": "30 kHz", "speed_loop": "30 kHz"},
            "current_loop": {"kp": "2.83 V/A", "ki": "5027 V/A/s", "current_limit": "8 A"},
            "inverter": {"bus_voltage": "24 V"},
            "position_sensor": {"kind": "absolute", "bits": 14},
        },
        "trace": {"rate": f"{RATE} Hz"},
        "scenario": scenarios,
        "controller": laws,
    }
    return list(run_study(checked(Source(Path("moteus.toml"), tables))).runs)


def ripples(laws: dict[str, dict[str, object]]) -> dict[str, float]:
    """Ripple at half a turn a second, rad/s rms, by controller."""
    scenario = {"duration": "4 s", "reference": SLOW, "initial_speed": SLOW}
    return {
        run.controller: float(np.std(run.trace["omega_m"][2 * RATE :]))
        for run in played({"slow": scenario}, laws)
    }


def true_table() -> str:
    values = PLANT.holding(TURN / 1024 * np.arange(1024))
    scale = float(np.max(np.abs(values))) / 127
    entries = "".join(f"motor.cogging_dq_comp.{n} {round(v / scale)}\n" for n, v in enumerate(values))
    return f"motor.cogging_dq_scale {scale}\n{entries}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the newcomer has: logs of tview at 1 kHz, made by the firmware's law, and a dump."""
    folder = tmp_path_factory.mktemp("bench")
    scenarios: dict[str, dict[str, object]] = {
        name: {
            "duration": f"{points[-1][0]} s",
            "reference": {"profile": [[f"{t} s", f"{v} rad/s"] for t, v in points]},
            "initial_speed": f"{points[0][1]} rad/s",
        }
        for name, points in RUNS.items()
    }
    for run in played(scenarios, {"moteus": law()}):
        tracker = Tracker(CPR, 400)
        turned = np.unwrap(run.trace["theta_m"])
        pairs = zip(turned, run.trace["omega_m"], strict=True)
        angle, speed = np.array([tracker.step(theta, omega) for theta, omega in pairs]).T
        noise = 2e-3 * np.random.default_rng(3).standard_normal(len(angle))
        log = {
            "t": np.arange(len(angle)) / RATE,
            "filtered_value": np.mod(angle / TURN, 1.0) * CPR,
            "position": angle / TURN + DRIVE.offset,
            "velocity": speed / TURN,
            "q_A": run.trace["i_q"] + noise,
        }
        tview_csv(log, folder, run.scenario, every=5)
    DRIVE.dump(folder / "dump.cfg", servo__pid_dq__kp="2.83", servo__pid_dq__ki="5027")
    return folder


def test_two_commands_take_the_ripple_away(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second command is the one that the first prints; what is predicted is what comes."""
    monkeypatch.chdir(folder)
    logs = sorted(path.name for path in folder.glob("*.csv"))
    code, out, err = cogless(capsys, "identify", *logs, "--drive-config", "dump.cfg", "-o", "found")
    assert (code, err) == (0, "")
    (line,) = (line for line in out.splitlines() if line.startswith("Table: "))
    words = shlex.split(line.removeprefix("Table: cogless ").replace("FILE", "cogging.cfg"))
    code, out, err = cogless(capsys, *words)
    assert (code, err) == (0, "") and "moteus_tool -t 1 --restore-config cogging.cfg" in out
    mine = (folder / "cogging.cfg").read_text()
    left = ripples({"none": law(), "true": law(true_table()), "mine": law(mine)})
    assert left["true"] < 0.1 * left["none"]
    assert left["mine"] < 1.5 * left["true"], left
    (line,) = (line for line in out.splitlines() if line.startswith("Ripple at 30 r/min"))
    predicted = float(line.split(": ")[1].split()[0]) / 60 * TURN
    assert predicted == pytest.approx(left["none"], rel=0.1) and math.isfinite(predicted)
