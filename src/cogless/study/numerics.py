"""Check that a study suits the simulation: integration step, inverter's dead time, size of a trace."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from cogless.study.drive import TRACE_ROWS_MOST
from cogless.study.table import invalid
from cogless.units import RPM

if TYPE_CHECKING:
    from cogless.study.drive import Drive
    from cogless.study.mechanics import LoadSide, Mass, Mechanics
    from cogless.study.motor import StarMotor
    from cogless.study.speed_study import Study
    from cogless.study.trial_study import TrialStudy

LARGEST_STEP = 0.5  # RK4 step in time constants: at 0.5 its error is 0.04 % per step, at 2.8 it is unstable
OVERMODULATION_MOST = 1.2  # bound of top speed / no-load speed; square voltages give 2 sqrt(3) / pi = 1.10
TOP = "at top speed"  # part of the text of a natural rate that is proportional to the top speed


def integration(study: Study) -> None:
    """Check that the integration step is short compared with the fastest time constant of the plant."""
    rates, motor = study.drive.rates, study.motor.star()
    asked_top, asked = max((of.top_reference, f"{name}.reference") for name, of in study.scenario.items())
    begun, at = max((abs(of.initial_speed), f"{name}.initial_speed") for name, of in study.scenario.items())
    most, why = voltage_reach(study), ""
    if asked_top > most:
        reachable, reference = (speed_text_rpm(speed) for speed in (most, asked_top))
        why = f"; at the bus voltage the motor reaches {reachable} without load, not {reference}"
    reached = min(asked_top, OVERMODULATION_MOST * most)
    top, of = (begun, top_speed(begun, at)) if begun > reached else (reached, top_speed(asked_top, asked))
    rates_of_plant = natural_rates(motor, study.mechanics, top, electrical=not study.drive.ideal)
    check_step(
        1 / (rates.current_loop * rates.integration_steps), rates.integration_steps, rates_of_plant, of, why
    )


def top_speed(omega_m: float, key: str) -> str:
    """Text that names a top speed, rad/s, in a message. `key`: key below [scenario] with this speed."""
    return f"the {speed_text_rpm(omega_m)} of scenario.{key}"


def speed_text_rpm(omega_m: float) -> str:
    """A speed, rad/s, in four digits of r/min, without an exponent up to a million."""
    return f"{float(f'{omega_m / RPM:.4g}'):g} rpm"


def no_load_speed(bus_voltage: float, motor: StarMotor, psi_f: float) -> float:
    """Mechanical speed, rad/s, at which a flux linkage, Wb, induces the bus's largest sinusoidal voltage."""
    return largest_voltage(bus_voltage, motor) / (motor.pole_pairs * psi_f)


def largest_voltage(bus_voltage: float, motor: StarMotor) -> float:
    """Length of the longest voltage vector that a bus gives at every angle, V."""
    return bus_voltage if motor.phases == 2 else bus_voltage / math.sqrt(3)


def voltage_reach(study: Study) -> float:
    """The motor's speed without load at the full bus voltage, rad/s; infinite with an ideal drive."""
    inverter, motor = study.drive.inverter, study.motor.star()
    if inverter is None:
        return math.inf
    weakening = study.drive.weakening(motor.psi_f, motor.L_d)
    return no_load_speed(inverter.bus_voltage, motor, motor.psi_f) * weakening


def check_step(step: float, steps: int, rates: Sequence[tuple[float, str]], top: str, why: str = "") -> None:
    """Refuse an RK4 step (s) that is too long for these natural rates. `steps`: per current-loop period.

    `top`: text of `top_speed`, shown if the top speed decides the fastest rate. `why`: end of the message.
    """
    fastest, what = max(rates)
    if fastest * step > LARGEST_STEP:
        needed = fastest * step * steps / LARGEST_STEP
        whole = f"{needed:.3g}" if needed > 1e6 else math.ceil(needed)
        what = what.replace(TOP, f"at {top}")
        expected = f"expected {whole} or more, since {what} changes within {1e6 / fastest:.3g} us{why}"
        raise invalid(expected, "drive", "rates", "integration_steps", value=f"{steps}, the default")


def steps_needed(motor: StarMotor, mechanics: Mechanics, top: float, rate: float) -> int:
    """RK4 steps that a current-loop period needs. `top`: largest speed, rad/s. `rate`: of the loop, Hz."""
    fastest, _ = max(natural_rates(motor, mechanics, top))
    return max(1, math.ceil(fastest / rate / LARGEST_STEP))


def natural_rates(
    motor: StarMotor, mechanics: Mechanics, top: float, *, electrical: bool = True
) -> list[tuple[float, str]]:
    """Natural rates of the plant, 1/s, each with its cause. `top`: the largest mechanical speed, rad/s."""
    saturated = motor.saturation.smallest if motor.saturation else math.inf
    inductance, inertia = min(motor.L_d, motor.L_q, saturated), mechanics.inertia
    side = mechanics.load_side
    swing = motor.K_t * motor.pole_pairs * motor.psi_f / (inertia * inductance)
    flux_orders = [h.order * motor.pole_pairs for h in motor.flux_harmonics]
    torque_orders = [*(r.order for r in motor.torque_ripple), *(h.order for h in motor.cogging)]
    orders = [motor.pole_pairs, *flux_orders, *torque_orders]
    cogging = sum(abs(h.torque) * h.order for h in motor.cogging)
    of_current = [
        (motor.R_s / inductance, "the current (R_s / L)"),
        (math.sqrt(swing), "the oscillation of speed and current (K_t, inertia, L)"),
    ]
    return [
        *(of_current if electrical else ()),
        (mechanics.viscous_friction / inertia, "the speed (viscous_friction / inertia)"),
        (math.sqrt(cogging / inertia), "the oscillation in the cogging torque"),
        (top * max(orders), f"the highest order {TOP}"),
        *_of_friction(mechanics, top, "mechanics"),
        *(() if side is None else (_of_shaft(mechanics, side), *_of_load_side(side, top))),
    ]


def _of_friction(mass: Mass, top: float, key: str) -> list[tuple[float, str]]:
    """Rates of friction that depends on speed and position."""
    rates = [(top * h.order, f"{key}.friction_harmonics {TOP}") for h in mass.friction_harmonics]
    if mass.stribeck_speed:
        # the steepest slope of exp(-x^2) is sqrt(2 / e)
        slope = (mass.breakaway - mass.coulomb_friction) / mass.stribeck_speed * math.sqrt(2 / math.e)
        rates.append((slope / mass.inertia, f"the speed under the friction of {key}.stribeck_speed"))
    return rates


def _of_shaft(mechanics: Mechanics, side: LoadSide) -> tuple[float, str]:
    """Rate of the shaft's twist: the magnitude of its fastest root."""
    per_inertia = 1 / side.inertia + side.slope[1] ** 2 / mechanics.inertia
    square, half = side.stiffness * per_inertia, side.damping * per_inertia / 2
    rate = half + math.sqrt(half**2 - square) if half**2 > square else math.sqrt(square)
    return rate, "the twist of the shaft (mechanics.load_side: stiffness, damping, both inertias)"


def _of_load_side(side: LoadSide, top: float) -> list[tuple[float, str]]:
    speed = top / side.ratio
    return [
        (side.viscous_friction / side.inertia, "the load's speed (viscous_friction / inertia)"),
        *(
            (e.order * (top if e.side == "input" else speed), f"the gear's error {TOP}")
            for e in side.gear_errors
        ),
        *_of_friction(side, speed, "mechanics.load_side"),
    ]


def heating(study: Study | TrialStudy) -> None:
    """Check that temperatures, which are integrated once per current-loop period, change slowly."""
    temperature = None if study.motor is None else study.motor.star().temperature
    if temperature is None or temperature.heating is None or study.drive is None:
        return
    fastest, rate = temperature.heating.fastest, study.drive.rates.current_loop
    if fastest > LARGEST_STEP * rate:
        expected = (
            f"expected larger heat capacities: with these a temperature changes within {1e6 / fastest:.3g} "
            "us, too fast for one step in each period of the current loop"
        )
        raise invalid(expected, "motor", "temperature", "heating")


def current_range(study: Study | TrialStudy) -> None:
    """Refuse a converter that can't measure the currents that the controller may ask for."""
    drive = study.drive
    if drive is None or drive.ideal or not drive.current_sensors.bits:
        return
    span, limit = drive.current_sensors.range, drive.current_loop.current_limit
    if span < limit:
        expected = f"expected {limit:g} A (drive.current_loop.current_limit) or more"
        raise invalid(expected, "drive", "current_sensors", "range", value=f"{span:g} A")


def dead_time(study: Study) -> None:
    """Check that the dead time leaves time to switch within a current-loop period."""
    check_dead_time(study.drive)


def check_dead_time(drive: Drive) -> None:
    """Refuse dead times, true and believed, of half a current-loop period or more."""
    longest = 0.5 / drive.rates.current_loop
    expected = f"expected less than half a period of the current loop, {longest:.3g} s"
    if drive.inverter is not None and drive.inverter.dead_time >= longest:
        raise invalid(expected, "drive", "inverter", "dead_time")
    compensation = drive.dead_time_compensation
    if compensation is not None and (compensation.time or 0.0) >= longest:
        raise invalid(expected, "drive", "dead_time_compensation", "time")


def size(study: Study) -> None:
    """Check that a run's trace fits into memory."""
    for name, scenario in study.scenario.items():
        if scenario.duration * study.trace_rate > TRACE_ROWS_MOST:
            longest = TRACE_ROWS_MOST / study.trace_rate
            expected = f"expected at most {longest:.6g} s at a trace.rate of {study.trace_rate:g} Hz"
            raise invalid(expected, "scenario", name, "duration")
