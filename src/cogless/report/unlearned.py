"""Runs that learned nothing, and why, so that their results aren't credited to learning."""

from __future__ import annotations

import numpy as np

from cogless.design.unlearned import Memory, never, revolutions_learned, starts_too_late, too_short
from cogless.report.paths import travelled
from cogless.results import Results, Run
from cogless.results.status import Status
from cogless.results.trace import BLOCK


def unlearned(results: Results, run: Run) -> str | None:
    """The reason why a run's law learned nothing that could act; None if it did, or if that is unknown.

    This is judged by the angle turned since the status first showed that learning wasn't frozen.
    """
    stop = BLOCK
    while (why := _within(results, run, slice(0, stop))) and stop < len(run.trace):
        stop *= 4  # what is enough at the beginning stays enough
    return why


def _within(results: Results, run: Run, rows: slice) -> str | None:
    """The reason by these rows, which begin with the run."""
    study, name, trace = results.study, run.controller, run.trace
    law, revolutions = study.controller[name], revolutions_learned(study, name)
    if revolutions is None or not isinstance(law, Memory) or not law.learned:
        return None
    if len(trace) < 2 or "status" not in trace:
        return None
    theta, status, speed = (trace.part(x, rows) for x in (travelled(results, run), "status", "omega_ref"))
    if not np.all(np.isfinite(theta) & np.isfinite(status)):
        return None
    learning = (status.astype(int) & Status.FROZEN) == 0
    cell = 2 * np.pi * float(revolutions) / law.cells
    if np.sum(np.abs(np.diff(theta))[learning[1:]]) < cell:
        end = float(trace.time[-1])
        why = starts_too_late(law, end) or never(study, run.scenario, name)
        why = why or too_short(law, revolutions, theta, end, speed)
        return why or "it was frozen all the time"
    since = int(np.argmax(learning))
    time = float(trace.time[-1] - trace.time[since]) + trace.period
    return too_short(law, revolutions, theta[since:], time, speed[since:])
