"""What the page's plots show, as plain data for report.js."""

from __future__ import annotations

from typing import Any

from cogless.report.maps import maps
from cogless.report.overtime import events, waveforms, zooms
from cogless.report.palette import colours, place
from cogless.report.spectra import spectra
from cogless.results import Results
from cogless.units import ANGULAR_SPEED


def data(results: Results, speed_unit: str) -> dict[str, Any]:
    """All that report.js draws."""
    colour = colours(results)
    return {
        "controllers": [{"label": results.study.label(name), "colour": colour[name]} for name in colour],
        "scenarios": [_scenario(results, scenario, speed_unit) for scenario in results.scenarios],
    }


def speed_unit(results: Results) -> str:
    """The unit that the study's metrics show speeds in; rad/s where they don't say."""
    metrics = results.study.metric
    return next((m.unit for m in metrics if m.unit and m.dimension == ANGULAR_SPEED), ANGULAR_SPEED.unit)


def _scenario(results: Results, scenario: str, speed_unit: str) -> dict[str, Any]:
    runs = [run for run in results.runs if run.scenario == scenario and len(run.trace) > 1]
    if not runs:
        empty: dict[str, Any] = {"controllers": [], "waveforms": {"panels": []}}
        return {**empty, "zooms": [], "spectra": [], "maps": [], "events": []}
    return {
        "controllers": [place(results, run) for run in runs],
        "waveforms": waveforms(results, runs, speed_unit),
        "zooms": zooms(results, runs),
        "spectra": spectra(results, runs, speed_unit),
        "maps": maps(results, runs),
        "events": events(results, runs, speed_unit),
    }
