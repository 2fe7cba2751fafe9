"""The report's sections for a speed scenario."""

from __future__ import annotations

from typing import Any

from cogless.report import criterion, late, maps, periods, sensitivity, spectra, tracking
from cogless.report.comparison import compare
from cogless.report.markup import note, reservations
from cogless.report.overtime import events, marks, waveforms, zooms
from cogless.report.plots import PICTURES
from cogless.report.sections import Runs, Sections
from cogless.report.speed_verdict import verdict
from cogless.report.status_lanes import strip
from cogless.report.tables import line_table, term_tables
from cogless.results import Results

LISTS = {
    "zooms": zooms,
    "marks": marks,
    "strip": strip,
    "spectra": spectra.spectra,
    "maps": maps.maps,
    "polar": maps.polar,
    "angle": periods.over_angle,
    "criterion": criterion.criterion,
    "bode": sensitivity.bode,
    "events": events,
}


def _charts(results: Results, runs: Runs) -> dict[str, Any]:
    drawn = [run for run in runs if len(run.trace) > 1]
    lists = {name: chart(results, drawn) if drawn else [] for name, chart in LISTS.items()}
    followed = tracking.tracked(results, drawn) if drawn else None
    return {
        "waveforms": waveforms(results, drawn),
        "waterfall": tracking.waterfall(results, followed),
        "tracking": tracking.tracking(results, drawn, followed),
        **lists,
    }


def _parts(results: Results, runs: Runs) -> dict[str, str]:
    return {
        "tables": line_table(results, runs, compare(results, runs[0].scenario)),
        "spectra_note": note(" ".join((spectra.NOTE, spectra.turned_back(results, runs)))),
        "spectra_left_out": reservations([spectra.left_out(results, run) for run in runs]),
        "map_note": note(maps.NOTE),
        "angle_note": note(periods.NOTE),
        "criterion_note": note(criterion.NOTE),
        "bode_note": note(sensitivity.NOTE),
        "waterfall_note": note(tracking.WATERFALL_NOTE),
        "tracking_note": note(tracking.NOTE),
        "late": late.table(results, runs),
        "terms": term_tables(results, runs),
    }


SPEED = Sections("speed", compare, verdict, _charts, _parts, PICTURES)
