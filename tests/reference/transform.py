"""Clarke and Park transforms, amplitude invariant, on complex numbers: alpha + j beta and d + j q."""

import cmath

import numpy as np

TURN = cmath.exp(2j * cmath.pi / 3)


def clarke(abc: np.ndarray) -> complex:
    """2/3 of the sum of the phases, each along its winding's axis."""
    return complex(2 / 3 * (abc[0] + abc[1] * TURN + abc[2] * TURN**2))


def clarke_inverse(u: complex) -> np.ndarray:
    """The projection onto each winding's axis."""
    return np.array([u.real, (u * TURN**-1).real, (u * TURN**-2).real])


def park(u: complex, theta: float) -> complex:
    return u * cmath.exp(-1j * theta)


def park_inverse(u: complex, theta: float) -> complex:
    return u * cmath.exp(1j * theta)
