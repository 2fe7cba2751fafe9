"""How each controller of a trial scenario ended: its error, its own feedback's, and what its input took."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cogless.report.comparison import SAME, Line
from cogless.report.markup import NONE
from cogless.report.packing import number
from cogless.report.sections import Outcome
from cogless.report.trials.case import Case, case
from cogless.report.verdict import over, times
from cogless.results import Run, TrialResults


def outcome(results: TrialResults, runs: Sequence[Run]) -> Outcome | None:
    """A row for each controller; None if its scenario has no error to judge by."""
    c = case(results, runs)
    if c is None or not c.final:
        return None
    unit = f" ({c.about.unit})" if c.about.unit else ""
    where = " of the worst phase" if len(c.phases) > 1 else ""
    drive = c.study.plant is None
    quantity, heading = ("current", "current\n(A)") if drive else ("input", "input\n")
    note = (
        f"RMS of the {c.about.quantity}{unit} and of the {quantity}. End: the second half of the "
        f"trials{where}. Feedback alone: the same controller there without learning."
    )
    columns = ("trial 1", "end", "feedback\nalone", "learning\nleaves", heading, "trials at\nthe limit")
    return Outcome(note, columns, [(name, _cells(c, name)) for name in c.runs if name in c.final])


def own_lines(c: Case) -> list[Line]:
    """The lines that every study of trials has: what the same controllers leave without learning, the RMS of
    the input, and trials in which it was at its limit."""
    quantity, unit = ("current", "A") if c.study.plant is None else ("input", "")
    end = f"at the end{', worst phase' if len(c.phases) > 1 else ''}"
    alone = {name: c.feedback[name][c.worst_phase(name)] for name in c.final if name in c.feedback}
    limited = {name: float(count) for name, count in c.at_limit.items()}
    named = (
        (f"{c.about.quantity} rms without learning {end}", "rms", c.about.unit, alone),
        (f"{quantity} rms {end}", "rms", unit, c.input_rms),
        (f"trials at the {quantity} limit, of {c.trials}", "trials-at-limit", "", limited),
    )
    return [
        Line(name, kind, None, None, "mechanical", "none", shown, _finite(values))
        for name, kind, shown, values in named
        if values
    ]


def _finite(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _cells(c: Case, name: str) -> list[str]:
    phase = c.worst_phase(name)
    end, alone = c.final[name][phase], c.feedback[name][phase] if name in c.feedback else math.nan
    return [
        _figure(c.first(name, c.phases[0])),
        _figure(end),
        _figure(alone) if name in c.feedback else NONE,
        than(end, alone) if name in c.feedback else NONE,
        _figure(c.input_rms[name]) if name in c.input_rms else NONE,
        f"{c.at_limit[name]} of {c.trials}" if name in c.at_limit else NONE,
    ]


def _figure(value: float) -> str:
    return number(value) if math.isfinite(value) else "not finite"


def than(value: float, other: float) -> str:
    """A value against another in words, such as "46 times less"; "as much" if they differ by little."""
    if not math.isfinite(value) or not math.isfinite(other):
        return NONE
    if same_size(value, other):
        return "as much"
    return f"{times(over(value, other))} more" if value > other else f"{times(over(other, value))} less"


def same_size(value: float, other: float) -> bool:
    """Whether two values differ by little."""
    return value <= (1 + SAME) * other and other <= (1 + SAME) * value
