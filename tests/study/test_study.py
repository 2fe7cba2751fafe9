"""Reading a study: values, defaults, datasheets, changes, overrides."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine import unpacked
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

import cogless
import studies
from cogless import units
from cogless.design.angle_functions import functions_in
from cogless.errors import StudyError
from cogless.run.drive_config import engine_config
from cogless.run.simulate import simulate
from cogless.study import changed, for_scenario, load
from cogless.study.datasheet import MAGNET
from cogless.study.drive import Belief
from cogless.study.motor import Motor
from cogless.study.reading import parse_change, split, with_unit
from cogless.study.saturation import Saturation
from cogless.study.scenario import Fault

MOTOR = """
pole_pairs = 12
R_s = "0.53 ohm"
L_d = "210 uH"
L_q = "210 uH"
K_t = "0.05 N*m/A"
winding = "delta"
cogging = [ {order = 72, current = "0.184 A", phase = "30 deg"} ]
"""


def test_quantities_are_si(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    assert study.motor.psi_f == pytest.approx(0.068)
    assert study.mechanics.inertia == 2.5e-4
    assert study.scenario["low"].reference.speed == pytest.approx(2 * math.pi)
    assert study.controller["pi"].kp == pytest.approx(0.015 * 30 / math.pi)
    assert study.metric[2].band == pytest.approx(2 * math.pi / 30)
    assert (study.name, study.baseline, study.trace_rate) == ("study", "pi", 15000.0)


def test_a_study_is_frozen(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="frozen"):
        studies.study(tmp_path).mechanics.inertia = 1.0


def test_gains_may_be_plain_numbers(tmp_path: Path) -> None:
    text = studies.BASE.replace('"0.015 A/rpm"', "0.14")
    assert studies.study(tmp_path, text=text).controller["pi"].kp == 0.14


def test_which_metrics_and_controllers_a_scenario_has(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    assert [metric.name for metric in study.metrics_in("low")] == ["speed_ripple", "speed"]
    assert [metric.name for metric in study.metrics_in("step")] == ["speed_ripple", "recovery"]
    assert study.controllers_in("low") == ("pi", "fair")


# Motors


def test_a_datasheet_gives_what_the_study_leaves_out(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MOTOR, encoding="utf-8")
    head, tail = studies.BASE.split("[motor]")
    text = f'{head}[motor]\ndatasheet = "m.toml"\nR_s = "0.6 ohm"\n[mechanics]{tail.split("[mechanics]")[1]}'
    study = studies.study(tmp_path, text=text)
    assert (study.motor.pole_pairs, study.motor.R_s, study.motor.L_d) == (12, 0.6, pytest.approx(210e-6))
    assert changed(study, {"motor.R_s": 0.7}).motor.R_s == 0.7
    # The other of psi_f and K_t steps back.
    own_flux = studies.study(tmp_path, text=text.replace('R_s = "0.6 ohm"', 'psi_f = "2 mWb"'))
    assert (own_flux.motor.psi_f, own_flux.motor.K_t) == (pytest.approx(0.002), None)


def test_a_changed_key_replaces_other_keys_that_say_the_same(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"motor.K_t": "0.3 N*m/A", "motor.resistance_line_to_line": "40 ohm"})
    assert (study.motor.psi_f, study.motor.K_t) == (None, 0.3)
    assert (study.motor.R_s, study.motor.star().R_s) == (None, 20.0)
    back = changed(study, {"motor.kv": "20 rpm/V"}).motor
    assert (back.K_t, back.kv) == (None, pytest.approx(2 * math.pi / 3))


def test_a_datasheet_named_by_set(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MOTOR, encoding="utf-8")
    text = studies.BASE.replace("pole_pairs = 4\n", "").replace("[motor]", '[motor]\ndatasheet = "none"')
    assert studies.study(tmp_path, {"motor.datasheet": "m.toml"}, text).motor.pole_pairs == 12


def test_delta_becomes_star() -> None:
    common = {"pole_pairs": 4, "R_s": "3 ohm", "L_d": "3 mH", "L_q": "6 mH", "winding": "delta"}
    star = Motor.model_validate(
        {**common, "psi_f": "0.1 Wb", "flux_harmonics": [{"order": 6, "d": "1 mWb", "q": "2 mWb"}]}
    ).star()
    assert (star.R_s, star.L_d, star.L_q) == pytest.approx((1.0, 0.001, 0.002))
    assert star.psi_f == pytest.approx(0.1 / math.sqrt(3))
    assert star.K_t == pytest.approx(6 * 0.1 / math.sqrt(3))
    assert (star.flux_harmonics[0].d, star.flux_harmonics[0].q) == pytest.approx(
        (1e-3 / 3**0.5, 2e-3 / 3**0.5)
    )
    # K_t is measured at the terminals, where the connection doesn't show.
    assert Motor.model_validate({**common, "K_t": "0.6 N*m/A"}).star().psi_f == pytest.approx(0.1)
    # Between two terminals of a delta a winding lies beside the other two: 2/3 of its resistance.
    lines = {"resistance_line_to_line": "2 ohm", "inductance_line_to_line": "3 mH"}
    assert Motor.model_validate({**common, **lines, "K_t": "0.6 N*m/A"}).star().L_q == pytest.approx(0.002)
    only = {"pole_pairs": 4, "winding": "delta", "K_t": "0.6 N*m/A", **lines}
    alone = Motor.model_validate(only).star()
    assert (alone.R_s, alone.L_d, alone.L_q) == pytest.approx((1.0, 0.0015, 0.0015))
    # A belief is about a winding too.
    belief = Belief.model_validate({"R_s": "3.3 ohm", "psi_f": "0.11 Wb"}).resolved(star)
    assert (belief.R_s, belief.psi_f, belief.L_d) == pytest.approx((1.1, 0.11 / math.sqrt(3), 0.001))


def test_cogging_given_as_a_current(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MOTOR, encoding="utf-8")
    harmonic = (
        Motor.model_validate(
            {"pole_pairs": 4, "R_s": "1 ohm", "L_d": "1 mH", "L_q": "1 mH", "K_t": "0.5 N*m/A"}
            | {"cogging": [{"order": 72, "current": "0.2 A", "phase": "30 deg"}]}
        )
        .star()
        .cogging[0]
    )
    assert (harmonic.torque, harmonic.phase) == pytest.approx((0.1, math.pi / 6))


# Changes


def test_a_bare_number_takes_the_unit_that_stands_there(tmp_path: Path) -> None:
    study = studies.study(
        tmp_path, {"controller.pi.kp": 0.02, "motor.cogging.0.torque": 6, "scenario.low.duration": 1}
    )
    assert study.controller["pi"].kp == pytest.approx(0.02 * 30 / math.pi)
    assert study.motor.cogging[0].torque == pytest.approx(0.006)
    assert study.source.tables["scenario"]["low"]["duration"] == "1 s"


def test_a_text_brings_its_own_unit(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"scenario.low.reference": "1 rev/s"})
    assert study.scenario["low"].reference.speed == pytest.approx(2 * math.pi)


def test_a_change_leaves_the_first_study_as_it_was(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    assert changed(study, {"motor.cogging.0.order": 36}).motor.cogging[0].order == 36
    assert study.source.tables["motor"]["cogging"][0]["order"] == 24
    assert changed(study, {"drive.precision": "double"}).drive.precision == "double"


@pytest.mark.parametrize(
    ("text", "change"),
    [
        ("controller.pi.kp=0.02", ("controller.pi.kp", 0.02)),
        ('a.b="1 A"', ("a.b", "1 A")),
        ("a.b=1 A", ("a.b", "1 A")),
        ("a.b=[1, 2]", ("a.b", [1, 2])),
        ("a.b=true", ("a.b", True)),
        ("a.b=", ("a.b", None)),
        ('a.b=""', ("a.b", "")),
        ("a=x=y", ("a", "x=y")),
        (" a.b = red ", ("a.b", "red")),
        ("a=1\nb=2", ("a", "1\nb=2")),  # no second key: all of it is the value
    ],
)
def test_set_reads_toml_and_else_text(text: str, change: tuple[str, object]) -> None:
    assert parse_change(text) == change


def test_keys_with_dots_stand_in_quotes() -> None:
    key = 'scenario.low.override."motor.cogging.0.torque"'
    assert split(key) == ("scenario", "low", "override", "motor.cogging.0.torque")
    assert split("motor.cogging.0.torque") == ("motor", "cogging", 0, "torque")
    assert split('a."7"."b.c".7') == ("a", "7", "b.c", 7)
    assert split("a.123456789.1234567890") == ("a", 123456789, "1234567890")
    assert split(".".join(32 * "x")) == tuple(32 * "x")


def test_an_array_that_is_longer_than_before_has_the_last_unit_for_the_rest() -> None:
    assert with_unit([1, 2.5, 3], ["1 A", "2 V"]) == ["1 A", "2.5 V", "3 V"]
    assert with_unit([1, "x", True], ["2 A"]) == ["1 A", "x", True] and with_unit([1], []) == [1]
    assert with_unit([[0, 5], [1, 6]], [["0 s", "1 rpm"]]) == [["0 s", "5 rpm"], ["1 s", "6 rpm"]]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_the_unit_stays_whatever_the_number(number: float) -> None:
    assert with_unit(number, "60 rpm") == f"{number!r} rpm"
    assert with_unit(number, 60) == number
    assert with_unit([number, number], ["1 A", "2 A"]) == [f"{number!r} A"] * 2


# Scenarios


def test_an_override_holds_in_its_scenario_only(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    assert for_scenario(study, "low") is study
    assert for_scenario(study, "step").drive.current_sensors.offset == (0.05, 0.0, 0.0)
    assert study.drive.current_sensors.offset == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("reference", "kind", "top_speed"),
    [
        ("60 rpm", "constant", 2 * math.pi),
        ({"speed": "-60 rpm", "ramp": "100 rpm/s"}, "ramp", 2 * math.pi),
        ({"profile": [["0 s", "0 rpm"], ["1 s", "-120 rpm"], ["2 s", "60 rpm"]]}, "profile", 4 * math.pi),
        ({"offset": "60 rpm", "amplitude": "30 rpm", "frequency": "1 Hz"}, "sine", 3 * math.pi),
    ],
)
def test_forms_of_a_reference(tmp_path: Path, reference: object, kind: str, top_speed: float) -> None:
    study = studies.study(tmp_path, {"scenario.low.reference": reference})
    scenario = study.scenario["low"]
    assert scenario.reference.kind == kind
    assert scenario.top_reference == pytest.approx(top_speed)
    config = engine_config(study, "low", "pi")["reference"]
    assert config["kind"] == kind
    assert len(config["times"]) == len(config["speeds"]) == (3 if kind == "profile" else 0)


# The engine's description


def test_the_engine_is_told_everything_in_si(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"mechanics.coulomb_friction": "3 mN*m"})
    config = engine_config(study, "step", "pi")
    assert config["motor"]["cogging"] == [{"order": 24, "torque": 0.004, "phase": 0.0}]
    assert config["mechanics"]["breakaway_friction"] == config["mechanics"]["coulomb_friction"] == 0.003
    assert config["events"] == [{"time": 0.1, "load": 0.2}, {"time": 0.2, "load": 0.0}]
    assert config["drive"]["current_sensors"]["offset"] == (0.05, 0.0, 0.0)
    found = unpacked(config)
    drive, control = found["drive"], found["drive"]["control"]
    assert (drive["current_rate"], control["divider"]) == (15000, 15)
    assert control["foc"]["kp_q"] == pytest.approx(2 * math.pi * 800 * 0.03)
    assert control["foc"]["ki_d"] == pytest.approx(2 * math.pi * 800 * 15.42)
    assert found["controller"]["law"] == "pi"
    assert found["controller"]["config"] == pytest.approx(
        {"kp": 0.1432394, "ki": 2.8647889, "limit": study.drive.current_loop.current_limit}
    )


def test_the_load_of_a_scenario_replaces_that_of_the_mechanics(tmp_path: Path) -> None:
    table = {"angle": ["0 deg", "180 deg"], "torque": ["0 N*m", "0.1 N*m"]}
    study = studies.study(
        tmp_path, {"mechanics.load": "0.1 N*m", "scenario.low.load": {"lag": "30 ms", "angle_table": table}}
    )
    low = engine_config(study, "low", "pi")["load"]
    assert (low["torque"], low["lag"], low["time_table"]) == (0.0, 0.03, None)
    assert low["angle_table"] == {"angle": (0.0, pytest.approx(math.pi)), "torque": (0.0, 0.1), "file": None}
    assert engine_config(study, "step", "pi")["load"]["torque"] == 0.1


def test_a_commissioning_run_has_no_load_of_the_scenario(tmp_path: Path) -> None:
    law = {
        "law": "anti-cogging",
        "kp": 0.1,
        "ki": 1,
        "calibration": {"speed": "6 rpm", "position_gain": "20 1/s"},
    }
    study = studies.study(
        tmp_path, {"controller.table": law, "mechanics.load": "0.1 N*m", "scenario.step.load": "0.2 N*m"}
    )
    config = engine_config(study, "step", "table", "learn")
    assert (config["events"], config["load"]["torque"], config["initial_speed"]) == ([], 0.1, 0.0)
    assert config["controller"]["calibrate"]
    assert not engine_config(study, "step", "table")["controller"]["calibrate"]


def test_an_override_does_not_retune_a_controller(tmp_path: Path) -> None:
    override = {"mechanics.inertia": "5e-4 kg*m^2"}
    study = studies.study(tmp_path, {"scenario.step.override": override})
    there, here = (engine_config(study, name, "fair") for name in ("step", "low"))
    assert there["mechanics"]["inertia"] == 5e-4
    assert there["controller"] == here["controller"]


# Shipped studies


def test_shipped_studies_and_motors_are_found_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "motors").mkdir()
    studies.write(tmp_path / "studies").rename(tmp_path / "studies" / "mine.toml")
    monkeypatch.setattr(cogless, "__path__", [str(tmp_path)])
    assert load("mine").title == "A small drive"
    told = studies.refusal(load, "yours")
    assert told == "yours: no such study: expected a file, or one of the shipped studies: mine"
    line = studies.refusal(load, "mine", {"motor.datasheet": "liu"}).rpartition("/")[2]
    assert line == (
        'mine.toml: motor.datasheet: "liu": no such datasheet: expected a file, or one of the shipped '
        "motors: none"
    )


WINDING = {"pole_pairs": 12, "R_s": "0.53 ohm", "L_d": "210 uH", "L_q": "210 uH"}
# Back-EMF of 300 r/min per volt: amplitude in V per r/min from line to line and of a phase, and both rms.
LINES, PHASE = 1 / 300, 1 / 300 / math.sqrt(3)
LINES_RMS, PHASE_RMS = LINES / math.sqrt(2), PHASE / math.sqrt(2)
WORDS = {
    "psi_f": "1.531468 mWb",  # 60 / (sqrt(3) 2 pi 300 pole_pairs)
    "K_t": "27.56644 mN*m/A",
    "K_t_rms": f"{27.56644 * math.sqrt(2)} mN*m/A",
    "kv": "300 rpm/V",
    "kv_line_to_line_rms": f"{1 / LINES_RMS} rpm/V",
    "kv_phase_peak": f"{1 / PHASE} rpm/V",
    "kv_phase_rms": f"{1 / PHASE_RMS} rpm/V",
    "K_e_line_to_line_peak": f"{LINES} V/rpm",
    "K_e_line_to_line_rms": f"{LINES_RMS} V/rpm",
    "K_e_phase_peak": f"{PHASE} V/rpm",
    "K_e_phase_rms": f"{PHASE_RMS} V/rpm",
}


@pytest.mark.parametrize("word", MAGNET)
def test_all_words_for_the_magnet_mean_the_same(word: str) -> None:
    star = Motor.model_validate({**WINDING, word: WORDS[word]}).star()
    assert (star.K_t, star.psi_f) == pytest.approx((0.02756644, 1.531468e-3), rel=1e-6)


def test_words_that_agree_may_stand_side_by_side() -> None:
    """Of all words for one thing the first counts."""
    star = Motor.model_validate(
        {**WINDING, **WORDS, "resistance_line_to_line": "1.04 ohm", "inductance_line_to_line": "0.43 mH"}
    ).star()
    assert (star.R_s, star.L_d, star.psi_f) == pytest.approx((0.53, 210e-6, 1.531468e-3))


@pytest.mark.parametrize("winding", ["star", "delta"])
def test_resistance_between_two_terminals(winding: str) -> None:
    """Two phases of a star in series; one of a delta beside the two others."""
    R, L = 0.9, 0.3e-3
    factor = 2.0 if winding == "star" else 2 / 3
    common = {"pole_pairs": 7, "K_t": "0.1 N*m/A", "winding": winding}
    of_winding = {**common, "R_s": f"{R} ohm", "L_d": f"{L} H", "L_q": f"{L} H"}
    of_lines = {
        **common,
        "resistance_line_to_line": f"{factor * R} ohm",
        "inductance_line_to_line": f"{factor * L} H",
    }
    one, other = (Motor.model_validate(keys).star() for keys in (of_winding, of_lines))
    assert (one.R_s, one.L_d, one.L_q) == pytest.approx((other.R_s, other.L_d, other.L_q))


def test_a_study_by_the_datasheets_words_and_in_si_gives_the_same_bits(tmp_path: Path) -> None:
    """All that the engine is told is the same, so the run is."""
    words = """resistance_line_to_line = "30.84 ohm"
inductance_line_to_line = "60 mH"
kv_line_to_line_rms = "29.78 rpm/V"
cogging = [ {order = 24, torque_peak_to_peak = "8 mN*m"} ]"""
    K_t = math.sqrt(1.5) / units.parse("29.78 rpm/V", units.SPEED_CONSTANT)
    in_si = f"""R_s = "15.42 ohm"
L_d = "0.03 H"
L_q = "0.03 H"
K_t = "{K_t!r} N*m/A"
cogging = [ {{order = 24, torque = "0.004 N*m"}} ]"""
    before, after = studies.BASE.partition("pole_pairs = 4\n")[0], studies.BASE.partition("[mechanics]")[2]
    runs = []
    for text in (words, in_si):
        study = studies.study(tmp_path, {}, f"{before}pole_pairs = 4\n{text}\n[mechanics]{after}")
        runs.append((engine_config(study, "low", "fair"), simulate(study, "low", "fair").trace.data))
    assert runs[0][0] == runs[1][0]
    assert runs[0][1].tobytes() == runs[1][1].tobytes()


@pytest.mark.parametrize("key", ["kv", "K_t", "psi_f", "K_e_phase_rms"])
@pytest.mark.parametrize("sheet", ["uomodri", "liu2018"])
def test_one_word_for_the_magnet_replaces_the_datasheets(tmp_path: Path, sheet: str, key: str) -> None:
    value = {"kv": "300 rpm/V", "K_t": "0.03 N*m/A", "psi_f": "2 mWb", "K_e_phase_rms": "2 mV/rpm"}[key]
    before, after = studies.BASE.partition("[motor]")[0], studies.BASE.partition("[mechanics]")[2]
    alone = f'{before}[motor]\ndatasheet = "{sheet}"\n[mechanics]{after}'
    with_key = alone.replace("[mechanics]", f'{key} = "{value}"\n[mechanics]')
    in_file = studies.study(tmp_path, {}, with_key)
    by_change = changed(studies.study(tmp_path, {}, alone), {f"motor.{key}": value})
    assert in_file.motor.star().K_t == by_change.motor.star().K_t
    assert getattr(in_file.motor, key) is not None


def test_a_scenarios_override_is_not_told_to_the_controller(tmp_path: Path) -> None:
    hot = {"motor.R_s": "20 ohm", "motor.L_q": "60 mH", "motor.psi_f": "50 mWb"}
    base = studies.study(tmp_path, {"scenario.low.override": hot})
    cold = engine_config(studies.study(tmp_path), "low", "pi")
    warm = engine_config(base, "low", "pi")
    assert warm["motor"]["L_q"] == 0.06
    assert {**warm["drive"]} == {**cold["drive"]}
    told = {**hot, "drive.belief.L_q": "60 mH"}
    config = engine_config(studies.study(tmp_path, {"scenario.low.override": told}), "low", "pi")
    assert unpacked(config)["drive"]["control"]["foc"]["L_q"] == pytest.approx(0.06)


def test_a_lead_is_a_time_at_any_rate(tmp_path: Path) -> None:
    learning = {"law": "pi-ilc", "kp": 0.1, "ki": 1, "gain": 0.01, "lead": "3 ms", "cells": 256}
    faster = {"scenario.low.override": {"drive.rates.speed_loop": "3 kHz"}, "controller.learning": learning}
    config = engine_config(studies.study(tmp_path, faster), "low", "learning")
    assert unpacked(config)["controller"]["config"]["memory"]["lead"] == 9


def test_an_override_is_judged_by_its_own_scenario(tmp_path: Path) -> None:
    slow = {"drive.rates.current_loop": "3 kHz", "trace.rate": "3 kHz"}
    changes = {
        "scenario.low.override": {"drive.rates.current_loop": "3 kHz"},
        "scenario.step.reference": "9000 rpm",
        "scenario.step.initial_speed": "9000 rpm",
        "drive.rates.integration_steps": 4,
        "metric": [],
    }
    assert studies.study(tmp_path, changes).scenario["low"].override
    with pytest.raises(StudyError, match="integration_steps: 4: expected"):
        studies.study(tmp_path, {**changes, **slow})


# Ripple and temperature

HEATING = {
    "ambient": "25 degC",
    "winding_capacity": "20 J/K",
    "magnet_capacity": "60 J/K",
    "winding_to_ambient": "4 K/W",
}
HOT = {"winding": "80 degC", "flux_coefficient": "-0.0011 1/K"}


def test_torque_ripple_in_per_cent(tmp_path: Path) -> None:
    change = {"motor.torque_ripple": [{"order": 12, "percent": 1.5}, {"order": 7, "percent_peak_to_peak": 4}]}
    study = studies.study(tmp_path, change)
    told = engine_config(study, "low", "pi")["motor"]["torque_ripple"]
    assert [(h["order"], h["share"]) for h in told] == [(12, 0.015), (7, 0.02)]
    K = functions_in(study, "low").K
    theta = np.array([0.3, 1.7])
    expected = study.motor.star().K_t * (1 + 0.015 * np.sin(12 * theta) + 0.02 * np.sin(7 * theta))
    assert K.values_at(theta) == pytest.approx(expected)


def test_a_temperature_is_not_told_to_the_controller(tmp_path: Path) -> None:
    """What the motor is at the reference stays the belief, the base of gains, and what a design sees."""
    cold, hot = studies.study(tmp_path), studies.study(tmp_path, {"motor.temperature": HOT})
    one, other = (engine_config(study, "low", "fair") for study in (cold, hot))
    told = other["motor"].pop("temperature")
    assert (told["winding"], told["magnet"], told["reference"], told["drifts"]) == (80.0, 80.0, 20.0, False)
    assert one == other
    assert hot.motor.star().R_s == cold.motor.star().R_s


def test_temperatures_are_recorded(tmp_path: Path) -> None:
    metric = {"name": "hottest", "kind": "maximum", "signal": "temperature_winding", "unit": "degC"}
    change = {"motor.temperature": {**HOT, "heating": HEATING}, "metric": [metric]}
    study = studies.study(tmp_path, change)
    x = simulate(study, "low", "fair").trace
    assert x["temperature_winding"][0] == pytest.approx(80.0)
    assert x["temperature_winding"][-1] < 80.0 == x["temperature_magnet"][-1]  # no path from the magnets


# Saturation

CURRENT = ["0 A", "1 A", "2 A", "4 A"]


def test_saturation_by_apparent_inductance(tmp_path: Path) -> None:
    """Flux is inductance times current; from zero on, the axis is alike in both directions."""
    q = {"current": CURRENT, "inductance": ["30 mH", "30 mH", "27 mH", "20 mH"]}
    magnet = {"current": CURRENT, "flux": ["0 Wb", "-0.2 mWb", "-1 mWb", "-4 mWb"]}
    study = studies.study(tmp_path, {"motor.saturation": {"q": q, "magnet": magnet}})
    told = engine_config(study, "low", "fair")["motor"]["saturation"]
    assert told.keys() == {"q", "cross"}
    assert told["q"]["current"] == [-4, -2, -1, 0, 1, 2, 4]
    assert told["q"]["flux"] == pytest.approx([-0.08, -0.054, -0.03, 0, 0.03, 0.054, 0.08])
    assert told["cross"]["flux"] == pytest.approx([-4e-3, -1e-3, -2e-4, 0, -2e-4, -1e-3, -4e-3])
    x = simulate(study, "step", "fair").trace
    at = (x["time"] > 0.15) & (x["time"] < 0.2)  # under load
    assert x["tau_e"][at].max() < (6 * 0.068 * x["i_q"][at]).max() * (1 - 1e-4)


SATURATION = {
    "d": ("current [A],flux [mWb]", [(-2, -58), (-1, -30), (0, 0), (1, 29), (2, 55), (4, 90)]),
    "q": ("flux [mWb],current [mA],note", [(0, 0, ""), (30, 1000, "x"), (54, 2000, ""), (80, 4000, "")]),
    "magnet": ("current [A],flux [mWb]", [(0, 0), (1, -0.2), (2, -1), (4, -4)]),
}


def test_saturation_comes_from_csv_files(tmp_path: Path) -> None:
    """Fluxes, or inductances, over the current: the bits of the same table in the study, torque and all."""
    motors = tmp_path / "motors"
    motors.mkdir()
    files = {axis: {"file": f"{axis}.csv"} for axis in SATURATION}
    for axis, (heading, rows) in SATURATION.items():
        text = [heading, *(",".join(str(cell) for cell in row) for row in rows)]
        (motors / f"{axis}.csv").write_text("\n".join(text))
    tables = {
        "d": {"current": [f"{i} A" for i, _ in SATURATION["d"][1]],
              "flux": [f"{f} mWb" for _, f in SATURATION["d"][1]]},
        "q": {"current": CURRENT, "inductance": ["30 mH", "30 mH", "27 mH", "20 mH"]},
        "magnet": {"current": CURRENT, "flux": ["0 Wb", "-0.2 mWb", "-1 mWb", "-4 mWb"]},
    }  # fmt: skip
    there = {axis: {"file": f"motors/{axis}.csv"} for axis in files}
    changes = {"motor.L_d": "29 mH"}
    in_files = studies.study(tmp_path, {**changes, "motor.saturation": there})
    inline = studies.study(tmp_path, {**changes, "motor.saturation": tables})
    one, other = (engine_config(study, "low", "fair")["motor"]["saturation"] for study in (in_files, inline))
    assert one["d"] == other["d"] and one["cross"] == other["cross"]
    assert one["q"]["flux"] == pytest.approx(other["q"]["flux"], rel=1e-15)
    x, y = (simulate(study, "step", "fair").trace for study in (in_files, inline))
    assert x["tau_e"] == pytest.approx(y["tau_e"], rel=1e-9, abs=1e-9)
    # a datasheet's tables are beside the datasheet
    sheet = studies.BASE.partition("[motor]")[2].partition("[mechanics]")[0]
    sheet = sheet.replace('L_d = "30 mH"', 'L_d = "29 mH"')
    named = "".join(f'[saturation.{axis}]\nfile = "{axis}.csv"\n' for axis in files)
    (motors / "m.toml").write_text(sheet + named)
    before, after = studies.BASE.partition("[motor]")[0], studies.BASE.partition("[mechanics]")[2]
    text = f'{before}[motor]\ndatasheet = "motors/m.toml"\n[mechanics]{after}'
    assert engine_config(studies.study(tmp_path, {}, text), "low", "fair")["motor"]["saturation"] == one


@pytest.mark.parametrize(
    ("axis", "text", "problem"),
    [
        ("q", "current [A],flux [mWb]\n0,0\n1,30\n1,50",
            'line 4: "1": expected a current above that of the previous line'),
        ("q", "current [A],flux [mWb]\n0,0\n1,nan\n2,50", 'line 3: "nan": expected a finite flux'),
        ("q", "current [A],flux [mWb]\n0,0\n1,\n2,50", 'line 3: "": expected a number'),
        ("q", "current [A],flux [mWb]\n0,0\n1\n2,50", 'line 3: "1": expected 2 columns'),
        ("q", "current [A],flux [mWb]\n0,0\n1,30",
            "expected three or more values that rise, zero among them"),
        ("q", "current [A],flux [mWb]\n0,1\n1,30\n2,50", "expected zero at zero current"),
        ("q", "current [A],flux [mWb]\n0,0\n1,30\n2,30",
            "expected a flux linkage that grows with the current"),
        ("q", "current [A],inductance [mH]\n0,30\n1,0\n2,30", "expected inductances above zero"),
        ("q", "current [A],torque [N*m]\n0,0",
            'line 1: "current [A],torque [N*m]": expected one column such as "flux [mWb]" or '
            '"inductance [mH]"'),
        ("q", "angle [deg],flux [mWb]\n0,0",
            'line 1: "angle [deg],flux [mWb]": expected one column such as "current [A]"'),
        ("q", "current [A],flux\n0,0", 'line 1: "flux": expected a unit, too, such as "flux [mWb]"'),
        ("q", "current [N],flux [mWb]\n0,0", 'line 1: "current [N]": expected a unit of a current, such as '
            '"current [A]"'),
        ("magnet", "current [A],inductance [mH]\n0,0",
            'line 1: "current [A],inductance [mH]": expected one column such as "flux [mWb]"'),
        ("magnet", "current [A],flux [mWb]\n-1,1\n0,0\n1,1", "expected currents from zero on"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_saturation_file_names_its_line(
    tmp_path: Path, axis: str, text: str, problem: str
) -> None:
    (tmp_path / "table.csv").write_text(text)
    told = studies.refusal(studies.study, tmp_path, {"motor.saturation": {axis: {"file": "table.csv"}}})
    assert f'motor.saturation.{axis}.file: "table.csv": {problem}' in told


def test_a_saturation_file_stands_alone(tmp_path: Path) -> None:
    both = {"q": {"current": CURRENT, "file": "table.csv"}}
    with pytest.raises(
        StudyError,
        match=r'q\.file: "table.csv": expected no such key, since current is given: delete file',
    ):
        studies.study(tmp_path, {"motor.saturation": both})


def test_friction_by_position_comes_from_a_csv_file(tmp_path: Path) -> None:
    angles = range(0, 360, 30)
    lines = [f"{angle},{2 + angle % 60 / 30}" for angle in angles]
    (tmp_path / "friction.csv").write_text("\n".join(["angle [deg],torque [mN*m]", *lines]))
    study = studies.study(tmp_path, {"mechanics.friction_table": {"file": "friction.csv"}})
    table = engine_config(study, "low", "pi")["mechanics"]["friction_table"]
    assert table["angle"] == pytest.approx([math.radians(angle) for angle in angles])
    assert table["torque"] == pytest.approx([2e-3, 3e-3] * 6)
    assert studies.study(tmp_path).mechanics.friction_table is None


@pytest.mark.parametrize(
    ("kind", "more", "words"),
    [
        ("angle-missing", {}, "position sensor gives no number"),
        ("angle-stuck", {}, "position sensor stuck"),
        ("angle-jump", {"angle": "12.3 deg"}, "position sensor off by 12.3°"),
        ("current-missing", {"phase": "a"}, "current sensor of phase a gives no number"),
        ("current-zero", {"phase": "c"}, "current sensor of phase c reads zero"),
        ("bus-voltage", {"voltage": "12.5 V"}, "bus at 12.5 V"),
    ],
)
def test_a_fault_in_words(kind: str, more: dict[str, str], words: str) -> None:
    table = {"kind": kind, "time": "1 s", "duration": "0.5 s", **more}
    fault: Fault = TypeAdapter(Fault).validate_python(table)
    assert (fault.effect, fault.end) == (words, 1.5)


def test_the_smallest_inductance_is_the_least_slope_of_the_tables_of_flux() -> None:
    """At the end that of a parabola through the last three points: (3 * 5 - 10) / 2 mWb a step."""
    bent = {"current": [*CURRENT[:3], "3 A"], "flux": ["0 Wb", "30 mWb", "40 mWb", "45 mWb"]}
    straight = {"current": CURRENT[:3], "inductance": ["3 mH"] * 3}
    assert Saturation.model_validate({"q": bent, "d": straight}).smallest == pytest.approx(2.5e-3)
    assert Saturation.model_validate({"d": straight}).smallest == pytest.approx(3e-3)
    assert Saturation().smallest == math.inf


@pytest.mark.parametrize(("axis", "henry"), [("d", 27.1), ("q", 27.1), ("d", 26.9), ("q", 26.9)])
def test_a_table_begins_within_a_tenth_of_the_motor_s_inductance(axis: str, henry: float) -> None:
    made = Saturation.model_validate({axis: {"current": CURRENT, "inductance": [f"{henry} mH"] * 4}})
    if henry > 27:
        made.check(30e-3, 30e-3)
    else:
        with pytest.raises(ValueError, match=f"expected 0.03 H at zero current, as L_{axis}, not 0.0269 H"):
            made.check(30e-3, 30e-3)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("d", "reach"), [(None, 2.0), (4.0, 4.0)], ids=["L_d", "table of d"])
def test_a_magnet_table_bends_less_than_leaves_an_inductance(
    sign: float, d: float | None, reach: float
) -> None:
    """Through 0, -f and -2 f at 0, 1 and 2 A it is f (t^3 - 2 t^2) first: L_q - 4 f i_d is left at i_q = 0.

    That is zero at the table's last i_d. A rising flux leaves it there in the other direction.
    """
    L = 30e-3
    tables: dict[str, Any] = {}
    if d:
        tables["d"] = {"current": ["0 A", "1 A", f"{d} A"], "inductance": [f"{L} H"] * 3}
    for share in (0.999, 1.001):
        f = sign * share * L / (4 * reach)
        tables["magnet"] = {
            "current": ["0 A", "1 A", "2 A"],
            "flux": ["0 Wb", f"{-f!r} Wb", f"{-2 * f!r} Wb"],
        }
        made = Saturation.model_validate(tables)
        if share < 1:
            made.check(L, L)
        else:
            with pytest.raises(
                ValueError, match=rf"the inductance is not above zero at i_d = {sign * reach:g} A, i_q = 0 A"
            ):
                made.check(L, L)
