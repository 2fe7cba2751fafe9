"""One's own motor in a page: the controller is told, and all numbers are those of `cogless run --set`."""

import math
import random
import struct
from dataclasses import replace
from pathlib import Path

import live_studies
import numpy as np
import pytest
from browser import MISSING
from node import NO_ENGINE, NO_NODE, run_node
from test_live_page import sets_of, settle

from cogless.control_library import Status
from cogless.errors import StudyError
from cogless.live import own_motor, write
from cogless.live.candidates import MOTOR, of_motor
from cogless.live.description import page_runs
from cogless.live.keys import _changed, adjustable, packed
from cogless.live.live_page import data
from cogless.live.motor_classes import motor_classes
from cogless.report.speed_tracking import STATE_TIME_LEAST, missed
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.reading import changed

READ = """
const { described } = liveBytes(given.page);
const hex = (place, values) => Buffer.from(described(place, new Map(values)).data).toString("hex");
return given.values.map((values) => given.places.map((place) => hex(place, values)));
"""
MY_MOTOR = Path(__file__).parents[2] / "examples" / "my_motor.toml"
REAL = {"f": 3e-7, "d": 1e-12}  # relative


@pytest.fixture(scope="module")
def own():
    """The playground's own motor: the study of the tutorial, which learns every order."""
    study = changed(load(MY_MOTOR), {"controller.harmonic.base": 1})
    return study, live_studies.found(study, for_own_motor=True)


@pytest.fixture
def small_study(tmp_path):
    return live_studies.study(tmp_path)


def test_a_motors_numbers_can_be_changed_for_plant_and_controller(own):
    _, found = own
    keys = {key.candidate.key: key.candidate for key in found.keys}
    for name in (
        "motor.pole_pairs",
        "motor.resistance_line_to_line",
        "motor.inductance_line_to_line",
        "motor.kv",
        "mechanics.inertia",
        "motor.cogging.0.order",
        "motor.cogging.0.torque",
    ):
        assert keys[name].group == "Your motor"
    assert not [name for name in keys if "override" in name and ("motor." in name or "inertia" in name)]
    # uomodri's motor, and a servo's inertia a hundred times as large, are within the fields
    assert keys["motor.pole_pairs"].least <= 12 <= keys["motor.pole_pairs"].most
    assert keys["mechanics.inertia"].least <= 6e-6 and keys["mechanics.inertia"].most >= 4e-3
    paths = {one.number.path for one in found.own_motor.products["slow", "harmonic", "run"]}
    assert {"controller.config.b", "controller.config.pi.kp", "drive.control.foc.kp_q"} <= paths


def test_gains_of_which_the_motor_already_decides_are_left_out(own):
    _, found = own
    same = "another key of the page already sets the numbers that this key changes"
    assert found.left_out == [("controller.pi.tuning.phase_margin", same), ("controller.harmonic.base", same)]


def test_a_motors_sliders_are_from_a_third_to_three_times_the_studys_value(own):
    """Pole pairs and orders from 1 to as many as a page has numbers for."""
    study, _ = own
    keys = {one.key: one for one in of_motor(study)}
    assert tuple(keys) == MOTOR and {one.group for one in keys.values()} == {"Your motor"}
    assert {one.key: (one.least, one.low, one.high, one.most) for one in keys.values() if one.whole} == {
        "motor.pole_pairs": (1, 1, 40, 40),
        "motor.cogging.0.order": (1, 1, 400, 400),
        "motor.cogging.1.order": (1, 1, 400, 400),
    }
    for one in keys.values():
        if not one.whole:
            ends = [end / one.start for end in (one.least, one.low, one.high, one.most)]
            assert ends == pytest.approx([0.003, 0.3, 3, 300], rel=1e-3)


@pytest.mark.parametrize("off", [1 - 1e-5, 1 + 1e-5])
def test_a_product_that_is_not_what_the_design_gives_is_told(own, off):
    """As is a number that moves and has no product."""
    study, found = own
    base = packed(study, page_runs(study))

    def changes(values):
        return _changed(study, values)

    place = ("slow", "pi", "run")
    kept = found.own_motor.products[place]
    (kp,) = [one for one in kept if one.number.path == "controller.config.kp"]
    others = [one for one in kept if one is not kp]
    for wrong in (others, [*others, replace(kp, start=off * kp.start)]):
        bent = replace(found.own_motor, products={**found.own_motor.products, place: wrong})
        with pytest.raises(
            StudyError,
            match=r"controller\.config\.kp: the page cannot .* powers \(\S+ as a product, \S+ "
            r"by the",
        ):
            own_motor._check(base, changes, bent)


def same_numbers(folder, study, found, sets):
    """How many of these values the study takes; the page has the numbers of each, and all else, too."""
    keys = {key.candidate.key: key.candidate for key in found.keys}
    places = list(packed(study, page_runs(study)))
    given = {
        "page": data(study, found, "cogless run x"),
        "places": ["/".join(place) for place in places],
        "values": [list(values.items()) for values in sets],
    }
    made = run_node(folder, ("bytes.js",), READ, given)
    tried = 0
    for values, pages in zip(sets, made, strict=True):
        try:
            other = changed(study, {name: keys[name].study_value(x) for name, x in values.items()})
        except StudyError:  # such as a motor that the integration step is too long for
            continue
        tried, wanted_of = tried + 1, packed(other, page_runs(other))
        for place, page in zip(places, pages, strict=True):
            blob, mine = wanted_of[place], bytes.fromhex(page)
            for number in blob.numbers:
                wanted, x = number.read(blob.data), number.read(mine)
                assert x == pytest.approx(wanted, rel=REAL.get(number.format, 0), abs=0), (number, values)
            clean = bytearray(mine)
            for number in blob.numbers:  # what is no number is the same, too
                size = struct.calcsize(number.format)
                clean[number.offset : number.offset + size] = blob.data[number.offset : number.offset + size]
            assert bytes(clean) == blob.data
    return tried


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_any_motor_gives_the_numbers_of_set(tmp_path, own):
    study, found = own
    rng, sets = random.Random(5), []
    for _ in range(25):
        values = {
            "motor.pole_pairs": float(rng.randint(1, 40)),
            "motor.kv": float(f"{58 * 10 ** rng.uniform(-1, 1.5):.3g}"),
            "mechanics.inertia": float(f"{4e-5 * 10 ** rng.uniform(-2, 2):.3g}"),
            "motor.resistance_line_to_line": float(f"{5.6 * 10 ** rng.uniform(-2, 1):.3g}"),
            "drive.inverter.bus_voltage": float(rng.randint(10, 60)),
            "motor.cogging.0.order": float(rng.randint(1, 400)),
        }
        slow = 2.3 * values["motor.resistance_line_to_line"] / 5.6 * 10 ** rng.uniform(-0.5, 1.4)
        sets.append(values | {"motor.inductance_line_to_line": float(f"{slow:.3g}")})
    assert same_numbers(tmp_path, study, found, sets) > 12


TAKEN = {
    # L / R of 387 us, and a step of 50 us: an inductance of a quarter is too small for it
    "a step of an eighth of L / R": {"motor.inductance_line_to_line": "2.168 mH"},
    "a slow current loop": {
        "drive.rates": {"current_loop": "10 kHz", "speed_loop": "2 kHz"},
        "drive.current_loop.bandwidth": "500 Hz",
        "motor.inductance_line_to_line": "4.6 mH",
    },
    "orders of the electrical revolution": {  # too fast for the rows from 34 pole pairs on
        "trace.rate": "5 kHz",
        "metric.0.kind": "order",
        "metric.0.order": [150],
        "metric.0.frame": "electrical",
    },
    "a law of 1 kHz": {"drive.rates.speed_loop": "1 kHz"},
    "a law of 2 kHz": {"drive.rates.speed_loop": "2 kHz"},
    "a law of 2 kHz that learns every order": {
        "drive.rates.speed_loop": "2 kHz",
        "controller.harmonic.base": 1,
    },
}


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
@pytest.mark.parametrize("name", TAKEN)
def test_a_study_that_run_takes_has_a_page_for_ones_own_motor(tmp_path, name):
    """What the page tries and the study refuses narrows what the page takes; the speed can be changed."""
    study = load(MY_MOTOR, TAKEN[name])
    found = live_studies.found(study, for_own_motor=True)
    keys = {key.candidate.key: key for key in found.keys}
    speed, rng, sets = keys["scenario.slow.reference"], random.Random(8), []
    (slow, fast), start = found.own_motor.ends, {key: one.start for key, one in found.own_motor.keys.items()}
    for _ in range(25):
        values = {
            key: float(f"{start[key] * 2 ** rng.uniform(-1, 1):.3g}")
            for key in (
                "motor.kv",
                "mechanics.inertia",
                own_motor.RESISTANCE_KEY,
                "drive.inverter.bus_voltage",
            )
        }
        share = values[own_motor.RESISTANCE_KEY] / start[own_motor.RESISTANCE_KEY] / rng.uniform(slow, fast)
        values[own_motor.INDUCTANCE_KEY] = float(f"{start[own_motor.INDUCTANCE_KEY] * share:.3g}")
        values[own_motor.POLE_PAIRS] = float(rng.choice(sorted(found.own_motor.turned)))
        ends = speed.candidate.low, speed.candidate.high
        to = rng.choice(speed.stops) if speed.stops else float(f"{rng.uniform(*ends):.3g}")
        sets.append(values | {"scenario.slow.reference": to})
    assert same_numbers(tmp_path, study, found, sets) > 8
    assert len(speed.stops) > 10 or speed.candidate.most >= 1.5 * speed.candidate.start
    assert (fast < 4) == ("step" in name)
    assert max(found.own_motor.turned) == (33 if "orders" in name else 40)


def test_a_load_behind_a_shaft_is_told_how_it_gets_a_page():
    """The gains depend on both inertias; the page without --own-motor has them."""
    side = {"inertia": "1e-4 kg*m^2", "stiffness": "20 N*m/rad", "damping": "1 mN*m*s/rad"}
    study = load(MY_MOTOR, {"mechanics.load_side": side})
    with pytest.raises(StudyError) as error:
        adjustable(study, for_own_motor=True)
    expected = "no product of their powers"
    assert str(error.value).startswith(f"{MY_MOTOR}: --own-motor: controller.config.")
    assert str(error.value).endswith(f"{expected}: expected cogless live without --own-motor")
    assert "scenario.slow.reference" in {key.candidate.key for key in adjustable(study).keys}


@pytest.fixture(scope="module")
def shown(own, window, tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "own.html"
    write(own[0], path, "cogless run my_motor.toml --set controller.harmonic.base=1", for_own_motor=True)
    window.open(path, 1300)
    settle(window)
    return window


in_browser = pytest.mark.skipif(bool(MISSING or NO_ENGINE), reason=MISSING or NO_ENGINE)


@in_browser
def test_the_page_draws_what_harmonic_has_learned_as_the_report_does(own, shown):
    study, _ = own
    memory = simulate(study, "slow", "harmonic").memory
    drawn = shown.run("return cogless.learned('harmonic')")
    assert np.max(np.abs(memory["current"])) > 0.03  # A, to cancel 4 mN*m of cogging and 2
    assert drawn["at"] == pytest.approx(np.rad2deg(memory["angle"]), abs=1e-9)
    assert drawn["values"] == pytest.approx(memory["current"], rel=1e-6, abs=1e-9)


@in_browser
def test_another_motor_gives_the_numbers_of_set(own, shown, tmp_path):
    """uomodri's motor: through whole numbers, gains of both loops, and cogging of another order."""
    study, _ = own
    values = {
        "motor.pole_pairs": 12,
        "motor.resistance_line_to_line": 1.06,
        "motor.inductance_line_to_line": 0.42,
        "motor.kv": 300,
        "mechanics.inertia": 6e-6,
        "motor.cogging.0.order": 72,
        "scenario.slow.reference": 60,
    }
    for key, value in values.items():
        shown.run(f"cogless.set({key!r}, {value!r})")
    settle(shown)
    sets = sets_of(shown)
    assert sets.keys() == values.keys() | {"controller.harmonic.base"}
    other = changed(study, sets)
    for name in ("pi", "harmonic"):
        (mine,) = shown.run(f"return cogless.result('{name}').result.values")
        (wanted,) = simulate(other, "slow", name).metrics.values()
        assert mine == pytest.approx(wanted, rel=1e-3)
    (tmp_path / "mine.toml").write_text(shown.run("return cogless.toml()"), encoding="utf-8")
    mine = load(tmp_path / "mine.toml")  # what the page downloads
    assert (mine.motor, mine.mechanics, mine.scenario) == (other.motor, other.mechanics, other.scenario)
    assert mine.controller == other.controller
    shown.run("cogless.set('motor.inductance_line_to_line', 0.04)")  # 1.06 ohm: 38 us
    assert sets_of(shown) == sets
    told = "with 0.04, L / R is 0.0377 ms: this page allows 0.103 ms to 12.3 ms. The value stays at 0.42."
    assert shown.run("return document.querySelector('.told .bounds').textContent") == told


@in_browser
def test_the_page_says_when_the_guard_held_learning_back_in_the_judged_window(own, shown):
    study, _ = own
    for speed in (30, 120):
        shown.run(f"cogless.set('scenario.slow.reference', {speed})")
        settle(shown)
        trace = simulate(changed(study, sets_of(shown)), "slow", "harmonic").trace
        rows = trace.window(4.0, 6.0)
        held = trace["status"][rows].astype(int) & Status.GUARDED > 0
        wanted = float(np.sum(held)) * trace.period >= STATE_TIME_LEAST
        text = shown.run("return document.querySelector('#verdicts').innerText")
        assert ("The guard held back its learning" in text) == wanted


@in_browser
def test_a_motor_that_stands_is_not_praised(own, shown):
    study, _ = own
    shown.run("cogless.set('scenario.slow.reference', 30); cogless.set('mechanics.coulomb_friction', 300)")
    settle(shown)
    run = simulate(changed(study, sets_of(shown)), "slow", "pi")
    cause = "the monitor has the output off 92 % of the time, first at 0.159 s: angle stuck, status bit 64"
    assert missed(run, run.trace.window(4.0, 6.0), "rpm") == f"mean 0 of 30 rpm ({cause})"
    text = shown.run("return document.querySelector('#verdicts').innerText")
    assert text.count("did not hold the speed: mean 0 of 30 r/min.") == 2 and "ripple" not in text
    shown.run("cogless.set('mechanics.coulomb_friction', 3)")
    settle(shown)
    assert "not hold" not in shown.run("return document.querySelector('#verdicts').innerText")


def test_a_number_that_is_no_product_is_refused(own):
    """Such as the orders that are learned, if slots and poles tell them: no power of anything."""
    study, found = own
    keys = [key.candidate for key in found.keys if key.candidate.key in own_motor.OWN_MOTOR_KEYS]
    base = packed(study, [("slow", "pi")])

    def bent(values):
        share = {key.key: x / key.start for key, x in values}
        other = {key.key: key.study_value(x) for key, x in values}
        inertia = 4e-5 * (1 + share.get("mechanics.inertia", 1.0) ** 2) / 2
        made = changed(study, other | {"mechanics.inertia": f"{inertia!r} kg*m^2"})
        return packed(made, [("slow", "pi")], study)

    with pytest.raises(
        StudyError, match=r"mechanics\.inertia: the page cannot .* no product of their powers"
    ):
        own_motor.own_motor(base, bent, keys, lambda key: key)


def test_a_motor_in_other_words_is_told_what_is_missing(small_study):
    with pytest.raises(
        StudyError, match=r": motor\.resistance_line_to_line, .*motor\.kv: missing: expected with"
    ):
        adjustable(small_study, for_own_motor=True)


def test_orders_that_slots_and_poles_tell_follow_the_pole_pairs(own):
    """Without a base of its own the law learns the multiples of gcd(slots, poles), or of 6."""
    study = load(own[0].source.path)
    keys = [key.candidate for key in own[1].keys if key.candidate.key in own_motor.OWN_MOTOR_KEYS]
    run = ("slow", "harmonic")

    def made(values):
        other = changed(study, {key.key: key.study_value(x) for key, x in values})
        return packed(other, [run], study)

    found = own_motor.own_motor(packed(study, [run]), made, keys, lambda key: key).products[*run, "run"]
    (base,) = [one for one in found if one.number.path.endswith(".base")]
    assert base.start == 1.0 and not base.powers
    common = [(math.gcd(12, 2 * n), math.lcm(12, 2 * n)) for n in range(1, 41)]
    assert base.factors == tuple(6.0 if main > 128 * each else float(each) for each, main in common)
    assert [main for each, main in common if main > 128 * each] == [276, 300, 348, 372, 420, 444]


# --- motors of the catalogue


def test_a_class_has_its_typical_values_between_two_terminals(own):
    _, found = own
    classes = {one["name"]: one["values"] for one in motor_classes(found.keys)}
    assert "nema17" not in classes and "own" not in classes and len(classes) >= 6
    drone = classes["drone"]
    assert (drone["motor.pole_pairs"], drone["motor.kv"]) == (7, 300)
    assert drone["motor.resistance_line_to_line"] == pytest.approx(2 * 0.53)
    assert drone["motor.inductance_line_to_line"] == pytest.approx(2 * 0.21)  # mH
    assert drone["mechanics.coulomb_friction"] == pytest.approx(0.013 * 110, rel=1e-3)  # mN*m
    assert drone["motor.cogging.0.torque"] == pytest.approx(0.015 * 110, rel=1e-3)
    assert all(set(values) <= {key.candidate.key for key in found.keys} for values in classes.values())


@in_browser
@pytest.mark.parametrize("name", ["drone", "gimbal", "direct-drive", "hub", "servo", "spindle"])
def test_a_picked_motor_gives_the_numbers_of_set(own, shown, name):
    """All values of a class are put in together, and none is refused."""
    study, found = own
    values = next(one["values"] for one in motor_classes(found.keys) if one["name"] == name)
    list_of = "const list = document.getElementById('motor-class');"
    pick = list_of + "list.value = {!r}; list.dispatchEvent(new Event('change'))"
    shown.run(pick.format(name))
    settle(shown)
    assert shown.run("return document.querySelectorAll('.slide.told').length") == 0
    sets = sets_of(shown)
    starts = {key.candidate.key: key.candidate.start for key in found.keys}
    changes = {key for key, x in values.items() if x != starts[key]}
    assert {key for key in sets if key in values} == changes
    blob = packed(changed(study, sets), [("slow", "pi")], study)["slow", "pi", "run"]
    mine = bytes(shown.run("return Array.from(cogless.job('pi', false).description)"))
    for number in blob.numbers:  # a run of a small motor would amplify what rounding does
        assert number.read(mine) == pytest.approx(number.read(blob.data), rel=REAL.get(number.format, 0)), (
            number
        )
    shown.run(pick.format(""))
    settle(shown)
    assert not set(sets_of(shown)) & set(values)
