"""What a position sensor leaves of the ripple: the design's answer beside runs, and a closed form."""

from __future__ import annotations

import io
import json
import math
import re
from pathlib import Path
from typing import Any

import drafts
import numpy as np
import pytest
from rich.console import Console
from scipy.special import jv

from cogless import run_study
from cogless.design.answers import to_dict
from cogless.design.closed_loop import Linear
from cogless.design.current_needed import limited_share, noisy_voltage
from cogless.design.design_table import design_table
from cogless.design.law_rules import feedback_of
from cogless.design.ripple import current_noise, disturbed
from cogless.design.sensor_limits import held_share, remaining, steps_density
from cogless.design.speed_blocks import speed_blocks
from cogless.design.speed_loop import CurrentLoop, IdealLoop, SpeedLoop, gains, speed_loop
from cogless.design.summary import design
from cogless.run.simulate import simulate
from cogless.study import Study, changed
from cogless.study.position_sensor import Absolute


@pytest.fixture(autouse=True)
def by_rules(monkeypatch: pytest.MonkeyPatch) -> None:
    drafts.drafted_by_rules(monkeypatch)


AS_MUCH = 0.95  # ripple with learning / without, from which on it is as much
NEVER = {"controller.harmonic.learning_start": "1e6 s"}


def answer(study: Study) -> str:
    """What `cogless design` says of the learning of `harmonic`."""
    (block,) = (block for block in speed_blocks(study).blocks if block.heading.startswith("Harmonic"))
    return dict(block.rows)["settles"]


def ratio(study: Study) -> float:
    """The ripple of a run with learning over the least of PI and learning off, at the draft's speed."""
    (scenario,) = study.scenario
    pi, learned = run_study(study, [f"{scenario}/pi", f"{scenario}/harmonic"], jobs=1).runs
    (off,) = run_study(changed(study, NEVER), [f"{scenario}/harmonic"], jobs=1).runs
    metrics = [run.metrics["speed_ripple_rad_s"] for run in (pi, off, learned)]
    *alone, left = np.asarray(metrics, dtype=float)
    return float(left / min(alone))


@pytest.mark.parametrize(
    ("motor", "drive", "encoder", "numbers", "begins", "helps"),
    [
        ("nema17", "stepper", "as5600", {}, "not worth it: at 50 rpm learning leaves 14.8 rpm", False),
        ("nema17", "stepper", "as5600", {"speed": 150}, "not worth it: at 150 rpm", False),
        ("nema17", "stepper", "absolute", {"bits": 18}, "yes, orders 50, 100, ..., 1200, in about ", True),
        ("hub", "generic", "incremental", {"cpr": 4096}, "not worth it: at 10 rpm", False),
        ("hub", "generic", "absolute", {"bits": 18}, "yes, orders 3, 6, ..., 384, in about ", True),
        ("hub", "vesc", "as5047", {"speed": 40}, "not sure: at 40 rpm the position sensor's steps cause ",
            False),
        ("gimbal", "moteus", "as5600", {},
            "not sure: at 20 rpm the position sensor gives 0.23 counts per speed sample, ", False),
        ("gimbal", "generic", "absolute", {"bits": 18}, "yes, orders 2, 4, ..., 256, in about ", True),
        ("gimbal", "generic", "as5600", {"speed": 70}, "yes, orders 2, 4, ..., 256, in about ", True),
        ("drone", "moteus", "as5600", {}, "not sure: at ", False),
        ("drone", "generic", "as5048", {"speed": 200}, "yes, orders 2, 4, ..., 256, in about ", True),
    ],
)  # fmt: skip
def test_a_plain_yes_never_comes_where_learning_leaves_as_much(
    motor: str, drive: str, encoder: str, numbers: dict[str, Any], begins: str, helps: bool, tmp_path: Path
) -> None:
    """A plain yes is one that neither doubts nor comes after the run's end. The guard is on."""
    _, draft = drafts.written(tmp_path, drafts.request(motor, drive, encoder, **numbers))
    says, left = answer(draft), ratio(draft)
    assert says.startswith(begins)
    plain = says.startswith("yes, ") and "(scenario slow lasts only " not in says
    assert plain is helps
    assert helps is (left < AS_MUCH), left


def test_steps_that_beat_with_the_law_are_doubted_and_the_advised_rate_helps(tmp_path: Path) -> None:
    """AS5600 at 60 r/min: 4096 steps a second in a law of 4 kHz. Over 6 s learning leaves as much."""
    _, draft = drafts.written(tmp_path, drafts.request("gimbal", "generic", "as5600", speed=60))
    assert re.match(
        r"not sure: at 60 rpm the position sensor's steps cause [12]\.\d\d rpm of ripple while the law "
        r"learns; the feedback alone leaves 2\.\d\d rpm\. The sensor's 4096 steps a "
        r"second, sampled by the law at 4000 Hz, alias to 96 Hz, which the law mistakes for motion; "
        r"drive\.rates\.speed_loop = \"2500 Hz\" would be enough by "
        r"calculation; runs with several seeds \(--set seed=1, --set seed=2, \.\.\.\) show whether "
        r"learning helps\. Without this effect the answer is yes, ",
        answer(draft),
    )
    assert ratio(draft) > AS_MUCH
    (cure,) = to_dict(draft)["controllers"]["harmonic"]["answer"]["cures"]
    cured = changed(draft, cure)
    assert answer(cured).startswith("yes, ")
    assert ratio(cured) < 0.6


@pytest.mark.parametrize(("speed", "bits"), [(60, 12), (57, 12), (70, 12), (61, 13), (33, 13)])
def test_ripple_that_the_steps_make_at_the_first_rate_is_that_of_a_run(
    speed: float, bits: int, tmp_path: Path
) -> None:
    """Nothing is there to learn. The rate is the first one for 3 s."""
    _, draft = drafts.written(tmp_path, drafts.request("gimbal", "generic", "as5600", speed=speed))
    changes = {
        "motor.cogging": [],
        "drive.position_sensor.error": [],
        "drive.position_sensor.bits": bits,
        "drive.inverter.dead_time": 0.0,
        "drive.current_sensors.noise": 0.0,
        "drive.current_sensors.bits": 0,
        "drive.guard": False,
    }
    quiet = changed(draft, changes)
    certified = design(quiet, "harmonic").certificate
    assert certified is not None
    (at_speed,) = remaining(quiet, "harmonic", certified)
    (scenario,) = quiet.scenario
    trace = simulate(quiet, scenario, "harmonic").trace
    learning = (trace["time"] > 1.0) & (trace["time"] < 3.0)
    expected = math.hypot(at_speed.steps_learning, at_speed.steps)
    assert np.std(trace["omega_m"][learning]) == pytest.approx(expected, rel=0.35)


@pytest.mark.parametrize(
    ("counts", "spread"), [(1.024, 0.03), (1.08, 0.01), (2.048, 0.08), (0.51, 0.02), (1.4, 0.3), (10.3, 0.01)]
)
def test_density_of_the_steps_is_that_of_a_sampled_sawtooth(counts: float, spread: float) -> None:
    """Four million samples of an angle in steps, whose speed varies slowly by a normal distribution."""
    samples, bands, random = 1 << 22, 64, np.random.default_rng(4)
    slow = np.fft.irfft(np.fft.rfft(random.standard_normal(samples)) * (np.arange(samples // 2 + 1) < 3000))
    angle = np.cumsum(counts + spread * slow / np.std(slow))
    power = np.abs(np.fft.rfft(angle % 1.0 - 0.5)) ** 2
    measured = power[1:].reshape(bands, -1).mean(axis=1) / np.mean(power[1:])
    middle, width = 0.5 * (np.arange(bands) + 0.5) / bands, 0.25 / bands
    predicted = steps_density(counts, spread, middle, width)
    assert predicted == pytest.approx(measured, rel=0.1, abs=0.04 * np.max(measured))


def test_json_and_the_long_table_have_the_answer_s_numbers(tmp_path: Path) -> None:
    """In SI units the one, in those of the study the other."""
    _, draft = drafts.written(tmp_path, drafts.request("nema17", "stepper", "as5600"))
    plain = json.loads(json.dumps(to_dict(draft), allow_nan=False))["controllers"]
    assert plain["pi"]["answer"] is None
    of_harmonic = plain["harmonic"]["answer"]
    assert of_harmonic["verdict"] == "not worth it"
    assert answer(draft) == f"not worth it: {of_harmonic['reason']}"
    assert of_harmonic["not_in_model"] == [
        "dead time",
        "current noise",
        "the position sensor's steps and error",
    ]
    (time,), (left,) = of_harmonic["settling"], of_harmonic["ripple"]
    assert time["scenario"] == "slow"
    assert time["in_time"] is (time["time_s"] <= time["duration_s"])
    assert (left["worth_it"], left["modelled"]) == (False, False)
    names = ("sensor_steps", "sensor_error", "unlearned_orders", "current_noise")
    assert left["learned_rad_s"] == pytest.approx(math.hypot(*(left[f"{part}_rad_s"] for part in names)))
    file = io.StringIO()
    Console(file=file, width=240).print(design_table(draft))
    (row,) = (line for line in file.getvalue().splitlines() if re.match(r"Harmonic +50 rpm ", line))
    shown = [float(number) for number in re.findall(r"([\d.]+) rpm", row)]
    keys = ("omega_m", "alone", "learned", *names)
    assert shown == pytest.approx([left[f"{key}_rad_s"] * 30 / math.pi for key in keys], rel=0.01)
    assert answer(draft) in " ".join(file.getvalue().split())


def test_what_an_unlearned_error_of_the_sensor_leaves_is_that_of_a_run(tmp_path: Path) -> None:
    """A step motor on 18 bits at a speed at which the law does not learn the sensor's error."""
    _, draft = drafts.written(tmp_path, drafts.request("nema17", "stepper", "absolute", bits=18))
    certified = design(draft, "harmonic").certificate
    assert certified is not None
    (speed,) = remaining(draft, "harmonic", certified)
    assert speed.modelled
    assert speed.worth_it
    assert speed.error > 0.98 * speed.learned
    assert speed.learned / speed.alone == pytest.approx(ratio(draft), rel=0.15)


@pytest.mark.parametrize(("sensors", "bits"), [(3, 0), (2, 0), (3, 9)])
def test_noise_of_the_current_sensors_is_that_of_a_run(sensors: int, bits: int, tmp_path: Path) -> None:
    """A rotor without cogging on a fine angle, so that the noise is all. Nine bits have steps of 39 mA."""
    _, draft = drafts.written(tmp_path, drafts.request("gimbal", "moteus", "as5047"))
    quiet = changed(
        draft,
        {
            "motor.cogging": [],
            "drive.position_sensor.error": [],
            "drive.position_sensor.bits": 24,
            "drive.inverter.dead_time": 0.0,
            "drive.current_sensors": {
                "noise": "30 mA" if not bits else "15 mA",
                "bits": bits,
                "range": "10 A",
                "sensors": sensors,
            },
        },
    )
    (scenario,) = quiet.scenario
    (run,) = run_study(quiet, [f"{scenario}/pi"], jobs=1).runs
    omega = quiet.scenario[scenario].constant_speed
    assert omega is not None
    feedback = feedback_of(quiet, "pi", omega)
    assert feedback is not None
    variance = current_noise(quiet, speed_loop(quiet, scenario), feedback)
    assert run.metrics["speed_ripple_rad_s"] == pytest.approx(math.sqrt(variance), rel=0.04)


def test_noise_of_the_current_sensors_is_that_of_an_independent_plant(tmp_path: Path) -> None:
    """A winding, a rotor, a current loop that is a period late, an observer of the angle and a speed PI."""
    _, draft = drafts.written(tmp_path, drafts.request("gimbal", "moteus", "as5047"))
    study = changed(draft, {"drive.current_sensors": {"noise": "50 mA", "sensors": 3}})
    (scenario,) = study.scenario
    omega_ref = study.scenario[scenario].constant_speed
    assert omega_ref is not None
    loop, (kp, ki), random = speed_loop(study, scenario), gains(study, "pi"), np.random.default_rng(1)
    current, dt, substeps = loop.current, loop.current.period, 2
    rows = 300_000  # 10 s, in which the noise about the crossover tells its rms to 2 %
    noise = 0.05 * math.sqrt(2 / 3) * random.standard_normal(rows)  # of i_q
    theta = theta_hat = i_q = i_q_ref = integral = integral_i = u_next = 0.0
    omega = omega_hat = omega_ref
    omegas = np.empty(rows)
    for row in range(rows):
        u, error_i = u_next, i_q_ref - i_q - noise[row]
        integral_i += current.ki * dt * error_i
        u_next = current.kp * error_i + integral_i
        theta_hat += omega_hat * dt
        error = theta - theta_hat
        theta_hat += 2 * loop.bandwidth * dt * error
        omega_measured = omega_hat + 2 * loop.bandwidth * error
        omega_hat += loop.bandwidth**2 * dt * error
        if row % loop.steps == 0:
            integral += ki * loop.period * (omega_ref - omega_measured)
            i_q_ref = kp * (omega_ref - omega_measured) + integral
        for _ in range(substeps):
            i_q += dt / substeps / current.L * (u - current.R * i_q)
            omega += dt / substeps * loop.b * i_q
            theta += dt / substeps * omega
        omegas[row] = omega
    feedback = feedback_of(study, "pi", omega_ref)
    assert feedback is not None
    variance = current_noise(study, loop, feedback)
    assert np.std(omegas[rows // 10 :]) == pytest.approx(math.sqrt(variance), rel=0.07)


@pytest.mark.parametrize(("speed", "noise"), [(240, 0.06), (100, 0.08), (240, 0.04)])
def test_share_of_limited_periods_is_that_of_drawn_voltages(
    speed: float, noise: float, tmp_path: Path
) -> None:
    """kp times the measured noise, beside the back-EMF, in five current periods of the law's."""
    _, draft = drafts.written(tmp_path, drafts.request("servo", "moteus", "as5048", speed=speed))
    sensors = {"noise": f"{noise} A", "sensors": 3}
    study = changed(draft, {"drive.current_sensors": sensors, "drive.inverter.bus_voltage": "44 V"})
    loop, motor, (scenario,) = speed_loop(study).current, study.motor.star(), study.scenario
    assert isinstance(loop, CurrentLoop)
    phases = noise * np.random.default_rng(3).standard_normal((40_000, 5, 3))
    alpha = phases @ np.array([2, -1, -1]) / 3
    beta = phases @ np.array([0, 1, -1]) / math.sqrt(3)
    emf = motor.pole_pairs * motor.psi_f * speed * math.pi / 30
    voltages = np.hypot(loop.kp * alpha, loop.kp * beta + emf)
    drawn = np.mean(np.any(voltages > 44 / math.sqrt(3), axis=1))
    assert limited_share(study, scenario) == pytest.approx(drawn, rel=0.05, abs=0.003)
    remark = noisy_voltage(study, scenario)
    assert (remark is not None) is bool(drawn > 0.1)


def test_a_law_of_hall_sensors_without_an_order_of_the_torque_is_not_worth_it(tmp_path: Path) -> None:
    """15 pole pairs give the misplaced edges order 15: the law learns up to 14, the cogging has 27 and up.

    The learning does harm in the run. With the encoder that is advised it leaves less than the PI.
    """
    _, draft = drafts.written(tmp_path, drafts.request("hub", "vesc", "hall"))
    says = "the law learns orders 1 to 14, but the torque has only orders 27, 30, 270"
    assert answer(draft) == f"not worth it: {says}"
    assert ratio(draft) > 0.9
    one = {"order": 3, "torque": "50 mN*m"}
    with_order = [*draft.source.tables["motor"]["cogging"], one]
    assert answer(changed(draft, {"motor.cogging": with_order})).startswith("yes")
    numbers = {"pole_pairs": 15, "kv": 16, "resistance": 0.4}
    _, draft = drafts.written(tmp_path, drafts.request("hub", "odrive", "hall", **numbers))
    (cure,) = to_dict(draft)["controllers"]["harmonic"]["answer"]["cures"]
    assert answer(draft).startswith(f"not worth it: {says}; with drive.position_sensor = ")
    cured = changed(draft, cure)
    assert answer(cured).startswith("yes, ")
    assert ratio(cured) < 0.6 < 0.9 < ratio(draft)


@pytest.mark.parametrize(
    ("order", "base", "amplitude", "bends"), [(200, 50, 0.005, 0), (12, 1, 0.1, 0), (270, 3, 0.004, 1)]
)
def test_the_share_that_orders_hold_is_that_of_bessel_functions(
    order: int, base: int, amplitude: float, bends: int
) -> None:
    """One wave of error: the sum of J_k(n a)^2 over the n + k that are learned; all of it if e is learned."""
    sensor = Absolute.model_validate(
        {
            "kind": "absolute",
            "bits": 14,
            "error": [{"order": 1, "amplitude": f"{amplitude} rad", "phase": "0.7 rad"}],
        }
    )
    highest = 6 * order // base * base
    held = np.arange(base, highest + 1, base)
    expected = 1.0 if bends else float(np.sum(jv(held - order, order * amplitude) ** 2))
    assert held_share(sensor, order, base, highest, bends) == pytest.approx(expected, abs=1e-9)
    assert math.isclose(expected, 1.0) is bool(bends or base == 1)


@pytest.mark.parametrize("window", [0, 1])
def test_torque_waves_disturb_the_speed_as_in_an_own_plant_up_to_far_above_the_laws_rate(window: int) -> None:
    """The law samples the speed itself (window 0) or the angle at 200 Hz. The plant takes exact steps."""
    b, T, k, k_i, fine = 80.0, 0.005, 0.3, 2.0, 40
    loop = SpeedLoop(b=b, steps=1, window=window, current=IdealLoop(T))

    def amplitude(w: float) -> float:
        speed = angle = last = total = 0.0
        speeds = []
        for n in range(6000):
            measured = (angle - last) / T if window else speed
            total, last = total + measured, angle
            current = -(k * measured + k_i * T * total)
            t = T * (n + np.arange(fine + 1) / fine)
            course = speed + b * (current * (t - t[0]) + (np.sin(w * t) - np.sin(w * t[0])) / w)
            angle += speed * T + b * (current * T**2 / 2)
            angle += b / w * ((math.cos(w * t[0]) - math.cos(w * t[-1])) / w - math.sin(w * t[0]) * T)
            speed = float(course[-1])
            speeds.append(course[:-1])
        return math.sqrt(2) * float(np.std(np.concatenate(speeds[3000:])))

    frequencies = np.array([3.0, 11, 30, 50, 80, 130, 230, 411, 733, 1003, 2550.5])
    computed = disturbed(loop, Linear(ratio=1, k=k, k_i=k_i), frequencies)
    assert computed == pytest.approx([amplitude(math.tau * f) for f in frequencies], rel=0.04)
