"""The trial-to-trial operator (20) of Mandra 2019 in the frequency domain, for many plants at once.

G(w) = C z^r (zI - A)^-1 B is the response from the learned v to the output r samples later, at z = exp(jw)
with w in rad per sample. With the gain K and a zero-phase filter of gain H >= 0 the error obeys
e_{k+1} = F e_k + ...

    no filter        F = 1 - K G
    on the error     F = 1 - K G H          v <- v + K H e
    on the signal    F = H (1 - K G)        v <- H (v + K e)

docs/theory/trial-design.md#the-certificate says what max |F| means for a trial of finite length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cogless.design.model import Real

Complex = NDArray[np.complex128]
Filtered = Literal["error", "signal"]
GRID = 700
AROUND = np.array([0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0])  # from a pole's angle, in 1 - |p|
NARROW = 0.05  # poles further than this from the unit circle need no grid points of their own
REFINEMENTS = 3
CANDIDATES = 40  # largest number of local maxima that are refined
MONOTONE = 1e-9  # an excess of a factor over one that is rounding, and harmless for a million trials


@dataclass(frozen=True)
class Loop:
    """A closed loop from the learned v to the output y: A (n, n), B (n, 1), C (n,)."""

    A: Real
    B: Real
    C: Real

    @property
    def radius(self) -> float:
        """Spectral radius: the magnitude of the largest pole."""
        return float(np.abs(np.linalg.eigvals(self.A)).max())


@dataclass(frozen=True)
class Disturbed:
    """A closed loop from errors of the angle and the speed that its law gets; n states."""

    A: Real
    B: Real  # (n, 2), of the two errors
    lesson: Real  # (n,), what is learned from
    lesson_at_once: float  # what the angle's error does to it at once
    position: Real  # (n,), the true output
    u: Real  # (n,), the input
    u_at_once: Real  # (2,), of the two errors

    def through(self, errors: Complex, w: Real) -> tuple[Complex, Complex, Complex]:
        """Output, lesson and input at w in rad per sample, of these two errors at w, (2, len(w))."""
        z = np.exp(1j * w)[:, None, None] * np.eye(len(self.A))
        x = np.linalg.solve(z - self.A, (self.B @ errors).T[..., None])[..., 0]
        return (
            np.asarray(x @ self.position),
            np.asarray(x @ self.lesson + self.lesson_at_once * errors[0]),
            np.asarray(x @ self.u + self.u_at_once @ errors),
        )


def padded(loops: Sequence[Loop]) -> list[Loop]:
    """The same loops, all of one order: their additional states do nothing."""
    order = max((len(loop.A) for loop in loops), default=0)

    def wider(loop: Loop) -> Loop:
        more = order - len(loop.A)
        if not more:
            return loop
        return Loop(np.pad(loop.A, (0, more)), np.pad(loop.B, ((0, more), (0, 0))), np.pad(loop.C, (0, more)))

    return [wider(loop) for loop in loops]


@dataclass(frozen=True)
class Filter:
    """A digital filter b, a that runs forward and backward; its gain is |b/a|^2.

    `odd`: at the ends the signal is continued by its odd reflection, otherwise by the even one.
    """

    b: Real
    a: Real
    odd: bool = False

    def gain(self, w: Real) -> Real:
        """Gain |b/a|^2 of both passes together, at w in rad per sample."""
        z = np.exp(-1j * w)
        return np.asarray(np.abs(np.polyval(self.b[::-1], z) / np.polyval(self.a[::-1], z)) ** 2)


class Bundle:
    """Several loops of the same order, whose G with a common shift is computed together.

    C (zI - A)^-1 B = det(zI - A + BC) / det(zI - A) - 1: a quotient of products over eigenvalues, which is as
    exact near repeated poles, where eigenvectors are useless. C is scaled so that G is about one.
    """

    def __init__(self, loops: Sequence[Loop], shift: int) -> None:
        self.loops, self.shift = list(loops), shift
        A = np.array([loop.A for loop in loops])
        B = np.array([loop.B for loop in loops])
        C = np.array([loop.C for loop in loops])[:, None, :]
        response, x = np.zeros(len(loops)), B
        for _ in range(A.shape[1]):
            response = np.maximum(response, np.abs((C @ x)[:, 0, 0]))
            x = A @ x
        self._size = np.where(response > 0, response, 1.0)
        self._poles = np.linalg.eigvals(A).astype(complex)
        self._others = np.linalg.eigvals(A - B @ C / self._size[:, None, None]).astype(complex)

    @property
    def radii(self) -> Real:
        """Spectral radius of each loop."""
        return np.asarray(np.abs(self._poles).max(axis=1))

    @property
    def grid(self) -> Real:
        """Frequency grid, rad per sample, that is fine enough for the resonances of all loops."""
        return grid(self._poles.ravel())

    def __call__(self, w: Real, which: Sequence[int] | None = None) -> Complex:
        """G at w, rad per sample, of the loops `which`, or of all: (loops, len(w))."""
        at = slice(None) if which is None else list(which)
        z = np.exp(1j * w)
        quotient = np.ones((len(self._poles[at]), len(w)), dtype=complex)
        for other, pole in zip(self._others[at].T, self._poles[at].T, strict=True):
            quotient *= (z - other[:, None]) / (z - pole[:, None])
        return np.asarray((quotient - 1) * self._size[at][:, None] * z**self.shift)


def grid(poles: Complex | None = None) -> Real:
    """Grid from 0 to pi rad per sample: even, but finer near zero and around poles near the unit circle."""
    w = np.union1d(np.linspace(0.0, np.pi, GRID), np.geomspace(1e-4, 0.3, GRID // 3))
    if poles is None:
        return w
    width = 1 - np.abs(poles)
    narrow = (width > 0) & (width < NARROW) & (poles.imag >= 0)
    width = width[narrow][:, None]
    near = np.abs(np.angle(poles[narrow])[:, None] + width * np.append(-AROUND, AROUND))
    # rounded, so that poles that hardly differ share their points
    step = 2.0 ** np.floor(np.log2(width / 16))
    return np.union1d(w, np.minimum(np.round(near / step) * step, np.pi))


def factor(G: Complex, K: float, H: Real | float = 1.0, filtered: Filtered = "error") -> Real:
    """|F| for the gain K and the filter gain H."""
    return np.abs(1 - K * G * H) if filtered == "error" else np.abs(H * (1 - K * G))


def direction(G: Complex) -> float:
    """The sign of K that makes the feedback negative: that of G at zero frequency, or 1 if G is zero there.

    G is (models, frequencies), and its first frequency is zero.
    """
    at_rest = float(G[:, 0].real.sum())
    return -1.0 if at_rest < -1e-9 * float(np.abs(G).max()) else 1.0


def longest_lag(G: Complex, w: Real) -> int:
    """The longest lag of all models, phase over frequency, in samples; a larger shift only leads.

    G is (models, frequencies) without a shift, and its first frequency is zero.
    """
    phase = np.unwrap(np.angle(direction(G) * G), axis=1)[:, 1:]
    return int(np.ceil(np.max(-phase / w[1:])))


def best_gain(G: Complex, H: Real | float = 1.0) -> tuple[float, float]:
    """The K with the smallest max |H (1 - K G)|, and that maximum. K has the sign of `direction`.

    The maximum is convex in K, so a golden-section search finds it.
    """
    sign = direction(G)
    top = 2 / max(float(np.abs(G).max()), 1e-300)
    ratio = (np.sqrt(5) - 1) / 2

    def worst(K: float) -> float:
        return float(factor(G, sign * K, H, "signal").max())

    a, b = 0.0, 2 * top
    c, d = b - ratio * (b - a), a + ratio * (b - a)
    at_c, at_d = worst(c), worst(d)
    for _ in range(40):
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - ratio * (b - a)
            at_c = worst(c)
        else:
            a, c, at_c = c, d, at_d
            d = a + ratio * (b - a)
            at_d = worst(d)
    K = (a + b) / 2
    return float(sign * K), worst(K)


def gain_limits(G: Complex, H: Real | float = 1.0, filtered: Filtered = "error") -> Real:
    """The K > 0 at which |F| reaches 1 + MONOTONE, for each model and frequency; about 0 if any K exceeds it.

    K solves a quadratic equation. With the filter on the signal it is |1 - K G|^2 = (1 + MONOTONE)^2 / H^2.
    With the filter on the error it is |1 - K G H|^2 = (1 + MONOTONE)^2.
    """
    gain = np.maximum(np.asarray(H), 1e-9)
    G, level = (G * H, 1.0) if filtered == "error" else (G, 1 / gain)
    real, square = G.real, np.maximum(np.abs(G) ** 2, 1e-300)
    spare = (level * (1 + MONOTONE)) ** 2 - 1
    return np.asarray((real + np.sqrt(real**2 + square * spare)) / square)


def peak(f: Callable[[Real, Sequence[int]], Real], w: Real, values: Real) -> tuple[float, float, int]:
    """The largest value of f(w, models), its frequency and its model.

    The search starts from the values on a grid, and refines around each local maximum that may have a larger
    value between its grid points.
    """
    first, k = np.unravel_index(int(np.argmax(values)), values.shape)
    best = (float(values[first, k]), float(w[k]), int(first))
    for model, k in _maxima(values):
        low, high = w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)]
        for _ in range(REFINEMENTS):
            near = np.linspace(low, high, 33)
            row = f(near, [int(model)])[0]
            top = int(np.argmax(row))
            best = max(best, (float(row[top]), float(near[top]), int(model)))
            low, high = near[max(top - 1, 0)], near[min(top + 1, len(near) - 1)]
    return best


def _maxima(values: Real) -> NDArray[np.intp]:
    """(model, grid index) of the local maxima that may hide the largest value between grid points.

    These are the maxima that exceed all values if raised by their height above their lower neighbour.
    """
    around = np.pad(values, ((0, 0), (1, 1)), constant_values=np.nan)
    left, right = around[:, :-2], around[:, 2:]
    risen = 2 * values - np.fmin(left, right)
    found = np.argwhere(~(left > values) & ~(right > values) & (risen > values.max()))
    return found[np.argsort(risen[tuple(found.T)])[::-1][:CANDIDATES]]
