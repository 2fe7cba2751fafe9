"""Semidefinite programs, solved by Clarabel, and a check of the solutions by the eigenvalues of the blocks.

The problems are always in coordinates scaled by a Riccati or Lyapunov solution. In unscaled coordinates
Clarabel and SCS return wrong gains and report them as optimal. cvxpy is imported only inside the function
that uses it, because the import takes longer than most designs.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cogless.design.model import Real

TOLERANCE = 1e-7  # an eigenvalue above minus this share of the block's largest counts as positive


@dataclass(frozen=True)
class Check:
    """A check of a solution that doesn't rely on the solver. Costs are in the cost function's unit."""

    smallest: float  # smallest eigenvalue of all blocks, each as a share of its block's largest
    cost: float  # the largest true cost at any vertex
    bound: float  # beta
    passed: bool


def minimise(objective: Any, constraints: list[Any]) -> str:
    """Solves in place and returns the status: "optimal", "optimal_inaccurate", "infeasible", "failed", ..."""
    import cvxpy as cp

    problem = cp.Problem(cp.Minimize(objective), constraints)
    settings = {"tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9, "max_threads": 1}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate": all solutions are checked anyway
        try:
            # Clarabel's own equilibration would undo our scaling, and then it sometimes fails
            problem.solve(solver=cp.CLARABEL, equilibrate_enable=False, **settings)
        except cp.SolverError:
            return "failed"
    return str(problem.status)


def smallest_share(blocks: Sequence[Real]) -> float:
    """The smallest eigenvalue of all symmetric blocks, each as a share of its block's largest."""
    spectra = [np.linalg.eigvalsh((block + block.T) / 2) for block in blocks]
    return float(min(values[0] / max(float(np.abs(values).max()), 1e-300) for values in spectra))
