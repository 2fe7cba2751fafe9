"""Semidefinite programs whose solution is known."""

import numpy as np

from cogless.design.trials.state_feedback import Unknown, minimise


def symmetric(n: int) -> np.ndarray:
    A = np.random.default_rng(n).normal(size=(n, n))
    return np.asarray(A + A.T)


def test_the_least_multiple_of_one_above_a_matrix_is_its_largest_eigenvalue() -> None:
    A = symmetric(5)
    status, values = minimise([Unknown(1, 1, weight=1.0)], [lambda t: t * np.eye(5) - A])
    assert status == "optimal" and values is not None
    np.testing.assert_allclose(values[0], np.linalg.eigvalsh(A)[-1], rtol=1e-7)


def test_unknown_matrices_take_their_places() -> None:
    # both together allow x' B^-1 x <= 1: the furthest x along the first axis is B's first column, scaled
    B = symmetric(3) @ symmetric(3) + np.eye(3)
    unknowns = [Unknown(1, 3, weight=-1.0), Unknown(3, 3, symmetric=True)]
    status, values = minimise(
        unknowns, [lambda x, P: np.block([[np.eye(1), x], [x.T, P]]), lambda x, P: B - P]
    )
    assert status == "optimal" and values is not None
    x, P = values
    assert np.array_equal(P, P.T)
    np.testing.assert_allclose(x[0], B[0] / np.sqrt(B[0, 0]), rtol=1e-5, atol=1e-6)


def test_every_matrix_is_a_combination_of_its_basis() -> None:
    A, S = np.random.default_rng(1).normal(size=(2, 3)), symmetric(3)
    assert Unknown(2, 3).basis.shape == (6, 2, 3) and Unknown(3, 3, symmetric=True).basis.shape == (6, 3, 3)
    np.testing.assert_array_equal(np.tensordot(A.flatten("F"), Unknown(2, 3).basis, 1), A)
    upper = S[np.triu_indices(3)]
    np.testing.assert_array_equal(np.tensordot(upper, Unknown(3, 3, symmetric=True).basis, 1), S)


def test_no_solution_gives_none() -> None:
    assert minimise([Unknown(1, 1)], [lambda x: x - np.eye(1), lambda x: -x]) == ("failed", None)
