"""Whether one gain stabilises all vertices with one Lyapunov matrix: quadratic stabilisability.

    [Y  *; A_j Y + B_j W  Y] >= t I,   Y <= I,   t as large as possible

This problem always has a solution. Its t depends on the coordinates, so the gain K = W Y^-1 itself is tested:
in coordinates in which Y is I, |A_j + B_j K| < 1 has to hold at each vertex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.design.lmi import minimise
from cogless.design.model import Model, Real

TRIES = 3  # each in coordinates in which the Y of the try before is I
NONE = 1e-9  # a Y with an eigenvalue below this counts as singular; its upper bound is I
MARGIN = 1e-9  # by which |A_j + B_j K|^2 has to be below one


@dataclass(frozen=True)
class Common:
    """A gain that stabilises all vertices: with x = T x~, |x~| shrinks in every sample."""

    K: Real  # (n,)
    T: Real  # (n, n)


def stabilise(models: Sequence[Model], T: Real) -> Common | None:
    """A gain that stabilises all models, or None. T: coordinates in which the states are of similar size."""
    for _ in range(TRIES):
        found = _solve(models, T)
        if found is None:
            return None
        K, T = found
        closed = [np.linalg.solve(T, (model.A + model.B @ K[None, :]) @ T) for model in models]
        if all(np.linalg.norm(matrix, 2) ** 2 < 1 - MARGIN for matrix in closed):
            return Common(K, T)
    return None


def _solve(models: Sequence[Model], T: Real) -> tuple[Real, Real] | None:
    """Solves the program for t in the coordinates T: K and the coordinates in which Y is I, or None."""
    import cvxpy as cp

    n, inverse = len(T), np.linalg.inv(T)
    driven = [inverse @ model.B for model in models]
    size = max(float(np.linalg.norm(b)) for b in driven)
    Y, W, t = cp.Variable((n, n), symmetric=True), cp.Variable((1, n)), cp.Variable()
    constraints = [Y << np.eye(n)]
    for model, b in zip(models, driven, strict=True):
        moved = (inverse @ model.A @ T) @ Y + b / size @ W
        constraints.append(cp.bmat([[Y, moved.T], [moved, Y]]) >> t * np.eye(2 * n))
    minimise(-t, constraints)
    if Y.value is None or W.value is None:
        return None
    y = np.asarray(Y.value)
    if not np.all(np.isfinite(y)) or np.linalg.eigvalsh(y)[0] < NONE:
        return None
    K = np.linalg.solve(y, np.asarray(W.value)[0]) / size @ inverse
    return K, T @ np.linalg.cholesky(y)
