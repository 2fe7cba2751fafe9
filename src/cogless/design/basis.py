"""What was learned for one reference, moved to another, as trial_basis.h of the control library does it."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from cogless.design.model import Real

PIVOT_LEAST = 1e-3  # of a function's sum of squares: with less left beside those before it, it is left out


def functions(reference: Real) -> Real:
    """Columns: a constant, acceleration, speed, its sign, jerk; (samples, 5)."""
    whole = np.concatenate([reference[:1], reference, np.repeat(reference[-1:], 2)])
    steps = np.diff(whole)
    earlier, speed, later = steps[:-2], steps[1:-1], steps[2:]
    columns = (np.ones(len(speed)), (later - earlier) / 2, speed, np.sign(speed), later - 2 * speed + earlier)
    return np.array(columns).T


def carried(v: Real, old: Real, new: Real, n: float, k_2: float) -> Real:
    """v (plants, samples) for the new reference.

    `n`: gain from v to the input. `k_2`: of the integral that v acts through, 0 without one. v itself where
    the law can't move it.
    """
    if n == 0 or not 0 <= k_2 / n < 2:
        return v
    before, after = functions(old), functions(new)
    w = n * v + k_2 * (np.cumsum(v, axis=1) - v)
    theta = _least_squares(before, w)
    change = theta[:, 1:] @ (after - before)[:, 1:].T
    # n d(p) + k_2 (d(0) + .. + d(p - 1)) = change(p)
    return v + np.asarray(lfilter([1.0, -1.0], [n, k_2 - n], change, axis=1))


def _least_squares(columns: Real, w: Real) -> Real:
    """Coefficients (plants, functions), 0 for a function that follows from those before it."""
    chosen: list[int] = []
    for i, column in enumerate(columns.T):
        rest = column
        if chosen:
            basis, _ = np.linalg.qr(columns[:, chosen])
            rest = column - basis @ (basis.T @ column)
        if rest @ rest > PIVOT_LEAST * (column @ column):
            chosen.append(i)
    theta = np.zeros((len(w), columns.shape[1]))
    size = np.linalg.norm(columns[:, chosen], axis=0)
    theta[:, chosen] = np.linalg.lstsq(columns[:, chosen] / size, w.T, rcond=None)[0].T / size
    return theta
