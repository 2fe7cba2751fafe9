"""Guaranteed-cost feedback: Mandra 2019's gains, Riccati's where nothing is uncertain, false optima."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
import scipy.linalg
from design_plants import START, Q, R, drive_train, mandra, motor

from cogless.design.trials import state_feedback
from cogless.design.trials.model import DesignError, Model, Real
from cogless.design.trials.polytope import UncertainPlant, from_parameters, from_vertices
from cogless.design.trials.state_feedback import (
    augmented,
    check,
    guaranteed_cost,
    riccati_scaling,
    stabilise,
    with_integrator,
)


def scalar(low: float, high: float) -> UncertainPlant:
    """x(p+1) = 2 x + b u."""
    return from_vertices([([[2.0]], [[low]]), ([[2.0]], [[high]])], [1], 1.0)


def test_mandra_gains() -> None:
    found = guaranteed_cost(mandra(), Q, R, START, True)
    assert np.all(np.abs(found.K_s - [-99.4484, -0.9270, 1.3916]) <= [0.02, 0.0005, 0.0005])
    assert found.check.passed
    assert found.check.cost <= found.check.bound * (1 + 1e-9)


@pytest.mark.parametrize("integral", [True, False])
def test_one_vertex_is_riccati(integral: bool) -> None:
    plant = from_parameters(
        motor,
        {"inertia": (8e-4, 8e-4), "friction": (1e-3, 1e-3), "torque_constant": (0.37, 0.37)},
        [1, 0],
        2.5e-3,
    )
    size = 2 + integral
    model = with_integrator(plant, integral)[0]
    X = scipy.linalg.solve_discrete_are(model.A, model.B, Q[:size, :size], [[R]])
    K = -np.linalg.solve(R + model.B.T @ X @ model.B, model.B.T @ X @ model.A)[0]
    found = guaranteed_cost(plant, Q[:size, :size], R, START[:size], integral)
    # in the cost's own measure: a gain this far off costs nothing that can be seen
    assert found.check.bound == pytest.approx(START[:size] @ X @ START[:size], rel=1e-6)
    np.testing.assert_allclose(found.K_s, K, rtol=2e-3)


def test_cost_of_any_plant_in_the_polytope_is_below_the_bound() -> None:
    plant = mandra()
    found = guaranteed_cost(plant, Q, R, START, True)
    worst = 0.0
    for model in plant.random[0][30:90]:
        whole, x, cost = augmented(model, plant.C), START, 0.0
        for _ in range(1500):
            u = found.K_s @ x
            cost += x @ Q @ x + R * u * u
            x = whole.A @ x + whole.B[:, 0] * u
        worst = max(worst, cost)
    assert 0.9 * found.check.bound < worst <= found.check.bound


def test_units_of_the_states_do_not_matter() -> None:
    plant = mandra()
    D = np.diag([1e3, 1e-2])  # mrad and 100 rad/s
    other = from_vertices(
        [(D @ m.A @ np.linalg.inv(D), D @ m.B) for m in plant.vertices], plant.C @ np.linalg.inv(D), 2.5e-3
    )
    S = np.diag([1e-3, 1e2, 1.0])  # psi keeps its unit, since y does
    expected = guaranteed_cost(plant, Q, R, START, True)
    found = guaranteed_cost(other, S @ Q @ S, R, np.linalg.solve(S, START), True)
    assert found.check.bound == pytest.approx(expected.check.bound, rel=1e-6)
    np.testing.assert_allclose(found.K_s @ np.linalg.inv(S), expected.K_s, rtol=1e-3)


def test_order_four() -> None:
    plant = drive_train("euler")
    weight, start = np.diag([1e4, 1.0, 1e2, 0.1, 1.0]), np.array([0.01, 0, 0.01, 0, 0])
    found = guaranteed_cost(plant, weight, 1.0, start, True)
    assert found.check.passed
    for model in [*with_integrator(plant, True), *(augmented(m, plant.C) for m in plant.random[0])]:
        assert np.abs(np.linalg.eigvals(model.A + model.B @ found.K_s[None, :])).max() < 1


def unscaled() -> tuple[str, Real, Real, float]:
    """(9) to (13) in the paper's own units, Y >= 1e-10 I: the solver's status, K, Y, beta."""
    Y, W, beta = cp.Variable((3, 3), symmetric=True), cp.Variable((1, 3)), cp.Variable((1, 1))
    zero, column = np.zeros((3, 3)), np.zeros((3, 1))
    constraints = [Y >> 1e-10 * np.eye(3), cp.bmat([[beta, START[None, :]], [START[:, None], Y]]) >> 0]
    for model in with_integrator(mandra(), True):
        closed = model.A @ Y + model.B @ W
        constraints.append(
            cp.bmat(
                [
                    [Y, closed.T, Y, W.T],
                    [closed, Y, zero, column],
                    [Y, zero, np.linalg.inv(Q), column],
                    [W, column.T, column.T, np.eye(1) / R],
                ]
            )
            >> 0
        )
    problem = cp.Problem(cp.Minimize(beta[0, 0]), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.solve(solver="CLARABEL")
    return problem.status, np.linalg.solve(Y.value, W.value[0]), Y.value, float(beta.value[0, 0])


def test_false_optimum_of_the_unscaled_problem_is_refused() -> None:
    status, K, Y, bound = unscaled()
    assert status in ("optimal", "optimal_inaccurate")
    assert K[0] > -90  # far from -99.4
    plant = mandra()
    T = riccati_scaling(augmented(plant.nominal, plant.C), Q, R)
    assert T is not None
    models = with_integrator(plant, True)
    refused = check(models, Q, R, START, K, Y, T, bound)
    assert not refused.passed
    assert refused.smallest < -1e-2  # an inequality is broken
    assert refused.cost > 1.1 * bound  # and a vertex costs more than was promised


def test_true_optimum_passes_the_same_check_only_with_its_own_bound() -> None:
    plant = mandra()
    found = guaranteed_cost(plant, Q, R, START, True)
    T = riccati_scaling(augmented(plant.nominal, plant.C), Q, R)
    assert T is not None
    models = with_integrator(plant, True)
    P = scipy.linalg.solve_discrete_lyapunov(
        (models[0].A + models[0].B @ found.K_s[None, :]).T, Q + R * np.outer(found.K_s, found.K_s)
    )
    assert not check(models, Q, R, START, found.K_s, np.linalg.inv(P), T, 0.9 * found.check.bound).passed


def test_infeasible_ranges_say_how_far_to_shrink_them() -> None:
    # |2 + b K| < 1 at both ends needs high / low < 3: (0.55 + 0.45 s) / (0.55 - 0.45 s) < 3 for s < 0.611
    with pytest.raises(DesignError) as error:
        guaranteed_cost(scalar(0.1, 1.0), np.eye(1), 1.0, np.ones(1), False)
    message, _, share = str(error.value).removesuffix(" of their width").rpartition(" to ")
    assert message == (
        "range: expected ranges that one gain and one Lyapunov matrix can control; no gain controls "
        "both vertex 1 and vertex 2; one gain controls the ranges if they are shrunk"
    )
    assert share in ("59 %", "60 %", "61 %")
    assert error.value.key == "range"


def test_feasible_ranges_close_to_the_limit() -> None:
    found = guaranteed_cost(scalar(0.4, 1.0), np.eye(1), 1.0, np.ones(1), False)
    assert all(abs(2 + b * found.K_s[0]) < 1 for b in (0.4, 1.0))


def test_uncontrollable_plant_names_vertex_and_mode() -> None:
    ranges = {"inertia": (6e-4, 8e-4), "friction": (1e-3, 1e-3), "torque_constant": (0.3, 0.3)}

    def idle(p: object) -> tuple[list[list[float]], list[list[float]]]:
        A, B = motor(p)
        return [[*A[0], 0.0], [*A[1], 0.0], [0.0, 0.0, 0.0]], [*B, [0.0]]

    plant = from_parameters(idle, ranges, [1, 0, 0], 1e-3)
    with pytest.raises(DesignError) as error:
        guaranteed_cost(plant, np.eye(3), 1.0, np.ones(3), False)
    assert str(error.value) == (
        "vertex: expected a controllable plant; at inertia = 0.0006, friction = 0.001, "
        "torque_constant = 0.3 the input "
        "can't move the mode at z = 1"
    )


def test_integral_action_needs_a_gain_at_rest() -> None:
    # y is a speed, x_2 its integral's derivative: a zero at z = 1
    plant = from_vertices([([[0.5, 0], [1, 0]], [[1], [0]])], [1, -1], 1.0)
    with pytest.raises(DesignError) as error:
        guaranteed_cost(plant, np.eye(3), 1.0, np.ones(3), True)
    assert str(error.value) == (
        "vertex: expected a plant that integral action can control: at vertex 1 the input can't move "
        "the mode at z = 1 "
        "(no gain at zero frequency)"
    )


@pytest.mark.parametrize(
    ("weight", "effort", "start", "key", "message"),
    [
        (np.diag([1.0, 0.0, 1.0]), 1.0, np.ones(3), "state_weight",
            "state_weight: expected a symmetric matrix that is positive definite"),
        (np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]]), 1.0, np.ones(3), "state_weight",
            "state_weight: expected a symmetric matrix that is positive definite"),
        (np.eye(3), 0.0, np.ones(3), "input_weight", "input_weight: 0: expected a number above zero"),
        (np.eye(3), 1.0, np.full(3, np.nan), "initial_state", "initial_state: expected 3 finite numbers"),
        (np.eye(3), 1.0, np.zeros(3), "initial_state", "initial_state: expected a state that is not zero"),
    ],
)  # fmt: skip
def test_errors(weight: Real, effort: float, start: Real, key: str, message: str) -> None:
    with pytest.raises(DesignError) as error:
        guaranteed_cost(mandra(), weight, effort, start, True)
    assert str(error.value) == message
    assert error.value.key == key


def test_augmented_is_the_papers() -> None:
    whole = augmented(Model(np.array([[1.0, 2], [3, 4]]), np.array([[5.0], [6]])), np.array([7.0, 8]))
    assert whole.A.tolist() == [[1, 2, 0], [3, 4, 0], [-7, -8, 1]]
    assert whole.B.tolist() == [[5], [6], [0]]


def axis(p: Mapping[str, float]) -> tuple[list[list[float]], list[list[float]]]:
    """Angle and speed, without a torque constant of its own."""
    return motor({**p, "torque_constant": 0.3})


@pytest.mark.parametrize("inertia", [1e-2, 1e-1])
def test_ranges_so_wide_that_the_riccati_scaling_fails(inertia: float) -> None:
    plant = from_parameters(axis, {"inertia": (1e-4, inertia), "friction": (1e-3, 2e-3)}, [1, 0], 2e-3)
    weight, start = np.diag([1e4, 0.1, 2.0]), np.array([0.01, 0.0, 0.0])
    found = guaranteed_cost(plant, weight, 1.0, start, True)
    assert found.check.passed
    for model in [*with_integrator(plant, True), *(augmented(m, plant.C) for m in plant.random[0])]:
        assert np.abs(np.linalg.eigvals(model.A + model.B @ found.K_s[None, :])).max() < 1


def test_an_input_that_costs_nothing() -> None:
    plant = from_parameters(lambda p: ([[p["a"]]], [-2.0]), {"a": (0.5, 1.5)}, [1.0], 0.05)
    found = guaranteed_cost(plant, np.eye(2), 1e-12, np.array([1.0, 0.0]), True)
    assert found.check.passed


def four_parameters(p: Mapping[str, float]) -> tuple[list[list[float]], list[float]]:
    J, L, k = p["motor"], p["load"], p["stiffness"]
    A = [
        [0, 1, 0, 0],
        [-k / J, -0.02 / J, k / J, 0.02 / J],
        [0, 0, 0, 1],
        [k / L, 0.02 / L, -k / L, -0.02 / L],
    ]
    return A, [0, p["torque_constant"] / J, 0, 0]


def test_infeasible_ranges_of_four_parameters_are_told_soon() -> None:
    ranges = {
        "motor": (1e-4, 9e-3), "load": (1e-4, 9e-3), "stiffness": (1, 300), "torque_constant": (0.01, 0.9)
    }  # fmt: skip
    plant = from_parameters(four_parameters, ranges, [1, 0, 0, 0], 2e-3)
    begin = time.process_time()
    with pytest.raises(
        DesignError, match="one gain controls the ranges if they are shrunk to 1 % of their width"
    ):
        guaranteed_cost(plant, np.eye(5), 1.0, np.eye(5)[0], True)
    assert time.process_time() - begin < 4.0


@pytest.mark.parametrize(("low", "feasible"), [(0.32, False), (0.3334, True), (0.34, True)])
def test_stabilise_where_one_gain_is_just_enough(low: float, feasible: bool) -> None:
    # |2 + b K| < 1 at both ends needs high / low < 3
    common = stabilise(scalar(low, 1.0).vertices, np.eye(1))
    assert (common is not None) == feasible
    if common is not None:
        assert all(abs(2 + b * common.K[0]) < 1 for b in (low, 1.0))


def test_check_refuses_a_cost_above_the_bound_that_its_inequalities_are_too_coarse_for() -> None:
    # (10) is measured beside Y; in large units of the state it sees nothing of a bound that is too low
    model = Model(np.array([[0.5]]), np.ones((1, 1)))
    Y, bound = np.array([[1 / (1 + 1 / 3)]]), 4 / 3  # P = Q / (1 - 1/4) with K = 0 and R of no matter
    true = check([model], np.eye(1), 1.0, np.ones(1), np.zeros(1), Y, np.eye(1), bound)
    assert true.cost == pytest.approx(bound)
    assert true.passed
    low = check([model], np.eye(1), 1.0, np.ones(1), np.zeros(1), Y, np.eye(1) * 1e-6, 0.9 * bound)
    assert low.smallest >= -1e-7
    assert low.cost > low.bound
    assert not low.passed


def test_check_refuses_an_inequality_that_the_cost_says_nothing_of() -> None:
    model = Model(np.array([[0.5]]), np.ones((1, 1)))
    found = check([model], np.eye(1), 1.0, np.ones(1), np.zeros(1), np.array([[2.0]]), np.eye(1), 1e3)
    assert found.cost < found.bound
    assert found.smallest < -1e-3
    assert not found.passed


def test_a_solver_that_fails_is_not_called_an_infeasible_range(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cogless.design.trials.state_feedback.solve_scaled", lambda *_: (None, None))
    with pytest.raises(DesignError) as error:
        guaranteed_cost(mandra(), Q, R, START, True)
    assert str(error.value).startswith("state_weight: expected other weights")


T = 1e-3


@pytest.mark.parametrize(
    ("mode", "integral", "told"),
    [
        (0.5 + 0j, True, "the mode at z = 0.5"),
        (1.0 + 0j, False, "the mode at z = 1"),
        (0.25 - 0.5j, True, "the mode at z = 0.25-0.5j"),
        (1 + 0.9e-5j, True, "(no gain at zero frequency)"),
        (1 + 1.1e-5j, True, "the mode at z = 1+1.1e-05j"),
    ],
)
def test_a_mode_that_the_input_cant_move_is_named(mode: complex, integral: bool, told: str) -> None:
    assert state_feedback._uncontrollable("vertex 2", mode, integral).endswith(told)


@pytest.mark.parametrize(("most", "share"), [(0.37, 0.35), (0.999, 0.98), (0.01, 0.0), (0.5, 0.5)])
def test_the_share_of_a_range_that_one_gain_holds_is_found_in_six_halvings(
    monkeypatch: pytest.MonkeyPatch, most: float, share: float
) -> None:
    """It is a number of 64ths, rounded down to a hundredth."""
    monkeypatch.setattr(state_feedback, "with_integrator", lambda share, integral: share)
    monkeypatch.setattr(state_feedback, "stabilise", lambda share, T: T if share <= most else None)
    plant: Any = SimpleNamespace(shrunk=lambda share: share)
    assert state_feedback._feasible_share(plant, np.eye(1), True) == share


def test_only_the_five_pairs_furthest_apart_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Distances are in units of each entry's spread, so that large entries do not decide alone."""
    models = [
        Model(np.array([[a]]), np.array([[b]])) for a, b in ((0, 0), (1, 0), (0, 1e6), (1, 1e6), (0.5, 5e5))
    ]
    tried: list[tuple[int, int]] = []
    places = {id(model): n for n, model in enumerate(models)}

    def stabilise(pair: list[Model], T: Any) -> int | None:
        tried.append((places[id(pair[0])], places[id(pair[1])]))
        return None if tried[-1] == hopeless else 1

    monkeypatch.setattr(state_feedback, "stabilise", stabilise)
    hopeless: Any = (1, 2)
    assert state_feedback._hopeless_pair(models, np.eye(1)) == (1, 2)
    assert set(tried) <= {(0, 3), (1, 2)}
    hopeless = None
    tried.clear()
    assert state_feedback._hopeless_pair(models, np.eye(1)) is None and len(tried) == 5
