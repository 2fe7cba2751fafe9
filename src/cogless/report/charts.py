"""Data of the page's plots, plain values for report.js."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cogless.report.criterion import criterion
from cogless.report.maps import maps
from cogless.report.overtime import events, marks, waveforms, zooms
from cogless.report.palette import colours, place
from cogless.report.periods import over_angle
from cogless.report.spectra import spectra
from cogless.report.status_lanes import strip
from cogless.results import Results, Run

HUGE = 1e30  # far beyond any drive


def data(results: Results, speed_unit: str) -> dict[str, Any]:
    """All that report.js draws."""
    colour = colours(results)
    return {
        "controllers": [{"label": results.study.label(name), "colour": colour[name]} for name in colour],
        "scenarios": [_scenario(results, scenario, speed_unit) for scenario in results.scenarios],
    }


def drawable(results: Results) -> Results:
    """The results with NaN for what isn't finite or is too large to draw."""
    return replace(results, runs=[_drawable(run) for run in results.runs])


def _drawable(run: Run) -> Run:
    data = run.trace.data
    # a NaN makes both comparisons false
    if not data.size or (data.min() > -HUGE and data.max() < HUGE):
        return run
    with np.errstate(invalid="ignore"):
        tamed = np.where(np.abs(data) < HUGE, data, np.nan)
    return replace(run, trace=replace(run.trace, data=tamed))


def _scenario(results: Results, scenario: str, speed_unit: str) -> dict[str, Any]:
    runs = [run for run in results.runs if run.scenario == scenario and len(run.trace) > 1]
    if not runs:
        empty: dict[str, Any] = {"controllers": [], "waveforms": {"panels": []}}
        return {
            **empty,
            "zooms": [],
            "marks": [],
            "strip": [],
            "spectra": [],
            "maps": [],
            "angle": [],
            "criterion": None,
            "events": [],
        }
    return {
        "controllers": [place(results, run) for run in runs],
        "waveforms": waveforms(results, runs, speed_unit),
        "zooms": zooms(results, runs),
        "marks": marks(results, runs),
        "strip": strip(results, runs),
        "spectra": spectra(results, runs, speed_unit),
        "maps": maps(results, runs),
        "angle": over_angle(results, runs),
        "criterion": criterion(results, runs),
        "events": events(results, runs, speed_unit),
    }
