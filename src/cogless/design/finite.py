"""Learning over trials of finite length, which the frequency response doesn't show.

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
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cogless.design.feedforward import polynomials
from cogless.design.linear_filter import (
    forward,
    forward_and_backward,
    forward_and_backward_transposed,
)
from cogless.design.model import Model, Real
from cogless.design.response import Filter, Filtered, Loop

TRIALS = 80
POWERS = (1, 2, 3, 5, 8)  # of M, whose norms are found
SHARES = (1, 2, 4, 8, 24)  # trials after which the error's largest share is found
NORM_ITERATIONS = 6  # for each norm; the estimate is from below
ROUNDING_SHARE = 1e-12  # of the largest value: a next vector that is only rounding


@dataclass(frozen=True)
class TrialMap:
    """One trial of several plants at once: rows are plants, columns samples."""

    loops: Sequence[Loop]  # from v to what is learned from, all of one order
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


def _norms(there: Callable[[Real], Real], back: Callable[[Real], Real], x: Real) -> tuple[float, Real]:
    """The largest norm of several maps and the vectors that show it, by Lanczos' iteration from x."""
    basis: list[Real] = []
    diagonal, off_diagonal = np.zeros((NORM_ITERATIONS, len(x))), np.zeros((NORM_ITERATIONS, len(x)))
    x = x / np.linalg.norm(x, axis=1)[:, None]
    for n in range(NORM_ITERATIONS):
        basis.append(x)
        y = back(there(x))
        diagonal[n] = np.einsum("rs,rs->r", x, y)
        for _ in range(2):  # once more, against rounding
            for other in basis:
                y = y - np.einsum("rs,rs->r", other, y)[:, None] * other
        off_diagonal[n] = np.linalg.norm(y, axis=1)
        # where nothing new comes the vectors span all that matters: a zero ends the row's iteration
        new = off_diagonal[n] > ROUNDING_SHARE * np.abs(diagonal[: n + 1]).max(axis=0)
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
    """Factor per trial of each loop's error: its geometric mean over the last half of `TRIALS` trials.

    The simulation starts with noise in v, without a reference.
    """
    v = np.random.default_rng(0).normal(size=(len(trial.loops), trial.samples)) * trial.acts
    sizes = np.ones((TRIALS, len(trial.loops)))
    for k in range(TRIALS):
        e = -trial.output(v)
        e[:, : trial.shift] = 0.0
        sizes[k] = np.maximum(np.linalg.norm(e, axis=1), 1e-300)
        # the update is linear: scaled to |e| = 1, many trials neither overflow nor vanish in rounding
        v, e = v / sizes[k][:, None], e / sizes[k][:, None]
        v = (trial.recall(v) + trial.correction(e)) * trial.acts
    return np.asarray(np.exp(np.log(sizes[TRIALS // 2 :]).mean(axis=0)))
