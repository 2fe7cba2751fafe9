"""Runs of a study: one controller in one scenario each, with trace, metrics and what was learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cogless.results.fault_response import Response
from cogless.results.limits import Limits
from cogless.results.metrics import Value
from cogless.results.trace import Trace
from cogless.study.base import Kind

if TYPE_CHECKING:
    from cogless.design.trials.gains import TrialDesign
    from cogless.errors import StudyError
    from cogless.maps.stored_map import StoredMap
    from cogless.study import AnyStudy, Study, TrialStudy


class Metrics(dict[str, Value]):
    """Metrics by name; a KeyError lists the available names."""

    def __missing__(self, name: str) -> Value:
        raise KeyError(f"no metric {name!r}; there are {', '.join(self) or 'none'}")


@dataclass(frozen=True, eq=False)
class Run:
    """The run of one controller in one scenario.

    `memory` is what was learned by the end, or empty: {"angle": rad, "current": A, "frame": "electrical" or
    "mechanical"}, or in trials {"learned": one number per sample}. `metrics` are SI values by their name in
    results.json. `quality` is the controller's own measure of its learning at the end, empty in trials:
    {"known", "residual": rad/s}, and for a law that learns also {"progress", "improving", "worsening"}.
    `faults` are the responses to each fault of the scenario. `feedback`, of a law that learns from trial to
    trial: one trial of each phase by the same controller without learning, one row for each sample.
    """

    scenario: str
    controller: str
    trace: Trace
    memory: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, Value] = field(default_factory=dict)
    design: TrialDesign | None = None  # of a study of trials: gains and certificate
    quality: Mapping[str, Any] = field(default_factory=dict)  # of learning, as the controller computes it
    faults: Sequence[Response] = ()
    map: StoredMap | None = None  # what was learned, as firmware stores it
    feedback: Trace | None = None
    lanes: int = 1  # how many runs the engine computed in step, this one among them

    def __post_init__(self) -> None:
        object.__setattr__(self, "metrics", Metrics(self.metrics))


@dataclass(frozen=True)
class LearningOff:
    """What a scenario's best learning law leaves with the same gains and its learning off.

    `metric`: the one that judges the scenario. `value`: SI; None: with learning off the law did not hold the
    speed.
    """

    scenario: str
    controller: str
    metric: str  # its name in results.json
    order: float | None
    value: float | None


@dataclass(frozen=True, eq=False)
class AnyResults:
    """A study of either kind and its finished runs. `interrupted`: some of its runs are missing."""

    study: AnyStudy
    runs: Sequence[Run]
    interrupted: bool = False
    limits: Mapping[str, Limits] = field(default_factory=dict, kw_only=True)
    learning_off: Mapping[str, LearningOff] = field(default_factory=dict, kw_only=True)
    not_designed: Mapping[tuple[str, str], StudyError] = field(default_factory=dict, kw_only=True)

    @property
    def scenarios(self) -> list[str]:
        """Scenarios that have a run, in the study's order."""
        return list(dict.fromkeys(run.scenario for run in self.runs))

    def without_design(self, scenario: str | None = None) -> list[str]:
        """A line for each controller that was not designed, of one scenario or of all: its label and why."""
        reasons = (
            f"{self.study.label(name)}: not designed: {why.text_without(self.study.source.path)}"
            for (where, name), why in self.not_designed.items()
            if scenario in (None, where)
        )
        return list(dict.fromkeys(reasons))


@dataclass(frozen=True, eq=False)
class Results(AnyResults):
    """Results of a speed study.

    `limits`: for each scenario, what limits its best run; empty if no further runs were made to find this.
    `learning_off`: for each scenario in which this was tried, the metric of its best run with learning off.
    """

    study: Study


@dataclass(frozen=True, eq=False)
class TrialResults(AnyResults):
    """Results of a study of trials. `not_designed`: why a (scenario, controller) did not run."""

    study: TrialStudy


RESULTS: Mapping[Kind, Callable[..., AnyResults]] = {"speed": Results, "trials": TrialResults}
