"""The learned maps for the page: current over angle at the end of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.report.packing import plain
from cogless.report.palette import place
from cogless.results import Results, Run

MOST = 1440  # points of a map

NOTE = "The current that each controller has learned over one revolution, as it stands at the end of the run."


def maps(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Charts of the learned current over angle, one electrical and one mechanical, each on a common grid."""
    charts = []
    for frame in ("electrical", "mechanical"):
        learned = [
            run
            for run in runs
            if run.memory
            and run.memory["frame"] == frame
            and len(run.memory["current"]) > 1
            and results.study.controller[run.controller].learned
        ]
        if not learned:
            continue
        cells = min(MOST, max(len(run.memory["current"]) for run in learned))
        longest = max(_period(run) for run in learned)
        grid = np.linspace(0, longest, cells + 1)
        series = [
            {
                "controller": place(results, run),
                "values": plain(
                    np.interp(grid, run.memory["angle"], run.memory["current"], period=_period(run))
                ),
            }
            for run in learned
        ]
        angle = np.round(np.rad2deg(grid), 3).tolist()
        charts.append(
            {
                "title": "Learned current",
                "x": f"{frame} angle (°)",
                "quantity": "current",
                "unit": "A",
                "angle": angle,
                "series": series,
            }
        )
    return charts


def _period(run: Run) -> float:
    """The angle that a map covers, rad: a revolution, or the period of a law that learns in angle."""
    angle = run.memory["angle"]
    return float(len(angle) * (angle[1] - angle[0]))
