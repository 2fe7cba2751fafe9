"""Whether one gain stabilises all vertices with one Lyapunov matrix: quadratic stabilisability.

    [Y  *; A_j Y + B_j W  Y] >= t I,   Y <= I,   t as large as possible

This problem always has a solution. Its t depends on the coordinates, so the gain K = W Y^-1 itself is tested:
in coordinates in which Y is I, |A_j + B_j K| < 1 has to hold at each vertex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from cogless.design.lmi import Unknown, minimise
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
    n, inverse = len(T), np.linalg.inv(T)
    driven = [inverse @ model.B for model in models]
    size = max(float(np.linalg.norm(b)) for b in driven)

    def shrinks(model: Model, b: Real, t: Real, Y: Real, W: Real) -> Real:
        moved = (inverse @ model.A @ T) @ Y + b / size @ W
        return np.block([[Y, moved.T], [moved, Y]]) - t * np.eye(2 * n)

    vertices = [partial(shrinks, model, b) for model, b in zip(models, driven, strict=True)]
    unknowns = [Unknown(1, 1, weight=-1.0), Unknown(n, n, symmetric=True), Unknown(1, n)]
    _, found = minimise(unknowns, [lambda t, Y, W: np.eye(n) - Y, *vertices])
    if found is None:
        return None
    _, y, w = found
    if not np.all(np.isfinite(y)) or np.linalg.eigvalsh(y)[0] < NONE:
        return None
    K = np.linalg.solve(y, w[0]) / size @ inverse
    return K, T @ np.linalg.cholesky(y)
