"""Norm-optimal learning in lifted form: docs/theory/trial-design.md#norm-optimal-learning.

Over a trial the nominal closed loop from v to y is a lower triangular Toeplitz matrix G of its impulse
response. The update is v_{k+1} = v_k + L e_k with L = (G^T G + q I)^-1 G^T, where q is the weight of v's
change relative to the error's weight.
"""

from __future__ import annotations

import numpy as np

from cogless.design.model import Real
from cogless.design.response import Loop


def impulse_response(loop: Loop, samples: int) -> Real:
    """Impulse response C A^(p-1) B at the samples p = 0 .. samples - 1; it is zero at p = 0."""
    out, x = np.zeros(samples), loop.B[:, 0]
    for p in range(1, samples):
        out[p] = loop.C @ x
        x = loop.A @ x
    return out


def lifted(loop: Loop, samples: int) -> Real:
    """The lifted closed loop: the Toeplitz matrix G (samples, samples)."""
    from scipy.linalg import toeplitz

    return np.asarray(toeplitz(impulse_response(loop, samples), np.zeros(samples)))


def norm_optimal(loop: Loop, samples: int, ratio: float) -> Real:
    """L (samples, samples); `ratio` is the weight of v's change divided by the weight of the error."""
    from scipy.linalg import cho_factor, cho_solve

    G = lifted(loop, samples)
    normal = G.T @ G
    normal[np.diag_indices(samples)] += ratio
    return np.asarray(
        cho_solve(cho_factor(normal, overwrite_a=True, check_finite=False), G.T, check_finite=False)
    )
