"""From an accelerometer's logs to the study `printer`: what an identified correction leaves of the ripple.

The logs are those of the independent plant with the study's axis. The study runs in the engine.
"""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from printer.printer_bench import FILE, SIGNS, ramp_records, write_klipper_logs
from printer.printer_plant import closed_form, study_axes

from cogless.files import shipped
from cogless.run.simulate import simulate
from cogless.study import load

TEETH, RADIUS = 50, 0.04 / math.tau
CLOSED_FORM_ERROR = 0.003  # rad, of the closed forms against balanced torques
SCENARIOS = {"20-mm-s": "forward", "50-mm-s": "forward", "100-mm-s": "forward", "50-mm-s-back": "backward"}
PAGE = Path(__file__).parents[2] / "docs" / "guide" / "printers.md"


@dataclass(frozen=True)
class Identified:
    """What identify printed, the file that it wrote, and the ripple that each correction leaves, m."""

    out: str
    file: Path
    shipped_ripple: dict[tuple[str, str], float]
    ripple: dict[tuple[str, str], float]

    @property
    def contents(self) -> Any:
        return json.loads(self.file.read_text())


def command(*words: object) -> str:
    """What a command prints; it must warn of nothing."""
    done = subprocess.run([sys.executable, "-m", "cogless", *map(str, words)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def ripples(folder: Path, *words: object) -> dict[tuple[str, str], float]:
    """The carriage's ripple, m, of each scenario and controller of a study."""
    command("run", *words, "-o", folder)
    runs = json.loads((folder / "results.json").read_text())["runs"]
    return {(run["scenario"], run["controller"]): run["metrics"]["carriage_ripple_m"] for run in runs}


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Identified:
    """The words of the guide, from logs to runs."""
    folder = tmp_path_factory.mktemp("printer")
    axis, file = folder / "printer.toml", folder / "found" / "correction.json"
    axis.write_text(FILE)
    logs = write_klipper_logs(folder, ramp_records(study_axes(1), 1), 0, np.random.default_rng(5), 0.1)
    out = command("identify", *logs, "--drive", "klipper", "--drive-config", axis, "-o", file.parent)
    change = f"controller.table.correction={{ file = '{file}' }}"
    return Identified(
        out,
        file,
        ripples(folder / "shipped", "printer"),
        ripples(folder / "identified", "printer", "--set", change),
    )


def order_sizes(scenario: str) -> dict[int, float]:
    """Amplitudes of the carriage's way without a correction, m, by electrical order."""
    trace = simulate(load("printer"), scenario, "plain").trace
    rows = trace.time > trace.time[-1] - 1.0
    line = trace["theta_ref"][rows]
    u = TEETH * (line - line[0])
    waves = [wave(n * u) for n in range(1, 9) for wave in (np.sin, np.cos)]
    matrix = np.column_stack([np.ones(len(u)), u, *waves])
    fit, *_ = np.linalg.lstsq(matrix, RADIUS * trace["theta_load"][rows], rcond=None)
    return {n: float(np.hypot(fit[2 * n], fit[2 * n + 1])) for n in (1, 2, 4)}


def test_an_identified_correction_leaves_what_its_errors_allow(identified: Identified) -> None:
    """A wrong coefficient moves the carriage as the motor's own error of that size does. So the ripple is off
    that of the closed form by the sum, in rms, of what the coefficients are off, and these are off by their
    errors at most.
    """
    for scenario, direction in SCENARIOS.items():
        psi = closed_form(study_axes(1), SIGNS[direction], 0.05)
        waves = identified.contents[direction]
        errors = {wave["order"]: wave["error_rad"] + CLOSED_FORM_ERROR for wave in waves}
        for wave in waves:
            n, c = wave["order"], wave["magnitude_rad"] * np.exp(1j * wave["phase_rad"])
            assert abs(c + psi[n][0]) < errors[n]
        sizes = order_sizes(scenario)
        allowed = math.sqrt(sum((sizes[n] * errors[n] / abs(psi[n][0])) ** 2 for n in sizes) / 2)
        plain, closed = (identified.shipped_ripple[scenario, name] for name in ("plain", "table"))
        assert identified.ripple[scenario, "plain"] == plain
        assert abs(identified.ripple[scenario, "table"] - closed) < allowed < 0.5 * plain


def test_the_line_that_identify_prints_is_a_study_s(identified: Identified, tmp_path: Path) -> None:
    """Pasted into a study in another folder, it is the correction that was written."""
    line = re.search(r"^For a study's law microstepping: (correction = .*)$", identified.out, re.MULTILINE)
    assert line is not None
    text = shipped("studies")["printer"].read_text("utf-8")
    start, end = text.index("[controller.table.correction]"), text.index("[[metric]]")
    mine = tmp_path / "mine.toml"
    mine.write_text(f"{text[:start]}{line[1]}\n\n{text[end:]}", "utf-8")
    law: Any = load(mine).controller["table"]
    for direction in SIGNS:
        waves = [(wave.order, wave.magnitude, wave.phase) for wave in getattr(law.correction, direction)]
        written = identified.contents[direction]
        assert waves == [(w["order"], w["magnitude_rad"], w["phase_rad"]) for w in written]


def test_the_guide_s_figures_are_the_study_s(identified: Identified) -> None:
    rows = {
        "no correction": (identified.shipped_ripple, "plain"),
        "closed form": (identified.shipped_ripple, "table"),
        "identified": (identified.ripple, "table"),
    }
    for name, (ripple, controller) in rows.items():
        row = re.search(rf"^\| {name}[^|]*\|(.*)\|$", PAGE.read_text("utf-8"), re.MULTILINE)
        assert row is not None
        figures = [1e-6 * float(cell) for cell in row[1].split("|")]
        # The page shows two digits.
        assert figures == pytest.approx([ripple[scenario, controller] for scenario in SCENARIOS], rel=0.06)


@pytest.mark.parametrize(("current", "share"), [("0.6 A", 0.25), ("1 A", 0.25), ("1.2 A", 0.5)])
def test_the_ripple_at_another_current_is_what_the_warning_says(
    current: str, share: float, identified: Identified, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The shipped correction and the identified one, in rms over the scenarios."""
    changes = {f"controller.{name}.current": current for name in ("plain", "table")}
    words = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    for table in ({}, {"controller.table.correction": {"file": str(identified.file)}}):
        study = load("printer", {**changes, **table})
        ripple = {
            name: [simulate(study, scenario, name).metrics["carriage_ripple_m"] for scenario in SCENARIOS]
            for name in ("plain", "table")
        }
        left = np.linalg.norm(ripple["table"]) / np.linalg.norm(ripple["plain"])
        assert left == pytest.approx(share, abs=0.05)
        if table:
            words += ["--set", f"controller.table.correction={{ file = '{identified.file}' }}"]
        line = (
            f"controller.table: the correction is for 0.8 A rms: at {current} it leaves about {share:.0%} of "
            "the ripple."
        )
        only = ["--only", "20-mm-s/*", "-o", tmp_path / "run"]
        code, _, err = cogless(capsys, "run", "printer", *words, *only)
        assert (code, " ".join(err.split())) == (0, f"Warning: {line}")
        code, out, _ = cogless(capsys, "design", "printer", *words)
        assert code == 0 and line in " ".join(out.split())
