"""The report's sections for a trial scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cogless.report.comparison import Line, lines_of, runs_in
from cogless.report.markup import note
from cogless.report.sections import Runs, Sections
from cogless.report.tables import line_table
from cogless.report.trials import certificate, overtrials, waveforms
from cogless.report.trials.case import case
from cogless.report.trials.gains import gain_table
from cogless.report.trials.outcome import outcome, own_lines
from cogless.report.trials.phases import groups, phases
from cogless.report.trials.plots import PICTURES
from cogless.report.trials.verdict import verdict
from cogless.results import TrialResults
from cogless.study.metric import EACH_TRIAL

__all__ = ["TRIALS"]


def _lines(results: TrialResults, scenario: str) -> list[Line]:
    """The lines of metrics that have one value per phase, in the study's order.

    A metric has a line for each group of phases: of many phases the worst value.
    """
    study, runs = results.study, runs_in(results, scenario)
    together = groups(phases(study.scenario[scenario]))
    lines: list[Line] = []
    for metric in study.metrics_in(scenario):
        if metric.kind not in EACH_TRIAL:
            named = [(metric.name, None) for group in together for _ in group.phases]
            each = iter(lines_of(study, metric, runs, named))
            for group in together:
                lines.append(_worst([next(each) for _ in group.phases], f"{metric.name}, {group.row}"))
    return lines


def _worst(lines: Sequence[Line], name: str) -> Line:
    """One line with each controller's worst value of several lines: the largest, unless higher is better."""
    worst = min if lines[0].better == "higher" else max
    columns = {c: [line.values[c] for line in lines] for c in lines[0].values}
    known = {c: [value for value in column if value is not None] for c, column in columns.items()}
    values = {c: worst(known[c]) if len(known[c]) == len(lines) else None for c in columns}
    return replace(lines[0], name=name, values=values)


def _charts(results: TrialResults, runs: Runs) -> dict[str, Any]:
    return {
        "over_trials": overtrials.over_trials(results, runs),
        "waveforms": waveforms.waveforms(results, runs),
        "certificate": certificate.curves(results, runs),
    }


def _parts(results: TrialResults, runs: Runs) -> dict[str, str]:
    judged = case(results, runs)
    lines = [*_lines(results, runs[0].scenario), *(own_lines(judged) if judged is not None else [])]
    return {
        "tables": line_table(results, runs, lines),
        "certificates": certificate.certificate_table(results, runs),
        "certificate_note": note(certificate.NOTE),
        "gains": gain_table(results, runs),
    }


TRIALS = Sections("trials", _lines, verdict, _charts, _parts, PICTURES, outcome)
