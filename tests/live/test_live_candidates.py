"""Sliders of keys and the values at which they are tried, number by number."""

import math
import struct
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar

import live_studies
import numpy as np
import pytest

from cogless.errors import StudyError
from cogless.live import keys
from cogless.live import own_motor as room
from cogless.live.candidates import (
    LINES,
    OF_REFERENCE,
    PLANT,
    YOURS,
    Candidate,
    candidates,
    key_candidate,
    looked_up,
    of_motor,
    shortest,
)
from cogless.live.description import Number, Packed
from cogless.study.table import Quantity
from cogless.units import TORQUE

# The ends of sliders, as shares of the study's value, and the last words of the keys that have them.
ENDS = {
    (0.3, 3): ("mechanics.inertia", "load_side.inertia", "stiffness"),  # what can't be zero
    (0, 3): (
        "coulomb_friction", "viscous_friction", "damping", "current", "torque", "torque_peak_to_peak",
        "percent", "percent_peak_to_peak", "d", "q", "latency", "eccentricity",
    ),
    (1, 3): ("breakaway_friction",),  # not below Coulomb's
    (0.5, 2): ("R_s", "resistance_line_to_line", "L_d", "L_q", "inductance_line_to_line"),
    (0.7, 1.3): ("psi_f", "K_t", "kv"),
    (0, 5): ("noise",),
    (8, 16): ("current_sensors.bits",),
    (8, 20): ("position_sensor.bits",),
    (0, 0): ("lines",),
    (-3, 3): ("offset.0", "offset.1", "offset.2", "gain_error.0", "gain_error.1", "gain_error.2"),
    (0, 4): ("dead_time",),
    (0.5, 1.5): ("bus_voltage",),
}  # fmt: skip


def test_each_key_of_the_plant_has_the_ends_of_its_quantity():
    words = {word: ends for ends, those in ENDS.items() for word in those}
    met, counts = set(), {}
    for _, key, *ends in PLANT:
        (word,) = (word for word in words if f".{key}".endswith(f".{word}"))
        assert tuple(ends) == words[word], key
        met.add(word)
        first, name, n, *_ = (*key.split("."), "", "")
        if first == "motor" and n:
            counts.setdefault(name, set()).add(int(n))
    assert met == words.keys()
    assert counts == {"cogging": set(range(12)), "torque_ripple": {0, 1}, "flux_harmonics": {0, 1, 2}}
    spans = {
        "speed": (0.1, 3),
        "ramp": (0.2, 3),
        "offset": (0.1, 3),
        "amplitude": (0, 2),
        "frequency": (0.3, 3),
    }
    assert {name: tuple(ends) for name, *ends in OF_REFERENCE} == spans


def test_an_encoders_lines_are_round_numbers_none_far_from_the_next():
    """Round: products of 2, 3 and 5. Each is larger than the one before by two thirds at most."""
    assert (LINES[0], LINES[-1]) == (64, 10_000)
    for n in LINES:
        for prime in (2, 3, 5):
            while n % prime == 0:
                n //= prime
        assert n == 1
    assert all(1 < after / before < 1.7 for before, after in pairwise(LINES))


class Owner:
    """A model with a number of each kind."""

    model_fields: ClassVar[dict[str, Any]] = {
        "torque": SimpleNamespace(metadata=[Quantity(TORQUE)], annotation=float),
        "positive": SimpleNamespace(metadata=[Quantity(TORQUE, ">")], annotation=float),
        "within": SimpleNamespace(
            metadata=[], annotation=tuple[Annotated[float, Quantity(TORQUE, ">")], ...]
        ),
        "plain": SimpleNamespace(metadata=[], annotation=float),
    }


def slider(value, span, field="plain", label="key"):
    """Low and high end, least and most of the field; None if it has no slider."""
    found = list(key_candidate("key", label, "Group", Owner(), field, value, span))
    return (found[0].low, found[0].high, found[0].least, found[0].most) if found else None


@pytest.mark.parametrize(
    ("value", "span", "field", "expected"),
    [
        ("4 mN*m", (0.5, 2), "torque", (2, 8, 0.02, 800)),
        ("4 mN*m", (0.0, 3), "torque", (0, 12, 0, 1200)),
        ("4 mN*m", (0.0, 3), "positive", (0.4, 12, 0.004, 1200)),  # not zero: a tenth at least
        ("4 mN*m", (0.3, 3), "positive", (1.2, 12, 0.012, 1200)),
        ("4 mN*m", (0.0, 3), "within", (0.4, 12, 0.004, 1200)),
        ("-4 mN*m", (-3, 3), "torque", (-12, 12, -1200, 1200)),
        ("-4 mN*m", (0.5, 2), "torque", (-8, -2, -800, -0.02)),
        ("1.23456 mN*m", (1, 3), "torque", (1.23456, 3.704, 0.01235, 370.4)),  # rounded to four digits
        ("4 mN*m", (-9, 9, "mN*m"), "torque", (-9, 9, -9, 9)),
        ("20 mN*m", (-9, 9, "mN*m"), "torque", (-9, 20, -9, 20)),
        ("-20 mN*m", (-9, 9, "mN*m"), "torque", (-20, 9, -20, 9)),
        ("0 mN*m", (0.5, 2), "torque", None),
        (0.5, (0.5, 2), "plain", (0.25, 1, 0.0025, 100)),
        (3, (0.0, 3), "plain", (0, 12, 0, 12)),  # a whole number
        (50, (0.0, 4), "plain", (0, 106, 0, 106)),
        (51, (0.0, 4), "plain", (12, 204, 12, 204)),
        (12, (8, 16), "plain", (8, 16, 8, 16)),  # bits are no shares
        (3, (1, 40, ""), "plain", (1, 40, 1, 40)),
        (True, (0.5, 2), "plain", None),
        ("text", (0.5, 2), "torque", None),
        ("4 mN*m", (0.5, 2), "plain", None),
        ([1.0], (0.5, 2), "plain", None),
        (1.0, (0.5, 2), "no field", None),
    ],
)  # fmt: skip
def test_a_slider_reaches_about_the_studys_value(value, span, field, expected):
    assert slider(value, span, field) == (expected and pytest.approx(expected, rel=1e-3))


def test_some_keys_have_sliders_of_their_own():
    assert slider(0.9, (0.0, 3), label="forgetting") == (0.5, 1, 0.5, 1)
    (found,) = key_candidate("key", "position_sensor.lines", "Group", Owner(), "plain", 777, (0.0, 0.0))
    assert (found.low, found.high, found.stops) == (64, 10_000, tuple(sorted((*LINES, 777))))
    (found,) = key_candidate("key", "label", "Group", Owner(), "torque", "4 mN*m", (0.5, 2), "low", "pi")
    assert (found.scenario, found.controller, found.whole, found.stops) == ("low", "pi", False, ())
    assert (found.unit, found.factor, found.start, found.si(2.5)) == ("mN*m", 1e-3, 4.0, 0.0025)
    (found,) = key_candidate("key", "label", "Group", Owner(), "plain", 0.5, (0.5, 2))
    assert (found.unit, found.factor, found.start) == ("", 1.0, 0.5)
    assert found.si(0.75) == found.study_value(0.75) == 0.75
    assert list(key_candidate("key", "label", "Group", None, "torque", "4 mN*m", (0.5, 2))) == []


def test_a_key_is_looked_up_in_the_model_and_in_the_file():
    """Of a list's number the owner is the one that has the list; of a list of tables it is the table."""
    ripple, sensors = SimpleNamespace(torque=1.0), SimpleNamespace(offset=[1.0, 2.0])
    here = SimpleNamespace(motor=SimpleNamespace(cogging=[ripple]), sensors=sensors)
    file = {"motor": {"cogging": [{"torque": "1 N*m"}]}, "sensors": {"offset": ["1 A", "2 A"]}}
    assert looked_up(here, file, "motor.cogging.0.torque") == (ripple, "torque", "1 N*m")
    assert looked_up(here, file, "sensors.offset.1") == (sensors, "offset", "2 A")
    assert looked_up(here, file, "sensors.offset.7") == (sensors, "offset", None)
    assert looked_up(here, {}, "motor.cogging.0.torque") == (ripple, "torque", None)
    for key in ("motor.cogging.1.torque", "motor.ripple.0.torque", "motor.cogging.x.torque"):
        assert looked_up(here, file, key)[0] is None and looked_up(here, file, key)[2] is None


def test_learning_may_begin_until_the_longest_run_of_its_law_ends(tmp_path):
    study = live_studies.study(tmp_path)  # runs of 2 s and of 1 s
    (found,) = (one for one in candidates(study) if one.label == "learning_start")
    assert found.key == "controller.pi-ilc.learning_start"
    assert (found.controller, found.scenario) == ("pi-ilc", None)
    assert (found.low, found.high, found.least, found.most, found.start) == (0, 2, 0, 2, 0)


def test_keys_of_ones_own_motor_are_named_without_their_table(tmp_path):
    found = {one.key: one.label for one in of_motor(live_studies.study(tmp_path))}
    assert found == {
        "motor.pole_pairs": "pole_pairs",
        "mechanics.inertia": "inertia",
        "motor.cogging.0.order": "cogging.0.order",
        "motor.cogging.0.torque": "cogging.0.torque",
        "drive.inverter.bus_voltage": "inverter.bus_voltage",
    }


@pytest.mark.parametrize(
    ("value", "text"),
    [(1e15, "1000000000000000.0"), (-1e15, "-1000000000000000.0"), (999999999999999.0, "999999999999999")],
)
def test_whole_numbers_below_a_million_billions_have_no_point(value, text):
    assert shortest(value) == text


def candidate(low, high, start=None, least=None, most=None, **more):
    start = low if start is None else start
    ends = {"least": low if least is None else least, "most": high if most is None else most}
    return Candidate(
        key="key",
        label="key",
        group="Group",
        unit="",
        factor=1.0,
        start=start,
        low=low,
        high=high,
        **ends,
        **more,
    )


def test_a_key_is_tried_all_over_its_slider_and_its_field():
    tried = keys.samples(candidate(2.0, 12.0))
    golden = (math.sqrt(5) - 1) / 2
    assert tried == pytest.approx([2 + 10 * (n * golden % 1) for n in range(1, 21)], rel=1e-6)
    assert keys.samples(candidate(0.0, 9.0, whole=True))[:3] == [
        round(9 * (n * golden % 1)) for n in (1, 2, 3)
    ]
    wide = keys._wide(candidate(2.0, 10.0, least=1.0, most=110.0))
    assert wide == pytest.approx([2, 1.1, 47, 110])  # the first is not tried


def test_stops_are_spread_evenly_with_the_studys_value_among_them():
    assert keys._grid(candidate(0.0, 20.0, start=3.3)) == sorted([*map(float, range(21)), 3.3])
    assert keys._grid(candidate(0.0, 1.0, start=0.5))[:3] == [0, 0.05, 0.1]
    assert keys._grid(candidate(1000.0, 1100.0, start=1000.0)) == [
        1000.0 + 10 * n for n in range(11)
    ]  # 3 digits
    assert keys._grid(candidate(0.0, 4.0, start=1.0, whole=True)) == [0, 1, 2, 3, 4]


def test_a_key_that_is_right_only_within_its_slider_has_no_wider_field():
    narrow = keys._of_slider(keys.Key(candidate(2.0, 10.0, least=1.0, most=110.0), {})).candidate
    assert (narrow.least, narrow.low, narrow.high, narrow.most) == (2, 2, 10, 10)


def packed(value, kind="d"):
    number = Number("x", 0, kind)
    data = np.array([value]).astype({"d": "<f8", "f": "<f4", "I": "<u4", "q": "<i8"}[kind]).tobytes()
    return number, Packed(data, (number,), ())


@pytest.mark.parametrize(
    ("kind", "start", "tried", "scale", "rounded"),
    [
        ("d", 3.0, 5.5, 1.0, False),
        ("d", 6.0, 11.0, 2.0, False),
        ("f", 6.0, 11.0, 2.0, False),
        ("q", 3000.0, 5500.0, 1000.0, False),
        ("I", 3001.0, 5501.0, None, False),
        ("q", 6.0, 11.0, 2.0, False),
        ("d", 9.0, 30.25, None, False),  # a square
        ("I", 750.0, 1375.0, 250.0, False),
    ],
)
def test_a_number_is_a_multiple_of_its_key_or_has_stops(kind, start, tried, scale, rounded):
    """Of a key that is 3 in the study and 5.5 as tried."""
    study = SimpleNamespace(drive=None)
    number, base = packed(start, kind)
    landing = keys._fitting(study, number, candidate(1.0, 9.0, start=3.0), 5.5, base, packed(tried, kind)[1])
    assert landing == (scale and keys.Landing(number, scale, rounded))


@pytest.mark.parametrize(("rate", "rounded"), [(1000, True), (4000, True), (2000, False)])
def test_a_time_is_a_whole_number_of_periods_of_the_law_or_the_current_loop(rate, rounded):
    study = SimpleNamespace(drive=SimpleNamespace(rates=SimpleNamespace(current_loop=4000, divider=4)))
    key = candidate(0.001, 0.03, start=0.0100003)
    numbers = [packed(float(round(x * rate)), "I") for x in (key.start, 0.0130004)]
    landing = keys._fitting(study, numbers[0][0], key, 0.0130004, numbers[0][1], numbers[1][1])
    assert landing == (keys.Landing(numbers[0][0], float(rate), True) if rounded else None)


# --- one's own motor

RATIO_ENDS = (1 / 30, 4.0)


def test_places_of_the_curve_are_chebyshevs_over_a_thirtieth_to_four_times():
    """All zeros of the 24th polynomial: cos(24 arccos x)."""
    low, high = math.log(1 / 30), math.log(4)
    x = (2 * np.array(room.nodes(RATIO_ENDS)) - low - high) / (high - low)
    assert len(x) == 24 and np.cos(24 * np.arccos(x)) == pytest.approx(np.zeros(24), abs=1e-11)
    assert np.all(np.diff(x) < 0)


@pytest.mark.parametrize("at", [-3.0, -1.0, 0.0, 1.3])
def test_between_the_places_the_curve_is_a_polynomial(at):
    def curve(x):
        return 2.0 + x - 0.5 * x**3

    places = room.nodes(RATIO_ENDS)
    assert room._between(places, [curve(x) for x in places], at) == pytest.approx(curve(at), rel=1e-12)
    assert room._between(places, [float(n) for n in range(24)], places[7]) == 7.0


@pytest.mark.parametrize(
    ("x", "start", "power"),
    [
        (4.0, 1.0, 2.0), (0.5, 1.0, -1.0), (0.0, 0.0, 0.0), (0.0, 1.0, math.nan), (1.0, 0.0, math.nan),
        (-4.0, 1.0, math.nan),
    ],
)  # fmt: skip
def test_a_power_is_how_often_a_number_doubles(x, start, power):
    assert room._power(x, start, 2.0) == pytest.approx(power, nan_ok=True)
    assert room._power(x, start, 1.0) == 0.0  # of a key that can't be changed


def test_a_power_shows_by_any_share():
    assert room._power(1.25**-2 * 3, 3.0, 1.25) == pytest.approx(-2)
    assert room._power(0.98**3 * 3, 3.0, 0.98) == pytest.approx(3)


def test_a_power_is_whole_within_a_hundred_thousandth():
    found = [room._is_whole(x) for x in (1.0, -2 + 0.9e-5, 1 + 1.1e-5, 0.5, math.nan, math.inf)]
    assert found == [True, True, False, False, False, False]


def test_a_number_is_a_product_of_powers_a_factor_for_the_pole_pairs_and_a_curve():
    about = {name: candidate(0.1, 100.0, start=start) for name, start in (
        ("a", 2.0), (room.RESISTANCE_KEY, 5.0), (room.INDUCTANCE_KEY, 7.0)
    )}  # fmt: skip
    about[room.POLE_PAIRS] = candidate(2.0, 5.0, start=4.0)
    own = room.OwnMotor({}, about, RATIO_ENDS, {})
    number = Number("x", 0, "d")
    plain = room.Product(number, 10.0, {"a": 2, room.RESISTANCE_KEY: -1})
    assert room.computed(plain, own, {}) == 10.0
    assert room.computed(plain, own, {"a": 6.0, room.RESISTANCE_KEY: 2.5}) == pytest.approx(10 * 9 * 2)
    by_pairs = room.Product(number, 10.0, {}, factors=(0.25, 0.5, 1.0, 4.0))
    assert [room.computed(by_pairs, own, {room.POLE_PAIRS: float(n)}) for n in (2, 5)] == [2.5, 40.0]
    assert room.computed(by_pairs, own, {}) == 10.0
    bent = room.Product(
        number, 10.0, {}, curve=tuple(1 + x for x in room.nodes(RATIO_ENDS))
    )  # of log(R_s / L)
    values = {room.RESISTANCE_KEY: 2.5, room.INDUCTANCE_KEY: 14.0}
    assert room.computed(bent, own, values) == pytest.approx(10 * (1 + math.log(0.25)))


def test_a_motor_is_tried_at_a_hundredth_to_a_hundred_times_its_values():
    """Where the study refuses such a value, one nearer to its own is tried, within the page's range."""
    by_key, _, _ = own_motor([], "")
    wide = {key.key: replace(key, least=0, most=math.inf) for key in by_key}
    own = room.OwnMotor({}, wide | {room.POLE_PAIRS: by_key[0]}, RATIO_ENDS, {})
    golden = (math.sqrt(5) - 1) / 2
    for n, reach in ((0, 1), (1, 1), (5, 1), (3, 0.25)):
        values = own.together(n, reach)
        shares = {key: values[key] / own.keys[key].start for key in KEYS}
        assert [np.log10(shares[key]) for key in ("motor.kv", "mechanics.inertia")] == pytest.approx(
            [reach * (4 * (golden * (k + 1) * (n + 1) % 1) - 2) for k in (3, 4)], abs=1e-5
        )
        ratio = shares[room.RESISTANCE_KEY] / shares[room.INDUCTANCE_KEY]
        assert ratio == pytest.approx((120 ** ((n + 0.5) / 12) / 30) ** reach, rel=1e-5)
        assert values[room.POLE_PAIRS] == round(4 + reach * (1 + 7 * n % 6 - 4))
    narrow = replace(own, keys=wide | {"motor.kv": replace(wide["motor.kv"], least=50.0, most=70.0)})
    narrow.keys[room.POLE_PAIRS] = by_key[0]
    assert {narrow.together(n, 1)["motor.kv"] for n in range(12)} >= {50.0, 70.0}


PLACE = ("low", "pi", "run")
KEYS = {
    room.POLE_PAIRS: (4.0, 1.0, 6.0), room.RESISTANCE_KEY: (2.0, 0.6, 6.0),
    room.INDUCTANCE_KEY: (1e-3, 3e-4, 3e-3),
    "motor.kv": (60.0, 20.0, 180.0), "mechanics.inertia": (4e-5, 1e-5, 1e-4),
    "drive.inverter.bus_voltage": (24.0, 8.0, 72.0),
}  # fmt: skip


def own_motor(formulas, formats):
    """The keys of one's own motor, numbers of these formulas, and the run with other values of some keys."""
    by_key = {
        key: Candidate(
            key=key,
            label=key,
            group=YOURS,
            unit="",
            factor=1.0,
            start=start,
            low=low,
            high=high,
            least=low,
            most=high,
            whole=key == room.POLE_PAIRS,
        )
        for key, (start, low, high) in KEYS.items()
    }
    numbers = tuple(Number(f"n{n}", 8 * n, kind) for n, kind in enumerate(formats))

    def described(values):
        at = {key: start for key, (start, *_) in KEYS.items()} | {one.key: x for one, x in values}
        data = bytearray(8 * len(numbers))
        for number, formula in zip(numbers, formulas, strict=True):
            x = formula(*at.values())
            struct.pack_into(
                f"<{number.format}", data, number.offset, x if number.format in "df" else round(x)
            )
        return {PLACE: Packed(bytes(data), numbers, ())}

    return list(by_key.values()), numbers, described


def test_numbers_of_a_motor_are_products_of_its_keys_powers():
    """And of a value for each number of pole pairs, and of a curve over R / L."""
    formulas = (
        lambda p, R, L, kv, J, bus: 3 * R / L,
        lambda p, R, L, kv, J, bus: 1e4 * J * kv**2 / p,
        lambda p, R, L, kv, J, bus: p,
        lambda p, R, L, kv, J, bus: bus * (1 + 1e-4 * R / L),
        lambda p, R, L, kv, J, bus: 7.0,
        lambda p, R, L, kv, J, bus: 5.0,
    )
    by_key, numbers, described = own_motor(formulas, "dfIfdQ")
    own = room.own_motor(described([]), described, by_key, lambda key: key)
    assert own.ends == RATIO_ENDS and {*own.turned} == {1, 2, 3, 4, 5, 6}
    first, second, pairs, bent = own.products[PLACE]
    assert (first.number, first.start, first.factors, first.curve) == (numbers[0], 6000.0, (), ())
    assert first.powers == {room.RESISTANCE_KEY: 1, room.INDUCTANCE_KEY: -1}
    assert second.powers == {"motor.kv": 2, "mechanics.inertia": 1}
    assert second.factors == pytest.approx([4 / p for p in range(1, 7)], rel=1e-6) and second.curve == ()
    assert (pairs.number, pairs.start, pairs.powers) == (numbers[2], 1.0, {})
    assert pairs.factors == (1, 2, 3, 4, 5, 6)
    assert bent.powers == {"drive.inverter.bus_voltage": 1} and bent.factors == ()
    assert bent.curve == pytest.approx(
        [(1 + 0.2 * math.exp(at)) / 1.2 for at in room.nodes(RATIO_ENDS)], rel=1e-5
    )


@pytest.mark.parametrize(
    ("formula", "kind"),
    [
        (lambda p, R, L, kv, J, bus: J + 1, "d"),
        (lambda p, R, L, kv, J, bus: J**0.5, "d"),
        (lambda p, R, L, kv, J, bus: R * bus + L, "d"),
        (lambda p, R, L, kv, J, bus: J * (1 + (kv > 150)), "d"),  # a product only near the study's values
        (lambda p, R, L, kv, J, bus: 1 + (kv > 150), "I"),
    ],
)
def test_a_number_that_is_no_product_is_refused(formula, kind):
    by_key, _, described = own_motor([formula], kind)
    with pytest.raises(
        StudyError,
        match=r"--own-motor: n0: the page cannot compute this number from the motor's values, since it is "
        r"no product",
    ):
        room.own_motor(described([]), described, by_key, lambda key: key)


REFUSALS = {
    "R / L of more than 1.5 times the study's": lambda p, R, L, kv, J, bus: R / L > 3000,
    "R / L of less than half the study's": lambda p, R, L, kv, J, bus: R / L < 1000,
    "any other R / L": lambda p, R, L, kv, J, bus: abs(R / L - 2000) > 1e-3,
    "five pole pairs or more": lambda p, R, L, kv, J, bus: p > 4,
    "two pole pairs": lambda p, R, L, kv, J, bus: p == 2,
    "a lower kv": lambda p, R, L, kv, J, bus: kv < 60,
    "a higher kv": lambda p, R, L, kv, J, bus: kv > 60,
    "a kv that is off by 10 %": lambda p, R, L, kv, J, bus: abs(kv / 60 - 1) > 0.1,
    "any other kv": lambda p, R, L, kv, J, bus: kv != 60,
    "a heavier rotor with more voltage": lambda p, R, L, kv, J, bus: J * bus > 3 * 4e-5 * 24,
}


@pytest.mark.parametrize("refusal", REFUSALS)
def test_what_the_study_refuses_narrows_the_range_of_its_key_alone(refusal):
    """The numbers stay the same products at all values that page and study accept."""
    formulas = (
        lambda p, R, L, kv, J, bus: 3 * R / L,
        lambda p, R, L, kv, J, bus: 1e4 * J * kv**2 / p,
        lambda p, R, L, kv, J, bus: p,
        lambda p, R, L, kv, J, bus: bus * (1 + 1e-4 * R / L),
    )
    by_key, _, free = own_motor(formulas, "dfIf")
    refused, study = REFUSALS[refusal], {key: start for key, (start, *_) in KEYS.items()}
    asked = []

    def described(values):
        if refused(*(study | {one.key: x for one, x in values}).values()):
            raise StudyError("no")
        return free(values)

    def narrow(key):
        asked.append(key.key)
        return replace(key, least=key.start, low=key.start)

    own = room.own_motor(described([]), described, by_key, narrow)
    same = {key.key for key in by_key if own.keys[key.key] == key}
    assert same >= KEYS.keys() - {room.POLE_PAIRS, "motor.kv"}  # R and L are narrowed by their ends alone
    assert (room.POLE_PAIRS not in same) == ("pole pairs" in refusal)
    assert asked == ["motor.kv"] * ("kv" in refusal and refusal != "a lower kv")
    (slow, fast), none = own.ends, "other R" in refusal
    assert (slow > 1 / 30) == (none or "less than" in refusal)
    assert (fast < 4) == (none or "more than" in refusal)
    assert slow <= 1 <= fast and (none or fast > 1.2)
    rng, base = np.random.default_rng(3), free([])[PLACE]
    for _ in range(50):
        values = {key: start * rng.uniform(0.5, 2) for key, start in study.items()}
        values[room.POLE_PAIRS] = float(rng.integers(min(own.turned), max(own.turned) + 1))
        values[room.INDUCTANCE_KEY] = values[room.RESISTANCE_KEY] / 2000 / rng.uniform(slow, fast)
        values["motor.kv"] = 60.0 if "any other kv" in refusal else values["motor.kv"]
        wanted = free([(key, values[key.key]) for key in by_key])[PLACE]
        products = {one.number: room.computed(one, own, values) for one in own.products[PLACE]}
        for number in wanted.numbers:
            mine = products.get(number, number.read(base.data))
            assert mine == pytest.approx(number.read(wanted.data), rel=1e-3 if none else 1e-6)
