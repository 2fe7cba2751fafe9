"""Static and dynamic feedforward: (41), perfect tracking to rounding, no phase where zeros forbid that."""

from __future__ import annotations

import numpy as np
import pytest
from design_plants import START, Q, R, drive_train, mandra

from cogless.design.trials.feedforward import (
    Feedforward,
    cancellable,
    dynamic,
    polynomials,
    static_gain,
    zeros,
)
from cogless.design.trials.model import DesignError, Model, Real
from cogless.design.trials.state_feedback import guaranteed_cost

K_MANDRA = np.array([-99.4484, -0.9270])


def tracked(model: Model, C: Real, K_1: Real, feedforward: Feedforward, y_ref: Real) -> Real:
    """y of the closed loop that f drives; y_ref is zero before and constant after."""
    samples, f, y, x = len(y_ref), np.zeros(len(y_ref)), np.zeros(len(y_ref)), np.zeros(model.order)
    for p in range(samples):
        ahead = [p + feedforward.preview - i for i in range(len(feedforward.num))]
        values = [y_ref[min(q, samples - 1)] if q >= 0 else 0.0 for q in ahead]
        f[p] = feedforward.num @ values
        f[p] -= sum(c * f[p - i] for i, c in enumerate(feedforward.den) if 0 < i <= p)
        y[p] = C @ x
        x = model.A @ x + model.B[:, 0] * (K_1 @ x + f[p])
    return y


def smooth(samples: int, rest: int) -> Real:
    y_ref = np.zeros(samples)
    y_ref[rest:-rest] = np.sin(np.linspace(0, 4 * np.pi, samples - 2 * rest)) ** 3
    return y_ref


def response(model: Model, C: Real, K_1: Real, feedforward: Feedforward, w: Real) -> np.ndarray:
    """From y_ref to y."""
    z = np.exp(1j * w)
    A = model.A + model.B @ K_1[None, :]
    G = np.array([C @ np.linalg.solve(x * np.eye(len(A)) - A, model.B[:, 0]) for x in z])
    f = np.polyval(feedforward.num[::-1], 1 / z) / np.polyval(feedforward.den[::-1], 1 / z)
    return np.asarray(G * f * z**feedforward.preview)


def test_mandra_printed_digits() -> None:
    plant = mandra()
    N = static_gain(plant.nominal, plant.C, K_MANDRA)
    assert pytest.approx(99.4484, abs=5e-5) == N
    assert pytest.approx(0.01005547, abs=5e-9) == 1 / N
    found = dynamic(plant.nominal, plant.C, K_MANDRA)
    b = 1 / found.num[0]
    assert round(b, 4) == 0.0028
    assert np.round(found.num * b, 4).tolist() == [1, -0.9564, 0.2352]
    assert found.den.tolist() == [1]
    assert (found.preview, found.method) == (2, "perfect tracking")
    assert float(found.num.sum()) == pytest.approx(N, rel=1e-12)


def test_perfect_tracking_to_rounding() -> None:
    plant = mandra()
    y_ref = smooth(400, 10)
    found = dynamic(plant.nominal, plant.C, K_MANDRA)
    y = tracked(plant.nominal, plant.C, K_MANDRA, found, y_ref)
    assert np.abs(y - y_ref).max() < 1e-13


@pytest.mark.parametrize("zero", [-0.5, 0.6, 0.98, -0.89])
def test_perfect_tracking_with_a_zero_inside(zero: float) -> None:
    # (z - zero) / (z^2 - 0.9 z + 0.2), in controllable form
    model = Model(np.array([[0.9, -0.2], [1.0, 0.0]]), np.array([[2.0], [0.0]]))
    C, K_1 = np.array([1.0, -zero]), np.array([-0.1, 0.02])
    found = dynamic(model, C, K_1)
    assert (found.method, found.preview) == ("perfect tracking", 1)
    np.testing.assert_allclose(found.den, [1, -zero], atol=1e-12)
    y_ref = smooth(300, 10)
    assert np.abs(tracked(model, C, K_1, found, y_ref) - y_ref).max() < 1e-11


@pytest.mark.parametrize("zero", [-1.7, -1.0, -0.95, 1.3, -0.999])
def test_zero_phase_where_a_zero_cannot_be_cancelled(zero: float) -> None:
    model = Model(np.array([[0.9, -0.2], [1.0, 0.0]]), np.array([[2.0], [0.0]]))
    C, K_1 = np.array([1.0, -zero]), np.array([-0.1, 0.02])
    found = dynamic(model, C, K_1)
    assert (found.method, found.preview) == ("zero-phase error tracking", 2)
    assert found.kept_zeros == pytest.approx([zero])
    w = np.linspace(1e-3, np.pi, 200)
    whole = response(model, C, K_1, found, w)
    expected = np.abs(1 - zero * np.exp(-1j * w)) ** 2 / (1 - zero) ** 2
    np.testing.assert_allclose(whole, expected, rtol=1e-7, atol=1e-9)  # real: no phase
    assert response(model, C, K_1, found, np.array([0.0]))[0] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("plant", [mandra("exact"), drive_train("exact"), drive_train("euler")])
def test_sampling_zeros_leave_no_phase(plant: object) -> None:
    model, C = plant.nominal, plant.C
    n = model.order
    weight = np.diag([1e4, 1.0, 1e2, 0.1][:n])
    K_1 = guaranteed_cost(plant, weight, 1.0, np.eye(n)[0], False).K_s
    found = dynamic(model, C, K_1)
    assert found.method == "zero-phase error tracking"
    assert not any(cancellable(z) for z in found.kept_zeros)
    assert np.all(np.abs(np.roots(found.den)) <= 0.99)
    w = np.linspace(1e-3, np.pi, 100)
    whole = response(model, C, K_1, found, w)
    assert np.abs(whole.imag).max() < 1e-6 * np.abs(whole).max()
    y_ref = smooth(600, 20)
    # accurate to second order in frequency
    assert np.abs(tracked(model, C, K_1, found, y_ref) - y_ref).max() < 3e-3


def test_which_zeros_are_cancelled() -> None:
    assert [cancellable(z) for z in (0.98, 0.9999, -0.89, -0.95, 1.0, -1.2, 0.9j, 0.995j)] == [
        True, True, True, False, False, False, True, False,
    ]  # fmt: skip


@pytest.mark.parametrize("zero", [0.9909, 0.9945, 0.9999])
def test_a_slow_zero_is_tracked_and_not_blown_up(zero: float) -> None:
    """A drive train with a lossy shaft has one; left uncancelled it would amplify a million times."""
    model = Model(np.array([[0.9, -0.2], [1.0, 0.0]]), np.array([[2.0], [0.0]]))
    C, K_1 = np.array([1.0, -zero]), np.array([-0.1, 0.02])
    found = dynamic(model, C, K_1)
    y_ref = smooth(300, 10)
    assert np.abs(tracked(model, C, K_1, found, y_ref) - y_ref).max() < 1e-9
    assert np.abs(found.num).max() < 10


def test_a_zero_next_to_one_but_outside_is_refused() -> None:
    model = Model(np.array([[0.9, -0.2], [1.0, 0.0]]), np.array([[2.0], [0.0]]))
    with pytest.raises(DesignError) as error:
        dynamic(model, np.array([1.0, -1.005]), np.array([-0.1, 0.02]))
    assert str(error.value) == (
        "feedforward: expected false: the zero at z = 1.005 can't be cancelled, and an uncancelled zero "
        "makes the feedforward amplify up to 1.61e+05 times"
    )


def test_polynomials() -> None:
    rng = np.random.default_rng(0)
    model, C = Model(rng.normal(size=(4, 4)), rng.normal(size=(4, 1))), rng.normal(size=4)
    a, b = polynomials(model, C)
    z = np.exp(0.7j)
    expected = C @ np.linalg.solve(z * np.eye(4) - model.A, model.B[:, 0])
    assert np.polyval(b, z) / np.polyval(a, z) == pytest.approx(expected, rel=1e-10)
    assert len(zeros(model, C)) == 3


@pytest.mark.parametrize("seed", range(3))
def test_delays_are_zeros_at_exactly_zero(seed: int) -> None:
    """Whatever the coordinates of the state round to."""
    T = np.linalg.qr(np.random.default_rng(seed).normal(size=(5, 5)))[0]
    A = np.diag([0.5, 0.3, 0.2, 0.0, 0.0])
    A[3, 4] = 1.0  # a delay of two samples, which the output does not show
    model = Model(T @ A @ T.T, T @ np.array([[1.0], [1.0], [1.0], [0.0], [1.0]]))
    found = zeros(model, T @ np.array([1.0, 2.0, 3.0, 0.0, 0.0]))
    assert np.count_nonzero(found == 0.0) == 2 and len(found) == 4


def test_errors() -> None:
    blocked = Model(np.array([[0.5, 0.0], [1.0, 0.0]]), np.array([[1.0], [0.0]]))
    with pytest.raises(DesignError) as error:
        static_gain(blocked, np.array([1.0, -1.0]), np.zeros(2))
    assert str(error.value) == (
        "static_gain: expected a plant with a gain at zero frequency; its zero at z = 1 leaves none"
    )
    with pytest.raises(DesignError, match=r"^feedforward: expected a plant without a zero at z = 1$"):
        dynamic(blocked, np.array([1.0, -1.0]), np.zeros(2))
    plant = mandra()
    with pytest.raises(DesignError) as error:
        static_gain(plant.nominal, plant.C, np.zeros(2))
    assert str(error.value) == (
        "static_gain: expected a closed loop without a pole at z = 1 when the integrator is off; its "
        "gain at zero "
        "frequency isn't finite"
    )
    assert error.value.key == "static_gain"


def test_feedforward_of_the_paper_gains_is_that_of_ours() -> None:
    plant = mandra()
    K = guaranteed_cost(plant, Q, R, START, True).K_s[:2]
    found = dynamic(plant.nominal, plant.C, K)
    assert np.round(found.num / found.num[0], 4).tolist() == [1, -0.9564, 0.2352]
