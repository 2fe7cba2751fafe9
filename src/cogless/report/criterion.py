"""The learning factor over frequency for laws that learn in angle, marked where a run's current grew."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cogless import units
from cogless.design.learning_loop import LearningLoop
from cogless.design.verdict import judged
from cogless.errors import StudyError
from cogless.report.comparison import speed_unit
from cogless.report.growth import growth
from cogless.report.packing import plain
from cogless.report.palette import place
from cogless.report.paths import in_angle
from cogless.results import Results, Run

POINTS = 600

NOTE = (
    "By which factor what is learned changes from period to period, at each frequency, by cogless design: "
    "below one it settles, above one it grows. Full: at the scenario's fastest speed, faint: at the slowest "
    "that is judged, both without acceleration. "
    "An upright line marks what grew in the run: the spectrum of its q current as learning goes on beside "
    "that when it began; a trace shows frequencies up to half its rate."
)


def criterion(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """The chart of learning factors over frequency, on a common grid; empty if no law learns in angle."""
    loops: list[tuple[Run, LearningLoop, float]] = []
    for run in runs:
        if in_angle(results, run):
            with suppress(StudyError):
                ends = judged(results.study, run.scenario, run.controller)
                loops += [(run, loop, 1.0 if loop is ends[-1] else 0.4) for loop in ends]
    if not loops:
        return []
    lowest = min(loop.frequencies[0] for _, loop, _ in loops)
    f = np.geomspace(lowest, max(loop.frequencies[-1] for _, loop, _ in loops), POINTS)
    series = [
        {
            "controller": place(results, run),
            "label": units.format(loop.omega_m, speed_unit(results), units.ANGULAR_SPEED, digits=3),
            "fade": fade,
            "values": plain(np.where(f <= loop.highest, loop.factor(f), np.nan)),
        }
        for run, loop, fade in loops
    ]
    marks = [
        {"controller": place(results, run), "at": grown}
        for run in runs
        if (grown := growth(results, run))  # on a log axis
    ]
    about = {"title": "Factor per period", "x": "frequency (Hz)", "quantity": "factor", "unit": ""}
    return [{**about, "frequency": plain(f), "series": series, "marks": marks}]
