"""The report's sections for a speed scenario."""

from __future__ import annotations

from cogless.report import angle_charts, map_charts, order_charts, tables
from cogless.report.answer import answer, pictures
from cogless.report.best_runs import with_learning_off, with_limits
from cogless.report.charts import SpeedCharts
from cogless.report.comparison import compare
from cogless.report.markup import note, reservations
from cogless.report.page import Runs, Sections
from cogless.report.pictures import SPEED_PICTURES
from cogless.report.speed_tracking import strip
from cogless.report.speed_verdict import judged_line, learning_off, verdict
from cogless.report.tables import line_table, term_tables
from cogless.report.waveforms import events, marks, waveforms, zooms
from cogless.results import Results


def _charts(results: Results, runs: Runs) -> SpeedCharts:
    drawn = [run for run in runs if len(run.trace) > 1]
    followed = order_charts.tracked(results, drawn) if drawn else None
    return SpeedCharts(
        answer=pictures(results, runs),
        waveforms=waveforms(results, drawn),
        zooms=zooms(results, drawn) if drawn else [],
        marks=marks(results, drawn) if drawn else [],
        strip=strip(results, drawn) if drawn else [],
        spectra=order_charts.spectra(results, drawn) if drawn else [],
        maps=map_charts.maps(results, drawn),
        polar=map_charts.polar(results, drawn),
        angle=angle_charts.over_angle(results, drawn),
        criterion=angle_charts.criterion(results, drawn),
        bode=angle_charts.bode(results, drawn) if drawn else [],
        events=events(results, drawn) if drawn else [],
        waterfall=order_charts.waterfall(results, followed),
        tracking=order_charts.tracking(results, drawn, followed),
    )


def _parts(results: Results, runs: Runs) -> dict[str, str]:
    return {
        "tables": line_table(results, runs, compare(results, runs[0].scenario)),
        "spectra_note": note(" ".join((order_charts.SPECTRA_NOTE, order_charts.turned_back(results, runs)))),
        "spectra_left_out": reservations([order_charts.left_out(results, run) for run in runs]),
        "map_note": note(map_charts.MAP_NOTE),
        "angle_note": note(angle_charts.PERIODS_NOTE),
        "criterion_note": note(angle_charts.CRITERION_NOTE),
        "bode_note": note(angle_charts.SENSITIVITY_NOTE),
        "waterfall_note": note(order_charts.WATERFALL_NOTE),
        "tracking_note": note(order_charts.TRACKING_NOTE),
        "late": tables.late_table(results, runs),
        "terms": term_tables(results, runs),
    }


SPEED_SECTIONS = Sections(
    kind="speed",
    lines=compare,
    verdict=verdict,
    charts=_charts,
    parts=_parts,
    pictures=SPEED_PICTURES,
    answer=answer,
    learning_off=learning_off,
    with_learning_off=with_learning_off,
    with_limits=with_limits,
    judged_line=judged_line,
)
