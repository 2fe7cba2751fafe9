"""A design's decisions on either side of their bounds, and its rarer messages: poles, ranges, zeros."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.design import adrc, certificate, closed_loop, fastest, feedback, state_feedback, trial
from cogless.design.certificate import Gains, Update
from cogless.design.closed_loop import Linear, Oscillation, Resonator
from cogless.design.error import DesignError
from cogless.design.learning_gain import _impossible
from cogless.design.margins import UNSTABLE, Margins
from cogless.design.model import Model
from cogless.design.response import Loop
from cogless.study.controller import PiIlc, RobustIlc
from cogless.study.pi_afc import PiAfc
from cogless.study.space_controller import SpaceSpeed

T = 1e-3


# Poles


@pytest.mark.parametrize(
    ("poles", "grows"),
    [
        ([0.5, 1 + 0.9e-6], None),  # integrators, as rounding leaves them
        ([0.5, 1.5, -1.1], Oscillation(0.0, math.log(1.5) / T)),
        ([0.5, -1.2], Oscillation(500.0, math.log(1.2) / T)),
        ([1.1 * np.exp(0.3j), 1.1 * np.exp(-0.3j), 1.0], Oscillation(0.3 / math.tau / T, math.log(1.1) / T)),
    ],
)
def test_the_largest_pole_tells_how_a_loop_grows(
    monkeypatch: pytest.MonkeyPatch, poles: list[complex], grows: Oscillation | None
) -> None:
    monkeypatch.setattr(closed_loop, "poles", lambda loop, feedback: np.array(poles, complex))
    loop: Any = SimpleNamespace(period=T)
    found = closed_loop.oscillation.__wrapped__(loop, Linear(1, 1.0))
    assert (found is None) == (grows is None)
    if found is not None and grows is not None:
        assert (found.frequency, found.rate) == pytest.approx((grows.frequency, grows.rate))


def test_a_resonator_is_an_integrator_that_turns_with_its_order() -> None:
    """At dw from its order it is gain / (2 j dw), turned by the lead; at the order large, but finite."""
    one = Resonator(3.0, 200.0, 2e-3)
    beside = one.response(np.array([200.0 + 1e-4]), T)[0]
    assert beside * 1e-4j * 2 / 3.0 == pytest.approx(np.exp(0.4j), rel=2e-5)
    assert np.isfinite(one.response(np.array([200.0]), T)[0])
    assert abs(one.response(np.array([200.0]), T)[0]) > 1e8


@pytest.mark.parametrize(
    ("keys", "unstable", "said"),
    [
        (["a", "b"], {("b", 4.0)}, "feedback unstable, at 88 Hz in scenario b"),
        (["b"], {("b", 2.0)}, "feedback unstable, at 88 Hz"),
        (["a", "b"], {("c", 2.0)}, None),
    ],
)
def test_the_first_scenario_with_unstable_feedback_is_named(
    monkeypatch: pytest.MonkeyPatch, keys: list[str], unstable: set[tuple[str, float]], said: str | None
) -> None:
    monkeypatch.setattr(feedback, "feedback_of", lambda study, name, omega_m: omega_m)
    monkeypatch.setattr(feedback, "speed_loop", lambda study, key: key)
    grows = Oscillation(87.6, 3.0)
    monkeypatch.setattr(
        feedback, "oscillation", lambda key, speed: grows if (key, speed) in unstable else None
    )
    ends = SimpleNamespace(slowest=2.0, top_reference=4.0)
    study: Any = SimpleNamespace(scenarios_of=lambda name: keys, scenario=dict.fromkeys("abc", ends))
    assert feedback.unstable_feedback(study, "x") == said


def test_robust_ilc_s_feedback_has_an_integral_of_its_sliding_variable() -> None:
    law = RobustIlc.model_construct(b=20.0, c=30.0, eta=10.0, q=0.5, g=0.0, gamma=60.0)
    study: Any = SimpleNamespace(controller={"x": law})
    k, k_i = law.linear
    assert feedback.feedback_of(study, "x") == Linear(1, k, 0.0, k_i, 0.0, 3.0, 30.0)


# Speeds


@pytest.mark.parametrize(
    ("law", "top"),
    [
        (PiAfc.model_construct(orders=(4, 9)), math.pi * 1e3 / 4),
        (SimpleNamespace(), None),
    ],
)
def test_the_fastest_speed_that_is_learned(law: Any, top: float | None) -> None:
    rates = SimpleNamespace(outer_loop=1e3)
    study: Any = SimpleNamespace(controller={"x": law}, drive=SimpleNamespace(rates=rates))
    assert fastest.fastest(study, "x") == (None if top is None else pytest.approx(top))


def test_a_period_has_at_least_four_samples_and_four_leads_and_its_filter() -> None:
    """A map's filter does not count: its width is in cells, not in samples."""
    in_map = SpaceSpeed.model_construct(memory="map", q_half_width=40)
    line = PiIlc.model_construct(memory="time", q_half_width=40)
    short = PiIlc.model_construct(memory="time", q_half_width=2)
    assert [fastest.fewest_samples(in_map, lead) for lead in (0, 1, 3)] == [4, 4, 12]
    assert [fastest.fewest_samples(line, lead) for lead in (0, 20)] == [41, 80]
    assert fastest.fewest_samples(short, 0) == 4


# ADRC


@pytest.mark.parametrize(("edge", "omega_c"), [(0.3, 150.0), (0.9, 450.0), (2.0, 500.0)])
def test_bandwidths_are_the_largest_with_the_margin(
    monkeypatch: pytest.MonkeyPatch, edge: float, omega_c: float
) -> None:
    """Here the margin falls with the bandwidth. The observer has four times that, 2 rad a sample at most."""

    def margins(loop: Any, b: float, omega_c: float, omega_o: float) -> Margins:
        assert omega_o == 4 * omega_c and b == 7.0
        share = omega_c / 500.0
        return Margins(True, 1.0, 1.0 + edge - share, 2.0, 1.0) if share <= 0.95 or edge > 1 else UNSTABLE

    monkeypatch.setattr(adrc, "adrc_margins", margins)
    loop: Any = SimpleNamespace(period=T)
    find = adrc.bandwidths.__wrapped__
    assert find(loop, 7.0, 1.0) == pytest.approx((omega_c, 4 * omega_c))
    with pytest.raises(ValueError, match="expected a faster and better damped current loop"):
        find(loop, 7.0, 4.0)


# Plants that no gain holds


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


@pytest.mark.parametrize(
    ("zeros", "reason"),
    [
        (
            [-4.0],
            "the plant has a zero at z = -4, not inside the unit circle, and so the error grows for any gain",
        ),
        ([0.5, -1.25], "the plant has a zero at z = -1.25, not"),
        ([1.0 + 0.5j, 1.0 - 0.5j], "the plant has a zero at z = 1"),
        ([0.5], "the feedback leaves so much lag that the error grows for any gain from 0.25 of half the"),
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
    assert told.startswith(f"q_filter: no K_3 is stable along the trial: {reason}")
    assert " for any gain from 0.25 of half the sampling rate on; expected a zero-phase low-pass" in told
    if len(zeros) > 1 and np.imag(zeros[0]):
        assert "z = 1+0.5j, not" in told or "z = 1-0.5j, not" in told


# Certificates


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


# Notes of a trial's design


def part(**more: Any) -> Any:
    learning = SimpleNamespace(monotone=False, norm=more.pop("norm", 1.0), frequency=12.3456)
    own = {"stable": True, "worst": "corner 2", "radius": 1.23456, "growth": None, "with_filter": None}
    return SimpleNamespace(**{**own, "learning": learning, "phi_radius": 1.5, **more})


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (part(norm=1.25), "1.25 a trial at 12.35 Hz"),
        (part(norm=1 + 1e-9, growth=1.5), "1.5 a trial, from the ends of the trial"),
        (part(growth=1.5, with_filter=1), "1.5 a trial, from the ends of the filter"),
        (part(growth=1 + 0.9e-4), "1.5 a sample, by Phi's largest pole"),
        (part(phi_radius=None), "1 + 0.0e+00 a sample, by Phi's largest pole"),
    ],
)  # fmt: skip
def test_what_can_grow_is_told_with_what_prevents_it(
    monkeypatch: pytest.MonkeyPatch, found: Any, told: str
) -> None:
    """What helps is a filter of so many Hz or a larger change_weight. Each of two models has its own note."""
    cutoffs: list[float | None] = [12.345, None, 5.0, 5.0]
    monkeypatch.setattr(trial, "workable_cutoff", lambda *_: cutoffs.pop(0))
    plant: Any = SimpleNamespace(vertices=(), exact_vertices=None, C=None, period=T)
    settings: Any = SimpleNamespace(filter_order=2, samples=100)
    law: Any = None

    def notes(update: Any, design: Any, exact: Any = None) -> list[str]:
        return trial._warnings(plant, law, SimpleNamespace(design=design, exact=exact), update, settings)  # type: ignore[arg-type]

    grows = "the error can grow by a factor of "
    remedy = "; a zero-phase low-pass filter of 12.3 Hz or less on the learned signal prevents it"
    assert notes(Update(1, 0.5), found) == [f"design model: {grows}{told}{remedy}"]
    assert notes(Update(1, 0.5), found) == [f"design model: {grows}{told}"]
    optimal = Update(1, 0.0, 0.01)
    larger = "; a larger change_weight prevents it"
    assert notes(optimal, found) == [f"design model: {grows}{told}{larger}"]
    assert notes(optimal, found, found) == [f"exact model: {grows}{told}{larger}"]  # L is for this model
    assert len(notes(Update(1, 0.5), found, found)) == 2 and notes(None, found) == []
    shaking = "unstable along the trial at corner 2, with a pole of 1.235"
    unstable = part(stable=False, learning=None)
    assert notes(None, unstable, unstable) == [f"{kind} model: {shaking}" for kind in ("design", "exact")]


@pytest.mark.parametrize(
    ("N", "kind", "gain", "told"),
    [
        (2.0, "robust", -1.5, "N: 2: expected a number below zero, as the loop's gain at zero frequency is"),
        (-2.0, "robust", 1.5, "N: -2: expected a number above zero, as the loop's gain at zero frequency is"),
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

    monkeypatch.setattr(trial, "static_gain", static_gain)
    of: Any = (
        SimpleNamespace(nominal=None, C=None),
        SimpleNamespace(K_1=None),
        SimpleNamespace(N=N, kind=kind),
    )
    if told is None:
        trial._check_sign(*of)
        return
    with pytest.raises(DesignError) as error:
        trial._check_sign(*of)
    assert str(error.value) == told
