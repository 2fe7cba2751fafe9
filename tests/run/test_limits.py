"""What limits a run: each cause in a study with that cause alone, beside independent plants and sums."""

from __future__ import annotations

import math

import drafts
import numpy as np
import pytest

import studies
from cogless.design.auto import load
from cogless.report import limit, with_limits
from cogless.report.limit_sentences import remark
from cogless.results import Results
from cogless.results.limits import HELPING_SHARE
from cogless.results.results_json import to_dict
from cogless.run.limit_search import _Tries, limits
from cogless.run.simulate import run_study, simulate
from cogless.study import Study, changed

# A motor with one order of cogging and a drive without an error of its own.
TEXT = """
title = "One cause"
[motor]
pole_pairs = 7
slots = 12
R_s = "1 ohm"
L_d = "1 mH"
L_q = "1 mH"
K_t = "0.09 N*m/A"
cogging = [ { order = 12, torque = "2 mN*m" } ]
[mechanics]
inertia = "5e-5 kg*m^2"
load = "20 mN*m"
[trace]
rate = "1 kHz"
[drive]
rates = { current_loop = "10 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "500 Hz", current_limit = "2 A" }
inverter = { bus_voltage = "24 V" }
[scenario]
turning = { duration = "8 s", reference = "120 rpm", initial_speed = "120 rpm" }
[controller]
pi = { law = "pi", baseline = true, kp = "0.04 A*s/rad", ki = "1 A/rad" }
harmonic = { law = "harmonic", kp = "0.04 A*s/rad", ki = "1 A/rad" }
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "2 s"
unit = "rpm"
"""
WORD = {"kind": "absolute", "bits": 24, "speed_method": "average", "window": 10}
REVERSING = {
    "scenario.turning.reference": {"offset": "0 rpm", "amplitude": "120 rpm", "frequency": "1 Hz"},
    "scenario.turning.initial_speed": "0 rpm",
    "metric.0.kind": "rms",
    "metric.0.signal": "omega_error",
}
RULE = {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}
SMOOTH = {"motor.cogging": []}
STRONG = {"motor.cogging": [{"order": 12, "torque": "12 mN*m"}]}
PUT_IN = {
    "sensor-steps": ("harmonic", {"drive.position_sensor": {**WORD, "bits": 12}}),
    "sensor-error": ("harmonic", {"drive.position_sensor": {**WORD, "eccentricity": "0.3 deg"}}),
    "delay": (
        "pi",
        {"drive.bus": {"delay_measured": "2 ms", "delay_command": "2 ms"}, "controller.pi": RULE},
    ),
    "dead-time": (
        "pi",
        {**SMOOTH, "drive.inverter.dead_time": "4 us", "scenario.turning.reference": "30 rpm"},
    ),
    "current-noise": ("harmonic", {"drive.current_sensors.noise": "50 mA"}),
    "current-error": ("harmonic", {"drive.current_sensors.offset": ["30 mA", "-10 mA", "0 A"]}),
    "learning-time": ("harmonic", {"scenario.turning.duration": "1.5 s", "metric.0.last": "0.5 s"}),
    "disturbance": ("pi", {}),
    "friction": ("pi", {**SMOOTH, **REVERSING, "mechanics.coulomb_friction": "20 mN*m"}),
    "limit": ("harmonic", {**STRONG, "drive.current_loop.current_limit": "0.3 A"}),
    "belief": ("harmonic", {"drive.belief": {"psi_f": "2 mWb"}}),
}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return studies.write(tmp_path_factory.mktemp("limits"), TEXT)


@pytest.fixture(scope="module")
def study(path):
    return load(path)


def limited(study: Study, controller: str) -> Results:
    return with_limits(run_study(study, [f"*/{controller}"], jobs=2), jobs=2)


def applied(study: Study, results: Results) -> None:
    """Each change that the sentence advises leaves what the sentence says, and clearly less than before."""
    (found,), told = results.limits.values(), limit(results, "turning")
    cures = [cure for cure in (found.setting, found.part) if cure is not None]
    assert [cure.changes for cure in cures] == [*told.cures]
    for cure, cured in zip(cures, told.cured(study), strict=True):
        value = simulate(cured, "turning", found.controller).metrics[found.metric]
        assert value == cure.value and value <= HELPING_SHARE * found.value


@pytest.mark.parametrize("cause", PUT_IN)
def test_the_cause_that_was_put_in_is_found_and_what_is_advised_helps(study, cause):
    controller, changes = PUT_IN[cause]
    of_cause = changed(study, changes)
    results = limited(of_cause, controller)
    found = results.limits["turning"]
    of_each = {each.name: each.share for each in found.causes}
    # Delay lets torque ripple through; a wrong flux linkage makes learning slow. So these causes appear, too.
    others = {"delay": {"disturbance"}, "belief": {"learning-time"}}.get(cause, set())
    first = next(each.name for each in found.named if each.name not in others)
    assert first == cause and 0.5 < of_each[cause] <= 1 and cause not in found.untried
    applied(of_cause, results)


def test_a_run_with_nothing_left_to_gain_has_no_limits(study):
    long = changed(study, {"scenario.turning.duration": "20 s"})
    results = limited(long, "harmonic")
    top = long.scenario["turning"].top_reference
    assert results.runs[0].metrics["ripple_rad_s"] < 1e-4 * top
    assert not results.limits and limit(results, "turning") is None


def test_steps_have_the_share_that_an_own_loop_gives_them(study):
    """Euler steps of J omega' = K_t i - cogging - load, and a PI on the counts of a millisecond.

    The share is a mean over several first angles, since the effect of the steps depends on their place."""
    angles, counts = np.array([0.0, 1.0, 2.0, 3.0]), 1 << 10

    def squares(counts: int | None) -> float:
        J, K_t, T, steps = 5e-5, 0.09, 1e-3, 20
        theta, omega, i = angles.copy(), np.full(4, 4 * math.pi), np.full(4, 0.02 / K_t)
        integral, past, speeds = i.copy(), theta - 4 * math.pi * T, []
        for _ in range(8000):
            seen = np.floor(theta * counts / math.tau) * math.tau / counts if counts else theta
            error, past = 4 * math.pi - (seen - past) / T, seen
            integral = integral + T * error
            for _ in range(steps):
                i = i + T / steps * math.tau * 500 * (0.04 * error + integral - i)  # a current loop of 500 Hz
                omega = omega + T / steps / J * (K_t * i - 0.02 - 0.002 * np.sin(12 * theta))
                theta = theta + T / steps * omega
            speeds.append(omega)
        return float(np.mean(np.var(speeds[-2000:], axis=0)))

    found = []
    for angle in angles:
        word = {
            "drive.position_sensor": {**WORD, "bits": 10},
            "scenario.turning.initial_angle": f"{angle} rad",
        }
        found.append(limited(changed(study, word), "pi").limits["turning"])
    fine = [c.value for each in found for c in each.causes if c.name == "sensor-steps"]
    share = 1 - np.mean(np.square(fine)) / np.mean([each.value**2 for each in found])
    assert np.mean(np.square(fine)) == pytest.approx(squares(None), rel=0.01)
    assert share == pytest.approx(1 - squares(None) / squares(counts), abs=0.15) and share > 0.3


def test_dead_time_has_all_of_the_sixth_electrical_order(study):
    """Dead time changes the voltage at the six zeros of the phase currents in an electrical revolution."""
    order = {"metric.0": {"name": "sixth", "kind": "order", "signal": "omega_m", "order": [6], "last": "2 s"}}
    order["metric.0"]["frame"] = "electrical"
    dead = {"drive.inverter.dead_time": "4 us", "scenario.turning.reference": "30 rpm"}
    found = limited(changed(study, {**dead, **order}), "pi").limits["turning"]
    first = found.named[0]
    assert (first.name, found.order) == ("dead-time", 6) and first.share > 0.99


def test_switching_is_a_cause_beside_metrics_that_only_a_switched_drive_has(study):
    """With the pulses' rows go their metrics; without them nothing else of the run changes."""
    pulses = {"name": "pulses", "kind": "switching-ripple", "signal": "tau_e"}
    voltage = {"name": "voltage", "kind": "rms", "signal": "u_a"}
    fine = {"drive.inverter.kind": "switched", "trace.rate": "160 kHz", "scenario.turning.duration": "0.5 s"}
    ripple = {"name": "torque", "kind": "ripple-rms", "signal": "tau_e", "last": "0.2 s"}
    switched = changed(study, {**SMOOTH, **fine, "metric": [ripple, pulses, voltage]})
    found = limits(switched, simulate(switched, "turning", "pi"), switched.metric[0], jobs=1)
    share = next(cause.share for cause in found.causes if cause.name == "switching")
    assert share > 0.99 and "switching" not in found.untried


def test_noise_has_a_share_by_its_square(study):
    """Twice the noise adds four times its square: s' = 4 s / (1 + 3 s)."""
    share = {}
    for noise in (10, 20):
        of_noise = changed(study, {"drive.current_sensors.noise": f"{noise} mA"})
        found = limited(of_noise, "pi").limits["turning"]
        share[noise] = next(each.share for each in found.causes if each.name == "current-noise")
    assert share[20] == pytest.approx(4 * share[10] / (1 + 3 * share[10]), abs=0.03)


def test_what_is_not_learned_falls_exponentially(study):
    """In the middle between D and 4 D, on the way of an exponential, lies the run of twice the duration."""
    short = changed(study, {"scenario.turning.duration": "1.5 s", "metric.0.last": "0.5 s"})
    found = limited(short, "harmonic").limits["turning"]
    first = found.named[0]
    assert first.name == "learning-time"
    twice = simulate(changed(short, {"scenario.turning.duration": "3 s"}), "turning", "harmonic")
    wanted = found.value ** (2 / 3) * first.value ** (1 / 3)
    assert twice.metrics["ripple_rad_s"] == pytest.approx(wanted, rel=0.25)


def test_an_overridden_sensor_is_changed_where_it_counts(study):
    word = {"drive.position_sensor": {**WORD, "bits": 12}}
    over = changed(study, {"scenario.turning.override": word})
    found = limited(over, "harmonic").limits["turning"]
    assert found.named[0].name == "sensor-steps"
    applied(over, limited(over, "harmonic"))


def test_a_rule_gives_its_numbers_anew_for_each_change(path):
    """The result for a law with the rule auto equals that of a user who sets the key in the study's file."""
    auto = {"law": "pi-ilc", "tuning": {"rule": "auto"}}
    only = {"controller.pi-ilc": auto, "drive.position_sensor": {**WORD, "bits": 12}}
    results = limited(load(path, only), "pi-ilc")
    found = results.limits["turning"]
    assert found.setting is not None
    anew = load(path, {**only, **found.setting.changes})
    assert simulate(anew, "turning", "pi-ilc").metrics["ripple_rad_s"] == found.setting.value


def test_a_cure_that_costs_elsewhere_says_so(study):
    """More feedback gain leaves less ripple, and more copper loss by the noise that it passes on."""
    loss = {"name": "loss", "kind": "copper-loss", "last": "2 s"}
    noisy = {
        "metric": [*study.source.tables["metric"], loss],
        "drive.position_sensor": {**WORD, "bits": 14},
        "mechanics.load": "0 N*m",
    }
    results = limited(changed(study, noisy), "pi")
    found = results.limits["turning"]
    (doubled,) = (cure for cure in found.cures if cure.changes.get('controller."pi".kp') == "0.08 A*s/rad")
    (cost,) = doubled.costs
    after = simulate(changed(changed(study, noisy), doubled.changes), "turning", "pi").metrics["loss_W"]
    assert (cost.metric, cost.value) == ("loss_W", after) and cost.ratio > 1.5


def test_a_change_that_helps_by_chance_is_not_advised(study):
    """Half a count per sample: what a change leaves with another seed is simulated here, change by change."""
    observer = {"speed_method": "observer", "observer_bandwidth": "60 Hz"}
    coarse = changed(
        study,
        {
            "drive.position_sensor": {"kind": "absolute", "bits": 8, **observer},
            "drive.current_sensors": {"noise": "20 mA"},
            "scenario.turning.reference": "60 rpm",
            "scenario.turning.initial_speed": "60 rpm",
            "seed": 2,
        },
    )
    limited = limits(coarse, simulate(coarse, "turning", "harmonic"), coarse.metric[0], jobs=1)
    assert limited is not None
    by_chance = [cure for cure in limited.cures if cure.by_chance]
    assert by_chance and limited.advised and not any(cure.by_chance for cure in limited.advised)

    def with_another_seed(changes):
        other = changed(coarse, {**changes, "seed": 0})
        return simulate(other, "turning", "harmonic").metrics["ripple_rad_s"]

    before = with_another_seed({})
    assert all(cure.value <= HELPING_SHARE * limited.value for cure in by_chance)
    assert all(with_another_seed(cure.changes) > HELPING_SHARE * before for cure in by_chance)
    assert all(with_another_seed(cure.changes) <= HELPING_SHARE * before for cure in limited.advised)
    text = str(remark(coarse, limited))
    assert "is not advised, since it helped by chance: with seed=2, but not with seed=0." in text
    assert "No change that was tried" not in text


def test_a_run_that_loses_its_speed_is_no_cure(study):
    """Without current the rotor stands still, and has no ripple at all."""
    (run,) = run_study(study, ["*/pi"]).runs
    tries = _Tries(study, run, study.metric[0], None, 1, None)
    (still,) = tries.metrics([{"drive.current_loop.current_limit": "1 uA"}])
    assert still == {}


def test_the_same_run_has_the_same_limits(study):
    word = changed(study, {"drive.current_sensors.noise": "50 mA"})
    (run,) = run_study(word, ["*/harmonic"]).runs
    first, again = (limits(word, run, word.metric[0], jobs=jobs) for jobs in (1, 2))
    assert first == again


def test_causes_of_which_each_covers_the_other_are_found_in_pairs(tmp_path):
    """Steps and cogging that give the same ripple each: without one of them the other is all that is seen."""
    masked = f"""title = "Masked"
{studies.IDEAL}
position_sensor = {{ kind = "absolute", bits = 10, window = 4 }}
[scenario]
turning = {{ duration = "2 s", reference = "60 rpm", initial_speed = "60 rpm" }}
[controller.pi]
law = "pi"
kp = "0.01 A/rpm"
ki = "0.1 A/rpm/s"
{TEXT[TEXT.index("[[metric]]") :].replace("2 s", "1 s")}"""
    found = limited(load(studies.write(tmp_path, masked)), "pi").limits["turning"]
    alone = [cause.share for cause in found.causes if len(cause.names) == 1]
    assert max(alone) < 0.1
    (first,) = found.named
    assert {"sensor-steps", "disturbance"} == {*first.names} and first.share > 0.9


def test_torque_ripple_that_a_law_fails_to_learn_explains_nothing(tmp_path):
    """A step motor's detent on 12 bits with an error of half a degree: a finer sensor alone doesn't help.

    The error is a hundred degrees of the detent's order 200, and the steps are a tenth of its period. The
    guard takes what is learned away, and leaves the ripple of the feedback alone in the end.
    """
    _, stepper = drafts.written(tmp_path, drafts.request("nema17", "stepper", "as5600"))
    turns = changed(stepper, {"scenario.slow.duration": "40 s"})
    found = limited(turns, "harmonic").limits["slow"]
    shares = {cause.name: cause.share for cause in found.causes}
    assert shares["disturbance"] > 0.9 and shares["sensor-steps"] < 0.3 and shares["sensor-error"] < 0.3
    assert set(found.named[0].names) == {"sensor-steps", "sensor-error"} and found.named[0].share > 0.9


def test_what_other_scenarios_need_doesnt_hide_a_cause(study):
    """Another scenario overrides an entry of a list that a cause empties, and shares a window."""
    fixed = changed(study, {"scenario.turning.duration": "1.5 s", "metric.0.last": "0.5 s"})
    metric = {"name": "ripple", "kind": "ripple-rms", "signal": "omega_m", "window": ["1 s", "1.5 s"]}
    other = {**fixed.source.tables["scenario"]["turning"], "override": {"motor.cogging.0.torque": "1 mN*m"}}
    two = changed(fixed, {"metric": [metric], "scenario.other": other})
    (run,) = run_study(two, ["turning/harmonic"]).runs
    found = limits(two, run, two.metric[0])
    assert found.untried == [] and [cause.name for cause in found.named] == ["learning-time"]
    assert {"learning-time", "disturbance"} <= {cause.name for cause in found.causes}
    assert found.setting is None or "scenario.turning.duration" not in found.setting.changes  # it doesn't fit


def test_hall_sensors_have_shares_of_their_steps_and_of_their_places():
    hub = changed(load("hub-motor"), {"scenario.walk.duration": "12 s", "metric.0.last": "3 s"})
    results = limited(changed(hub, {"scenario.ride.duration": "12 s"}), "pi-ilc")
    found = results.limits["walk"]
    assert {"sensor-steps", "sensor-error", "disturbance"} <= {cause.name for cause in found.causes}


def test_a_stepper_of_fifty_pole_pairs_is_limited_by_its_detent(study):
    """The detent pulls at sqrt(200 T / J) = 137 Hz, above the crossover. It makes nearly all the ripple."""
    motor = {"pole_pairs": 50, "R_s": "1.5 ohm", "L_d": "2.8 mH", "L_q": "2.8 mH", "K_t": "0.26 N*m/A"}
    detent = {"cogging": [{"order": 200, "torque": "20 mN*m"}]}
    nema = {
        "motor": {**motor, **detent, "slots": 48},
        "mechanics": {"inertia": "54 g*cm^2"},
        "drive.position_sensor": {"kind": "absolute", "bits": 14},
        "controller.pi": RULE,
        "scenario.turning.reference": "30 rpm",
        "scenario.turning.initial_speed": "30 rpm",
    }
    stepper = changed(study, nema)
    results = limited(stepper, "pi")
    found = results.limits["turning"]
    assert found.named[0].name == "disturbance" and found.named[0].share > 0.95
    applied(stepper, results)


def test_where_the_pi_is_best_a_change_is_tried_with_the_law_that_learns_too(study):
    """Harmonic learns the sensor's own error at a speed that the PI does not follow; a table mends both."""
    eccentric = changed(
        study,
        {
            **SMOOTH,
            "drive.position_sensor": {**WORD, "eccentricity": "0.3 deg"},
            "scenario.turning.reference": "600 rpm",
            "scenario.turning.initial_speed": "600 rpm",
        },
    )
    results = with_limits(run_study(eccentric, jobs=2), jobs=2)
    found, told = results.limits["turning"], limit(results, "turning")
    assert (found.controller, found.learner.controller) == ("pi", "harmonic")
    (alone,) = (run for run in results.runs if run.controller == "harmonic")
    assert found.learner.value == alone.metrics[found.metric] > found.value
    for cure, cured in zip(found.advised, told.cured(eccentric), strict=True):
        assert cure.learner == simulate(cured, "turning", "harmonic").metrics[found.metric]
    assert found.advised and "harmonic then left " in str(told)


def test_where_the_law_that_learns_is_best_it_alone_is_told(study):
    results = with_limits(run_study(changed(study, PUT_IN["sensor-steps"][1]), jobs=2), jobs=2)
    assert results.limits["turning"].controller == "harmonic" and results.limits["turning"].learner is None


# --- speeds that no controller holds

STOPS = math.sqrt(0.5)  # rms of a sine, as a share of the speed, whose troughs stop the rotor


def unsteady(study: Study, controller: str, changes: dict[str, object]) -> float:
    """The rms of the speed error / the reference in the last 3 s, with these changes."""
    trace = simulate(changed(study, changes), "slow", controller).trace
    late, reference = trace.time > trace.time[-1] - 3.0, study.scenario["slow"].top_reference
    return float(np.sqrt(np.mean((trace["omega_m"][late] / reference - 1) ** 2)))


@pytest.fixture(scope="module")
def stepper(tmp_path_factory):
    """A step motor at 20 r/min, whose rotor snaps from detent to detent with either law."""
    numbers = drafts.request("nema17", "stepper", "as5047", speed=20)
    return drafts.written(tmp_path_factory.mktemp("stepper"), numbers)[1]


@pytest.mark.parametrize(("bits", "settings"), [(14, 1), (12, 2)])
def test_where_no_controller_holds_the_speed_a_setting_is_advised_with_which_one_does(
    stepper, bits, settings
):
    """With coarser steps no single setting of `cogless new` is enough, but two together are."""
    coarse = changed(stepper, {"drive.position_sensor.bits": bits})
    assert min(unsteady(coarse, law, {}) for law in ("pi", "harmonic")) > STOPS
    results = with_limits(run_study(coarse, jobs=2), jobs=2)
    told = limit(results, "slow")
    (changes,) = told.cures
    new = {key for key in changes if f"{key} = " in str(told)}  # the others keep their values
    assert len(new) == settings and str(told).startswith("With drive.")
    (cured,) = told.cured(coarse)
    after = simulate(cured, "slow", "harmonic")
    assert unsteady(coarse, "harmonic", changes) < STOPS
    ripple = after.metrics["speed_ripple_rad_s"] * 30 / math.pi
    assert f"Harmonic held the speed: simulated again, it left {ripple:.2f} rpm." in str(told)
    for key in new if settings > 1 else ():
        assert unsteady(coarse, "harmonic", {key: changes[key]}) > STOPS


def test_where_no_setting_holds_the_speed_the_sentence_says_so(stepper):
    """Ten times the detent torque is too much for all settings of `cogless new`."""
    stuck = changed(stepper, {"motor.detent_torque": "135 mN*m"})
    results = with_limits(run_study(stuck, jobs=2), jobs=2)
    ways = "the rate of the speed loop, an observer, dead-time compensation and a slower current loop"
    assert f" Tried in vain to hold the speed with Harmonic: {ways}." in str(limit(results, "slow"))
    assert to_dict(results)["limits"][0]["in_vain"]["controller"] == "harmonic"
    quick = {"drive.rates.speed_loop": "20 kHz", "drive.dead_time_compensation": {"band": "6 mA"}}
    assert unsteady(stuck, "harmonic", quick) > STOPS


def test_no_setting_is_advised_against_the_bus_voltage(stepper):
    fast = {"scenario.slow.reference": "1200 rpm", "scenario.slow.initial_speed": "0 rpm"}
    shorter = {"scenario.slow.duration": "2 s", "drive.rates.integration_steps": 8}
    beyond = changed(
        stepper, {**fast, **shorter, "metric": stepper.source.tables["metric"][:1], "metric.0.last": "1 s"}
    )
    results = run_study(beyond, jobs=2)
    assert all(run.trace["omega_m"][-1] < 0.9 * run.trace["omega_ref"][-1] for run in results.runs)
    assert limit(with_limits(results, jobs=2), "slow") is None


# --- advice that one scenario gives and another pays for

GIMBAL = """title = "A gimbal motor at two speeds"
[motor]
pole_pairs = 7
slots = 12
R_s = "0.5 ohm"
L_d = "0.4 mH"
L_q = "0.4 mH"
K_t = "0.06 N*m/A"
cogging = [ {order = 84, torque = "20 mN*m"} ]
[mechanics]
inertia = "6e-5 kg*m^2"
coulomb_friction = "1 mN*m"
[drive]
rates = { current_loop = "20 kHz", speed_loop = "4 kHz" }
current_loop = { bandwidth = "1 kHz", current_limit = "8 A" }
inverter = { bus_voltage = "24 V" }
position_sensor = { kind = "absolute", bits = 11 }
[scenario]
at_60_rpm = { duration = "6 s", reference = "60 rpm", initial_speed = "60 rpm" }
at_10_rpm = { duration = "8 s", reference = "10 rpm", initial_speed = "10 rpm" }
[controller.law]
law = "pi"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "3 s"
unit = "rpm"
"""
LEARNING = {"controller.law": {"law": "harmonic", "tuning": {"rule": "auto"}}}
COGS_LESS = {"motor.cogging": [{"order": 84, "torque": "8 mN*m"}, {"order": 12, "torque": "2 mN*m"}]}
COARSE = {"drive.position_sensor": {"kind": "encoder", "lines": 1024}, "mechanics.coulomb_friction": "4 mN*m"}
AT_TWO_SPEEDS = {
    "a law that reads the steps as motion": {},
    "friction": {"mechanics.coulomb_friction": "10 mN*m"},
    "edges that come late": {**LEARNING, **COGS_LESS, **COARSE},
    "fine steps": {"drive.position_sensor.bits": 14},
}
HELD = 0.05  # mean speed error / reference, with which a speed counts as held


def left(study: Study, scenario: str) -> float | None:
    """The ripple in the last 3 s of a run, rad/s; None if the mean speed is off."""
    trace = simulate(study, scenario, "law").trace
    late = trace["omega_m"][trace.time > trace.time[-1] - 3.0]
    reference = study.scenario[scenario].top_reference
    return float(np.std(late)) if abs(np.mean(late) / reference - 1) < HELD else None


@pytest.mark.parametrize("what", AT_TWO_SPEEDS)
def test_advice_says_what_it_does_to_the_other_scenario(what, tmp_path):
    """Each advised change is put into the study by hand, and the other scenario is run with it."""
    study = load(studies.write(tmp_path, GIMBAL), AT_TWO_SPEEDS[what])
    results = with_limits(run_study(study, jobs=2), jobs=2)
    advised = 0
    for scenario, found in results.limits.items():
        (other,) = {*study.scenario} - {scenario}
        told, before = limit(results, scenario), left(study, other)
        for cure in found.advised if told is not None and before is not None else ():
            path, changes = studies.write(tmp_path, GIMBAL), {**AT_TWO_SPEEDS[what], **cure.changes}
            after = left(load(path, changes), other)
            advised += 1
            if after is None:
                assert f"; but in {other} law then did not hold the speed" in str(told)
            elif before <= HELPING_SHARE * after:
                assert f"; but in {other} law then left {after / before:.3g} times as much" in str(told)
            else:
                assert "; but in" not in str(told)
    assert advised


def test_a_change_that_harms_another_scenario_gives_way_to_one_that_does_not(tmp_path):
    """Timed edges mend 60 rpm. At 10 rpm they come too late for the feedback, and the rotor runs away."""
    study = load(studies.write(tmp_path, GIMBAL), AT_TWO_SPEEDS["edges that come late"])
    results = with_limits(run_study(study, jobs=2), jobs=2)
    found = results.limits["at_60_rpm"]
    best, setting = found.cures[0], next(cure for cure in found.cures if cure.setting)
    assert setting.changes == {"drive.position_sensor.speed_method": "MT"} and best.value <= setting.value
    timed = changed(study, setting.changes)
    assert left(timed, "at_60_rpm") < HELPING_SHARE * left(study, "at_60_rpm")
    assert left(timed, "at_10_rpm") is None and [harm.value for harm in setting.harms] == [None]
    assert found.setting is not setting and found.setting.value > setting.value and not found.setting.harms
    assert "MT" not in str(limit(results, "at_60_rpm"))
