"""Trials of finite length against matrices that NumPy and SciPy make from the definitions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from reference.trial import zero_phase
from scipy.linalg import toeplitz

from cogless.design.trials.model import Real, forward_and_backward, forward_and_backward_transposed
from cogless.design.trials.response import SHARES, Filter, Loop, TrialMap, butterworth, finite_trial, growth

SAMPLES = 90
# A resonance and a lag, sampled at 10 ms: what learning by one gain finds hard.
LOOPS = [
    Loop(np.array([[1.5, -0.72], [1.0, 0.0]]), np.array([[0.22], [0.0]]), np.array([0.6, 0.4])),
    Loop(np.array([[0.9, 0.0], [0.1, 0.5]]), np.array([[0.1], [0.0]]), np.array([0.0, 5.0])),
]


def matrices(loop: Loop, K: float, shift: int, q: Filter | None, filtered: str) -> tuple[Real, Real, Real]:
    """G, M and B."""
    response = [float(loop.C @ np.linalg.matrix_power(loop.A, p) @ loop.B[:, 0]) for p in range(SAMPLES - 1)]
    G = toeplitz([0.0, *response], np.zeros(SAMPLES))
    one = np.eye(SAMPLES)
    Q = one if q is None else zero_phase(q.b, q.a, one, q.odd)
    Z = np.diag((np.arange(SAMPLES) >= shift).astype(float))
    S = one[np.minimum(np.arange(SAMPLES) + shift, SAMPLES - 1)]
    if filtered == "error":
        B = K * S @ Q @ Z
        return G, one - B @ G, B
    B = K * Q @ S @ Z
    return G, Q - B @ G, B


def share(G: Real, M: Real, B: Real, trials: int) -> Real:
    """R_k."""
    total, power = np.zeros_like(M), np.eye(len(M))
    for _ in range(trials):
        total, power = total + power, power @ M
    return np.asarray(np.eye(len(M)) - G @ total @ B)


@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_filter_s_transpose(order: int, odd: bool) -> None:
    q = butterworth(8.0, order, 0.01)
    Q = forward_and_backward(q.b, q.a, np.eye(40), odd)
    np.testing.assert_allclose(forward_and_backward_transposed(q.b, q.a, np.eye(40), odd), Q.T, atol=1e-10)


CASES: list[Any] = [
    (0.5, 2, None, "error"),
    (0.9, 3, butterworth(9.0, 2, 0.01), "error"),
    (0.9, 3, butterworth(9.0, 2, 0.01), "signal"),
    (1.2, 1, butterworth(4.0, 1, 0.01, odd=True), "signal"),
    (0.9, 2, butterworth(9.0, 2, 0.01, odd=True), "error"),
]


@pytest.mark.parametrize(("K", "shift", "q", "filtered"), CASES)
def test_maps_and_transposes_are_those_of_matrices(K: float, shift: int, q: Any, filtered: Any) -> None:
    trial = TrialMap(LOOPS, K, shift, q, filtered, SAMPLES)
    rng = np.random.default_rng(0)
    d, e = rng.normal(size=(2, 2, SAMPLES))
    for n, loop in enumerate(LOOPS):
        G, M, B = matrices(loop, K, shift, q, filtered)
        acts = np.diag(trial.acts[n].astype(float))
        R = share(G, M, B, 7)
        expected = (
            (trial.output(d), G),
            (trial.output_transposed(d), G.T),
            (trial.correction(d), B),
            (trial.correction_transposed(d), B.T),
            (trial.step(d), acts @ M @ acts),
            (trial.step_transposed(d), (acts @ M @ acts).T),
            (trial.remaining(d, 7), R),
            (trial.remaining_transposed(d, 7), R.T),
        )
        for number, (ours, matrix) in enumerate(expected):
            np.testing.assert_allclose(ours[n], matrix @ d[n], atol=1e-8 * abs(R).max(), err_msg=str(number))
    both = trial.remaining(d, 7), trial.remaining_transposed(e, 7)
    assert np.sum(both[0] * e) == pytest.approx(np.sum(both[1] * d))


@pytest.mark.parametrize(("K", "shift", "q", "filtered"), CASES)
def test_norms_are_those_of_matrices(K: float, shift: int, q: Any, filtered: Any) -> None:
    trial = TrialMap(LOOPS, K, shift, q, filtered, SAMPLES)
    measured = finite_trial(trial)
    norms, powers, shares, ends = [], [], [], []
    for n, loop in enumerate(LOOPS):
        G, M, B = matrices(loop, K, shift, q, filtered)
        acting = np.diag(trial.acts[n].astype(float)) @ M @ np.diag(trial.acts[n].astype(float))
        norms.append(np.linalg.norm(acting, 2))
        powers.append(max(np.linalg.norm(np.linalg.matrix_power(acting, k), 2) for k in (1, 2, 3, 5, 8)))
        every = [np.linalg.norm(share(G, M, B, k), 2) for k in SHARES]
        shares.append(max(every))
        ends.append(every[-1])
    ours = (measured.norm, measured.power, measured.share, measured.remains)
    exact = (max(norms), max(powers), max(shares), max(ends))
    for estimate, norm in zip(ours, exact, strict=True):  # from below, and close
        assert 0.97 * norm <= estimate <= norm * (1 + 1e-9)


def test_the_odd_reflection_makes_a_map_grow_first_whose_radius_is_below_one() -> None:
    """The same filter by its even reflection doesn't, and what remains in the end is less."""
    odd, even = (
        finite_trial(TrialMap(LOOPS[1:], 0.6, 2, butterworth(2.0, 2, 0.01, odd=odd), "signal", SAMPLES))
        for odd in (True, False)
    )
    radius = growth(TrialMap(LOOPS[1:], 0.6, 2, butterworth(2.0, 2, 0.01, odd=True), "signal", SAMPLES))
    assert radius.max() < 1
    assert odd.norm > 1.5 and even.norm < 1.02
    assert odd.share > 1.2 * even.share


def test_norm_optimal_learning_leaves_of_its_own_plant_less_each_trial() -> None:
    G = matrices(LOOPS[0], 0.0, 1, None, "error")[0]
    L = np.linalg.solve(G.T @ G + 0.01 * np.eye(SAMPLES), G.T)
    trial = TrialMap(LOOPS[:1], 0.0, 1, None, "error", SAMPLES, L)
    d = np.random.default_rng(0).normal(size=(1, SAMPLES))
    d[0, 0] = 0.0  # no input reaches it
    R = np.linalg.matrix_power(np.eye(SAMPLES) - G @ L, 5)
    np.testing.assert_allclose(trial.remaining(d, 5)[0], R @ d[0], atol=1e-9)
    assert finite_trial(trial).share == pytest.approx(1.0, abs=1e-6)
