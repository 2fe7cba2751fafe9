"""The rows of a run over which a metric is taken."""

from __future__ import annotations

from cogless.results.metrics import window_of
from cogless.results.runs import Results, Run
from cogless.study import Study
from cogless.study.metric import Metric


def late(results: Results, run: Run) -> slice:
    """Rows of the last part of a run, from which spectra and the shares of terms are computed.

    They are the time window of the scenario's last order metric. Without one they are the last quarter, or
    less if an event is shortly before it.
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
    """Rows over which a metric is taken: its window, else from its event to the next, else the last part."""
    end = float(run.trace.time[-1]) if len(run.trace) else 0.0
    if metric.span(end) is None and metric.event is None:
        return late(results, run)
    events = [event.time for event in results.study.scenario[run.scenario].events]
    return run.trace.window(*window_of(metric, run.trace, events))


def span_of(results: Results, metric: Metric, run: Run) -> tuple[float, float] | None:
    """The time span over which a metric is taken in a run, s; None if the run has no trace."""
    time = run.trace.time[rows_of(results, metric, run)]
    return (float(time[0]), float(time[-1])) if len(time) else None


def in_torque_mode(study: Study, run: Run, rows: slice) -> bool:
    """Whether an outer loop's current acts in some of these rows of a run, in place of the speed loop."""
    torque, time = study.scenario[run.scenario].torque_mode, run.trace.time[rows]
    return torque is not None and len(time) > 0 and torque.acts_within(float(time[0]), float(time[-1]))
