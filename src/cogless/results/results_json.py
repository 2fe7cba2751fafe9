"""Write results.json: the study's settings, and each run's metrics with a summary of what it learned.

The module also writes the maps that a study's runs have learned, as firmware stores them: one file per run.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cogless.files import replacing, versions
from cogless.maps.stored_map import write as write_map
from cogless.results.fault_response import Response
from cogless.results.metrics import Value, result_name
from cogless.results.runs import AnyResults

if TYPE_CHECKING:
    from cogless.design.trials.gains import TrialDesign


def to_dict(results: AnyResults) -> dict[str, Any]:
    """Content of results.json, in plain types; a number that isn't finite becomes null, for "never"."""
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
        **results.study.scenario_facts(results.scenarios),
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
        **_not_designed(results),
        **_learning_off(results),
        **_limits(results),
    }


def run_id(results: AnyResults) -> str:
    """Identity of a run, which all of its files carry: equal if all settings, versions and results are."""
    text = json.dumps(to_dict(results), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write(results: AnyResults, path: Path, files: Mapping[str, str] | None = None) -> None:
    """Write results.json, completely or not at all. `files`: SHA-256 of the set's other files, by name."""
    content = {"run": run_id(results), **to_dict(results), "files": dict(files or {})}
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _learning_off(results: AnyResults) -> dict[str, Any]:
    """What each scenario's best law leaves with its learning off, SI; null: it did not hold the speed."""
    if not results.learning_off:
        return {}
    return {"learning_off": [asdict(off) for off in results.learning_off.values()]}


def _limits(results: AnyResults) -> dict[str, Any]:
    """What limits each scenario's best run; shares are of the metric's square, values in its SI unit.

    A value that is null: no controller holds the speed of the scenario.
    """
    if not results.limits:
        return {}
    entries = [
        {
            "scenario": limited.scenario,
            "controller": limited.controller,
            "metric": limited.metric,
            **({} if limited.order is None else {"order": limited.order}),
            "value": _plain(limited.value),
            "causes": [
                {"cause": cause.name, "without": cause.value, "share": cause.share}
                for cause in limited.causes
            ],
            "untried": list(limited.untried),
            **({} if limited.learner is None else {"learner": asdict(limited.learner)}),
            **({} if limited.in_vain is None else {"in_vain": asdict(limited.in_vain)}),
            "tried": [
                {
                    "against": cure.cause,
                    "set": as_json(dict(cure.changes)),
                    "value": cure.value,
                    "setting": cure.setting,
                    "costs": {cost.metric: cost.ratio for cost in cure.costs},
                    **({} if cure.learner is None else {"learner": cure.learner}),
                    **({"by_chance": True} if cure.by_chance else {}),
                    **({"harms": [asdict(harm) for harm in cure.harms]} if cure.harms else {}),
                }
                for cure in limited.cures
            ],
        }
        for limited in results.limits.values()
    ]
    return {"limits": entries}


def _definitions(results: AnyResults) -> dict[str, dict[str, Any]]:
    """Definition of each metric by its name in the runs: kind, unit, signal; orders and frame, or floor."""
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
            meaning["floor"] = metric.floor
        definitions[result_name(metric)] = meaning
    return definitions


def _not_designed(results: AnyResults) -> dict[str, Any]:
    """The controllers that have no run because they can't be designed, and why; absent if there is none."""
    entries = [
        {"scenario": scenario, "controller": name, "why": str(why)}
        for (scenario, name), why in results.not_designed.items()
    ]
    return {"not_designed": entries} if entries else {}


def _design(design: TrialDesign) -> dict[str, Any]:
    from cogless.design.trials.trial_summary import design_dict

    return design_dict(design)


def _memory(memory: Mapping[str, Any]) -> dict[str, Any]:
    """Summary of what a law has learned: number of entries, peak, and for a current its RMS."""
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
        "rms_A": _plain(_rms(current)) if len(current) else 0.0,
    }


def _quality(quality: Mapping[str, Any]) -> dict[str, Any]:
    """Quality of learning as the controller computes it; null if the motor hasn't turned far enough."""
    names = {"residual_rad_per_s": "residual"}
    names |= {name: name for name in ("progress", "improving", "worsening") if name in quality}
    return {key: quality[name] if quality["known"] else None for key, name in names.items()}


def _fault(response: Response) -> dict[str, Any]:
    """A fault and the response of the run to it; null: it never happened, or couldn't be computed."""
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
    """A study's tables as JSON values; a value that JSON doesn't have (a date, infinity) becomes a text."""
    if isinstance(value, dict):
        return {key: as_json(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [as_json(inner) for inner in value]
    is_plain = isinstance(value, bool | int | str) or (isinstance(value, float) and math.isfinite(value))
    return value if is_plain else str(value)


def _plain(value: Value) -> Any:
    if value is None:
        return None
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if math.isfinite(value) else None


def _rms(x: NDArray[np.float64]) -> float:
    with np.errstate(over="ignore"):  # squares overflow in a run that grew
        return float(np.sqrt(np.mean(np.square(x))))


def name(scenario: str, controller: str) -> str:
    """The path of a run's map file within the folder of maps."""
    return f"{scenario}/{controller}.bin"


def write_all(results: AnyResults, folder: Path) -> None:
    """Write folder/SCENARIO/CONTROLLER.bin for each run that has a map."""
    for run in results.runs:
        if run.map is not None:
            path = folder / name(run.scenario, run.controller)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_map(path, bytes(run.map))
