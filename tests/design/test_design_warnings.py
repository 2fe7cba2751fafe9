"""What `design` and `run` say beforehand of a motor and its drive that don't go together."""

import math
from pathlib import Path

import numpy as np
import pytest

from cogless.design import warnings as module
from cogless.design.current_needed import carried
from cogless.design.design_table import design_table
from cogless.design.warnings import cogging_notes, likely_harm, shaft_notes
from cogless.errors import StudyError
from cogless.run.run_plan import plan
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.reading import changed

EXAMPLE = Path(__file__).parents[2] / "examples" / "my_motor.toml"
FINER = {"drive.rates.integration_steps": 3}


def my_motor(**changes):
    return changed(load(EXAMPLE), changes)


def notes(study, name):
    return [*map(str, module.notes(study, name))]


def beyond_drive(study, scenarios):
    return [*map(str, module.beyond_drive(study, scenarios))]


def test_a_speed_beyond_the_voltage_is_said_with_the_speed_that_it_reaches():
    """58 rpm/V and 24 V: 1392 rpm."""
    fast = my_motor(**{"scenario.slow.reference": "3000 rpm"}, **FINER)
    line = (
        "scenario.slow: its reference of 3000 rpm needs more than the bus voltage: "
        "24 V turn this motor at 1392 rpm at most, without load"
    )
    assert beyond_drive(fast, ["slow", "slow"]) == [line]
    assert f"{line}." in [str(text) for text in design_table(fast).renderables]
    assert beyond_drive(my_motor(**{"scenario.slow.reference": "1390 rpm"}, **FINER), ["slow"]) == []
    more = {"scenario.slow.override": {"drive.inverter.bus_voltage": "52 V"}}
    assert beyond_drive(changed(fast, more), ["slow"]) == []


def test_a_step_that_is_too_long_for_an_unreachable_speed_names_the_voltage():
    expected = r"at the bus voltage the motor reaches 1392 rpm without load, not 3000 rpm$"
    with pytest.raises(StudyError, match=expected):
        my_motor(**{"scenario.slow.reference": "3000 rpm"})
    # the step only has to follow what the voltage reaches
    faster = {"scenario.slow.reference": "30000 rpm"}
    assert my_motor(**faster, **FINER).scenario["slow"].top_reference > 3000


def test_a_speed_that_reads_zero_in_most_samples_is_said_with_what_helps():
    """10,000 counts at 11 r/min are 1833 a second, of which a sample at 4 kHz gets 0.46."""
    encoder = {"kind": "encoder", "lines": 2500}
    slow = {"scenario.slow.reference": "11 rpm", "drive.position_sensor": encoder}
    line = (
        "scenario.slow: at 11 rpm the position sensor gives 0.46 counts per speed sample: most speed "
        'samples are 0, the others 24 rpm; drive.position_sensor.speed_method = "MT" would time the edges, '
        "and by calculation leave less ripple"
    )
    assert beyond_drive(my_motor(**slow), ["slow", "slow"]) == [line]
    assert f"{line}." in [str(text) for text in design_table(my_motor(**slow)).renderables]
    assert beyond_drive(my_motor(**slow | {"scenario.slow.reference": "12.1 rpm"}), ["slow"]) == []
    timed = slow | {"drive.position_sensor": {**encoder, "speed_method": "MT"}}
    assert beyond_drive(my_motor(**timed), ["slow"]) == []
    word = {"kind": "absolute", "bits": 12, "window": 4}
    (of_a_word,) = beyond_drive(my_motor(**slow | {"drive.position_sensor": word}), ["slow"])
    assert of_a_word.endswith("others 73.24 rpm")


def test_cogging_that_is_not_learned_is_named_with_a_base_that_learns_it():
    other = my_motor(**{"motor.cogging.1.order": 21})
    (line,) = notes(other, "harmonic")
    told = (
        "it learns orders 2, 4, ..., 256, but the cogging has order 21; "
        "with controller.harmonic.base = 21 it would learn all of them"
    )
    assert line == f"controller.harmonic: {told}"
    assert notes(changed(other, {"controller.harmonic.base": 21}), "harmonic") == []
    assert notes(changed(other, {"motor.cogging.1.torque": "0 N*m"}), "harmonic") == []
    assert notes(load(EXAMPLE), "harmonic") == []


def test_a_base_that_the_law_has_already_is_not_advised():
    """The law learns at most six times the main order, with any base. Its base here is 6 already."""
    high = {"motor.cogging": [{"order": n, "torque": "1 mN*m"} for n in (6, 84, 510)]}
    high |= {"drive.rates.integration_steps": 4}
    for base in ({}, {"controller.harmonic.base": 6}):
        study = my_motor(**high, **base)
        (remark,) = (each for each in module.notes(study, "harmonic") if "the cogging has" in str(each))
        assert str(remark).endswith("but the cogging has order 510") == (not remark.cures)
        for cured in remark.cured(study):
            assert not any("the cogging has" in line for line in notes(cured, "harmonic"))


def test_edges_are_not_timed_where_they_come_later_than_the_loop_can_wait():
    """A telescope's drive has 17 counts a second. Timed edges make its speed worse and its mean wrong."""
    stars = {"scenario.slow.reference": "0.1 rpm", "scenario.slow.duration": "20 s"}
    counted = {"drive.position_sensor": {"kind": "encoder", "lines": 2500}}
    timed = {"drive.position_sensor.speed_method": "MT"}
    study = my_motor(**stars, **counted, **{"mechanics.coulomb_friction": "0 N*m"})
    (remark,) = module.beyond_drive(study, ["slow"])
    assert str(remark).endswith("most speed samples are 0, the others 24 rpm") and remark.cures == ()
    ripple, off = [], []
    for each in (study, changed(study, timed)):
        trace = simulate(each, "slow", "pi").trace
        omega, reference = trace["omega_m"][len(trace) // 2 :], trace["omega_ref"][-1]
        ripple.append(float(np.std(omega)))
        off.append(abs(float(np.mean(omega)) / reference - 1))
    assert ripple[1] > 1.2 * ripple[0] and off[1] > 0.05 > off[0]


def test_orders_that_are_not_learned_may_be_why_learning_does_harm():
    other = my_motor(**{"controller.harmonic.base": 5})
    assert likely_harm(other, "harmonic", "slow").startswith(
        "it learns orders 5, 10, ..., 500, but the cogging has orders"
    )
    assert likely_harm(other, "pi", "slow") is None


def test_orders_beyond_the_memory_have_no_base():
    far = my_motor(**{"motor.cogging.1.order": 521})
    assert notes(far, "harmonic") == [
        "controller.harmonic: it learns orders 2, 4, ..., 256, but the cogging has order 521; "
        "no base learns all of the cogging with 128 orders"
    ]


def test_a_base_without_room_for_a_sensor_s_error_is_said_with_one_that_has_it():
    off = {"drive.position_sensor.eccentricity": "0.3 deg"}
    assert notes(my_motor(**off), "harmonic") == []  # 6, of itself
    told = (
        "controller.harmonic: base 2 puts the learned orders too close together to learn an error of the "
        "position sensor that comes once a "
        "turn; with controller.harmonic.base = 6 it would learn this error"
    )
    small = my_motor(**off, **{"controller.harmonic.base": 2})
    assert notes(small, "harmonic") == [told] and notes(small, "pi") == []
    assert f"{told}." in [str(text) for text in design_table(small).renderables]
    both = off | {"motor.cogging": [{"order": n, "torque": "1 mN*m"} for n in (14, 24, 84)]}
    assert notes(my_motor(**both), "harmonic") == [f"{told}, but not order 14 of the cogging"]
    for base in (2, 6):  # a study that states one of the two has chosen
        assert notes(my_motor(**both, **{"controller.harmonic.base": base}), "harmonic") == []
    assert notes(my_motor(**both, **{"controller.harmonic.base": 4}), "harmonic") != []
    there = {"scenario.slow.override": {"drive.position_sensor.error": [{"order": 2, "amplitude": "1 deg"}]}}
    (of_a_scenario,) = notes(my_motor(**there), "harmonic")
    assert "comes twice a turn; with controller.harmonic.base = 6 it would learn this error" in of_a_scenario


def test_a_table_too_coarse_for_the_main_order_is_said(tmp_path):
    """84 waves over 100 points look like 16."""
    rows = [f"{3.6 * n:.1f},{math.sin(math.radians(84 * 3.6 * n)):.5f}" for n in range(100)]
    (tmp_path / "cogging.csv").write_text("\n".join(["angle [deg],torque [mN*m]", *rows]), encoding="utf-8")
    path = tmp_path / "study.toml"
    path.write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    table = {"file": "cogging.csv", "frame": "mechanical", "sign": "on-rotor"}
    coarse = load(path, {"motor.cogging_table": table})
    shows = "so the cogging's main order, 84, looks like a lower order: expected 169 points or more"
    told = f"motor.cogging_table: 100 points show orders up to 49, {shows}"
    assert cogging_notes(coarse) == [told]
    assert f"{told}." in [str(text) for text in design_table(coarse).renderables]
    electrical = load(path, {"motor.cogging_table": table | {"frame": "electrical"}})
    assert cogging_notes(electrical) == [] == cogging_notes(my_motor())


def test_orders_of_other_slots_are_named_when_the_slots_change():
    """The motor has 12 slots and 14 poles. With 21 slots, all orders of its cogging are multiples of 7."""
    main = "the main order of 21 slots with 14 poles is 42"
    told = "motor.slots was changed, but motor.cogging was not: order 12 belongs to other slots; " + main
    assert cogging_notes(load(EXAMPLE, {"motor.slots": 21})) == [told]
    own = {"motor.cogging": [{"order": 12, "torque": "1 mN*m"}]}
    assert cogging_notes(load(EXAMPLE, {"motor.slots": 21, **own})) == [] == cogging_notes(load(EXAMPLE))


def test_missing_slots_are_refused_before_anything_runs(tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8").replace("slots = 12\n", "")
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    told = (
        "motor.slots: missing: expected the number of slots, or controller.harmonic.base: they "
        "give the orders to learn"
    )
    with pytest.raises(StudyError) as error:
        load(path)
    assert str(error.value) == f"{path}: {told}"
    assert load(path, {"controller.harmonic.base": 2})


@pytest.mark.parametrize(("poles", "half"), [("16", ": 8"), ("15", ""), ('"x"', "")])
def test_poles_become_pole_pairs_by_half(tmp_path, poles, half):
    text = EXAMPLE.read_text(encoding="utf-8").replace("pole_pairs = 7", f"poles = {poles}")
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError) as error:
        load(path)
    assert (
        str(error.value)
        == f'{path}: motor.poles: {poles}: expected the key "pole_pairs" instead, half of the poles{half}'
    )


def test_too_many_orders_are_told_with_their_keys_and_the_limit():
    cogging = [{"order": n, "torque": "0.1 mN*m"} for n in range(2, 400, 2)]
    told = r"too many different orders in motor\.cogging, torque_ripple and .*: expected 128 at most"
    with pytest.raises(StudyError, match=told):
        plan(my_motor(**{"motor.cogging": cogging}), "slow", "pi")


def test_the_highest_order_of_a_memory_is_learned():
    """Base 2 learns up to order 256. No base learns the 128th multiple of 21 on this motor."""
    highest = {"motor.cogging": [{"order": 256, "torque": "0.1 mN*m"}]}
    assert notes(my_motor(**highest), "harmonic") == []
    others = {"motor.cogging": [{"order": n, "torque": "0.1 mN*m"} for n in (21, 21 * 128)]}
    (line,) = notes(my_motor(**others, **{"drive.rates.integration_steps": 30}), "harmonic")
    assert line.endswith("but the cogging has orders 21, 2688")


def test_a_soft_shaft_is_told_with_where_it_swings():
    """The load on a held rotor, and both masses against each other."""
    side = {"inertia": "4e-5 kg*m^2", "stiffness": "10 N*m/rad", "backlash": "0.1 deg"}
    soft = my_motor(**{"mechanics.load_side": side}, **FINER)
    own = soft.mechanics.inertia
    low, high = (math.sqrt(10 * each) / math.tau for each in (1 / 4e-5, 1 / 4e-5 + 1 / own))
    told = (
        f"mechanics.load_side: the soft shaft has an antiresonance at {low:.4g} Hz and a resonance at "
        f"{high:.4g} Hz; the printed margins include this shaft{{}}. The tuning rules do not: they take "
        "motor and load as one mass"
    )
    assert shaft_notes(soft) == [told.format(" with its gap closed")]
    assert shaft_notes(changed(soft, {"mechanics.load_side.backlash": "0 deg"})) == [told.format("")]
    assert shaft_notes(my_motor()) == []


def test_a_soft_shaft_that_takes_a_tenth_of_the_phase_margin_is_told():
    """The crossover is in Hz; a loop that it makes unstable is told as such instead."""

    def said(stiffness, **more):
        side = {"inertia": "4e-5 kg*m^2", "stiffness": stiffness, "damping": "1 mN*m*s/rad"}
        return notes(my_motor(**{"mechanics.load_side": side}, **more, **FINER), "pi")

    has = "its phase margin is 53.3 deg at 127.9 Hz"
    told = f"controller.pi: with the soft shaft {has}, not the 60 deg of its tuning rule"
    assert said("3 N*m/rad") == [told]  # 0.89 of 60 degrees
    assert said("1 N*m/rad") == []  # 0.92
    given = {"controller.pi": {"law": "pi", "kp": "0.02 A*s/rad", "ki": "0.5 A/rad"}}
    assert said("3 N*m/rad", **given) == []  # no rule asks for a margin
    assert said("3 N*m/rad", **{"drive.position_sensor": {"kind": "ideal", "side": "load"}}) == []


def test_no_current_limit_is_advised_that_the_voltage_does_not_carry():
    """At 30 rpm 24 V carry (24 / sqrt(3) - K_e omega) / R; the current's own ripple is left out."""
    heavy = my_motor(**{"mechanics.load": {"torque": "2 N*m"}})
    star, inverter = heavy.motor.star(), heavy.drive.inverter
    omega = heavy.scenario["slow"].top_reference
    carries = (inverter.bus_voltage / math.sqrt(3) - star.pole_pairs * star.psi_f * omega) / star.R_s
    assert carried(heavy, omega) == pytest.approx(carries, rel=0.01)
    (line,) = module.beyond_drive(heavy, ["slow"])
    assert line.cures == () and str(line).endswith(
        f"; a bus voltage of 24 V allows {carried(heavy, omega):.3g} A at its top speed"
    )
    u = [star.R_s * carried(heavy, omega) + star.pole_pairs * star.psi_f * omega,
         star.pole_pairs * omega * star.L_q * carried(heavy, omega)]  # fmt: skip
    assert math.hypot(*u) == pytest.approx(inverter.bus_voltage / math.sqrt(3))
    light = my_motor(**{"mechanics.load": {"torque": "0.5 N*m"}})
    (line,) = module.beyond_drive(light, ["slow"])
    assert line.cures and "carry" not in str(line)
    assert carried(light, 1e6) == 0.0
