"""Guaranteed-cost state feedback, with or without integral action: (9) to (13) of Mandra 2019.

docs/theory/trial-design.md#state-feedback-with-a-guaranteed-cost derives it. The feedback is u = K x with one
Lyapunov matrix Y^-1 for all vertices, W = K Y, and the smallest bound beta on the cost from x(0) = gamma.

The problem is solved in coordinates x = T x~, with Q^-1 and 1/R scaled to one by congruence. T follows from
the nominal Riccati solution, X = T^-T T^-1. If the solver fails with this T because the ranges are very wide,
T follows from the gain of `stabilise`. A result is used only if `check` accepts it.

Semidefinite programs, solved by Clarabel, and a check of the solutions by the eigenvalues of the blocks.

The problems are always in coordinates scaled by a Riccati or Lyapunov solution. In unscaled coordinates
Clarabel and SCS return wrong gains and report them as optimal. Clarabel is imported only inside the function
that uses it.

Whether one gain stabilises all vertices with one Lyapunov matrix: quadratic stabilisability.

    [Y  *; A_j Y + B_j W  Y] >= t I,   Y <= I,   t as large as possible

This problem always has a solution. Its t depends on the coordinates, so the gain K = W Y^-1 itself is tested:
in coordinates in which Y is I, |A_j + B_j K| < 1 has to hold at each vertex.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from cogless.design.trials.model import DesignError, Model, Real, uncontrollable_mode
from cogless.design.trials.polytope import UncertainPlant

EIGENVALUE_TOLERANCE = 1e-7  # an eigenvalue above minus this share of the block's largest counts as positive
RESCALINGS_MOST = 4  # attempts to minimise a cost, each in coordinates from the attempt before
STATUS = {  # statuses of Clarabel that come with a solution
    "Solved": "optimal",
    "AlmostSolved": "optimal_inaccurate",
    "MaxIterations": "user_limit",
    "InsufficientProgress": "stalled",
    "NumericalError": "stalled",
}


@dataclass(frozen=True)
class Check:
    """A check of a solution that doesn't rely on the solver. Costs are in the cost function's unit."""

    smallest: float  # smallest eigenvalue of all blocks, each as a share of its block's largest
    cost: float  # the largest true cost at any vertex
    bound: float  # beta
    passed: bool


@dataclass(frozen=True)
class Unknown:
    """An unknown matrix. `weight`: of its top left entry in the cost."""

    rows: int
    columns: int
    symmetric: bool = False
    weight: float = 0.0

    @property
    def basis(self) -> Real:
        """Matrices (count, rows, columns) whose linear combinations it can be."""
        one = np.eye(self.rows * self.columns).reshape(-1, self.columns, self.rows).swapaxes(1, 2)
        if not self.symmetric:
            return one
        pairs = (one + one.swapaxes(1, 2)) / (1 + np.eye(self.rows))
        i, j = np.triu_indices(self.rows)
        return np.asarray(pairs[j * self.rows + i])


def minimise(
    unknowns: Sequence[Unknown], blocks: Sequence[Callable[..., Real]]
) -> tuple[str, list[Real] | None]:
    """Minimises the unknowns' weighted sum under the condition that all blocks are positive semidefinite.

    A block is an affine function of the unknowns, its value a symmetric matrix. Returns the status, such as
    "optimal" or "stalled", and the unknowns' values, or "failed" and None. Values of any status may be wrong:
    check them.
    """
    import clarabel
    from scipy.sparse import csc_matrix

    bases = [unknown.basis for unknown in unknowns]
    zeros = [np.zeros(basis.shape[1:]) for basis in bases]
    at_zero = [block(*zeros) for block in blocks]
    columns, cost = [], []
    for n, (unknown, basis) in enumerate(zip(unknowns, bases, strict=True)):
        for one in basis:
            values = [*zeros[:n], one, *zeros[n + 1 :]]
            slopes = [block(*values) - start for block, start in zip(blocks, at_zero, strict=True)]
            columns.append(np.concatenate([_triangle(slope) for slope in slopes]))
            cost.append(unknown.weight * one[0, 0])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    settings.max_threads = 1
    settings.equilibrate_enable = False  # it would undo our scaling, and then the solver sometimes fails
    solution = clarabel.DefaultSolver(
        P=csc_matrix((len(cost), len(cost))),
        q=np.array(cost),
        A=csc_matrix(-np.array(columns).T),
        b=np.concatenate([_triangle(start) for start in at_zero]),
        cones=[clarabel.PSDTriangleConeT(len(start)) for start in at_zero],
        settings=settings,
    ).solve()
    status = STATUS.get(str(solution.status))
    if status is None:
        return "failed", None
    parts = np.split(np.asarray(solution.x), np.cumsum([len(basis) for basis in bases])[:-1])
    return status, [np.tensordot(part, basis, 1) for part, basis in zip(parts, bases, strict=True)]


def joined(blocks: Sequence[Sequence[Real]]) -> Real:
    """The matrix of these blocks, row by row; np.block takes eight times as long for small blocks."""
    return np.concatenate([np.concatenate(row, axis=1) for row in blocks])


def _triangle(matrix: Real) -> Real:
    """The upper triangle of a symmetric matrix, column by column, scaled to keep inner products."""
    i, j, scale = _upper(len(matrix))
    return np.asarray(scale * matrix[i, j])


@cache
def _upper(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Real]:
    """Rows, columns and scale of the entries of `_triangle`."""
    j, i = np.tril_indices(size)
    return i, j, np.where(i == j, 1.0, np.sqrt(2.0))


def smallest_share(blocks: Sequence[Real]) -> float:
    """The smallest eigenvalue of all symmetric blocks, divided by the largest magnitude in its block."""
    spectra = [np.linalg.eigvalsh((block + block.T) / 2) for block in blocks]
    return float(min(values[0] / max(float(np.abs(values).max()), 1e-300) for values in spectra))


DESIGN_TRIES = 3  # tries, each in coordinates in which the Y of the try before is I
SINGULAR_Y_MOST = 1e-9  # a Y with an eigenvalue below this counts as singular; its upper bound is I
NORM_SLACK = 1e-9  # |A_j + B_j K|^2 has to be below one by this


@dataclass(frozen=True)
class Common:
    """A gain that stabilises all vertices: with x = T x~, |x~| shrinks in every sample."""

    K: Real  # (n,)
    T: Real  # (n, n)


def stabilise(models: Sequence[Model], T: Real) -> Common | None:
    """A gain that stabilises all models, or None. T: coordinates in which the states are of similar size."""
    for _ in range(DESIGN_TRIES):
        solution = _solve(models, T)
        if solution is None:
            return None
        K, T = solution
        closed = [np.linalg.solve(T, (model.A + model.B @ K[None, :]) @ T) for model in models]
        if all(np.linalg.norm(matrix, 2) ** 2 < 1 - NORM_SLACK for matrix in closed):
            return Common(K, T)
    return None


def _solve(models: Sequence[Model], T: Real) -> tuple[Real, Real] | None:
    """Solves the program for t in the coordinates T: K and the coordinates in which Y is I, or None."""
    n, inverse = len(T), np.linalg.inv(T)
    driven = [inverse @ model.B for model in models]
    size = max(float(np.linalg.norm(b)) for b in driven)

    def shrinks(model: Model, b: Real, t: Real, Y: Real, W: Real) -> Real:
        moved = (inverse @ model.A @ T) @ Y + b / size @ W
        return joined([[Y, moved.T], [moved, Y]]) - t * np.eye(2 * n)

    vertices = [partial(shrinks, model, b) for model, b in zip(models, driven, strict=True)]
    unknowns = [Unknown(1, 1, weight=-1.0), Unknown(n, n, symmetric=True), Unknown(1, n)]
    _, values = minimise(unknowns, [lambda t, Y, W: np.eye(n) - Y, *vertices])
    if values is None:
        return None
    _, y, w = values
    if not np.all(np.isfinite(y)) or np.linalg.eigvalsh(y)[0] < SINGULAR_Y_MOST:
        return None
    K = np.linalg.solve(y, w[0]) / size @ inverse
    return K, T @ np.linalg.cholesky(y)


VERTEX_PAIRS = 5  # pairs of vertices that are tried for an error message
RANGE_HALVINGS = 6  # the ranges are halved so often for an error message


@dataclass(frozen=True)
class StateFeedback:
    """State feedback u(p) = K_s chi(p), where chi is the state with the integrator, if there is one."""

    K_s: Real  # (n,) or, with integral action, (n + 1,)
    check: Check  # its bound is beta: on the cost from x(0) = gamma of any plant in the polytope
    status: str  # the solver reports it


def augmented(model: Model, C: Real) -> Model:
    """The model with the integrator psi(p) = psi(p-1) - y(p) as its last state: (7) of Mandra 2019."""
    n = model.order
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[n, :n], A[n, n] = model.A, -C, 1.0
    return Model(A, np.vstack([model.B, [[0.0]]]))


def with_integrator(plant: UncertainPlant, integral: bool) -> list[Model]:
    """The vertices that the feedback acts on: augmented with the integrator if `integral`."""
    return [augmented(m, plant.C) for m in plant.vertices] if integral else list(plant.vertices)


def weights(Q: Real, R: float, gamma: Real) -> None:
    """Checks the weights Q and R and the initial state gamma; DesignError if one is invalid."""
    if not np.all(np.isfinite(Q)) or not np.allclose(Q, Q.T, rtol=1e-9) or np.linalg.eigvalsh(Q)[0] <= 0:
        raise DesignError("state_weight: expected a symmetric matrix that is positive definite")
    if not (np.isfinite(R) and R > 0):
        raise DesignError(f"input_weight: {R:g}: expected a number above zero")
    if not np.all(np.isfinite(gamma)):
        raise DesignError(f"initial_state: expected {len(Q)} finite numbers")
    if not np.any(gamma):
        raise DesignError("initial_state: expected a state that is not zero")


def guaranteed_cost(plant: UncertainPlant, Q: Real, R: float, gamma: Real, integral: bool) -> StateFeedback:
    """The gains with the smallest cost bound; DesignError, with a remedy, if there are none."""
    weights(Q, R, gamma)
    models = with_integrator(plant, integral)
    for label, model in zip(plant.labels, models, strict=True):
        mode = uncontrollable_mode(model.A, model.B)
        if mode is not None:
            raise DesignError(_uncontrollable(label, mode, integral))
    centre = augmented(plant.nominal, plant.C) if integral else plant.nominal
    T = riccati_scaling(centre, Q, R)
    rough = np.diag(1 / np.sqrt(np.diag(Q))) if T is None else T
    common = stabilise(models, rough)
    if common is None:
        raise DesignError(_why(plant, models, rough, integral))
    for scaling in (T, _with_the_cost(models, common, Q, R)):
        for _ in range(RESCALINGS_MOST):
            if scaling is None:
                break
            gains, scaling = solve_scaled(models, scaling, Q, R, gamma)
            if gains is not None:
                return gains
    raise DesignError(
        "state_weight: expected other weights: with these the solver finds no gain, though one gain can "
        "control the ranges"
    )


def check(
    models: Sequence[Model], Q: Real, R: float, gamma: Real, K: Real, Y: Real, T: Real, bound: float
) -> Check:
    """Checks that (9) and (10) hold at given values, and that each vertex's true cost is below the bound.

    The blocks are measured in the coordinates x = T x~. The true cost is gamma^T P gamma with P from the
    closed loop's Lyapunov equation. It is infinite if a vertex is unstable.
    """
    import scipy.linalg

    n = len(Q)
    inverse = np.linalg.inv(T)
    y, root = inverse @ Y @ inverse.T, np.linalg.cholesky(T.T @ Q @ T).T
    y = (y + y.T) / 2
    k = K.reshape(1, n) @ T
    blocks, cost = [], 0.0
    for model in models:
        closed = inverse @ (model.A @ T + model.B @ k) @ y
        q, w = root @ y, np.sqrt(R) * k @ y
        blocks.append(joined(_of_the_cost(y, closed, q, w)))
        loop = model.A + model.B @ K.reshape(1, n)
        if np.abs(np.linalg.eigvals(loop)).max() >= 1:
            cost = np.inf
            continue
        scaled = inverse @ loop @ T
        P = scipy.linalg.solve_discrete_lyapunov(scaled.T, T.T @ Q @ T + R * k.T @ k)
        start = inverse @ gamma
        cost = max(cost, float(start @ P @ start))
    start = (inverse @ gamma) / np.sqrt(bound)
    blocks.append(joined([[np.eye(1), start[None, :]], [start[:, None], y]]))
    smallest = smallest_share(blocks)
    return Check(smallest, cost, bound, smallest >= -EIGENVALUE_TOLERANCE and cost <= bound * (1 + 1e-5))


def _of_the_cost(Y: Real, closed: Real, q: Real, w: Real) -> list[list[Real]]:
    """The block rows of (9), with Q^-1 and 1/R scaled to one."""
    n, zero = Y.shape[0], np.zeros
    return [
        [Y, closed.T, q.T, w.T],
        [closed, Y, zero((n, n)), zero((n, 1))],
        [q, zero((n, n)), np.eye(n), zero((n, 1))],
        [w, zero((1, n)), zero((1, n)), np.eye(1)],
    ]


def riccati_scaling(model: Model, Q: Real, R: float) -> Real | None:
    """T with T^T X T = I, where X solves the nominal Riccati equation; None if that has no solution."""
    import scipy.linalg

    try:
        # scaled by the weights, because the equation itself may be ill-conditioned
        s = 1 / np.sqrt(np.diag(Q))
        X = scipy.linalg.solve_discrete_are(
            model.A * s / s[:, None], model.B / s[:, None] / np.sqrt(R), Q * np.outer(s, s), np.eye(1)
        )
        X = X / np.outer(s, s)
        lower = np.linalg.cholesky((X + X.T) / 2)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(np.linalg.inv(lower.T))


def _with_the_cost(models: Sequence[Model], common: Common, Q: Real, R: float) -> Real:
    """T such that Y~ = I and the common gain satisfy (9): the T of the common gain, rescaled."""
    T, k = common.T, common.K.reshape(1, -1) @ common.T
    spent = T.T @ Q @ T + R * k.T @ k
    size = 0.0
    for model in models:
        moved = np.linalg.solve(T, (model.A + model.B @ common.K.reshape(1, -1)) @ T)
        root = np.linalg.inv(np.linalg.cholesky(np.eye(len(T)) - moved.T @ moved))
        size = max(size, float(np.linalg.eigvalsh(root @ spent @ root.T)[-1]))
    return np.asarray(T / np.sqrt(size))


def solve_scaled(
    models: Sequence[Model], T: Real, Q: Real, R: float, gamma: Real
) -> tuple[StateFeedback | None, Real | None]:
    """A gain, solved for in coordinates x = T x~; None if `check` rejects it.

    Also returns the T that makes this solution's Y~ the identity, for another attempt.
    """
    n, inverse = len(Q), np.linalg.inv(T)
    root = np.linalg.cholesky(T.T @ Q @ T).T
    start = inverse @ gamma
    size = float(np.linalg.norm(start))
    start = start / size

    def cost(beta: Real, Y: Real, W: Real) -> Real:
        return joined([[beta, start[None, :]], [start[:, None], Y]])

    def of_vertex(model: Model, beta: Real, Y: Real, W: Real) -> Real:
        closed = (inverse @ model.A @ T) @ Y + (inverse @ model.B / np.sqrt(R)) @ W
        return joined(_of_the_cost(Y, closed, root @ Y, W))

    unknowns = [Unknown(1, 1, weight=1.0), Unknown(n, n, symmetric=True), Unknown(1, n)]
    status, values = minimise(unknowns, [cost, *(partial(of_vertex, model) for model in models)])
    if values is None:
        return None, None
    _, y, w = values
    if not np.all(np.isfinite(y)) or np.linalg.eigvalsh(y)[0] <= 0:
        return None, None
    K = (np.linalg.solve(y, w[0]) / np.sqrt(R)) @ inverse
    # the bound computed from this Y, not the one that the solver reports
    bound = float(start @ np.linalg.solve(y, start)) * size**2 * (1 + 1e-9)
    result = check(models, Q, R, gamma, K, T @ y @ T.T, T, bound)
    gains = StateFeedback(K, result, status) if result.passed else None
    return gains, T @ np.linalg.cholesky(y)


def _uncontrollable(label: str, mode: complex, integral: bool) -> str:
    at = f"{mode.real:.6g}" if abs(mode.imag) < 1e-9 else f"{mode.real:.6g}{mode.imag:+.6g}j"
    if integral and abs(mode - 1) < 1e-5:
        return (
            f"vertex: expected a plant that integral action can control: at {label} the input can't move the "
            "mode at z = 1 (no gain at zero frequency)"
        )
    return f"vertex: expected a controllable plant; at {label} the input can't move the mode at z = {at}"


def _why(plant: UncertainPlant, models: Sequence[Model], T: Real, integral: bool) -> str:
    """The message: which two vertices have no stabilising gain in common, and how far ranges must shrink."""
    message = "range: expected ranges that one gain and one Lyapunov matrix can control"
    pair = _hopeless_pair(models, T)
    if pair is not None:
        message += f"; no gain controls both {plant.labels[pair[0]]} and {plant.labels[pair[1]]}"
    share = _feasible_share(plant, T, integral)
    return f"{message}; one gain controls the ranges if they are shrunk to {100 * share:.0f} % of their width"


def _hopeless_pair(models: Sequence[Model], T: Real) -> tuple[int, int] | None:
    """Two of the `VERTEX_PAIRS` furthest vertices that no common gain stabilises; else None."""
    rows = np.array([m.entries for m in models])
    spread = np.where(np.ptp(rows, axis=0) > 0, np.ptp(rows, axis=0), 1.0)
    apart = np.linalg.norm((rows[:, None] - rows) / spread, axis=2)
    pairs = [(i, j) for i in range(len(models)) for j in range(i)]
    for i, j in sorted(pairs, key=lambda pair: -apart[pair])[:VERTEX_PAIRS]:
        if stabilise([models[j], models[i]], T) is None:
            return j, i
    return None


def _feasible_share(plant: UncertainPlant, T: Real, integral: bool) -> float:
    """The largest share of the polytope, about the nominal plant, all of which one gain can stabilise.

    It is rounded down, by about two percent at most.
    """
    low, high = 0.0, 1.0
    for _ in range(RANGE_HALVINGS):
        middle = (low + high) / 2
        models = with_integrator(plant.shrunk(middle), integral)
        low, high = (middle, high) if stabilise(models, T) is not None else (low, middle)
    return math.floor(100 * low) / 100
