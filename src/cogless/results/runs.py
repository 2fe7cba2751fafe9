"""Runs of a study: one controller in one scenario each, with trace, metrics and what was learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cogless.results.fault_response import Response
from cogless.results.metrics import Value
from cogless.results.trace import Trace

if TYPE_CHECKING:
    from cogless.design.trial import TrialDesign
    from cogless.maps.stored_map import StoredMap
    from cogless.study import AnyStudy, Study, TrialStudy


class Metrics(dict[str, Value]):
    """Metrics by name; a KeyError names those there are."""

    def __missing__(self, name: str) -> Value:
        raise KeyError(f"no metric {name!r}; there are {', '.join(self) or 'none'}")


@dataclass(frozen=True, eq=False)
class Run:
    """One controller in one scenario.

    `memory` is what was learned by the end, or empty: {"angle": rad, "current": A, "frame": "electrical" or
    "mechanical"}, or of trials {"learned": a number each sample}. `metrics` are SI, by their name in
    results.json. `quality` is what the controller says of its own learning at the end, not of trials:
    {"known", "residual": rad/s} and, of a law that learns, {"progress", "improving", "worsening"}. `faults`
    is what it did about each fault of its scenario.
    """

    scenario: str
    controller: str
    trace: Trace
    memory: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, Value] = field(default_factory=dict)
    design: TrialDesign | None = None  # of a study of trials: gains and certificate
    quality: Mapping[str, Any] = field(default_factory=dict)  # of learning, as the controller sees it
    faults: Sequence[Response] = ()
    map: StoredMap | None = None  # what was learned, as firmware stores it

    def __post_init__(self) -> None:
        object.__setattr__(self, "metrics", Metrics(self.metrics))


@dataclass(frozen=True, eq=False)
class AnyResults:
    """A study of whichever kind and what came out of it; `interrupted`: not all of its runs are here."""

    study: AnyStudy
    runs: Sequence[Run]
    interrupted: bool = False

    @property
    def scenarios(self) -> list[str]:
        """Scenarios that have a run, in the study's order."""
        return list(dict.fromkeys(run.scenario for run in self.runs))


@dataclass(frozen=True, eq=False)
class Results(AnyResults):
    """Results of a speed study."""

    study: Study


@dataclass(frozen=True, eq=False)
class TrialResults(AnyResults):
    """Results of a study of trials."""

    study: TrialStudy
