"""The report's sections for a trial scenario."""

from __future__ import annotations

from typing import Any

from cogless.report.comparison import Line, lines_of, runs_in
from cogless.report.markup import note
from cogless.report.sections import Runs, Sections
from cogless.report.tables import line_table
from cogless.report.trials import certificate, overtrials, waveforms
from cogless.report.trials.gains import gain_table
from cogless.report.trials.plots import PICTURES
from cogless.report.trials.verdict import verdict
from cogless.results import TrialResults
from cogless.study.metric import EACH_TRIAL

__all__ = ["TRIALS"]


def _lines(results: TrialResults, scenario: str) -> list[Line]:
    """The lines of metrics that have one value per phase: one per metric and phase, in the study's order."""
    study, runs = results.study, runs_in(results, scenario)
    starts = study.scenario[scenario].starts
    lines: list[Line] = []
    for metric in study.metrics_in(scenario):
        if metric.kind not in EACH_TRIAL:
            named = [(f"{metric.name}, from trial {start}", None) for start in starts]
            lines += lines_of(study, metric, runs, named)
    return lines


def _charts(results: TrialResults, runs: Runs) -> dict[str, Any]:
    return {
        "over_trials": overtrials.over_trials(results, runs),
        "waveforms": waveforms.waveforms(results, runs),
        "certificate": certificate.curves(results, runs),
    }


def _parts(results: TrialResults, runs: Runs) -> dict[str, str]:
    return {
        "tables": line_table(results, runs, _lines(results, runs[0].scenario)),
        "certificates": certificate.certificate_table(results, runs),
        "certificate_note": note(certificate.NOTE),
        "gains": gain_table(results, runs),
    }


TRIALS = Sections("trials", _lines, verdict, _charts, _parts, PICTURES)
