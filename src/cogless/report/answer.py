"""The answer that a speed scenario opens with: a revolution before and after, and the ripple over time.

Before is the baseline, after is the best other controller. The chart shows the signal of the metric that
judges the scenario, at the end of the metric's window. The x axis is the rotor's angle, so that cogging acts
at the same place in both curves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cogless.control_library import Status
from cogless.report.charts import Curve, OverGrid, Series, Span
from cogless.report.comparison import QUANTITIES, Line, pretty, shown_in
from cogless.report.markup import place, thin
from cogless.report.speed_tracking import STATE_TIME_LEAST, spans
from cogless.report.speed_verdict import Contrast, changed_by, contrast
from cogless.report.verdicts import Answer, called
from cogless.results import Results, Run
from cogless.results.trace import Array, Trace
from cogless.study.base import spoken_unit
from cogless.study.metric import SIGNAL_DIMENSIONS, Metric
from cogless.units import factor

TURN_DEGREES = 360.0
PULSE_TURN_CELLS = 2160  # points over a revolution: 15 for each of 144 pulses
TIME_POINTS = 4000  # largest number of points of a curve over time
RIPPLE_POINTS = 400  # largest number of points of the ripple over time
EVENT_SPAN = (-0.1, 1.5)  # s, begin and end of the drawn span, after a metric's event
LAST_SPAN = 1.0  # s, the drawn span if the rotor turns less than a revolution
STRONG_SHARE = 0.3  # amplitude / the strongest order's, from which on an order is visible
HOLD_RISE_LEAST = 1.25  # ripple at a hold's end / before it, above which learning helps
TURN_PIECES = 8  # steps of the moving RMS per revolution; fewer if RIPPLE_POINTS demands it


def answer(results: Results, runs: Sequence[Run]) -> Answer | None:
    """The values of the metric that judges the scenario, before and after; None if nothing judges it."""
    pair = contrast(results, runs)
    if pair is None:
        return None
    line = pair.line
    figures = [(run.controller, "", line.value_text(run.controller)) for run in pair.runs]
    if pair.off is not None:
        figures.insert(-1, (pair.off.controller, "learning off", pair.off.text))
    return Answer(figures, changed_by(pair), ", ".join(word for word in (line.quantity, line.window) if word))


def pictures(results: Results, runs: Sequence[Run]) -> list[OverGrid]:
    """The answer's charts: a revolution of the runs before and after, and the ripple of all runs over time.

    The first chart is over time instead if the rotor turns less, or if the metric belongs to an event.
    """
    pair = contrast(results, runs)
    if pair is None:
        return []
    drawn = drawn_signal(results, pair)
    return [*_revolution(results, pair, drawn), *_ripple(results, runs, pair, drawn)]


@dataclass(frozen=True)
class DrawnSignal:
    """The signal that is drawn, and its unit."""

    signal: str
    unit: str
    scale: float  # SI value of the unit

    @property
    def quantity(self) -> str:
        return QUANTITIES.get(self.signal, self.signal)

    def part(self, trace: Trace, rows: slice) -> Array:
        return np.asarray(trace.part(self.signal, rows) / self.scale)


def drawn_signal(results: Results, pair: Contrast) -> DrawnSignal:
    """The signal of the metric that judges, in the metric's unit if it suits the signal, else the study's."""
    study, metric, name = results.study, pair.metric, pair.line.signal or "omega_error"
    dimension = SIGNAL_DIMENSIONS[name]
    if metric.dimension == dimension and metric.signal is not None:
        unit, scale = shown_in(study, metric)
    else:
        spoken = spoken_unit(study, dimension)
        unit, scale = pretty(spoken), factor(spoken, dimension) if dimension.unit else 1.0
    turns = name.startswith(("omega", "theta"))
    electrical = turns and pair.line.frame == "electrical" and pair.line.kind != "order"
    return DrawnSignal(name, unit, scale / (study.motor.pole_pairs if electrical else 1))


def _revolution(results: Results, pair: Contrast, drawn: DrawnSignal) -> list[OverGrid]:
    runs = [run for run in pair.runs if len(run.trace) > 1 and drawn.signal in run.trace]
    if not runs:
        return []
    turns = [_last_turn(run.trace, pair.line) for run in runs]
    by_angle = pair.metric.event is None and all(turn is not None for turn in turns)
    if by_angle:
        curves = [_over_angle(run.trace, drawn, turn) for run, turn in zip(runs, turns, strict=True) if turn]
        start, step, x, x_unit = 0.0, TURN_DEGREES / PULSE_TURN_CELLS, "angle of the rotor (°)", "°"
        title = f"{drawn.quantity.capitalize()} over the rotor's angle, in the last revolution"
        cycles = _strong_order(curves[0])
    else:
        begin, end = _span(pair.metric, pair.line, runs)
        rows = [run.trace.window(begin, end) for run in runs]
        thinned = [thin(drawn.part(run.trace, r), TIME_POINTS) for run, r in zip(runs, rows, strict=True)]
        step = thinned[0][1] * runs[0].trace.period
        curves = [curve for curve, _ in thinned]
        start, x, x_unit = float(begin), "time (s)", "s"
        title, cycles = f"{drawn.quantity.capitalize()} over time", 0
    series = [
        Curve(
            controller=place(results, run), label="", text=pair.line.value_text(run.controller), values=curve
        )
        for run, curve in zip(runs, curves, strict=True)
    ]
    return [
        OverGrid(
            title=title,
            x=x,
            x_unit=x_unit,
            quantity=drawn.quantity,
            unit=drawn.unit,
            cycles=cycles,
            start=start,
            step=step,
            series=series,
        )
    ]


def _last_turn(trace: Trace, line: Line) -> slice | None:
    """Rows of the rotor's last whole revolution in the line's window; None if it turns less or turns back."""
    if "theta_m" not in trace:
        return None
    end = trace.window(0.0, line.span[1]).stop if line.span else len(trace)
    last = float(trace.part("theta_m", slice(end - 1, end))[0]) if end else math.nan
    if not math.isfinite(last):
        return None
    for rows in reversed(list(trace.blocks(slice(0, end)))):
        back = np.abs(trace.part("theta_m", rows) - last)
        if not np.all(np.isfinite(back)):
            return None
        beyond = np.flatnonzero(back >= math.tau)
        if len(beyond):
            turn = slice(rows.start + int(beyond[-1]), end)
            speed = np.nan_to_num(trace.part("omega_ref", turn)) if "omega_ref" in trace else np.zeros(1)
            return None if np.any(speed > 0) and np.any(speed < 0) else turn
    return None


def _over_angle(trace: Trace, drawn: DrawnSignal, rows: slice) -> Array:
    """The signal over the rotor's angle, 0 to 360 degrees, from rows of a revolution."""
    theta, x = trace.part("theta_m", rows), drawn.part(trace, rows)
    order = np.argsort(theta, kind="stable")  # the angle falls if the rotor turns backwards, or shakes
    grid = np.linspace(0.0, math.tau, PULSE_TURN_CELLS + 1)
    start = theta.min()
    at = start + np.mod(grid[:-1] - start, math.tau)
    values = np.interp(at, theta[order], x[order])
    return np.append(values, values[0])


def _strong_order(curve: Array) -> int:
    """The highest order that one sees in a revolution: how many times the curve goes up and down."""
    if not np.all(np.isfinite(curve)):
        return 0
    amplitudes = np.abs(np.fft.rfft(curve[:-1]))
    amplitudes[0] = 0.0
    strong = np.flatnonzero(amplitudes >= STRONG_SHARE * amplitudes.max())
    return int(strong[-1]) if amplitudes.max() > 0 else 0


def _span(metric: Metric, line: Line, runs: Sequence[Run]) -> tuple[float, float]:
    """Begin and end, s, of the drawn span for a metric of an event, or for a rotor that does not turn."""
    start, end = float(runs[0].trace.time[0]), float(runs[0].trace.time[-1])
    if metric.event is not None:
        return max(start, metric.event + EVENT_SPAN[0]), min(end, metric.event + EVENT_SPAN[1])
    first, last = line.span or (start, end)
    return max(start, first, last - LAST_SPAN), min(end, last)


def _ripple(results: Results, runs: Sequence[Run], pair: Contrast, drawn: DrawnSignal) -> list[OverGrid]:
    """The chart of each run's moving RMS: over a revolution, or 1/20 of a run that turns too little."""
    runs = [run for run in runs if len(run.trace) > RIPPLE_POINTS and drawn.signal in run.trace]
    if not runs:
        return []
    trace = runs[0].trace
    of_turn = _rows_of_turn(trace)
    whole = of_turn or len(trace) // 20
    size = max(1, whole // TURN_PIECES, -(-len(trace) // RIPPLE_POINTS))
    count = max(1, round(whole / size))
    about_mean = pair.line.kind != "rms"
    curves = [_moving_rms(run.trace, drawn, size, count, about_mean) for run in runs]
    if max(map(len, curves)) < 2:
        return []
    series = [
        Series(controller=place(results, run), values=values)
        for run, values in zip(runs, curves, strict=True)
    ]
    step = size * trace.period
    start, compared = float(trace.time[0]) + count * step, {run.controller for run in pair.runs}

    def rows_of(since: float, until: float) -> slice:
        """The rows of the curve from one time to another, s."""
        first, last = (max(0, math.floor((time - start) / step)) for time in (since, until))
        return slice(first, last + 1)

    quantity = f"{drawn.quantity}{' ripple' if about_mean else ''}, rms"
    while_ = "revolution" if of_turn and count * size < 1.5 * of_turn else f"{count * step:.2g} s"
    holds = [
        Span(since, until, _hold_label(results, run, curve[rows_of(since, until)]))
        for run, curve in zip(runs, curves, strict=True)
        if run.controller in compared and results.study.controller[run.controller].learns
        for since, until in spans(run, Status.GUARDED)
        if until - since > STATE_TIME_LEAST
    ]
    return [
        OverGrid(
            title=f"{quantity[0].upper()}{quantity[1:]} of the last {while_}, over time",
            x="time (s)",
            quantity=quantity,
            unit=drawn.unit,
            start=start,
            step=step,
            holds=holds,
            series=series,
        )
    ]


def _hold_label(results: Results, run: Run, ripple: Array) -> str:
    """The label of a time span in which the guard holds a law back: a test, or a hold.

    `ripple`: the ripple's curve, from the last value before the span to its end. If the ripple rises, the
    guard tests what the feedback alone leaves, and finds that learning helps.
    """
    name = called(results.study, run.controller)
    is_test = len(ripple) > 1 and ripple[-1] > HOLD_RISE_LEAST * ripple[0]
    return f"test: {name} without learning" if is_test else f"the guard holds {name} back"


def _rows_of_turn(trace: Trace) -> int:
    """Rows of a revolution at the reference's mean speed; 0 if the run turns less than twice."""
    if "omega_ref" not in trace:
        return 0
    speeds = [np.abs(np.nan_to_num(trace.part("omega_ref", rows))) for rows in trace.blocks()]
    turned = sum(float(np.sum(speed)) for speed in speeds) * trace.period / (math.tau)
    return round(len(trace) / turned) if turned >= 2 else 0


def _moving_rms(trace: Trace, drawn: DrawnSignal, size: int, count: int, about_mean: bool) -> Array:
    """A signal's moving RMS, over windows of `count` successive pieces with `size` rows each.

    `about_mean`: the window's mean is subtracted first.
    """
    used = len(trace) // size * size
    origin = float(drawn.part(trace, slice(-1, None))[0]) if about_mean else 0.0
    origin = origin if math.isfinite(origin) else 0.0
    sums, squares = [], []
    for rows in trace.blocks(slice(0, used), size * max(1, (1 << 18) // size)):
        pieces = (drawn.part(trace, rows) - origin).reshape(-1, size)
        sums.append(pieces.mean(axis=1))
        squares.append(np.square(pieces).mean(axis=1))
    if used < size * count:
        return np.zeros(0)
    mean, square = (
        sliding_window_view(np.concatenate(parts), count).mean(axis=1) for parts in (sums, squares)
    )
    return np.asarray(np.sqrt(np.maximum(square - (mean**2 if about_mean else 0.0), 0.0)))
