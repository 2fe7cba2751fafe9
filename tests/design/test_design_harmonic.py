"""The rule of the law `harmonic`, its certificate, and runs that hold it to both."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless import load
from cogless.design.auto import filled
from cogless.design.laws.harmonic import _acting, certificate, harmonic_gains, learner, rate_at
from cogless.design.laws.harmonic_transfer import gamma, rate_bound
from cogless.design.speed_loop import interpolated, speed_loop
from cogless.design.summary import design, design_dict, summary
from cogless.errors import StudyError
from cogless.run.simulate import simulate
from cogless.study import Study, changed
from cogless.study.laws.harmonic import ORDER_ANGLE_MOST

EXAMPLE = Path(__file__).parents[2] / "examples" / "my_motor.toml"
RPM = math.pi / 30
COMPENSATED = {"drive.dead_time_compensation.band": "35 mA"}
UNGUARDED = {"drive.guard": False}  # it would look at the feedback alone in between
SPEEDS = ("reference", "initial_speed")
BASE_2 = {**studies.HARMONIC["controller.harmonic"], "base": 2}
LATE = {"drive.bus.delay_command": "0.2 ms"}  # a sample of the law


def study(name: str = "uomodri", **changes: Any):
    here = load(name)
    chosen = {
        f"scenario.{key}.controllers": [*scenario.controllers, "harmonic"]
        for key, scenario in here.scenario.items()
        if scenario.controllers
    }
    return load(name, {**studies.HARMONIC, **chosen, **changes})


def error(scenario: str, duration: int, name: str, **changes: Any):
    """The speed error in each quarter of a second of a run on uomodri, rms, r/min."""
    own = {"controller.same": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "45 deg"}}}
    own |= {"metric": []}
    here = study(**{f"scenario.{scenario}.duration": f"{duration} s", **own, **changes})
    speed = simulate(here, scenario, name).trace["omega_m"] / RPM
    return speed.reshape(-1, 1250).std(axis=1)


def test_numbers_follow_from_slots_poles_and_drive(tmp_path):
    told = learner(study(**COMPENSATED), "harmonic")
    assert (told.base, told.orders) == (6, 72)  # 18 slots, 24 poles: to 6 lcm = 432
    assert told.base * told.fast == 144  # the highest order of its cogging
    assert learner(study(), "harmonic").fast == 72  # dead time has all of its multiples
    assert learner(study(**{"drive.inverter.dead_time": "0 s"}), "harmonic").fast == 24
    drops = {"drive.inverter.dead_time": "0 s", "drive.inverter.device_drop": "0.5 V"}
    assert learner(study(**drops), "harmonic").fast == 72
    assert told.b == pytest.approx(study().K_t / 6e-6)
    # a current loop of 1 kHz, whose phase rises a little, less half of its period of 50 us
    assert told.delay == pytest.approx(1 / (2 * math.pi * 1000) - 25e-6, rel=0.15)
    liu = learner(study("liu2018"), "harmonic")
    assert (liu.base, liu.orders, liu.fast) == (4, 36, 6)  # 12 slots, 8 poles
    path = studies.write(tmp_path)  # its motor doesn't tell
    expected = (
        r"motor\.slots: missing: expected the number of slots, or controller\.harmonic\.base: they give the "
        r"orders"
    )
    with pytest.raises(StudyError, match=expected):
        load(path, studies.HARMONIC)
    by_hand = {**studies.HARMONIC["controller.harmonic"], "base": 2}
    assert learner(load(path, {"controller.harmonic": by_hand}), "harmonic").base == 2


@pytest.mark.parametrize(
    ("pole_pairs", "slots", "cogging", "base"),
    [
        (7, 12, (), 2),  # the main order is 84
        (11, 24, (), 6),  # 264 > 128 * 2; the inverter's are 66 k
        (11, 24, (24, 264), 6),
        (11, 24, (22, 264), 22),
        (11, 24, (22, 24), 2),  # nothing else divides both
        (13, 24, (), 6),  # 312
        (19, 36, (), 6),  # 684
        (7, 12, (84, 420), 6),  # five times the main order
    ],
)
def test_the_main_order_is_learned_whatever_the_slots(pole_pairs, slots, cogging, base):
    waves = [{"order": n, "torque": "1 mN*m"} for n in cogging]
    motor = {"motor.pole_pairs": pole_pairs, "motor.slots": slots, "motor.cogging": waves}
    motor["drive.rates.integration_steps"] = 8
    told = learner(study(**motor, **COMPENSATED), "harmonic")
    assert told.base == base
    if base != 2 or slots == 12:
        assert told.base * told.fast == max([math.lcm(2 * pole_pairs, slots), *cogging])
        assert told.orders == min(128, 6 * math.lcm(2 * pole_pairs, slots) // base)


@pytest.mark.parametrize(
    "tells",
    [
        {"motor.cogging": [{"order": 144, "torque": "1 mN*m"}]},
        {"motor.torque_ripple": [{"order": 144, "percent": 1.0}]},
        {"motor.flux_harmonics": [{"order": 12, "q": "1 uWb"}]},  # electrical
    ],
)
def test_what_the_motor_is_told_to_have_is_learned_at_any_speed(tells):
    bare = {"motor.cogging": [], **COMPENSATED}
    assert learner(study(**bare), "harmonic").fast * 6 == 72
    assert learner(study(**bare | tells), "harmonic").fast * 6 == 144


def alone(speed: str) -> Study:
    """A study of uomodri with dead time compensated and a single scenario at one speed."""
    of_speed = {"duration": "6 s", "reference": speed, "initial_speed": speed}
    afc = {"law": "pi-afc", "tuning": {"rule": "auto"}}
    scenario = {"scenario": {"alone": of_speed}, "controller.afc": afc, "metric": []}
    return filled(study(**COMPENSATED, **scenario, **UNGUARDED))


@pytest.mark.parametrize("speed", ["240 rpm", "480 rpm"])
def test_a_scenario_gets_what_it_can_hold_whatever_the_others_are(speed):
    """Before, the law left .275 r/min at 240 r/min and .283 at 480, but .081 if a scenario had 15 r/min.

    It had left out order 144, and at 480 r/min it had learned a bend of the angle that does not exist.
    """
    here = alone(speed)
    assert learner(here, "harmonic") == learner(study(**COMPENSATED), "harmonic")
    beside = {"duration": "6 s", "reference": "15 rpm", "initial_speed": "15 rpm"}
    both = changed(here, {"scenario": {**here.source.tables["scenario"], "beside": beside}})
    left = {
        name: np.sqrt(np.mean(simulate(where, "alone", law).trace["omega_error"][-10_000:] ** 2)) / RPM
        for name, where, law in (
            ("alone", here, "harmonic"),
            ("beside", both, "harmonic"),
            ("orders", here, "afc"),
        )
    }
    assert left["alone"] == left["beside"] < left["orders"] < 0.15, left


@pytest.mark.parametrize(("speed", "time"), [("40 rpm", 1.3), ("60 rpm", 1.3), ("120 rpm", 0.6)])
def test_a_load_that_steps_while_it_learns_bends_no_angle(speed, time):
    """During a step of the load the ripple gives a wrong bend of the angle.

    A bend learned from it turned order 72 by up to two radians. It left 5 to 19 r/min for good, where the
    feedback alone leaves 5.
    """
    of_speed = {"duration": "6 s", "reference": speed, "initial_speed": speed}
    step = {"events": [{"time": f"{time} s", "load": "20 mN*m"}]}
    here = changed(alone(speed), {"scenario": {"alone": {**of_speed, **step}}})
    found = simulate(here, "alone", "harmonic").trace["omega_error"][-5000:] / RPM
    assert np.sqrt(np.mean(found**2)) < 0.5


def test_a_speed_that_swings_is_learned_once():
    """A new speed raises the learning rate. Before, a swing by over a quarter raised it again and again.

    A step of the load was then learned too fast. Here the load steps by 20 mN m at 18 s.
    """
    here = load("uomodri-varying", {**studies.HARMONIC, **COMPENSATED, "metric": []})
    step = [{"time": "18 s", "load": "20 mN*m"}]
    made = {"scenario.varying.events": step, "scenario.varying.duration": "24 s"}
    found = simulate(changed(here, made), "varying", "harmonic").trace["omega_error"][-5000:] / RPM
    assert np.sqrt(np.mean(found**2)) < 0.6


@pytest.mark.parametrize("name", ["uomodri", "liu2018", "gimbal", "my_motor"])
def test_the_rate_is_below_where_all_orders_together_oscillate_at_any_speed(name):
    """A firmware turns at speeds that no scenario has."""
    here = load(EXAMPLE) if name == "my_motor" else study(name)
    told, loop = learner(here, "harmonic"), speed_loop(here)
    for omega in np.geomspace(0.1, ORDER_ANGLE_MOST / (told.base * loop.period), 25):
        bound = rate_bound(loop.period, told, _acting(told, omega, loop.period) * omega)
        assert rate_at(told, omega, loop.period) < 0.6 * bound, omega


@pytest.mark.parametrize(
    ("pole_pairs", "slots", "cogging", "sensor", "base"),
    [
        (7, 12, (12, 84), {"eccentricity": "0.3 deg"}, 6),  # 14, which the study doesn't tell, is left out
        (7, 12, (14, 84), {"eccentricity": "0.3 deg"}, 14),
        (7, 12, (12, 14, 84), {"eccentricity": "0.3 deg"}, 2),  # nothing else divides both
        (7, 12, (12, 84), {"eccentricity": "0.02 deg"}, 2),  # below 0.5 mrad
        (7, 12, (12, 84), {"error": [{"order": 3, "amplitude": "0.3 deg"}]}, 2),  # not learned anyway
        (4, 9, (), {"eccentricity": "0.3 deg"}, 3),  # 24 and 72
        (4, 9, (), {"error": [{"order": 2, "amplitude": "0.3 deg"}]}, 6),
        (4, 6, (), {"eccentricity": "0.3 deg", "bits": 12}, 2),  # too coarse to learn its error
    ],
)
def test_what_the_study_tells_of_a_sensor_s_error_gets_room(pole_pairs, slots, cogging, sensor, base):
    waves = [{"order": n, "torque": "1 mN*m"} for n in cogging]
    motor = {"motor.pole_pairs": pole_pairs, "motor.slots": slots, "motor.cogging": waves}
    motor["drive.position_sensor"] = {"kind": "absolute", "bits": 14} | sensor
    told = learner(study(**motor), "harmonic")
    assert told.base == base and bool(told.bends) == (base > 2)


def test_gamma_is_one_where_the_model_is_right():
    here = study()
    loop, told, pi = speed_loop(here), learner(here, "harmonic"), harmonic_gains(here, "harmonic")
    w = 2 * math.pi * np.array([6.0, 72.0, 216.0, 432.0])
    assert gamma(loop, told, pi, w) == pytest.approx(np.ones(4), abs=0.04)
    late = gamma(loop, told, pi, w, 1)
    assert late[0].real > 0.9 and abs(np.angle(late[1])) > abs(np.angle(late[0]))


def test_a_law_without_gains_is_offered_its_rule():
    with pytest.raises(StudyError, match=r'expected either kp and ki or tuning, such as \{ rule = "auto" \}'):
        load("uomodri", {"controller.harmonic": {"law": "harmonic"}})


def test_a_motor_that_rests_has_a_certificate_without_infinite_numbers():
    resting = {f"scenario.{key}.{what}": "0 rpm" for key in load("uomodri").scenario for what in SPEEDS}
    made = certificate(study(**resting, metric=[]), "harmonic")
    assert "all references are too slow" in made.in_words() and made.speeds == () and made.fine


def test_the_certificate_tells_up_to_which_speed_an_eccentric_sensor_is_found():
    """At 72 waves a turn and 5 kHz 0.5105 rad a sample are 338 r/min."""
    made = certificate(study(), "harmonic")
    assert made.straight is not None and made.straight / RPM == pytest.approx(338.5, abs=0.1)
    assert "learns an eccentric sensor's error up to 338.5 rpm" in made.in_words()
    assert certificate(study(**{"controller.harmonic": BASE_2}), "harmonic").straight is None


@pytest.mark.parametrize(
    ("degrees", "scenario", "most"), [(0.2, "1-rev-s", 0.4), (0.5, "1-rev-s", 0.6), (0.5, "fast", 0.9)]
)
def test_an_eccentric_encoder_leaves_little_more_than_a_true_one(degrees, scenario, most):
    """Without the bend half a degree left 3.4 r/min at 60 r/min, 0.2 degrees 1.6."""
    untold = {f"scenario.{scenario}.override": {"drive.position_sensor.eccentricity": f"{degrees} deg"}}
    assert np.mean(error(scenario, 5, "harmonic", **untold, **COMPENSATED, **UNGUARDED)[16:]) < most


def test_the_certificate_is_shown():
    here = study()
    made = summary(here)["harmonic"]
    assert (
        "at 15 rpm orders up to 432, with a learning rate of 4.34 1/s at first. Together they settle with "
        "rates "
        "below 10.3 1/s. If K_t/J is 50 % wrong, they still converge (least Re Gamma: 0.66" in made.in_words()
    )
    assert certificate(here, "harmonic").fine
    as_json = design_dict(made)
    assert as_json["rule"] == "auto" and as_json["gains"]["orders"]["value"] == 72
    assert list(as_json["gains"])[:2] == ["kp", "ki"] and "k_theta" not in as_json["gains"]
    assert as_json["certificate"]["speeds"][1]["late"] < 432


def test_the_rate_is_well_below_where_all_orders_together_oscillate():
    """That is 0.15 / (N T) at low speeds; the rule's 1/16 leaves a gain margin of 2.4, which is 7.6 dB."""
    slow, fast = certificate(study(**COMPENSATED), "harmonic").speeds
    assert slow.rate == pytest.approx(1 / (16 * 72 * 0.2e-3)) and slow.most is not None
    assert slow.most / slow.rate == pytest.approx(2.4, rel=0.03)
    assert fast.rate == pytest.approx(1 / (16 * 24 * 0.2e-3)) and (fast.most or math.inf) > 2.4 * fast.rate


def test_a_second_is_enough_at_15_rpm_where_a_map_takes_forty():
    learned = error("slow", 4, "harmonic")
    assert np.min(learned[:4]) < 1.0 and np.all(learned[4:] < 1.0)
    assert np.all(error("slow", 4, "pi-ilc") > 2.0)


@pytest.mark.parametrize("changes", [
    {"mechanics.inertia": "3e-6 kg*m^2"}, {"mechanics.inertia": "9e-6 kg*m^2"}, {"motor.kv": "600 rpm/V"},
    {"motor.kv": "200 rpm/V"}, LATE,
])  # fmt: skip
def test_what_nobody_told_it_slows_it_only(changes):
    untold = {"scenario.1-rev-s.override": changes, **COMPENSATED}
    learned, without = (error("1-rev-s", 5, name, **untold) for name in ("harmonic", "same"))
    assert np.mean(learned[12:20]) < 0.35 * np.mean(without[12:20])


def test_a_dropout_of_50_ms_costs_no_learning():
    fault = {"kind": "angle-missing", "time": "4 s", "duration": "50 ms"}
    changes = {"scenario.1-rev-s.faults": [fault], "drive.guard": False, **COMPENSATED}
    learned = error("1-rev-s", 6, "harmonic", **changes)
    assert learned[16] > 5.0  # what the rotor did meanwhile
    assert np.all(learned[17:] < 0.6) and np.all(learned[:2] > 0.6)


def test_liu_at_60_rpm_is_near_the_encoders_floor():
    speed = simulate(study("liu2018"), "60-rpm", "harmonic").trace["omega_m"][-12000:] / RPM
    assert np.std(speed) < 0.4


def test_counts_that_beat_with_the_samples_are_not_taken_for_ripple():
    """At 61.3 r/min 4.087 counts come in a sample: seen there, they beat with 433 Hz, where order 420 is.
    From steps alone, without the timed speed, 1.2 r/min would be learned."""
    speed = {f"scenario.1-rev-s.{key}": "61.3 rpm" for key in SPEEDS}
    assert learner(study(), "harmonic").step == pytest.approx(math.tau / 20_000)
    assert error("1-rev-s", 12, "harmonic", **COMPENSATED, **speed)[-8:].max() < 0.12
    for other in ({"drive.position_sensor.speed_method": "M"}, {"drive.speed_filter": "1 kHz"}):
        assert learner(study(**other), "harmonic").step == 0


def test_ripple_that_changes_with_a_turning_load_is_followed():
    """An arm's weight turns with the rotor, at up to 0.4 rad/s, and with it the torque that a step motor's
    ripple is a share of. The paper's electrical rad/s, peak to peak; its learning leaves 0.081."""
    law = {**studies.HARMONIC["controller.harmonic"], "position": True}
    arm = {"controller.harmonic": law, "controller.same": {**law, "learning_start": "1e6 s"}}
    here = load("verrelli2016", arm)
    assert learner(here, "harmonic").rate_min == pytest.approx(10 * 0.4)
    assert learner(study(), "harmonic").rate_min == 0.5
    left = []
    for name in ("harmonic", "same"):
        trace = simulate(here, "twelve-seconds", name).trace
        left.append(50 * np.ptp((trace["omega_m"] - trace["omega_ref"])[8000:10_000]))
    assert left[0] < 0.005 and left[1] > 0.06
    # a load that is faster than learning is not followed: the mean goes on
    fast = {f"scenario.{key}.reference": "100 rpm" for key in here.scenario}
    assert learner(load("verrelli2016", arm | fast), "harmonic").rate_min == 0.5


def test_orders_that_a_soft_shaft_turns_are_held():
    """The shaft of the study has its antiresonance at 59.5 Hz and its resonance at 84 Hz."""
    by_hand = {"law": "harmonic", "tuning": {"rule": "auto"}, "kp": "0.1 A*s/rad", "ki": "0.5 A/rad"}
    here = load("two-mass-axis", {"controller.harmonic": by_hand})
    made = certificate(here, "harmonic")
    (held,) = {each.held_orders for each in made.speeds}
    assert (
        held[0] == 60
        and held[-1] > 90
        and made.fine
        and "learns no order of a frequency from 58.7 to" in made.in_words()
    )
    short = {"scenario.motor-sensor.duration": "12 s", "metric": []}
    still = {**by_hand, "learning_start": "1e6 s"}
    left = []
    for law in (by_hand, still):
        run = load("two-mass-axis", {"controller.harmonic": law, **short})
        left.append(np.std(simulate(run, "motor-sensor", "harmonic").trace["omega_m"][-8000:]))
    assert left[0] < 0.6 * left[1]


def test_hall_sensors_show_the_loads_orders_only():
    """With 15 pole pairs their places have order 15; the load has orders 1 and 2."""
    law = {"law": "harmonic", "tuning": {"rule": "auto"}, "kp": "0.4 A*s/rad", "ki": "2 A/rad"}
    short = {"scenario.walk.duration": "11 s", "metric": [], "controller.harmonic": law}
    here = load("hub-motor", short)
    told = learner(here, "harmonic")
    assert (told.base, told.orders, told.bends) == (1, 14, 0)
    left = [
        np.std(simulate(here, "walk", name).trace["omega_m"][-8000:] / RPM) for name in ("harmonic", "pi")
    ]
    assert left[0] < 0.15 * left[1]


def test_what_halls_show_of_a_slow_motion_is_true():
    """Late by little, and a speed that is the angle's derivative, late by half of its intervals and more."""
    w = np.array([0.5])
    speed, angle = interpolated(w, 0.01, 3)
    assert angle == pytest.approx([1.0], abs=1e-4)
    assert speed / (1j * w) == pytest.approx(np.exp(-1j * w * 0.02), abs=1e-4)


def test_a_position_is_held_with_less_ripple():
    """Verrelli's arm: the same feedback with nothing learned beside it."""
    law = {"law": "harmonic", "position": True, "tuning": {"rule": "auto"}, "learning_start": "2 s"}
    own = {"controller.harmonic": law, "scenario.twelve-seconds.duration": "7 s", "metric": []}
    here = load("verrelli2016", own)
    assert learner(here, "harmonic").base == 50
    gains = design(here, "harmonic").gains
    assert [gains[key].value for key in ("k_theta", "kp", "ki")] == list(harmonic_gains(here, "harmonic"))
    assert gains["k_theta"].value > 0
    runs = [
        simulate(here, "twelve-seconds", name).trace["omega_error"][-2000:] for name in ("harmonic", "fair")
    ]
    assert np.std(runs[0]) < 0.5 * np.std(runs[1])
    with pytest.raises(StudyError, match="since kp and ki are not given: delete k_theta, or give kp and ki"):
        load("verrelli2016", {**own, "controller.harmonic": {**law, "k_theta": "5 1/s"}})


@pytest.mark.parametrize(("rate", "speed", "slow"), [("8 kHz", 0.5, 2), ("30 kHz", 0.25, 18)])
def test_slow_orders_are_named_and_do_not_veto_the_others(rate: str, speed: float, slow: int) -> None:
    """Order 2 turns by less than 0.001 rad a sample here. Before, that kept all orders from a judgement."""
    turning = {"scenario.slow.reference": f"{speed} rev/s", "scenario.slow.initial_speed": f"{speed} rev/s"}
    rates = {"drive.rates": {"current_loop": "24 kHz" if rate == "8 kHz" else "30 kHz", "speed_loop": rate}}
    fine = {"drive.position_sensor": {"kind": "absolute", "bits": 20}}
    path = Path(__file__).parents[2] / "examples" / "my_motor.toml"
    study = load(path, {**turning, **rates, **fine})
    (each,) = certificate(study, "harmonic").speeds
    assert each.slow == (2, slow) and each.gamma > 0 and each.acting == 256
    assert "too slow to be judged" in certificate(study, "harmonic").in_words()
    ripple = {
        name: float(np.std(trace["omega_m"][len(trace) // 2 :]))
        for name in ("pi", "harmonic")
        for trace in [simulate(study, "slow", name).trace]
    }
    assert ripple["harmonic"] < 0.5 * ripple["pi"]
