"""Controllers against the metrics of each phase, one line a number, as in `cogless.report.comparison`."""

from __future__ import annotations

import math

from cogless.report.comparison import Line, pretty
from cogless.results import TrialResults
from cogless.results.metrics import result_name
from cogless.study.metric import EACH_TRIAL
from cogless.units import factor


def phase_lines(results: TrialResults, scenario: str) -> list[Line]:
    """A line for each phase of each metric that has a number a phase, in the study's order of metrics."""
    study = results.study
    runs = [run for run in results.runs if run.scenario == scenario]
    lines = []
    for metric in study.metrics_in(scenario):
        if metric.kind in EACH_TRIAL:
            continue
        dimension = metric.dimension
        unit = metric.unit or dimension.unit
        scale = factor(unit, dimension) if metric.unit and dimension.unit else 1.0
        values = {run.controller: run.metrics[result_name(metric)] for run in runs}
        for index, start in enumerate(study.scenario[scenario].starts):
            shown = {}
            for controller, of_phases in values.items():
                assert isinstance(of_phases, list)
                value = of_phases[index] / scale
                shown[controller] = value if math.isfinite(value) else None
            name = f"{metric.name}, from trial {start}"
            about = (name, metric.kind, metric.signal, None, "mechanical", metric.better, pretty(unit))
            lines.append(Line(*about, shown))
    return lines
