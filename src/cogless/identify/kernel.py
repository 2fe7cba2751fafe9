"""The Gaussian kernel that filters every term of a log's balance, and its derivatives, shifted by a delay."""

from __future__ import annotations

import numpy as np

from cogless.results.trace import Array

REACH_WIDTHS = 4  # widths that a kernel reaches to either side
SHIFT_ROWS = 8  # rows of the polynomial that interpolates between two rows
ANSWER_ROWS = 8  # rows within which a law's current follows the angle


class Kernel:
    """Weights of a Gaussian of a width, s, for rows `dt` apart, s.

    `value` and `slope`: mean and first derivative at a row. `speed` and `acceleration`: first and second
    derivative at the time `delay`, s, before the row, exact for lines and parabolas. `curvature`: second
    derivative at the row. `half`: rows that all weights reach to either side.
    """

    def __init__(self, width: float, dt: float, delay: float = 0.0) -> None:
        self.half = int(np.ceil((REACH_WIDTHS * width + abs(delay)) / dt))
        x = dt * np.arange(-self.half, self.half + 1, dtype=np.float64)
        self.value = np.exp(-0.5 * (x / width) ** 2)
        self.value /= self.value.sum()
        self.slope, self.curvature = _derivatives(x, width)
        self.speed, self.acceleration = _derivatives(x + delay, width)

    def filter(self, x: Array, weights: Array, step: int) -> Array:
        """The filtered signal at every step-th row that the kernel covers."""
        if step == 1:
            return np.correlate(x, weights, "valid")
        # Kernel and signal are cut in parts of a step: their product is a matrix, its diagonals are added up.
        parts, count = -(-len(weights) // step), (len(x) - len(weights)) // step + 1
        taps, rows = np.zeros(parts * step), np.zeros((count + parts - 1) * step)
        taps[: len(weights)], rows[: len(x)] = weights, x[: len(rows)]
        products = taps.reshape(parts, step) @ rows.reshape(-1, step).T
        return np.asarray(sum(products[part, part : part + count] for part in range(parts)))


def _derivatives(x: Array, width: float) -> tuple[Array, Array]:
    """Weights of the first and second derivative at x = 0."""
    g = np.exp(-0.5 * (x / width) ** 2)
    g /= g.sum()
    first = x * g
    first -= g * first.sum()
    first /= first @ x
    second = (x**2 - width**2) * g
    lines = np.stack([g, g * x])  # subtracted below, so that a line has no second derivative
    moments = np.stack([lines.sum(axis=1), lines @ x])
    second -= np.linalg.solve(moments, [second.sum(), second @ x]) @ lines
    return first, 2 * second / (second @ x**2)


def shifted(x: Array, rows: float) -> Array:
    """The signal `rows` rows after each row, by a polynomial through SHIFT_ROWS rows; end values repeat."""
    if not rows:
        return x
    first = int(np.floor(rows)) - SHIFT_ROWS // 2 + 1
    ends = abs(first) + SHIFT_ROWS
    padded = np.concatenate((x[:1].repeat(ends), x, x[-1:].repeat(ends)))
    return np.asarray(np.correlate(padded, _polynomial(rows - first), "valid")[ends + first :][: len(x)])


def _polynomial(place: float) -> Array:
    """Weights of SHIFT_ROWS rows for the interpolated value at a place, in rows from the first."""
    others = np.arange(SHIFT_ROWS)
    factors = [np.delete(others, row) for row in others]
    return np.array([np.prod((place - rest) / (row - rest)) for row, rest in enumerate(factors)])


def white_noise(x: Array, answers: Array | None = None) -> float:
    """Variance of the white noise of a signal, by its fourth differences; 0 for a short one.

    `answers`: another signal. The part of the noise that follows this signal within some rows does not count.
    """
    fourth = np.diff(x, 4)
    if len(fourth) <= ANSWER_ROWS * 10:
        return 0.0
    if answers is not None:
        cause = np.diff(answers, 4)
        lagged = np.column_stack([cause[ANSWER_ROWS - lag : len(cause) - lag] for lag in range(ANSWER_ROWS)])
        fourth = fourth[ANSWER_ROWS:]
        fourth = fourth - lagged @ np.linalg.lstsq(lagged, fourth, rcond=None)[0]
    return float((np.median(np.abs(fourth)) / 0.6745) ** 2 / 70)
