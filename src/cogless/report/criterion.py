"""The criterion's curve for laws that learn in angle, with what grew in the run marked on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.design.space_learning import SpaceLoop
from cogless.errors import StudyError
from cogless.report.growth import growth
from cogless.report.packing import plain
from cogless.report.palette import place
from cogless.report.paths import in_angle
from cogless.results import Results, Run

POINTS = 600

NOTE = (
    "By which factor what is learnt changes from period to period, at each frequency, by cogless design: "
    "below one it settles, above one it grows. Full: at the scenario's fastest speed, faint: at its slowest. "
    "An upright line marks what grew in the run: the spectrum of its q current as learning goes on beside "
    "that when it began; a trace shows frequencies up to half its rate."
)


def criterion(results: Results, runs: Sequence[Run]) -> dict[str, Any] | None:
    """Factors over frequency, on a common grid; None where no controller learns in angle."""
    loops = []
    for run in runs:
        law = in_angle(results.study, run.controller)
        if law is None:
            continue
        reference = results.study.scenario[run.scenario].reference
        speeds = sorted({max(reference.slowest, law.omega_min), reference.top_speed})
        loops += [
            (run, SpaceLoop(results.study, run.controller, speed), 1.0 if speed == speeds[-1] else 0.4)
            for speed in speeds
            if speed >= law.omega_min
        ]
    if not loops:
        return None
    f = np.geomspace(
        min(loop.frequencies[0] for _, loop, _ in loops),
        max(loop.frequencies[-1] for _, loop, _ in loops),
        POINTS,
    )
    series: list[dict[str, Any]] = []
    for run, loop, fade in loops:
        try:
            factor = np.where(f <= loop.frequencies[-1], loop.factor(f), np.nan)
        except StudyError:
            continue
        label = f"{60 * loop.omega_m / (2 * np.pi):.3g} rpm"
        series.append(
            {"controller": place(results, run), "label": label, "fade": fade, "values": plain(factor)}
        )
    marks = [
        {"controller": place(results, run), "at": found.frequency}
        for run in runs
        if (found := growth(results, run)) is not None
    ]
    return {"frequency": plain(f), "series": series, "marks": marks}
