"""What `cogless design` says of a law that learns chosen orders, against runs."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import studies
from cogless import changed, load
from cogless.design.closed_loop import Linear, Oscillation, Resonator, poles
from cogless.design.laws import pi_afc
from cogless.design.laws.pi_afc import OrderLoop
from cogless.design.learning_loop import Worst
from cogless.design.speed_loop import gains, pi_response, speed_loop
from cogless.design.unlearned import foreseen
from cogless.design.verdict import Verdict, verdict
from cogless.design.warnings import warnings
from cogless.run.simulate import simulate
from cogless.study import Study
from cogless.study.laws.pi_afc import PiAfc

Changes = dict[str, Any]
PERFECT: Changes = {
    "drive.position_sensor": {"kind": "ideal"},
    "drive.current_sensors": {},
    "drive.inverter.dead_time": "0 s",
    "mechanics.coulomb_friction": "0 N*m",
    "drive.guard": False,  # the law alone is judged
    "trace.rate": "5 kHz",
    "metric": [],
}
ORDERS = (12, 18, 24, 36, 54, 72, 90, 144)


def at(speed: str, law: Changes, duration: float = 5.0) -> Study:
    """The real motor on perfect sensors at one speed."""
    scenario = {"duration": f"{duration} s", "reference": speed, "initial_speed": speed}
    (name, table), *_ = studies.AFC.items()
    return load("uomodri", {**PERFECT, name: {**table, **law}, "scenario": {"s": scenario}})


def known(study: Study) -> Verdict:
    found = verdict(study, "pi-afc")
    assert found is not None
    return found


def amplitudes(study: Study, order: int, speed: float) -> np.ndarray:
    """Amplitude of an order of the speed in each revolution, rad/s."""
    trace = simulate(study, "s", "pi-afc").trace
    turns = np.floor(trace["time"] * speed)
    wave = (trace["omega_m"] - speed * math.tau) * np.exp(-1j * order * trace["theta_m"])
    return np.array([2 * abs(np.mean(wave[turns == n])) for n in np.unique(turns)[1:-1]])


def slope(found: np.ndarray) -> float:
    """Factor a revolution of what rises or falls."""
    return float(np.exp(np.polyfit(np.arange(len(found)), np.log(found), 1)[0]))


def test_an_order_grows_by_the_factor_that_is_foretold() -> None:
    """Without a lead, at 4 rev/s, 144 and 90 are turned by more than a quarter of their period."""
    study = at("4 rev/s", {"lead": "0 s", "orders": [18, 144]}, 4.0)
    found = known(study)
    assert found.kind == "grows" and found.worst is not None
    assert found.worst.frequency == pytest.approx(576, abs=1)
    assert slope(amplitudes(study, 144, 4.0)[2:10]) == pytest.approx(found.worst.factor, rel=0.03)
    assert found.in_words() in str(warnings(study, "s", "pi-afc")[0])


def test_an_order_settles_by_the_factor_that_is_foretold() -> None:
    """Of a ripple so small that the speed hardly swings."""
    study = at("1 rev/s", {"orders": [72], "gain": "0.3 A/rad"}, 8.0)
    study = changed(study, {"motor.cogging": [{"order": 72, "torque": "0.1 mN*m"}]})
    found = known(study)
    assert found.kind == "settles" and found.fine and found.worst is not None
    assert slope(amplitudes(study, 72, 1.0)) == pytest.approx(found.worst.factor, rel=0.03)


def test_the_lead_that_is_advised_settles_and_one_sample_less_does_not() -> None:
    without = at("4 rev/s", {"lead": "0 s"})
    repair = known(without).repair
    assert repair is not None and repair.lead is not None
    assert known(changed(without, {"controller.pi-afc.lead": repair.lead})).kind == "settles"
    less = changed(without, {"controller.pi-afc.lead": repair.lead - 2e-4})
    assert known(less).kind == "grows"


def test_too_large_a_gain_is_unstable_although_each_order_alone_would_settle() -> None:
    """Averaging doesn't see it: the poles do, and the run hits its limit."""
    small, large = (at("1 rev/s", {"gain": f"{gain} A/rad"}, 3.0) for gain in (10, 100))
    assert known(small).kind == "settles"
    found = known(large)
    assert found.kind == "unstable" and found.unstable is not None
    assert found.in_words().endswith('learning settles with gain = "25 A/rad"')
    trace = simulate(large, "s", "pi-afc").trace
    late = trace.window(2, 3)
    assert np.std(trace["omega_m"][late]) > 5
    steady = simulate(small, "s", "pi-afc").trace
    assert np.std(steady["omega_m"][steady.window(2, 3)]) < 0.01


def test_what_stays_is_foretold() -> None:
    """Of orders that aren't among the chosen, which resonators beside them amplify."""
    study = at("1 rev/s", {"orders": [54, 90], "gain": "5 A/rad"}, 8.0)
    off = changed(study, {"controller.pi-afc.learning_start": "1000 s"})
    left = [simulate(s, "s", "pi-afc").trace for s in (study, off)]
    ripples = [float(np.std(trace["omega_m"][trace.window(4, 8)])) for trace in left]
    assert known(study).ratio == pytest.approx(ripples[0] / ripples[1], rel=0.03)
    assert known(study).ratio > 1


@pytest.mark.parametrize(("share", "kind"), [(0.2, "may grow"), (0.9, "grows")])
def test_along_a_reference_the_mean_counts(share: float, kind: str) -> None:
    """Without a lead order 144 grows at 4 rev/s and settles at 1 rev/s: which of both is longer decides."""
    times = [0, 10 * (1 - share), 10 * (1 - share) + 0.2, 10]
    points = [[f"{t} s", f"{v} rev/s"] for t, v in zip(times, (1, 1, 4, 4), strict=True)]
    scenario = {"duration": "10 s", "reference": {"profile": points}}
    study = at("1 rev/s", {"lead": "0 s", "gain": "1 A/rad", "orders": [144]})
    study = changed(study, {"scenario": {"s": {**scenario, "initial_speed": "1 rev/s"}}})
    assert known(study).kind == kind


@pytest.mark.parametrize(  # of an observer that runs more often than the law, P leaves out the images
    ("sensor", "rel"),
    [
        ({}, 1e-6),
        ({"bandwidth": 900.0, "window": 0, "steps": 1}, 1e-6),
        ({"bandwidth": 900.0, "window": 0}, 1e-4),
    ],
)
def test_the_poles_are_those_of_resonators_beside_the_pi(sensor: dict[str, Any], rel: float) -> None:
    """det(z - A) with feedback over det(z - A) without is 1 + P (C + sum R); with counts, and an observer."""
    study = load("uomodri")
    loop, (kp, ki) = replace(speed_loop(study, "1-rev-s"), **sensor), gains(study, "pi")
    w = np.array([3.0, 100.0, 452.0, 900.0, 5000.0])
    z, T = np.exp(1j * w * loop.period), loop.period
    with_them, without = ([Resonator(gain, math.tau * h, 1e-3) for h in ORDERS] for gain in (20.0, 0.0))
    closed, opened = (
        poles(loop, Linear(ratio=1, k=kp, k_i=ki), with_them),
        poles(loop, Linear(ratio=1, k=0.0), without),
    )
    ratio = np.prod((z[:, None] - closed) / (z[:, None] - opened), axis=1)
    added = sum(each.response(w, T) for each in with_them)
    assert ratio == pytest.approx(1 + loop.plant(w)[0] * (pi_response(w, T, kp, ki) + added), rel=rel)


def test_where_nothing_is_learned_is_told() -> None:
    slow = at("1 rpm", {"omega_min": "2 rpm"})
    assert known(slow).kind == "rests"
    assert foreseen(slow, "s", "pi-afc") == "1 rpm is below omega_min"
    fast = at("10 rev/s", {"orders": [251, 260]})  # at 5 kHz
    assert known(fast).kind == "rests"
    assert foreseen(fast, "s", "pi-afc") == "order 251 has less than two samples at 10 rev/s"
    some = OrderLoop(at("10 rev/s", {"orders": [249, 251]}), "pi-afc", 10 * math.tau, scenario="s")
    assert some.orders.tolist() == [249] and some.frozen is None
    late = at("1 rev/s", {"learning_start": "9 s"})
    assert foreseen(late, "s", "pi-afc") == "learning_start is 9 s, but the run ends at 5 s"
    assert foreseen(at("1 rev/s", {}, 0.2), "s", "pi-afc") is None  # it needs no whole revolution


def test_leads_of_orders_settle_by_each_order_and_all_together() -> None:
    """Up to 30 samples of 50 ms."""
    own = {
        "unfiltered": lambda self, f, n: np.array([0.5, 1.0 if n == 3 else 0.9]),
        "_worst_with": lambda self, lead: Worst(1.1 if lead == pytest.approx(0.35) else 0.9, 7.0),
    }
    found = type("Leading", (Orders,), own)(orders().study, "x", 4.0)
    assert found.settling_leads() == {*range(31)} - {3, 7}


class Orders(OrderLoop):
    """Orders 2, 5 and 9 at 4 rad/s; the loop, at 20 Hz, lags by a quarter of a turn more every 4 Hz."""

    plant: Any = SimpleNamespace(period=0.05)
    feedback: Any = Linear(ratio=1, k=1.0)

    def closed(self, f: Any) -> Any:
        return np.exp(-2j * np.pi * np.asarray(f) / 16)


def orders(omega_m: float = 4.0, **more: Any) -> Orders:
    law = {"orders": (2, 5, 9), "omega_min": 0.5, "gain": 3.0, "lead": 0.0, **more}
    study = SimpleNamespace(
        controller={"x": PiAfc.model_construct(**law)}, motor=SimpleNamespace(pole_pairs=3)
    )
    return Orders(study, "x", omega_m)


def test_orders_with_more_than_two_samples_a_cycle_are_learned_by_their_averaged_factor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pi_afc, "speed_text", lambda study, speed: f"{speed:g} rad/s")
    here = orders()
    assert here.orders.tolist() == [2.0, 5.0, 9.0] and orders(7.0).orders.tolist() == [2.0, 5.0]
    second = 4.0 / math.tau
    assert here.frequencies == pytest.approx(np.array([2, 5, 9]) * second)
    for lead, time in ((None, 0.0), (3, 0.15)):
        f = np.array([1.0, 3.0, 10.0])
        seen = np.cos(2 * np.pi * f * (time - 1 / 16))
        expected = np.exp(-1.5 * seen / second)
        expected[2] = 1.0  # half the rate: too fast to be learned
        assert here.unfiltered(f, lead) == pytest.approx(expected)
    assert here.q(f).tolist() == [0.0] * 3 and here.recalled(f, True).tolist() == [1.0] * 3
    assert here.cells_per_second == 20.0 and here.gamma == (0.0, 0.0)
    assert orders(-4.0).frozen is None and orders(0.5).frozen is None
    assert orders(-0.4).frozen == "-0.4 rad/s is below omega_min"
    assert orders(32.0).frozen == "order 2 has less than two samples at 32 rad/s"


def test_growth_is_an_oscillation_only_if_no_order_grows_by_itself() -> None:
    def found(factor: float, grows: bool) -> Oscillation | None:
        own = {
            "_worst": Worst(factor, 7.0),
            "unfiltered": lambda self, f: np.array([0.9, 1.1 if grows else 1.0]),
        }
        return type("Known", (Orders,), own)(orders().study, "x", 4.0).oscillation()

    assert found(1.001, False) is None and found(1.5, True) is None
    shaking = found(1.5, False)
    assert shaking == Oscillation(7.0, pytest.approx(math.log(1.5) * 4.0 / math.tau))
