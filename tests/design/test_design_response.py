"""|F| of lightly damped loops against dense sweeps, gains of both signs, growth against lifted updates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from reference.trial import zero_phase

from cogless.design.trials.certificate import Certificate, Gains, Update, certify
from cogless.design.trials.gains import impulse_response
from cogless.design.trials.model import Real
from cogless.design.trials.polytope import from_vertices
from cogless.design.trials.response import (
    Bundle,
    Filter,
    Filtered,
    Loop,
    TrialMap,
    best_gain,
    butterworth,
    direction,
    factor,
    gain_limits,
    growth,
    peak,
)

AT_REST = Gains(np.zeros(3), 0.0, 1.0, False, False)


def flexible(damping: float, angle: float, size: float) -> Loop:
    """A first-order lag, and a mode whose peak doesn't depend on its damping."""
    A = np.zeros((3, 3))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    A[0, 0], A[1:, 1:] = 0.6, np.exp(-damping * angle) * turn
    return Loop(A, np.array([[0.4], [0.0], [1.0]]), np.array([1.0, size * damping * angle, 0.0]))


def densely(loop: Loop, K: float, angle: float, damping: float) -> float:
    w = np.append(np.linspace(0, np.pi, 20001), angle * (1 + damping * np.linspace(-20, 20, 40001)))
    return float(factor(Bundle([loop], 1)(w), K).max())


def of(loop: Loop, K: float) -> Certificate:
    plant = from_vertices([(loop.A, loop.B)], loop.C, 1e-3)
    return certify(plant, AT_REST, Update(1, K), None, "error", 300)


@pytest.mark.parametrize("damping", [1e-2, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("size", [-12.0, 4.0])
@pytest.mark.parametrize("angle", [0.61234, 2.5])
def test_a_lightly_damped_mode_is_not_missed(damping: float, size: float, angle: float) -> None:
    loop, K = flexible(damping, angle, size), 0.2
    found = of(loop, K).design.without_filter
    dense = densely(loop, K, angle, damping)
    assert found is not None and found.K_3_limit is not None
    assert found.norm == pytest.approx(dense, rel=1e-6)
    assert found.monotone == (dense <= 1 + 1e-9)
    assert not (found.contracting and dense >= 1)
    if found.K_3_limit > 1e-3:
        assert densely(loop, 0.999 * found.K_3_limit, angle, damping) <= 1 + 1e-9
        assert densely(loop, 1.001 * found.K_3_limit, angle, damping) > 1


def test_a_peak_between_the_points_of_the_grid() -> None:
    def hill(w: Real, models: object) -> Real:
        return -((w[None, :] - 0.1234) ** 2)

    w = np.linspace(0, 1, 11)
    assert peak(hill, w, hill(w, [0]))[0] == pytest.approx(0.0, abs=1e-9)


def test_the_lower_of_two_maxima_on_the_grid_may_be_the_higher() -> None:
    def hills(w: Real, models: object) -> Real:
        return (np.exp(-((w - 0.3) ** 2) / 0.02) + 1.2 * np.exp(-((w - 0.77) ** 2) / 0.002))[None, :]

    w = np.linspace(0, 1, 11)
    value, at, _ = peak(hills, w, hills(w, [0]))
    assert (value, at) == pytest.approx((1.2, 0.77), abs=1e-4)


def test_best_gain_sees_a_narrow_mode() -> None:
    loop = flexible(1e-4, 0.61234, 12.0)
    bundle = Bundle([loop], 1)
    K, worst = best_gain(bundle(bundle.grid))
    assert worst == pytest.approx(densely(loop, K, 0.61234, 1e-4), rel=1e-3)


def test_gains_of_a_plant_that_acts_the_other_way() -> None:
    loop = flexible(0.2, 0.6, 1.0)
    turned = Loop(loop.A, -loop.B, loop.C)
    w = Bundle([loop], 1).grid
    G, other = (Bundle([which], 1)(w) for which in (loop, turned))
    assert (direction(G), direction(other)) == (1.0, -1.0)
    assert direction(np.array([[0.0, -1.0 + 0.5j, -2.0]])) == 1.0  # zero at rest
    assert best_gain(other) == pytest.approx((-best_gain(G)[0], best_gain(G)[1]))
    ours, theirs = (of(which, K).design.without_filter for which, K in ((loop, 0.3), (turned, -0.3)))
    assert ours is not None and theirs is not None
    assert ours.K_3_limit is not None and theirs.K_3_limit is not None
    assert (theirs.norm, theirs.K_3_limit) == pytest.approx((ours.norm, -ours.K_3_limit))
    assert gain_limits(G).min() == pytest.approx(ours.K_3_limit, rel=1e-3)


def update(loop: Loop, K: float, shift: int, q: Filter | None, filtered: Filtered, samples: int) -> Real:
    """From v to v after a trial."""
    G, seen, ahead = parts(loop, shift, samples)
    Q = np.eye(samples) if q is None else zero_phase(q.b, q.a, np.eye(samples), q.odd)
    if filtered == "error":
        return np.asarray(np.eye(samples) - K * ahead @ Q @ seen @ G)
    return np.asarray(Q @ (np.eye(samples) - K * ahead @ seen @ G))


def parts(loop: Loop, shift: int, samples: int) -> tuple[Real, Real, Real]:
    """From v to y, what of the error counts, and the shift."""
    G = scipy.linalg.toeplitz(impulse_response(loop, samples), np.zeros(samples))
    seen = np.diag((np.arange(samples) >= shift).astype(float))
    return G, seen, np.eye(samples)[np.minimum(np.arange(samples) + shift, samples - 1)]


@pytest.mark.parametrize("pole", [0.5, 0.8])
@pytest.mark.parametrize("samples", [60, 120])
@pytest.mark.parametrize("shift", [1, 2, 3])
@pytest.mark.parametrize(("odd", "error"), [(True, 0.03), (False, 0.05)])
def test_growth_is_the_lifted_update_s_radius(
    pole: float, samples: int, shift: int, odd: bool, error: float
) -> None:
    """With the even reflection the map is further from a normal one: forty trials show a little more."""
    loop = Loop(np.array([[pole]]), np.array([[1 - pole]]), np.ones(1))
    K, q = 0.9, replace(butterworth(20.0, 2, 0.01), odd=odd)
    measured = growth(TrialMap([loop], K, shift, q, "signal", samples))[0]
    M = update(loop, K, shift, q, "signal", samples)
    assert measured == pytest.approx(np.abs(np.linalg.eigvals(M)).max(), rel=error)


@pytest.mark.parametrize("pole", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("K", [0.92, 1.16])
@pytest.mark.parametrize("q", [None, butterworth(20.0, 2, 0.01)])
def test_growth_where_the_last_samples_act_on_nothing(pole: float, K: float, q: Filter | None) -> None:
    loop = Loop(np.array([[pole]]), np.array([[1 - pole]]), np.ones(1))
    measured = growth(TrialMap([loop], K, 1, q, "error", 200))[0]
    M = update(loop, K, 1, q, "error", 200)[:-1, :-1]
    radius = np.abs(np.linalg.eigvals(M)).max()
    if q is None:  # a triangle: its radius comes late, the largest |F| first
        norm = factor(Bundle([loop], 1)(np.linspace(0, np.pi, 999)), K).max()
        assert radius == pytest.approx(abs(1 - K * (1 - pole)), rel=1e-6)
        assert radius < measured < norm
    else:  # above the cutoff the error stays
        assert measured == pytest.approx(radius, rel=5e-3)
        assert measured <= 1 + 1e-6


@pytest.mark.parametrize("filtered", ["error", "signal"])
@pytest.mark.parametrize("shift", [1, 2, 4])
def test_growth_is_that_of_matrices(filtered: Filtered, shift: int) -> None:
    loop, samples = Loop(np.array([[0.8]]), np.array([[0.2]]), np.ones(1)), 40
    q = butterworth(8.0, 1, 0.01)
    M, (G, seen, _) = update(loop, 0.9, shift, q, filtered, samples), parts(loop, shift, samples)
    v = np.random.default_rng(0).normal(size=samples)
    sizes = []
    for _ in range(80):
        sizes.append(np.linalg.norm(seen @ G @ v))
        v = M @ v
    measured = growth(TrialMap([loop], 0.9, shift, q, filtered, samples))[0]
    assert measured == pytest.approx((sizes[79] / sizes[39]) ** (1 / 40), rel=2e-6)


def test_without_a_filter_its_gain_is_one_and_it_acts_on_the_error() -> None:
    G = np.array([[0.5 + 0.1j, 1.0 - 0.3j]])
    assert np.array_equal(gain_limits(G), gain_limits(G, 1.0, "error"))
    assert best_gain(G) == best_gain(G, np.ones(2))
    assert np.array_equal(factor(G, 0.7), np.abs(1 - 0.7 * G))
    assert np.array_equal(factor(G, 0.7, 0.5), np.abs(1 - 0.7 * G * 0.5))
