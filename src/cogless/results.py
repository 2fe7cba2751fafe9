"""Results of a study: its runs with their metrics, and results.json."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cogless.faults import Response
from cogless.files import replacing
from cogless.metrics import Value, result_name
from cogless.study.checks import NAME
from cogless.trace import Trace

if TYPE_CHECKING:
    from cogless.design.trial import TrialDesign
    from cogless.stored_map import StoredMap
    from cogless.study import AnyStudy, Study, TrialStudy


class Metrics(dict[str, Value]):
    """Metrics by name; a KeyError names those there are."""

    def __missing__(self, name: str) -> Value:
        raise KeyError(f"no metric {name!r}; there are {', '.join(self) or 'none'}")


@dataclass(frozen=True, eq=False)
class Run:
    """One controller in one scenario.

    `memory` is what was learnt by the end, or empty: {"angle": rad, "current": A, "frame": "electrical" or
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
    """Of a speed study."""

    study: Study


@dataclass(frozen=True, eq=False)
class TrialResults(AnyResults):
    """Of a study of trials."""

    study: TrialStudy


@cache
def versions() -> dict[str, str]:
    """Versions of what computes the numbers."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        cogless = version("cogless")
    except PackageNotFoundError:
        cogless = "not installed"
    return {"cogless": cogless, "python": platform.python_version(), "numpy": np.__version__}


def to_dict(results: AnyResults) -> dict[str, Any]:
    """What results.json holds, from plain types only; a number that isn't finite becomes null ("never")."""
    return {
        "study": results.study.name,
        "title": results.study.title,
        "version": versions()["cogless"],
        "versions": versions(),
        "seed": results.study.seed,
        "interrupted": results.interrupted,
        "baseline": results.study.baseline,
        "settings": as_json(results.study.source.tables),
        "metrics": _definitions(results),
        **({"trials": _trials(results)} if isinstance(results, TrialResults) else {}),
        "runs": [
            {
                "scenario": run.scenario,
                "controller": run.controller,
                "metrics": {name: _plain(value) for name, value in run.metrics.items()},
                "memory": _memory(run.memory),
                **({"quality": _quality(run.quality)} if run.quality else {}),
                **({"faults": [_fault(response) for response in run.faults]} if run.faults else {}),
                **({"design": _design(run.design)} if run.design is not None else {}),
            }
            for run in results.runs
        ],
    }


def write(results: AnyResults, path: Path) -> None:
    """Write results.json, whole or not at all."""
    text = json.dumps(to_dict(results), indent=2, allow_nan=False, ensure_ascii=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def runs_that_learned(path: Path) -> list[tuple[str, str]]:
    """(scenario, controller) of the runs in a results.json that learned a map or a trial's signal; none where
    it is not there or not readable."""
    try:
        runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
        names = [(run["scenario"], run["controller"]) for run in runs if run["memory"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [pair for pair in names if all(isinstance(name, str) and NAME.fullmatch(name) for name in pair)]


def _definitions(results: AnyResults) -> dict[str, dict[str, Any]]:
    """What each name in a run's metrics means: unit, kind, signal; orders and frame, or the floor."""
    definitions = {}
    for metric in results.study.metric:
        meaning: dict[str, Any] = {
            "kind": metric.kind,
            "unit": metric.dimension.unit,
            "signal": metric.signal,
        }
        if metric.kind == "order":
            meaning |= {"order": list(metric.order or ()), "frame": metric.frame}
        if metric.kind == "trials-to-floor":
            meaning["floor"] = metric.threshold
        definitions[result_name(metric)] = meaning
    return definitions


def _trials(results: TrialResults) -> dict[str, dict[str, Any]]:
    """Of each scenario: how many trials of how many samples, and the first trial of each phase."""
    study = results.study
    return {
        name: {
            "count": study.scenario[name].trials,
            "samples": study.samples(name),
            "phases": list(study.scenario[name].starts),
        }
        for name in results.scenarios
    }


def _design(design: TrialDesign) -> dict[str, Any]:
    from cogless.design.trial_summary import design_dict

    return design_dict(design)


def _memory(memory: Mapping[str, Any]) -> dict[str, Any]:
    """What was learnt in short: enough to see that something was, and how much."""
    if "learned" in memory:
        learned = np.asarray(memory["learned"], dtype=float)
        return {"samples": len(learned), "peak": _plain(float(np.max(np.abs(learned), initial=0.0)))}
    if not memory:
        return {}
    current = np.asarray(memory["current"], dtype=float)
    return {
        "frame": memory["frame"],
        "cells": len(current),
        "peak_A": _plain(float(np.max(np.abs(current), initial=0.0))),
        "rms_A": _plain(float(np.sqrt(np.mean(np.square(current))))) if len(current) else 0.0,
    }


def _quality(quality: Mapping[str, Any]) -> dict[str, Any]:
    """As the controller sees it; null where it has not yet turned far enough to know."""
    names = {"residual_rad_per_s": "residual"}
    names |= {name: name for name in ("progress", "improving", "worsening") if name in quality}
    return {key: quality[name] if quality["known"] else None for key, name in names.items()}


def _fault(response: Response) -> dict[str, Any]:
    """A fault and what the run did about it; null: never, or nothing that could be taken."""
    fault = response.fault
    return {
        "what": list(fault.words),
        "time_s": fault.time,
        "duration_s": fault.end - fault.time,
        "noticed": list(response.noticed),
        "noticed_after_s": _plain(response.noticed_after),
        "safe_s": response.safe,
        "not_learning_s": _plain(response.not_learning),
        "saturated_s": response.saturated,
        "before_s": _plain(list(response.before) if response.before else None),
        "after_s": _plain(list(response.after) if response.after else None),
        "ripple_before_rad_s": _plain(response.ripple_before),
        "ripple_after_rad_s": _plain(response.ripple_after),
        "largest_speed_error_rad_s": _plain(response.largest_error),
        "largest_current_A": _plain(response.largest_current),
        "current_limit_A": response.current_limit,
    }


def as_json(value: Any) -> Any:
    """A study's tables; what JSON doesn't have (a date, an infinite parameter) becomes a text."""
    if isinstance(value, dict):
        return {key: as_json(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [as_json(inner) for inner in value]
    known = isinstance(value, bool | int | str) or (isinstance(value, float) and math.isfinite(value))
    return value if known else str(value)


def _plain(value: Value) -> Any:
    if value is None:
        return None
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if math.isfinite(value) else None
