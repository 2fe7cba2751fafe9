"""What differs between recording sessions: friction, and the offset of i_q, as each session has them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cogless.identify.advice import Advice, recording
from cogless.identify.balance import Rows
from cogless.identify.result import Estimate, Value

PARTS = 12  # of a session's rows, for the jackknife
FEWEST = 5  # rows of a part
TOLD = ("c", "offset")  # what a session may have of its own


@dataclass(frozen=True)
class Session:
    """A session's logs, and its friction and offset, A, with all else as in all sessions together."""

    name: str
    logs: tuple[str, ...]
    values: dict[str, Value]


def sessions(made: Estimate) -> tuple[Session, ...]:
    """The sessions that the file of columns names, where there are two or more."""
    names = dict.fromkeys(log.rule.session for log in made.logs if log.rule.session is not None)
    if len(names) < 2 or made.fit is None:
        return ()
    found = []
    for name in names:
        logs = tuple(log.name for log in made.logs if log.rule.session == name)
        rows = [each for each in made.rows if each.log.name in logs and each.log.kind != "load"]
        found.append(Session(str(name), logs, _own(made, rows)))
    return tuple(found)


def _own(made: Estimate, rows: list[Rows]) -> dict[str, Value]:
    """Coefficients as these rows alone would have them, the others as all rows have them."""
    assert made.fit is not None
    fit = made.fit
    keys = [key for key in TOLD if (key,) in fit and all((key,) in each.names for each in rows)]
    parts = []
    for each in rows:
        columns = each.columns[:, [each.names.index((key,)) for key in keys]]
        left = each.y - fit.prediction(each)
        for own in np.array_split(np.arange(len(left)), max(1, min(PARTS, len(left) // FEWEST))):
            parts.append((columns[own].T @ columns[own], columns[own].T @ left[own]))
    if not keys or len(parts) < 2:
        return {}
    matrix, vector = sum(a for a, _ in parts), sum(b for _, b in parts)
    if np.linalg.cond(matrix) > 1e8:
        return {}
    moved = np.linalg.solve(matrix, vector)
    without = np.array([np.linalg.lstsq(matrix - a, vector - b, rcond=None)[0] for a, b in parts])
    count = len(parts)
    errors = np.sqrt((count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    return {
        key: Value(fit[key,] + float(by), 2 * float(error))
        for key, by, error in zip(keys, moved, errors, strict=True)
    }


def sentences(found: tuple[Session, ...]) -> list[str]:
    """What differs by more than its errors, a sentence each."""
    said: list[str] = []
    for key, about in (("c", "friction"), ("offset", "offset of i_q")):
        own = {session.name: session.values[key] for session in found if key in session.values}
        if len(own) < 2:
            continue
        low, high = min(own, key=lambda n: own[n].value), max(own, key=lambda n: own[n].value)
        if own[high].value - own[low].value > np.hypot(own[high].error, own[low].error):
            of = [f"{own[name].value:.3g} +- {own[name].error:.1g} A in {name}" for name in (low, high)]
            said.append(
                Advice(
                    f"Sessions differ: {about} {' and '.join(of)}; the values are between them; identify "
                    "each "
                    "session by itself, or warm the motor up first.",
                    *(recording(session=name) for name in (low, high)),
                )
            )
    return said
