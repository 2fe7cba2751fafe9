"""A value that a page changes: all bytes that the engine gets are those of `cogless run --set`."""

import json
import random
import tomllib
from pathlib import Path

import live_studies
import numpy as np
import pytest
from node import NO_NODE, run_node

import studies
from cogless.control_library import Status
from cogless.design.auto import load
from cogless.errors import StudyError
from cogless.live.candidates import OF_REFERENCE, PLANT, candidates, quoted, shortest
from cogless.live.description import Number, pack, page_runs
from cogless.live.keys import AdjustableKeys, Landing, _accepted, landed, packed
from cogless.live.live_page import data
from cogless.report.speed_tracking import STATE_TIME_LEAST
from cogless.results import held_speed
from cogless.study.reading import changed
from cogless.study.toml import sections, toml

DESCRIBED = """
const { described, runs } = liveBytes(given.page);
return given.values.map((values) => Object.fromEntries([...runs.keys()].map((place) =>
  [place, Buffer.from(described(place, values).data).toString("hex")])));
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    study = live_studies.study(tmp_path_factory.mktemp("small"))
    return study, live_studies.found(study)


def drawn(found, rng):
    """A value for a few keys, by key: one of the stops, or as a slider or a hand gives it."""
    values = {}
    for key in rng.sample(found.keys, min(len(found.keys), rng.randint(1, 8))):
        one = key.candidate
        if key.stops:
            values[one.key] = rng.choice(key.stops)
        elif one.whole:
            values[one.key] = float(rng.randint(int(one.low), int(one.high)))
        else:
            values[one.key] = float(f"{rng.uniform(one.low, one.high):.{rng.randint(1, 9)}g}")
    return values


def bytes_of(study, found, values):
    """All descriptions with these values, as `--set` makes them; None if the study refuses them together."""
    texts = {key.candidate.key: key.candidate for key in found.keys}
    try:
        other = changed(study, {name: texts[name].study_value(value) for name, value in values.items()})
        return {"/".join(place): blob.data.hex() for place, blob in packed(other, page_runs(other)).items()}
    except (StudyError, ValueError):
        return None


def same_bytes(folder, study, found, seed, count):
    rng = random.Random(seed)
    tried = [drawn(found, rng) for _ in range(count)]
    wanted = [(values, made) for values in tried if (made := bytes_of(study, found, values))]
    assert len(wanted) > count / 2
    given = {"page": data(study, found, "cogless run x"), "values": [list(v.items()) for v, _ in wanted]}
    by_page = run_node(folder, ("bytes.js",), DESCRIBED, given)
    for (values, by_set), made in zip(wanted, by_page, strict=True):
        assert {place: blob for place, blob in made.items() if "|" not in place} == by_set, values


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_changed_values_give_the_bytes_of_set(tmp_path, small):
    same_bytes(tmp_path, *small, seed=1, count=25)


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_changed_values_of_a_shipped_study_give_the_bytes_of_set(tmp_path):
    """With every law where it compensates the dead time, and one where it doesn't."""
    others = {f"scenario.{name}.controllers": ["pi"] for name in ("as-it-is", "no-dead-time")}
    study = load("uomodri-dead-time", others)
    same_bytes(tmp_path, study, live_studies.found(study), seed=2, count=12)


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_a_speed_that_moves_what_is_learned_in_other_scenarios_has_the_bytes_of_set(tmp_path):
    """The slowest reference decides how many orders a law of 1 kHz learns, in all scenarios of its file."""
    text = (Path(__file__).parents[2] / "examples" / "my_motor.toml").read_text(encoding="utf-8")
    (tmp_path / "two.toml").write_text(text + '[scenario.other]\nduration = "6 s"\nreference = "40 rpm"\n')
    study = load(tmp_path / "two.toml", {"drive.rates.speed_loop": "1 kHz"})
    found = live_studies.found(study)
    assert "scenario.slow.reference" in {key.candidate.key for key in found.keys}
    same_bytes(tmp_path, study, found, seed=3, count=20)


def test_gains_motor_load_and_sensors_can_be_changed(small):
    _, found = small
    names = {key.candidate.key: key for key in found.keys}
    assert names["controller.pi-ilc.gain"].stops == ()
    assert names['scenario.low.override."mechanics.inertia"'].stops == ()
    assert names["scenario.low.duration"].stops == ()
    # through a rule, or through several sums: tabulated
    assert len(names["controller.pi.tuning.phase_margin"].stops) > 15
    assert 2500 in names['scenario.low.override."drive.position_sensor.lines"'].stops
    for word in ("reference", "load", 'override."motor.R_s"', 'override."motor.cogging.0.torque"'):
        assert f"scenario.low.{word}" in names
    assert "scenario.step.reference.speed" in names


def test_no_two_keys_set_the_same_number(small):
    _, found = small
    all_of = [
        (place, one.number.offset)
        for key in found.keys
        for place, lands in key.lands.items()
        for one in lands
    ]
    assert len(all_of) == len(set(all_of))


def test_a_scenarios_key_leaves_the_gains_alone(small):
    """The plant gets heavier, and the controller isn't told."""
    _, found = small
    (key,) = [k for k in found.keys if k.candidate.key == 'scenario.low.override."mechanics.inertia"']
    assert {one.number.path for lands in key.lands.values() for one in lands} == {"mechanics.inertia"}
    assert {place[0] for place in key.lands} == {"low"}


def joined(pieces):
    return "".join(piece if isinstance(piece, str) else piece[1] for piece in pieces)


def test_the_lines_of_the_study_read_back_as_the_study(small):
    study, _ = small
    text = "\n".join(
        "\n".join(
            [f"[{s['heading']}]"] * bool(s["heading"])
            + [f"{key} = {joined(value)}" for key, value in s["lines"]]
        )
        for s in sections(study._source)
    )
    assert tomllib.loads(text) == study._source.tables
    assert json.loads(toml('a "b" \x7f\n')) == 'a "b" \x7f\n'


SLIDERS = {
    # its slider in the study's unit, and what the field takes
    "controller.pi.kp": ("A/rpm", 0.0, 0.045, 0.0, 4.5),
    "controller.pi.gain": ("A/rpm", 0.0, 0.012, 0.0, 1.2),
    "controller.pi.forgetting": ("", 0.5, 1.0, 0.5, 1.0),
    "controller.pi.cells": ("", 75.0, 1200.0, 75.0, 1200.0),
    "controller.pi.q_half_width": ("", 0.0, 12.0, 0.0, 12.0),
    "controller.pi.learning_start": ("s", 0.0, 0.4, 0.0, 0.4),
    "controller.fair.tuning.phase_margin": ("deg", 25.0, 75.0, 25.0, 75.0),
    "scenario.low.duration": ("s", 0.04, 0.8, 4e-4, 80.0),
    "scenario.low.reference": ("rpm", 6.0, 180.0, 0.06, 18e3),
    "scenario.low.load": ("mN*m", -610.0, 610.0, -610.0, 610.0),  # half of K_t 3 A
    'scenario.low.override."mechanics.inertia"': ("kg*m^2", 7.5e-5, 7.5e-4, 7.5e-7, 0.075),
    'scenario.low.override."mechanics.coulomb_friction"': ("mN*m", 0.0, 6.0, 0.0, 600.0),
    'scenario.low.override."motor.cogging.0.torque"': ("mN*m", 0.0, 12.0, 0.0, 1200.0),
    'scenario.low.override."motor.R_s"': ("ohm", 7.71, 30.84, 0.0771, 3084.0),
    'scenario.low.override."motor.psi_f"': ("mWb", 47.6, 88.4, 0.476, 8840.0),
    'scenario.low.override."drive.current_sensors.bits"': ("", 8.0, 16.0, 8.0, 16.0),
    'scenario.low.override."drive.current_sensors.offset.1"': ("mA", -60.0, 60.0, -6000.0, 6000.0),
    'scenario.low.override."drive.inverter.dead_time"': ("us", 0.0, 4.0, 0.0, 400.0),
    'scenario.low.override."drive.inverter.bus_voltage"': ("V", 155.0, 465.0, 1.55, 46500.0),
}


def test_sliders_are_about_the_studys_values_and_fields_take_a_hundred_times_more(tmp_path):
    """A key of zero has no slider, an encoder's lines have stops, a law's own keys belong to no scenario."""
    ilc = {"law": "pi-ilc", "kp": "0.015 A/rpm", "ki": "0 A/rpm/s", "gain": "0.004 A/rpm", "cells": 300,
           "forgetting": 0.9, "q_half_width": 3}  # fmt: skip
    study = studies.study(
        tmp_path,
        {
            "controller.pi": ilc,
            "scenario.low.load": "10 mN*m",
            "scenario.step.controllers": ["fair"],
            "mechanics.coulomb_friction": "2 mN*m",
            "drive.inverter.dead_time": "1 us",
            "drive.current_sensors": {"bits": 12, "offset": ["0 A", "-20 mA", "0 A"]},
            "drive.position_sensor": {"kind": "encoder", "lines": 2500},
        },
    )
    found = {one.key: one for one in candidates(study)}
    for key, (unit, *ends) in SLIDERS.items():
        one = found[key]
        assert one.unit == unit
        assert [one.low, one.high, one.least, one.most] == pytest.approx(ends), key
        where, name = key.split(".")[:2]
        assert (one.scenario or one.controller) == name and bool(one.scenario) == (where == "scenario")
    of_low = [key for key in found if not key.startswith("scenario.step")]
    assert [key for key in of_low if key.endswith((".ki", 'viscous_friction"', 'offset.0"'))] == []
    lines = found['scenario.low.override."drive.position_sensor.lines"']
    assert (lines.low, lines.high, lines.whole) == (64, 10000, True) and 2500 in lines.stops
    whole = {key.rpartition(".")[2] for key, one in found.items() if one.whole}
    assert whole == {"cells", "q_half_width", 'bits"', 'lines"'}
    gain, cells = found["controller.pi.gain"], found["controller.pi.cells"]
    assert (gain.study_value(0.002), gain.study_value(3.0), cells.study_value(256.0)) == (
        "0.002 A/rpm", "3 A/rpm", 256
    )  # fmt: skip
    assert gain.si(0.002) == pytest.approx(0.002 * 30 / np.pi)
    assert [shortest(x) for x in (2.0, 0.1, 1e15, -3.0, 1e-7)] == [
        "2", "0.1", "1000000000000000.0", "-3", "1e-07",
    ]  # fmt: skip
    pairs = found["controller.fair.tuning.phase_margin"].pairs(study)
    assert pairs == [("low", "fair"), ("step", "fair")]


def test_a_slider_has_the_studys_value_and_larger_ones():
    """An encoder's lines have stops instead, and bits are told as they are, not as shares."""
    groups = {"mechanics": "Load and motion", "motor": "Motor", "inverter": "Inverter"}
    for _, low, high in OF_REFERENCE:
        assert low < 1 < high
    for group, key, low, high in PLANT:
        assert group == groups.get(key.removeprefix("drive.").partition(".")[0], "Sensors")
        if key.endswith(".bits"):
            assert 8 == low < high
        elif key != "drive.position_sensor.lines":
            assert low <= 1 < high, key


@pytest.mark.parametrize(
    ("name", "written"), [("pi", "pi"), ("a.b", '"a.b"'), ("7", '"7"'), ("pi-ilc", "pi-ilc")]
)
def test_names_are_quoted_where_a_dotted_key_needs_it(name, written):
    assert quoted(name) == written


def test_a_direct_key_sets_its_value_times_a_constant_rounded_as_the_number_is():
    def number(kind):
        return Number("x", 0, kind)

    assert landed(Landing(number("d"), 2.0), 0.3) == 0.6
    assert landed(Landing(number("f"), 2.0), 0.3) == float(np.float32(0.6)) != 0.6
    assert landed(Landing(number("I"), 1000.0, True), 0.0126) == 13.0


def test_a_value_that_no_description_has_is_refused():
    with pytest.raises(TypeError, match=r"^page\.x: complex: expected a plain value$"):
        pack({"controller": {"law": "pi"}, "page": {"x": 1j}}, "double")


def test_an_end_of_a_slider_that_the_study_refuses_comes_nearer(tmp_path):
    """Half the way to the study's value, five times at most; a sensor has 32 bits at most, and 12 here."""
    study = live_studies.study(tmp_path)
    found = {one.key.rpartition(".")[2]: one for one in candidates(study) if one.scenario == "low"}
    bits, inertia = found['bits"'], found['inertia"']
    assert [_accepted(study, bits, end) for end in (32.0, 33.0, 100.0, 400.0)] == [32, 22, 23, 12]
    assert _accepted(study, inertia, -1e-4) == 7.5e-5  # of 2.5e-4


def test_a_page_has_what_its_scripts_draw_and_judge_by(small):
    """Its constants are the report's; what a law learned is told from what it never learns by one number."""
    study, found = small
    made = data(study, found, "cogless run x")
    assert (made["command"], made["name"], made["kind"], made["motor"]) == (
        "cogless run x",
        "study",
        "speed",
        None,
    )
    assert (made["busy"], made["guarded"], made["moment"]) == (Status.BUSY, Status.GUARDED, STATE_TIME_LEAST)
    limits = {
        "far": held_speed.MEAN_ERROR_MOST,
        "jerks": held_speed.JERKS_RATIO,
        "lost": held_speed.LOST_SPEED_RATIO,
    }
    limits |= {"drift": held_speed.REST_ERROR_MOST, "one_way": held_speed.ONE_WAY}
    assert made["tracking"] == limits
    named = [
        tuple(one[key] for key in ("name", "label", "colour", "baseline")) for one in made["controllers"]
    ]
    assert named == [
        ("pi", "<i>PI</i>", 0, True),
        ("pi-ilc", "pi-ilc", 1, False),
        ("table", "table", 2, False),
    ]
    assert [one["learns"] for one in made["controllers"]] == [False, True, False]  # a table is learned before
    low, step = made["scenarios"]
    assert (low["name"], low["rate"], low["controllers"]) == ("low", 4e3, ["pi", "pi-ilc", "table"])
    titles = {one["name"]: (one["titles"], one["unit"]) for one in step["metrics"]}
    assert titles == {
        "speed_ripple_rad_s": (["speed ripple"], "rpm"),
        "speed_order_rad_s": (["speed order 8", "speed order 16"], "rad/s"),
        "loss_W": (["loss"], "W"),
        "chatter_A": (["chatter"], "A"),
        "recovery_s": (["recovery"], "s"),
        "dip_rad_s": (["dip"], "rpm"),
    }
    for one in step["metrics"]:
        assert one["factor"] == (np.pi / 30 if one["unit"] == "rpm" else 1) and one["better"] == "lower"
    runs = made["runs"]
    places = {f"{s}/{c}/run" for s in ("low", "step") for c in ("pi", "pi-ilc", "table")}
    of_study = {place for place in runs if "|" not in place}  # the others have another sensor
    assert of_study == places | {"low/table/learn", "step/table/learn"}
    assert all(runs[place]["off"][1:] == ["d", 1e9] and runs[place]["learned"] is None for place in places)
    key = next(one for one in made["keys"] if one["key"] == "scenario.low.duration")
    assert (key["label"], key["group"], key["scenario"], key["controller"]) == (
        "duration", "Load and motion", "low", None
    )  # fmt: skip
    assert [key[word] for word in ("unit", "factor", "start", "whole", "stops")] == ["s", 1.0, 2.0, False, ()]
    assert (key["low"], key["high"], key["most"]) == (1.1, 4.0, 400.0)  # 0.2 s were too short for a metric
    assert 1.0 <= key["least"] < 1.1
    assert {place for place in key["lands"] if "|" not in place} == {p for p in runs if p.startswith("low/")}


def test_more_controllers_than_colours_share_them(tmp_path):
    """The baseline has the first for itself."""
    more = {f"controller.more{n}": {"law": "pi", "kp": "0.01 A/rpm", "ki": "0.1 A/rpm/s"} for n in range(7)}
    study = changed(live_studies.study(tmp_path), more)
    made = data(study, AdjustableKeys(), "")["controllers"]
    assert [one["colour"] for one in made] == [0, 1, 2, 3, 4, 5, 6, 7, 1, 2]
