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
    pad = _pad(a, x, odd)
    before = after = x[:, ::-1]
    if odd:
        before, after = 2 * x[:, :1] - x[:, pad:0:-1], 2 * x[:, -1:] - x[:, -2 : -pad - 2 : -1]
    rows, steady = np.concatenate([before, x, after], axis=1), _steady(b, a)
    for _ in range(2):
        rows = _pass(b, a, steady * rows[:, :1], rows)[:, ::-1]
    return rows[:, pad:-pad]


def forward_and_backward_transposed(b: Real, a: Real, x: Real, odd: bool = False) -> Real:
    """Each row of x times the transposed matrix of `forward_and_backward`."""
    pad, steady = _pad(a, x, odd), _steady(b, a)
    rows = np.pad(x, ((0, 0), (pad, pad)))
    # a pass is T + c s^T: T from rest, s picks the first sample, c is what the steady state of one leaves
    c = _pass(b, a, steady[None, :], np.zeros((1, rows.shape[1])))[0]
    for _ in range(2):
        rows = rows[:, ::-1]
        whole = _pass(b, a, np.zeros((len(x), len(steady))), rows[:, ::-1])[:, ::-1]
        whole[:, 0] += rows @ c
        rows = whole
    before, middle, after = rows[:, :pad], rows[:, pad:-pad].copy(), rows[:, -pad:]
    if not odd:
        return middle + before[:, ::-1] + after[:, ::-1]
    middle[:, 0] += 2 * before.sum(axis=1)
    middle[:, -1] += 2 * after.sum(axis=1)
    middle[:, 1 : pad + 1] -= before[:, ::-1]
    middle[:, -pad - 1 : -1] -= after[:, ::-1]
    return middle


def _pad(a: Real, x: Real, odd: bool) -> int:
    """Samples by which each end is extended."""
    return 3 * len(a) if odd else x.shape[1]


def _steady(b: Real, a: Real) -> Real:
    """The filter's state after a long constant input of one."""
    n = len(a) - 1
    companion = np.eye(n, k=-1)
    companion[0] = -a[1:]
    return np.asarray(np.linalg.solve(np.eye(n) - companion.T, b[1:] - a[1:] * b[0]))


def _pass(b: Real, a: Real, state: Real, x: Real) -> Real:
    """Each row of x through one filter from its row of `state`."""
    return _filtered(np.tile(b, (len(x), 1)), np.tile(a, (len(x), 1)), state, x)


def _filtered(b: Real, a: Real, state: Real, x: Real) -> Real:
    arrays = (np.ascontiguousarray(array) for array in (b, a, state, x))
    return np.asarray(import_module("cogless._simulator_f64").filtered(*arrays))
