"""K_3 of Mandra 2019 by (32) to (35), its cost in simulation, and what no gain can do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from design_plants import START, Q, R, drive_train, mandra, speed
from scipy.linalg import toeplitz
from scipy.optimize import minimize_scalar, nnls

from cogless.design.trials.certificate import Gains
from cogless.design.trials.feedforward import static_gain
from cogless.design.trials.learning_gain import (
    LearningGain,
    Vertex,
    _impossible,
    check,
    cost,
    learning_gain,
    mapped,
)
from cogless.design.trials.model import DesignError, Model, Real
from cogless.design.trials.polytope import UncertainPlant, from_parameters
from cogless.design.trials.response import Bundle, Loop, best_gain, factor, grid
from cogless.design.trials.state_feedback import guaranteed_cost

K_S = np.array([-99.4484, -0.9270, 1.3916])
G = 0.1
Corner = tuple[float, float]


def loops_of(plant: UncertainPlant, K_s: Real, models: list[Model] | None = None) -> list[Loop]:
    n = plant.order
    law = Gains(K_s[:n], float(K_s[n]), static_gain(plant.nominal, plant.C, K_s[:n]), True, True)
    return [law.closed(m, plant.C) for m in models or [*plant.vertices, plant.nominal]]


@pytest.fixture(scope="module")
def paper() -> LearningGain:
    *loops, nominal = loops_of(mandra(), K_S)
    return learning_gain(loops, nominal, 2, START, G)


def test_mandra_gain(paper: LearningGain) -> None:
    assert pytest.approx(0.6942, abs=1e-3) == paper.K_3
    assert paper.affine
    assert paper.note == ""
    assert len(mapped(loops_of(mandra(), K_S)[:-1], 2)[0]) == 6
    assert paper.check.passed


def test_mandra_gain_with_our_feedback() -> None:
    plant = mandra()
    *loops, nominal = loops_of(plant, guaranteed_cost(plant, Q, R, START, True).K_s)
    assert pytest.approx(0.6942, abs=1e-3) == learning_gain(loops, nominal, 2, START, G).K_3


def test_without_a_change_of_the_start_the_gain_is_the_fastest_by_frequency(paper: LearningGain) -> None:
    """f = 0 leaves beta_2 alone, and that is smallest where the largest |F| is."""
    *loops, nominal = loops_of(mandra(), K_S)
    found = learning_gain(loops, nominal, 2, np.zeros(3), G)
    assert found.check.passed and found.bounds[0] == 0
    assert found.bounds[1] < paper.bounds[1]
    on_circle = Bundle(loops, 2)(np.linspace(0.0, np.pi, 10001))
    best = minimize_scalar(
        lambda K: factor(on_circle, K).max(), bounds=(0.1, 1.1), method="bounded", options={"xatol": 1e-8}
    )
    assert pytest.approx(best.x, abs=1e-5) == found.K_3
    assert found.bounds[1] == pytest.approx(G**2 * best.fun**2 / (1 - best.fun**2), rel=1e-6)


def test_units_of_the_states_do_not_matter(paper: LearningGain) -> None:
    *loops, nominal = loops_of(mandra(), K_S)
    D = np.diag([1e3, 1e-2, 10.0])
    back = np.linalg.inv(D)
    changed = [Loop(D @ loop.A @ back, D @ loop.B, loop.C @ back) for loop in [*loops, nominal]]
    found = learning_gain(changed[:-1], changed[-1], 2, D @ START, G)
    assert pytest.approx(paper.K_3, abs=1e-4) == found.K_3
    assert sum(found.bounds) == pytest.approx(sum(paper.bounds), rel=1e-5)


def test_bound_on_the_error_alone_is_that_of_the_norm(paper: LearningGain) -> None:
    # p e_k^2 - (1 + p) e_{k+1}^2 >= 0 in the sum: max |F|^2 <= p / (1 + p), and beta_2 = p g^2
    *loops, nominal = loops_of(mandra(), K_S)
    bundle = Bundle([*loops, nominal], 2)
    worst = float(factor(bundle(np.linspace(0.0, np.pi, 20001)), paper.K_3).max())
    p = paper.bounds[1] / G**2
    assert worst**2 <= p / (1 + p) * (1 + 1e-9)
    assert worst**2 == pytest.approx(p / (1 + p), rel=1e-3)
    assert best_gain(bundle(grid()))[1] <= worst


def simulated(vertex: Vertex, K_3: float, samples: int) -> tuple[Real, Real]:
    """The error of a trial that starts with f after one without, and the matrix from the last error to it."""
    F, free = np.zeros(samples), np.zeros(samples)
    F[0] = 1 - vertex.Upsilon * K_3
    eta, driven = START, vertex.B[:, 0] * K_3
    for p in range(samples):
        free[p], eta = -float(vertex.Gamma[0] @ eta), vertex.A @ eta
        if p:
            F[p], driven = -float(vertex.Gamma[0] @ driven), vertex.A @ driven
    return free, toeplitz(F, np.zeros(samples))


def test_cost_of_simulated_trials_is_below_the_bound(paper: LearningGain) -> None:
    plant = mandra()
    trials, samples = 40, 300
    for loop in loops_of(plant, K_S, plant.random[0][::8]):
        free, trial = simulated(Vertex.of_loop(loop, 2), paper.K_3, samples)
        e, cost = np.full(samples, G), 0.0
        for _ in range(trials):
            e = free + trial @ e
            cost += float(e @ e)
        # (30) summed: each trial starts with f, each sample of the first with g
        assert cost <= trials * paper.bounds[0] + samples * paper.bounds[1]


def test_phi_is_schur_over_the_polytope(paper: LearningGain) -> None:
    plant = mandra()
    radii = [
        np.abs(np.linalg.eigvals(Vertex.of_loop(loop, 2).phi(paper.K_3))).max()
        for loop in loops_of(plant, K_S, plant.random[0])
    ]
    assert max(radii) < 1


def test_cost_is_that_of_simulated_trials(paper: LearningGain) -> None:
    samples, trials, costs = 500, 300, []
    for loop in loops_of(mandra(), K_S)[:-1]:
        vertex = Vertex.of_loop(loop, 2)
        (free, trial), totals = simulated(vertex, paper.K_3, samples), []
        for g in (G, -G):
            e, total = free + trial[:, 0] * g, 0.0
            for _ in range(trials):
                total += float(e @ e)
                e = trial @ e
            totals.append(total)
        costs.append(max(totals))
        assert cost(vertex, paper.K_3, START, G) == pytest.approx(costs[-1], rel=1e-3)
    assert max(costs) == pytest.approx(paper.check.cost, rel=1e-3)
    assert paper.check.cost < paper.check.bound


def one_state() -> Vertex:
    """F = -(1 - z/2) / (z - 1/2) / 2 with K = 3/4: 1/2 at all frequencies."""
    return Vertex.of_loop(Loop(np.array([[0.5]]), np.ones((1, 1)), np.ones(1)), 1)


def test_check_refuses_what_does_not_hold() -> None:
    *loops, _ = loops_of(mandra(), K_S)
    vertices, _, _ = mapped(loops, 2)
    P = [np.eye(4) for _ in vertices]
    assert not check(vertices, 0.6942, P, np.eye(3), START, G, 1e9).passed
    # unstable from trial to trial
    assert check(vertices, 8.0, P, np.eye(3), START, G, 1e9).cost == np.inf


def test_check_refuses_a_cost_above_the_bound() -> None:
    vertex, f = one_state(), np.zeros(1)
    P = np.diag([4 / 9, 1 / 3])  # (30) with equality
    assert cost(vertex, 0.75, f, 0.2) == pytest.approx(0.04 / 3)
    bounds = (0.9 * 0.04 / 3, 1.1 * 0.04 / 3)
    low, high = (check([vertex], 0.75, [P], np.eye(1), f, 0.2, bound) for bound in bounds)
    assert low.smallest == high.smallest
    assert low.cost == high.cost
    assert (low.passed, high.passed) == (False, True)


def test_check_refuses_a_broken_inequality() -> None:
    found = check([one_state()], 0.75, [np.eye(2) * 1e-3], np.eye(1), np.zeros(1), 0.2, 1e3)
    assert found.cost < found.bound
    assert found.smallest < -1
    assert not found.passed


def test_relative_degree_one() -> None:
    plant = from_parameters(
        speed, {"inertia": (1e-4, 2e-4), "friction": (1e-4, 2e-4), "torque_constant": (0.1, 0.12)}, [1], 1e-3
    )
    K_s = guaranteed_cost(plant, np.diag([1.0, 1e-3]), 1.0, np.array([1.0, 0.0]), True).K_s
    *loops, nominal = loops_of(plant, K_s)
    found = learning_gain(loops, nominal, 1, np.array([0.1, 0.0]), 1.0)
    assert found.affine
    assert found.check.passed
    assert factor(Bundle(loops, 1)(grid()), found.K_3).max() < 1


@pytest.mark.parametrize(
    ("mass", "damping", "change"),
    [
        ((2.0, 3.5), (4.0, 6.0), [0.01, 0.0, 0.0]),  # the solver stalls in the first coordinates
        ((0.2, 0.24), (0.3, 0.45), [0.0, 0.5, 0.01]),
        ((0.02, 0.033), (0.05, 0.08), [0.5, 0.5, 0.0]),
    ],
)
def test_a_gain_is_found_for_axes_of_other_sizes(mass: Corner, damping: Corner, change: list[float]) -> None:
    """Learning is slow, a certificate's Lyapunov matrices are far from those that the scaling expects."""

    def axis(p: Mapping[str, float]) -> tuple[list[list[float]], list[list[float]]]:
        return [[0, 1], [0, -p["damping"] / p["mass"]]], [[0], [0.5 * mass[0] / p["mass"]]]

    plant = from_parameters(axis, {"mass": mass, "damping": damping}, [1, 0], 8e-3, "euler")
    size = 1e4 / 8e-3**2
    K_s = guaranteed_cost(plant, np.diag([size, size * 4e-5, size * 6e-5]), 1.0, START, True).K_s
    *loops, nominal = loops_of(plant, K_s)
    found = learning_gain(loops, nominal, 2, np.array(change), G)
    assert found.check.passed
    everywhere = Bundle(loops_of(plant, K_s, plant.random[0]), 2)(grid())
    assert factor(everywhere, found.K_3).max() < 1


def test_one_state_in_closed_form() -> None:
    # z G = z / (z - 1/2) is a circle through 2 and 2/3: K = 3/4 leaves 1/2 at both, p = 1/3
    loop = Loop(np.array([[0.5]]), np.ones((1, 1)), np.ones(1))
    found = learning_gain([loop], loop, 1, np.zeros(1), 0.2)
    assert pytest.approx(0.75, abs=1e-4) == found.K_3
    assert found.bounds[1] == pytest.approx(0.2**2 / 3, rel=1e-6)


def bent_loops() -> list[Loop]:
    """Relative degree two with an uncertain entry that C A^2 has squared."""
    loops = []
    for a in (0.0, 0.3):
        A = np.array([[a, 1.0], [0.0, a]])
        loops.append(Loop(A, np.array([[0.0], [0.7]]), np.array([1.0, 0.0])))
    return loops


def test_a_set_that_bends_gets_a_bounding_polytope() -> None:
    loops = bent_loops()
    vertices, affine, note = mapped(loops, 2)
    assert not affine
    assert "are outside the hull of its corners, by up to" in note
    assert len(vertices) > 2
    rows = np.array([v.entries for v in vertices])
    for share in np.linspace(0, 1, 21):
        A = (1 - share) * loops[0].A + share * loops[1].A
        entries = Vertex.of_loop(Loop(A, loops[0].B, loops[0].C), 2).entries
        # a mixture: weights that aren't negative, of sum one
        assert nnls(np.vstack([rows.T, np.ones(len(rows))]), np.append(entries, 1.0))[1] < 1e-9
    middle = Loop((loops[0].A + loops[1].A) / 2, loops[0].B, loops[0].C)
    found = learning_gain(loops, middle, 2, np.zeros(2), 1.0)
    assert (found.affine, found.note) == (False, note)
    assert found.check.passed


def test_relative_degree_one_is_always_affine() -> None:
    rng = np.random.default_rng(0)
    loops = [
        Loop(0.3 * rng.normal(size=(3, 3)), rng.normal(size=(3, 1)), np.array([1.0, 0, 0])) for _ in range(4)
    ]
    assert mapped(loops, 1)[1]


def test_a_zero_outside_the_unit_circle_is_named() -> None:
    plant = drive_train("euler")
    weight, start = np.diag([1e4, 1.0, 1e2, 0.1, 1.0]), np.array([0.01, 0, 0.01, 0, 0])
    *loops, nominal = loops_of(plant, guaranteed_cost(plant, weight, 1.0, start, True).K_s)
    with pytest.raises(DesignError) as error:
        learning_gain(loops, nominal, plant.relative_degree, start, 0.1)
    assert error.value.key == "q_filter"
    assert str(error.value).startswith("q_filter: no K_3 makes the error fall at every frequency: above ")
    assert "because the plant has a zero at z = -4, not inside the unit circle; " in str(error.value)
    assert str(error.value).endswith("expected a zero-phase low-pass filter on the learned signal")


@pytest.mark.parametrize(
    ("f", "g", "key", "message"),
    [
        (np.full(3, np.nan), 0.1, "initial_change", "initial_change: expected 3 finite numbers"),
        (START, 0.0, "initial_error", "initial_error: 0: expected a number above zero"),
    ],
)
def test_errors(f: Real, g: float, key: str, message: str) -> None:
    *loops, nominal = loops_of(mandra(), K_S)
    with pytest.raises(DesignError) as error:
        learning_gain(loops, nominal, 2, f, g)
    assert str(error.value) == message
    assert error.value.key == key


@pytest.mark.parametrize(
    ("zeros", "reason"),
    [
        ([-4.0], "the plant has a zero at z = -4, not inside the unit circle; expected"),
        ([0.5, -1.25], "the plant has a zero at z = -1.25, not"),
        ([1.0 + 0.5j, 1.0 - 0.5j], "the plant has a zero at z = 1"),
        ([0.5], "the feedback lags too much there; expected"),
    ],
)
def test_why_no_gain_is_stable_is_told(zeros: list[complex], reason: str) -> None:
    """The frequency is the first at which the response of any of the plants points backwards."""
    n = len(zeros) + 1
    A = np.eye(n, k=-1)
    C = np.real(np.poly(zeros))  # with a chain of delays the output row has the zeros
    loop = Loop(A, np.eye(n)[:, :1], C)
    w = np.array([0.0, 0.25, 0.5, 1.0]) * np.pi
    told = _impossible(np.array([[1.0, 0.5, 0.1, 0.1], [1.0, 0.0, 0.2, -1.0]], complex), w, loop)
    assert told.startswith(
        "q_filter: no K_3 makes the error fall at every frequency: above 0.125 times the sampling rate it "
        f"grows with any gain, because {reason}"
    )
    assert "; expected a zero-phase low-pass" in told
    if len(zeros) > 1 and np.imag(zeros[0]):
        assert "z = 1+0.5j, not" in told or "z = 1-0.5j, not" in told
