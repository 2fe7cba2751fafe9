"""Semidefinite programs by Clarabel, and the eigenvalues of their blocks, which don't trust it.

Always in coordinates that a Riccati or Lyapunov solution has scaled: unscaled, Clarabel and SCS return wrong
gains and call them optimal. cvxpy is imported where it is used, because that takes longer than most designs.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cogless.design.model import Real

TOLERANCE = 1e-7  # of a block's smallest eigenvalue beside its largest: as good as positive


@dataclass(frozen=True)
class Check:
    """A solution measured without its solver. Costs are in the cost function's unit."""

    smallest: float  # eigenvalue of any block, as a share of that block's largest
    cost: float  # the largest true cost at any vertex
    bound: float  # beta
    passed: bool


def minimise(objective: Any, constraints: list[Any]) -> str:
    """Solves in place; the status: "optimal", "optimal_inaccurate", "infeasible", "failed", ..."""
    import cvxpy as cp

    problem = cp.Problem(cp.Minimize(objective), constraints)
    settings = {"tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9, "max_threads": 1}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate": every solution is checked
        try:
            # its own equilibration would undo ours, and then fails now and again
            problem.solve(solver=cp.CLARABEL, equilibrate_enable=False, **settings)
        except cp.SolverError:
            return "failed"
    return str(problem.status)


def smallest_share(blocks: Sequence[Real]) -> float:
    """The smallest eigenvalue of any symmetric block, each as a share of its largest."""
    spectra = [np.linalg.eigvalsh((block + block.T) / 2) for block in blocks]
    return float(min(values[0] / max(float(np.abs(values).max()), 1e-300) for values in spectra))
