"""A newcomer with a moteus: logs and a dump, two commands, and less ripple under the firmware's own law."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import TURN, Plant
from drives.oracle import ripples
from drives.oracle_logs import FIRMWARES, moteus_law

PLANT = Plant()


def true_table() -> str:
    values = PLANT.holding(TURN / 1024 * np.arange(1024))
    scale = float(np.max(np.abs(values))) / 127
    entries = "".join(f"motor.cogging_dq_comp.{n} {round(v / scale)}\n" for n, v in enumerate(values))
    return f"motor.cogging_dq_scale {scale}\n{entries}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the newcomer has: logs of tview at 1 kHz, made by the firmware's law, and a dump."""
    folder = tmp_path_factory.mktemp("bench")
    FIRMWARES["moteus"].write(folder)
    return folder


def test_two_commands_take_the_ripple_away(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second command is the one that the first prints; what is predicted is what comes."""
    monkeypatch.chdir(folder)
    logs = sorted(path.name for path in folder.glob("*.csv"))
    code, out, err = cogless(capsys, "identify", *logs, "--drive-config", "dump.cfg", "-o", "found")
    assert (code, err) == (0, "")
    (line,) = (line for line in out.splitlines() if line.startswith("Next: "))
    words = shlex.split(line.removeprefix("Next: cogless ").replace("FILE", "cogging.cfg"))
    code, out, err = cogless(capsys, *words[:-2])
    assert (code, err) == (0, "") and out.endswith("No table was written: -o FILE writes one.\n")
    assert not (folder / "cogging.cfg").exists()
    code, out, err = cogless(capsys, *words)
    assert (code, err) == (0, "") and "moteus_tool -t 1 --restore-config cogging.cfg" in out
    mine = (folder / "cogging.cfg").read_text()
    tables = {"none": "", "true": true_table(), "mine": mine}
    left = ripples({name: moteus_law(lines) for name, lines in tables.items()})
    assert left["true"] < 0.1 * left["none"]
    assert left["mine"] < 1.5 * left["true"], left
    line = out.splitlines()[0]
    assert line.startswith("Predicted ripple at 30 rpm: ")
    predicted = float(line.split(": ")[1].split()[0]) / 60 * TURN
    assert predicted == pytest.approx(left["none"], rel=0.1) and math.isfinite(predicted)
