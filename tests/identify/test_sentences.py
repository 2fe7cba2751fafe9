"""What an estimate and a diagnosis say, word by word, from numbers that are made up."""

from __future__ import annotations

import json
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.commissioned import MOTORS
from identify.fits import fit_of
from report.curves import curves

from cogless.errors import StudyError
from cogless.identify import config, described, diagnosis, findings, plan, speed_alone, write
from cogless.identify.advice import Advice
from cogless.identify.balance import Rows
from cogless.identify.causes import Cause, OrderCauses
from cogless.identify.command import Identified, value_lines
from cogless.identify.config import Identification, LogRule
from cogless.identify.diagnosis import Diagnosis
from cogless.identify.jackknife import fit
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Value, Wave, wave_of
from cogless.identify.sessions import Session, sentences
from cogless.report import diagnosed, identified, svg
from cogless.results.trace import Trace

TURN = 2 * math.pi
DT = 1e-3


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Identification:
    """A servo with 4 pole pairs and 10,000 counts, whose K_t is 0.3 N m/A."""
    path = tmp_path_factory.mktemp("known") / "id.toml"
    servo = MOTORS["servo"]
    columns = {name: name for name in ("t", "theta", "omega", "i_q")}
    path.write_text(plan.to_toml({"columns": columns, "motor": servo["motor"], "drive": servo["drive"]}))
    return config.load(path)


def log(name: str = "one.csv", kind: Any = None, rows: int = 2000, dt: float = DT, **signals: Any) -> Log:
    made = {key: np.broadcast_to(np.asarray(x, dtype=float), rows) for key, x in signals.items()}
    return Log(name, LogRule(file="*", kind=kind), dt, made, (slice(0, rows),))


def turning(speed: float, rows: int = 2000, **more: Any) -> Log:
    """A log at a speed, rad/s."""
    return log(rows=rows, theta=speed * DT * np.arange(rows), **{"i_q": 0.1, **more})


def estimate(known: Identification, **values: Any) -> Estimate:
    logs = values.pop("logs", (turning(0.5),))
    empty = Estimate(known, tuple(logs), {}, (), (), (), {}, (), ())
    return replace(empty, **values)


def wave(order: int, size: float, error: float = 0.0, phase: float = 0.0) -> Wave:
    return Wave(order, Value(size, error), Value(phase, error))


# --- numbers with their errors


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.123456, 0.0, "0.1235 A"),
        (0.123456, math.inf, "0.1235 A"),
        (0.123456, 0.01, "0.123 +- 0.01 A"),
        (0.123456, 0.0123, "0.123 +- 0.012 A"),
        (0.123456, 0.13, "0.12 +- 0.13 A"),
        (-0.123456, 0.00012, "-0.12346 +- 0.00012 A"),
        (0.001, 5.0, "0.001 +- 5 A"),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value: float, error: float, text: str) -> None:
    assert write.value_text(Value(value, error), "A") == text
    assert write.value_text(Value(value, error)) == text.removesuffix(" A")


def test_a_wave_of_its_parts() -> None:
    """3 and 4 make 5; an error along it is one of its size, one across of its phase."""
    found = wave_of(6, Value(3.0, 0.5), Value(4.0, 0.25))
    assert found.size.value == 5.0 and found.phase.value == pytest.approx(math.atan2(3, 4))
    assert found.size.error == pytest.approx(math.hypot(3 * 0.5, 4 * 0.25) / 5)
    assert found.phase.error == pytest.approx(math.hypot(4 * 0.5, 3 * 0.25) / 25)
    theta = 0.3
    assert found.size.value * math.sin(6 * theta + found.phase.value) == pytest.approx(
        3.0 * math.cos(6 * theta) + 4.0 * math.sin(6 * theta)
    )
    assert Value(-2.0, 0.5).times(-3.0) == Value(6.0, 1.5)


def test_lines_of_an_estimate(known: Identification) -> None:
    """Over K_t in A, and times K_t; waves in the units of a datasheet."""
    made = estimate(
        known,
        values={"j": Value(1e-3, 1e-5), "offset": Value(0.02, 0.001), "c_hold": Value(0.1, 0.0)},
        cogging=(wave(24, 0.05, 0.001, math.pi / 6),),
        ripple=(wave(24, 0.02, 0.001, -math.pi / 2),),
        encoder=(wave(1, math.radians(0.1)),),
    )
    assert value_lines(made) == [
        "inertia over K_t               0.001 +- 1e-05 A*s^2/rad  inertia 0.0003 +- 3e-06 kg*m^2",
        "friction at rest over K_t      0.1 A",
        "offset of i_q, or a load       0.02 +- 0.001 A",
        "cogging, order 24              15 +- 0.3 mN*m, phase 30 +- 0.057 deg",
        "K_t ripple, order 24           2 +- 0.1 %, phase -90 +- 0.057 deg",
        "encoder's error, order 1       0.1 deg, phase 0 deg",
    ]


# --- what misleads


def test_a_current_that_follows_the_speed_before_is_a_feedback_law() -> None:
    speed = 6 + np.sin(0.1 * np.arange(2000))
    lag, correlation, gain = findings.feedback(log(omega=speed, i_q=-0.05 * np.roll(speed, 3))) or (0, 0, 0)
    assert (lag, correlation, gain) == (3, pytest.approx(1.0, abs=1e-3), pytest.approx(-0.05, rel=1e-2))
    assert findings.feedback(log(omega=speed, i_q=0.05 * speed)) is None  # it drives itself
    noise = np.random.default_rng(0).normal(0, 0.12 * np.std(speed), 2000)
    assert findings.feedback(log(omega=speed, i_q=-speed + noise)) is not None
    assert findings.feedback(log(omega=speed, i_q=-speed + 2 * noise)) is None
    assert findings.feedback(log(omega=speed, i_q=1.0)) is None
    assert findings.feedback(log(omega=speed, i_q=-speed, dt=0.0)) is None
    assert findings.feedback(log(i_q=-speed)) is None
    steps = np.random.default_rng(0).normal(size=2000)  # each is like no other
    for lag, found in ((5, 5), (6, None)):
        law = findings.feedback(log(omega=steps, i_q=-np.roll(steps, lag)))
        assert (law and law[0]) == found


@pytest.mark.parametrize(("fastest", "one"), [(1.0, True), (1.17, True), (1.19, False), (2.0, False)])
def test_speeds_that_differ_by_less_than_15_percent_are_one(fastest: float, one: bool) -> None:
    logs = [turning(1.0), turning(fastest)]
    assert findings.one_speed(logs) == findings.one_speed(logs[::-1]) == one


def test_one_speed_says_which_and_what_its_current_is() -> None:
    """The mean current in the direction of motion: friction and load together."""
    both = [turning(TURN, i_q=0.2), turning(-TURN, i_q=-0.1)]
    assert findings.said_of_one_speed(both) == (
        "The logs have only one speed (1 rev/s): inertia, friction and delay cannot be identified (its mean "
        "current, 0.15 A, is friction and load together); add an acceleration log and a second speed."
    )


def test_offsets_are_those_with_the_bridge_off() -> None:
    """The third phase carries what the others do, where nobody recorded it."""
    two = log(kind="bridge-off", i_a=0.02, i_b=-0.05)
    assert findings.offsets_of([turning(1.0), two]) == pytest.approx((0.02, -0.05, 0.03))
    three = log(kind="bridge-off", i_a=0.04, i_b=-0.05, i_c=0.1)
    assert findings.offsets_of([three]) == pytest.approx((0.04, -0.05, 0.1))
    assert findings.offsets_of([two, three]) == pytest.approx((0.03, -0.05, 0.1))
    assert findings.offsets_of([log(kind="load", i_a=0.1, i_b=0.1), log(kind="bridge-off", i_a=1.0)]) is None


def test_inertia_that_is_not_larger_than_its_error_takes_friction_along(known: Identification) -> None:
    told = {"b": Value(1.0, 0.1), "c": Value(1.0, 0.1), "delay": Value(1e-3, 1e-5), "offset": Value(0.1, 0.0)}
    for inertia, kept in ((2.01, True), (2.0, False)):
        left: list[str] = []
        made = findings.without_nonsense(estimate(known, values={"j": Value(inertia, 1.0), **told}), left)
        assert set(made.values) == ({"j", *told} if kept else {"offset"})
        said = (
            "Inertia is not larger than its error, so inertia, friction and delay cannot be "
            "identified; add an acceleration log."
        )
        assert left == [said] * (not kept)
        assert made.left_out == tuple(left)


@pytest.mark.parametrize(
    ("b", "kept", "said"), [(0.0, True, False), (-0.19, False, False), (-0.2, False, True)]
)
def test_a_negative_friction_is_left_out_and_told_where_it_stands_out(
    known: Identification, b: float, kept: bool, said: bool
) -> None:
    left: list[str] = []
    made = findings.without_nonsense(estimate(known, values={"b": Value(b, 0.1)}), left)
    assert ("b" in made.values) == kept
    negative = "Viscous friction comes out negative and is left out."
    assert left == [negative] * said


def test_an_order_of_the_pole_pairs_waits_for_the_bridge_to_be_off(known: Identification) -> None:
    both = (wave(4, 0.1), wave(24, 0.2))
    for offsets, orders in ((None, [24]), ((0.0, 0.0, 0.0), [4, 24])):
        left: list[str] = []
        made = findings.without_nonsense(estimate(known, cogging=both, offsets=offsets), left)
        assert [one.order for one in made.cogging] == orders
        told = (
            "Order 4 is the number of pole pairs: cogging and a current offset cannot be told apart; record "
            "currents with the bridge off."
        )
        assert left == [told] * (len(orders) == 1)


def test_orders_that_no_log_shows_are_named_with_the_speed_at_which_one_would(known: Identification) -> None:
    """By a kernel of 6 ms at 80 rad/s orders to 6 come through. No value goes for it."""
    values = {key: Value(1.0, 0.1) for key in ("j", "b", "c", "delay", "offset")}
    left: list[str] = []
    made = findings.without_nonsense(estimate(known, values=values, logs=(turning(80.0),)), left)
    assert set(made.values) == set(values)
    (line,) = left
    assert (
        line == "one.csv: orders are seen up to 6 at 13 rev/s, the slowest speed. A motor of 4 pole pairs "
        "may also cog at order 48. To see this order, turn at 1.5 rev/s."
    )
    just = 80 * 6.25 / 48  # what is advised has a tenth to spare
    assert isinstance(line, Advice) and line.cures[0]["record.speed"] == pytest.approx(0.9 * just)
    held: list[str] = []
    findings.without_nonsense(estimate(known, logs=(turning(80.0), log(dt=0.0, theta=0.0))), held)
    assert held == []


@pytest.mark.parametrize(("size", "order", "beside"), [(0.09, 23, True), (0.1, 23, False), (0.09, 22, True),
                                                       (0.09, 21, False), (0.09, 26, True)])  # fmt: skip
def test_a_small_order_beside_a_large_one_may_be_the_encoders(
    known: Identification, size: float, order: int, beside: bool
) -> None:
    """An error of order k and size eps turns n into n -+ k, each of half n eps."""
    left: list[str] = []
    made = findings.without_nonsense(estimate(known, cogging=(wave(order, size), wave(24, 0.2))), left)
    assert [one.order for one in made.cogging] == ([24] if beside else [order, 24])
    degrees = math.degrees(2 * size / (24 * 0.2))
    assert (
        left
        == [
            f"Order {order} may be cogging, or come from the larger order 24 by an encoder's error of order "
            f"{abs(order - 24)} ({degrees:.2g} deg), which distorts it; add a faster log."
        ]
        * beside
    )
    told = findings.without_nonsense(
        estimate(known, cogging=(wave(order, size), wave(24, 0.2)), encoder=(wave(1, 0.1), wave(2, 0.1))), []
    )
    assert len(told.cogging) == 2  # the error is known


def test_orders_on_both_sides_of_a_large_one_are_told_once(known: Identification) -> None:
    """The larger tells the angle. An order that is out puts no other out, and none is put out twice."""

    def beside(*errors: int, **sizes: float) -> tuple[list[int], list[str]]:
        left: list[str] = []
        waves = tuple(wave(int(name[1:]), size) for name, size in sizes.items())
        encoder = tuple(wave(order, 0.1) for order in errors)
        made = findings.without_nonsense(estimate(known, cogging=waves, encoder=encoder), left)
        return [one.order for one in made.cogging], left

    both = "may be cogging, or come from the larger order 24 by an encoder's error of order 1"
    told = "which distorts it; add a faster log."
    assert beside(n23=0.05, n24=0.2, n25=0.08) == (
        [24],
        [f"Order 23 and 25 {both} ({math.degrees(0.16 / 4.8):.2g} deg), {told}"],
    )  # fmt: skip
    orders, left = beside(n23=0.05, n24=0.2, n25=0.19)
    assert orders == [24, 25] and len(left) == 1
    orders, left = beside(2, n22=0.01, n23=0.09, n24=0.2)
    assert orders == [22, 24] and len(left) == 1


def test_held_angles_leave_ripple_of_k_t_open(known: Identification) -> None:
    """At the one load of 0.5 A, 10 % of K_t would be 0.05 A."""
    held = log(dt=0.0, theta=0.0, i_q=0.5)
    left: list[str] = []
    findings.without_nonsense(estimate(known, logs=(held,), cogging=(wave(24, 0.2),)), left)
    (line,) = left
    assert line.startswith("Order 24 is six times the pole pairs: K_t ripple and cogging cannot be told")
    assert "a ripple of 10 % would be 0 A of this order" in line  # no rows
    left.clear()
    rows = tuple(SimpleNamespace(y=np.array([y, y])) for y in (-0.5, 0.3))
    findings.without_nonsense(estimate(known, logs=(held,), cogging=(wave(24, 0.2),), rows=rows), left)
    assert left == [
        "Order 24 is six times the pole pairs: K_t ripple and cogging cannot be told apart at one load; a "
        "ripple of 10 % would be 0.04 A of this order; record logs with loads of both signs."
    ]
    left.clear()
    findings.without_nonsense(estimate(known, logs=(held, turning(0.5)), cogging=(wave(24, 0.2),)), left)
    assert left == []


def test_a_rotor_that_stands_still_without_slipping_should_turn_faster(known: Identification) -> None:
    """26 % of the windows of 20 ms are at rest in one piece; a quarter is still borne."""
    for share, said in ((0.25, None), (0.27, "27 %")):
        rows = np.arange(2000)
        still = round(share * 1980) + 20
        theta = DT * TURN * np.minimum(rows, 2000 - still)
        found = findings.usable(known, [log(theta=theta, i_q=0.1, kind="load")])[1]
        if said is None:
            assert found == []
        else:
            assert found == [
                f"one.csv: the rotor stands still {said} of the time, where friction is not known; "
                "turn faster, or with higher feedback gains."
            ]


def test_a_rotor_that_sticks_should_turn_as_fast_as_it_slips() -> None:
    """In each 100 ms it slips for 5 ms at 20 rev/s, so it moves in 24 windows of 20 ms; a count is no motion.

    From three slips on; a kernel sees order 24 of them with three rows a wave.
    """
    known: Any = SimpleNamespace(step=2**-10, motor=SimpleNamespace(pole_pairs=4))
    slips = np.cumsum((np.arange(2000) % 100 < 5) * DT * 20 * TURN)
    still = "one.csv: the rotor stands still"
    rest = "of the time, where friction is not known"
    assert findings._sticks(known, log(theta=slips)) == (
        f"{still} 77 % {rest}: the rotor sticks and slips at 20 rev/s; record at this speed or faster, with "
        "1500 rows a second or more, or with higher feedback gains."
    )
    slow = findings._sticks(known, log(theta=slips / 10))
    assert slow is not None and "slips at 2 rev/s; record at this speed or faster, with 1000 rows" in slow
    for rows, sticks in ((310, True), (210, False)):
        said = findings._sticks(known, log(theta=slips[:rows], rows=rows))
        assert said is not None and ("the rotor sticks" in said) == sticks
    counts = 2.0**-10 * (np.arange(2000) // 20)
    assert findings._sticks(known, log(theta=counts)) == (
        f"{still} 100 % {rest}; turn faster, or with higher feedback gains."
    )
    assert findings._sticks(known, log(theta=2 * counts)) is None


def test_signals_of_a_log_become_torques_of_the_motor(known: Identification) -> None:
    """A torque is over K_t, of 0.3 N m/A; no current flows where the rotor coasts."""
    torque = turning(0.5, torque=0.6)
    (made,), said = findings.usable(known, [torque])
    assert (made["torque"][0], made["i_q"][0], said) == (pytest.approx(2.0), 0.1, [])
    coasting = replace(torque, rule=LogRule(file="*", kind="coast-down"))
    (made,), _ = findings.usable(known, [coasting])
    assert np.array_equal(made["i_q"], np.zeros(2000))


def test_offsets_of_the_phases_are_taken_out_of_i_q(known: Identification) -> None:
    """A third of them in each phase is a wave of the electrical angle in i_q."""
    theta = 0.5 * DT * np.arange(2000)
    off = log(kind="bridge-off", i_a=0.03, i_b=-0.01, i_c=0.004)  # of which no angle is needed
    (made,), said = findings.usable(known, [off, log(theta=theta, i_q=0.1)])
    assert said == [
        "With the bridge off the phase currents show 30, -10, 4 mA; these offsets are taken out of i_q."
    ]
    offsets = zip((0.03, -0.01, 0.004), (0.0, TURN / 3, 2 * TURN / 3), strict=True)
    wave = sum(offset * np.sin(4 * theta - phase) for offset, phase in offsets)
    assert made["i_q"] == pytest.approx(0.1 + 2 / 3 * wave)


def test_a_log_with_the_bridge_off_tells_offsets_alone(known: Identification) -> None:
    """What turns its rotor is not known, be it a hand; one that stands still needs no sentence."""
    currents = {"i_a": 0.0, "i_b": 0.0}
    taken = "With the bridge off the phase currents show 0, 0, -0 mA; these offsets are taken out of i_q."
    turned = (
        "off.csv: this log gives only the currents' offsets, since with the bridge off it is not known what "
        "turns the rotor; if nothing turns it, give the log the kind coast-down."
    )
    for turns, said in ((0.0, [taken]), (0.99, [taken]), (1.01, [taken, turned])):
        off = log("off.csv", "bridge-off", theta=turns * TURN * np.linspace(0, 1, 2000), **currents)
        assert findings.usable(known, [off]) == ([], said)
    assert findings.usable(known, [log("off.csv", "bridge-off", theta=0.0)]) == (
        [],
        [
            "off.csv: the bridge is off, and there are no phase currents, so nothing can be "
            "identified from it; record i_a and i_b."
        ],
    )


def test_why_a_log_cannot_be_used(known: Identification) -> None:
    """A log shows order 24 up to an eighth of its sampling rate."""

    def said(*logs: Log) -> list[str]:
        return findings.usable(known, logs)[1]

    assert said(log(i_q=0.1)) == [
        'one.csv: no angle (no column "theta"): cogging cannot be placed; record the '
        "encoder's angle as theta."
    ]
    plain = known.model_copy(update={"columns": {}})
    bare = turning(0.5)
    del bare.signals["i_q"]
    assert findings.usable(plain, [bare])[1] == [
        "one.csv: no current: torque is not known; record i_q, or give the log the kind coast-down."
    ]
    for rate, turns in ((200.0, 1.01), (50.0, 0.99), (20_000.0, 3.0)):
        speed = turns * TURN * 200 / 8 / 24
        slow = log(theta=speed / rate * np.arange(2000), i_q=0.1, dt=1 / rate)
        assert said(slow) == []  # a rate is no reason to leave a log out
    speed = 6 + np.sin(0.1 * np.arange(2000))
    law = log(theta=np.cumsum(speed) * DT, omega=speed, i_q=0.3 - 0.05 * speed)
    used, (line,) = findings.usable(known, [law, turning(1.0)])
    assert [one.rule for one in used] == [law.rule] and used[0]["i_q"][0] == 0.1  # the plant alone
    assert line == (
        "one.csv: i_q follows the speed with a gain of 0.05 A*s/rad, 0 samples late (correlation 1.0000). "
        "So it shows the feedback law, and little of the motor; add an acceleration log."
    )


WRONG = {"j": -1e-3, "c": -0.1}


@pytest.mark.parametrize(
    ("motions", "refused"),
    [
        ([(3.0, 0.0)], True),
        ([(10.0, -1000.0)], True),  # what is stored is not braked
        ([(10.0, 0.0), (-0.1, 0.0)], False),  # an offset drives it, by the power
    ],
)
def test_a_current_that_brakes_what_turns_has_the_wrong_sign(
    known: Identification, monkeypatch: pytest.MonkeyPatch, motions: list[tuple[float, float]], refused: bool
) -> None:
    """Each motion is a speed and an acceleration; friction and inertia come out negative."""
    omega, alpha = (np.repeat(of, 16) for of in zip(*motions * (2 // len(motions)), strict=True))
    offset = 0.5 if len(motions) > 1 else 0.0
    y = WRONG["j"] * alpha + WRONG["c"] * np.sign(omega) + offset

    def check(j: float = 0.0, c: float = -0.51, kind: Any = None, rows: int = 31, dt: float = DT) -> None:
        one = log("a.csv", kind, dt=dt, theta=0.0)
        own = omega[:rows]
        made = Rows(one, (("j",),), alpha[:rows, None], y[:rows], {}, own, own, own)
        fitted = fit_of({("j",): WRONG["j"] if alpha.any() else j, ("c",): c}, 0.1)
        monkeypatch.setattr(findings, "fit", lambda rows: fitted)
        findings.check_sign(known, [one], [made])

    if refused:
        with pytest.raises(StudyError) as error:
            check()
        assert str(error.value) == (
            "a.csv: i_q: inertia and friction come out negative, as if the current braked the motor that it "
            'drives: expected the other sign: columns.i_q = { name = "i_q", sign = -1 }'
        )
    else:
        check()
    check(c=-0.49)  # within five standard errors
    check(rows=30)
    check(dt=0.0)
    for kind in ("load", "coast-down"):
        check(kind=kind)
    if not alpha.any():
        check(j=1e-3)


def test_sessions_differ_where_their_errors_do_not_reach() -> None:
    def session(name: str, c: float, error: float = 0.03, **more: Value) -> Session:
        return Session(name, (name,), {"c": Value(c, error), **more})

    alike = (session("a", 0.10), session("b", 0.14))
    assert sentences(alike) == []  # 0.04 against hypot(0.03, 0.03)
    assert sentences((session("a", 0.15), session("b", 0.10), session("c", 0.12))) == [
        "Sessions differ: friction 0.1 +- 0.03 A in b and 0.15 +- 0.03 A in a; the result for all logs lies "
        "between them; identify each session by itself, or warm the motor up first."
    ]
    offsets = session("a", 0.1, offset=Value(-0.2, 0.01)), session("b", 0.1, offset=Value(0.2, 0.01))
    assert sentences(offsets)[0].startswith("Sessions differ: offset of i_q -0.2 +- 0.01 A in a and")
    assert sentences((offsets[0], session("b", 0.1))) == []


# --- where the ripple comes from


def order_at(
    order: int, speed: float, *causes: Cause, ripple: float = 0.5, share: float = 0.9, load: float = 0.1
) -> OrderCauses:
    return OrderCauses(
        log=f"{speed:g}.npz",
        speed=speed,
        load=load,
        order=order,
        ripple=ripple,
        share=share,
        causes=causes or (Cause("cogging", 1.0, 0.1),),
    )


@pytest.mark.parametrize(
    ("causes", "confidence"),
    [
        ((), "open"),
        ((Cause("not explained", 0.9, 0.0),), "open"),
        ((Cause("cogging or dead time", 1.0, 0.0),), "cannot be told apart"),
        ((Cause("cogging", 1.0, 0.19),), "sure"),
        ((Cause("cogging", 1.0, 0.2),), "likely"),
        ((Cause("cogging", 1.0, 0.49),), "likely"),
        ((Cause("cogging", 1.0, 0.5),), "open"),
        ((Cause("cogging", 1.4, 0.0), Cause("not explained", -0.5, 0.0)), "sure"),
        ((Cause("cogging", 1.4, 0.0), Cause("not explained", -0.51, 0.0)), "open"),
    ],
)
def test_how_sure_a_cause_is(causes: tuple[Cause, ...], confidence: str) -> None:
    assert replace(order_at(24, 1.0), causes=causes).confidence == confidence


def test_an_order_falls_or_grows_with_speed() -> None:
    """By an exponent of a half, from a ratio of 1.5 on; what is small is in no sentence."""

    def said(fast: float, ripple: float, share: float = 0.9) -> list[str]:
        return speed_alone.sentences(
            [order_at(6, TURN), order_at(6, fast * TURN, ripple=ripple, share=share)]
        )

    assert said(2.0, 0.5 / 2**0.6) == [
        "The ripple of order 6 falls between 1 and 2 rev/s: a torque causes it, not the encoder."
    ]
    assert said(2.0, 0.5 * 2**0.6) == [
        "The ripple of order 6 grows between 1 and 2 rev/s: the encoder's error causes it, or a torque, "
        "whose ripple the controller reduces more at low speed; record i_q."
    ]
    assert said(2.0, 0.5 / 2**0.4) == said(2.0, 0.5 * 2**0.4) == []
    assert said(1.49, 0.1) == [] and said(1.5, 0.1) != []
    assert said(2.0, 0.1, share=0.05) == []


@pytest.mark.parametrize(("speed", "meets"), [(1.45, False), (1.55, True)])
@pytest.mark.parametrize(("off", "near"), [(1.02, True), (1.04, False)])
def test_orders_meet_at_one_frequency_within_3_percent(
    speed: float, meets: bool, off: float, near: bool
) -> None:
    order = 3100
    other = round(order / speed * off)
    found = speed_alone.sentences([order_at(order, 1.0), order_at(other, speed)])
    assert bool(found) == (meets and near)


def test_both_directions_of_a_log_are_one() -> None:
    """Shares of causes by the square of each one's ripple, that of the whole as a mean."""
    forth = order_at(6, 2.0, Cause("cogging", 1.0, 0.1), ripple=3.0, share=0.8)
    back = order_at(6, 2.0, Cause("encoder", 0.6, 0.0), Cause("cogging", 0.4, 0.2), ripple=4.0, share=0.6)
    other = order_at(3, 2.0, ripple=1.0, share=0.9)
    log = forth.log
    first, merged = diagnosis._merged([forth, back, other], {log: 5.0}, {log: 2})
    assert (first.order, first.ripple) == (6, pytest.approx(math.sqrt((9 + 16) / 2)))
    assert first.share == pytest.approx(0.5)
    assert (merged.order, merged.ripple) == (3, pytest.approx(math.sqrt(1 / 2)))  # in one of two parts
    assert merged.share == pytest.approx(0.02)
    merged = first
    cogging, encoder = merged.causes
    assert (cogging.name, encoder.name) == ("cogging", "encoder")
    assert cogging.share == pytest.approx((9 * 1.0 + 16 * 0.4) / 25)
    assert cogging.error == pytest.approx((9 * 0.1 + 16 * 0.2) / 25)
    assert encoder.share == pytest.approx(16 * 0.6 / 25)


def test_a_diagnosis_is_read_from_the_answer_down() -> None:
    slow = order_at(24, TURN, Cause("cogging", 0.9, 0.05), Cause("not explained", 0.1, 0.0), share=0.8)
    small = order_at(7, TURN, share=0.009)
    fast = order_at(1, 2 * TURN, Cause("encoder or mechanics", 1.0, 0.4), share=0.5, load=math.nan)
    made = Diagnosis("x", (slow, small, fast), {slow.log: 0.559, fast.log: 0.4}, ("Said.",))
    assert made.causes(slow.log) == pytest.approx(
        {"cogging": 0.729, "no order": 0.191, "not explained": 0.08}
    )
    heading = "log                  order  rad/s rms  of all  cause (share of the order), confidence"
    assert diagnosis.answer_lines(made) == [
        "Most of the ripple is cogging: 73 % of the ripple's square in 1 of 2 logs.",
        "",
        f"{slow.log} (1 rev/s, 0.1 A): 0.559 rad/s rms: cogging 73 %, no order 19 %, not explained 8 %",
        f"{fast.log} (2 rev/s): 0.4 rad/s rms: encoder or mechanics 50 %, no order 50 %",
        "",
        heading,
        f"{slow.log:<20}    24        0.5    80 %  cogging 90 +- 5 %, not explained 10 %: sure",
        f"{fast.log:<20}     1        0.5    50 %  encoder or mechanics 100 +- 40 %: cannot be told apart",
    ]
    plain = diagnosis.to_dict(made)
    assert plain["logs"][slow.log] == {
        "ripple_rad_per_s": 0.559,
        "motion_rad_per_s": 0.559,
        "noise_share_of_logged_speed": None,
        "shares": made.causes(slow.log),
    }
    assert plain["uses"] == {}
    assert [order["load_A"] for order in plain["orders"]] == [0.1, 0.1, None]
    assert plain["orders"][0]["causes"][0] == {"name": "cogging", "share": 0.9, "error": 0.05}
    assert (plain["orders"][0]["speed_rad_per_s"], plain["orders"][0]["ripple_rad_per_s"]) == (TURN, 0.5)
    assert plain["said"] == ["Said."]


def test_the_answer_has_a_span_where_logs_differ() -> None:
    def told(*found: OrderCauses) -> str:
        return diagnosis.answer(Diagnosis("x", found, {each.log: 1.0 for each in found}, ()))

    told_apart = order_at(6, 1.0, share=0.9), order_at(6, 2.0, share=0.6)
    assert told(*told_apart) == (
        "Most of the ripple is cogging: 60 to 90 % of the ripple's square in 2 of 2 logs."
    )
    assert "cogging: 90 % of the ripple's square" in told(
        order_at(6, 1.0, share=0.9), order_at(6, 2.0, share=0.895)
    )
    assert told(told_apart[0]).endswith("cogging: 90 % of the ripple's square in 1 log.")
    unclear = order_at(1, 1.0, Cause("encoder or mechanics", 1.0, 0.4))
    assert "is encoder or mechanics, which cannot be told apart here: 90 % of" in told(unclear)
    assert told(order_at(6, 1.0, share=0.1)) == (
        "Most of the ripple belongs to no order of the rotor that these logs can show, so it is vibration, "
        "or slow changes of the speed."
    )


@pytest.mark.parametrize(("first", "second", "opposed"), [(1.25, -0.25, True), (1.19, -0.19, False)])
def test_causes_that_oppose_each_other_are_told_beyond_a_fifth(
    first: float, second: float, opposed: bool
) -> None:
    two = Cause("cogging", first, 0.1), Cause("K_t ripple", second, 0.1)
    assert bool(diagnosis._opposed([order_at(42, 1.0, *two)])) == opposed
    assert diagnosis._opposed([order_at(42, 1.0, *two, share=0.009)]) == []
    assert bool(diagnosis._opposed([order_at(42, 1.0, *two, share=0.01)])) == opposed
    assert diagnosis._opposed([order_at(42, 1.0, two[0], Cause("K_t ripple", -0.2, 0.1))]) == []


def test_both_directions_of_a_log_are_one_by_their_squares() -> None:
    """Where one of them lacks a cause, its share and error are zero. The largest cause comes first."""
    one, two = Cause("cogging", 0.6, 0.1), Cause("cogging", 0.1, 0.1)
    forth, back = (
        order_at(6, 1.0, one, ripple=1.0),
        order_at(6, 1.0, two, Cause("encoder", 0.9, 0.4), ripple=2.0),
    )
    (merged,) = diagnosis._merged([forth, back], {forth.log: 2.0}, {forth.log: 2})
    assert [(cause.name, cause.share, cause.error) for cause in merged.causes] == [
        ("encoder", pytest.approx(0.72), pytest.approx(0.32)),
        ("cogging", pytest.approx(0.2), pytest.approx(0.1)),
    ]
    parts: Any = [
        SimpleNamespace(log=log(name), ripple=x) for name, x in (("a", 1.0), ("a", 7.0), ("b", 2.0))
    ]
    ripples = diagnosis._rms_by_log(parts, lambda part: part.ripple)
    assert ripples == {"a": pytest.approx(5.0), "b": 2.0}
    none = order_at(6, 1.0, one, Cause("encoder", 0.0, 0.1))
    assert set(Diagnosis("x", (none,), {none.log: 1.0}, ()).causes(none.log)) == {"cogging", "no order"}


def test_an_estimate_tells_the_torques_of_logs_that_turn_if_it_has_an_inertia(known: Identification) -> None:
    """Those of a rotor that turns with the bridge off, too, though no value is from its log."""
    logs = (turning(1.0), log("held", dt=0.0, theta=0.0))
    off = [log("off", "bridge-off", theta=1.0), log("blind", "bridge-off"), turning(1.0)]
    inertia = {"j": Value(1.0, 0.1)}
    explained = diagnosis._explained(
        estimate(known, logs=logs, values=inertia, fit=fit_of({("j",): 1.0})), off
    )
    assert list(explained) == ["one.csv", "off"] and not explained["off"]["i_q"].any()
    untold = estimate(known, logs=logs, fit=fit_of({("j",): 1.0}))  # not larger than its error
    for made in (None, estimate(known, logs=logs), untold):
        assert diagnosis._explained(made, off) == {}


def test_what_logs_without_angle_or_current_can_tell() -> None:
    whole = turning(1.0, omega=1.0)
    poor = log(omega=1.0)
    assert diagnosis._without([whole, log("off", "bridge-off", theta=0.0), log("c", "coast-down")]) == []
    assert diagnosis._without([poor]) == [
        "one.csv: no angle: the angle is the speed's integral, so the phase of an order on the rotor is "
        "unknown; record the encoder's angle as theta.",
        "one.csv: no current: the log shows how an order changes with the speed, but not which cause the "
        "order "
        "has; record i_q.",
    ]


def test_every_log_without_a_steady_part_says_what_it_is_used_for() -> None:
    logs = [turning(1.0), log("still.csv", dt=0.0), log("off.csv", "bridge-off"), log("poor.csv", omega=1.0)]
    assert diagnosis._uses(logs, {"one.csv"}, set()) == {
        "still.csv": "the rotor is held, so the log is used for the cogging",
        "off.csv": "the bridge is off, so the log is used only for the offsets of the phase currents",
        "poor.csv": "the log is not used: it has neither a turn at a steady speed nor known torques",
    }
    assert diagnosis._uses(logs[:1], set(), {"one.csv"}) == {
        "one.csv": "the log has no turn at a steady speed, so it is used for inertia, friction and "
        "orders, not for shares"
    }


def test_a_diagnosis_is_of_logs_whose_torque_is_known_and_of_speeds_beside_them(
    known: Identification, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """If no estimate can be made, it is of the speeds alone, and says why."""
    turned = TURN * DT * np.arange(2000)
    steady = {"omega": TURN, "theta": turned + 1e-2 * np.sin(24 * turned)}
    logs = [
        log("whole", **steady, i_q=0.1),
        log("held", dt=0.0, theta=0.0),
        log("off", "bridge-off", **steady),
        log("blind-off", "bridge-off", i_a=0.1, i_b=0.1),
        log("torqueless", **steady),
        log("blind", omega=TURN, i_q=0.1),
        log("short", "load", **steady, i_q=0.1),
    ]
    logs[-1] = replace(logs[-1], stretches=(slice(0, 15),))
    asked: list[list[str]] = []
    model = estimate(
        known,
        left_out=("Left.",),
        remarks=("Remark.", "Left."),
        fit=fit_of({("j",): 1.0}),
        values={"j": Value(1.0, 0.1)},
    )

    def estimated(known: Identification, logs: list[Log], progress: Any) -> Any:
        asked.append([one.name for one in logs])
        if told is None:
            raise StudyError("No.\nNever.")
        return replace(told, identification=known, logs=tuple(log for log in logs if "i_q" in log))

    monkeypatch.setattr(diagnosis.config, "load", lambda path: known)
    monkeypatch.setattr(diagnosis, "load_logs", lambda paths, known: logs)
    monkeypatch.setattr(diagnosis, "estimate_motor", estimated)
    monkeypatch.setattr(
        diagnosis, "attributed", lambda made, parts: [replace(order_at(24, 1.0), log="whole")]
    )
    monkeypatch.setattr(diagnosis.speed_alone, "by_order", lambda parts, poles: [])
    (tmp_path / "id.toml").touch()

    def diagnosed() -> Diagnosis:
        return diagnosis.diagnosed([], tmp_path / "id.toml", lambda *of: None)

    told: Any = model
    made = diagnosed()
    assert asked == [["whole", "held", "off", "blind-off", "short"]]
    assert set(made.whole) == {"whole", "off", "torqueless", "blind"} and len(made.orders) == 1
    assert made.remarks[:2] == ("Left.", "Remark.") and made.title == known.title
    reference = [
        line for line in made.remarks if line.startswith("Dead time disturbs the current at order 24")
    ]
    assert len(reference) == 1
    assert {"held", "blind-off", "short"} == set(made.uses)
    logs[0] = log("whole", **steady, i_q=0.1, i_q_ref=0.1)
    assert not any(line.startswith("Dead time disturbs") for line in diagnosed().remarks)
    told = None
    made = diagnosed()
    assert made.remarks[:2] == ("No.", "Never.") and made.orders == () and len(made.whole) == 4
    logs[:] = [log("off", "bridge-off", **steady), log("held", dt=0.0, theta=0.0)]
    asked.clear()
    assert list(diagnosed().whole) == ["off"] and asked == []  # nothing turns by a current
    logs[:] = [logs[1]]
    with pytest.raises(StudyError, match="no log turns at a steady speed for a revolution"):
        diagnosed()


def test_a_diagnosis_needs_its_files(tmp_path: Path) -> None:
    seen: list[tuple[str, float]] = []
    columns = tmp_path / "id.toml"
    with pytest.raises(StudyError) as error:
        diagnosis.diagnosed([tmp_path / "a.csv"], columns, lambda *of: seen.append(of))
    assert str(error.value) == f"{columns}: no such file: expected a TOML file that names the columns"
    servo = MOTORS["servo"]
    columns.write_text(
        plan.to_toml({"columns": {"t": "t"}, "motor": servo["motor"], "drive": servo["drive"]})
    )
    with pytest.raises(StudyError, match=r"a\.csv: "):
        diagnosis.diagnosed([tmp_path / "a.csv"], columns, lambda *of: seen.append(of))
    assert seen == [("reading", 0.0)]


# --- files that are written


def test_tables_become_toml_with_a_line_for_each_key() -> None:
    tables: dict[str, Any] = {
        "motor": {"pole_pairs": 4, "cogging": [{"order": 24, "torque": "1 mN*m"}]},
        "log": [{"file": "a"}, {"file": "b", "sign": -1}],
        "scenario": {"slow": {"duration": "1 s"}, "fast": {"duration": "2 s"}},
        "title": "Two logs",
        "orders": [1, 2],
        "none": [],
    }
    assert plan.to_toml(tables) == (
        'title = "Two logs"\norders = [1, 2]\nnone = []\n'
        '\n[motor]\npole_pairs = 4\ncogging = [{ order = 24, torque = "1 mN*m" }]\n'
        '\n[[log]]\nfile = "a"\n\n[[log]]\nfile = "b"\nsign = -1\n'
        '\n[scenario.slow]\nduration = "1 s"\n\n[scenario.fast]\nduration = "2 s"\n'
    )


def test_the_files_of_an_estimate_have_its_sentences_and_errors(
    known: Identification, tmp_path: Path
) -> None:
    made = estimate(
        known,
        values={"j": Value(1e-3, 1e-5), "c": Value(0.1, 0.01), "b": Value(-0.1, 0.2)},
        cogging=(wave(24, 0.05, 0.001, math.pi / 6),),
        ripple=(wave(24, 0.02, 0.001, math.pi / 2),),
        encoder=(wave(1, math.radians(0.1)), wave(2, 0.001)),
        loads={"one.csv": Value(0.5, 0.1)},
        remarks=("Remark.",),
        left_out=("Left.",),
    )
    found = write.to_dict(made)
    assert found["K_t_N_m_per_A"] == pytest.approx(0.3)
    assert found["values"]["j"] == {
        "about": "inertia over K_t", "unit": "A*s^2/rad", "value": 1e-3, "error": 1e-5
    }  # fmt: skip
    (cogging,), (ripple,), (once, _) = (found[k] for k in ("cogging", "torque_constant_ripple", "encoder"))
    assert cogging["amplitude_N_m"] == pytest.approx(0.015) and cogging["amplitude_error"] == pytest.approx(
        3e-4
    )
    assert (cogging["phase_rad"], cogging["phase_error"]) == (math.pi / 6, 0.001)
    assert ripple["amplitude"] == 0.02 and once["amplitude_rad"] == math.radians(0.1)
    assert found["loads_N_m"]["one.csv"] == pytest.approx({"value": 0.15, "error": 0.03})
    assert (found["logs"], found["sessions"], found["remarks"]) == (["one.csv"], {}, ["Remark."])
    write.write_all(made, tmp_path)
    motor = (tmp_path / "motor.toml").read_text()
    assert motor.startswith("# By cogless identify, from one.csv.\n# +-: error at 95 %.")
    assert tomllib.loads(motor) == described.motor(made)
    assert {path.name for path in tmp_path.iterdir()} == {
        "motor.toml", "identified.json", "study.toml", "cogging.csv", "cogging.bin"
    }  # fmt: skip
    (tmp_path / "little").mkdir()
    write.write_all(estimate(known), tmp_path / "little")
    assert {path.name for path in (tmp_path / "little").iterdir()} == {"motor.toml", "identified.json"}
    assert json.loads((tmp_path / "identified.json").read_text()) == json.loads(json.dumps(found))
    head = [line for line in motor.splitlines() if line.startswith("#")][2:]
    assert head == [
        "# Left.",
        "# Remark.",
        "# cogging, order 24: 15 +- 0.3 mN*m, phase 30 +- 0.057 deg",
        "# K_t ripple, order 24: 2 +- 0.1 %, phase 90 +- 0.057 deg",
    ]
    assert 'cogging = [\n  { order = 24, torque = "15 mN*m", phase = "30 deg" },\n]' in motor
    # 2 % of 0.05 Wb
    assert 'flux_harmonics = [\n  { order = 6, d = "1000 uWb", d_phase = "0 deg" },\n]' in motor
    study = (tmp_path / "study.toml").read_text()
    assert "# inertia over K_t: 0.001 +- 1e-05 A*s^2/rad; inertia 0.0003 +- 3e-06 kg*m^2\n" in study
    assert "# load of one.csv: 0.15 +- 0.03 N*m\n# encoder's error, order 1: 0.1 deg\n" in study
    assert 'eccentricity = "0.1 deg"' in study and "viscous_friction = " not in study
    assert 'coulomb_friction = "0.03 N*m"' in study and 'inertia = "0.0003 kg*m^2"' in study
    assert (
        '[scenario.steady]\nduration = "10 s"\nreference = "0.5 rad/s"\ninitial_speed = "0.5 rad/s"\n'
        in study
    )
    pi = 'law = "pi"\nbaseline = true\ntuning = { rule = "phase-margin", phase_margin = "60 deg" }\n'
    assert f"[controller.pi]\n{pi}" in study
    table = np.asarray(write.compensation(made).values).ravel()
    angle = TURN / 1024 * np.arange(1024)
    assert table == pytest.approx(-0.05 * np.sin(24 * angle + math.pi / 6), abs=1e-7)
    assert len(write.compensation(replace(made, cogging=(wave(129, 0.1),))).values.ravel()) == 8 * 129


# --- pages


def bars(page: str) -> dict[str, list[tuple[str, float]]]:
    """Colour and length, %, of the parts of each bar in a page, by the bar's heading."""
    rows = re.findall(r'<tr><th>([^<]+)</th><td class="wide"><div>(.*?)</div></td>', page)
    part = re.compile(r"--colour:([^;]+);width:([\d.]+)%")
    return {name: [(colour, float(width)) for colour, width in part.findall(bar)] for name, bar in rows}


def cells(page: str) -> list[list[str]]:
    """The rows of a page's tables."""
    rows = re.findall(r"<tr>(.*?)</tr>", page)
    return [[re.sub(r"<[^>]+>", "", c) for c in re.findall(r"<t[hd]>(.*?)</t[hd]>", row)] for row in rows]


def test_a_table_has_eight_cells_for_each_wave_of_its_highest_order(known: Identification) -> None:
    """But 1024 at least; its limit is the largest entry's, as a float holds it."""
    for orders, cells in (((24, 200), 1600), ((200, 24), 1600), ((24, 128), 1024)):
        made = estimate(known, cogging=tuple(wave(order, 0.1) for order in orders))
        table = write.compensation(made)
        assert (table.cells, table.units, table.law_name) == (cells, (1,), "anti-cogging")
        largest = float(np.max(np.abs(table.values)))
        assert largest <= table.limits[0] <= largest * (1 + 3e-7)


def test_bars_of_a_diagnosis_are_as_wide_as_the_shares() -> None:
    """All bars have the same length; a cause has its colour in all logs."""
    slow = order_at(24, TURN, Cause("cogging", 0.75, 0.05), Cause("encoder", 0.25, 0.0), share=0.8)
    fast = order_at(1, 2 * TURN, Cause("encoder", 1.0, 0.4), share=0.5, load=math.nan)
    small = order_at(7, TURN, share=0.009)
    made = Diagnosis("Two <logs>", (slow, small, fast), {slow.log: 0.559, fast.log: 0.7}, ("Said.",))
    page = diagnosed.render(made)
    assert page.startswith("<!doctype html>") and "<h1>Two &lt;logs&gt;</h1>" in page
    colours = {name: colour for colour, name in re.findall(r'--colour:(var\(--c\d\))">([^<]+)<', page)}
    assert [*colours.values()] == [f"var(--c{n})" for n in range(len(colours))]
    drawn = bars(page)
    assert [*drawn] == [slow.log, fast.log]
    for log, parts in drawn.items():
        shares = made.causes(log)
        assert [colour for colour, _ in parts] == [colours[name] for name in shares]
        whole = sum(shares.values())
        assert [length for _, length in parts] == pytest.approx(
            [100 * share / whole for share in shares.values()], abs=0.006
        )
    assert cells(page)[len(drawn) :] == [
        ["Log", "order", "speed", "load", "ripple, rms", "share of the square", "causes", "confidence"],
        [
            slow.log,
            "24",
            "1 rev/s",
            "0.1 A",
            "0.5 rad/s",
            "80 %",
            "cogging 75 +- 5 %, encoder 25 %",
            "likely",
        ],
        [fast.log, "1", "2 rev/s", "", "0.5 rad/s", "50 %", "encoder 100 +- 40 %", "likely"],
    ]
    assert "<li>Said.</li>" in page
    assert f"<li>{slow.log}: 0.559 rad/s rms</li>" in page
    more = replace(made, logged={slow.log: 1.0}, uses={"a": "holds the rotor"})
    page = diagnosed.render(more)
    says = (
        "the logged speed ripples by 1 rad/s rms; "
        "69 % of its square come from steps and noise of the measurement"
    )
    assert f"<li>{slow.log}: 0.559 rad/s rms, {says}<" in page
    assert "<li>a: holds the rotor</li>" in page
    assert "Nothing is left out." in diagnosed.render(replace(made, remarks=()))


def test_bars_of_an_estimate_are_as_long_as_the_waves(known: Identification) -> None:
    """The largest wave with its error has the whole length; the error is faint on both sides of the value."""
    made = estimate(
        known, values={"offset": Value(0.02, 0.001)}, cogging=(wave(24, 0.05, 0.01), wave(72, 0.03, 0.0)),
        encoder=(wave(1, math.radians(0.2)),), left_out=("Left.",),
    )  # fmt: skip
    page = identified.render(Identified(made, {}))
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings == ["Orders", "What was found", "What is left out, and what to record next"]
    drawn = bars(page)
    assert [[length for _, length in parts] for parts in drawn.values()] == [
        pytest.approx([100 * 4 / 6, 100 * 2 / 6], abs=0.006),
        pytest.approx([50, 0]),
        pytest.approx([100, 0]),
    ]
    assert [*drawn] == ["24", "72", "1"]
    assert all(parts[0][0] == "var(--c1)" and "var(--c1) 35%" in parts[1][0] for parts in drawn.values())
    assert "Cogging by mechanical order, with errors" in page and "K_t ripple" not in page
    assert "Encoder&#x27;s error by mechanical order" in page
    # 0.05 +- 0.01 A times 0.3 N m/A, in mN m
    assert [row[-1] for row in cells(page)[:3]] == ["15 +- 3 mN m", "9 mN m", "0.2 deg"]
    share = identified.render(Identified(estimate(known, ripple=(wave(6, 0.02, 0.005),)), {}))
    assert "K_t ripple by mechanical order" in share and "<td>2 +- 0.5 %</td>" in share
    assert bars(identified.render(Identified(estimate(known, ripple=(wave(6, 0.01, 0.03),)), {})))["6"] == [
        ("var(--c1)", 0.0), (identified.ERROR_COLOUR, 100.0)
    ]  # fmt: skip
    assert cells(page)[3] == ["Value", "with its error"]
    assert cells(page)[4] == ["offset of i_q, or a load", "0.02 +- 0.001 A"]
    empty = identified.render(Identified(estimate(known), {}))
    assert "Nothing could be identified." in empty and "<h2>Orders</h2>" not in empty


def test_a_replay_is_drawn_over_the_log_for_a_second_of_its_middle() -> None:
    """Three seconds: from 1 to 2 s, a point in each row; the simulated one has ten rows for each."""
    t = DT * np.arange(3000)
    measured = log(rows=3000, omega=5 + np.sin(TURN * t))
    fine = 1e-4 * np.arange(30000)
    trace = Trace(
        ("time", "omega_measured"), ("s", "rad/s"), np.column_stack([fine, 5 + 0.5 * np.sin(TURN * fine)])
    )
    page = identified._overlay(measured, trace, "omega", "omega_measured")
    title = "one.csv: 1 s of omega (rad/s). Standard deviation, simulated / measured: 0.50"
    assert f"<header>{title}</header>" in page and f'aria-label="{title}"' in page
    lines = curves(page)
    assert [colour for colour, _ in lines] == ["c0", "c2"]
    right = svg.PAGE_WIDTH - svg.RIGHT_MARGIN
    for (_, line), size in zip(lines, (1.0, 0.5), strict=True):
        assert line[:, 0] == pytest.approx(np.linspace(svg.LEFT_EDGE, right, 1001)[:-1], abs=0.06)
        high = (1 + size * np.sin(TURN * t[1000:2000])) / 2
        assert line[:, 1] == pytest.approx(svg.LOW_EDGE - (svg.LOW_EDGE - svg.TOP_EDGE) * high, abs=0.06)
    assert re.findall(r'text-anchor="end">([\d.]+)<', page) == ["4", "4.5", "5", "5.5", "6"]
    assert re.findall(r'text-anchor="middle">([\d.]+)<', page) == ["0", "0.2", "0.4", "0.6", "0.8", "1"]


def test_a_log_is_predicted_by_the_others(known: Identification) -> None:
    """Of a coefficient that is 1 in one log and 1.1 in the other, each misses the other's by 0.1."""
    x = np.sin(0.1 * np.arange(400))
    logs = [turning(1.0), replace(turning(1.0), name="two.csv", rule=LogRule(file="*", kind="load"))]
    rows = tuple(
        Rows(one, (("c",),), x[:, None], a * x, {}, x, x, np.arange(400))
        for one, a in zip(logs, (1.0, 1.1), strict=True)
    )
    found = fit(rows)
    assert (
        found["c",] == pytest.approx(1.05, abs=2e-3) and found.get("c") == found["c",] and found.get("j") == 0
    )
    assert found.prediction(rows[0], "one.csv") == pytest.approx(1.1 * x)
    assert found.noise["one.csv"] == pytest.approx(0.05 * np.sqrt(np.mean(x**2)), rel=0.1)
    page = identified.render(Identified(estimate(known, logs=tuple(logs), rows=rows, fit=found), {}))
    head, one, two = cells(page.split("What each log contributed")[1])
    assert head == ["Log", "kind", "rows", "not explained, rms", "error if predicted from the other logs"]
    miss = f"{1e3 * 0.05 * np.std(x):.2g}"
    assert one[:3] == ["one.csv", "not given", "2000"] and one[3].startswith(miss[:1])
    assert (one[4], two[4]) == ("10 % of its current", "9.1 % of its current")
    assert two[:3] == ["two.csv", "load", "2000"]
