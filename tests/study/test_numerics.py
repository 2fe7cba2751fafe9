"""How fast a plant changes, each rate with its cause, and what follows for steps and speeds: closed forms."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.study.datasheet import PER_BACK_EMF, mixed_up, replaced_by, torque_constant
from cogless.study.mechanics import Mechanics
from cogless.study.motor import CoggingTorque, FluxHarmonic, StarMotor, TorqueRipple
from cogless.study.numerics import (
    LARGEST_STEP,
    check_dead_time,
    check_step,
    natural_rates,
    no_load_speed,
    steps_needed,
    voltage_reach,
)
from cogless.study.saturation import Heating, MotorTemperature

MOTOR = StarMotor(
    pole_pairs=4, R_s=2.0, L_d=4e-3, L_q=5e-3, psi_f=0.05, K_t=0.3, impedance_factor=1.0, flux_factor=1.0,
    flux_harmonics=(), cogging=(),
)  # fmt: skip
TOP = 100.0  # rad/s
HARMONIC = {"order": 7, "torque": "1 mN*m"}


def mechanics(**more: Any) -> Mechanics:
    return Mechanics.model_validate({"inertia": "1e-4 kg*m^2", **more})


def rates(motor: StarMotor = MOTOR, **more: Any) -> dict[str, float]:
    return {what: rate for rate, what in natural_rates(motor, mechanics(**more), TOP)}


def test_the_winding_is_as_fast_as_its_smaller_inductance() -> None:
    """R / L; and K_t against p psi_f through inertia and L, as mass and spring."""
    found = rates()
    assert found["the current (R_s / L)"] == pytest.approx(2.0 / 4e-3)
    swing = math.sqrt(0.3 * 4 * 0.05 / (1e-4 * 4e-3))
    assert found["the oscillation of speed and current (K_t, inertia, L)"] == pytest.approx(swing)
    other = rates(replace(MOTOR, L_d=5e-3, L_q=4e-3))
    assert other == pytest.approx(found)
    ideal = natural_rates(MOTOR, mechanics(), TOP, electrical=False)
    assert len(ideal) == len(found) - 2 and not any("current" in what for _, what in ideal)


def test_cogging_and_friction_are_springs_and_dampers_of_the_rotor() -> None:
    cogging = (CoggingTorque(24, 0.002), CoggingTorque(12, -0.001))
    found = rates(replace(MOTOR, cogging=cogging), viscous_friction="5e-3 N*m*s/rad")
    slope = 24 * 2e-3 + 12 * 1e-3
    assert found["the oscillation in the cogging torque"] == pytest.approx(math.sqrt(slope / 1e-4))
    assert found["the speed (viscous_friction / inertia)"] == pytest.approx(5e-3 / 1e-4)


@pytest.mark.parametrize(
    ("more", "order"),
    [
        ({}, 4),
        ({"flux_harmonics": (FluxHarmonic(order=6, d="1 mWb"),)}, 24),
        ({"cogging": (CoggingTorque(36, 0.001),)}, 36),
        ({"torque_ripple": (TorqueRipple(order=48, percent=1.0),)}, 48),
    ],
)
def test_the_highest_order_passes_at_top_speed(more: dict[str, Any], order: int) -> None:
    assert rates(replace(MOTOR, **more))["the highest order at top speed"] == pytest.approx(TOP * order)


def test_friction_that_falls_is_steepest_at_the_inflection_of_its_bell() -> None:
    """(T_b - T_c) exp(-(w / w_s)^2) has the slope sqrt(2 / e) (T_b - T_c) / w_s at w = w_s / sqrt 2."""
    stribeck = {"coulomb_friction": "2 mN*m", "breakaway_friction": "5 mN*m", "stribeck_speed": "0.5 rad/s"}
    found = rates(**stribeck, friction_harmonics=[{**HARMONIC, "torque": "1 mN*m"}])
    w = 0.5 / math.sqrt(2)
    slope = 3e-3 * 2 * w / 0.5**2 * math.exp(-((w / 0.5) ** 2))
    assert found["the speed under the friction of mechanics.stribeck_speed"] == pytest.approx(slope / 1e-4)
    assert found["mechanics.friction_harmonics at top speed"] == pytest.approx(7 * TOP)
    assert "the speed under the friction of mechanics.stribeck_speed" not in rates()


def test_a_soft_shaft_swings_with_both_masses() -> None:
    """Behind a gear of 2 the load turns at half the speed, and its inertia counts a quarter."""
    side = {
        "inertia": "4e-4 kg*m^2", "stiffness": "10 N*m/rad", "ratio": 2, "viscous_friction": "2e-3 N*m*s/rad",
        "coulomb_friction": "2 mN*m", "friction_harmonics": [HARMONIC],
        "gear_errors": [{"side": "input", "order": 3, "angle": "0.01 deg"},
                        {"side": "output", "order": 5, "angle": "0.01 deg"}],
    }  # fmt: skip
    found = rates(load_side=side)
    errors = [rate for rate, what in natural_rates(MOTOR, mechanics(load_side=side), TOP) if "gear" in what]
    assert errors == pytest.approx([3 * TOP, 5 * TOP / 2])
    assert found["the load's speed (viscous_friction / inertia)"] == pytest.approx(2e-3 / 4e-4)
    assert found["mechanics.load_side.friction_harmonics at top speed"] == pytest.approx(7 * TOP / 2)
    twist = "the twist of the shaft (mechanics.load_side: stiffness, damping, both inertias)"
    plain = {**side, "gear_errors": []}
    per_inertia = 1 / 4e-4 + 0.25 / 1e-4
    swing = math.sqrt(10 * per_inertia)
    assert rates(load_side=plain)[twist] == pytest.approx(swing)
    # the faster of two real roots of s^2 + 2 half s + swing^2
    damped = rates(load_side={**plain, "damping": "0.1 N*m*s/rad"})[twist]
    half = 0.1 * per_inertia / 2
    assert half > swing and damped == pytest.approx(half + math.sqrt(half**2 - swing**2))
    assert damped**2 - 2 * half * damped + swing**2 == pytest.approx(0, abs=1e-6 * swing**2)


def test_a_load_behind_a_rigid_gear_is_seen_from_the_motor() -> None:
    """With a ratio of 2: a quarter of its inertia and viscous friction, and half of its sliding friction."""
    side = {"inertia": "4e-4 kg*m^2", "viscous_friction": "8e-3 N*m*s/rad", "coulomb_friction": "6 mN*m",
            "stiffness": "1 N*m/rad", "ratio": 2}  # fmt: skip
    own = {"viscous_friction": "1e-3 N*m*s/rad", "coulomb_friction": "1 mN*m"}
    found, alone = mechanics(**own, load_side=side), mechanics(**own)
    stiff = found.stiff
    assert (stiff.inertia, stiff.viscous_friction, stiff.coulomb_friction) == pytest.approx(
        (2e-4, 3e-3, 4e-3)
    )
    assert (stiff.load_side, stiff.ratio, found.ratio) == (None, 1.0, 2.0)
    assert alone.stiff is alone and alone.ratio == 1.0


def test_a_gear_s_errors_make_its_output_faster_and_slower() -> None:
    """By 3 * 0.02 of the input's speed for the order of the input, by 5 * 0.03 / 2 for that of the output."""
    errors = [{"side": "input", "order": 3, "angle": "0.02 rad"},
              {"side": "output", "order": 5, "angle": "0.03 rad"}]  # fmt: skip
    side = {"inertia": "1 g*m^2", "stiffness": "1 N*m/rad", "ratio": 2, "gear_errors": errors}
    found = mechanics(load_side=side).load_side
    assert found is not None and found.slope == pytest.approx((0.5 - 0.135, 0.5 + 0.135))


def test_half_a_time_constant_is_the_longest_step() -> None:
    slow = mechanics(inertia="1 kg*m^2")
    fastest = TOP * 4
    still = replace(MOTOR, R_s=0.0)
    assert max(natural_rates(still, slow, TOP))[0] == pytest.approx(fastest)
    for rate, steps in (
        (fastest / 0.5, 1),
        (0.99 * fastest / 0.5, 2),
        (fastest / 1.01, 3),
        (10 * fastest, 1),
    ):
        assert steps_needed(still, slow, TOP, rate) == steps


@pytest.mark.parametrize(
    ("needed", "steps", "told"),
    [(1.5, 1, "2"), (6.0, 4, "6"), (1e6, 1, "1000000"), (1.5e6, 1, "1.5e+06")],
)  # fmt: skip
def test_a_step_that_is_too_long_tells_how_many_are_needed(needed: float, steps: int, told: str) -> None:
    """A step of half a time constant is short enough; more than a million steps have three digits."""
    check_step(LARGEST_STEP, steps, [(0.1, "the other"), (1.0, "the speed")], "")
    with pytest.raises(ValueError, match=f"expected {re.escape(told)} or more, since the speed changes"):
        check_step(LARGEST_STEP * needed / steps, steps, [(1.0, "the speed"), (0.1, "the other")], "")


@pytest.mark.parametrize(("part", "key"), [("inverter", "dead_time"), ("dead_time_compensation", "time")])
def test_a_dead_time_is_shorter_than_half_a_period(tmp_path: Path, part: str, key: str) -> None:
    drive = studies.study(tmp_path, {"drive.dead_time_compensation.band": "0.1 A"}).drive
    half = 0.5 / drive.rates.current_loop
    for time in (0.999 * half, half):
        other = getattr(drive, part).model_copy(update={key: time})
        told = drive.model_copy(update={part: other})
        if time < half:
            check_dead_time(told)
        else:
            with pytest.raises(ValueError, match="expected less than half a period"):
                check_dead_time(told)


def test_an_ideal_drive_has_all_the_voltage_that_there_is(tmp_path: Path) -> None:
    real = studies.study(tmp_path)
    assert voltage_reach(real) == pytest.approx(310 / math.sqrt(3) / (4 * 0.068))
    without = real.model_copy(update={"drive": real.drive.model_copy(update={"inverter": None})})
    assert voltage_reach(without) == math.inf


@pytest.mark.parametrize(("phases", "volts"), [(3, 24 / math.sqrt(3)), (2, 24.0)])
def test_the_speed_without_load_induces_the_largest_sine(phases: int, volts: float) -> None:
    motor = replace(MOTOR, phases=phases)
    assert motor.pole_pairs * 0.05 * no_load_speed(24.0, motor, 0.05) == pytest.approx(volts)


def test_temperatures_change_no_faster_than_twice_the_row_sums() -> None:
    """Two bodies: the matrix of rates has its eigenvalues within twice its largest diagonal entry."""
    heating = Heating.model_validate({
        "ambient": "20 degC", "winding_capacity": "50 J/K", "magnet_capacity": "20 J/K",
        "winding_to_ambient": "4 K/W", "winding_to_magnet": "2 K/W", "magnet_to_ambient": "0.5 K/W",
    })  # fmt: skip
    assert heating.paths() == pytest.approx(
        {"winding_to_ambient": 0.25, "winding_to_magnet": 0.5, "magnet_to_ambient": 2.0}
    )
    assert heating.fastest == pytest.approx(2 * max((0.25 + 0.5) / 50, (2.0 + 0.5) / 20))
    alone = heating.model_copy(update={"magnet_to_ambient": None, "winding_to_magnet": None})
    assert alone.fastest == pytest.approx(2 * 0.25 / 50)


def test_a_motor_s_temperatures_reach_the_engine_with_or_without_heating() -> None:
    plain = MotorTemperature.model_validate({"winding": "80 degC", "flux_coefficient": "-0.001 1/K"})
    assert plain.magnets == plain.winding == 80.0 and plain.reference == 20.0
    found = plain.engine_config()
    assert found == {
        "winding": 80.0, "magnet": 80.0, "reference": 20.0, "resistance_coefficient": 0.00393,
        "flux_coefficient": -0.001, "drifts": False,
    }  # fmt: skip
    heating_paths = ("winding_to_ambient", "winding_to_magnet", "magnet_to_ambient")
    heated = plain.model_copy(update={"magnet": 60.0, "heating": Heating.model_validate(
        {"ambient": "25 degC", "winding_capacity": "50 J/K", "magnet_capacity": "20 J/K"})})  # fmt: skip
    assert heated.engine_config() == {
        **found, "magnet": 60.0, "drifts": True, "ambient": 25.0, "winding_capacity": 50.0,
        "magnet_capacity": 20.0, **dict.fromkeys(heating_paths, 0.0),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("times", "name"),
    [
        (math.sqrt(2), "sqrt(2)"), (1.39, "sqrt(2)"), (1.95, "2"),
        (math.sqrt(3), "sqrt(3)"), (math.sqrt(1.5), "sqrt(3/2)"), (math.sqrt(6), "sqrt(6)"),
        (2 / math.sqrt(3), "2/sqrt(3)"), (1.5, "3/2"), (3.0, "3"), (2.0, "2"), (2.07, ""), (1.05, ""),
    ],
)  # fmt: skip
def test_a_factor_by_which_datasheets_are_misread_is_named(times: float, name: str) -> None:
    found = mixed_up(times, 0.03)
    assert found.partition(", the factor")[0] == (f"; the values differ by {name}" if name else "")


def test_words_of_a_datasheet_for_one_magnet() -> None:
    """K_t by power: 3/2 U I of a star's phases; from line to line there is sqrt 3 of their voltage."""
    K_t, omega = 0.3, 100.0
    U = K_t * omega / 1.5  # peak of a phase
    for kind, volts in (("phase_peak", U), ("phase_rms", U / math.sqrt(2)),
                        ("line_to_line_peak", U * math.sqrt(3)),
                        ("line_to_line_rms", U * math.sqrt(1.5))):  # fmt: skip
        assert torque_constant(f"K_e_{kind}", volts / omega, 4, 1.0) == pytest.approx(K_t)
        word = "kv" if kind == "line_to_line_peak" else f"kv_{kind}"
        assert torque_constant(word, omega / volts, 4, 1.0) == pytest.approx(K_t)
        assert kind in PER_BACK_EMF
    assert torque_constant("psi_f", 0.05, 4, 1.0) == pytest.approx(1.5 * 4 * 0.05)
    assert torque_constant("psi_f", 0.05, 4, 0.5) == pytest.approx(1.5 * 4 * 0.05 * 0.5)
    assert torque_constant("K_t_rms", 0.3 * math.sqrt(2), 4, 1.0) == pytest.approx(0.3)
    assert torque_constant("K_t", 0.3, 4, 1.0) == 0.3


def test_a_word_replaces_those_that_say_the_same() -> None:
    assert "kv" in replaced_by("psi_f") and "psi_f" not in replaced_by("psi_f")
    assert replaced_by("R_s") == {"resistance_line_to_line"}
    assert replaced_by("inductance_line_to_line") == {"L_d", "L_q"}
    assert replaced_by("L_d") == replaced_by("L_q") == {"inductance_line_to_line"}
    assert replaced_by("pole_pairs") == frozenset()
