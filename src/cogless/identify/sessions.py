"""Find how friction and the offset of i_q differ between recording sessions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cogless.identify.advice import Advice, recording
from cogless.identify.balance import Name, Rows
from cogless.identify.jackknife import Equations
from cogless.identify.result import Estimate, Value

SESSION_KEYS = ("c", "offset")  # coefficients that each session has of its own


@dataclass(frozen=True)
class Session:
    """A session's logs, and its friction and offset, A; all other coefficients are common to all sessions."""

    name: str
    logs: tuple[str, ...]
    values: dict[str, Value]


def sessions(estimate: Estimate) -> tuple[Session, ...]:
    """The sessions that the file of columns names, if there are two or more; else none."""
    names = dict.fromkeys(log.rule.session for log in estimate.logs if log.rule.session is not None)
    if len(names) < 2 or estimate.fit is None:
        return ()
    fit = Equations([_by_session(rows) for rows in estimate.rows]).fit(estimate.instrument)
    fitted_sessions = []
    for name in names:
        logs = tuple(log.name for log in estimate.logs if log.rule.session == name)
        keys = [key for key in SESSION_KEYS if (key, name) in fit]
        values = {key: Value(fit[key, name], fit.interval((key, name))) for key in keys}
        fitted_sessions.append(Session(name, logs, values))
    return tuple(fitted_sessions)


def _by_session(rows: Rows) -> Rows:
    """The rows with columns of friction and offset that are the session's own."""
    session = rows.log.rule.session
    if session is None:
        return rows
    own: dict[Name, Name] = {(key,): (key, session) for key in SESSION_KEYS}
    names = tuple(own.get(name, name) for name in rows.names)
    return replace(rows, names=names)


def sentences(fitted_sessions: tuple[Session, ...]) -> list[str]:
    """A sentence on each quantity that differs between sessions by more than the errors."""
    remarks: list[str] = []
    for key, quantity in (("c", "friction"), ("offset", "offset of i_q")):
        own = {session.name: session.values[key] for session in fitted_sessions if key in session.values}
        if len(own) < 2:
            continue
        low, high = min(own, key=lambda n: own[n].value), max(own, key=lambda n: own[n].value)
        if own[high].value - own[low].value > np.hypot(own[high].error, own[low].error):
            of = [f"{own[name].value:.3g} +- {own[name].error:.1g} A in {name}" for name in (low, high)]
            remarks.append(
                Advice(
                    f"Sessions differ: {quantity} {' and '.join(of)}; the result for all logs lies "
                    "between them; identify each session by itself, or warm the motor up first.",
                    *(recording(session=name) for name in (low, high)),
                )
            )
    return remarks
