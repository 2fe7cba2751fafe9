"""What the guide shows of a command's output is what the command prints in a terminal of 80 columns."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cogless import load, run_study
from cogless.cli.printed import print_blocks, print_results
from cogless.design.speed_blocks import speed_blocks
from cogless.report import with_learning_off, with_limits

ROOT = Path(__file__).parents[2]


def shown(page: str) -> str:
    """The page's first block of text."""
    block = re.search(r"```text\n(.*?)```", (ROOT / "docs" / "guide" / page).read_text("utf-8"), re.DOTALL)
    assert block is not None
    return block[1]


@pytest.fixture(autouse=True)
def _eighty_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cogless.lines.terminal_columns", lambda *_: 80)


def test_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    results = with_learning_off(run_study(load("uomodri"), ["1-rev-s/*"], jobs=2))
    print_results(with_limits(results))
    printed = "\n".join(line.rstrip() for line in capsys.readouterr().out.splitlines())
    assert shown("first-run.md").rstrip() == printed.partition("\n\nAll metrics")[0]


def test_a_design(capsys: pytest.CaptureFixture[str]) -> None:
    print_blocks(speed_blocks(load(ROOT / "examples" / "my_motor.toml")))
    assert f"\n\n{shown('command-line.md')}\n" in capsys.readouterr().out
