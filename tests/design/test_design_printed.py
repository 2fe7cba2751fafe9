"""What `cogless design` prints of shipped studies and of an example, line by line, numbers to 0.2 %.

The files are its output, 240 columns wide and without blanks at the ends:
cogless design STUDY --long > tests/design/printed/STUDY.txt
"""

from __future__ import annotations

import io
import json
import math
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from cogless import load
from cogless.design.answers import to_dict
from cogless.design.design_table import design_table
from cogless.design.trials import trial_summary
from cogless.study import TrialStudy

PRINTED = Path(__file__).with_name("printed")
EXAMPLES = Path(__file__).parents[2] / "examples"
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?")


def parted(line: str) -> tuple[str, list[float]]:
    """A line's words, with one blank or two between them, and its numbers."""
    words = re.sub(r"(?<=\S) {2,}", "  ", NUMBER.sub("#", line.rstrip()))
    return words, [float(x) for x in NUMBER.findall(line)]


@cache
def loaded(name: str) -> Any:
    example = EXAMPLES / f"{name}.toml"
    return load(example if example.exists() else name)


@cache
def designs(name: str) -> trial_summary.TrialSummary:
    """Of a study of trials."""
    return trial_summary.summary(loaded(name))


@pytest.mark.parametrize("name", sorted(path.stem for path in PRINTED.glob("*.txt")))
def test_the_design_of_a_shipped_study_is_printed(name: str) -> None:
    study, file = loaded(name), io.StringIO()
    trials = isinstance(study, TrialStudy)
    shown = trial_summary.table(study, designs(name)) if trials else design_table(study)
    Console(file=file, width=240).print(shown)
    lines = [parted(line) for line in file.getvalue().splitlines()]
    expected = [parted(line) for line in (PRINTED / f"{name}.txt").read_text().splitlines()]
    assert [words for words, _ in lines] == [words for words, _ in expected]
    for (words, numbers), (_, wanted) in zip(lines, expected, strict=True):
        assert numbers == pytest.approx(wanted, rel=2e-3, abs=1e-9), words


def numbers(table: Any) -> list[float]:
    """All numbers within plain types."""
    if isinstance(table, dict | list):
        return [x for inner in (table.values() if isinstance(table, dict) else table) for x in numbers(inner)]
    return [float(table)] if isinstance(table, int | float) and not isinstance(table, bool) else []


@pytest.mark.parametrize("name", ["hub-motor", "two-mass-axis", "my_motor", "mandra2019"])
def test_the_same_design_as_json(name: str) -> None:
    """In SI units where the table has a datasheet's; of a study of trials its numbers are the table's."""
    study = loaded(name)
    trials = isinstance(study, TrialStudy)
    found = trial_summary.to_dict(study, designs(name)) if trials else to_dict(study)
    told = json.loads(json.dumps(found, allow_nan=False))
    assert told["study"] == study.title and list(told["controllers"]) == list(study.controller)
    printed = (PRINTED / f"{name}.txt").read_text()
    if trials:
        everything = np.array(numbers(told))
        shown = [
            float(x)
            for line in printed.split("Certificate")[1].splitlines()[2:]
            for x in NUMBER.findall(line)
        ]
        missing = [x for x in shown if not np.any(np.abs(everything - x) <= 2e-3 * abs(x) + 1e-9)]
        assert missing == []
        return
    for controller, each in told["controllers"].items():
        line = next(line for line in printed.splitlines() if line.startswith(f"{study.label(controller)}  "))
        hertz, degrees, gain, second = map(
            float, re.search(r"([\d.]+) Hz +([\d.]+) deg +([\d.]+) at ([\d.]+) Hz", line).groups()
        )
        margins = each["margins"]
        assert margins["stable"] and margins["crossover_rad_s"] == pytest.approx(math.tau * hertz, rel=2e-3)
        assert margins["phase_margin_rad"] == pytest.approx(math.radians(degrees), rel=2e-3)
        assert margins["gain_margin"] == pytest.approx(gain, rel=3e-3)
        assert margins["phase_crossover_rad_s"] == pytest.approx(math.tau * second, rel=2e-3)
        kp = float(re.search(r"kp ([\d.]+) A/\(r/min\)", line)[1])
        assert each["gains"]["kp"] == {"value": pytest.approx(kp * 30 / math.pi, rel=2e-3), "unit": "A*s/rad"}
        learns = each["learning"] is not None or each["certificate"] is not None
        assert learns == (each["fastest_rad_s"] is not None)
