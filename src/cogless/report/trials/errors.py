"""The error by which a trial study is judged: its signal, its display unit, and its RMS over each trial."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.report.comparison import pretty
from cogless.report.packing import Array, number, rms
from cogless.results import Run
from cogless.results.metrics import SETTLED_SHARE, result_name
from cogless.study import TrialStudy
from cogless.study.metric import SIGNALS, Metric
from cogless.units import factor

NAMES = {"theta_error": "error", "theta_error_measured": "measured error", "y_error": "error"}


@dataclass(frozen=True)
class Judged:
    """A signal whose RMS over each trial is judged, and the floor, in `unit`, that the RMS should reach."""

    signal: str
    unit: str  # as it is printed; empty if it has none
    scale: float  # SI value of a unit
    floor: float | None
    metrics: Sequence[Metric]  # those of this signal

    @property
    def quantity(self) -> str:
        """The signal's name in sentences, such as "measured error" or "tau_e"."""
        return NAMES.get(self.signal, self.signal)

    def text(self, value: float) -> str:
        """A value in `unit`, as text with the unit."""
        return f"{number(value)} {self.unit}".rstrip() if math.isfinite(value) else "not finite"


def judged(study: TrialStudy, scenario: str) -> Judged:
    """The signal to judge by: that of the first metric with a floor, else of the first RMS, else an error."""
    metrics = [m for m in study.metrics_in(scenario) if m.better == "lower"]
    floors = [m for m in metrics if m.kind == "trials-to-floor"]
    chosen = [*floors, *(m for m in metrics if m.kind != "maximum")]
    signal = (chosen and chosen[0].signal) or ("theta_error" if study.plant is None else "y_error")
    unit, scale = display_unit(study, signal)
    floor = floors[0].floor / scale if floors and floors[0].floor else None
    return Judged(signal, unit, scale, floor, [m for m in metrics if m.signal == signal])


def display_unit(study: TrialStudy, signal: str) -> tuple[str, float]:
    """The unit in which the study's metrics show a signal, and its SI value; the SI unit if they show none.

    An error signal without a metric of its own has the unit of another error signal.
    """
    dimension = SIGNALS.get(signal) if study.plant is None else None
    if dimension is None or not dimension.unit:
        return "", 1.0
    told = {m.signal: m.unit for m in reversed(study.metric) if m.unit and m.kind != "trials-to-floor"}
    alike = [told[name] for name in NAMES if name in told and signal in NAMES]
    unit = told.get(signal) or next(iter(alike), dimension.unit)
    return pretty(unit), factor(unit, dimension)


def rms_of_trials(about: Judged, run: Run, trials: int) -> Array | None:
    """RMS over each trial, in the signal's display unit; None if neither a metric nor the trace has it."""
    for metric in about.metrics:
        if metric.kind == "rms" and result_name(metric) in run.metrics:
            return np.asarray(run.metrics[result_name(metric)], dtype=float) / about.scale
    if not len(run.trace) or len(run.trace) % trials or about.signal not in run.trace:
        return None
    return rms(run.trace[about.signal].reshape(trials, -1)) / about.scale


def settled(of_trials: Array) -> float:
    """RMS over the second half of a phase's trials, like the metric final-rms."""
    return float(rms(of_trials[-max(1, round(SETTLED_SHARE * len(of_trials))) :]))
