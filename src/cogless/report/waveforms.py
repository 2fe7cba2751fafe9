"""Plots over time: the waveforms of a scenario, their zooms, the response to each event.

The module also computes the i_q that would produce exactly the reference's motion. A learning law has to
find this current.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cogless.report.charts import Chart, Curve, Grid, Span, Waveforms, Zoom
from cogless.report.comparison import pretty, speed_unit
from cogless.report.faults import spans
from cogless.report.markup import bucket, peaks, place
from cogless.report.panels import ALL_LEARNED, Panel, errors, in_angle, learned_terms
from cogless.results import Results, Run
from cogless.results.fault_response import faults_in
from cogless.results.trace import BLOCK_ROWS, Array, Trace
from cogless.study import for_scenario
from cogless.units import TURN


def needed_current(results: Results, run: Run) -> Callable[[slice], Array] | None:
    """The i_q whose torque would produce the reference's motion, as a function of the trace's rows.

    None if the trace lacks the signals for it.

    It is the run's own current, corrected by the torque that is missing for the reference's speed and
    acceleration. So it doesn't depend on assumed flux harmonics. With a tracking error it is valid at the
    rotor's angle.
    """
    trace = run.trace
    if "alpha_ref" not in trace or "tau_cogging" not in trace:
        return None
    study = for_scenario(results.study, run.scenario)
    mechanics, K_t = study.mechanics.stiff, study.motor.star().K_t

    def needed(rows: slice) -> Array:
        speed, alpha, load, cogging, i_q, tau_e = (
            trace.part(name, rows)
            for name in ("omega_ref", "alpha_ref", "tau_load", "tau_cogging", "i_q", "tau_e")
        )
        friction = mechanics.viscous_friction * speed + mechanics.coulomb_friction * np.sign(speed)
        torque = mechanics.inertia * alpha + friction + load / study.mechanics.ratio - cogging
        return np.asarray(i_q + (torque - tau_e) / K_t)

    return needed


SPEED_PAGE_POINTS = 560_000  # points of all waveforms of a page, at 2.7 bytes per point
WAVEFORM_POINTS_MOST, WAVEFORM_POINTS_LEAST = 20_000, 1_500  # points of one waveform
POINTS_FINE, MOST_FINE = 200_000, 4_000  # points of a page's close-ups in all; most of one waveform
TURNS_READABLE = 2  # revolutions in one plot
FAULT_BUTTONS = 6  # largest number of buttons for faults
FAULTS_FINE = 2  # largest number of faults with finer points
EVENT_POINTS = 1_200  # points of a waveform around an event
EVENT_SPAN = (-0.1, 1.5)  # s, begin and end of the drawn span, after an event


@dataclass(frozen=True)
class View:
    """A time span of the runs, s (None: the whole runs), drawn in at most `points` points."""

    span: tuple[float, float] | None
    points: int

    def rows_of(self, trace: Trace) -> slice:
        return slice(None) if self.span is None else trace.window(*self.span)

    def grid(self, trace: Trace) -> Grid:
        """Start and step of the view's points, s. A thinned value is at the middle time of its rows."""
        time = trace.time[self.rows_of(trace)]
        step = (bucket(len(time), self.points) / 2 or 1.0) * trace.period
        return Grid(float(time[0]) + (step - trace.period) / 2, step)

    def thinned(self, trace: Trace, values: Callable[[slice], Array]) -> Array:
        """What `values` returns for the view's rows, thinned to `points`; a long trace is read in pieces."""
        first, last, _ = self.rows_of(trace).indices(len(trace))
        size = bucket(last - first, self.points)
        if not size:
            return values(slice(first, last))
        pieces = trace.blocks(slice(first, last), max(1, BLOCK_ROWS // size) * size)
        return np.concatenate([peaks(values(rows), size) for rows in pieces])


def waveforms(results: Results, runs: Sequence[Run]) -> Waveforms:
    """Panels over the whole run, with finer points to zoom in at faults and over the last revolutions."""
    if not runs:
        return Waveforms([])
    spatial = any(in_angle(results, run) for run in runs)
    needed = spatial and needed_current(results, runs[0]) is not None
    legend = "; dashed: the current that the motion needs" if needed else ""
    panels = [
        Panel("Speed, reference dashed", "omega_m", "speed", speed_unit(results)),
        *errors(results, runs),
        Panel("Current reference", "i_q_ref", "i_q_ref", "A"),
        Panel("Torque of the motor, cogging included", "tau_motor", "torque", "N*m"),
        Panel(f"Learned part of the current reference{legend}", ALL_LEARNED, "current", "A"),
    ]
    if spatial:
        panels += [Panel(f"{axis} current", f"i_{axis}", f"i_{axis}", "A") for axis in "qd"]
        if any("P_t" in run.trace for run in runs):
            panels.append(Panel("Time of the last period, P_t, by the delay memory", "P_t", "P_t", "s"))
    share = len(panels) * len(results.runs)
    whole = View(None, max(WAVEFORM_POINTS_LEAST, min(WAVEFORM_POINTS_MOST, SPEED_PAGE_POINTS // share)))
    return _times(results, runs, panels, [whole, *_details(results, runs, whole.points, share)])


def _details(results: Results, runs: Sequence[Run], coarse: int, share: int) -> list[View]:
    """Views of the first faults and the last revolutions, if the run's `coarse` points are too few there."""
    time = runs[0].trace.time
    start, end = float(time[0]), float(time[-1])
    close_ups = [(since, until) for _, since, until in spans(results, runs, start, end)[:FAULTS_FINE]]
    last = _since(runs[0].trace, TURNS_READABLE)
    close_ups += [(last, end)] if last is not None else []
    fine = max(WAVEFORM_POINTS_LEAST, min(MOST_FINE, POINTS_FINE // share // max(1, len(close_ups))))
    views: list[View] = []
    for since, until in close_ups:
        since = max(since, views[-1].span[1]) if views and views[-1].span else since
        if until > since and fine >= 2 * coarse * (until - since) / (end - start):
            views.append(View((since, until), fine))
    return views


def zooms(results: Results, runs: Sequence[Run]) -> list[Zoom]:
    """Buttons above the waveforms: whole run, after the start-up, last revolutions, faults, events.

    The first fault is shown first, or the last revolution where nothing changes.
    """
    time = runs[0].trace.time
    start, end = float(time[0]), float(time[-1])
    buttons: list[Zoom] = []

    def add(name: str, since: float, until: float, first: bool = False) -> None:
        buttons.append(Zoom(name, max(start, since), min(end, until), first))

    changes = [e.time for e in results.study.scenario[runs[0].scenario].events if e.time < end]
    broken = spans(results, runs, start, end)
    add("whole run", start, end)
    started = _started(runs, min([end, *changes]))
    if started > start:
        add("after start-up", started, end)
    for name, count in (("last two revolutions", TURNS_READABLE), ("last revolution", 1)):
        since = _since(runs[0].trace, count)
        if since is not None:
            add(name, since, end, first=count == 1 and not broken and not changes)
    for fault, since, until in broken[:FAULT_BUTTONS]:
        add(f"fault at {fault.time:g} s", since, until, first=fault is broken[0][0])
    laws = [in_angle(results, run) for run in runs]
    for begun in sorted({law.learns_from for law in laws if law and 0 < law.learns_from < end}):
        add(f"learning begins at {begun:g} s", begun - 2, begun + 5)
    for change in changes:
        if not any(fault.time <= change <= fault.end for fault, _, _ in broken):
            add(f"event at {change:g} s", change - 0.1, change + 1)
    return buttons


def marks(results: Results, runs: Sequence[Run]) -> list[Span]:
    """Marks of the faults."""
    return [
        Span(fault.time, fault.end, " and ".join(fault.words))
        for fault in faults_in(results.study, runs[0].scenario)
    ]


def _since(trace: Trace, revolutions: int) -> float | None:
    """Time at which the reference's last `revolutions` revolutions begin, s; None if it turns less."""
    row, turned = len(trace) - 1, 0.0
    for rows in reversed(list(trace.blocks())):
        speed = np.abs(np.nan_to_num(trace.part("omega_ref", rows)))[::-1]
        remaining = turned + np.cumsum(speed) * trace.period / TURN
        within = int(np.count_nonzero(remaining <= revolutions))
        row, turned = row - within, float(remaining[-1])
        if within < len(remaining):
            return float(trace.time[row]) if row > 0 else None
    return None


def _started(runs: Sequence[Run], until: float) -> float:
    """Time, s, before `until`, at which the speed errors of all runs have decayed to their later size."""

    def errors(later: bool) -> Iterator[tuple[int, Array]]:
        for run in runs:
            stop = run.trace.window(0.0, until).stop
            for rows in run.trace.blocks(slice(stop // 2 if later else 0, stop)):
                error = np.abs(run.trace.part("omega_error", rows))
                yield rows.start, np.where(np.isfinite(error), error, 0.0)

    calm = 1.2 * max((float(np.max(error)) for _, error in errors(later=True)), default=0.0)
    last = [first + np.flatnonzero(error > calm) for first, error in errors(later=False)]
    return float(runs[0].trace.time[max((int(rows[-1]) for rows in last if len(rows)), default=0)])


def events(results: Results, runs: Sequence[Run]) -> list[Waveforms]:
    """Charts of speed and current reference around each event."""
    changes = results.study.scenario[runs[0].scenario].events
    last = float(runs[0].trace.time[-1])
    ends = [min(last, change.time) for change in changes[1:]] + [last]
    charts = []
    for event, end in zip(changes, ends, strict=False):
        name = f"load to {event.load:.3g} N·m at {event.time:g} s"
        panels = [
            Panel(f"Speed, {name}", "omega_m", "speed", speed_unit(results)),
            Panel(f"Current reference, {name}", "i_q_ref", "i_q_ref", "A"),
        ]
        before, after = EVENT_SPAN
        span = (max(0.0, event.time + before), min(event.time + after, end))
        if span[1] - event.time > 10 * runs[0].trace.period:
            chart = _times(results, runs, panels, [View(span, EVENT_POINTS)])
            start = chart.start - event.time
            charts.append(replace(chart, start=start, x="time since the event (s)"))
    return charts


def _times(
    results: Results, runs: Sequence[Run], panels: Sequence[Panel], views: Sequence[View]
) -> Waveforms:
    """The panels' series over time, each with the points of all views."""
    drawn = [
        Chart(title=panel.title, quantity=panel.quantity, unit=pretty(panel.unit), series=series)
        for panel in panels
        if (series := _series(results, runs, panel, views))
    ]
    whole, *details = [view.grid(runs[0].trace) for view in views]
    return Waveforms(drawn, "time (s)", whole.start, whole.step, details)


def _series(results: Results, runs: Sequence[Run], panel: Panel, views: Sequence[View]) -> list[Curve]:
    """A panel's signal of each run; also the speed's reference, and for laws in angle the needed current."""
    drawn: list[Curve] = []
    for run in runs:
        names = learned_terms(results, run) if panel.signal == ALL_LEARNED else [panel.signal]
        if not names or names[0] not in run.trace:
            continue
        if panel.signal == "omega_m" and not drawn:
            reference = _total(run.trace, ["omega_ref"], panel.scale)
            drawn.append(_curve(run.trace, reference, views, dash=True))
        if panel.signal == ALL_LEARNED and not drawn and in_angle(results, run):
            needed = needed_current(results, run)
            if needed is not None:
                drawn.append(_curve(run.trace, needed, views, dash=True, label="needed"))
        values = _total(run.trace, names, panel.scale)
        drawn.append(_curve(run.trace, values, views, controller=place(results, run)))
    # The series with the largest spread is drawn first, so that it doesn't hide the others; references last.
    return sorted(drawn, key=lambda one: math.inf if one.dash else -_spread(one.values))


def _total(trace: Trace, names: Sequence[str], scale: float) -> Callable[[slice], Array]:
    """The sum of signals, in units of `scale`, as a function of the trace's rows."""

    def total(rows: slice) -> Array:
        return np.asarray(np.sum([trace.part(name, rows) for name in names], axis=0) / scale)

    return total


def _curve(trace: Trace, values: Callable[[slice], Array], views: Sequence[View], **looks: Any) -> Curve:
    whole, *details = [view.thinned(trace, values) for view in views]
    return Curve(values=whole, details=details, **looks)


def _spread(x: Array) -> float:
    """Standard deviation of the second half of x; 0 if it isn't finite."""
    spread = float(np.std(x[len(x) // 2 :])) if len(x) else 0.0
    return spread if math.isfinite(spread) else 0.0
