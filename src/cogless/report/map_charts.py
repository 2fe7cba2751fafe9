"""The learned maps for the page: current over angle at the end of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cogless.report.charts import Band, OverAngle, Polar, Series
from cogless.report.markup import place
from cogless.report.panels import learned_terms
from cogless.results import Results, Run
from cogless.results.trace import Array
from cogless.units import TURN

MAP_POINTS_MOST = 1440  # points of a map
POLAR_CELLS = 360  # cells of a polar map
SPREAD_PERIODS = 8  # last revolutions, from which a polar map's spread is computed
MOST_ROWS = 1_000_000  # last rows that are read for the spread: all of a long trace would take gigabytes

MAP_NOTE = (
    "The current that each controller has learned over one revolution, at the end of the run. The middle "
    "line of the circle is zero. The curve is the mean over the last revolutions; the band reaches from the "
    "least to the largest value at each angle."
)


def maps(results: Results, runs: Sequence[Run]) -> list[OverAngle]:
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
        cells = min(MAP_POINTS_MOST, max(len(run.memory["current"]) for run in learned))
        longest = max(_period(run) for run in learned)
        grid = np.linspace(0, longest, cells + 1)
        series = [
            Series(
                controller=place(results, run),
                values=np.interp(grid, run.memory["angle"], run.memory["current"], period=_period(run)),
            )
            for run in learned
        ]
        chart = OverAngle(
            title="Learned current",
            x=f"{frame} angle (°)",
            quantity="current",
            unit="A",
            angle=np.round(np.rad2deg(grid), 3).tolist(),
            series=series,
        )
        charts.append(chart)
    return charts


def _period(run: Run) -> float:
    """The angle that a map covers, rad: a revolution, or the period of a law that learns in angle."""
    angle = run.memory["angle"]
    return float(len(angle) * (angle[1] - angle[0]))


def polar(results: Results, runs: Sequence[Run]) -> list[Polar]:
    """Charts of the learned current around one revolution, with its spread over the last revolutions."""
    series: dict[str, list[Band]] = {"electrical": [], "mechanical": []}
    for run in runs:
        frame = run.memory["frame"] if run.memory else "mechanical"
        names = learned_terms(results, run)
        if names and frame in series:
            rows = slice(-MOST_ROWS, None)
            turns = run.trace.part("theta_m", rows) / TURN
            turns = turns * (results.study.motor.pole_pairs if frame == "electrical" else 1)
            turns_of_current = _last_turns(
                turns, np.sum([run.trace.part(name, rows) for name in names], axis=0)
            )
            if len(turns_of_current) > 1:
                least, largest = np.min(turns_of_current, axis=0), np.max(turns_of_current, axis=0)
                mean, where = np.mean(turns_of_current, axis=0), place(results, run)
                series[frame].append(Band(controller=where, values=mean, low=least, high=largest))
    return [
        Polar(f"Learned current around one {frame} revolution", "A", drawn)
        for frame, drawn in series.items()
        if drawn
    ]


def _last_turns(turns: Array, x: Array) -> Array:
    """x on an even grid of angle, a row for each of the last whole turns from angle zero to angle zero.

    No rows if a value isn't finite, or if there is no whole turn. Where the rotor turns back, the farthest
    angle so far counts.
    """
    if not np.all(np.isfinite(turns)) or not np.all(np.isfinite(x)) or not len(turns):
        return np.zeros((0, POLAR_CELLS))
    back = turns[-1] < turns[0]
    onward = np.maximum.accumulate(-turns if back else turns)
    first, last = math.ceil(onward[0]), math.floor(onward[-1])
    grid = np.arange(POLAR_CELLS) / POLAR_CELLS
    last_turns = np.arange(max(first, last - SPREAD_PERIODS), last)
    on_grid = [np.interp(k + grid, onward, x) for k in last_turns.tolist()]
    rows = np.array(on_grid).reshape(len(on_grid), POLAR_CELLS)
    return np.roll(rows[:, ::-1], 1, axis=1) if back else rows
