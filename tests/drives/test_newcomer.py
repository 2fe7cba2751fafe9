"""A newcomer with a moteus: logs and a dump, two commands, and less ripple under the firmware's own law."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives import oracle
from drives.drive_bench import RATE, TURN, Plant, Tracker
from drives.moteus_stand_in import CPR, GAINS, Moteus, tview_csv
from drives.oracle import motions, played, ripples

DRIVE = Moteus(encoder_zero=0.0)
PLANT = Plant()


def law(lines: str = "") -> dict[str, object]:
    """Position mode with the gains of the dump and a table as `--restore-config` takes it."""
    drive = Moteus()
    drive.restore(lines)
    gains = dict(zip(("kp", "kd", "ki"), (TURN * gain for gain in GAINS), strict=True))
    return oracle.law("Moteus", **gains, ilimit=10.0, scale=drive.scale, entries=drive.comp)


def true_table() -> str:
    values = PLANT.holding(TURN / 1024 * np.arange(1024))
    scale = float(np.max(np.abs(values))) / 127
    entries = "".join(f"motor.cogging_dq_comp.{n} {round(v / scale)}\n" for n, v in enumerate(values))
    return f"motor.cogging_dq_scale {scale}\n{entries}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the newcomer has: logs of tview at 1 kHz, made by the firmware's law, and a dump."""
    folder = tmp_path_factory.mktemp("bench")
    for run in played(motions(), {"moteus": law()}):
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
