"""What `cogless design` prints of shipped studies and of an example, line by line, numbers to 0.2 %.

The files are its output: cogless design STUDY > tests/design/printed/STUDY.txt, without blanks at the ends.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from cogless import load
from cogless.design import trial_summary
from cogless.design.table import design_table
from cogless.study import TrialStudy

PRINTED = Path(__file__).with_name("printed")
EXAMPLES = Path(__file__).parents[2] / "examples"
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?")


def parted(line: str) -> tuple[str, list[float]]:
    """A line's words, with one blank or two between them, and its numbers."""
    words = re.sub(r"(?<=\S) {2,}", "  ", NUMBER.sub("#", line.rstrip()))
    return words, [float(x) for x in NUMBER.findall(line)]


@pytest.mark.parametrize("name", sorted(path.stem for path in PRINTED.glob("*.txt")))
def test_the_design_of_a_shipped_study_is_printed(name: str) -> None:
    example, file = EXAMPLES / f"{name}.toml", io.StringIO()
    study = load(example if example.exists() else name)
    trials = isinstance(study, TrialStudy)
    shown = trial_summary.table(study, trial_summary.summary(study)) if trials else design_table(study)  # type: ignore[arg-type]
    Console(file=file, width=240).print(shown)
    lines = [parted(line) for line in file.getvalue().splitlines()]
    expected = [parted(line) for line in (PRINTED / f"{name}.txt").read_text().splitlines()]
    assert [words for words, _ in lines] == [words for words, _ in expected]
    for (words, numbers), (_, wanted) in zip(lines, expected, strict=True):
        assert numbers == pytest.approx(wanted, rel=2e-3, abs=1e-9), words
