"""The report of a study of trials: one HTML file that needs nothing else."""

from __future__ import annotations

from pathlib import Path

from cogless.files import replacing
from cogless.report import markup
from cogless.report.tables import line_table
from cogless.report.trials import certificate, charts
from cogless.report.trials.gains import gain_table
from cogless.report.trials.lines import phase_lines
from cogless.report.trials.verdict import verdicts
from cogless.results import TrialResults


def write(results: TrialResults, path: Path) -> None:
    """Write the report, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(render(results), encoding="utf-8")


def render(results: TrialResults) -> str:
    """The report as HTML. All of the user's text is escaped."""
    return markup.page(
        "trials",
        results,
        verdicts(results),
        charts.data(results),
        lambda scenario: {
            "tables": line_table(results, scenario, phase_lines(results, scenario)),
            "certificates": certificate.certificate_table(results, scenario),
            "certificate_note": markup.note(certificate.NOTE),
            "gains": gain_table(results, scenario),
        },
    )
