"""Whether the drive has the current that a scenario's motion needs.

With the functions of model (1), i = alpha(theta) + beta omega + h a. The mean of i over the angle carries
load, friction and acceleration. The part of i that varies with the angle cancels the ripple. If the limit is
below the mean, the rotor doesn't follow. If it is below the peak, ripple remains.

A rotor at rest needs the current of its breakaway friction and its cogging before it turns. A slow feedback
asks for that current only after some time.

The current controller also turns noise of the measured current into a voltage, kp times the noise. Where this
voltage reaches its limit, no law learns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.changes import cure_words, first, helping, unit_text
from cogless.design.closed_loop import Linear
from cogless.design.margins import Real
from cogless.design.ripple import measured_noise
from cogless.design.speed_loop import slower_loop
from cogless.study import Study, changed, for_scenario
from cogless.study.drive import StarBelief
from cogless.study.motion import course
from cogless.study.motor import StarMotor
from cogless.study.numerics import largest_voltage
from cogless.study.reading import Changes, Remark

D_POINTS = 20_001  # values of i_d among which the largest torque is searched
WAVE_POINTS = 8  # angles in a wave of the highest order
LIMIT = "drive.current_loop.current_limit"
MEASURED_CURRENTS = {
    "current_max": "the current at its limit with the sensors' noise",
    "current_sum": "the sum of the phase currents with the sensors' errors",
}
CURRENT_RESERVE = 1.1  # limit that is advised / current that is needed
LIMITED_SHARE_MOST = 0.1  # share of the law's periods at the voltage limit; a larger one is warned of
NOISE_DEVIATIONS, NOISE_POINTS = 5, 100  # standard deviations of a normal distribution, and points for them


@dataclass(frozen=True)
class Needed:
    """Magnitudes of the current i_q that a scenario's motion needs, A."""

    mean: float  # the largest mean over the angle
    most: float  # the peak over angle and time


def needed(study: Study, scenario: str) -> Needed:
    """The current that a scenario's reference, load, load events and cogging need."""
    functions, of = functions_in(study, scenario), for_scenario(study, scenario)
    experiment, K_t = study.scenario[scenario], of.motor.star().K_t
    theta = np.linspace(0, math.tau, WAVE_POINTS * max([*functions.orders, 16]), endpoint=False)
    alpha = functions.alpha(theta)
    mean = float(np.mean(alpha))
    load = experiment.load or of.mechanics.load
    steps = [0.0, *((event.load - load.torque) / of.mechanics.ratio / K_t for event in experiment.events)]
    way = course(experiment)
    moving = (
        float(np.mean(functions.beta(theta))) * way.omega + float(np.mean(functions.h(theta))) * way.alpha
    )
    means = [mean + step + moving for step in steps]
    largest = max(float(np.max(np.abs(current))) for current in means)
    return Needed(largest, largest + float(np.max(np.abs(alpha - mean))))


def available(study_here: Study, omega: float) -> float:
    """The largest output of a law, A, at a speed (rad/s): the equivalent q-axis current of largest torque.

    With field weakening, current and voltage bound it; without, the current alone.
    """
    drive, star = study_here.drive, study_here.motor.star()
    limit, reach = drive.current_loop.current_limit, drive.largest_torque_current(star)
    reference = drive.current_reference
    if reference is None or not reference.field_weakening or drive.inverter is None:
        return reach
    belief = drive.belief.resolved(star)
    d = np.linspace(-limit, limit, D_POINTS)
    u_max = reference.voltage_share * largest_voltage(drive.inverter.bus_voltage, star)
    q = np.minimum(np.sqrt(limit**2 - d**2), _q_within(belief, star.pole_pairs * abs(omega), d, u_max))
    torque = np.where(q > 0, q * (1 - (belief.L_q - belief.L_d) / belief.psi_f * d), 0.0)
    return min(reach, float(torque.max()))


def carried(study_here: Study, omega: float) -> float:
    """The largest i_q, A, that the bus voltage carries at a speed, rad/s, with i_d = 0; infinite if ideal."""
    star, inverter = study_here.motor.star(), study_here.drive.inverter
    if inverter is None or study_here.drive.ideal:
        return math.inf
    u_max = largest_voltage(inverter.bus_voltage, star)
    return max(0.0, float(_q_within(star, star.pole_pairs * abs(omega), np.zeros(1), u_max)[0]))


def _q_within(motor: StarMotor | StarBelief, omega_e: float, i_d: Real, u_max: float) -> Real:
    """The largest i_q, A, at each i_d within a voltage of u_max, V; zero or less if there is none.

    |u|^2 = (R i_q + w (psi + L_d i_d))^2 + (R i_d - w L_q i_q)^2 = a i_q^2 + 2 b i_q + c + u_max^2
    """
    a = motor.R_s**2 + (omega_e * motor.L_q) ** 2
    b = motor.R_s * omega_e * (motor.psi_f + (motor.L_d - motor.L_q) * i_d)
    c = (motor.R_s * i_d) ** 2 + (omega_e * (motor.psi_f + motor.L_d * i_d)) ** 2 - u_max**2
    return np.asarray(np.where(b * b >= a * c, (np.sqrt(np.maximum(b * b - a * c, 0.0)) - b) / a, 0.0))


def starts_after(study: Study, scenario: str, feedback: Linear, omega: float) -> float:
    """Time, s, after which a feedback asks a resting rotor for the current that starts it, at a reference of
    `omega`, rad/s; infinite if it never does.

    The feedback's output is ratio omega (k + (k k_theta + k_i + k_r) t + k_i k_theta t^2 / 2).
    """
    own_study = for_scenario(study, scenario)
    star, size = own_study.motor.star(), feedback.ratio * abs(omega)
    friction = own_study.mechanics.breakaway + sum(abs(wave.torque or 0.0) for wave in star.cogging)
    missing = friction / star.K_t - feedback.k * size
    slope = (feedback.k * feedback.k_theta + feedback.k_i + feedback.k_r) * size
    bend = feedback.k_i * feedback.k_theta * size / 2
    if missing <= 0:
        return 0.0
    if bend > 0:
        return (math.sqrt(slope**2 + 4 * bend * missing) - slope) / (2 * bend)
    return missing / slope if slope > 0 else math.inf


def _available(study: Study, scenario: str) -> float:
    """The largest output of a law at a scenario's top speed, A."""
    return available(for_scenario(study, scenario), study.scenario[scenario].top_reference)


def too_much_current(study: Study, scenario: str) -> Remark | None:
    """Warning that the motion, or an even speed, needs more current than the limit; None if neither does."""
    limit, needs = _available(study, scenario), needed(study, scenario)
    if needs.most <= limit:
        return None
    drive = for_scenario(study, scenario).drive
    bound = f"current_limit is {limit:.3g} A"
    if drive.current_reference is not None:
        bound = (
            "at the top speed the limits of current and voltage allow only as much torque as "
            f"{limit:.3g} A of q-axis current gives"
        )
    if needs.mean > limit:
        sentence = f"its motion and load need {needs.mean:.3g} A on average, but {bound}"
    else:
        sentence = f"a speed without ripple needs up to {needs.most:.3g} A, but {bound}"

    voltage_current = carried(for_scenario(study, scenario), study.scenario[scenario].top_reference)
    if drive.current_reference is None and needs.most > voltage_current and drive.inverter is not None:
        return Remark(
            f"{sentence}; a bus voltage of {drive.inverter.bus_voltage:.4g} V allows {voltage_current:.3g} A "
            "at its top speed"
        )

    def cured(other: Study) -> bool:
        return needed(other, scenario).most <= _available(other, scenario) and not _trips(other, scenario)

    more: Changes = {LIMIT: unit_text(CURRENT_RESERVE * needs.most, "A")}
    wider = {**more, **_wider_bounds(changed(study, more), scenario)}
    cures = helping(study, (wider,), cured)
    return Remark(sentence + cure_words(cures), cures)


def noisy_currents(study: Study, scenario: str) -> Remark | None:
    """Warning that the monitor may take errors of the current sensors for a fault; None if it does not.

    A change that `too_much_current` advises cures this, too, and is enough.
    """
    trips, more_current = _trips(study, scenario), too_much_current(study, scenario)
    if not trips or (more_current is not None and more_current.cures):
        return None
    bounds = for_scenario(study, scenario).drive.plausible_currents(study.motor.star().phases)
    reach = " and ".join(
        f"{key} is {bounds[key]:.3g} A, but {MEASURED_CURRENTS[key]} reaches {trips[key]:.3g} A"
        for key in trips
    )
    sentence = f"the monitor may switch the drive off without a fault: {reach}"

    cures = helping(study, (_wider_bounds(study, scenario),), lambda other: not _trips(other, scenario))
    return Remark(sentence + cure_words(cures), cures)


def _wider_bounds(study: Study, scenario: str) -> Changes:
    """The change to wider bounds of the monitor where errors of the current sensors exceed the bounds."""
    return {
        f"drive.monitor.{key}": unit_text(CURRENT_RESERVE * reach, "A")
        for key, reach in _trips(study, scenario).items()
    }


def _trips(study: Study, scenario: str) -> dict[str, float]:
    """The largest measured value at the current limit, A, by the key of each monitor bound that it exceeds.

    The measured vector is the limit plus noise. The measured sum of three phases is noise, offsets and gain
    errors.
    """
    of = for_scenario(study, scenario)
    drive, sensors, phases = of.drive, of.drive.current_sensors, of.motor.star().phases
    limit, noise = drive.current_loop.current_limit, drive.current_noise(phases)
    turns = np.exp(1j * math.tau * np.arange(3) / 3)
    errors = abs(sum(sensors.offset)) + limit * abs(np.sum(turns * sensors.gain_error))
    reach = {"current_max": limit + noise["current_max"], "current_sum": errors + noise["current_sum"]}
    bounds = drive.plausible_currents(phases)
    return {key: value for key, value in reach.items() if 0 < bounds[key] < value}


def noisy_voltage(study: Study, scenario: str) -> Remark | None:
    """Warning of noise of the current sensors that takes the voltage to its limit: little is learned."""
    share = limited_share(study, scenario)
    if share <= LIMITED_SHARE_MOST:
        return None
    sentence = (
        "noise of the current sensors drives the voltage to its limit in "
        f"{share:.0%} of the law's periods; no law learns in such a period"
    )

    def cured(other: Study) -> bool:
        return limited_share(other, scenario) <= LIMITED_SHARE_MOST

    cures = first(study, slower_loop(study), cured)
    return Remark(sentence + cure_words(cures), cures)


def limited_share(study: Study, scenario: str) -> float:
    """The share of the law's periods with a current period in which noise takes the voltage to its limit.

    The share is that at the scenario's top speed. The noise of the voltage is taken as normal in both axes.
    """
    of, top = for_scenario(study, scenario), study.scenario[scenario].top_reference
    drive, motor = of.drive, of.motor.star()
    if drive.ideal or drive.inverter is None:
        return 0.0
    gain = drive.current_loop.gains(drive.belief.resolved(study.motor.star()))["kp_q"]
    deviation = gain * math.sqrt(measured_noise(of))
    limit = largest_voltage(drive.inverter.bus_voltage, motor)
    emf = motor.pole_pairs * motor.psi_f * top
    if not deviation:
        return 0.0
    along = np.linspace(-NOISE_DEVIATIONS, NOISE_DEVIATIONS, 2 * NOISE_POINTS + 1)
    weight = np.exp(-(along**2) / 2)
    across = np.sqrt(np.maximum(0.0, limit**2 - (emf + deviation * along) ** 2)) / deviation
    inside = np.array([math.erf(x / math.sqrt(2)) for x in across])
    within = float(np.sum(weight * inside) / np.sum(weight))
    return float(1 - within**drive.rates.divider)
