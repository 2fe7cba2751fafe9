"""Whole designs: Mandra 2019's four structures, the baselines, other plants, mistakes in one line each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trial_studies
from design_plants import (
    START,
    Q,
    Unseen,
    drive_train,
    mandra,
    mandra_settings,
    rms,
    simulate,
    smooth_step,
    speed,
    two_masses,
)
from scipy.linalg import expm

from cogless.design.trials import from_study
from cogless.design.trials import gains as room
from cogless.design.trials.certificate import Certificate, Learning, Update
from cogless.design.trials.from_study import design_study, retuned, same_gains, settings_of
from cogless.design.trials.gains import (
    TrialDesign,
    TrialGains,
    TrialSettings,
    _factor,
    design_gains,
    design_trial,
)
from cogless.design.trials.model import DesignError, Real
from cogless.design.trials.polytope import UncertainPlant, from_parameters, from_vertices
from cogless.design.trials.response import Filter
from cogless.study import reading


@pytest.fixture(scope="module")
def plant() -> UncertainPlant:
    return mandra()


@pytest.fixture(scope="module")
def gains(plant: UncertainPlant) -> TrialGains:
    return design_gains(plant, mandra_settings())


def test_mandra(plant: UncertainPlant, gains: TrialGains) -> None:
    design = design_trial(plant, mandra_settings(cutoff=30.0), gains)
    assert np.all(np.abs(gains.K_s - [-99.4484, -0.9270, 1.3916]) <= [0.02, 0.0005, 0.0005])
    assert pytest.approx(0.6942, abs=1e-3) == design.K_3
    assert pytest.approx(-design.K_1[0], rel=1e-9) == design.N  # the plant integrates
    assert (design.shift, design.through_integrator, design.filtered) == (2, True, "error")
    assert design.feedforward is not None and design.feedforward.preview == 2
    assert design.q_filter is not None and len(design.q_filter.b) == 3
    assert design.learning_matrix is None
    assert gains.feedback is not None and gains.feedback.check.passed
    assert gains.learning is not None and gains.learning.check.passed
    assert design.notes == ()


def test_note_where_the_exact_plant_grows(plant: UncertainPlant, gains: TrialGains) -> None:
    (note,) = design_trial(plant, mandra_settings(), gains).notes
    assert str(note).startswith("exact model: the error can grow by a factor of 1.000")
    assert "a trial at 200 Hz; a zero-phase low-pass filter of " in str(note)
    cutoff = float(str(note).split(" filter of ")[1].split(" Hz")[0])
    cured = design_trial(plant, mandra_settings(cutoff=cutoff, filtered="signal"), gains)
    assert cured.notes == ()
    assert cured.certificate.exact is not None and cured.certificate.exact.with_filter is not None
    assert cured.certificate.exact.with_filter.contracting


def test_note_where_the_exact_plant_is_unstable() -> None:
    ranges = {"load_inertia": (7e-4, 9e-4), "stiffness": (100.0, 100.0)}
    plant = from_parameters(two_masses, ranges, [1, 0, 0, 0], 2.5e-3)  # Euler, far too slow for the resonance
    weight, start = np.diag([1e4, 1.0, 1e2, 0.1, 1.0]), [0.01, 0, 0.01, 0, 0]
    settings = TrialSettings(samples=400, Q=weight, R=1.0, gamma=start, f=start, g=0.1, learning=False)
    design = design_trial(plant, settings)
    assert design.certificate.design.stable
    assert design.certificate.exact is not None and not design.certificate.exact.stable
    (note,) = design.notes
    assert str(note).startswith("exact model: unstable along the trial at load_inertia = 0.000")


def test_four_structures_share_their_gains(plant: UncertainPlant, gains: TrialGains) -> None:
    settings = mandra_settings(cutoff=30.0)
    full, simplified, proportional, without = (
        design_trial(plant, changed, gains)
        for changed in (
            settings,
            replace(settings, structure="input"),
            replace(settings, integral=False),
            replace(settings, learning=False),
        )
    )
    assert (full.through_integrator, simplified.through_integrator) == (True, False)
    assert (proportional.K_2, proportional.through_integrator) == (0.0, False)
    assert (without.K_3, without.q_filter, without.certificate.design.without_filter) == (0.0, None, None)
    assert full.K_3 == simplified.K_3 == proportional.K_3
    assert without.K_2 == full.K_2 != 0


def test_structures_in_simulation(plant: UncertainPlant, gains: TrialGains) -> None:
    settings = mandra_settings()
    y_ref, load = smooth_step(400), 1.0
    errors = {}
    for name, changed in {
        "full": settings,
        "input": replace(settings, structure="input"),
        "no integral": replace(settings, integral=False),
        "no learning": replace(settings, learning=False),
    }.items():
        errors[name] = rms(simulate(design_trial(plant, changed, gains), plant.nominal, y_ref, 12, load))
    assert errors["full"][0] == errors["input"][0] == errors["no learning"][0]
    assert errors["no integral"][0] > 2 * errors["full"][0]
    assert errors["full"][-1] < 0.1 * errors["input"][-1]
    assert np.ptp(errors["no learning"]) == 0


def test_feedforward_leaves_nothing_on_the_nominal_plant(plant: UncertainPlant, gains: TrialGains) -> None:
    design = design_trial(plant, mandra_settings(learning=False), gains)
    y_ref = np.concatenate([np.zeros(10), smooth_step(300)])
    assert np.abs(simulate(design, plant.nominal, y_ref, 1)).max() < 1e-12


def test_given_gains_are_certified_not_designed(plant: UncertainPlant) -> None:
    design = design_trial(plant, mandra_settings(K_s=[-99.4484, -0.9270, 1.3916], N=99.4484, K_3=0.6942))
    assert (design.N, design.K_3) == (99.4484, 0.6942)
    assert design.gains.feedback is None and design.gains.learning is None
    assert design.certificate.design.phi_radius is not None and design.certificate.design.phi_radius < 1


def test_older_law_telescopes(plant: UncertainPlant) -> None:
    design = design_trial(plant, mandra_settings(kind="state"))
    assert (design.K_2, design.N, design.through_integrator, design.feedforward) == (0.0, 1.0, False, None)
    assert design.gains.learning is not None and design.gains.learning.check.passed
    y_ref, trials, samples = smooth_step(200), 6, 200
    expected = simulate(design, plant.nominal, y_ref, trials)
    A, B = plant.nominal.A, plant.nominal.B[:, 0]
    u, x_before = np.zeros(samples), np.zeros((samples, 2))
    e = np.zeros(samples)
    for k in range(trials):
        x, x_now, y = np.zeros(2), np.zeros((samples, 2)), np.zeros(samples)
        for p in range(samples):
            y[p], x_now[p] = x[0], x
            # (3), with e of the last trial r samples later
            if k:
                u[p] += design.K_1 @ (x - x_before[p]) + design.K_3 * (e[p + 2] if p + 2 < samples else e[-1])
            else:
                u[p] = design.K_1 @ x
            x = A @ x + B * u[p]
        x_before, e = x_now, y_ref - y
        np.testing.assert_allclose(e, expected[k], atol=1e-9)
        e = e.copy()
        e[:2] = 0.0


def test_norm_optimal_learning(plant: UncertainPlant, gains: TrialGains) -> None:
    settings = mandra_settings(kind="norm-optimal", samples=300)
    design = design_trial(plant, settings, gains)
    assert design.learning_matrix is not None and design.learning_matrix.shape == (300, 300)
    assert (design.K_3, design.q_filter) == (0.0, None)
    assert design.notes == ()
    assert plant.exact_nominal is not None
    errors = rms(simulate(design, plant.exact_nominal, smooth_step(300), 8, load=1.0)[:, 2:])
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 2e-2 * errors[0]


def test_relative_degree_one() -> None:
    ranges = {"inertia": (1e-4, 2e-4), "friction": (1e-4, 2e-4), "torque_constant": (0.1, 0.12)}
    plant = from_parameters(speed, ranges, [1], 1e-3)
    settings = TrialSettings(
        samples=300, Q=np.diag([1.0, 1e-3]), R=1.0, gamma=[1.0, 0.0], f=[0.1, 0.0], g=1.0, feedforward=False
    )
    design = design_trial(plant, settings)
    assert design.shift == 1
    part = design.certificate.exact
    assert part is not None and part.without_filter is not None
    assert part.without_filter.contracting
    _holds(design_errors(design, plant, 15), part.without_filter.norm)


def test_two_mass_drive_train() -> None:
    plant = drive_train()
    assert plant.order == 4
    weight, start = np.diag([1e4, 1.0, 1e2, 0.1, 1.0]), [0.01, 0, 0.01, 0, 0]
    settings = TrialSettings(samples=400, Q=weight, R=1.0, gamma=start, f=start, g=0.1)
    unfiltered = design_gains(plant, settings)
    with pytest.raises(DesignError) as error:
        design_trial(plant, settings, unfiltered)
    assert error.value.key == "q_filter"
    assert error.value.cures == ({"q_filter": "auto", "shift": "auto"},)
    design = design_trial(plant, replace(settings, K_s=unfiltered.K_s, cutoff="auto", shift="auto"))
    cutoff = f"{design.gains.cutoff:.3g} Hz"
    chosen = f"the design chose shift = {design.shift}, a filter of {cutoff} and K_3 together. "
    assert str(design.notes[-1]).startswith(chosen) and str(error.value).endswith(
        f'shift = "auto" would choose a filter of {cutoff} and a shift of {design.shift}'
    )
    part = design.certificate.exact
    assert part is not None and part.with_filter is not None and part.without_filter is not None
    assert part.with_filter.contracting
    assert not part.without_filter.monotone
    errors = design_errors(design, plant, 25)
    # with the filter on the signal the error settles at what the filter takes out of v: its changes shrink
    assert part.growth is not None
    factor = max(part.with_filter.norm, part.growth)
    assert factor < 0.951
    _holds(np.diff(errors, axis=1), factor, ends=0.02)
    # with the smallest shift and without the filter, learning first helps and then destroys
    least = design_trial(plant, replace(settings, K_s=unfiltered.K_s, cutoff=20.0, filtered="signal"))
    assert least.shift == plant.relative_degree < design.shift
    grown = design_errors(replace(least, q_filter=None), plant, 90)
    assert np.all(rms(grown)[:, -1] > 3 * rms(grown).min(axis=1))


@pytest.mark.parametrize(
    ("zero", "ends", "grows"),
    [(1.4, "odd", True), (1.4, "even", False), (-1.6, "odd", False), (-1.6, "even", False)],
)
def test_zero_outside_the_unit_circle(zero: float, ends: Any, grows: bool) -> None:
    models = [([[0.9, -0.2], [1.0, 0.0]], [[b], [0.0]]) for b in (0.8, 1.0, 1.2)]
    plant = from_vertices(models, [1.0, -zero], 1e-2)
    settings = TrialSettings(
        samples=300, Q=np.diag([1.0, 1.0, 0.01]), R=10.0, gamma=[1.0, 0, 0], f=[0.1, 0, 0], g=1.0, cutoff=5.0,
        filtered="signal", ends=ends,
    )  # fmt: skip
    design = design_trial(plant, settings)
    assert design.feedforward is not None
    assert design.feedforward.kept_zeros == pytest.approx([zero])
    part = design.certificate.design
    assert design.certificate.exact is None
    # every frequency shrinks, and yet the ends of the trial may not
    assert part.with_filter is not None and part.with_filter.norm < 1
    assert part.growth is not None and (part.growth > 1) == grows
    assert part.with_filter.contracting == part.with_filter.monotone == (not grows)
    changes = np.array([np.diff(simulate(design, m, smooth_step(300), 60), axis=0) for m in plant.vertices])
    sizes = np.linalg.norm(changes[:, :, 1:], axis=2)
    # the mean factor over trials in which the change is above rounding
    last = min(40, int(np.argmax(np.all(sizes < 1e-9 * sizes[:, :1], axis=0)) or 40))
    measured = (sizes[:, last] / sizes[:, last // 2]) ** (1 / (last - last // 2))
    assert measured.max() <= 1.02 * part.growth
    if last == 40:  # long enough that only the slowest part is left
        assert measured.max() == pytest.approx(part.growth, rel=0.02)
    assert any("a trial, near the trial's beginning" in str(note) for note in design.notes) == grows


def design_errors(design, plant: UncertainPlant, trials: int) -> Real:
    """(plants, trials, samples) at random plants, sampled exactly where that is known, with a load."""
    discrete, exact = plant.random
    models = (exact or discrete)[:3]
    y_ref = smooth_step(300, 1.0)
    return np.array([simulate(design, m, y_ref, trials, load=0.1) for m in models])


def _holds(errors: Real, norm: float, ends: float = 1e-9) -> None:
    """Each trial's RMS is at most norm times the last one's; `ends`: spare for filtfilt's."""
    sizes = rms(errors[:, :, 2:])
    matters = sizes[:, :-1] > 1e-9 * sizes.max()
    assert np.all((sizes[:, 1:] / sizes[:, :-1])[matters] <= norm + ends)


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ({"samples": 2}, "samples", "samples: 2: expected a trial longer than the relative degree, 2"),
        ({"samples": 9, "cutoff": 30.0}, "samples", "samples: 9: expected more than 9, by which the filter "
        "extends the trial at each end"),
        ({"Q": np.eye(4)}, "state_weight", "state_weight: 4 x 4: expected 2 x 2 or 3 x 3"),
        ({"Q": np.eye(2), "gamma": START[:2], "f": START[:2]}, "state_weight",
            "state_weight: expected 3 x 3, with a weight for the integrator"),
        ({"Q": np.diag([1.0, -1.0, 1.0])}, "state_weight",
            "state_weight: expected a symmetric matrix that is positive definite"),
        ({"R": -1.0}, "input_weight", "input_weight: -1: expected a number above zero"),
        ({"gamma": [1.0]}, "initial_state",
            "initial_state: expected 3 numbers, as many as the state weight has rows"),
        ({"f": [1.0, 0]}, "initial_change",
            "initial_change: expected 3 numbers, as many as the state weight has rows"),
        ({"g": -0.1}, "initial_error", "initial_error: -0.1: expected a number above zero"),
        ({"cutoff": 200.0}, "q_filter",
            "q_filter: 200 Hz: expected a cutoff above zero and below 200 Hz, half the sampling rate"),
        ({"cutoff": 30.0, "filter_order": 0}, "q_filter", "q_filter: order 0: expected at least 1"),
        ({"K_s": [1.0, 2.0]}, "K_s", "K_s: expected 3 finite numbers"),
        ({"K_3": float("nan")}, "K_3", "K_3: expected a finite number"),
        ({"K_s": [1.0, 0.0, 0.0], "N": 1.0, "feedforward": False}, "K_s",
            "K_s: expected feedback that is stable at inertia = 0.00059, friction = 0.0013, "
            "torque_constant = 0.39; its largest pole is 1.062"),
        ({"N": float("inf")}, "N", "N: expected a finite number"),
        ({"K_s": [1.0, float("nan"), 2.0]}, "K_s", "K_s: expected 3 finite numbers"),
        ({"shift": 1}, "shift", "shift: 1: expected 2, the relative degree, or more"),
        ({"shift": 32, "samples": 32}, "shift", "shift: 32: expected less than the 32 samples"),
        ({"samples": 12, "cutoff": 30.0, "filter_order": 3}, "samples",
            "samples: 12: expected more than 12, by which the filter extends the trial at each end"),
        ({"kind": "norm-optimal", "change_weight": float("inf")}, "change_weight",
            "change_weight: inf: expected a number above zero"),
        ({"kind": "norm-optimal", "change_weight": 0.0}, "change_weight",
            "change_weight: 0: expected a number above zero"),
    ],
)  # fmt: skip
def test_errors(plant: UncertainPlant, changes: dict[str, object], key: str, message: str) -> None:
    with pytest.raises(DesignError) as error:
        design_trial(plant, mandra_settings(**changes))
    assert str(error.value) == message
    assert error.value.key == key


def test_a_trial_law_is_robust_and_learns_by_all_it_has_unless_it_is_told_otherwise() -> None:
    left_out = vars(TrialSettings(samples=100, Q=np.eye(1), R=1.0, gamma=[1.0], f=[1.0], g=0.1))
    switches = [left_out[key] for key in ("integral", "learning", "feedforward")]
    assert switches == [True, True, True] and left_out["kind"] == "robust"
    chosen = ("structure", "filter_order", "filtered", "change_weight")
    assert [left_out[key] for key in chosen] == ["input-and-integrator", 2, "error", 0.01]
    by_design = ("cutoff", "K_s", "N", "K_3", "shift", "pole")
    assert [left_out[key] for key in by_design] == [None] * 6


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.5, "1.5"), (1.00012345678, "1.000123"), (1.00009, "1 + 9.0e-05"), (1.000101, "1.000101")],
)
def test_a_factor_keeps_enough_digits(value: float, text: str) -> None:
    assert _factor(value) == text


def test_designed_without_integral_action(plant: UncertainPlant) -> None:
    settings = mandra_settings(Q=Q[:2, :2], gamma=START[:2], f=START[:2], integral=False)
    design = design_trial(plant, settings)
    assert design.gains.K_s.shape == (2,)
    assert design.K_2 == 0.0
    part = design.certificate.design.without_filter
    assert part is not None and part.contracting


def first_order(gain: float) -> UncertainPlant:
    return from_parameters(lambda p: ([[p["a"]]], [gain]), {"a": (0.5, 1.5)}, [1.0], 0.05)


@pytest.mark.parametrize("kind", ["state", "robust"])
@pytest.mark.parametrize(
    "filtered", [{}, {"cutoff": 3.0, "filtered": "signal"}, {"cutoff": 2.0, "filtered": "signal", "shift": 2}]
)
def test_a_plant_that_acts_the_other_way_learns_as_well(kind: str, filtered: dict[str, object]) -> None:
    settings = TrialSettings(
        samples=100, Q=np.eye(2), R=1.0, gamma=[1.0, 0.0], f=[0.1, 0.0], g=0.1, kind=kind, **filtered
    )  # fmt: skip
    ours, theirs = (design_trial(first_order(gain), settings) for gain in (2.0, -2.0))
    assert ours.K_3 > 0
    sign = -1 if kind == "state" else 1  # N has the sign otherwise
    assert pytest.approx(sign * ours.K_3, rel=1e-3) == theirs.K_3
    assert pytest.approx(sign * -ours.N) == theirs.N if kind == "robust" else theirs.N == 1
    for mine, other in zip(parts(ours), parts(theirs), strict=True):
        assert mine.norm == pytest.approx(other.norm, rel=1e-3)
        assert (mine.monotone, mine.contracting) == (other.monotone, other.contracting)
        assert mine.K_3_limit is not None and other.K_3_limit is not None
        assert mine.K_3_limit == pytest.approx(sign * other.K_3_limit, rel=1e-3)


def parts(design: TrialDesign) -> list[Learning]:
    found = design.certificate.design
    return [part for part in (found.without_filter, found.with_filter) if part is not None]


def test_a_static_gain_of_the_wrong_sign_is_named(plant: UncertainPlant) -> None:
    with pytest.raises(DesignError) as error:
        design_trial(plant, mandra_settings(N=-99.4, feedforward=False, structure="input"))
    assert str(error.value) == (
        "N: -99.4: expected a number above zero: N must have the sign of the loop's gain at zero frequency"
    )


def test_gains_for_another_shift_are_others() -> None:
    settings = mandra_settings()
    assert same_gains(settings, replace(settings, samples=500))
    assert not same_gains(settings, replace(settings, shift=3))


def test_a_study_changed_elsewhere_takes_the_other_s_plant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study, run = trial_studies.loaded(tmp_path), ("move", "ilc")
    before = design_study(study, [run])[run]
    other = reading.changed(study, {"controller.ilc.K_3": 0.3})
    monkeypatch.setattr(from_study, "from_parameters", lambda *of: pytest.fail("a plant is made anew"))
    found = retuned(other, run, study)
    assert (pytest.approx(0.69, abs=0.1), 0.3) == (before.K_3, found.K_3)
    assert found.K_1.tolist() == before.K_1.tolist()


def test_a_factor_above_one_is_never_told_as_one(plant: UncertainPlant, gains: TrialGains) -> None:
    (note,) = design_trial(plant, mandra_settings(K_3=1e-5), replace(gains, K_3=1e-5)).notes
    factor = str(note).split("by a factor of ")[1].split(" a trial")[0]
    assert factor.startswith("1 + ")


def test_growth_without_a_filter_is_the_trial_s_not_the_filter_s() -> None:
    plant = from_vertices([([[0.3]], [0.7])], [1.0], 1e-2)
    settings = TrialSettings(
        samples=60, Q=np.eye(1), R=1.0, gamma=[1.0], f=[1.0], g=0.1, integral=False, structure="input",
        K_s=[0.0], N=1.0, K_3=0.9, shift=2,
    )  # fmt: skip
    design = design_trial(plant, settings)
    assert all("filter;" not in note and "ends of the filter" not in note for note in map(str, design.notes))


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (
            {"law": "state-ilc", "K_stab": [-50.0, -0.5], "K_ilc": 0.3},
            {"kind": "state", "structure": "input", "integral": False, "feedforward": False,
             "K_s": (-50.0, -0.5), "K_3": 0.3},
        ),
        ({"law": "trial-ilc", "acts_on": "input", "K_3": 0.5},
            {"structure": "input", "K_3": 0.5, "cutoff": None}),
        ({"law": "trial-ilc", "q_filter": {"cutoff": "30 Hz", "order": 3, "acts_on": "error"}},
            {"structure": "input-and-integrator", "cutoff": 30.0, "filter_order": 3, "filtered": "error"}),
        ({"law": "norm-optimal", "change_weight": 0.2}, {"kind": "norm-optimal", "change_weight": 0.2}),
        ({"law": "observer-ilc"},
            {"kind": "observer", "structure": "input", "integral": False, "filtered": "signal"}),
    ],
)  # fmt: skip
def test_a_law_s_keys_are_its_design_s_settings(
    tmp_path: Path, law: dict[str, Any], expected: dict[str, Any]
) -> None:
    study = trial_studies.loaded(tmp_path, {"controller.ilc": law})
    found = settings_of(study, "move", "ilc")
    assert {key: getattr(found, key) for key in expected} == expected
    assert found.samples == 200 and np.shape(found.Q) == (3, 3)
    assert found.f == found.gamma and study.design.initial_change is None


def test_the_default_feedforward_is_of_the_plant_as_it_is_sampled() -> None:
    """An own simulation of the motor under a held input: the plant's exponential by SciPy, no integrator.

    What is left is the zero at the unit circle, which the feedforward doesn't cancel: y is a mean of three
    samples of the reference. Euler's inverse leaves many times more.
    """
    J, B, K_t = 8.25e-4, 1.4e-3, 0.37
    step = expm(2.5e-3 * np.array([[0, 1, 0], [0, -B / J, K_t / J], [0, 0, 0]]))
    A, b = step[:2, :2], step[:2, 2]
    y_ref = np.concatenate([np.zeros(50), smooth_step(300), np.ones(50)])

    def moved(**changes: object) -> Real:
        design = design_trial(mandra(), mandra_settings(learning=False, **changes))
        ahead = design.feedforward
        assert ahead is not None and np.allclose(ahead.den[1:], 0)
        padded = np.concatenate([y_ref, np.ones(ahead.preview)])
        x, y = np.zeros(2), np.zeros(len(y_ref))
        for p in range(len(y_ref)):
            y[p] = x[0]
            taps = [padded[max(0, p + ahead.preview - i)] for i in range(len(ahead.num))]
            x = A @ x + b * (design.K_1 @ x + ahead.num @ taps)
        return y

    default, paper = moved(inverted="exact"), moved()
    zero = A[1, 1] - A[0, 1] * b[1] / b[0]
    mean = np.convolve(y_ref, [-zero, 1 + zero**2, -zero])[1:-1] / (1 - zero) ** 2
    assert default[50:-5] == pytest.approx(mean[50:-5], abs=1e-9)
    assert np.abs(default - y_ref).max() < 0.2 * np.abs(paper - y_ref).max()


T = 1e-3


def part(**more: Any) -> Any:
    learning = SimpleNamespace(
        monotone=more.pop("monotone", False), norm=more.pop("norm", 1.0), frequency=12.3456
    )
    own = {"stable": True, "worst": "corner 2", "radius": 1.23456, "growth": None, "with_filter": None}
    return SimpleNamespace(**{**own, "learning": learning, "phi_radius": 1.5, **more})


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (part(norm=1.25), "1.25 a trial at 12.35 Hz"),
        (part(norm=1 + 1e-9, growth=1.5), "1.5 a trial, near the trial's beginning or end"),
        (part(growth=1.5, with_filter=1), "1.5 a trial, near the trial's beginning or end"),
        (part(growth=1 + 0.9e-4), "1.5 a sample: this is the largest pole of trial and learning together, "
        "of the matrix Phi, (27) of Mandra 2019"),
        (part(phi_radius=None), "1 + 0.0e+00 a sample: this is the largest pole of trial and learning "
        "together, of the matrix Phi, (27) of Mandra 2019"),
    ],
)  # fmt: skip
def test_what_can_grow_is_told_with_what_prevents_it(
    monkeypatch: pytest.MonkeyPatch, found: Any, told: str
) -> None:
    """What helps is a filter of so many Hz or a larger change_weight. It is of the models that decide."""
    cutoffs: list[float | None] = [12.345, None, 5.0, 5.0]
    monkeypatch.setattr(room, "workable_cutoff", lambda *_: cutoffs.pop(0))
    plant: Any = SimpleNamespace(vertices=(), exact_vertices=None, C=None, period=T)
    settings: Any = SimpleNamespace(filter_order=2, samples=100)
    law: Any = None

    def notes(update: Any, design: Any, exact: Any = None) -> list[str]:
        certificate = Certificate(design, exact, None, 0)
        return [*map(str, room._warnings(plant, law, certificate, update, settings))]

    grows = "the error can grow by a factor of "
    remedy = "; a zero-phase low-pass filter of 12.3 Hz or less on the learned signal prevents it"
    assert notes(Update(1, 0.5), found) == [f"design model: {grows}{told}{remedy}"]
    assert notes(Update(1, 0.5), found) == [f"design model: {grows}{told}"]
    optimal = Update(1, 0.0, 0.01)
    monkeypatch.setattr(room, "_calmer", lambda *_: 0.1)
    larger = "; change_weight = 0.1 prevents it"
    assert notes(optimal, found) == [f"design model: {grows}{told}{larger}"]
    assert notes(optimal, part(), found) == [f"exact model: {grows}{told}{larger}"]
    assert notes(optimal, found, part(monotone=True)) == [] and notes(None, found) == []
    shaking = "unstable along the trial at corner 2, with a pole of 1.235"
    unstable = part(stable=False, learning=None)
    assert notes(None, unstable) == [f"design model: {shaking}"]
    assert notes(None, part(), unstable) == [f"exact model: {shaking}"]


@pytest.mark.parametrize(
    ("N", "kind", "gain", "told"),
    [
        (
            2.0,
            "robust",
            -1.5,
            "N: 2: expected a number below zero: N must have the sign of the loop's gain at zero frequency",
        ),
        (
            -2.0,
            "robust",
            1.5,
            "N: -2: expected a number above zero: N must have the sign of the loop's gain at zero frequency",
        ),
        (2.0, "robust", 1.5, None),
        (-2.0, "state", 1.5, None),
        (None, "robust", 1.5, None),
        (-2.0, "robust", None, None),
    ],
)
def test_a_static_gain_points_where_the_loop_does(
    monkeypatch: pytest.MonkeyPatch, N: float | None, kind: str, gain: float | None, told: str | None
) -> None:
    def static_gain(*_: Any) -> float:
        if gain is None:
            raise DesignError("static_gain: none")
        return gain

    monkeypatch.setattr(room, "static_gain", static_gain)
    of: Any = (
        SimpleNamespace(nominal=None, C=None),
        SimpleNamespace(K_1=None),
        SimpleNamespace(N=N, kind=kind),
    )
    if told is None:
        room._check_sign(*of)
        return
    with pytest.raises(DesignError) as error:
        room._check_sign(*of)
    assert str(error.value) == told


FASTEST = (
    "K_3 was chosen by the frequency response. From one trial to the next it multiplies the error, "
    "at its worst frequency, by"
)


OTHER_SHIFT = "Rule (35) of Mandra 2019 is not used, since it is for a shift of 2"


FILTERED = "with the filter on the learned signal"


@pytest.mark.parametrize(
    ("cutoff", "filtered", "worst", "better", "note"),
    [
        (None, "error", 0.95, None, f"{FASTEST} 0.95. {OTHER_SHIFT}"),
        (30.0, "error", 0.8, None, f"{FASTEST} 0.8. {OTHER_SHIFT}"),
        (None, "error", 0.951, None, None),
        (30.0, "signal", 0.95, None, f"{FASTEST} 0.95 {FILTERED}"),
        (30.0, "signal", 0.951, None, None),
        (30.0, "signal", 0.8, (0.9, 4, 0.5),
            f"{FASTEST} 0.8 {FILTERED}, and near the trial's beginning or end by 0.9; shift = 4 gives 0.5"),
    ],
)  # fmt: skip
def test_a_gain_by_frequency_says_how_fast_it_is(
    monkeypatch: pytest.MonkeyPatch,
    cutoff: float | None,
    filtered: str,
    worst: float,
    better: Any,
    note: str | None,
) -> None:
    monkeypatch.setattr(room, "Bundle", Unseen)
    monkeypatch.setattr(room, "best_gain", lambda *of: (0.7 + len(of), worst))
    monkeypatch.setattr(room, "butterworth", lambda *_: Filter(np.ones(1), np.ones(1)))
    monkeypatch.setattr(room, "better_shift", lambda loops, r, q, shift, samples: better)
    plant: Any = SimpleNamespace(period=1e-3, relative_degree=2)
    settings: Any = SimpleNamespace(
        cutoff=cutoff, filtered=filtered, filter_order=2, samples=100, ends="even"
    )
    found = room._by_frequency([], plant, settings, 3)
    with_filter = 2.7 if cutoff and filtered == "signal" else 1.7
    assert (found and (found[0], str(found[1]))) == (None if note is None else (with_filter, note))
