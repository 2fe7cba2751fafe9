"""Metrics of trials: numbers for each trial, or for each phase, from one change to the next. Values are SI.

One small function a kind, in the registry KINDS, on the RMS or the rows of each trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cogless.results.trace import Trace
from cogless.study.trial_metric import TrialMetric

Array = NDArray[np.float64]
Values = list[float]

SETTLED_SHARE = 1 / 2  # of a phase's trials, at its end, that final-rms is taken over


@dataclass(frozen=True)
class TrialMetricInput:
    """A metric about to be evaluated: `rows` is trials x rows of its signal."""

    metric: TrialMetric
    rows: Array
    starts: Sequence[int]  # the phases' first trials, counted from 1

    @property
    def rms(self) -> Array:
        """Root of the mean square over each trial; infinite where a square is too large for a number."""
        with np.errstate(over="ignore"):
            return np.asarray(np.sqrt(np.mean(np.square(self.rows), axis=1)))

    @property
    def phases(self) -> list[slice]:
        """The trials of each phase."""
        return [slice(a - 1, b - 1) for a, b in pairwise((*self.starts, len(self.rows) + 1))]


def evaluate(metric: TrialMetric, trace: Trace, trials: int, starts: Sequence[int]) -> Values:
    """Values of a metric: one a trial or one a phase; infinite for a floor that isn't reached.

    `starts`: the first trial of each phase, counted from 1.
    """
    return KINDS[metric.kind](TrialMetricInput(metric, trace[metric.signal].reshape(trials, -1), starts))


def rms(m: TrialMetricInput) -> Values:
    """Root of the mean square of each trial, mean included, in the signal's unit."""
    return list(m.rms.tolist())


def maximum(m: TrialMetricInput) -> Values:
    """Largest magnitude of each trial, in the signal's unit."""
    return list(np.max(np.abs(m.rows), axis=1).tolist())


def first_rms(m: TrialMetricInput) -> Values:
    """RMS of the first trial of each phase, in the signal's unit."""
    return [float(m.rms[phase.start]) for phase in m.phases]


def final_rms(m: TrialMetricInput) -> Values:
    """RMS over the second half of each phase's trials, in the signal's unit."""
    found: Values = []
    for phase in m.phases:
        last = m.rms[phase][-max(1, round(SETTLED_SHARE * (phase.stop - phase.start))) :]
        found.append(float(np.sqrt(np.mean(np.square(last)))))
    return found


def trials_to_floor(m: TrialMetricInput) -> Values:
    """Trials of each phase until the RMS is at the floor or below; infinite where none is.

    1: the first trial of the phase is there already. Noise may lift a later trial above the floor again.
    """
    found: Values = []
    for phase in m.phases:
        below = np.flatnonzero(m.rms[phase] <= m.metric.threshold)
        found.append(float(below[0] + 1) if len(below) else math.inf)
    return found


KINDS: dict[str, Callable[[TrialMetricInput], Values]] = {
    "rms": rms,
    "maximum": maximum,
    "first-rms": first_rms,
    "final-rms": final_rms,
    "trials-to-floor": trials_to_floor,
}
