"""The zero-phase Butterworth filter between trials, and the cutoff that makes learning possible."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cogless.design.error import DesignError
from cogless.design.finite import growth
from cogless.design.response import Bundle, Filter, Loop, best_gain, factor

SHIFTS = 6  # tried beyond the relative degree
CLEARLY = 0.95  # of the factor: worth another shift
ENDS = 10  # cutoffs tried for the ends' sake, each 0.8 times the last
PROPOSED = 0.95  # the factor a trial that a proposed cutoff reaches


def butterworth(cutoff: float, order: int, period: float) -> Filter:
    """b, a of a low-pass filter; cutoff in Hz. Run forward and backward, as filtfilt does."""
    half = 0.5 / period
    if not (math.isfinite(cutoff) and 0 < cutoff < half):
        raise DesignError(
            f"q_filter: {cutoff:g} Hz: expected a cutoff above zero and below {half:g} Hz, half the "
            "sampling rate"
        )
    if order < 1:
        raise DesignError(f"q_filter: order {order}: expected at least 1")
    from scipy.signal import butter

    b, a = butter(order, cutoff * period * 2)
    return Filter(b, a)


def better_shift(
    loops: Sequence[Loop], r: int, q_filter: Filter, shift: int, samples: int
) -> tuple[float, int, float] | None:
    """The factor a trial of this shift, the shift whose best gain shrinks the error fastest, and its factor.

    With this filter on the learned signal, the trial's ends included; None where no shift is clearly faster.
    """
    w = Bundle(loops, shift).grid
    H = q_filter.gain(w)
    factors = {}
    for tried in {shift, *range(r, min(r + SHIFTS, samples - 1) + 1)}:
        K_3, worst = best_gain(Bundle(loops, tried)(w), H)
        factors[tried] = max(worst, float(growth(loops, K_3, tried, q_filter, "signal", samples).max()))
    best = min(factors, key=lambda tried: factors[tried])
    return (factors[shift], best, factors[best]) if factors[best] < CLEARLY * factors[shift] else None


def workable_cutoff(
    loops: Sequence[Loop], shift: int, order: int, period: float, samples: int, K_3: float | None = None
) -> float | None:
    """The largest cutoff in Hz with which K_3, or the best one, reaches `PROPOSED` at all loops and
    frequencies, and the trial's ends don't grow; None where none does.

    The filter acts on the learned signal: filtering the error alone can't do it (response.py).
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
        if growth(loops, at(low)[0], shift, q_filter, "signal", samples).max() <= PROPOSED:
            return low
        low *= 0.8
    return None
