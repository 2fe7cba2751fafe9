"""Plots over trials: every metric that has a number a trial, and always the RMS of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cogless.report.comparison import pretty
from cogless.report.packing import pack
from cogless.report.palette import place
from cogless.report.trials.errors import Array, Judged, judged, rms_of_trials
from cogless.report.trials.phases import phases, zooms
from cogless.results import Run, TrialResults
from cogless.results.metrics import result_name
from cogless.study.metric import EACH_TRIAL
from cogless.units import factor


def over_trials(results: TrialResults, scenario: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Charts on a logarithmic axis, what changed when, zooms. A series holds the logarithms of its values."""
    study = results.study
    about, described = judged(study, scenario), study.scenario[scenario]
    found = phases(described)
    values = {run.controller: rms_of_trials(about, run, described.trials) for run in runs}
    charts = [_chart(results, f"RMS of the {about.quantity} in each trial", "RMS", about.unit, runs, values)]
    if charts[0]["series"] and about.floor is not None:
        charts[0] |= {"floor": about.floor, "floor_name": f"floor {about.text(about.floor)}"}
    return {
        "charts": [chart for chart in charts + _others(results, scenario, runs, about) if chart["series"]],
        "trials": described.trials,
        "marks": [{"trial": phase.start, "name": phase.name} for phase in found[1:]],
        "zooms": zooms(found),
    }


def _others(results: TrialResults, scenario: str, runs: Sequence[Run], about: Judged) -> list[dict[str, Any]]:
    """Charts of each further metric with a number a trial."""
    charts = []
    for metric in results.study.metrics_in(scenario):
        if metric.kind not in EACH_TRIAL or (metric.kind, metric.signal) == ("rms", about.signal):
            continue
        unit = metric.unit or metric.dimension.unit
        scale = factor(unit, metric.dimension) if metric.unit and metric.dimension.unit else 1.0
        taken = {run.controller: run.metrics.get(result_name(metric)) for run in runs}
        values = {c: np.asarray(v, dtype=float) / scale for c, v in taken.items() if v is not None}
        title = metric.name.replace("_", " ").capitalize()
        charts.append(_chart(results, title, metric.kind, pretty(unit), runs, values))
    return charts


def _chart(
    results: TrialResults,
    title: str,
    quantity: str,
    unit: str,
    runs: Sequence[Run],
    values: Mapping[str, Array | None],
) -> dict[str, Any]:
    series, untold = [], []
    for run in runs:
        x = values.get(run.controller)
        if x is None:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            series.append({"controller": place(results, run), "values": pack(np.log10(x))})
        label = results.study.label(run.controller)
        untold += _untold(label, int(np.sum(x == 0)), "at zero")
        untold += _untold(label, int(np.sum(~np.isfinite(x))), "not finite")
    note = f"Not on a logarithmic axis: {'; '.join(untold)}." if untold else ""
    return {"title": title, "quantity": quantity, "unit": unit, "series": series, "note": note}


def _untold(label: str, count: int, what: str) -> list[str]:
    return [f"{label}, {count} trial{'s' if count > 1 else ''} {what}"] if count else []
