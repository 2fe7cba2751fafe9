"""The certificate against trials that are simulated, and against finite lifted operators."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from design_plants import drive_train, mandra, mandra_settings, rms, simulate, smooth_step
from scipy.signal import butter, filtfilt

from cogless.design.trials import certificate
from cogless.design.trials.certificate import Certificate, Gains, Update, _Sweep, certify
from cogless.design.trials.feedforward import static_gain
from cogless.design.trials.gains import design_trial, impulse_response, lifted, norm_optimal
from cogless.design.trials.model import Model
from cogless.design.trials.polytope import UncertainPlant
from cogless.design.trials.response import (
    Bundle,
    Filter,
    Loop,
    TrialMap,
    best_gain,
    butterworth,
    factor,
    gain_limits,
    grid,
    growth,
    peak,
    workable_cutoff,
)
from cogless.design.trials.state_feedback import guaranteed_cost

LAW = Gains(np.array([-99.4484, -0.9270]), 1.3916, 99.4484, True, True)
K_3 = 0.6942


@pytest.fixture(scope="module")
def plant() -> UncertainPlant:
    return mandra()


@pytest.fixture(scope="module")
def found(plant: UncertainPlant) -> Certificate:
    return certify(plant, LAW, Update(2, K_3), butterworth(30.0, 2, 2.5e-3), "error", 300)


def test_design_model_contracts_and_exact_model_does_not(found: Certificate) -> None:
    design, exact = found.design, found.exact
    assert exact is not None
    assert found.discretisation == "euler"
    assert design.stable and exact.stable
    assert design.phi_radius is not None and design.phi_radius < 1
    assert design.without_filter is not None and exact.without_filter is not None
    assert design.without_filter.contracting
    assert design.without_filter.norm == pytest.approx(0.976, abs=1e-3)
    assert not exact.without_filter.monotone
    assert 1 < exact.without_filter.norm < 1.001
    assert exact.without_filter.frequency == pytest.approx(200, abs=2)  # Nyquist's
    # filtering the error leaves what is above the cutoff as it is: it doesn't grow, and doesn't shrink
    assert design.with_filter is not None and exact.with_filter is not None
    for part in (design.with_filter, exact.with_filter):
        assert part.monotone
        assert not part.contracting
        assert part.norm == pytest.approx(1.0, abs=1e-9)


def test_filter_on_the_signal_contracts_everywhere(plant: UncertainPlant) -> None:
    found = certify(plant, LAW, Update(2, K_3), butterworth(30.0, 2, 2.5e-3), "signal", 300)
    assert found.exact is not None
    for part in (found.design.with_filter, found.exact.with_filter):
        assert part is not None
        assert part.contracting
        assert part.norm < 0.6


def test_one_more_sample_of_delay_destabilises(found: Certificate, plant: UncertainPlant) -> None:
    assert not found.design.delayed_stable
    assert found.exact is not None
    assert not found.exact.delayed_stable
    assert found.exact.delayed_radius > 1.2
    # the same by simulation, at the smallest inertia
    assert plant.exact_vertices is not None
    growth = []
    for model in plant.exact_vertices:
        x, psi, held, size = np.array([0.01, 0.0]), 0.0, 0.0, []
        for _ in range(200):
            u = float(LAW.K_1 @ x) + LAW.K_2 * psi
            psi -= float(x[0])
            x = model.A @ x + model.B[:, 0] * held
            held = u
            size.append(np.linalg.norm(x))
        growth.append((size[-1] / size[99]) ** (1 / 100))
    assert max(growth) == pytest.approx(found.exact.delayed_radius, rel=1e-2)


@pytest.mark.parametrize("exact", [False, True])
def test_norm_bounds_the_lifted_operator_and_is_reached_by_long_trials(
    plant: UncertainPlant, exact: bool
) -> None:
    models = plant.exact_vertices if exact else plant.vertices
    assert models is not None
    for model in models[::3]:
        loop = LAW.closed(model, plant.C)
        bundle = Bundle([loop], 2)
        w = grid()
        norm, _, _ = peak(lambda w, _, b=bundle: factor(b(w), K_3), w, factor(bundle(w), K_3))
        G = lifted(loop, 403)
        finite = np.linalg.norm(np.eye(400) - K_3 * G[2:402, :400], 2)
        assert finite <= norm * (1 + 1e-12)
        assert finite > norm - 2e-3


def test_simulated_error_shrinks_at_least_as_fast(plant: UncertainPlant) -> None:
    design = design_trial(plant, mandra_settings(K_s=[-99.4484, -0.9270, 1.3916], K_3=K_3, feedforward=False))
    part = design.certificate.design.without_filter
    assert part is not None
    for model, bound in (
        (plant.nominal, part.nominal),
        (plant.vertices[0], part.norm),
        (plant.vertices[3], part.norm),
    ):
        # the first r samples are at rest; the learned signal can't reach them
        errors = rms(simulate(design, model, smooth_step(250), 60, load=2.0)[:, 2:])
        ratios = errors[1:] / errors[:-1]
        assert np.all(ratios[errors[:-1] > 1e-12] <= bound * (1 + 1e-9))
    nominal = rms(simulate(design, plant.nominal, smooth_step(250), 330, load=2.0)[:, 2:])
    assert nominal[-1] < 1e-13  # until rounding


def test_limit_of_the_gain(plant: UncertainPlant, found: Certificate) -> None:
    part = found.design.without_filter
    assert part is not None and part.K_3_limit is not None
    for share, monotone in ((0.9999, True), (1.0001, False)):
        other = certify(
            plant, LAW, Update(2, share * part.K_3_limit), None, "error", 300
        ).design.without_filter
        assert other is not None
        assert other.monotone == monotone


@pytest.mark.parametrize("sign", [-1, 1])
def test_worst_plant_nominal_plant_and_limit_in_closed_form(sign: int) -> None:
    """F = 1 - K b z / (z - 1/2) is 1 - 2 K b at rest and 1 - 2/3 K b at half the rate."""
    strong, nominal = (Loop(np.array([[0.5]]), np.array([[b * sign]]), np.ones(1)) for b in (2.0, 1.0))
    both = _Sweep([strong, nominal], ["strong", "nominal"], Update(1, 0.7 * sign), 1e-3)
    found = both.learning(None, "error", 0.0)
    assert (found.norm, found.frequency, found.worst) == (pytest.approx(1.8), 0.0, "strong")
    assert found.nominal == pytest.approx(1 - 0.7 * 2 / 3)
    assert found.K_3_limit == pytest.approx(sign * 0.5)
    assert (found.monotone, found.contracting) == (False, False)
    alone = _Sweep([nominal], ["nominal"], Update(1, 0.7 * sign), 1e-3).learning(None, "error", 0.0)
    assert (alone.frequency, alone.monotone, alone.contracting) == (pytest.approx(500.0), True, True)


@pytest.mark.parametrize(
    ("ends", "phi", "monotone", "contracting"),
    [
        (1 + 0.99e-4, 0.999, True, True),  # growth at the ends is only estimated
        (1 + 1.01e-4, 0.0, False, False),
        (0.0, 1.0, True, False),
        (0.0, 1 + 0.9e-6, True, False),  # as rounding leaves a double pole at z = 1
        (0.0, 1 + 1.1e-6, False, False),
    ],
)
def test_ends_and_phi_count_beside_the_norm(
    ends: float, phi: float, monotone: bool, contracting: bool
) -> None:
    loop = Loop(np.array([[0.5]]), np.ones((1, 1)), np.ones(1))
    found = _Sweep([loop], ["nominal"], Update(1, 0.75), 1e-3).learning(None, "error", ends, phi)
    assert found.norm == pytest.approx(0.5)
    assert (found.monotone, found.contracting) == (monotone, contracting)


@pytest.mark.parametrize("filtered", ["error", "signal"])
def test_limits_by_frequency(filtered: str) -> None:
    rng = np.random.default_rng(0)
    G = rng.normal(size=(3, 50)) + 1j * rng.normal(size=(3, 50))
    H = rng.uniform(0.2, 0.9, 50)
    limits = gain_limits(G, H, filtered)
    for k, row in enumerate(limits):
        for i, limit in enumerate(row):
            at = factor(G[k : k + 1, i : i + 1], limit, H[i : i + 1], filtered)
            assert at[0, 0] == pytest.approx(1 + 1e-9, rel=1e-9)


def test_best_gain_is_the_best() -> None:
    loop = Loop(np.array([[0.5]]), np.ones((1, 1)), np.ones(1))
    K, worst = best_gain(Bundle([loop], 1)(grid()))
    assert (K, worst) == pytest.approx((0.75, 0.5), rel=1e-4)


def test_filter_gain_is_that_of_filtfilt() -> None:
    b, a = butter(2, 30.0 * 2 * 2.5e-3)
    x = np.zeros(2001)
    x[1000] = 1.0
    w = np.linspace(0.01, 3.1, 50)
    measured = np.abs(np.exp(-1j * np.outer(w, np.arange(2001))) @ filtfilt(b, a, x))
    np.testing.assert_allclose(Filter(b, a).gain(w), measured, atol=1e-9)
    np.testing.assert_allclose(butterworth(30.0, 2, 2.5e-3).b, b)


def test_response_of_repeated_poles() -> None:
    A = np.array([[0.5, 1.0, 0.0], [0.0, 0.5, 1.0], [0.0, 0.0, 0.5]])
    loop = Loop(A, np.array([[0.0], [0.0], [1.0]]), np.array([1.0, 0.0, 0.0]))
    w = np.linspace(0, np.pi, 7)
    np.testing.assert_allclose(Bundle([loop, loop], 3)(w)[1], 1 / (1 - 0.5 * np.exp(-1j * w)) ** 3, rtol=1e-9)


def test_unstable_along_the_trial_has_no_norm(plant: UncertainPlant) -> None:
    weak = Gains(np.array([10.0, 0.0]), 0.0, 1.0, False, False)
    found = certify(plant, weak, Update(2, 1.0), None, "error", 300).design
    assert not found.stable
    assert found.without_filter is None
    assert found.radius > 1


def test_input_structure_does_not_contract_at_rest(plant: UncertainPlant) -> None:
    # the integrator cancels a constant learned signal at the input: simplified structures learn slowly
    law = Gains(LAW.K_1, LAW.K_2, LAW.N, False, True)
    part = certify(plant, law, Update(2, K_3), None, "error", 300).design.without_filter
    assert part is not None
    assert (part.monotone, part.contracting) == (True, False)
    assert part.frequency == pytest.approx(0.0, abs=1.0)


def test_curve_holds_the_peak(found: Certificate) -> None:
    part = found.design.without_filter
    assert part is not None
    frequency, magnitude = part.curve
    assert np.all(np.diff(frequency) >= 0)
    assert magnitude.max() == part.norm
    assert frequency[np.argmax(magnitude)] == part.frequency
    assert (frequency[0], frequency[-1]) == pytest.approx((0.0, 200.0))


def test_norm_optimal_in_frequency_and_lifted(plant: UncertainPlant) -> None:
    nominal = LAW.closed(plant.nominal, plant.C)
    ratio, samples = 1e-2, 300
    L = norm_optimal(nominal, samples, ratio)
    G = lifted(nominal, samples)
    np.testing.assert_allclose((G.T @ G + ratio * np.eye(samples)) @ L, G.T, atol=1e-10)
    part = certify(plant, LAW, Update(2, 0.0, ratio, nominal), None, "error", 300).design.without_filter
    assert part is not None
    vertices = [lifted(LAW.closed(m, plant.C), samples) for m in plant.vertices]
    finite = max(np.linalg.norm((np.eye(samples) - g @ L)[2:, 2:], 2) for g in vertices)
    assert finite == pytest.approx(part.norm, abs=0.02)
    assert part.K_3_limit is None


def test_impulse_response() -> None:
    loop = Loop(np.array([[0.5]]), np.array([[2.0]]), np.array([3.0]))
    assert impulse_response(loop, 4).tolist() == [0, 6, 3, 1.5]
    assert lifted(loop, 3).tolist() == [[0, 0, 0], [6, 0, 0], [3, 6, 0]]


def test_workable_cutoff() -> None:
    plant = drive_train()
    law = design_law(plant)
    loops = [law.closed(m, plant.C) for m in plant.vertices]
    cutoff = workable_cutoff(loops, 1, 2, 1e-3, 400)
    assert cutoff is not None
    w = grid()
    G = Bundle(loops, 1)(w)
    assert best_gain(G)[1] >= 1 - 1e-6  # none without a filter
    assert best_gain(G, butterworth(cutoff, 2, 1e-3).gain(w))[1] <= 0.95
    K = best_gain(G, butterworth(cutoff, 2, 1e-3).gain(w))[0]
    assert growth(TrialMap(loops, K, 1, butterworth(cutoff, 2, 1e-3), "signal", 400)).max() <= 0.95


def design_law(plant: UncertainPlant) -> Gains:
    """Some feedback for the drive train."""
    weight, start = np.diag([1e4, 1.0, 1e2, 0.1, 1.0]), np.array([0.01, 0, 0.01, 0, 0])
    K_s = guaranteed_cost(plant, weight, 1.0, start, True).K_s
    return Gains(K_s[:4], float(K_s[4]), static_gain(plant.nominal, plant.C, K_s[:4]), True, True)


def test_closed_loop_is_the_papers() -> None:
    law = Gains(np.array([1.0, 2.0]), 3.0, 4.0, True, True)
    loop = law.closed(Model(np.eye(2), np.array([[5.0], [6.0]])), np.array([7.0, 8.0]))
    assert loop.A.tolist() == [[6, 10, 15], [6, 13, 18], [-7, -8, 1]]
    assert loop.B.tolist() == [[20], [24], [1]]
    assert loop.C.tolist() == [7, 8, 0]


T = 1e-3


def test_a_norm_optimal_update_is_its_operator_with_a_gain_of_one() -> None:
    known = Loop(np.array([[0.5]]), np.array([[2.0]]), np.ones(1))
    update, w = Update(1, 0.7, 0.01, known), np.array([0.0, 1.0])
    G = 2.0 / (1 - 0.5 * np.exp(-1j * w))
    assert update.gain == 1.0 and Update(1, 0.7).gain == 0.7
    assert update.on(3 * G, w) == pytest.approx(3 * np.abs(G) ** 2 / (np.abs(G) ** 2 + 0.01))
    assert Update(1, 0.7).on(G, w) is G


def test_one_more_sample_of_delay_is_a_state_of_the_input() -> None:
    """x' = u of the sample before, u = -x / 4: z^2 - z + 1/4 has a double root at a half; with an integral
    z^3 - 2 z^2 + (1 - K_1) z + K_1 + K_2."""
    model, C = Model(np.ones((1, 1)), np.ones((1, 1))), np.ones(1)
    plain = Gains(np.array([-0.25]), 0.1, 1.0, True, False)
    assert plain.delayed(model, C) == pytest.approx(0.5, abs=1e-6)
    whole = Gains(np.array([-0.5]), 0.1, 1.0, True, True)
    roots = np.roots([1.0, -2.0, 1.5, -0.5 + 0.1])
    assert whole.delayed(model, C) == pytest.approx(np.abs(roots).max())


def plants(**more: Any) -> Any:
    """A plant whose vertices have poles at 0.5 and 0.6, and at 0.55 nominally; `more` replaces its fields."""

    def first(pole: float) -> Model:
        return Model(np.array([[pole]]), np.ones((1, 1)))

    none = {"exact_vertices": None, "exact_nominal": None, "exact_hull": True, "discretisation": None}
    drawn = [first(0.56)] * 3
    same = {
        "vertices": (first(0.5), first(0.6)),
        "labels": ("low", "high"),
        "nominal": first(0.55),
        "C": np.ones(1),
    }
    return SimpleNamespace(
        **{**none, **same, "random": (drawn, None), "relative_degree": 1, "period": T, **more}
    )


def test_a_certificate_names_the_plant_that_is_worst() -> None:
    idle = Gains(np.zeros(1), 0.0, 1.0, False, False)
    found = certificate.certify(plants(), idle, Update(1, 0.5), None, "error", 60)
    assert (found.design.worst, found.design.radius, found.samples) == ("high", pytest.approx(0.6), 3)
    assert found.exact is None and found.design.learning is found.design.without_filter is not None
    exact = plants(
        exact_vertices=(Model(np.array([[0.7]]), np.ones((1, 1))),) * 2,
        exact_nominal=Model(np.array([[0.65]]), np.ones((1, 1))),
        exact_hull=False,
    )
    exact.random = (exact.random[0], [Model(np.array([[0.8]]), np.ones((1, 1)))])
    beside = certificate.certify(exact, idle, None, None, "error", 60).exact
    assert beside is not None and (beside.worst, beside.radius) == ("a random plant", pytest.approx(0.8))
    assert (beside.phi_radius, beside.growth, beside.learning) == (None, None, None)
    exact.random = (exact.random[0], [])
    of_corners = certificate.certify(exact, idle, None, None, "error", 60).exact
    assert of_corners is not None and of_corners.worst == "corner 1"
    exact.exact_nominal = Model(np.array([[0.9]]), np.ones((1, 1)))
    nominal = certificate.certify(exact, idle, None, None, "error", 60).exact
    assert nominal is not None and nominal.worst == "the nominal plant"
    shifted = certificate.certify(plants(), idle, Update(2, 0.1), None, "error", 60).design
    assert shifted.phi_radius is None and found.design.phi_radius is not None
