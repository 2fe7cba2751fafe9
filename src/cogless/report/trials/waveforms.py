"""The waveforms of chosen trials, so that they can be laid over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.report.packing import Array, pack, thin
from cogless.report.palette import place
from cogless.report.trials.errors import NAMES, display_unit, judged
from cogless.report.trials.phases import Phase, phases
from cogless.results import Run, TrialResults
from cogless.study import TrialStudy
from cogless.study.metric import SIGNALS

POINTS = 900_000  # of all waveforms of a page, at 2.7 bytes each
FEWEST = 200  # of one waveform
MOST_PHASES = 24
HUGE = 1e30  # far beyond any drive

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


def waveforms(results: TrialResults, scenario: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Panels over the time in a trial: a series of each controller and chosen trial.

    "note" says what is left out.
    """
    study, count = results.study, results.study.scenario[scenario].trials
    runs = [run for run in runs if len(run.trace) >= 2 * count and len(run.trace) % count == 0]
    found = phases(study.scenario[scenario])
    note = f"Of the first {MOST_PHASES} of {len(found)} phases." if len(found) > MOST_PHASES else ""
    found = found[:MOST_PHASES]
    if not runs:
        return {"panels": [], "phases": [], "note": ""}
    chosen = sum(len(phase.chosen) for phase in found)
    points = max(FEWEST, POINTS // (len(DRIVE) * max(1, len(results.runs)) * chosen))
    rows, period = len(runs[0].trace) // count, runs[0].trace.period
    step = thin(np.zeros(rows), points)[1] * period
    learning = [_learns(run, scenario, results) for run in runs]
    panels = []
    for title, signal, reference, quantity in _panels(study, scenario):
        shown = [run for run, learns in zip(runs, learning, strict=True) if learns or signal != "learned"]
        shown = [run for run in shown if signal in run.trace]
        if shown:
            unit, scale = display_unit(study, signal)
            panels.append(
                {
                    "title": title,
                    "quantity": quantity,
                    "unit": unit,
                    "references": _references(shown[0], found, reference, count, scale, points),
                    "series": [_series(results, run, found, signal, count, scale, points) for run in shown],
                }
            )
    return {
        "x": "time in the trial (s)",
        "start": (step - period) / 2,
        "step": step,
        "phases": [{"name": phase.name, "trials": phase.chosen} for phase in found],
        "panels": panels,
        "note": note,
    }


def _panels(study: TrialStudy, scenario: str) -> list[tuple[str, str, str | None, str]]:
    """Panels of a study; their error is the one that the study is judged by, if that is one."""
    if study.plant is not None:
        return list(LINEAR)
    signal = judged(study, scenario).signal
    error = signal if signal in NAMES and signal in SIGNALS else "theta_error"
    title = "Position error as measured" if error == "theta_error_measured" else "Position error"
    return [(title, error, None, q) if s == "theta_error" else (t, s, r, q) for t, s, r, q in DRIVE]


def _learns(run: Run, scenario: str, results: TrialResults) -> bool:
    """Whether anything is learned, so that a line at zero isn't drawn for one that doesn't."""
    if "learned" not in run.trace:
        return False
    count = results.study.scenario[scenario].trials
    last = run.trace["learned"].reshape(count, -1)[-1]
    return bool(np.any(last != 0))


def _series(
    results: TrialResults,
    run: Run,
    found: Sequence[Phase],
    signal: str,
    count: int,
    scale: float,
    points: int,
) -> dict[str, Any]:
    of_trials = _of_trials(run, signal, count)
    trials = [trial for phase in found for trial in phase.chosen]
    values = {str(trial): pack(thin(_tamed(of_trials[trial - 1], scale), points)[0]) for trial in trials}
    return {"controller": place(results, run), "trials": values}


def _references(
    run: Run, found: Sequence[Phase], signal: str | None, count: int, scale: float, points: int
) -> list[dict[str, Any]]:
    """References of each phase; the plan is the same for all controllers."""
    if signal is None:
        return []
    of_trials = _of_trials(run, signal, count)
    return [pack(thin(_tamed(of_trials[phase.start - 1], scale), points)[0]) for phase in found]


def _of_trials(run: Run, signal: str, count: int) -> Array:
    """A signal as trials x rows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return run.trace[signal].reshape(count, -1)


def _tamed(x: Array, scale: float) -> Array:
    """Signal in the display unit, NaN where it is too large to draw."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(x) < HUGE, x, np.nan) / scale
