"""Studies of step motors and of laws that learn in angle: what they mean, and mistakes as one line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.results.trace import Trace
from cogless.run.carry_out import measure
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.drive import Belief
from cogless.study.motion import course
from cogless.study.motor import StepMotor
from cogless.study.scenario import Scenario

STEP = {
    "kind": "step",
    "teeth": 50,
    "R_s": "1 ohm",
    "L_0": "0.7 mH",
    "L_m": ["5 mH", "0.5 mH"],
    "L_f": ["1.766 mH"],
}
SPACE = {"law": "space-position", "k_theta": 5, "k_omega": 0.1, "mu_alpha": 5.0}
SPEED = {
    "law": "space-speed",
    "k": 0.1,
    "eta_bar": "1 rad/s",
    "mu_alpha": 5.0,
    "period": {"of": "mechanical"},
}


def line_of(folder: Path, changes: dict[str, Any]) -> str:
    return studies.refusal(studies.study, folder, changes).removeprefix("study.toml: ")


def test_a_step_motor_in_the_words_of_the_plant() -> None:
    star = StepMotor.model_validate(STEP).star()
    assert (star.phases, star.pole_pairs, star.power_factor) == (2, 50, 1.0)
    assert star.K_t == pytest.approx(50 * 5e-3)
    (harmonic,) = star.flux_harmonics
    assert (harmonic.order, harmonic.d, harmonic.q) == (1, 0.5e-3, 0.5e-3)
    (cogging,) = star.cogging
    assert cogging.order == 200 and cogging.torque == pytest.approx(-0.5 * 50 * 4 * 1.766e-3)


def test_a_step_motor_with_a_saliency_and_gaps_among_its_harmonics() -> None:
    """L_d and L_q are L_0 +- L_1. Flux is in proportion to i_f, and cogging to its square."""
    more = {"L_1": "0.1 mH", "i_f": "2 A", "L_m": ["5 mH", "0 mH", "0.2 mH"], "L_f": ["0 mH", "1 mH"]}
    star = StepMotor.model_validate({**STEP, **more}).star()
    assert (star.L_d, star.L_q, star.psi_f, star.K_t) == pytest.approx((0.8e-3, 0.6e-3, 0.01, 0.5))
    (harmonic,), (cogging,) = star.flux_harmonics, star.cogging
    assert (harmonic.order, harmonic.d, harmonic.q) == (2, 0.4e-3, 0.4e-3)
    assert (cogging.order, cogging.torque) == (250, pytest.approx(-0.5 * 50 * 4 * 5 * 1e-3))
    belief = Belief.model_validate({"R_s": "1.2 ohm", "L_q": "0.5 mH", "psi_f": "8 mWb"}).resolved(star)
    assert (belief.R_s, belief.L_d, belief.L_q, belief.psi_f) == pytest.approx((1.2, 0.8e-3, 0.5e-3, 8e-3))


DATASHEET = {
    "kind": "step",
    "step_angle": "1.8 deg",
    "R_s": "1 ohm",
    "L_0": "1 mH",
    "holding_torque": "0.59 N*m",
    "rated_current": "2 A",
    "detent_torque": "6 mN*m",
}


def test_a_step_motor_in_the_words_of_its_datasheet() -> None:
    """L_m1 = 4.17193 mH and L_f4 = 60 uH hold .590 N m and have a detent of 6 mN m, measured in runs."""
    words = {key: DATASHEET[key] for key in ("kind", "R_s", "L_0")}
    plain = {**words, "teeth": 50, "L_m": ["4.17193 mH"], "L_f": ["60 uH"]}
    star, other = (StepMotor.model_validate(motor).star() for motor in (DATASHEET, plain))
    assert star.pole_pairs == other.pole_pairs == 50
    assert star.K_t == pytest.approx(other.K_t, rel=1e-5)
    assert star.cogging == (pytest.approx(other.cogging[0]),)
    assert star.K_t * 2 * math.sqrt(2) == pytest.approx(0.59)


def test_a_third_harmonic_that_turns_backwards_and_the_detent_by_the_coils_own_fluxes(tmp_path: Path) -> None:
    """The torque of each coil is its current times the slope of its flux; both are alike."""
    motor = {**DATASHEET, "L_m_backward": ["0 mH", "0 mH", "0.3 mH"]}
    trace = simulate(studies.study(tmp_path, {"motor": motor}), "low", "pi").trace
    theta_e = 50 * trace["theta_m"]
    i_a = trace["i_d"] * np.cos(theta_e) - trace["i_q"] * np.sin(theta_e)
    i_b = trace["i_d"] * np.sin(theta_e) + trace["i_q"] * np.cos(theta_e)
    first, third = 0.59 / (math.sqrt(2) * 2 * 50), 0.3e-3  # Wb

    def slope(angle: Any) -> Any:
        """Of the flux of a coil whose axis lies at zero, over the mechanical angle."""
        return -50 * (first * np.sin(angle) + 3 * third * np.sin(3 * angle))

    torque = i_a * slope(theta_e) + i_b * slope(theta_e - math.pi / 2) - 6e-3 * np.sin(4 * theta_e)
    assert trace["tau_motor"] == pytest.approx(torque, rel=1e-9, abs=1e-12)
    assert np.ptp(trace["i_q"]) > 0.01


TEETH = 'expected either teeth, such as 50, or step_angle, such as "1.8 deg"'
STEP_ANGLE = 'expected 360 deg divided by four times the number of teeth, such as "1.8 deg"'
MAGNET = 'expected either L_m, such as ["5 mH"], or holding_torque, such as "0.4 N*m"'


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step_angle": None}, f"teeth: missing: {TEETH}"),
        ({"teeth": 50},
            'step_angle: "1.8 deg": expected no such key, since teeth is given: delete step_angle, or '
            'delete teeth'),
        ({"step_angle": "1.7 deg"}, f'step_angle: "1.7 deg": {STEP_ANGLE}'),
        ({"step_angle": "-1.8 deg"}, f'step_angle: "-1.8 deg": {STEP_ANGLE}'),
        ({"step_angle": "0 deg"}, f'step_angle: "0 deg": {STEP_ANGLE}'),
        ({"rated_current": None},
            "rated_current: missing: expected the direct current of each phase at the holding torque, such "
            'as "1.5 A"'),
        ({"holding_torque": None}, f"L_m: missing: {MAGNET}"),
        ({"L_m": ["5 mH"]}, 'holding_torque: "0.59 N*m": expected no such key, since L_m is given: '
            "delete holding_torque, or delete L_m"),
        ({"L_f": ["5 mH"]}, 'L_f: ["5 mH"]: expected no such key, since detent_torque is given: delete L_f, '
            "or delete detent_torque"),
    ],
)  # fmt: skip
def test_words_of_a_step_motor_that_do_not_go_together(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    motor = {key: value for key, value in {**DATASHEET, **change}.items() if value is not None}
    assert line_of(tmp_path, {"motor": motor}) == f"motor.{message}"


def test_a_change_of_one_word_replaces_the_other(tmp_path: Path) -> None:
    path = studies.write(tmp_path)
    for key, value, K_t, teeth in (
        ("teeth", 100, 0.59 / math.sqrt(8), 100),
        ("L_m", ["5 mH"], 0.25, 50),
        ("L_f", ["90 uH"], 0.59 / math.sqrt(8), 50),
    ):
        star = load(path, {"motor": DATASHEET, f"motor.{key}": value}).motor.star()
        assert (star.K_t, star.pole_pairs) == (pytest.approx(K_t), teeth)
        if key == "L_f":
            assert star.cogging[0].torque == pytest.approx(-9e-3)


SINE = {"offset": "3 rad/s", "amplitude": "1 rad/s", "frequency": "2 Hz"}
STEEPEST = 10 / math.sqrt(3)  # of a move from rest to rest, over distance / time^2


@pytest.mark.parametrize(
    ("reference", "initial", "speeds", "acceleration"),
    [
        ({"speed": "2 rad/s"}, 0.0, (2.0, 2.0), 0.0),
        ({"speed": "-2 rad/s"}, 0.0, (-2.0, -2.0), 0.0),
        ({"speed": "0 rad/s"}, 0.0, (0.0, 0.0), 0.0),
        (SINE, 0.0, (2.0, 4.0), 4 * math.pi),
        ({**SINE, "depth": 0.5, "modulation": "1 Hz"}, 0.0, (2.0, 4.0), 5 * math.pi),
        ({"offset": "1 rad/s", "sines": [{"amplitude": "2 rad/s", "frequency": "1 Hz"}]}, 0.0, (-1.0, 3.0),
            4 * math.pi),
        ({"moves": [["0 s", "0 rad"], ["2 s", "4 rad"]]}, 0.0, (0.0, 3.75), STEEPEST),
        ({"moves": [["0 s", "0 rad"], ["2 s", "4 rad"], ["3 s", "3 rad"]]}, 0.0, (-1.875, 3.75), STEEPEST),
        ({"profile": [["0 s", "1 rad/s"], ["2 s", "5 rad/s"]]}, 0.0, (1.0, 5.0), 2.0),
        ({"speed": "0.4 rad/s", "ramp": "1 rad/s^2"}, 0.3, (0.3, 0.4), 1.0),
        ({"speed": "0.3 rad/s", "ramp": "0.1 rad/s^2"}, 3.0, (0.3, 3.0), 0.1),
        ({"speed": "0.3 rad/s", "ramp": "0.5 rad/s^2"}, -1.0, (-1.0, 0.3), 0.5),
        ({"speed": "2 rad/s", "smoothing": "0.5 s"}, -1.0, (-1.0, 2.0), 3 / (math.e * 0.5)),
    ],
)  # fmt: skip
def test_what_a_reference_asks_at_most(
    reference: dict[str, Any], initial: float, speeds: tuple[float, float], acceleration: float
) -> None:
    plain = {"duration": "40 s", "reference": reference, "initial_speed": f"{initial} rad/s"}
    scenario = Scenario.model_validate(plain)
    assert scenario.speeds == pytest.approx(speeds)
    assert scenario.top_reference == pytest.approx(max(map(abs, speeds)))
    turns = min(speeds) <= 0 <= max(speeds)
    assert scenario.slowest == pytest.approx(0.0 if turns else min(map(abs, speeds)))
    assert scenario.constant_speed == (abs(speeds[0]) if speeds[0] == speeds[1] != 0 else None)
    assert scenario.top_acceleration == pytest.approx(acceleration)
    # and its samples come up to these bounds, but not beyond
    way = course(scenario)
    assert way.omega.min() >= speeds[0] - 1e-9 and way.omega.max() <= speeds[1] + 1e-9
    assert np.ptp(way.omega) == pytest.approx(speeds[1] - speeds[0], abs=0.01 * max(1.0, speeds[1]))
    assert np.abs(way.alpha).max() == pytest.approx(acceleration, rel=0.03)


@pytest.mark.parametrize(
    ("reference", "samples"),
    [
        ({"speed": "2 rad/s"}, 4000),
        ({**SINE, "frequency": "10 Hz"}, 40 * 10 * 40),
        ({**SINE, "frequency": "10 Hz", "depth": -2.0, "modulation": "5 Hz"}, 40 * 20 * 40),
        ({"offset": "0 rad/s", "sines": [{"amplitude": "1 rad/s", "frequency": f"{f} Hz"} for f in (9, 3)]},
            40 * 9 * 40),
        ({"profile": [["0 s", "1 rad/s"], ["0.02 s", "5 rad/s"], ["9 s", "5 rad/s"]]}, 10 * 40 / 0.02),
        ({"moves": [["1 s", "0 rad"], ["9 s", "2 rad"], ["9.02 s", "2 rad"]]}, 10 * 40 / 0.02),
        ({"speed": "2 rad/s", "smoothing": "0.02 s"}, 10 * 40 / 0.02),
        ({**SINE, "frequency": "1 kHz"}, 200_000),
    ],
)  # fmt: skip
def test_samples_are_as_dense_as_what_they_sample_is_fast(reference: dict[str, Any], samples: float) -> None:
    """And one lies in each step of the time, at a place that doesn't repeat."""
    way = course(Scenario.model_validate({"duration": "40 s", "reference": reference}))
    assert len(way.time) == pytest.approx(samples, abs=1)
    assert way.step == pytest.approx(40 / len(way.time))
    places = way.time / way.step - np.arange(len(way.time))
    assert places.min() >= -1e-9 and places.max() < 1
    golden = (math.sqrt(5) - 1) / 2
    assert places[1:3] == pytest.approx([golden, 2 * golden - 1])
    assert np.histogram(places, 10, (0, 1))[0] / len(places) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize(
    ("reference", "steepest", "jump"),
    [
        ({"profile": [["0 s", "1 rad/s"], ["2 s", "5 rad/s"]]}, 2.0, 2.0),
        ({"profile": [["1 s", "1 rad/s"], ["2 s", "5 rad/s"]]}, 4.0, 2.0),  # held until it begins
        ({"profile": [["0 s", "3 rad/s"]]}, 0.0, 4.0),
        ({"moves": [["0 s", "0 rad"], ["2 s", "4 rad"]]}, STEEPEST, 1.0),
        (SINE, 4 * math.pi, 4.0),
        ({"offset": "1 rad/s", "sines": [{"amplitude": "2 rad/s", "frequency": "1 Hz", "phase": "30 deg"}]},
            4 * math.pi, 3.0),
        ({"speed": "0.3 rad/s", "ramp": "0.5 rad/s^2"}, 0.5, 0.0),  # begins at the initial speed
    ],
)  # fmt: skip
def test_smoothing_adds_the_jump_from_the_initial_speed(
    reference: dict[str, Any], steepest: float, jump: float
) -> None:
    plain = {"duration": "40 s", "initial_speed": "-1 rad/s"}
    smooth = Scenario.model_validate({**plain, "reference": {**reference, "smoothing": "0.5 s"}})
    assert smooth.top_acceleration == pytest.approx(steepest + jump / (math.e * 0.5))


@pytest.mark.parametrize("smoothing", [0.0, 0.3])
@pytest.mark.parametrize(
    "reference",
    [
        {"speed": "2 rad/s", "ramp": "0.5 rad/s^2"},
        {**SINE, "depth": 0.5, "modulation": "1 Hz"},
        {"offset": "1 rad/s", "sines": [{"amplitude": "2 rad/s", "frequency": "0.7 Hz", "phase": "1 rad"}]},
        {"moves": [["0.5 s", "0 rad"], ["2 s", "4 rad"], ["3 s", "3 rad"]]},
        {"profile": [["0.5 s", "1 rad/s"], ["2 s", "5 rad/s"], ["3 s", "-1 rad/s"]]},
    ],
)
def test_samples_of_a_reference_are_what_the_engine_makes(
    tmp_path: Path, reference: dict[str, Any], smoothing: float
) -> None:
    from cogless import run_study

    smooth = {"smoothing": f"{smoothing} s"} if smoothing else {}
    changes = {
        "scenario.low.reference": {**reference, **smooth},
        "scenario.low.duration": "4 s",
        "scenario.low.initial_speed": "0.2 rad/s",
        "controller.pi": SPACE,
        "metric": [],
    }
    study = load(studies.write(tmp_path), changes)
    (run,) = run_study(study, ["low/pi"]).runs
    way = course(study.scenario["low"])
    inside = way.time < run.trace.time[-1]
    for samples, name in ((way.omega, "omega_ref"), (way.alpha, "alpha_ref")):
        there = np.interp(way.time, run.trace.time, run.trace[name])
        off = np.abs(samples - there)[inside]
        assert np.mean(off < 0.02 * np.ptp(run.trace[name])) > 0.99, name  # but where a slope jumps


def test_a_reference_from_a_file(tmp_path: Path) -> None:
    path = studies.write(tmp_path)
    (tmp_path / "speeds.csv").write_text("time,speed\n0,1.0\n0.2,3.0\n\n0.4,2.0\n")
    study = load(path, {"scenario.low.reference": {"file": "speeds.csv"}})
    assert study.scenario["low"].reference.points == ((0.0, 1.0), (0.2, 3.0), (0.4, 2.0))
    assert study.scenario["low"].top_speed == pytest.approx(2 * math.pi)  # it begins at 60 r/min


def test_a_reference_file_without_a_heading_is_in_s_and_rad_per_s(tmp_path: Path) -> None:
    path = studies.write(tmp_path)
    (tmp_path / "speeds.csv").write_text("0,1.0\n0.2,3.0\n0.4,2.0\n")
    study = load(path, {"scenario.low.reference": {"file": "speeds.csv"}})
    assert study.scenario["low"].reference.points == ((0.0, 1.0), (0.2, 3.0), (0.4, 2.0))


@pytest.mark.parametrize(
    "heading",
    [
        "time [s],speed [rpm]", "t,n (rpm)", "time_ms , speed_rpm", "Zeit/ms,n/rpm", "time [ms],speed r/min",
        "s,rpm",
    ],
)  # fmt: skip
def test_the_units_that_a_heading_names(tmp_path: Path, heading: str) -> None:
    second = 1000 if "ms" in heading else 1
    (tmp_path / "speeds.csv").write_text(f"{heading}\n0,60\n{second},120\n")
    study = load(studies.write(tmp_path), {"scenario.low.reference": {"file": "speeds.csv"}})
    (start, slow), (end, fast) = study.scenario["low"].reference.points
    assert (start, end) == (0.0, pytest.approx(1.0))
    assert (slow, fast) == (pytest.approx(2 * math.pi), pytest.approx(4 * math.pi))


def test_a_name_is_no_unit(tmp_path: Path) -> None:
    """Of omega_r the r is no revolution."""
    (tmp_path / "speeds.csv").write_text("t,omega_r\n0,60\n")
    study = load(studies.write(tmp_path), {"scenario.low.reference": {"file": "speeds.csv"}})
    assert study.scenario["low"].reference.points == ((0.0, 60.0),)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time,speed\n0,1\n0,2\n", 'line 3: "0": expected a time after that of the previous line'),
        ("time,speed\n0,1\n1,fast\n",
            'line 3: "1,fast": expected a time in s and a speed in rad/s, with a comma between them, '
            "and decimal points in numbers"),
        ("0,1\n1,nan\n", 'line 2: "nan": expected a finite speed'),
        ("0,1\ninf,2\n", 'line 2: "inf": expected a finite time'),
        ("time;speed\n0;1\n",
            'line 1: "time;speed": expected two columns, time and speed, with a comma between them'),
        ("time,speed [V]\n0,1\n",
            'line 1: "speed [V]": expected a unit of an angular speed, such as "speed [rad/s]"'),
        ("time_Hz,speed\n0,1\n", 'line 1: "time_Hz": expected a unit of a time, such as "time [s]"'),
        ("time,speed\n", "expected lines with a time in s and a speed in rad/s"),
        (None, "expected a readable file at speeds.csv"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_reference(tmp_path: Path, text: str | None, problem: str) -> None:
    if text is not None:
        (tmp_path / "speeds.csv").write_text(text)
    found = line_of(tmp_path, {"scenario.low.reference": {"file": "speeds.csv"}})
    assert found == f'scenario.low.reference.file: "speeds.csv": {problem}'


IDEAL = {
    "drive": {
        "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
        "current_loop": {"kind": "ideal", "current_limit": "3 A"},
    }
}


def metric(signal: str) -> dict[str, Any]:
    return {"name": "m", "kind": "rms", "signal": signal}


def test_what_a_law_records_can_be_measured(tmp_path: Path) -> None:
    delay = {**SPACE, "memory": "delay", "cells": 4000, "mu_h": 0.1}
    signals = ("alpha_ref", "theta_error", "P_t", "term_h")
    changes = {"controller.pi": delay, "metric": [{**metric(s), "name": f"m_{s}"} for s in signals]}
    study = load(studies.write(tmp_path), changes)
    assert {m.signal for m in study.metric} == set(signals)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"controller.pi": {**SPEED, "period": {"of": "electrical", "turns": 3}}},
            "controller.pi.period: expected a whole number of periods in a revolution of the rotor, not a "
            "period of 0.75 "
            "revolutions"),
        ({"controller.pi": {**SPACE, "memory": "delay"},
          "scenario.low.reference": {"offset": "1 rad/s", "amplitude": "1 rad/s", "frequency": "1 Hz"}},
            'controller.pi.memory: "delay": expected "map": the reference of scenario low slows down to 0 '
            "rad/s, but a delay line needs omega_min, 0.01 rad/s, or more"),
        ({"controller.pi": {**SPACE, "memory": "delay", "cells": 100}},
            "controller.pi.cells: 100: expected 250 or more, the number of samples in a period at the "
            "slowest speed of "
            "scenario low"),
        ({"controller.pi": {**SPACE, "cells": 65536}},
            "controller.pi.cells: 65536: expected at most 65535 cells, the most of a map"),
        ({"controller.pi": {**SPACE, "memory": "delay", "period": {"of": "mechanical", "turns": 3000}},
          "scenario.low.reference": {"speed": "0.1 rad/s"}, "scenario.low.initial_speed": "0.1 rad/s",
          "metric": []},
            'controller.pi.memory: "delay": expected "map": a period at the slowest speed of scenario low '
            "has 188495560 samples, but a delay line holds at most 16777216"),
        ({"controller.pi": {**SPACE, "period": {"parts": 100}}},
            "controller.pi.period: expected a longer period: at the top speed of scenario low it has 2.5 "
            "samples, but needs 4"),
        ({"controller.pi": {**SPACE, "q_half_width": 600}},
            "controller.pi.q_half_width: 600: expected a filter that fits into the 1024 cells of the memory"),
        ({"controller.pi": {**SPACE, "omega_min": "0 rad/s"}},
            'controller.pi.omega_min: "0 rad/s": expected an angular speed above zero, such as "1 rad/s"'),
        ({"controller.pi": {**SPEED, "eta_bar": "0 rad/s"}},
            'controller.pi.eta_bar: "0 rad/s": expected an angular speed above zero, such as "1 rad/s"'),
        ({"controller.pi": {**SPEED, "mu_h": 1e39}},
            "controller.pi.mu_h: 1e+39: expected a size that single precision holds, 1e-15 to 1e+15 in SI "
            "units"),
        ({"controller.pi": {"law": "space-position", "k_theta": 5, "mu_alpha": 5.0}},
            "controller.pi: expected either k_theta and k_omega or tuning, such as "
            '{ rule = "phase-margin", phase_margin = "60 deg" }'),
        ({"controller.pi": {**SPACE, "period": {"of": "mechanical", "turns": 5000}}},
            "controller.pi.period: expected a period of which a whole number fits into 3978 revolutions or "
            "fewer: this one needs 5000"),
        ({"controller.pi": {**SPACE, "memory": "delay", "cells": 4000, "k_pp": 20000.0}},
            "controller.pi.k_pp: 20000.0: expected less than drive.rates.speed_loop, 1000 Hz"),
        ({"controller.pi": {**SPACE, "beta_limit": 1e300}},
            "controller.pi.beta_limit: 1e+300: expected a size that single precision holds, 1e-15 to 1e+15 "
            "in SI units"),
        ({"controller.pi": {**SPACE, "mu_alpha": 0.0}},
            "controller.pi.learning: expected false, since mu_alpha, mu_beta and mu_h are zero; or set one "
            "of them above zero"),
        ({"motor": {**STEP, "kind": "foo"}},
            'motor.kind: "foo": expected one of "pmsm", "step"'),
        ({"controller.pi": SPACE, "metric": [metric("term_beta")]},
            'metric.0.signal: "term_beta": expected a signal that a controller of this study has'),
        ({"controller.pi": SPACE, "metric": [metric("P_t")]},
            'metric.0.signal: "P_t": expected a signal that a controller of this study has'),
        ({"metric": [metric("theta_error")]},
            'metric.0.signal: "theta_error": expected another signal, or a controller such as harmonic with '
            "position = true"),
        ({"motor": STEP, "metric": [metric("i_c")]},
            'metric.0.signal: "i_c": expected another signal, since the motor has two phases'),
        ({**IDEAL, "metric": [metric("i_d")]},
            'metric.0.signal: "i_d": expected another signal, since the current loop is ideal'),
        ({**IDEAL, "metric": [{"name": "m", "kind": "copper-loss"}]},
            'metric.0.kind: "copper-loss": expected another kind, since the current loop is ideal'),
        ({**IDEAL, "metric": [], "trace": {"energy": True}},
            "trace.energy: true: expected false, since the current loop is ideal"),
        ({"motor": {**STEP, "L_1": "0.8 mH"}}, 'motor.L_1: "0.8 mH": expected less than L_0'),
        ({"motor": {**STEP, "L_m": []}}, f"motor.L_m: []: {MAGNET}"),
        ({"drive.current_loop": {"kind": "ideal", "current_limit": "3 A"}},
            'drive.inverter: expected no such key, since current_loop.kind = "ideal": delete inverter, or '
            "delete current_loop.kind for a real current loop; inverter is from the file, kind from --set: "
            "add --set drive.inverter= to delete inverter"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, changes: dict[str, Any], line: str) -> None:
    assert line_of(tmp_path, changes) == line


PERIODIC = {**SPACE, "memory": "delay", "cells": 1024}
RESTS = {**SPACE, "learning": False, "frame": "mechanical"}  # asks for no samples


@pytest.mark.parametrize(
    ("common", "most", "beyond"),
    [
        ({}, {**PERIODIC, "cells": 250}, {**PERIODIC, "cells": 249}),  # samples of a period
        ({}, {**PERIODIC, "k_pp": 999.9}, {**PERIODIC, "k_pp": 1000.0}),  # the speed loop's rate
        ({}, {**PERIODIC, "delay_method": "inversion", "k_pp": 2000.0}, {**PERIODIC, "k_pp": 2000.0}),
        ({}, {**SPACE, "period": {"of": "mechanical", "turns": 3978}},
            {**SPACE, "period": {"of": "mechanical", "turns": 3979}}),
        ({"motor.pole_pairs": 3},
            {**RESTS, "period": {"parts": 21845}}, {**RESTS, "period": {"parts": 21846}}),
        ({}, {**RESTS, "period": {"parts": 100}}, {**RESTS, "learning": True, "period": {"parts": 100}}),
        ({}, {**SPACE, "index": "rotor", "period": {"parts": 3}},
            {**SPACE, "index": "rotor", "period": {"turns": 3}}),
        ({}, {**PERIODIC, "alpha_limit": 1e15}, {**PERIODIC, "alpha_limit": 1.1e15}),
        ({}, {**PERIODIC, "alpha_limit": 1e-15}, {**PERIODIC, "alpha_limit": 0.9e-15}),
        # one gain is enough
        ({}, {**SPACE, "mu_alpha": 0.0, "mu_beta": 1.0}, {**SPACE, "mu_alpha": 0.0, "mu_beta": 0.0}),
        ({}, {**SPACE, "mu_alpha": 0.0, "mu_h": 1.0}, {**SPACE, "mu_alpha": 0.0, "mu_h": 0.0}),
    ],
)  # fmt: skip
def test_a_law_over_the_angle_at_its_bounds_and_beyond(
    tmp_path: Path, common: dict[str, Any], most: dict[str, Any], beyond: dict[str, Any]
) -> None:
    load(studies.write(tmp_path), {**common, "controller.pi": most})
    assert line_of(tmp_path, {**common, "controller.pi": beyond}).startswith("controller.pi.")


def test_metrics_in_the_electrical_frame(tmp_path: Path) -> None:
    from cogless import run_study

    metric = {"name": "m", "kind": "peak-to-peak", "signal": "omega_m", "scenarios": ["low"]}
    study, turned = (
        load(studies.write(tmp_path), {"metric": [{**metric, "frame": frame}]})
        for frame in ("mechanical", "electrical")
    )
    (one,), (other,) = (run_study(s, ["low/pi"]).runs for s in (study, turned))
    assert other.metrics["m_rad_s"] == pytest.approx(4 * np.float64(one.metrics["m_rad_s"]))


def test_copper_loss_of_two_phases_is_their_resistance_times_both_squares(tmp_path: Path) -> None:
    """i_a^2 + i_b^2 = i_d^2 + i_q^2; of three phases the sum is half as much again."""
    for motor, phases in (({"motor": STEP}, 2), ({"motor.R_s": "1 ohm"}, 3)):
        loss = {"name": "loss", "kind": "copper-loss"}
        study = studies.study(tmp_path, {**motor, "metric": [loss], "scenario.low.initial_speed": "0 rpm"})
        rows = np.column_stack([np.arange(100) * 1e-3, np.full(100, 3.0), np.full(100, -4.0)])
        trace = Trace(("time", "i_d", "i_q"), ("s", "A", "A"), rows)
        assert measure(study, "low", trace)["loss_W"] == pytest.approx(25.0 * phases / 2)
