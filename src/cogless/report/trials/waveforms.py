"""The waveforms of chosen trials, which can be drawn over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.report.packing import Array, pack, thin
from cogless.report.palette import place
from cogless.report.trials.errors import NAMES, display_unit, judged
from cogless.report.trials.phases import groups, phases
from cogless.results import Run, TrialResults
from cogless.study import TrialStudy
from cogless.study.metric import SIGNALS

POINTS = 900_000  # in all waveforms of a page, at 2.7 bytes per point
FEWEST = 200  # of one waveform
MOST_PHASES = 24

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


def waveforms(results: TrialResults, runs: Sequence[Run]) -> dict[str, Any]:
    """Panels over the time within a trial, with a series for each controller and chosen trial.

    "note" says which phases are left out.
    """
    study, scenario = results.study, runs[0].scenario
    count = study.scenario[scenario].trials
    runs = [run for run in runs if len(run.trace) >= 2 * count and len(run.trace) % count == 0]
    if not runs:
        return {"panels": [], "phases": [], "note": ""}
    together = groups(phases(study.scenario[scenario]))
    every = [phase for group in together for phase in group.drawn]
    found = every[:MOST_PHASES]
    chosen = [trial for phase in found for trial in phase.chosen]
    points = max(FEWEST, POINTS // (len(DRIVE) * len(results.runs) * len(chosen)))

    def packed(run: Run, signal: str, scale: float, trials: Sequence[int]) -> list[dict[str, Any]]:
        x = _of_trials(run, signal, count)
        return [pack(thin(x[trial - 1] / scale, points)[0]) for trial in trials]

    panels = []
    for title, signal, reference, quantity in panels_of(study, scenario):
        unit, scale = display_unit(study, signal)
        series = []
        for run in runs:
            if _shown(run, signal, count):
                values = dict(zip(map(str, chosen), packed(run, signal, scale, chosen), strict=True))
                series.append({"controller": place(results, run), "trials": values})
        if not series:
            continue
        # the reference is the same for all controllers
        plan = packed(runs[0], reference, scale, [p.start for p in found]) if reference else []
        about = {"title": title, "quantity": quantity, "unit": unit}
        panels.append({**about, "references": plan, "series": series})
    period = runs[0].trace.period
    step = thin(_of_trials(runs[0], "time", count)[0], points)[1] * period
    notes = [
        f"Of the {group.changes}: the first and the last." for group in together if len(group.phases) > 1
    ]
    if len(every) > MOST_PHASES:
        notes.append(f"Of the first {MOST_PHASES} of {len(every)} phases.")
    return {
        "x": "time in the trial (s)",
        "start": (step - period) / 2,
        "step": step,
        "phases": [{"name": phase.name, "trials": phase.chosen} for phase in found],
        "panels": panels,
        "note": " ".join(notes),
    }


def panels_of(study: TrialStudy, scenario: str) -> list[tuple[str, str, str | None, str]]:
    """The panels of a study; the error panel shows the signal judged by, if that is an error."""
    if study.plant is not None:
        return list(LINEAR)
    signal = judged(study, scenario).signal
    error = signal if signal in NAMES and signal in SIGNALS else "theta_error"
    title = "Position error as measured" if error == "theta_error_measured" else "Position error"
    return [(title, error, None, q) if s == "theta_error" else (t, s, r, q) for t, s, r, q in DRIVE]


def _shown(run: Run, signal: str, count: int) -> bool:
    """Whether to draw a run's signal: not if it is missing, or is a learned signal that ends at zero."""
    if signal not in run.trace:
        return False
    return signal != "learned" or bool(np.any(_of_trials(run, signal, count)[-1] != 0))


def _of_trials(run: Run, signal: str, count: int) -> Array:
    """A signal as a two-dimensional array, trials by rows."""
    return run.trace[signal].reshape(count, -1)
