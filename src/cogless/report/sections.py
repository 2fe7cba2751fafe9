"""The sections that a kind of scenario has on the page and as pictures, within the one frame of all."""

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
class Sections:
    """Functions of the results, of their own type, and of the runs of one scenario."""

    kind: str  # in the names of its template and script in assets/
    lines: Callable[[Any, str], list[Line]]
    verdict: Callable[[Any, Runs], ScenarioVerdict | None]
    charts: Callable[[Any, Runs], dict[str, Any]]  # plain values for the script
    parts: Callable[[Any, Runs], dict[str, str]]  # tables and notes as HTML, for the template
    pictures: Mapping[str, Picture]
