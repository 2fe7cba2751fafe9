"""Semidefinite programs, solved by Clarabel, and a check of the solutions by the eigenvalues of the blocks.

The problems are always in coordinates scaled by a Riccati or Lyapunov solution. In unscaled coordinates
Clarabel and SCS return wrong gains and report them as optimal. Clarabel is imported only inside the function
that uses it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cogless.design.model import Real

TOLERANCE = 1e-7  # an eigenvalue above minus this share of the block's largest counts as positive
RESCALED = 4  # attempts to minimise a cost, each in coordinates from the attempt before
STATUS = {  # Clarabel's, of those that come with a solution
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
        both = (one + one.swapaxes(1, 2)) / (1 + np.eye(self.rows))
        i, j = np.triu_indices(self.rows)
        return np.asarray(both[j * self.rows + i])


def minimise(
    unknowns: Sequence[Unknown], blocks: Sequence[Callable[..., Real]]
) -> tuple[str, list[Real] | None]:
    """Minimises the weighted sum such that all blocks are positive semidefinite.

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
        csc_matrix((len(cost), len(cost))),
        np.array(cost),
        csc_matrix(-np.array(columns).T),
        np.concatenate([_triangle(start) for start in at_zero]),
        [clarabel.PSDTriangleConeT(len(start)) for start in at_zero],
        settings,
    ).solve()
    status = STATUS.get(str(solution.status))
    if status is None:
        return "failed", None
    parts = np.split(np.asarray(solution.x), np.cumsum([len(basis) for basis in bases])[:-1])
    return status, [np.tensordot(part, basis, 1) for part, basis in zip(parts, bases, strict=True)]


def _triangle(matrix: Real) -> Real:
    """The upper triangle of a symmetric matrix, column by column, such that products of matrices are kept."""
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
