"""The page's sections and the pictures for one kind of scenario; the rest of the page is common to all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cogless.report.comparison import Line
from cogless.report.png import Picture
from cogless.report.verdict import ScenarioVerdict
from cogless.results import Run

Runs = Sequence[Run]  # of one scenario


@dataclass(frozen=True)
class Outcome:
    """How each controller's runs ended, as a table of words for the terminal.

    `rows`: a controller and its cells, one for each of `columns`.
    """

    note: str  # what the columns mean
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]


def no_outcome(results: Any, runs: Runs) -> Outcome | None:
    """None: the lines of metrics say how the runs ended."""
    return None


@dataclass(frozen=True)
class Sections:
    """Functions that take the results, of the kind's own type, and the scenario or its runs."""

    kind: str  # "speed" or "trials", as in the names of template and script in assets/
    lines: Callable[[Any, str], list[Line]]
    verdict: Callable[[Any, Runs], ScenarioVerdict | None]
    charts: Callable[[Any, Runs], dict[str, Any]]  # plain values for the script
    parts: Callable[[Any, Runs], dict[str, str]]  # tables and notes as HTML, for the template
    pictures: Mapping[str, Picture]
    outcome: Callable[[Any, Runs], Outcome | None] = no_outcome
