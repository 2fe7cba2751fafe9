"""Errors that differ at random: docs/theory/trial-design.md#what-differs-from-trial-to-trial.

A start, a load or noise that each trial draws anew can't be learned. Its error w_k stays, and what the law
makes of this error acts in the trials after. With the notation of response.py, and with l_k, which the law
learns from in place of w_k:

    e_k = w_k - G (B l_{k-1} + M B l_{k-2} + M^2 B l_{k-3} + ...)

Draws of different trials are independent, so the mean squares of these terms add up. They are computed in the
time domain, with the trial's ends. For white noise the mean square is that of some rows of random signs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from cogless.design.trials.model import Real
from cogless.design.trials.response import TrialMap

PROBE_SAMPLES = 10_000  # samples of all rows together: the mean square is right within one to three percent
TERMS_MOST = 200  # trials whose terms are added
TERM_LEAST = 1e-4  # share of the sum; smaller terms end it

# Simulates one trial of each plant, without feedforward and learned signal. Arguments: reference and load
# (samples, rows), initial state (n,), rows of each plant. Returns the error and the signal that the law
# learns from, both (rows, samples).
Respond = Callable[[Real, Real, Real, int], tuple[Real, Real]]


@dataclass(frozen=True)
class Disturbances:
    """What each trial draws anew: standard deviations."""

    start: Real  # (n,), of the state at the first sample
    load: float = 0.0  # of a load that is constant throughout a trial, in the unit of the input
    load_noise: float = 0.0  # of white noise on the load
    noise: Real | None = None  # (n,), of white noise on each measured state


@dataclass(frozen=True)
class Loops:
    """Closed loops of several plants: how they respond, and how they learn."""

    respond: Respond
    trial: TrialMap  # from v to what is learned from
    position: TrialMap  # from v to the error of y
    C: Real  # (n,)
    K_1: Real  # (n,), zeros with an observer


@dataclass(frozen=True)
class Amplification:
    """RMS of an error in the long run / its RMS without learning, of each plant.

    The error is that of y itself. It comes from white noise, new in each trial.
    """

    labels: tuple[str, ...]
    load: Real  # (plants,), of noise on the load
    noise: Real  # (plants,), of noise on the measured states that y consists of

    def worst(self, of: Real) -> tuple[float, str]:
        """The largest value in `of`, which has one for each plant, and the name of that plant."""
        k = int(np.argmax(of))
        return float(of[k]), self.labels[k]


def amplification(labels: tuple[str, ...], loops: Loops) -> Amplification:
    """How learning amplifies errors that don't repeat."""
    none = np.zeros(len(loops.C))
    shares = []
    for disturbances in (
        Disturbances(none, load_noise=1.0),
        Disturbances(none, noise=(loops.C != 0).astype(np.float64)),
    ):
        feedback, learned = random_errors(loops, disturbances, TERMS_MOST)
        shares.append(np.sqrt(learned[:, -1] / feedback))
    return Amplification(labels, *shares)


def random_errors(loops: Loops, disturbances: Disturbances, trials: int) -> tuple[Real, Real]:
    """Mean square of the random part of the error: without learning (plants,), with it (plants, trials).

    Nothing was learned before the first of these trials. Infinite where it grows beyond all numbers.
    """
    plants = len(loops.trial.loops)
    feedback, learned = np.zeros(plants), np.zeros((plants, trials))
    for error, lesson in _errors(loops, disturbances):
        probes = len(error) // plants
        many = _Rows(loops, probes)
        first = _mean_square(error, probes)
        feedback += first
        learned += many.sums(first, lesson, trials)
    return feedback, learned


def _errors(loops: Loops, disturbances: Disturbances) -> Iterator[tuple[Real, Real]]:
    """Yields, for each independent disturbance, a trial's error and what the law learns from."""
    samples, plants, n = loops.trial.samples, len(loops.trial.loops), len(loops.C)
    rest = np.zeros(n)
    constant = np.ones((samples, plants))
    for i in np.flatnonzero(disturbances.start):
        start = np.where(np.arange(n) == i, disturbances.start, 0.0)
        yield loops.respond(0 * constant, 0 * constant, start, 1)
    if disturbances.load:
        yield loops.respond(0 * constant, disturbances.load * constant, rest, 1)
    probes = -(-PROBE_SAMPLES // samples)
    signs = np.random.default_rng(0).choice((-1.0, 1.0), size=(samples, probes))
    white = np.tile(signs, (1, plants))  # a plant's probes are neighbours
    if disturbances.load_noise:
        yield loops.respond(0 * white, disturbances.load_noise * white, rest, probes)
    sizes = rest if disturbances.noise is None else disturbances.noise
    for i in np.flatnonzero(sizes):
        # the law sees x_i + n: K_1 of it is an input, and C of it an error
        reference = -loops.C[i] * sizes[i] * white
        error, lesson = loops.respond(reference, -loops.K_1[i] * sizes[i] * white, rest, probes)
        yield error - reference.T, lesson


class _Rows:
    """The loops with each plant repeated, a row for each probe."""

    def __init__(self, loops: Loops, probes: int) -> None:
        def repeated(trial: TrialMap) -> TrialMap:
            return replace(trial, loops=[loop for loop in trial.loops for _ in range(probes)])

        self._trial, self._position, self._probes = repeated(loops.trial), repeated(loops.position), probes

    def sums(self, first: Real, lesson: Real, trials: int) -> Real:
        """Mean square after 0, 1, .. trials - 1 trials of learning: (plants, trials)."""
        trial, total = self._trial, first.copy()
        sums = np.zeros((len(first), trials))
        sums[:, 0] = total
        v = trial.correction(lesson)
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(1, trials):
                term = _mean_square(self._position.output(v), self._probes)
                total = total + np.where(np.isfinite(term), term, np.inf)
                sums[:, k] = total
                if not np.all(np.isfinite(total)) or np.all(term <= TERM_LEAST * total):
                    sums[:, k:] = total[:, None]
                    break
                v = trial.recall(v) - trial.correction(trial.output(v))
        return sums


def _mean_square(rows: Real, probes: int) -> Real:
    return np.asarray(np.mean(rows**2, axis=1).reshape(-1, probes).mean(axis=1))
