"""A linear plant with one input, and its sampling with period T.

continuous  x' = A_c x + B_c u
euler       A = I + T A_c,  B = T B_c: maps a polytope to a polytope, but is inexact for a held input
exact       A, B from the exponential of [[A_c, B_c], [0, 0]] T: exact for u held over a sample

The file also has digital filters as in scipy.signal, whose import takes as long as a design, and the
exception of a design, whose message says in one line which input was expected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.margins import Real as Real
from cogless.errors import StudyError


class DesignError(StudyError):
    """A design can't be made, or its solution fails the check. The message begins with `key` and a colon."""

    @property
    def key(self) -> str:
        """The name of the setting at fault, such as `state_weight`, `range.inertia` or `vertex`."""
        return str(self).partition(":")[0]


Discretisation = Literal["euler", "exact"]
NO_PATH = 1e-9  # a product below this share of the sum of its terms' magnitudes counts as zero


@dataclass(frozen=True)
class Model:
    """Discrete model x(p+1) = A x(p) + B u(p), or continuous x' = A x + B u, with A (n, n) and B (n, 1)."""

    A: Real
    B: Real
    continuous: Model | None = None  # the continuous plant, if this model samples it exactly; else None
    seen: Real | None = None  # (plant's order, n): the plant's state as a law gets it; None: as it is
    lift: Real | None = (
        None  # (n, plant's order): from the plant's state to this model's, at a constant speed
    )
    base: Model | None = None  # the plant alone, without what a sensor adds; None: this

    @property
    def plant(self) -> Model:
        """The plant alone."""
        return self if self.base is None else self.base

    @property
    def view(self) -> Real:
        """The matrix (plant's order, n) from this model's state to the plant's state as a law gets it."""
        return np.eye(self.order) if self.seen is None else self.seen

    def output(self, C: Real) -> Real:
        """The row (n,) that gives the true output, from the plant's C."""
        return np.append(C, np.zeros(self.order - len(C)))

    def started(self, x: Real) -> Real:
        """This model's state at the start of a trial, from the plant's state x."""
        return x if self.lift is None else np.asarray(self.lift @ x)

    @property
    def order(self) -> int:
        """Number of states, n."""
        return len(self.A)

    @property
    def entries(self) -> Real:
        """The entries of [A B] as a vector, row by row."""
        return np.hstack([self.A, self.B]).ravel()

    @classmethod
    def from_arrays(cls, A: ArrayLike, B: ArrayLike, key: str = "vertex") -> Model:
        """A model from arrays; DesignError if a shape is wrong or a number isn't finite."""
        try:
            a, b = np.asarray(A, dtype=float), np.asarray(B, dtype=float)
        except (TypeError, ValueError):
            raise DesignError(f"{key}: expected matrices of numbers") from None
        if a.ndim != 2 or a.shape[0] != a.shape[1] or not len(a):
            raise DesignError(f"{key}: A is {_shape(a)}, expected as many rows as columns")
        if b.shape not in ((len(a),), (len(a), 1)):
            raise DesignError(f"{key}: B is {_shape(b)}, expected {len(a)} x 1")
        if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
            raise DesignError(f"{key}: expected finite numbers in A and B")
        return cls(a, b.reshape(-1, 1))

    @classmethod
    def from_entries(cls, entries: Real, order: int) -> Model:
        """The model of given order with these `entries`."""
        A_and_B = entries.reshape(order, order + 1)
        return cls(A_and_B[:, :order].copy(), A_and_B[:, order:].copy())


def sampled(continuous: Model, period: float, how: Discretisation) -> Model:
    """The discrete model of a continuous one, with the sample period in s."""
    n = continuous.order
    if how == "euler":
        return Model(np.eye(n) + period * continuous.A, period * continuous.B)
    rates = np.zeros((n + 1, n + 1))
    rates[:n, :n], rates[:n, n:] = continuous.A, continuous.B
    step = exponential(rates * period)
    return Model(step[:n, :n].copy(), step[:n, n:].copy(), continuous)


def exponential(M: Real) -> Real:
    """Matrix exponential by its series, because importing scipy.linalg takes longer than a run."""
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(M).max()), 1e-300))) + 3)
    small = M / 2.0**halvings
    sum_, term = np.eye(len(M)), np.eye(len(M))
    for n in range(1, 16):
        term = term @ small / n
        sum_ = sum_ + term
    return np.asarray(np.linalg.matrix_power(sum_, 2**halvings))


def markov(A: Real, B: Real, C: Real, count: int) -> Real:
    """Markov parameters C A^(i-1) B for i = 1 .. count; values that are only rounding become zero."""
    out, x, size = np.zeros(count), B[:, 0], np.abs(B[:, 0])
    for i in range(count):
        value = float(C @ x)
        out[i] = value if abs(value) > NO_PATH * float(np.abs(C) @ size) else 0.0
        x, size = A @ x, np.abs(A) @ size
    return out


def relative_degree(model: Model, C: Real) -> int:
    """The smallest r with C A^(r-1) B != 0; 0 if the input has no effect on the output."""
    return first_effect(markov(model.A, model.B, C, model.order))


def first_effect(parameters: Real) -> int:
    """The relative degree, from the Markov parameters of a model; 0 if all are zero."""
    nonzero = np.flatnonzero(parameters)
    return int(nonzero[0]) + 1 if len(nonzero) else 0


def uncontrollable_mode(A: Real, B: Real) -> complex | None:
    """A pole that the input cannot move (Popov-Belevitch-Hautus test); None if there is none.

    The result doesn't depend on the states' units: after balancing, each row of [zI - A, B] is divided by its
    norm.
    """
    import scipy.linalg

    balanced, (scale, order) = scipy.linalg.matrix_balance(A, separate=True)
    b = B[order] / scale[:, None]
    size = max(float(np.abs(b).max()), 1e-300)
    for pole in np.linalg.eigvals(balanced):
        pencil = np.hstack([pole * np.eye(len(A)) - balanced, b / size])
        rows = np.linalg.norm(pencil, axis=1)
        if rows.min() == 0 or np.linalg.svd(pencil / rows[:, None], compute_uv=False)[-1] < 1e-7:
            return complex(pole)
    return None


def _shape(matrix: Real) -> str:
    return " x ".join(str(n) for n in matrix.shape) or "a number"


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
    """Each row of x, filtered from rest by b(1/z) / a(1/z) of the same rows of b and a; a[:, 0] is one."""
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
    return _filtered(np.full((len(x), len(b)), b), np.full((len(x), len(a)), a), state, x)


def _filtered(b: Real, a: Real, state: Real, x: Real) -> Real:
    arrays = (np.ascontiguousarray(array) for array in (b, a, state, x))
    return np.asarray(import_module("cogless._simulator_f32").filtered(*arrays))
