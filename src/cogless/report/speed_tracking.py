"""Whether a controller held the speed: one that did not can be the best at nothing."""

from __future__ import annotations

import numpy as np

from cogless.report.packing import Array, number, rms
from cogless.results import Results, Run
from cogless.study.metric import Metric
from cogless.units import ANGULAR_SPEED, factor

FAR = 0.05  # of the reference's mean magnitude: the mean speed is off
LOST = 0.5  # of the reference's rms: the speed doesn't follow a reference that averages to zero
DRIFT = 0.1  # rad/s, rms, where the reference is zero throughout
ONE_WAY = 0.1  # of its mean magnitude: a reference with a smaller mean averages to zero


def late(results: Results, run: Run) -> slice:
    """Rows of the last part of a run, which spectra and shares are of.

    The window of the scenario's last order metric, else the last quarter, but not soon after an event.
    """
    if not len(run.trace):
        return slice(0, 0)
    end = float(run.trace.time[-1])
    for metric in reversed(results.study.metrics_in(run.scenario)):
        span = metric.span(end)
        if metric.kind == "order" and span is not None and span[0] < end:
            return run.trace.window(*span)
    events = [event.time for event in results.study.scenario[run.scenario].events if event.time < end]
    return run.trace.window(max([0.75 * end, *(0.5 * (t + end) for t in events)]), end)


def rows_of(results: Results, metric: Metric, run: Run) -> slice:
    """Rows that a metric is of: its window, from its event to the next one, else the last part of the run."""
    trace = run.trace
    end = float(trace.time[-1]) if len(trace) else 0.0
    span, event = metric.span(end), metric.event
    if span is None and event is not None:
        later = [e.time for e in results.study.scenario[run.scenario].events if e.time > event + 1e-9]
        span = event, min([end, *later])
    return late(results, run) if span is None else trace.window(*span)


def span_of(results: Results, metric: Metric, run: Run) -> tuple[float, float] | None:
    """The span in which a metric is taken in a run, s; None where the run has no trace."""
    time = run.trace.time[rows_of(results, metric, run)]
    return (float(time[0]), float(time[-1])) if len(time) else None


def missed(run: Run, rows: slice, unit: str) -> str | None:
    """Words for a speed that missed its reference, such as "mean 0 of 60 rpm"; None: it was held.

    A start-up at the window's beginning isn't held against a run, nor a slow ripple: the speed must be off
    over the rows and over their second half.
    """
    scale = factor(unit, ANGULAR_SPEED)
    reference, speed = run.trace["omega_ref"][rows] / scale, run.trace["omega_m"][rows] / scale
    half = slice(len(speed) // 2, None)
    with np.errstate(all="ignore"):
        found = [_off(reference[part], speed[part], unit, DRIFT / scale) for part in (slice(None), half)]
    return found[0] if all(found) else None


def _off(reference: Array, speed: Array, unit: str, drift: float) -> str:
    """Words for how the speed is off its reference, both in `unit`; "" where it isn't."""
    if not len(speed):
        return ""
    if not np.all(np.isfinite(speed)):
        return "speed not finite"
    wanted, got, size = (float(np.mean(x)) for x in (reference, speed, np.abs(reference)))
    if abs(wanted) > ONE_WAY * size:
        off = abs(got - wanted) > FAR * size
        shown = got if abs(got) > 1e-3 * size else 0.0
        return f"mean {shown:.4g} of {wanted:.4g} {unit}" if off else ""
    error, amplitude = float(rms(reference - speed)), float(rms(reference))
    if error <= (LOST * amplitude or drift):
        return ""
    return f"error {number(error)} {unit} rms, reference {number(amplitude)} {unit} rms"
