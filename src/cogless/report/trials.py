"""The report's sections for a trial scenario.

Plots over trials show every metric with one value per trial, and always the RMS of the error. The waveforms
of chosen trials can be drawn over each other. A table has the gains that each controller ran with, and how
they were found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import escape

import numpy as np
from numpy.typing import NDArray

from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.state_feedback import Check
from cogless.design.trials.trial_summary import labelled_notes, matrix_flash, matrix_size, megabytes
from cogless.report import trial_certificate
from cogless.report.charts import (
    Changed,
    ChosenTrials,
    Curve,
    OverGrid,
    OverTrials,
    TrialCharts,
    TrialCurves,
    TrialPanel,
    Trials,
    TrialWaveforms,
)
from cogless.report.comparison import Line, lines_of, runs_in, shown_in
from cogless.report.markup import DASH, headings, note, number, place, table, table_rows, thin
from cogless.report.page import Runs, Sections
from cogless.report.phases import (
    ERROR_NAMES,
    Phase,
    display_unit,
    groups,
    judged,
    phases,
    rms_of_trials,
    zooms,
)
from cogless.report.pictures import TRIAL_PICTURES
from cogless.report.tables import line_table
from cogless.report.trial_case import Case, case, outcome, own_lines
from cogless.report.trial_verdict import best_of, verdict
from cogless.report.verdicts import Answer, change_words, ratio
from cogless.results import Run, TrialResults
from cogless.results.metrics import result_name
from cogless.results.trace import Array
from cogless.study import TrialStudy
from cogless.study.metric import EACH_TRIAL, SIGNAL_DIMENSIONS


def over_trials(results: TrialResults, runs: Sequence[Run]) -> Trials:
    """Charts over the trials on a logarithmic axis, with marks of the changes, and zoom buttons."""
    study, scenario = results.study, runs[0].scenario
    metric_words, described = judged(study, scenario), study.scenario[scenario]
    all_phases, floor = phases(described), metric_words.floor
    values = {run.controller: rms_of_trials(metric_words, run, described.trials) for run in runs}
    title = f"RMS of the {metric_words.quantity} in each trial"
    first = _chart(results, title, "RMS", metric_words.unit, runs, values)
    if floor is not None:
        first = replace(first, floor=floor, floor_name=f"floor {metric_words.value_text(floor)}")
    charts = [first]
    for metric in study.metrics_in(scenario):
        if metric.kind in EACH_TRIAL and (metric.kind, metric.signal) != ("rms", metric_words.signal):
            unit, scale = shown_in(study, metric)
            taken = {run.controller: run.metrics.get(result_name(metric)) for run in runs}
            values = {c: np.asarray(v, dtype=float) / scale for c, v in taken.items() if v is not None}
            title = metric.name.replace("_", " ").capitalize()
            charts.append(_chart(results, title, metric.kind, unit, runs, values))
    return Trials(
        [chart for chart in charts if chart.series],
        described.trials,
        [Changed(group.start, group.name) for group in groups(all_phases) if group.start > 1],
        zooms(all_phases),
    )


def _chart(
    results: TrialResults,
    title: str,
    quantity: str,
    unit: str,
    runs: Sequence[Run],
    values: Mapping[str, Array | None],
) -> OverTrials:
    series, untold = [], []
    for run in runs:
        x = values.get(run.controller)
        if x is None:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            decades = np.log10(x)
        decades[~np.isfinite(decades)] = np.nan
        series.append(Curve(controller=place(results, run), values=decades))
        for count, what in ((np.sum(x == 0), "at zero"), (np.sum(~np.isfinite(x)), "not finite")):
            if count:
                count_words = f"{count} trial{'s' if count > 1 else ''} {what}"
                untold.append(f"{results.study.label(run.controller)}, {count_words}")
    note = f"The logarithmic axis cannot show: {'; '.join(untold)}." if untold else ""
    return OverTrials(title=title, x="trial", quantity=quantity, unit=unit, series=series, note=note)


TRIAL_PAGE_POINTS = 900_000  # points of all waveforms of a page, at 2.7 bytes per point
TRIAL_POINTS_LEAST = 200  # points of one waveform
MOST_PHASES = 24  # largest number of phases with waveforms
TRIAL_POINTS = 3000  # largest number of points of the answer's curve over a trial

# Title, signal, reference, quantity.
DRIVE = (
    ("Position, reference dashed", "theta_m", "theta_ref", "position"),
    ("Position error", "theta_error", None, "error"),
    ("Current reference", "i_q_ref", None, "i_q_ref"),
    ("Learned signal", "learned", None, "v"),
)
LINEAR = (
    ("Output, reference dashed", "y", "y_ref", "y"),
    ("Error", "y_error", None, "error"),
    ("Input", "u", None, "u"),
    ("Learned signal", "learned", None, "v"),
)


def waveforms(results: TrialResults, runs: Sequence[Run]) -> TrialWaveforms:
    """Panels over the time within a trial, with a series for each controller and chosen trial.

    The `note` says which phases are left out.
    """
    study, scenario = results.study, runs[0].scenario
    count = study.scenario[scenario].trials
    runs = [run for run in runs if len(run.trace) >= 2 * count and len(run.trace) % count == 0]
    if not runs:
        return TrialWaveforms(panels=[], phases=[], note="")
    together = groups(phases(study.scenario[scenario]))
    every = [phase for group in together for phase in group.drawn]
    shown_phases = every[:MOST_PHASES]
    chosen = [trial for phase in shown_phases for trial in phase.chosen]
    points = max(TRIAL_POINTS_LEAST, TRIAL_PAGE_POINTS // (len(DRIVE) * len(results.runs) * len(chosen)))

    def thinned(run: Run, signal: str, scale: float, trials: Sequence[int]) -> list[Array]:
        x = _of_trials(run, signal, count)
        return [thin(x[trial - 1] / scale, points)[0] for trial in trials]

    panels = []
    for title, signal, reference, quantity in panels_of(study, scenario):
        unit, scale = display_unit(study, signal)
        series = []
        for run in runs:
            if _is_drawn(run, signal, count):
                values = dict(zip(map(str, chosen), thinned(run, signal, scale, chosen), strict=True))
                series.append(TrialCurves(controller=place(results, run), trials=values))
        if not series:
            continue
        # the reference is the same for all controllers
        plan = thinned(runs[0], reference, scale, [p.start for p in shown_phases]) if reference else []
        panel = TrialPanel(title=title, quantity=quantity, unit=unit, references=plan, series=series)
        panels.append(panel)
    period = runs[0].trace.period
    step = thin(_of_trials(runs[0], "time", count)[0], points)[1] * period
    notes = [
        f"Of the {group.changes}, the first and the last are drawn."
        for group in together
        if len(group.phases) > 1
    ]
    if len(every) > MOST_PHASES:
        notes.append(f"Only the first {MOST_PHASES} of {len(every)} phases are drawn.")
    return TrialWaveforms(
        panels=panels,
        phases=[ChosenTrials(phase.name, phase.chosen) for phase in shown_phases],
        note=" ".join(notes),
        x="time in the trial (s)",
        start=(step - period) / 2,
        step=step,
    )


def panels_of(study: TrialStudy, scenario: str) -> list[tuple[str, str, str | None, str]]:
    """The panels of a study; the error panel shows the signal judged by, if that is an error."""
    if study.plant is not None:
        return list(LINEAR)
    signal = judged(study, scenario).signal
    error = signal if signal in ERROR_NAMES and signal in SIGNAL_DIMENSIONS else "theta_error"
    title = "Position error as measured" if error == "theta_error_measured" else "Position error"
    return [(title, error, None, q) if s == "theta_error" else (t, s, r, q) for t, s, r, q in DRIVE]


def _is_drawn(run: Run, signal: str, count: int) -> bool:
    """Whether to draw a run's signal: not if it is missing, or is a learned signal that ends at zero."""
    if signal not in run.trace:
        return False
    return signal != "learned" or bool(np.any(_of_trials(run, signal, count)[-1] != 0))


def _of_trials(run: Run, signal: str, count: int) -> Array:
    """A signal as a two-dimensional array, trials by rows."""
    return run.trace[signal].reshape(count, -1)


def gain_table(results: TrialResults, runs: Sequence[Run]) -> str:
    """HTML table with a row per gain and a column per controller; empty if no run has a design."""
    designs = {run.controller: run.design for run in runs if run.design is not None}
    columns = [dict(_gains(results.study, design)) for design in designs.values()]
    names = dict.fromkeys(name for column in columns for name in column)
    body = table_rows(
        (name, "".join(f"<td>{escape(column.get(name, DASH))}</td>" for column in columns)) for name in names
    )
    head = f"<th></th>{headings(results, designs)}"
    notes = "".join(map(note, labelled_notes(results.study, designs)))
    return table("gains", f"Gains in {runs[0].scenario}", head, body) + notes


def _gains(study: TrialStudy, design: TrialDesign) -> Iterator[tuple[str, str]]:
    """Yields the name, with unit, and the value of each gain, as text."""
    drive = study.plant is None
    states = ("theta_m", "omega_m") if study.plant is None else study.plant.names
    units = (" (A/rad)", " (A·s/rad)") if drive else ("",) * len(states)
    angle = units[0] if drive else ""
    for state, unit, gain in zip(states, units, design.K_1, strict=True):
        yield f"K_1, {state}{unit}", _plain(gain)
    yield f"K_2, integrator{angle}", _plain(design.K_2) if design.K_2 else DASH
    yield f"N{angle}", _plain(design.N)
    if design.learning_matrix is not None:
        flash = matrix_flash(study, design)
        needed = f", {megabytes(flash)} of flash" if flash else ""
        yield "learning matrix", f"{matrix_size(design)}{needed}"
    else:
        yield "K_3", _plain(design.K_3) if design.K_3 else DASH
    if design.K_3 or design.learning_matrix is not None:
        yield "learned signal into", "input and integrator" if design.through_integrator else "input"
        yield "shift r (samples)", str(design.shift)
    if design.q_filter is not None:
        yield "Q filter b", _list(design.q_filter.b)
        yield "Q filter a", _list(design.q_filter.a)
        yield "Q filter acts on", f"the {'error' if design.filtered == 'error' else 'learned signal'}"
    ahead = design.feedforward
    yield "feedforward", f"{ahead.method}, {ahead.preview} samples ahead" if ahead else DASH
    if ahead is not None:
        yield f"feedforward num{angle}", _list(ahead.num)
        yield "feedforward den", _list(ahead.den)
    feedback, learning = design.gains.feedback, design.gains.learning
    yield "K_1 and K_2 from", "given" if feedback is None else f"LMIs; {_check(feedback.check)}"
    if design.K_3:
        without_lmis = "given, or chosen by frequency"
        yield "K_3 from", without_lmis if learning is None else f"LMIs; {_check(learning.check)}"


def _check(check: Check) -> str:
    return (
        f"{'checked' if check.passed else 'CHECK FAILED'}: cost at the worst vertex {number(check.cost)}, "
        f"expected {number(check.bound)} or less"
    )


def _list(values: NDArray[np.float64]) -> str:
    return ", ".join(_plain(value) for value in values.tolist())


def _plain(value: float) -> str:
    return f"{value:.6g}"


__all__ = ["TRIALS"]


def answer(results: TrialResults, runs: Sequence[Run]) -> Answer | None:
    """The best controller's error in the first and the last trial of its worst phase."""
    judged = case(results, runs)
    if judged is None or best_of(judged) not in judged.rms:
        return None
    best, chosen = best_of(judged), first_and_last(worst_phase(judged))
    errors = [float(judged.rms[best][trial - 1]) for trial in chosen]
    figures = [
        (best, f"trial {trial}", judged.metric.value_text(x)) for trial, x in zip(chosen, errors, strict=True)
    ]
    compared = len(errors) > 1 and math.isfinite(sum(errors))
    words = change_words(ratio(errors[-1], errors[0])) if compared else ""
    return Answer(figures, words, f"RMS of the {judged.metric.quantity}")


def worst_phase(judged: Case) -> Phase:
    """The phase in whose first trial the best controller has its largest error."""
    best = best_of(judged)
    return max(judged.phases, key=lambda phase: np.nan_to_num(judged.first(best, phase)))


def first_and_last(phase: Phase) -> list[int]:
    """The first and the last trial of a phase; one trial if the phase has only one."""
    return list(dict.fromkeys((phase.start, phase.stop - 1)))


def pictures(results: TrialResults, runs: Sequence[Run]) -> list[OverGrid]:
    """The chart of the best controller's error over the first and the last trial of its worst phase."""
    judged = case(results, runs)
    if judged is None:
        return []
    best, count = best_of(judged), judged.trials
    run, signal, phase = judged.runs[best], judged.metric.signal, worst_phase(judged)
    chosen, error = first_and_last(phase), judged.metric.quantity
    if len(run.trace) < 2 * count or len(run.trace) % count or signal not in run.trace:
        return []
    trials, period = _of_trials(run, signal, count) / judged.metric.scale, run.trace.period
    step = thin(trials[0], TRIAL_POINTS)[1] * period
    return [
        OverGrid(
            title=f"{error.capitalize()} over one trial, first against last {phase.after}",
            x="time in the trial (s)",
            x_unit="s",
            quantity=error,
            unit=judged.metric.unit,
            start=(step - period) / 2,
            step=step,
            series=[
                Curve(
                    controller=place(results, run),
                    label=f"trial {trial}",
                    fade=0.45 if trial < chosen[-1] else 1.0,
                    values=thin(trials[trial - 1], TRIAL_POINTS)[0],
                )
                for trial in chosen
            ],
        )
    ]


def _metric_lines(results: TrialResults, scenario: str) -> list[Line]:
    """The lines of metrics that have one value per phase, in the study's order.

    A metric has a line for each group of phases, with the worst value of the group.
    """
    study, runs = results.study, runs_in(results, scenario)
    together = groups(phases(study.scenario[scenario]))
    lines: list[Line] = []
    for metric in study.metrics_in(scenario):
        if metric.kind not in EACH_TRIAL:
            named = [(metric.name, None) for group in together for _ in group.phases]
            phase_lines = iter(lines_of(study, metric, runs, named))
            for group in together:
                lines.append(_worst([next(phase_lines) for _ in group.phases], f"{metric.name}, {group.row}"))
    return lines


def _worst(lines: Sequence[Line], name: str) -> Line:
    """One line with each controller's worst value of several lines: the largest, unless higher is better."""
    worst = min if lines[0].better == "higher" else max
    columns = {c: [line.values[c] for line in lines] for c in lines[0].values}
    by_controller = {c: [value for value in column if value is not None] for c, column in columns.items()}
    values = {c: worst(by_controller[c]) if len(by_controller[c]) == len(lines) else None for c in columns}
    return replace(lines[0], name=name, values=values)


def _charts(results: TrialResults, runs: Runs) -> TrialCharts:
    return TrialCharts(
        answer=pictures(results, runs),
        over_trials=over_trials(results, runs),
        waveforms=waveforms(results, runs),
        certificate=trial_certificate.curves(results, runs),
    )


def _parts(results: TrialResults, runs: Runs) -> dict[str, str]:
    judged = case(results, runs)
    lines = [*_metric_lines(results, runs[0].scenario), *(own_lines(judged) if judged is not None else [])]
    return {
        "tables": line_table(results, runs, lines),
        "certificates": trial_certificate.certificate_table(results, runs),
        "certificate_note": note(trial_certificate.CERTIFICATE_NOTE),
        "gains": gain_table(results, runs),
    }


TRIALS = Sections(
    kind="trials",
    lines=_metric_lines,
    verdict=verdict,
    charts=_charts,
    parts=_parts,
    pictures=TRIAL_PICTURES,
    outcome=outcome,
    answer=answer,
)
