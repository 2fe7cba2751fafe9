"""The report: one HTML file that needs nothing else. The template and its style and script are in assets/."""

from __future__ import annotations

from pathlib import Path

from cogless.files import replacing
from cogless.report import charts, criterion, maps, markup, periods, spectra
from cogless.report.comparison import speed_unit
from cogless.report.tables import metric_table, term_tables
from cogless.report.verdict import verdicts
from cogless.results import Results


def write(results: Results, path: Path) -> None:
    """Write the report, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(render(results), encoding="utf-8")


def render(results: Results) -> str:
    """The report as HTML. All of the user's text is escaped."""
    results = charts.drawable(results)
    unit = speed_unit(results)
    return markup.page(
        "report",
        results,
        verdicts(results, unit),
        charts.data(results, unit),
        lambda scenario: {
            "tables": metric_table(results, scenario),
            "spectra_note": markup.note(" ".join((spectra.NOTE, spectra.turned_back(results, scenario)))),
            "spectra_left_out": markup.reservations(spectra.left_out(results, scenario)),
            "map_note": markup.note(maps.NOTE),
            "angle_note": markup.note(periods.NOTE),
            "criterion_note": markup.note(criterion.NOTE),
            "terms": term_tables(results, scenario),
        },
    )
