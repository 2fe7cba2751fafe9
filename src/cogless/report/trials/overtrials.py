"""Plots over trials: every metric with one value per trial, and always the RMS of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cogless.report.comparison import shown_in
from cogless.report.packing import Array, pack
from cogless.report.palette import place
from cogless.report.trials.errors import judged, rms_of_trials
from cogless.report.trials.phases import groups, phases, zooms
from cogless.results import Run, TrialResults
from cogless.results.metrics import result_name
from cogless.study.metric import EACH_TRIAL


def over_trials(results: TrialResults, runs: Sequence[Run]) -> dict[str, Any]:
    """Charts on a logarithmic axis, marks of changes, and zooms. A series holds decimal logarithms."""
    study, scenario = results.study, runs[0].scenario
    about, described = judged(study, scenario), study.scenario[scenario]
    found = phases(described)
    values = {run.controller: rms_of_trials(about, run, described.trials) for run in runs}
    charts = [_chart(results, f"RMS of the {about.quantity} in each trial", "RMS", about.unit, runs, values)]
    if about.floor is not None:
        charts[0] |= {"floor": about.floor, "floor_name": f"floor {about.text(about.floor)}"}
    for metric in study.metrics_in(scenario):
        if metric.kind in EACH_TRIAL and (metric.kind, metric.signal) != ("rms", about.signal):
            unit, scale = shown_in(study, metric)
            taken = {run.controller: run.metrics.get(result_name(metric)) for run in runs}
            values = {c: np.asarray(v, dtype=float) / scale for c, v in taken.items() if v is not None}
            title = metric.name.replace("_", " ").capitalize()
            charts.append(_chart(results, title, metric.kind, unit, runs, values))
    return {
        "charts": [chart for chart in charts if chart["series"]],
        "trials": described.trials,
        "marks": [{"trial": group.start, "name": group.name} for group in groups(found) if group.start > 1],
        "zooms": zooms(found),
    }


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
        for count, what in ((np.sum(x == 0), "at zero"), (np.sum(~np.isfinite(x)), "not finite")):
            if count:
                told = f"{count} trial{'s' if count > 1 else ''} {what}"
                untold.append(f"{results.study.label(run.controller)}, {told}")
    note = f"Not on a logarithmic axis: {'; '.join(untold)}." if untold else ""
    about = {"title": title, "x": "trial", "quantity": quantity, "unit": unit}
    return {**about, "series": series, "note": note}
