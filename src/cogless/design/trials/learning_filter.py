"""Shift, low-pass and learning gain, chosen together: v <- Q (v + K_3 e(p + shift)).

A loop that lags lets little pass with a small shift, and what doesn't pass remains. A larger shift lets more
pass, but its first samples learn nothing. What counts is the error that is left. With F = Q (1 - K_3 G) of
response.py and the error E without learning, that is after n trials

    R_n E,   R_n = R + (1 - R) F^n,   R = (1 - Q) / (1 - F)

E is the error that a step of the load at the input causes. The choice has the smallest RMS of R_n E over that
of E after JUDGED_TRIALS trials, at the worst corner. |F| must be at most PROPOSED_FACTOR_MOST and |R| at most
REMAINS_MOST at every plant and frequency. A grid of choices is searched by frequency. The best choices
are refined over a trial of finite length (response.py), with a load from the first sample and one from the
middle on, so that the trial's ends count. A choice with which the error grows at the ends is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from cogless.design.trials.model import Real
from cogless.design.trials.response import (
    FACTOR_ROUNDING,
    PROPOSED_FACTOR_MOST,
    SHIFTS_TRIED,
    Bundle,
    Complex,
    Filter,
    Filtered,
    Loop,
    TrialMap,
    butterworth,
    direction,
    growth,
    longest_lag,
    padded,
)

JUDGED_TRIALS = 10  # trials after which the error that is left is compared
SLOWEST_FACTOR = 0.999  # |F| that is accepted where no choice keeps to PROPOSED_FACTOR_MOST
REMAINS_MOST = 1.01  # |R|: what remains of a frequency's error in the end, over its size without learning
CUTOFFS_TRIED, GAINS_TRIED = 20, 14  # cut-offs and gains of the grid of choices
GAIN_RANGE = (0.05, 2.0)  # K_3 times G at zero frequency
CUTOFF_RANGE = (1e-3, 0.45)  # times the sampling rate
GRID_STRIDE = 3  # every third frequency is looked at in the grid of choices
REFINED_CHOICES = 4  # of different shifts, compared over a finite trial; the best of them is refined
FIRST_STEPS = (4, 1.3, 1.3)  # of the refinement: samples, factor of the cut-off, factor of K_3
LAST_STEP = 1.02  # factor of K_3 and of the cut-off at which the refinement ends
LOWER_CUTOFF, CUTOFFS_LOWERED = 0.8, 4  # a cut-off that is tried where the trial's ends grow, and how often
CUTOFF_DIGITS, K_3_DIGITS = 3, 4  # of what is chosen: a study can repeat it
SQUARE_LEAST = 1e-300  # least divisor, against a division by zero


@dataclass(frozen=True)
class Choice:
    """How the error of a trial changes v."""

    shift: int  # samples
    cutoff: float | None  # of the filter, Hz; None: no filter
    K_3: float


@dataclass(frozen=True)
class Bench:
    """The loops on which choices are tried, and what is chosen already."""

    learning: Sequence[Loop]  # from v to y, at the corners and the nominal plant: judged over a whole trial
    loaded: Sequence[Loop]  # at the same plants, from a load at the input to y
    others: Sequence[Loop]  # from v to y, at the design's corners: every frequency must shrink there too
    drawn: Sequence[Loop]  # from v to y, at random plants: likewise, but only what is chosen is tried there
    least_shift: int  # the relative degree
    period: float  # s
    samples: int  # samples of a trial
    order: int  # order of the filter
    shift: int | Literal["auto"] = "auto"  # samples
    cutoff: float | Literal["auto"] | None = "auto"  # Hz; None: no filter
    filtered: Filtered = "signal"
    odd: bool = False  # reflection of the filter at the trial's ends

    @cached_property
    def everywhere(self) -> Bundle:
        """All loops from v to y except the random ones. These loops are judged first."""
        return Bundle(padded([*self.learning, *self.others]), 0)

    @cached_property
    def grid(self) -> Real:
        """Frequencies, rad per sample."""
        return self.everywhere.grid

    @cached_property
    def response(self) -> Complex:
        """G of all loops on the grid, without a shift."""
        return self.everywhere(self.grid)

    @cached_property
    def energy(self) -> Real:
        """|E|^2 of a load step at each judged plant, as shares of its sum over the grid."""
        w = self.grid
        # a trial has no lower frequency than half a period
        width = np.where(w >= np.pi / self.samples, np.gradient(w), 0.0)
        loaded = np.abs(Bundle(self.loaded, 0)(w)) ** 2
        density = loaded / np.maximum(2 - 2 * np.cos(w), SQUARE_LEAST) * width
        return np.asarray(density / density.sum(axis=1, keepdims=True))

    @cached_property
    def errors(self) -> Real:
        """Errors without learning: rows for a load from the first sample, then for one from the middle."""
        steps = np.ones((2 * len(self.loaded), self.samples))
        steps[len(self.loaded) :, : self.samples // 2] = 0.0
        loops = [*self.loaded, *self.loaded]
        return TrialMap(loops, 0.0, 1, None, filtered="error", samples=self.samples).output(steps)

    @cached_property
    def lag(self) -> int:
        """The longest lag of a loop, in samples, limited to the range of possible shifts."""
        return int(np.clip(longest_lag(self.response, self.grid), self.least_shift, self.samples - 1))

    @property
    def shifts(self) -> Sequence[int]:
        """Shifts of the grid of choices."""
        if self.shift != "auto":
            return (self.shift,)
        spread = np.linspace(self.least_shift, self.lag, SHIFTS_TRIED).round().astype(int)
        return [int(shift) for shift in np.unique(spread)]

    @property
    def cutoffs(self) -> Sequence[float | None]:
        """Cut-offs of the grid of choices."""
        if self.cutoff != "auto":
            return (self.cutoff,)
        low, high = self._cutoff_range
        return [None, *(float(cutoff) for cutoff in np.geomspace(high, low, CUTOFFS_TRIED))]

    @property
    def _cutoff_range(self) -> tuple[float, float]:
        lowest, highest = CUTOFF_RANGE
        return max(lowest, 0.5 / self.samples) / self.period, highest / self.period

    def near(self, choice: Choice, steps: tuple[int, float, float]) -> Iterator[Choice]:
        """Choices that are a step away in K_3, or in a shift or cut-off that the design may choose."""
        low, high = self._cutoff_range
        for sign in (1, -1):
            shift = int(np.clip(choice.shift + sign * steps[0], self.least_shift, self.samples - 1))
            moved = choice if self.shift != "auto" else replace(choice, shift=shift)
            yield replace(choice, K_3=choice.K_3 * steps[2] ** sign)
            yield moved
            if choice.cutoff is None or self.cutoff != "auto":
                continue
            for power in (1, -1):
                cutoff = float(np.clip(choice.cutoff * steps[1] ** power, low, high))
                yield replace(moved, cutoff=cutoff)
            yield replace(choice, cutoff=float(np.clip(choice.cutoff * steps[1] ** sign, low, high)))

    def q_filter(self, cutoff: float | None) -> Filter | None:
        """The filter with this cut-off."""
        return None if cutoff is None else butterworth(cutoff, self.order, self.period, self.odd)

    def q_gain(self, cutoff: float | None, w: Real) -> Real:
        """Q at w, rad per sample."""
        q_filter = self.q_filter(cutoff)
        return np.ones_like(w) if q_filter is None else q_filter.gain(w)

    def factors(self, G: Complex, K_3: float, Q: Real) -> Complex:
        """F of loops with the response G, shift included."""
        return np.asarray(1 - K_3 * G * Q if self.filtered == "error" else Q * (1 - K_3 * G))

    def remainder(self, F: Complex, Q: Real) -> Complex:
        """R. A filter on the error leaves nothing in the end where |F| < 1."""
        return np.zeros_like(F) if self.filtered == "error" else np.asarray((1 - Q) / (1 - F))

    def shrinks(self, choice: Choice, most: float) -> bool:
        """Whether |F| <= most and |R| <= REMAINS_MOST at every corner and frequency."""
        return self._shrinks(self.response, choice, most)

    def shrinks_drawn(self, choice: Choice, most: float) -> bool:
        """Whether |F| <= most and |R| <= REMAINS_MOST at every random plant and frequency."""
        return not self.drawn or self._shrinks(self._drawn_response, choice, most)

    @cached_property
    def _drawn_response(self) -> Complex:
        return Bundle(padded(self.drawn), 0)(self.grid)

    def _shrinks(self, G: Complex, choice: Choice, most: float) -> bool:
        w = self.grid
        Q = self.q_gain(choice.cutoff, w)
        F = self.factors(G * np.exp(1j * w * choice.shift), choice.K_3, Q)
        return bool(np.abs(F).max() <= most and np.abs(self.remainder(F, Q)).max() <= REMAINS_MOST)

    def trial(self, loops: Sequence[Loop], choice: Choice) -> TrialMap:
        """Trials of finite length with a choice."""
        q_filter = self.q_filter(choice.cutoff)
        return TrialMap(
            loops, choice.K_3, choice.shift, q_filter, filtered=self.filtered, samples=self.samples
        )

    def share_left(self, choice: Choice) -> float:
        """RMS after JUDGED_TRIALS trials over that without learning, of both loads, at the worst plant."""
        trial = self.trial([*self.learning, *self.learning], choice)
        after, before = trial.remaining(self.errors, JUDGED_TRIALS), self.errors
        shares = np.sum(after**2, axis=1) / np.maximum(np.sum(before**2, axis=1), SQUARE_LEAST)
        return float(np.sqrt(np.max(np.mean(shares.reshape(2, -1), axis=0))))


def learning_filters(bench: Bench) -> Iterator[Choice]:
    """Choices with which the error shrinks at every frequency and at the trial's ends, the best first."""
    limits = (PROPOSED_FACTOR_MOST, SLOWEST_FACTOR) if bench.filtered == "signal" else (1 + FACTOR_ROUNDING,)
    for most in limits:
        grid = _grid(bench, most)
        if grid:
            yield from _best_first(bench, grid, most)
            return


def _best_first(bench: Bench, grid: Sequence[Choice], most: float) -> Iterator[Choice]:
    shares = {choice: bench.share_left(choice) for choice in grid[:REFINED_CHOICES]}
    best = min(shares, key=lambda choice: shares[choice])
    tried = sorted(shares, key=lambda choice: shares[choice])
    for choice in dict.fromkeys([_refined(bench, best, most), *tried, *grid]):
        settled = _settled(bench, choice, most)
        if settled is not None:
            yield settled


def _grid(bench: Bench, most: float) -> list[Choice]:
    """The best choice of each shift on the grid, by frequency, the best first."""
    w = bench.grid[::GRID_STRIDE]
    G, energy = bench.response[:, ::GRID_STRIDE], bench.energy[:, ::GRID_STRIDE]
    energy = energy / energy.sum(axis=1, keepdims=True)
    judged, cutoffs = len(bench.learning), bench.cutoffs
    Q = np.array([bench.q_gain(cutoff, w) for cutoff in cutoffs])
    at_rest = float(np.abs(G[:, 0]).mean())
    scale = direction(G) / max(at_rest, 1e-6 * float(np.abs(G).max()), SQUARE_LEAST)
    best: dict[int, tuple[float, Choice]] = {}
    for shift in bench.shifts:
        ahead = G * np.exp(1j * w * shift)
        for K_3 in scale * np.geomspace(*GAIN_RANGE, GAINS_TRIED):
            for cutoff, q in zip(cutoffs, Q, strict=True):
                F = bench.factors(ahead, K_3, q)
                if np.abs(F).max() > most:
                    continue
                R = bench.remainder(F, q)
                if np.abs(R).max() > REMAINS_MOST:
                    continue
                R, F = R[:judged], F[:judged]
                remaining = np.abs(R + (1 - R) * F**JUDGED_TRIALS) ** 2
                worst = float(np.sqrt((remaining * energy).sum(axis=1).max()))
                if shift not in best or worst < best[shift][0]:
                    best[shift] = worst, Choice(shift, cutoff, float(K_3))
    choices = [choice for _, choice in sorted(best.values(), key=lambda pair: pair[0])]
    return [choice for choice in choices if bench.shrinks(choice, most)]


def _refined(bench: Bench, choice: Choice, most: float) -> Choice:
    """The choice that no neighbour betters over a finite trial."""
    steps = FIRST_STEPS
    shares = {choice: bench.share_left(choice)}
    while steps[2] > LAST_STEP:
        for other in bench.near(choice, steps):
            if other not in shares and bench.shrinks(other, most):
                shares[other] = bench.share_left(other)
        best = min(shares, key=lambda other: shares[other])
        if best == choice:
            steps = max(1, steps[0] // 2), math.sqrt(steps[1]), math.sqrt(steps[2])
        choice = best
    return choice


def _settled(bench: Bench, choice: Choice, most: float) -> Choice | None:
    """The choice, rounded, with a lower cut-off if the trial's ends need one; None if that doesn't help."""
    for n in range(CUTOFFS_LOWERED):
        cutoff = choice.cutoff
        if n and (cutoff is None or bench.cutoff != "auto"):
            break
        if cutoff is not None and bench.cutoff == "auto":
            cutoff = _rounded(cutoff * LOWER_CUTOFF**n, CUTOFF_DIGITS)
        tried = Choice(choice.shift, cutoff, _rounded(choice.K_3, K_3_DIGITS))
        shrinks = bench.shrinks(tried, most) and bench.shrinks_drawn(tried, most)
        if shrinks and growth(bench.trial(bench.learning, tried)).max() <= most:
            return tried
    return None


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
