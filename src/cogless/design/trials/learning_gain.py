"""The learning gain K_3 by the linear matrix inequality of Mandra 2019, (21) to (35).

docs/theory/trial-design.md#learning-as-a-repetitive-process has the inequalities. They bound the sum of the
squares of all later errors. Each trial that starts with eta(0) = f adds at most beta_1 to it. Each sample of
the first trial with e_0 = g adds at most beta_2. So one of each adds at most beta_1 + beta_2.

Scaling. For f = 0, (28) says that the loop stores less than it is supplied with, p |e_k|^2 - (1 + p)
|e_{k+1}|^2 a sample, where p is P_2. It needs max |F|^2 <= p / (1 + p). So a frequency sweep finds the K_3
with the smallest max |F|, which gives the size of p. The bounded-real Riccati equation of the nominal loop
then gives the size of P_1, the matrix of what is stored.
Where that scales badly, the solver's last iterate scales the next attempt. The sweep also shows when there is
no solution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from cogless.design.trials.feedforward import zeros
from cogless.design.trials.model import DesignError, Model, Real
from cogless.design.trials.polytope import enclose
from cogless.design.trials.response import Bundle, Complex, Loop, best_gain, direction
from cogless.design.trials.state_feedback import (
    EIGENVALUE_TOLERANCE,
    RESCALINGS_MOST,
    Check,
    Unknown,
    joined,
    minimise,
)
from cogless.units import TURN

MIXTURE_COUNT = 100  # random mixtures of vertices that the polytope must contain
FREQUENCIES_LEAST, FREQUENCIES_MOST = 1024, 8192  # `cost` uses a number of frequencies between these


@dataclass(frozen=True)
class Vertex:
    """One vertex (A, B, Gamma, Upsilon) of the set (23) of Mandra 2019."""

    A: Real
    B: Real  # (n, 1)
    Gamma: Real  # (1, n)
    Upsilon: float

    @classmethod
    def of_loop(cls, loop: Loop, r: int) -> Vertex:
        """The matrices (22) of a closed loop with relative degree r."""
        power = np.linalg.matrix_power(loop.A, r - 1)
        ahead = loop.C[None, :] @ power
        return cls(loop.A, loop.B, ahead @ loop.A, float((ahead @ loop.B)[0, 0]))

    @property
    def entries(self) -> Real:
        """The entries of all matrices, in one row vector."""
        return np.concatenate([self.A.ravel(), self.B.ravel(), self.Gamma.ravel(), [self.Upsilon]])

    @classmethod
    def from_entries(cls, row: Real, n: int) -> Vertex:
        """The vertex with these `entries`, for n states."""
        A, B, Gamma = row[: n * n].reshape(n, n), row[n * n : n * n + n], row[n * n + n : -1]
        return cls(A, B.reshape(n, 1), Gamma.reshape(1, n), float(row[-1]))

    def phi(self, K_3: float) -> Real:
        """The matrix Phi of (27) with the learning gain K_3."""
        return joined([[self.A, self.B * K_3], [-self.Gamma, np.array([[1 - self.Upsilon * K_3]])]])


@dataclass(frozen=True)
class LearningGain:
    """The gain of the learning update v(p) <- v(p) + K_3 e(p + r), with its bounds and its check."""

    K_3: float
    bounds: tuple[float, float]  # beta_1 and beta_2, in the error's unit squared: see `cost`
    check: Check
    status: str
    affine: bool  # the set (23) is the hull of its mapped corners
    note: str


def mapped(loops: Sequence[Loop], r: int) -> tuple[list[Vertex], bool, str]:
    """Vertices of a polytope that contains the set (23), whether these are the mapped corners, and a note."""
    corners = [Vertex.of_loop(loop, r) for loop in loops]
    if r == 1 or len(loops) == 1:
        return corners, True, ""
    unit = np.eye(len(loops))
    middles = [(unit[i] + unit[j]) / 2 for i in range(len(loops)) for j in range(i)]
    shares = [*np.random.default_rng(0).dirichlet(np.ones(len(loops)), MIXTURE_COUNT), *middles]
    A, B = np.array([loop.A for loop in loops]), np.array([loop.B for loop in loops])
    rows = []
    for share in shares:
        mixture = Loop(np.tensordot(share, A, 1), np.tensordot(share, B, 1), loops[0].C)
        rows.append(Vertex.of_loop(mixture, r).entries)
    hull = enclose(np.array([corner.entries for corner in corners]), np.array(rows))
    if hull.exact:
        return [corners[k] for k in hull.corner_indices], True, ""
    n = len(loops[0].A)
    widened = [Vertex.from_entries(row, n) for row in hull.vertices]
    outside = f"by up to {100 * hull.outside:.2g} % of the hull's size"
    note = f"some plants of the set (23) of Mandra 2019 are outside the hull of its corners, {outside}"
    return widened, False, f"{note}: the design uses a bounding polytope of {len(widened)} vertices"


def learning_gain(loops: Sequence[Loop], nominal: Loop, r: int, f: Real, g: float) -> LearningGain:
    """K_3 for closed loops from v to y; DesignError if no gain is stable along the trial."""
    n = len(nominal.A)
    if not np.all(np.isfinite(f)):
        raise DesignError(f"initial_change: expected {n} finite numbers")
    if not (np.isfinite(g) and g > 0):
        raise DesignError(f"initial_error: {g:g}: expected a number above zero")
    bundle = Bundle([*loops, nominal], r)
    G = bundle(bundle.grid)
    start, worst = best_gain(G)
    if worst >= 1 - 1e-9:
        raise DesignError(_impossible(direction(G) * G, bundle.grid, nominal))
    vertices, affine, note = mapped(loops, r)
    scaling: tuple[Real, float] | None = (_scaling(nominal, r, start, worst), 1.0)
    for _ in range(RESCALINGS_MOST):
        if scaling is None:
            break
        solution, scaling = _solve(vertices, *scaling, f, g, 1 / start)
        if solution is not None:
            K_3, bounds, result, status = solution
            return LearningGain(K_3=K_3, bounds=bounds, check=result, status=status, affine=affine, note=note)
    rounded = float(f"{start:.4g}")
    keeps = (
        f"with K_3 = {rounded:g} each trial multiplies the error by {worst:.4g} or less, at each vertex and "
        "frequency"
    )
    raise DesignError(
        f"K_3: missing: expected a number, since rule (35) of Mandra 2019 gives no certified K_3: {keeps}"
    ).advising({"K_3": rounded})


def check(
    vertices: Sequence[Vertex], K_3: float, P: Sequence[Real], T: Real, f: Real, g: float, bound: float
) -> Check:
    """Checks (30) with P_j at each vertex, and the true `cost`, which doesn't use P_j, against the bound.

    The blocks are measured in the scaled coordinates of eta = T eta~. Each P_j, blockdiag(n x n, 1), is given
    in the same coordinates.
    """
    n = len(f)
    S = joined([[T, np.zeros((n, 1))], [np.zeros((1, n)), np.eye(1)]])
    blocks = []
    for vertex, p in zip(vertices, P, strict=True):
        phi = np.linalg.solve(S, vertex.phi(K_3) @ S)
        U = phi[n:]
        # measured relative to P, not to the difference, which may be small without being wrong
        root = np.linalg.cholesky(p)
        blocks.append(
            np.eye(n + 1) - np.linalg.solve(root, np.linalg.solve(root, phi.T @ p @ phi + U.T @ U).T)
        )
    smallest = float(min(np.linalg.eigvalsh((b + b.T) / 2)[0] for b in blocks))
    worst = max(cost(vertex, K_3, f, g) for vertex in vertices)
    return Check(smallest, worst, bound, smallest >= -EIGENVALUE_TOLERANCE and worst <= bound * (1 + 1e-6))


def cost(vertex: Vertex, K_3: float, f: Real, g: float) -> float:
    """The sum of e_k(p)^2 over all trials k >= 1 and samples p, for infinitely long trials.

    The initial values are those for which (30) gives the bound beta_1 + beta_2: eta(0) = f in the first trial
    and zero in later ones, e_0(0) = g and zero at later samples. The worse of both relative signs of f and g
    counts. By Parseval the sum is the mean of |E_1|^2 / (1 - |F|^2) over evenly spaced frequencies.
    """
    A, B, n = vertex.A, vertex.B * K_3, len(f)
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    if radius >= 1 or np.abs(np.linalg.eigvals(vertex.phi(K_3))).max() >= 1:
        return np.inf
    points = int(np.clip(20 / (1 - radius), FREQUENCIES_LEAST, FREQUENCIES_MOST))
    z = np.exp(1j * np.linspace(0, np.pi, points + 1))
    responses = np.linalg.solve(z[:, None, None] * np.eye(n) - A, np.column_stack([f, B[:, 0]]))
    seen = (-vertex.Gamma @ responses)[:, 0, :]
    free, F = z * seen[:, 0], 1 - vertex.Upsilon * K_3 + seen[:, 1]
    loss = 1 - np.abs(F) ** 2
    if loss.min() <= 0:
        return np.inf
    sums = [np.abs(F * g + sign * free) ** 2 / loss for sign in (-1.0, 1.0)]
    return max(float(row.sum() - (row[0] + row[-1]) / 2) / points for row in sums)


def _impossible(G: Complex, w: Real, nominal: Loop) -> str:
    """The message why no K_3 is stable along the trial.

    Stability needs |1 - K G| < 1, so Re G > 0 at every frequency w. Then the phase of G stays within 90 deg,
    so that all zeros of G are inside the unit circle.
    """
    all_zeros = zeros(Model(nominal.A, nominal.B), nominal.C)
    outside = [zero for zero in all_zeros if abs(zero) >= 1 - 1e-9]
    if outside:
        z = max(outside, key=abs)
        at = f"{z.real:.4g}" if abs(z.imag) < 1e-9 else f"{z.real:.4g}{z.imag:+.4g}j"
        reason = f"because the plant has a zero at z = {at}, not inside the unit circle"
    else:
        reason = "because the feedback lags too much there"
    lowest = G.real.min(axis=0)
    at_first = float(w[lowest <= 0].min(initial=np.pi)) / TURN
    return (
        f"q_filter: no K_3 makes the error fall at every frequency: above {at_first:.3g} times the sampling "
        f"rate it grows with any gain, {reason}; expected a zero-phase low-pass filter on the learned signal"
    )


def _scaling(nominal: Loop, r: int, K: float, worst: float) -> Real:
    """T of eta = T eta~, chosen so that P_1 of the nominal loop is about the identity; e isn't scaled.

    P_1 is the solution X of the bounded-real Riccati equation: the storage for the supply p |e_k|^2 - (1 + p)
    |e_{k+1}|^2. If it has no solution, each state is scaled by the size to which errors of about one drive
    it.
    """
    import scipy.linalg

    vertex = Vertex.of_loop(nominal, r)
    A, B, Gamma, D = vertex.A, vertex.B * K, -vertex.Gamma, 1 - vertex.Upsilon * K
    reached = scipy.linalg.solve_discrete_lyapunov(A, B @ B.T)
    unit = np.sqrt(np.maximum(np.diag(reached), 1e-24 * max(float(np.trace(reached)), 1e-300)))
    A, B, Gamma = A * unit / unit[:, None], B / unit[:, None], Gamma * unit
    level = min(0.5 * (1 + worst**2), 0.9999)
    p = level / (1 - level)
    try:
        X = scipy.linalg.solve_discrete_are(
            A, B, (1 + p) * Gamma.T @ Gamma, np.array([[(1 + p) * D * D - p]]), s=(1 + p) * Gamma.T * D
        )
        T = np.linalg.inv(np.linalg.cholesky((X + X.T) / 2).T)
    except (np.linalg.LinAlgError, ValueError):
        return np.diag(unit)
    return np.asarray(unit[:, None] * T)


_Found = tuple[float, tuple[float, float], Check, str]


def _solve(
    vertices: Sequence[Vertex], T: Real, s: float, f: Real, g: float, unit: float
) -> tuple[_Found | None, tuple[Real, float] | None]:
    """Solves (32) to (35) in the coordinates eta = T eta~, e = s e~, with v scaled by `unit`; None if `check`
    fails. Also returns the T and s for which this solution's P_j are about the identity, for another attempt.
    """
    n = len(f)
    inverse = np.linalg.inv(T)
    start = (inverse @ f) / g
    row, column, zero, one = np.zeros((1, n)), np.zeros((n, 1)), np.zeros((1, 1)), np.eye(1)
    scalar, weighted, symmetric = Unknown(1, 1), Unknown(1, 1, weight=1.0), Unknown(n, n, symmetric=True)
    # beta_1, beta_2, G_1, Y_1 of the first vertex, G_2, its Y_2, W, then Y_1 and Y_2 of the others
    unknowns = [weighted, weighted, Unknown(n, n), symmetric, scalar, scalar, scalar]
    unknowns += [symmetric, scalar] * (len(vertices) - 1)

    def sorted_out(x: Sequence[Real]) -> tuple[Real, Real, Real, list[tuple[Real, Real]]]:
        """G_1, G_2, W, and for each vertex Y_1 and Y_2."""
        return x[2], x[4], x[6], [(x[3], x[5]), *zip(x[7::2], x[8::2], strict=True)]

    def of_vertex(vertex: Vertex, k: int, *x: Real) -> Real:
        G_1, G_2, W, Y = sorted_out(x)
        Y_1, Y_2 = Y[k]
        moved = (inverse @ vertex.A @ T) @ G_1
        driven = (inverse @ vertex.B / unit * s) @ W
        seen = -(vertex.Gamma @ T) @ G_1  # in e, as `left` is; the fourth row is in e~
        error_row = (G_2 - vertex.Upsilon / unit * W) * s
        return joined(
            [
                [G_1 + G_1.T - Y_1, column, moved.T, seen.T / s, seen.T],
                [row, 2 * G_2 - Y_2, driven.T, error_row / s, error_row],
                [moved, driven, Y_1, column, column],
                [seen / s, error_row / s, row, Y_2, zero],
                [seen, error_row, row, zero, one],
            ]
        )

    def first_cost(k: int, *x: Real) -> Real:
        return joined([[x[0], start[None, :]], [start[:, None], sorted_out(x)[3][k][0]]])

    def second_cost(k: int, *x: Real) -> Real:
        return joined([[x[1], one / s], [one / s, sorted_out(x)[3][k][1]]])

    blocks: list[Callable[..., Real]] = []
    for k, vertex in enumerate(vertices):
        blocks += [partial(of_vertex, vertex, k), partial(first_cost, k), partial(second_cost, k)]
    status, x = minimise(unknowns, blocks)
    if x is None:
        return None, None
    _, G_2, W, Y = sorted_out(x)
    try:
        mean_1, mean_2 = (np.mean(matrices, axis=0) for matrices in zip(*Y, strict=True))
        scaling = T @ np.linalg.cholesky(mean_1), s * float(np.linalg.cholesky(mean_2)[0, 0])
        whole = [joined([[Y_1, column], [row, Y_2 * s**2]]) for Y_1, Y_2 in Y]
        P = list(np.linalg.inv(np.array(whole)))
        K_3 = float(W[0, 0] / G_2[0, 0] / unit)
        first = g * g * max(float(start @ p[:n, :n] @ start) for p in P)
        second = g * g * max(float(p[n, n]) for p in P)
        result = check(vertices, K_3, P, T, f, g, (first + second) * (1 + 1e-9))
    except np.linalg.LinAlgError:
        return None, None
    solution = (K_3, (first, second), result, status) if np.isfinite(K_3) and result.passed else None
    return solution, scaling
