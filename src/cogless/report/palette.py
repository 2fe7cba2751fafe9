"""Colours of controllers, and their places in the page's data."""

from __future__ import annotations

from cogless.results import AnyResults, Run

COLOURS = 8  # --c0 (the baseline's) to --c7 of report.css


def colours(results: AnyResults) -> dict[str, int]:
    """The colour index of each controller that has a run, in the study's order; the baseline's is 0."""
    ran = {run.controller for run in results.runs}
    names = [name for name in results.study.controller if name in ran]
    others = [name for name in names if name != results.study.baseline]
    return {n: 0 if n == results.study.baseline else 1 + others.index(n) % (COLOURS - 1) for n in names}


def place(results: AnyResults, run: Run) -> int:
    """The index of a run's controller in the page's list of controllers."""
    return list(colours(results)).index(run.controller)
