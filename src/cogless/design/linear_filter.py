"""Digital filters as scipy.signal has them, whose import takes as long as a design."""

from __future__ import annotations

from importlib import import_module

import numpy as np

from cogless.design.model import Real


def butterworth_polynomials(order: int, cutoff: float) -> tuple[Real, Real]:
    """Coefficients b and a of a low-pass filter; cutoff as a share of half the sampling rate."""
    rate = 2.0
    poles = -np.exp(1j * np.pi * np.arange(-order + 1, order, 2) / (2 * order))
    warped = 2 * rate * np.tan(np.pi * cutoff / rate)
    poles, gain = warped * poles, warped**order
    # bilinear transform: z = (2 rate + s) / (2 rate - s)
    gain *= np.real(1 / np.prod(2 * rate - poles))
    poles = (2 * rate + poles) / (2 * rate - poles)
    return gain * np.poly(-np.ones(order)), np.real(np.poly(poles))


def forward(b: Real, a: Real, x: Real) -> Real:
    """Each row of x through its own b(1/z) / a(1/z) from rest: a row of b and of a each; a[:, 0] is one."""
    return _filtered(b, a, np.zeros((len(a), a.shape[1] - 1)), x)


def forward_and_backward(b: Real, a: Real, x: Real, odd: bool = False) -> Real:
    """Each row of x through the filter in both directions, as the control library's zero_phase.h does it.

    Before and after, the row is extended by its even reflection as a whole, or, as scipy.signal.filtfilt does
    it, by the odd one about the end's value; the filter starts in the steady state there.
    """
    n, extra = len(a) - 1, 3 * len(a) if odd else x.shape[1]
    companion = np.eye(n, k=-1)
    companion[0] = -a[1:]
    steady = np.linalg.solve(np.eye(n) - companion.T, b[1:] - a[1:] * b[0])
    before = after = x[:, ::-1]
    if odd:
        before, after = 2 * x[:, :1] - x[:, extra:0:-1], 2 * x[:, -1:] - x[:, -2 : -extra - 2 : -1]
    rows = np.concatenate([before, x, after], axis=1)
    b, a = (np.tile(coefficients, (len(x), 1)) for coefficients in (b, a))
    for _ in range(2):
        rows = _filtered(b, a, steady * rows[:, :1], rows)[:, ::-1]
    return rows[:, extra:-extra]


def _filtered(b: Real, a: Real, state: Real, x: Real) -> Real:
    arrays = (np.ascontiguousarray(array) for array in (b, a, state, x))
    return np.asarray(import_module("cogless._simulator_f64").filtered(*arrays))
