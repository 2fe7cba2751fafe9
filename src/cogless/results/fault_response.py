"""Responses of controllers to faults in a scenario: duration of the safe output, ripple before and after.

All is computed from the rows of a run's trace, so an event shorter than the time between rows may be missed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.control_library import NOTICED, SAFE_OUTPUT, Status
from cogless.results.trace import Trace
from cogless.study import Study, for_scenario
from cogless.study.scenario import Event
from cogless.units import TURN

Span = tuple[float, float]  # s

RIPPLE_ROWS_LEAST = 10  # fewest rows from which a ripple is computed


@dataclass(frozen=True)
class Fault:
    """A time span (s) in which a fault is present; overlapping faults are merged into one.

    `lasting`: the fault lasts to the scenario's end.
    """

    time: float
    end: float
    words: tuple[str, ...]
    lasting: bool = False


@dataclass(frozen=True)
class Response:
    """Response of a run to a fault, from the fault's beginning to that of the next fault, or to the end.

    `safe`, `not_learning`, `saturated`: total duration of that state, s. `noticed_after`: time from the fault
    to the first sign that the controller noticed the fault, s. `ripple_before`, `ripple_after`: RMS of the
    speed error about its mean over one turn of the reference, rad/s, in the spans `before` and `after`. None:
    never, or unknown.
    """

    fault: Fault
    noticed: tuple[str, ...]
    noticed_after: float | None
    safe: float
    not_learning: float | None  # None if the law does not learn
    saturated: float
    before: Span | None
    after: Span | None
    ripple_before: float | None
    ripple_after: float | None
    largest_error: float  # rad/s
    largest_current: float | None  # A, length of the current vector
    current_limit: float  # A


def faults_in(study: Study, scenario: str) -> list[Fault]:
    """Faults of a scenario in order of time. In a study with faults, temporary loads count as faults, too."""
    experiment = study.scenario[scenario]
    end = experiment.duration
    single = [Fault(f.time, min(f.end, end), (f.effect,), f.end >= end) for f in experiment.faults]
    single += [
        Fault(came.time, went.time, (f"load of {1e3 * came.load:.3g} mN·m",))
        for came, went in _knocks(study, scenario)
    ]
    merged: list[Fault] = []
    for fault in sorted(single, key=lambda fault: fault.time):
        if merged and fault.time <= merged[-1].end:
            last = merged.pop()
            words = tuple(dict.fromkeys((*last.words, *fault.words)))
            fault = Fault(last.time, max(last.end, fault.end), words, last.lasting or fault.lasting)
        merged.append(fault)
    return merged


def without_faults(study: Study, scenario: str) -> str | None:
    """Name of the scenario that is the same but has no faults; None if there is none."""
    experiment = study.scenario[scenario]
    knocks = [event for pair in _knocks(study, scenario) for event in pair]
    events = tuple(event for event in experiment.events if event not in knocks)
    alike = experiment.model_copy(update={"faults": (), "events": events})
    return next((n for n, other in study.scenario.items() if n != scenario and other == alike), None)


def _knocks(study: Study, scenario: str) -> list[tuple[Event, Event]]:
    """Pairs of events that set another load, and then the usual one again.

    Empty in a study without faults.
    """
    experiment = study.scenario[scenario]
    if not experiment.events or not any(other.faults for other in study.scenario.values()):
        return []
    usual = (experiment.load or for_scenario(study, scenario).mechanics.load).torque
    pairs = zip(experiment.events, experiment.events[1:], strict=False)
    return [(came, went) for came, went in pairs if came.load != usual and went.load == usual]


def responses(faults: Sequence[Fault], trace: Trace, current_limit: float, learns: bool) -> list[Response]:
    """Responses of a run, one per fault."""
    if len(trace) < RIPPLE_ROWS_LEAST or not faults:
        return []
    ends = [*(fault.time for fault in faults[1:]), math.inf]
    since = [0.0, *(fault.end for fault in faults[:-1])]
    return [
        _response(fault, trace, (start, end), current_limit, learns)
        for fault, start, end in zip(faults, since, ends, strict=True)
    ]


def _response(fault: Fault, trace: Trace, room: Span, limit: float, learns: bool) -> Response:
    """Response to one fault. `room`: from the end of the previous fault to the start of the next one, s."""
    period, during = trace.period, _span_rows(trace, (fault.time, room[1]))
    time, status = trace.time[during], np.nan_to_num(trace.part("status", during)).astype(int)

    def lasted(bits: int) -> float:
        return float(np.count_nonzero(status & bits) * period)

    seen = [(int(np.argmax((status & bit) > 0)), words) for bit, words in NOTICED.items() if lasted(bit)]
    before = _last_turn(trace, (room[0], fault.time))
    after = _last_turn(trace, (fault.end, room[1]))
    current = trace.part("i_amplitude", during) if "i_amplitude" in trace else np.zeros(0)
    return Response(
        fault=fault,
        noticed=tuple(words for _, words in sorted(seen)),
        noticed_after=max(0.0, float(time[min(seen)[0]]) - fault.time) if seen else None,
        safe=lasted(SAFE_OUTPUT),
        not_learning=lasted(Status.FROZEN) if learns else None,
        saturated=lasted(Status.SATURATED),
        before=before,
        after=after,
        ripple_before=ripple(trace, before),
        ripple_after=ripple(trace, after),
        largest_error=float(np.max(np.abs(trace.part("omega_error", during)))),
        largest_current=float(np.max(current)) if len(current) else None,
        current_limit=limit,
    )


def _last_turn(trace: Trace, room: Span) -> Span | None:
    """Span of the last whole turn of the reference within `room`; None if it turns less than that."""
    rows = _span_rows(trace, room)
    time = trace.time[rows]
    if len(time) < RIPPLE_ROWS_LEAST:
        return None
    remaining = np.cumsum(np.abs(trace.part("omega_ref", rows)[::-1]))[::-1] * trace.period
    if not remaining[0] >= TURN * (1 - 1e-9):
        return None
    first = int(np.flatnonzero(remaining >= TURN * (1 - 1e-9))[-1])
    return float(time[first]), float(time[-1]) + trace.period


def _span_rows(trace: Trace, span: Span) -> slice:
    """Rows of the trace within a span, whose end is excluded."""
    first, last = np.searchsorted(trace.time, np.array(span) - 1e-6 * trace.period)
    return slice(int(first), int(last))


def ripple(trace: Trace, span: Span | None) -> float | None:
    """RMS of the speed error about its mean, rad/s."""
    if span is None:
        return None
    with np.errstate(all="ignore"):
        return float(np.std(trace.part("omega_error", _span_rows(trace, span))))
