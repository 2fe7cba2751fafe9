"""The rule of `harmonic` and what the law sees of a ripple, part by part in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.design.laws import harmonic, harmonic_transfer
from cogless.design.laws.harmonic import (
    LEARNER_RATE_LEAST,
    Certificate,
    Certified,
    _acting,
    _bends,
    _halls,
    _least_rate,
    _speeds,
    _step,
    delay_of,
    least_base,
    main_order,
    rate_at,
)
from cogless.design.laws.harmonic_transfer import (
    _bands,
    _few,
    _shares,
    all_orders,
    at_speed,
    held_bands,
    is_held,
    plants,
    rate_bound,
    seen,
    turned,
)
from cogless.design.speed_loop import CurrentLoop, IdealLoop, SoftShaft, SpeedLoop
from cogless.study.csv_table import OverAngle
from cogless.study.laws.harmonic import ORDER_ANGLE_MOST, Harmonic, Learner
from cogless.study.motor import StepMotor
from cogless.study.position_sensor import Encoder, Hall, IdealSensor

RPM = math.pi / 30
TOLD = Learner(b=800.0, delay=0.0, step=0.0, base=2, bends=0, orders=3, fast=3, rate=5.0, rate_min=0.5)
LOOP = SpeedLoop(b=800.0, steps=1, window=0, current=IdealLoop(1e-3))
HALLS = Hall.model_construct(kind="hall", edges=4)


# What the law sees


@pytest.mark.parametrize(
    ("d", "powers"), [(0.0, [1.0]), (0.4, [0.6, 0.4]), (1.0, [0.0, 1.0]), (1.5, [0.0, 0.5, 0.5])]
)
def test_a_short_delay_is_shared_between_two_samples(d: float, powers: list[float]) -> None:
    z = np.exp(1j * np.array([0.3, 2.0]))
    assert _shares(d, z) == pytest.approx(sum(part * z**-n for n, part in enumerate(powers)))


def test_a_longer_delay_is_a_low_pass_of_the_same_mean() -> None:
    impulse = np.array([0.375 * 0.625**n for n in range(200)])  # of 5/3 samples
    z = np.exp(0.7j)
    assert _shares(5 / 3, z) == pytest.approx(np.sum(impulse * z ** -np.arange(200.0)))


def test_slow_orders_learn_from_the_mean_of_the_observer_s_z() -> None:
    """At rest that shows the current as it is; at a quarter of the rate each pole is 1 / (j - p)."""
    p = math.exp(-0.5)
    assert seen(np.exp(1e-6j), 0.1) == pytest.approx(1.0, abs=1e-5)
    of_e = -1 / (1j - p) ** 3
    assert seen(np.array(1j), 0.5106) == pytest.approx(of_e)
    for order in (0.1, 0.5105):
        assert seen(np.array(1j), order) == pytest.approx((1 - p) ** 3 * -0.5j * of_e)


def test_each_order_s_resonator_takes_back_what_the_law_assumes_of_its_delay() -> None:
    """R (1 - Z / z) at the order itself, for its positive and its negative frequency."""
    told, T, order = replace(TOLD, delay=0.7e-3), 1e-3, 0.3
    for om, turn in ((order + 1e-7, 1j), (-order + 1e-7, -1j)):
        z = np.exp(1j * np.array([om]))
        found = all_orders(told, np.array([order]), np.array([om]), T) * (1 - np.exp(turn * order) / z)
        assert found == pytest.approx(T / 2 * np.exp(turn * 0.7 * order) * _shares(0.7, z), rel=1e-5)
    two = [all_orders(told, np.array(some), np.array([0.5]), T)[0] for some in ([0.3, 0.8], [0.3], [0.8])]
    assert two[0] == pytest.approx(two[1] + two[2])


@pytest.mark.parametrize("orders", [[0.3], [0.7, 1.4]])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_at_the_largest_rate_the_loop_of_all_orders_passes_minus_one(
    orders: list[float], turn: float
) -> None:
    """And at a smaller one it doesn't, whether the plant is as the law assumes or later."""
    T, told, w = 1e-3, replace(TOLD, delay=0.4e-3), np.array(orders) / 1e-3
    bound = rate_bound(T, told, w) if not turn else rate_bound(T, told, w, lambda om: np.exp(-1j * om * turn))
    assert 0 < bound < math.inf
    om = np.union1d(np.linspace(1e-3, math.pi, 8000), np.add.outer(orders, np.geomspace(1e-4, 0.3, 200)))
    om = om * (1 + 1e-8)  # beside the orders themselves, where it is infinite
    R = all_orders(told, w * T, om, T)
    if turn:
        R = R * np.exp(-1j * om * (turn + 0.4)) / _shares(0.4, np.exp(1j * om))
    first, then = R[:-1], R[1:]
    on_axis = (first.imag * then.imag < 0) & (np.abs(np.diff(R)) * bound < 1)  # not through infinity
    share = first.imag / (first.imag - then.imag)
    furthest = np.min((first.real + share * np.diff(R.real))[on_axis])
    assert furthest * bound == pytest.approx(-1.0, rel=0.01)


def test_orders_must_converge_with_half_the_torque_or_the_inertia_before_a_soft_shaft_off() -> None:
    assert [each.b for each in plants(LOOP)] == [400.0, 800.0, 1200.0]
    soft = replace(LOOP, shaft=SoftShaft(2e-6, 4e-6, 10.0, 1e-3))
    found = plants(soft)
    assert [each.b for each in found] == pytest.approx([400, 800, 1200, 960, 800, 4800 / 7])
    assert [each.shaft.inertia for each in found[3:]] == pytest.approx([1e-6, 2e-6, 3e-6])


def test_the_time_between_hall_edges_depends_on_the_speed() -> None:
    found = at_speed(LOOP, 0.3, 4, -1.5)
    assert (found.edge, found.edges) == (pytest.approx(0.2), 4) and at_speed(LOOP, 0.0, 4, 1.5) is LOOP
    motor = SimpleNamespace(pole_pairs=5)
    drives = [SimpleNamespace(position_sensor=sensor) for sensor in (HALLS, IdealSensor.model_construct())]
    told = [_halls(SimpleNamespace(drive=drive, motor=motor)) for drive in drives]
    assert told == [(pytest.approx(math.tau / 30), 4), (0.0, 0)]


def test_gamma_is_turned_too_far_beyond_60_degrees_and_where_it_is_zero() -> None:
    found = turned(np.array([*np.exp(1j * np.radians([59, -59, 61, -61, 180])), 0.0]))
    assert found.tolist() == [False, False, True, True, True, True]


def test_a_band_reaches_from_the_last_good_point_before_it_to_the_first_after_it() -> None:
    om, bad = np.arange(1.0, 7.0), np.array([True, False, False, True, True, False])
    assert _bands(om, bad) == [(0.0, 2.0), (3.0, 6.0)]
    assert _bands(om, ~bad) == [(1.0, 4.0), (5.0, math.pi)]
    assert _bands(om, np.zeros(6, dtype=bool)) == []


def test_if_there_are_more_bands_than_the_law_can_keep_the_nearest_are_joined() -> None:
    """Nearest by the ratio of the edges on both sides of the gap."""
    bands = [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0), (8.0, 9.0)]
    assert _few(bands.copy()) == (1, 2, 3, 4, 5, 6, 8, 9)
    assert _few([*bands, (14.0, 15.0)]) == (1, 2, 3, 6, 8, 9, 14, 15)
    assert _few([*bands, (9.1, 15.0)]) == (1, 2, 3, 4, 5, 6, 8, 15)


def test_orders_within_a_band_or_at_its_edges_are_held() -> None:
    told = replace(TOLD, held=(0.1, 0.2, 0.5, 0.6))
    found = is_held(told, np.array([0.09, 0.1, 0.15, 0.2, 0.3, 0.5, 0.6, 0.61]))
    assert found.tolist() == [False, True, True, True, False, True, True, False]


def test_bands_are_where_any_plant_turns_an_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to the fastest order; frequencies near a resonance are looked at, too."""
    loop: Any = SimpleNamespace(period=1e-2, near=None)
    others = [SimpleNamespace(low=0.1, high=0.2), SimpleNamespace(low=0.18, high=0.3)]
    monkeypatch.setattr(harmonic_transfer, "plants", lambda loop: others)

    def gamma(plant: Any, told: Learner, pi: Any, w: Any) -> Any:
        return np.where((w * 1e-2 >= plant.low) & (w * 1e-2 <= plant.high), -1.0, 1.0) + 0j

    monkeypatch.setattr(harmonic_transfer, "gamma", gamma)
    pi: Any = None
    step = (ORDER_ANGLE_MOST / 1e-3) ** (1 / 1999)
    low, high = held_bands(loop, TOLD, pi, 0.0, 0, (1.0, 2.0))
    assert 0.1 / step < low < 0.1 and 0.3 < high < 0.3 * step
    loop.near = np.array([9.9999, 30.0001, 1e-3, 400.0])
    assert held_bands(loop, TOLD, pi, 0.0, 0, (1.0, 2.0)) == pytest.approx((0.099999, 0.300001))
    others[1].high = 3.0
    assert held_bands(loop, TOLD, pi, 0.0, 0, (1.0, 2.0))[1] == math.pi


def test_with_halls_each_order_is_judged_at_its_own_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Orders 2, 4 and 6 at 1 to 2 rad/s and 5 % beside these; edges that come slowly turn them here."""
    loop: Any = SimpleNamespace(period=0.05, near=None)
    monkeypatch.setattr(harmonic_transfer, "plants", lambda loop: ["one", "other"])
    monkeypatch.setattr(harmonic_transfer, "at_speed", lambda plant, sector, edges, omega: (plant, omega))

    def gamma(at: tuple[str, float], told: Learner, pi: Any, w: Any) -> Any:
        return np.where(at[1] < 1.2 if at[0] == "one" else at[1] > 2.05, -1.0, 1.0) * np.ones(len(w), complex)

    monkeypatch.setattr(harmonic_transfer, "gamma", gamma)
    pi: Any = None
    found = held_bands(loop, replace(TOLD, base=4, orders=2), pi, 0.3, 4, (1.0, 2.0))
    edges = [4 / 1.05, 4 * 1.2, 8 / 1.05, 8 * 1.2, 16 * 1.025, 16 * 1.05]
    assert found == pytest.approx(np.array(edges) * 0.05, rel=6e-3)


# The rule


def test_speeds_that_show_the_lowest_order_are_judged() -> None:
    """Above 1/1000 rad a sample; in the controller's scenarios, or in all of them if it has none."""
    ends = {"a": (0.0, 2.0), "b": (0.5, 3.0), "c": (9.0, 9.0)}
    scenarios = {key: SimpleNamespace(slowest=low, top_reference=top) for key, (low, top) in ends.items()}

    def found(keys: list[str], sampled: float) -> list[float]:
        study: Any = SimpleNamespace(scenario=scenarios, scenarios_of=lambda name: keys)
        return _speeds(study, "x", sampled)

    assert found(["a", "b"], 0.01) == [0.5, 3.0] and found([], 0.01) == [0.5, 9.0]
    assert found(["a", "b"], 1e-3 / 0.5) == [2.0, 3.0]
    assert found(["a"], 0.01) == [2.0] and found(["a"], 1e-5) == []


def test_orders_that_are_sure_act_up_to_the_fastest_and_the_others_while_they_are_slow() -> None:
    assert _acting(TOLD, 1.0, 0.3).tolist() == [2.0, 4.0, 6.0]
    assert _acting(TOLD, 1.0, ORDER_ANGLE_MOST / 4).tolist() == [2.0, 4.0] and not len(
        _acting(TOLD, 1.0, 1.4)
    )
    some = replace(TOLD, fast=1)
    assert _acting(some, -1.0, 0.3).tolist() == [2.0] and not len(_acting(some, 1.0, 1.4))
    assert _acting(some, 1.0, 0.51 / 4).tolist() == [2.0, 4.0]
    assert _acting(some, 1.0, 0.51 / 6).tolist() == [2.0, 4.0, 6.0]


def test_the_orders_that_act_share_a_sixteenth_a_sample() -> None:
    assert rate_at(TOLD, 1.0, 0.01) == pytest.approx(1 / (16 * 3 * 0.01))
    assert rate_at(replace(TOLD, rate=2.0), 1.0, 0.01) == 2.0
    assert rate_at(replace(TOLD, fast=1), 30.0, 0.01) == 5.0  # order 2 alone could have 6.25
    assert rate_at(TOLD, 1e4, 0.02) == pytest.approx(1 / (16 * 0.02))  # none acts


def test_an_ideal_current_loop_has_the_delay_that_it_is_given() -> None:
    assert delay_of(replace(LOOP, delay=0.4e-3)) == 0.4e-3


def test_a_current_loop_is_late_by_its_phase_less_half_its_period() -> None:
    """With kp = L / T_c and no resistance the current is its reference one period later."""
    at_once = replace(
        LOOP, steps=10, current=CurrentLoop(kp=20.0, ki=0.0, R=0.0, L=2e-3, period=1e-4, delay=0)
    )
    assert delay_of(at_once) == pytest.approx(0.5e-4)
    assert delay_of(replace(at_once, delay=3e-4)) == pytest.approx(3.5e-4)


def turning(orders: list[tuple[float, float]], **drive: Any) -> Any:
    """A study whose load has these orders and torques; `own` are harmonics of a scenario's own load."""
    waves = [SimpleNamespace(order=order, torque=torque) for order, torque in orders]
    none = SimpleNamespace(load=None)
    motor = drive.pop("motor", None)
    scenarios = {"plain": none, "own": SimpleNamespace(load=SimpleNamespace(harmonics=drive.pop("own", [])))}
    mechanics = SimpleNamespace(load=SimpleNamespace(harmonics=waves))
    return SimpleNamespace(
        mechanics=mechanics, scenario=scenarios, drive=SimpleNamespace(**drive), motor=motor
    )


@pytest.mark.parametrize(
    ("orders", "rate_min"),
    [
        ([], LEARNER_RATE_LEAST),
        ([(1, 0.1), (2, 0.0)], 3.0),  # ten times as fast as it turns; what has no torque doesn't count
        ([(1, 0.1), (2, 0.1)], 6.0),
        ([(1, 0.1), (3, 0.1)], 9.0),
        ([(1, 0.1), (4, 0.1)], 3.0),  # learned itself
        ([(1, 0.1), (3.5, 0.1)], 3.0),  # too fast to be followed
        ([(0.1, 0.1)], LEARNER_RATE_LEAST),
    ],
)
def test_learning_slows_down_to_what_a_turning_load_allows(
    orders: list[tuple[float, float]], rate_min: float
) -> None:
    told, T = replace(TOLD, base=4, rate=9.0), 1e-3
    assert _least_rate(turning(orders), told, 0.3, T) == pytest.approx(rate_min)
    shared = _least_rate(turning(orders), told, 0.3, 1 / (16 * 3 * 5.9))  # 5.9 1/s for each of three orders
    assert shared == (LEARNER_RATE_LEAST if rate_min == LEARNER_RATE_LEAST else pytest.approx(3.0))
    own = [SimpleNamespace(order=order, torque=torque) for order, torque in orders]
    assert _least_rate(turning([], own=own), told, 0.3, T) == pytest.approx(rate_min)


def test_a_sensor_s_error_is_learned_where_the_base_leaves_its_orders_free() -> None:
    fine, coarse = (Encoder.model_construct(kind="encoder", lines=lines) for lines in (3142, 3141))
    for sensor, orders, base, bends in (
        (fine, [(3, 1.0)], 5, 2),
        (fine, [], 4, 1),
        (fine, [], 3, 1),
        (fine, [], 2, 0),
        (fine, [(2, 1.0)], 5, 0),
        (coarse, [], 5, 0),
        (HALLS, [], 5, 0),
    ):
        assert _bends(turning(orders, position_sensor=sensor), base) == bends, (sensor, orders, base)


def test_a_table_of_the_sensor_s_error_tells_of_it_as_its_eccentricity_does() -> None:
    angle = np.arange(8) * math.pi / 4
    fine = Encoder.model_construct(kind="encoder", lines=4000, eccentricity=1e-4)
    fine._errors = OverAngle("error", tuple(angle), tuple(3e-3 * np.sin(2 * angle)))
    straight = np.sinc(2 / 8) ** 2  # what lines between eight points leave of order 2
    assert [abs(fine.wave(n)) for n in (1, 2)] == pytest.approx([1e-4, 3e-3 * straight], rel=1e-5)
    assert least_base(turning([], position_sensor=fine)) == 5
    fine._errors = OverAngle("error", tuple(angle), tuple(6e-4 * np.sin(angle)))
    assert least_base(turning([], position_sensor=fine)) == 3
    fine._errors = OverAngle("error", (0.0, 2.0, 4.0), (0.0, 1e-3, -1e-3))  # points enough for any order
    assert least_base(turning([], position_sensor=fine)) == 3
    fine._errors = None
    assert [least_base(turning([], position_sensor=each)) for each in (fine, HALLS)] == [1, 1]


def test_only_a_timed_angle_has_steps_that_the_law_knows() -> None:
    for method, filtered, step in (("MT", None, math.tau / 4000), ("M", None, 0.0), ("MT", 300.0, 0.0)):
        sensor = Encoder.model_construct(kind="encoder", lines=1000, speed_method=method)
        assert _step(turning([], position_sensor=sensor, speed_filter=filtered)) == pytest.approx(step)


def test_cogging_smain_order_is_that_of_poles_and_slots() -> None:
    """A step motor's phase has two places for each of a rotor's teeth, in two phases."""
    for motor, order in (
        (SimpleNamespace(pole_pairs=4, slots=9), 72),
        (SimpleNamespace(pole_pairs=4, slots=None), 6),
        (StepMotor.model_construct(teeth=50), 200),
    ):
        assert main_order(turning([], motor=motor), 6) == order


def test_a_speed_is_certified_by_its_worst_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Orders up to the first that a later sample turns; what is held counts as good, and is told."""
    on_time = {"one": [0.9, 0.5, -3.0, 0.3], "other": [0.8, 0.6, 0.9, 0.4]}
    late = {"one": [0.1, 0.2, -3.0, 0.0], "other": [0.1, 0.2, 0.1, 0.5]}
    monkeypatch.setattr(harmonic, "plants", lambda loop: list(on_time))
    monkeypatch.setattr(harmonic, "at_speed", lambda plant, sector, edges, omega: (plant, omega))
    monkeypatch.setattr(harmonic, "_halls", lambda study: (0.3, 4))
    monkeypatch.setattr(harmonic, "_swing", lambda study, name, omega: (0.1, None))
    bounds = [7.0, math.inf, 7.0, 7.0]
    monkeypatch.setattr(harmonic, "_rate_bound", lambda *of: bounds.pop(0))

    def gamma(at: tuple[str, float], told: Learner, pi: Any, w: Any, later: int) -> Any:
        assert at[1] == 1.5 and w.tolist() == [3.0, 6.0, 9.0, 12.0]
        return np.array((late if later else on_time)[at[0]]) + 0.7j

    monkeypatch.setattr(harmonic, "gamma", gamma)
    told, orders, none = replace(TOLD, held=(8.9e-3, 9.1e-3)), np.array([2.0, 4.0, 6.0, 8.0]), None
    found = harmonic._certified_at(none, "x", LOOP, told, none, orders, 1.5)
    assert found == Certified(
        omega_m=1.5, acting=8, gamma=0.3, late=6, held_orders=(6,), rate=5.0, most=7.0, slow=(), swing=0.1
    )
    late["one"][3] = 0.1
    further = harmonic._certified_at(none, "x", LOOP, told, none, orders, 1.5)
    assert (further.late, further.most) == (8, None)
    late["other"][0] = -0.1
    assert harmonic._certified_at(none, "x", LOOP, told, none, orders, 1.5).late == 0


@pytest.mark.parametrize(
    ("shaft", "bounds", "rate", "rate_min"),
    [
        (None, {}, 20.0, 0.7),
        ("soft", {1.0: 240.0, 3.0: 24.0}, 10.0, 0.7),
        ("soft", {1.0: 1.2, 3.0: 24.0}, 0.5, 0.5),
    ],
)
def test_the_rule_s_numbers_of_a_law(
    monkeypatch: pytest.MonkeyPatch,
    shaft: str | None,
    bounds: dict[float, float],
    rate: float,
    rate_min: float,
) -> None:
    """20 1/s at most; on a soft shaft the least bound of the judged speeds, with a margin of 2.4."""
    loop: Any = SimpleNamespace(period=1e-3, b=800.0, shaft=shaft)
    law = Harmonic.model_construct()
    asked: dict[str, Any] = {}
    of_part: dict[str, Any] = {
        "speed_loop": lambda study: loop,
        "_orders": lambda study, law: (4, 8, 13),
        "delay_of": lambda loop: 2e-4,
        "_step": lambda study: 1e-3,
        "_bends": lambda study, base: base // 2,
        "harmonic_gains": lambda study, name: "pi",
        "_halls": lambda study: (0.3, 4),
        "_speeds": lambda study, name, sampled: [1.0, 3.0] if sampled == 12e-3 else [],
        "_least_rate": lambda study, told, fastest, T: asked.update(fastest=(fastest, T)) or 0.7,
        "held_bands": lambda *of: asked.update(bands=of[2:]) or (0.1, 0.2),
        "_rate_bound": lambda study, loop, told, pi, omega: bounds[omega],
    }
    for name, part in of_part.items():
        monkeypatch.setattr(harmonic, name, part)
    study: Any = SimpleNamespace(controller={"x": law})
    found = harmonic._learner(study, "x")
    assert found == Learner(
        b=800.0,
        delay=2e-4,
        step=1e-3,
        base=4,
        bends=2,
        orders=3,
        fast=2,
        rate=rate,
        rate_min=rate_min,
        held=(0.1, 0.2),
    )
    assert asked == {"fastest": (3.0, 1e-3), "bands": ("pi", 0.3, 4, (1.0, 3.0))}
    monkeypatch.setattr(harmonic, "_speeds", lambda *_: [])
    still = harmonic._learner(study, "x")
    assert (still.rate, still.rate_min, still.held) == (20.0, LEARNER_RATE_LEAST, ())
    monkeypatch.setattr(harmonic, "_orders", lambda *_: (1, 200, 900))
    many = harmonic._learner(study, "x")
    assert (many.orders, many.fast, many.rate) == (128, 128, 20.0)
    monkeypatch.setattr(harmonic, "_orders", lambda *_: (9, 4, 4))
    few = harmonic._learner(study, "x")
    assert (few.orders, few.fast) == (1, 1)


def test_a_certificate_is_of_the_speeds_at_which_orders_act(monkeypatch: pytest.MonkeyPatch) -> None:
    """The main order tells that of a sensor's error."""
    speeds = [1.0, 2.0, 1e4]
    of_part: dict[str, Any] = {
        "learner": lambda study, name: TOLD,
        "harmonic_gains": lambda study, name: "pi",
        "speed_loop": lambda study: LOOP,
        "_speeds": lambda study, name, sampled: speeds if sampled == 6e-3 else [],
        "_certified_at": lambda study, name, loop, told, pi, acting, omega: (omega, acting.tolist()),
        "main_order": lambda study, base: 50,
    }
    for name, part in of_part.items():
        monkeypatch.setattr(harmonic, name, part)
    study: Any = None
    found = harmonic.certificate(study, "x")
    assert found.speeds == ((1.0, [2.0, 4.0, 6.0]), (2.0, [2.0, 4.0, 6.0]))
    assert (found.learner, found.period, found.straight) == (TOLD, 1e-3, None)
    assert found.fastest == pytest.approx(2.6 / 2e-3)
    monkeypatch.setattr(harmonic, "learner", lambda study, name: replace(TOLD, bends=1))
    assert harmonic.certificate(study, "x").straight == pytest.approx(0.5105 / 0.05)


def test_halls_show_orders_below_their_own() -> None:
    drive = SimpleNamespace(position_sensor=HALLS)
    for pairs, base, orders in (
        (15, None, (1, 14, 14)),
        (15, 3, (3, 14, 14)),
        (1, None, (1, 1, 1)),
        (4, 5, (5, 5, 5)),
    ):
        study: Any = SimpleNamespace(drive=drive, motor=SimpleNamespace(pole_pairs=pairs))
        law: Any = SimpleNamespace(base=base)
        assert harmonic._orders(study, law) == orders


# The certificate's words

SLOW = Certified(omega_m=10 * RPM, acting=6, gamma=0.656, late=4, held_orders=(4, 6), rate=5.0, most=None)
FAST = Certified(omega_m=200 * RPM, acting=4, gamma=-0.1, late=2, held_orders=(2,), rate=5.0, most=12.345)
FINE = Certificate(TOLD, 1e-3, (SLOW,), 300 * RPM, None)


def test_a_certificate_in_one_line() -> None:
    assert FINE.in_words() == (
        "learns orders 2, 4 and 6; at 10 rpm orders up to 6, except 2 orders from 4 to 6, with a learning "
        "rate of 5 1/s at first. Together they settle with any rate. If K_t/J is 50 % wrong, they still "
        "converge (least Re Gamma: 0.66; must be above 0). If a sample of delay is not in the model, orders "
        "up to 4 converge; "
        "learns up to 300 rpm"
    )
    both = replace(FINE, speeds=(replace(SLOW, held_orders=()), FAST), straight=50 * RPM)
    held = replace(both, learner=replace(TOLD, held=(0.01, 0.02, 0.1, math.tau / 10)))
    assert held.in_words() == (
        "learns orders 2, 4 and 6; at 10 rpm orders up to 6, with a learning rate of 5 1/s at first. "
        "Together they settle with any rate. If K_t/J is 50 % wrong, they still converge (least Re Gamma: "
        "0.66; must be above 0). If a sample of delay is not in the model, orders up to 4 converge; at 200 "
        "rpm orders up to 4, except 2, with a learning rate of 5 1/s at first. Together they settle with "
        "rates below 12.3 1/s. If K_t/J is 50 % wrong, they may not all converge (least Re Gamma: -0.10; "
        "must be above 0). If a sample of delay is not in the model, orders up to 2 converge; "
        "learns no order of a frequency from 1.59 to 3.18 or from 15.9 to 100 Hz; learns up to 300 rpm; "
        "learns an eccentric sensor's error up to 50 rpm"
    )
    slow = replace(FINE, speeds=(replace(SLOW, held_orders=(), slow=(2, 4), swing=0.64),))
    assert slow.in_words() == (
        "learns orders 2, 4 and 6; at 10 rpm orders up to 6, with a learning rate of 5 1/s at first. "
        "Together they settle with any rate. If K_t/J is 50 % wrong, they still converge (least Re Gamma: "
        "0.66; must be above 0). If a sample of delay is not in the model, orders up to 4 converge. Orders "
        "2 to 4 are too slow to be judged "
        "(uncertain, since the model is for small ripple: with the feedback alone the ripple is 64 % of "
        "the speed, rms); learns up to 300 rpm"
    )
    snaps = replace(SLOW, held_orders=(), slow=(2, 2), snaps="at 10 rpm it snaps")
    assert ". Order 2 is too slow to be judged" in replace(snaps, snaps=None).in_words()
    assert replace(FINE, speeds=(snaps,)).in_words() == "not judged: at 10 rpm it snaps"
    some = replace(FINE, speeds=(snaps, FAST))
    assert "; not judged: at 10 rpm it snaps; at 200 rpm orders up to 4" in some.in_words() and not some.fine
    assert (
        replace(FINE, speeds=()).in_words()
        == "not judged: all references are too slow, since even a wave of order 6 advances by less than "
        "0.001 rad "
        "a sample"
    )


def test_a_certificate_is_fine_if_all_orders_converge_and_settle_together() -> None:
    for changes, fine in (
        ({}, True),
        ({"speeds": (replace(SLOW, most=5.1),)}, True),
        ({"speeds": (replace(SLOW, most=5.0),)}, False),
        ({"speeds": (SLOW, FAST)}, False),
        ({"speeds": (replace(SLOW, gamma=0.0),)}, False),
    ):
        assert replace(FINE, **changes).fine == fine


def test_the_bound_on_the_rate_is_of_orders_that_are_not_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rigid plant is as the law assumes. With a soft shaft Gamma counts, a function of rad a sample."""
    monkeypatch.setattr(harmonic, "rate_bound", lambda *of: of)
    monkeypatch.setattr(harmonic, "gamma", lambda loop, told, pi, w: w)
    told, study, pi = replace(TOLD, held=(3e-3, 5e-3)), None, None
    T, _, w = harmonic._rate_bound(study, LOOP, told, pi, 1.0)
    assert T == 1e-3 and w.tolist() == [2.0, 6.0]
    soft: Any = SimpleNamespace(period=1e-3, shaft="soft", near="near")
    *_, plant, near = harmonic._rate_bound(study, soft, told, pi, 1.0)
    assert plant(0.2) == pytest.approx(200.0) and near == "near"
    none = replace(TOLD, held=(0.0, 3.0))
    assert harmonic._rate_bound(study, LOOP, none, pi, 1.0) == math.inf
