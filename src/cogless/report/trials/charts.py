"""Data of the page's plots, plain values for trials.js."""

from __future__ import annotations

from typing import Any

from cogless.report.palette import colours, place
from cogless.report.trials.certificate import curves
from cogless.report.trials.overtrials import over_trials
from cogless.report.trials.waveforms import waveforms
from cogless.results import TrialResults


def data(results: TrialResults) -> dict[str, Any]:
    """All that trials.js draws."""
    colour = colours(results)
    return {
        "controllers": [{"label": results.study.label(name), "colour": colour[name]} for name in colour],
        "scenarios": [_scenario(results, scenario) for scenario in results.scenarios],
    }


def _scenario(results: TrialResults, scenario: str) -> dict[str, Any]:
    runs = [run for run in results.runs if run.scenario == scenario]
    return {
        "controllers": [place(results, run) for run in runs],
        "over_trials": over_trials(results, scenario, runs),
        "waveforms": waveforms(results, scenario, runs),
        "certificate": curves(results, runs),
    }
