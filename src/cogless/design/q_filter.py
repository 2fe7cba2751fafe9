"""The zero-phase Butterworth filter between trials, and a search for a cutoff with which learning works."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cogless.design.error import DesignError
from cogless.design.finite import TrialMap, growth
from cogless.design.linear_filter import butterworth_polynomials
from cogless.design.response import Bundle, Filter, Loop, best_gain, factor, longest_lag

SHIFTS_TRIED = 13  # from the relative degree to the longest lag
CLEARLY = 0.95  # another shift is proposed if its factor is less than this share
ENDS = 10  # cutoffs tried until the error shrinks at the trial's ends too, each 0.8 times the last
PROPOSED = 0.95  # largest factor per trial with a proposed cutoff


def butterworth(cutoff: float, order: int, period: float, odd: bool = False) -> Filter:
    """A low-pass filter b, a with the cutoff in Hz, to be run forward and backward."""
    half = 0.5 / period
    if not (math.isfinite(cutoff) and 0 < cutoff < half):
        raise DesignError(
            f"q_filter: {cutoff:g} Hz: expected a cutoff above zero and below {half:g} Hz, half the "
            "sampling rate"
        )
    if order < 1:
        raise DesignError(f"q_filter: order {order}: expected at least 1")
    return Filter(*butterworth_polynomials(order, cutoff * period * 2), odd)


def better_shift(
    loops: Sequence[Loop], r: int, q_filter: Filter, shift: int, samples: int
) -> tuple[float, int, float] | None:
    """The error's factor per trial with this shift, the shift that shrinks the error fastest, and its factor.

    Each shift is tried with its best gain and this filter on the learned signal. The trial's ends are
    included. None if no shift is clearly faster.
    """
    bundle = Bundle(loops, 0)
    w = bundle.grid
    G, H = bundle(w), q_filter.gain(w)
    longest = int(np.clip(longest_lag(G, w), r, samples - 1))
    spread = {shift, *map(int, np.linspace(r, longest, SHIFTS_TRIED).round())}
    gains = {tried: best_gain(G * np.exp(1j * w * tried), H) for tried in spread}

    def with_ends(tried: int) -> float:
        K_3, worst = gains[tried]
        return max(worst, float(growth(TrialMap(loops, K_3, tried, q_filter, "signal", samples)).max()))

    now = with_ends(shift)
    best, factor_best = shift, now
    for tried in sorted(spread - {shift}, key=lambda tried: gains[tried][1]):
        if gains[tried][1] >= factor_best:
            break  # the ends only add to it
        factor_tried = with_ends(tried)
        if factor_tried < factor_best:
            best, factor_best = tried, factor_tried
    return (now, best, factor_best) if factor_best < CLEARLY * now else None


def workable_cutoff(
    loops: Sequence[Loop], shift: int, order: int, period: float, samples: int, K_3: float | None = None
) -> float | None:
    """The largest cutoff, Hz, with which the error's factor per trial is at most `PROPOSED`, or None.

    This holds for all loops and frequencies and at the trial's ends, with K_3 or, if it is None, with the
    best gain. The filter acts on the learned signal: filtering the error alone isn't enough (response.py).
    """
    bundle = Bundle(loops, shift)
    w = bundle.grid
    G = bundle(w)

    def at(cutoff: float) -> tuple[float, float]:
        H = butterworth(cutoff, order, period).gain(w)
        return best_gain(G, H) if K_3 is None else (K_3, float(factor(G, K_3, H, "signal").max()))

    low, high = 1e-3 / period, 0.49 / period
    if at(low)[1] > PROPOSED:
        return None
    for _ in range(10):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if at(middle)[1] <= PROPOSED else (low, middle)
    for _ in range(ENDS):
        q_filter = butterworth(low, order, period)
        trial = TrialMap(loops, at(low)[0], shift, q_filter, "signal", samples)
        if growth(trial).max() <= PROPOSED:
            return low
        low *= 0.8
    return None
