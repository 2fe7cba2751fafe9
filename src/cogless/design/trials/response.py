"""The trial-to-trial operator (20) of Mandra 2019 in the frequency domain, for many plants at once.

G(w) = C z^r (zI - A)^-1 B is the response from the learned v to the output r samples later, at z = exp(jw)
with w in rad per sample. With the gain K and a zero-phase filter of gain H >= 0 the error obeys
e_{k+1} = F e_k + ...

    no filter        F = 1 - K G
    on the error     F = 1 - K G H          v <- v + K H e
    on the signal    F = H (1 - K G)        v <- H (v + K e)

docs/theory/trial-design.md#the-certificate says what max |F| means for a trial of finite length.

Learning over trials of finite length, which the frequency response doesn't show.

At both ends of the trial the filter extends the signal, and the shift repeats the last error. So the error
may grow there although it shrinks at every frequency. And where the filter acts on the learned signal, |F|
is the factor of the signal's change, not of the error. Over N samples one trial is

    e = d - G v        d: the error without learning
    v <- M v + B d     M = I - B G,  B = K_3 S Q Z     filter on the error, or none
                       M = Q - B G,  B = K_3 Q S Z     filter on the signal
                       M = I - B G,  B = L Z           norm-optimal
                       M = Q - B G,  B = Q L Z         with the filter on the signal

with the lifted loop G, the filter Q, the shift S and Z, which leaves out the first samples, that no input can
reach. So after k trials the error is R_k d, R_k = I - G (I + M + .. + M^(k-1)) B.

The zero-phase Butterworth filter between trials, and a search for a cutoff with which learning works.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cogless.design.margins import Complex as Complex
from cogless.design.trials.feedforward import polynomials
from cogless.design.trials.model import (
    DesignError,
    Model,
    Real,
    butterworth_polynomials,
    forward,
    forward_and_backward,
    forward_and_backward_transposed,
)

Filtered = Literal["error", "signal"]
GRID_FREQUENCIES = 700  # evenly spaced frequencies of a grid
POLE_DISTANCES = np.array(
    [0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0]
)  # distances of grid points from a pole's angle, in units of 1 - |p|
NARROW_POLE_DISTANCE = 0.05  # a pole further from the unit circle needs no grid points of its own
REFINEMENT_ROUNDS = 3  # rounds in which a maximum is searched on a finer grid
MAXIMA_MOST = 40  # largest number of local maxima that are refined
FACTOR_ROUNDING = 1e-9  # a factor above one by less is rounding, and harmless for a million trials


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
    w = np.union1d(np.linspace(0.0, np.pi, GRID_FREQUENCIES), np.geomspace(1e-4, 0.3, GRID_FREQUENCIES // 3))
    if poles is None:
        return w
    width = 1 - np.abs(poles)
    narrow = (width > 0) & (width < NARROW_POLE_DISTANCE) & (poles.imag >= 0)
    width = width[narrow][:, None]
    near = np.abs(np.angle(poles[narrow])[:, None] + width * np.append(-POLE_DISTANCES, POLE_DISTANCES))
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
    """The K > 0 at which |F| reaches 1 + FACTOR_ROUNDING, for each model and frequency.

    The limit is about 0 if every K > 0 exceeds that level.

    K solves a quadratic equation. With the filter on the signal it is
    |1 - K G|^2 = (1 + FACTOR_ROUNDING)^2 / H^2.
    With the filter on the error it is |1 - K G H|^2 = (1 + FACTOR_ROUNDING)^2.
    """
    gain = np.maximum(np.asarray(H), 1e-9)
    G, level = (G * H, 1.0) if filtered == "error" else (G, 1 / gain)
    real, square = G.real, np.maximum(np.abs(G) ** 2, 1e-300)
    spare = (level * (1 + FACTOR_ROUNDING)) ** 2 - 1
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
        for _ in range(REFINEMENT_ROUNDS):
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
    before, right = around[:, :-2], around[:, 2:]
    risen = 2 * values - np.fmin(before, right)
    maxima = np.argwhere(~(before > values) & ~(right > values) & (risen > values.max()))
    return maxima[np.argsort(risen[tuple(maxima.T)])[::-1][:MAXIMA_MOST]]


TRIALS_TRIED = 80  # trials that are simulated to find the growth per trial
POWERS = (1, 2, 3, 5, 8)  # powers of M whose norms are computed
SHARES = (1, 2, 4, 8, 24)  # trials after which the error's largest share is found
NORM_ITERATIONS = 6  # for each norm; the estimate is from below
VECTOR_ROUNDING = 1e-12  # share of the largest value; a next vector below it is only rounding


@dataclass(frozen=True)
class TrialMap:
    """One trial of several plants at once: rows are plants, columns samples."""

    loops: Sequence[Loop]  # each from v to the signal that the law learns from; all have the same order
    K_3: float
    shift: int
    q_filter: Filter | None
    filtered: Filtered
    samples: int
    matrix: Real | None = None  # L, in place of K_3, shift and a filter on the error

    @cached_property
    def _polynomials(self) -> tuple[Real, Real]:
        transfer = [polynomials(Model(loop.A, loop.B), loop.C) for loop in self.loops]
        a, b = (np.array(coefficients) for coefficients in zip(*transfer, strict=True))
        return b, a

    @cached_property
    def acts(self) -> Real:
        """1 where v acts within the trial: not its last samples, unless the filter spreads them to others."""
        b, _ = self._polynomials
        idle = np.array([[self.samples - int(np.flatnonzero(row)[0])] for row in b])
        spread = self._on_signal or self.matrix is not None
        until = np.full_like(idle, self.samples) if spread else idle
        return (np.arange(self.samples) < until).astype(np.float64)

    @property
    def _on_signal(self) -> bool:
        return self.q_filter is not None and self.filtered == "signal"

    def output(self, v: Real) -> Real:
        """G v. In the time domain: a product of spectra spreads the largest samples' rounding over all."""
        b, a = self._polynomials
        return forward(b, a, v)

    def output_transposed(self, y: Real) -> Real:
        """G^T y: G is lower triangular and Toeplitz."""
        return self.output(y[:, ::-1])[:, ::-1]

    def smooth(self, x: Real) -> Real:
        """Q x."""
        q = self.q_filter
        return x if q is None else forward_and_backward(q.b, q.a, x, q.odd)

    def smooth_transposed(self, x: Real) -> Real:
        """Q^T x."""
        q = self.q_filter
        return x if q is None else forward_and_backward_transposed(q.b, q.a, x, q.odd)

    def correction(self, e: Real) -> Real:
        """B e: what an error adds to v."""
        seen = e.copy()
        seen[:, : self.shift] = 0.0
        if self.matrix is not None:
            added = seen @ self.matrix.T
            return self.smooth(added) if self._on_signal else added
        if self._on_signal:
            return self.smooth(self.K_3 * self._ahead(seen))
        return self.K_3 * self._ahead(self.smooth(seen))

    def correction_transposed(self, v: Real) -> Real:
        """B^T v."""
        if self.matrix is not None:
            e = (self.smooth_transposed(v) if self._on_signal else v) @ self.matrix
        elif self._on_signal:
            e = self.K_3 * self._ahead_transposed(self.smooth_transposed(v))
        else:
            e = self.smooth_transposed(self.K_3 * self._ahead_transposed(v))
        e[:, : self.shift] = 0.0
        return e

    def recall(self, v: Real) -> Real:
        """What remains of v where there is no error: v, or Q v."""
        return self.smooth(v) if self._on_signal else v

    def step(self, v: Real) -> Real:
        """M v."""
        acting = v * self.acts
        return (self.recall(acting) - self.correction(self.output(acting))) * self.acts

    def step_transposed(self, v: Real) -> Real:
        """M^T v."""
        acting = v * self.acts
        smoothed = self.smooth_transposed(acting) if self._on_signal else acting
        return (smoothed - self.output_transposed(self.correction_transposed(acting))) * self.acts

    def learned(self, d: Real, trials: int) -> Real:
        """v after so many trials from v = 0, with the error d where v is zero."""
        added = self.correction(d)
        v = np.zeros_like(d)
        for _ in range(trials):
            v = self.recall(v) - self.correction(self.output(v)) + added
        return v

    def remaining(self, d: Real, trials: int) -> Real:
        """R_k d: the error after so many trials, d without learning."""
        return d - self.output(self.learned(d, trials))

    def remaining_transposed(self, e: Real, trials: int) -> Real:
        """R_k^T e."""
        w = self.output_transposed(e)
        total = np.zeros_like(w)
        for _ in range(trials):
            total += w
            smoothed = self.smooth_transposed(w) if self._on_signal else w
            w = smoothed - self.output_transposed(self.correction_transposed(w))
        return e - self.correction_transposed(total)

    def _ahead(self, e: Real) -> Real:
        return np.hstack([e[:, self.shift :], np.repeat(e[:, -1:], self.shift, axis=1)])

    def _ahead_transposed(self, v: Real) -> Real:
        inside = v[:, : self.samples - self.shift]
        e = np.hstack([np.zeros((len(v), self.shift)), inside])
        e[:, -1] += v[:, self.samples - self.shift :].sum(axis=1)
        return e


@dataclass(frozen=True)
class FiniteTrial:
    """Norms of a trial of finite length, each the largest of all plants; estimates from below."""

    norm: float  # of M: by how much the change of v may grow in one trial
    power: float  # the largest norm of a power of M: by how much on the way
    share: float  # the largest norm of R_k: the error after any number of trials / the error without learning
    remains: (
        float  # the norm of R_k after the last of SHARES: the error in the end / the error without learning
    )


def finite_trial(trial: TrialMap) -> FiniteTrial:
    """The norms of a trial."""
    start = np.random.default_rng(0).normal(size=(len(trial.loops), trial.samples))

    def repeated(step: Callable[[Real], Real], count: int) -> Callable[[Real], Real]:
        def steps(v: Real) -> Real:
            for _ in range(count):
                v = step(v)
            return v

        return steps

    powers, x = [], start
    for k in POWERS:
        size, x = _norms(repeated(trial.step, k), repeated(trial.step_transposed, k), x)
        powers.append(size)
    shares, x = [], start
    for k in SHARES:
        size, x = _norms(
            lambda d, k=k: trial.remaining(d, k),  # type: ignore[misc]
            lambda e, k=k: trial.remaining_transposed(e, k),  # type: ignore[misc]
            x,
        )
        shares.append(size)
    return FiniteTrial(powers[0], max(powers), max(shares), shares[-1])


def _norms(forward: Callable[[Real], Real], back: Callable[[Real], Real], x: Real) -> tuple[float, Real]:
    """The largest norm of several maps and the vectors that show it, by Lanczos' iteration from x."""
    basis: list[Real] = []
    diagonal, off_diagonal = np.zeros((NORM_ITERATIONS, len(x))), np.zeros((NORM_ITERATIONS, len(x)))
    x = x / np.linalg.norm(x, axis=1)[:, None]
    for n in range(NORM_ITERATIONS):
        basis.append(x)
        y = back(forward(x))
        diagonal[n] = np.einsum("rs,rs->r", x, y)
        for _ in range(2):  # once more, against rounding
            for other in basis:
                y = y - np.einsum("rs,rs->r", other, y)[:, None] * other
        off_diagonal[n] = np.linalg.norm(y, axis=1)
        # where nothing new comes the vectors span all that matters: a zero ends the row's iteration
        new = off_diagonal[n] > VECTOR_ROUNDING * np.abs(diagonal[: n + 1]).max(axis=0)
        off_diagonal[n] = np.where(new, off_diagonal[n], 0.0)
        x = np.where(new[:, None], y / np.where(new, off_diagonal[n], 1.0)[:, None], 0.0)
    squares = np.zeros((len(x), NORM_ITERATIONS, NORM_ITERATIONS))
    at = np.arange(NORM_ITERATIONS)
    squares[:, at, at] = diagonal.T
    squares[:, at[1:], at[:-1]] = squares[:, at[:-1], at[1:]] = off_diagonal[:-1].T
    values, vectors = np.linalg.eigh(squares)
    ritz = np.einsum("nrs,rn->rs", np.array(basis), vectors[:, :, -1])
    # a part of noise, so that the next map's own direction isn't missed
    noise = np.random.default_rng(1).normal(size=x.shape) / np.sqrt(x.shape[1])
    return float(np.sqrt(max(values[:, -1].max(), 0.0))), ritz + 0.3 * noise


def growth(trial: TrialMap) -> Real:
    """Factor per trial of each loop's error: its geometric mean over the last half of `TRIALS_TRIED` trials.

    The simulation starts with noise in v, without a reference.
    """
    v = np.random.default_rng(0).normal(size=(len(trial.loops), trial.samples)) * trial.acts
    sizes = np.ones((TRIALS_TRIED, len(trial.loops)))
    for k in range(TRIALS_TRIED):
        e = -trial.output(v)
        e[:, : trial.shift] = 0.0
        sizes[k] = np.maximum(np.linalg.norm(e, axis=1), 1e-300)
        # the update is linear: scaled to |e| = 1, many trials neither overflow nor vanish in rounding
        v, e = v / sizes[k][:, None], e / sizes[k][:, None]
        v = (trial.recall(v) + trial.correction(e)) * trial.acts
    return np.asarray(np.exp(np.log(sizes[TRIALS_TRIED // 2 :]).mean(axis=0)))


SHIFTS_TRIED = 13  # from the relative degree to the longest lag
BETTER_SHARE = 0.95  # another shift is proposed if its factor is less than this share of the present one
# cutoffs that are tried until the error shrinks at the trial's ends too, each 0.8 times the last
CUTOFFS_MOST = 10
PROPOSED_FACTOR_MOST = 0.95  # largest factor per trial with a proposed cutoff


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
        return max(
            worst,
            float(
                growth(
                    TrialMap(
                        loops=loops,
                        K_3=K_3,
                        shift=tried,
                        q_filter=q_filter,
                        filtered="signal",
                        samples=samples,
                    )
                ).max()
            ),
        )

    now = with_ends(shift)
    best, factor_best = shift, now
    for tried in sorted(spread - {shift}, key=lambda tried: gains[tried][1]):
        if gains[tried][1] >= factor_best:
            break  # the ends only add to it
        factor_tried = with_ends(tried)
        if factor_tried < factor_best:
            best, factor_best = tried, factor_tried
    return (now, best, factor_best) if factor_best < BETTER_SHARE * now else None


def workable_cutoff(
    loops: Sequence[Loop], shift: int, order: int, period: float, samples: int, K_3: float | None = None
) -> float | None:
    """The largest cutoff, Hz, whose factor per trial is at most `PROPOSED_FACTOR_MOST`, or None.

    This holds for all loops and frequencies and at the trial's ends, with K_3 or, if it is None, with the
    best gain. The filter acts on the learned signal: filtering the error alone isn't enough (response.py).
    """
    bundle = Bundle(loops, shift)
    w = bundle.grid
    G = bundle(w)

    def gain_and_factor(cutoff: float) -> tuple[float, float]:
        H = butterworth(cutoff, order, period).gain(w)
        return best_gain(G, H) if K_3 is None else (K_3, float(factor(G, K_3, H, "signal").max()))

    low, high = 1e-3 / period, 0.49 / period
    if gain_and_factor(low)[1] > PROPOSED_FACTOR_MOST:
        return None
    for _ in range(10):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if gain_and_factor(middle)[1] <= PROPOSED_FACTOR_MOST else (low, middle)
    for _ in range(CUTOFFS_MOST):
        q_filter = butterworth(low, order, period)
        trial = TrialMap(
            loops=loops,
            K_3=gain_and_factor(low)[0],
            shift=shift,
            q_filter=q_filter,
            filtered="signal",
            samples=samples,
        )
        if growth(trial).max() <= PROPOSED_FACTOR_MOST:
            return low
        low *= 0.8
    return None
