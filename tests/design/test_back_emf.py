"""Margins with the back-EMF, against a step motor of a few lines of NumPy and runs of the engine."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_axis import growth

from cogless.design.answers import answer
from cogless.design.auto import load
from cogless.design.back_emf import back_emf_warning, margins_with_back_emf, response_factors
from cogless.design.closed_loop import Linear, position_margins
from cogless.design.law_rules import feedback_of
from cogless.design.margins import Margins
from cogless.design.speed_loop import CurrentLoop, speed_loop
from cogless.design.summary import design
from cogless.run.simulate import simulate
from cogless.study import Study, changed

# A NEMA 17 without a load: K_t K_e / k_i of its current loop is six times the rotor's inertia.
STEP_MOTOR = """title = "A light step motor"
[motor]
kind = "step"
teeth = 50
R_s = "1.8 ohm"
L_0 = "3.2 mH"
holding_torque = "0.45 N*m"
rated_current = "1.5 A"
[mechanics]
inertia = "6e-6 kg*m^2"
[drive]
rates = { current_loop = "5 kHz", speed_loop = "1 kHz", integration_steps = 4 }
current_loop = { bandwidth = "200 Hz", current_limit = "2 A" }
inverter = { bus_voltage = "24 V" }
[drive.position_sensor]
kind = "absolute"
bits = 22
speed_method = "observer"
observer_bandwidth = "70 Hz"
latency = "200 us"
[scenario]
slow = { duration = "3 s", reference = "60 rpm", initial_speed = "60 rpm" }
[controller]
pi = { law = "pi", tuning = { rule = "phase-margin", phase_margin = "60 deg" } }
[controller.harmonic]
law = "harmonic"
tuning = { rule = "auto" }
"""
NO_DECOUPLING = {"drive.current_loop.decoupling": False}


def step_motor(folder: Path, changes: dict[str, Any] | None = None) -> Study:
    path = folder / "step.toml"
    path.write_text(STEP_MOTOR, encoding="utf-8")
    study = load(path, changes or {})
    assert isinstance(study, Study)
    return study


def both(study: Study, name: str = "pi") -> tuple[Margins, Margins, Linear]:
    feedback = feedback_of(study, name)
    assert feedback is not None
    return position_margins(speed_loop(study), feedback), margins_with_back_emf(study, feedback), feedback


@pytest.mark.parametrize("degrees", [40, 60, 70])
@pytest.mark.parametrize("decoupling", [True, False])
def test_the_loop_is_unstable_where_an_own_motor_s_is(decoupling: bool, degrees: int, tmp_path: Path) -> None:
    """At the gain margin, within 4 %; at 40 degrees the late decoupling makes it unstable from the start."""
    changes = {} if decoupling else NO_DECOUPLING
    study = step_motor(tmp_path, {**changes, "controller.pi.tuning.phase_margin": f"{degrees} deg"})
    plain, left, feedback = both(study)
    assert plain.phase_margin == pytest.approx(math.radians(degrees))
    if degrees == 40 and decoupling:
        assert not left.stable and growth(study, feedback) > 0
        return
    most = left.gain_margin
    assert left.stable and (most < 0.8 * plain.gain_margin) is decoupling
    for factor, grows in ((0.96 * most, False), (1.04 * most, True)):
        scaled = replace(feedback, k=factor * feedback.k, k_i=factor * feedback.k_i)
        assert margins_with_back_emf(study, scaled).stable is not grows
        assert (growth(study, scaled) > 0) is grows


def test_what_is_unstable_with_the_back_emf_is_so_in_a_run_and_each_cure_mends_it(tmp_path: Path) -> None:
    study = step_motor(tmp_path, {"controller.pi.tuning.phase_margin": "45 deg"})
    warning = back_emf_warning(study, "pi")
    assert warning is not None
    assert str(warning).startswith(
        "with the motor's back-EMF its loop is unstable; without it the margin is 45 deg. The decoupling "
        "does not prevent this, since the speed that it uses comes late; drive.current_loop.decoupling = "
        "false"
    )

    def ripple(of: Study) -> float:
        omega = simulate(of, "slow", "pi").trace["omega_m"]
        return float(np.std(omega[len(omega) // 2 :])) / 6.283

    assert ripple(study) > 1
    assert warning.cures
    for cure in warning.cures:
        assert ripple(changed(study, cure)) < 0.01, cure


def test_learning_is_doubted_where_the_back_emf_outweighs_the_rotor(tmp_path: Path) -> None:
    """Without decoupling the loop is stable, but order 50 sees six times the inertia at low frequencies."""
    unstable = step_motor(tmp_path)
    no = answer(unstable, "harmonic", design(unstable, "harmonic"))
    assert no is not None
    assert no.words == "no, because its feedback is unstable with the motor's back-EMF"
    free = changed(unstable, NO_DECOUPLING)
    doubt = answer(free, "harmonic", design(free, "harmonic"))
    assert doubt is not None
    assert re.match(
        r"not sure: at 60 rpm the motor's back-EMF multiplies the speed's response to a current of order "
        r"50 by 0\.\d+; learning surely converges only for factors from 0\.5 to 1\.5; runs with several "
        r"seeds "
        r"\(--set seed=1, --set seed=2, \.\.\.\) show whether learning helps\. ",
        doubt.words,
    )
    heavy = changed(free, {"mechanics.inertia": "1e-3 kg*m^2"})
    yes = answer(heavy, "harmonic", design(heavy, "harmonic"))
    assert yes is not None and "back-EMF" not in yes.words


def test_at_low_frequencies_the_back_emf_is_an_inertia(tmp_path: Path) -> None:
    study = step_motor(tmp_path, NO_DECOUPLING)
    current, motor = speed_loop(study).current, study.motor.star()
    assert isinstance(current, CurrentLoop)
    inertia = motor.K_t * motor.pole_pairs * motor.psi_f / current.ki
    factor = response_factors(study, np.array([0.1]))[0]
    assert factor == pytest.approx(study.mechanics.inertia / (study.mechanics.inertia + inertia), rel=1e-3)


def test_a_fast_current_loop_and_a_heavy_rotor_have_the_margins_without_back_emf() -> None:
    study = load("uomodri")
    assert isinstance(study, Study)
    plain, left, _ = both(study)
    assert left.phase_margin == pytest.approx(plain.phase_margin, abs=math.radians(1))
    assert left.gain_margin == pytest.approx(plain.gain_margin, rel=0.02)  # 1.4 %
