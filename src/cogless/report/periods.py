"""Plots over the angle for laws that learn in angle: errors and learned current, period by period."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.report.comparison import pretty
from cogless.report.packing import Array, plain
from cogless.report.palette import place
from cogless.report.paths import errors, in_angle, learned_terms, periods
from cogless.results import Results, Run
from cogless.study.space_controller import Period

CELLS = 360
SHOWN = 5  # periods of a chart

NOTE = (
    "Over the angle that the law counts, period by period: faint is early, full is late. What repeats from "
    "line to line is what learning can remove; the learned current is all of its learned parts together."
)


def over_angle(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Charts over the angle, for each controller that learns in angle: its errors and its learned current."""
    return [chart for run in runs for chart in _charts(results, run)]


def _charts(results: Results, run: Run) -> list[dict[str, Any]]:
    turns, law = periods(results, run), in_angle(results, run)
    if turns is None or law is None:
        return []
    begun = turns[min(run.trace.window(0.0, law.learning_start).stop, len(turns) - 1)]
    chosen = _chosen(float(begun), float(turns[-1]))
    if not chosen or np.any(np.diff(turns) < 0):  # the rotor turns back: no function of the angle
        return []
    learned = np.sum([run.trace[name] for name in learned_terms(results, run)], axis=0)
    drawn = [(e.title, e.of(run.trace), e.quantity, e.unit) for e in errors(results, [run])]
    return [
        {
            "title": f"{title} over {_period(law.period)}: {results.study.label(run.controller)}",
            "x": "angle within the period (°)",
            "angle": np.linspace(0, 360, CELLS + 1).tolist(),
            "quantity": quantity,
            "unit": pretty(unit),
            "series": [
                {
                    "controller": place(results, run),
                    "label": f"period {k + 1}",
                    "fade": 0.25 + 0.75 * i / max(1, len(chosen) - 1),
                    "values": plain(_within(turns, x, k)),
                }
                for i, k in enumerate(chosen)
            ],
        }
        for title, x, quantity, unit in [*drawn, ("Learned current", learned, "current", "A")]
    ]


def _chosen(begun: float, end: float) -> list[int]:
    """Periods to draw: the last whole one without learning, and some after it, more early than late ones."""
    first, last = max(0, int(begun) - 1), int(end + 1e-6) - 1
    if last < first:
        return []
    steps = np.geomspace(1, last - first + 1, SHOWN) - 1
    return sorted({first + round(step) for step in steps})


def _within(turns: Array, x: Array, period: int) -> Array:
    """x over the period with this number, on the common grid of angles."""
    rows = slice(max(0, int(np.searchsorted(turns, period)) - 1), int(np.searchsorted(turns, period + 1)) + 1)
    return np.asarray(np.interp(period + np.linspace(0, 1, CELLS + 1), turns[rows], x[rows]))


def _period(period: Period) -> str:
    share = f"{period.turns}/{period.parts} of " if (period.turns, period.parts) != (1, 1) else ""
    return f"{share}one {period.of} revolution"
