"""The design of the trial law with an observer: the rule holds over the plants, and only for such plants."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.design.trials.gains import TrialSettings, design_trial
from cogless.design.trials.model import DesignError, Model
from cogless.design.trials.polytope import UncertainPlant, from_parameters
from cogless.design.trials.response import Bundle, butterworth
from cogless.design.trials.trial_observer import (
    OBSERVER_SHIFT,
    POLES,
    REMAINING_SHARE_MOST,
    SENSITIVITY_MOST,
    ObserverGains,
    _exact,
    design_observer,
    highest_cutoff,
    inverse,
)

PERIOD = 2.5e-3


def motor(low: float = 5.9e-4, high: float = 10.6e-4, friction: float = 1.4e-3) -> UncertainPlant:
    """A motor's angle with a range of inertia."""

    def model(ranged):
        J = ranged["J"]
        return [[0.0, 1.0], [0.0, -friction / J]], [0.0, 0.37 / J]

    return from_parameters(model, {"J": (low, high)}, [1.0, 0.0], PERIOD, "euler")


def settings(**changes) -> TrialSettings:
    same = TrialSettings(
        samples=400,
        Q=np.eye(3),
        R=1.0,
        gamma=np.ones(3),
        f=np.ones(3),
        g=0.1,
        kind="observer",
        structure="input",
        integral=False,
    )
    return replace(same, **({"filtered": "signal"} | changes))


def sensitivity(plant: UncertainPlant, gains: ObserverGains) -> float:
    """The largest |S|, from the response of each plant to a sine in v, sample by sample."""
    w = np.linspace(0.02, np.pi, 300)
    assert plant.exact_vertices is not None
    found = []
    for model in plant.exact_vertices:
        A, B, u_fb, _ = gains._loop_rows(model, plant.C)
        pencil = np.exp(1j * w)[:, None, None] * np.eye(len(A)) - A
        states = np.linalg.solve(pencil, np.broadcast_to(B, (len(w), *B.shape)))[:, :, 0]
        found.append(np.abs(1 + states @ u_fb).max())
    return float(max(found))


def test_the_rule_is_at_its_bounds() -> None:
    plant = motor()
    gains = design_observer(plant, None)
    assert 0.9 * SENSITIVITY_MOST < sensitivity(plant, gains) <= 1.003 * SENSITIVITY_MOST
    faster = design_observer(plant, gains.pole - 0.02)
    assert sensitivity(plant, faster) > SENSITIVITY_MOST
    cutoff = highest_cutoff(plant, gains, 2)
    # 25 responses, from half to twice the plants', at poles in hundredths from 0.95 to 0.05
    assert np.round(POLES, 9).tolist() == [n / 100 for n in range(95, 4, -1)]
    assert (gains.pole, gains.response, cutoff) == pytest.approx((0.33, 3.43542e-3, 38.9274), rel=1e-4)
    w = np.linspace(1e-3, np.pi, 800)
    assert plant.exact_vertices is not None
    loops = [gains.closed(model, plant.C) for model in plant.exact_vertices]
    keeps = np.abs(1 - Bundle(loops, OBSERVER_SHIFT)(w)).max(axis=0) * butterworth(cutoff, 2, PERIOD).gain(w)
    assert keeps.max() == pytest.approx(REMAINING_SHARE_MOST, rel=0.02)


@pytest.mark.parametrize(("far", "suits"), [(0.19, True), (0.21, False)])
def test_the_second_integrator_s_pole_may_be_a_fifth_away_from_one(far: float, suits: bool) -> None:
    here = Model(np.array([[1.0, 1.0], [0.0, 1 - far]]), np.array([[0.0], [1.0]]))
    plant: Any = SimpleNamespace(random=([], [here]), exact_vertices=(here,), exact_nominal=here)
    if suits:
        assert _exact(plant) == [here] * 3
        return
    with pytest.raises(
        DesignError, match=r"^nominal: expected a plant that integrates its input twice, such as"
    ):
        _exact(plant)


def test_the_feedforward_is_of_the_two_slowest_poles() -> None:
    """The mean of two second differences, and the damping times the first, over the plant's strength."""
    A = np.diag([-0.9, 0.2, 1.0, 0.95])
    plant: Any = SimpleNamespace(exact_nominal=Model(A, np.ones((4, 1))), C=np.array([0.0, 0.0, 0.1, 0.3]))
    found = inverse(plant)
    damping, strength = -np.log(0.95), (0.4 + 0.1 + 0.3 * 0.95) / 2
    num = np.array([0.5, damping - 0.5, -damping - 0.5, 0.5]) / strength
    assert found.num == pytest.approx(num) and found.den.tolist() == [1.0]
    assert (found.preview, found.method, found.kept_zeros) == (2, "inverse", ())


def test_a_smaller_range_allows_a_faster_loop() -> None:
    wide, narrow = design_observer(motor(), None), design_observer(motor(7e-4, 9e-4), None)
    assert narrow.pole < wide.pole


@pytest.mark.parametrize("J", [5.9e-4, 8e-4, 10.6e-4])
def test_a_trial_leaves_what_the_law_s_equation_says(J: float) -> None:
    """F = S (1 - beta cos^2(w / 2)) of a motor without friction."""
    plant = motor(J, J, 0.0)
    gains = ObserverGains(0.37 / 8e-4 * PERIOD**2, 0.4)
    assert plant.exact_nominal is not None
    A, B, u_fb, _ = gains._loop_rows(plant.exact_nominal, plant.C)
    w = np.linspace(0.05, 3.0, 60)
    F = 1 - Bundle([gains.closed(plant.exact_nominal, plant.C)], OBSERVER_SHIFT)(w)[0]
    for at, found in zip(w, F, strict=True):
        S = 1 + u_fb @ np.linalg.solve(np.exp(1j * at) * np.eye(len(A)) - A, B)[:, 0]
        assert found == pytest.approx(S * (1 - 8e-4 / J * np.cos(at / 2) ** 2), abs=1e-9)


def test_the_certificate_is_of_exactly_sampled_plants_and_contracts() -> None:
    design = design_trial(motor(), settings())
    found = design.certificate
    assert found.discretisation == "exact" and found.design.stable
    assert found.design.learning is not None and found.design.learning.contracting
    assert found.design.learning.norm <= REMAINING_SHARE_MOST * 1.001
    assert found.design.growth is not None and found.design.growth < 0.75
    assert design.notes == ()


def test_a_given_pole_and_cutoff_are_kept() -> None:
    design = design_trial(motor(), settings(pole=0.5, cutoff=20.0))
    assert design.gains.observer is not None and design.gains.observer.pole == 0.5
    assert design.gains.cutoff == 20.0
    assert (design.N, design.K_2, design.K_3, design.K_1.tolist()) == (1.0, 0.0, 1.0, [0.0, 0.0])
    assert not design.gains.integral and design.shift == 2
    same = butterworth(20.0, 2, PERIOD)
    assert design.q_filter is not None and np.array_equal(design.q_filter.b, same.b)


def test_its_feedforward_moves_the_nominal_plant_and_can_be_left_out() -> None:
    plant = motor()
    assert design_trial(plant, settings(feedforward=False)).feedforward is None
    ahead = design_trial(plant, settings(feedforward=True)).feedforward
    assert ahead is not None and plant.exact_nominal is not None and list(ahead.den) == [1.0]
    s = np.clip(np.arange(500) / 400, 0, 1)
    y_ref = s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    wanted = np.concatenate([np.zeros(20), y_ref, np.ones(20)])
    x, y = np.zeros((2, 1)), []
    for k in range(500):
        y.append(float(plant.C @ x[:, 0]))
        u = sum(ahead.num[j] * wanted[20 + k + ahead.preview - j] for j in range(len(ahead.num)))
        x = plant.exact_nominal.A @ x + plant.exact_nominal.B * u
    assert np.abs(np.array(y) - y_ref).max() < 5e-3


def lagging(ranged):
    """Integrates once, with a lag whose pole is k from z = 1."""
    return [[0.0, 1.0], [0.0, -ranged["k"] / PERIOD]], [0.0, 1.0]


@pytest.mark.parametrize("farthest", [0.3, 2.0])
def test_other_plants_are_refused(farthest: float) -> None:
    ranged = {"k": (0.5 * farthest, farthest)}
    with pytest.raises(DesignError, match="integrates its input twice"):
        design_observer(from_parameters(lagging, ranged, [1.0, 0.0], PERIOD, "euler"), None)


def test_a_plant_that_acts_the_other_way_is_refused() -> None:
    turned = replace(motor(), C=np.array([-1.0, 0.0]))
    with pytest.raises(DesignError, match="raises y"):
        design_observer(turned, None)
    with pytest.raises(DesignError, match="a continuous plant"):
        design_observer(replace(motor(), exact_vertices=None), None)


def test_a_range_that_no_pole_holds_is_refused() -> None:
    with pytest.raises(DesignError, match="expected ranges within which the observer"):
        design_observer(motor(1e-4, 1e-2), None)
    with pytest.raises(DesignError, match=r"with pole = 0\.05"):
        design_observer(motor(1e-4, 1e-2), 0.05)
