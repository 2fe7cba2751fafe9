"""The predicted speed ripple at one speed, with learning and with the same feedback alone.

The analysis is for small signals. P_t is the response from current reference to the true speed. S, C, Gamma
and kept are those of learning_loop.py. Two disturbances make ripple of the true speed:

    disturbance                                     ripple with feedback alone    ripple with learning
    an order of motor and load, d in A              P_t S d                       P_t S d residual
    noise n of the measured speed from counts       P_t S C n                    its variance after N periods,
                                                                                 with rho = Q kept:
        without a lead   |P_t S|^2 (|C + V|^2 + |V|^2 rho^2 R) n^2,    V = Gamma S / (1 + X)
        with a lead      |P_t S|^2 (|C|^2 + |V|^2 Q^2 R) n^2,          V = Gamma S
        R = (1 - rho^2N) / (1 - rho^2)

Without learning, C and S are those before learning takes over from the integral, if the law hands that over.

R is the accumulation of noise in the memory: each period adds noise to what was learned, and if learning
hardly decays, it stays there. An angle in counts of q has an error of variance q^2 / 12. A speed that is the
difference of two angles over the time W contains this error twice. The speed's noise is white if W is shorter
than a sample. Otherwise successive samples share an angle, and the noise has the spectrum |1 - exp(-jwW)|^2.
An observer's speed has the spectrum of its response, folded at the law's rate. A speed timed from edge to
edge has no such error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.design.angle_functions import functions_in
from cogless.design.closed_loop import Linear
from cogless.design.learning_loop import FREQUENCY_LEAST, LearningLoop, plants, sensitivity
from cogless.design.margins import Complex, Real
from cogless.design.speed_loop import SpeedLoop, counting_window, observed
from cogless.study import Study, for_scenario
from cogless.study.position_sensor import Counted, Hall
from cogless.units import TURN

RIPPLE_FREQUENCIES = 2000  # frequencies at which a sensor's noise is added up
HARMFUL_RATIO = 1.25  # ripple with learning / feedback's ripple; above this learning does harm
WINDOW_ROUNDING = 1e-9  # relative error of a window that is as long as a sample


@dataclass(frozen=True)
class Sampled:
    """How a position sensor measures speed: the angle of one count, and the time over which it counts."""

    count: float  # rad
    window: float  # s
    timed: bool  # the speed is the time between edges
    intervals: int = 0  # Hall sensors: intervals over which the speed is the mean; 0: other sensors
    observer: tuple[float, float] | None = None  # bandwidth, rad/s, and period, s

    @property
    def hall(self) -> bool:
        """Whether the position sensor is Hall sensors."""
        return self.intervals > 0

    @property
    def edge(self) -> float:
        """Angle from edge to edge, rad. `count` is larger if the speed is the mean over several edges."""
        return 2 * self.count / (self.intervals + 1) if self.hall else self.count

    def counts(self, omega_m: float) -> float:
        """Counts per speed sample at the mechanical speed omega_m in rad/s."""
        return abs(omega_m) * self.window / self.count

    def counts_clause(self, omega_m: float) -> str:
        """The counts per speed sample at the mechanical speed omega_m in rad/s, as a clause."""
        return f"the position sensor gives {self.counts(omega_m):.2g} counts per speed sample"


def sampled(study: Study, scenario: str) -> Sampled | None:
    """How the position sensor measures speed in a scenario; None for an ideal sensor."""
    drive = for_scenario(study, scenario).drive
    sensor = drive.position_sensor
    if isinstance(sensor, Counted):
        period = 1 / drive.rates.current_loop
        if sensor.bandwidth:
            window = counting_window(sensor.bandwidth, period)
            return Sampled(sensor.step, window, False, observer=(sensor.bandwidth, period))
        return Sampled(sensor.step, sensor.periods(drive.rates.divider) * period, sensor.timed)
    if isinstance(sensor, Hall):
        # A mean over n intervals is as late as the speed over one interval that is (n + 1) / 2 times as long.
        step = sensor.step(study.motor.pole_pairs) * (sensor.edges + 1) / 2
        return Sampled(step, 1 / drive.rates.outer_loop, True, sensor.edges)
    return None


@dataclass(frozen=True)
class Ripple:
    """RMS of the speed about its mean, rad/s, after learning for a given time."""

    without: float  # the ripple that the feedback alone leaves
    learned: float

    @property
    def ratio(self) -> float:
        """Ratio of the ripple with learning to that of the feedback alone; 1 if there is no ripple."""
        return self.learned / self.without if self.without > 0 else 1.0


def ripple(loop: LearningLoop, duration: float, settled: bool = True) -> Ripple:
    """The ripple at a loop's speed, after learning for `duration` seconds.

    `settled`: each order counts as fully learned; otherwise as far as it is learned in `duration`.
    """
    assert loop.scenario is not None
    n, d = orders(loop.study, loop.scenario, loop.omega_m)
    f = np.asarray(n * abs(loop.omega_m) / math.tau)
    periods = max(1.0, duration * loop.periods_per_second)
    feedbacks = (loop.feedback_before, loop.feedback)  # a law may hand its integral over to learning
    alone, learned = (disturbed(loop.plant, feedback, f) * d for feedback in feedbacks)
    if len(f):
        learned = learned * (loop.residual(f) if settled else loop.yet(f, periods))
    before, after = float(np.sum(alone**2)) / 2, float(np.sum(learned**2)) / 2
    source = _sensor(loop)
    if source is not None and not source.timed:
        noise = _noise(loop, source, periods)
        before, after = before + noise[0], after + noise[1]
    return Ripple(math.sqrt(before), math.sqrt(after))


def _sensor(loop: LearningLoop) -> Sampled | None:
    assert loop.scenario is not None
    return sampled(loop.study, loop.scenario)


def orders(study: Study, scenario: str, omega_m: float) -> tuple[NDArray[np.intp], Real]:
    """The orders of motor, load and current sensors at a speed, rad/s, and their amplitudes, A."""
    wave = functions_in(study, scenario).waves(omega_m)
    of_sensors = sensor_waves(for_scenario(study, scenario), wave[0] / 2)
    wave = np.pad(wave, (0, max(0, 1 + max(of_sensors) - len(wave))))
    for order, amplitude in of_sensors.items():
        wave[order] = math.hypot(wave[order], amplitude)
    indices = np.flatnonzero(wave > 1e-9 * (1 + wave[0]))
    indices = indices[indices > 0]
    return indices, wave[indices]


def sensor_waves(study: Study, current: float) -> dict[int, float]:
    """Amplitudes of i_q by order, A, that the current sensors' errors make at a mean current of `current`, A.

    The loop holds the measured current, so the true current has the sensors' error. An offset makes one wave
    in an electrical revolution. Gains that differ between the phases make two.
    """
    drive, pairs = study.drive, study.motor.pole_pairs
    if drive.ideal:
        return {pairs: 0.0}
    sensors, phases = drive.current_sensors, study.motor.star().phases
    axes, to_axes = _axes(study)
    offset = to_axes @ np.array(sensors.offset[:phases])
    (a, b), (c, d) = to_axes @ np.diag(sensors.gain_error[:phases]) @ axes.T
    mirrored = math.hypot(a - d, b + c) / 2  # the rest turns with the current
    return {pairs: float(np.hypot(*offset)), 2 * pairs: mirrored * abs(current)}


def _axes(study: Study) -> tuple[Real, Real]:
    """The phases' axes in alpha and beta, and the matrix from sensed phases to both; 2 x phases each."""
    phases = study.motor.star().phases
    angles = TURN * np.arange(3) / 3 if phases == 3 else np.array([0.0, math.pi / 2])
    axes, measured = np.array([np.cos(angles), np.sin(angles)]), np.eye(phases)
    if phases == 3 and study.drive.current_sensors.sensors == 2:
        measured[2] = [-1.0, -1.0, 0.0]  # the third is what the other two leave
    return axes, 2 / phases * axes @ measured


def current_noise(study: Study, plant: SpeedLoop, feedback: Linear) -> float:
    """Variance of the true speed, (rad/s)^2, that noise of the current sensors causes under a feedback.

    The current loop follows the measured current, so this noise is a current that disturbs.
    """
    f = _frequencies(plant.period)
    passed = np.abs(responses(plant, feedback, f)[0]) ** 2
    # white up to half the current loop's rate, of which the law's band is one part in `steps`
    return float(np.mean(passed)) * measured_noise(study) / plant.steps


def measured_noise(study: Study) -> float:
    """Variance of the measured i_q, A^2, by noise of the current sensors, as a mean over the angle."""
    if study.drive.ideal:
        return 0.0
    return study.drive.current_sensors.variance * float(np.sum(_axes(study)[1] ** 2)) / 2


def responses(plant: SpeedLoop, feedback: Linear, f: Real) -> tuple[Complex, Complex]:
    """P_t S, from a current that disturbs to the true speed, and S, at frequencies f in Hz."""
    grid, P_omega, P_theta = plants(plant)
    w = math.tau * f
    P_omega, P_theta = np.interp(f, grid, P_omega), np.interp(f, grid, P_theta)
    S = sensitivity(plant, feedback, w, P_omega, P_theta)
    return 1j * w * P_theta * S, S


def disturbed(plant: SpeedLoop, feedback: Linear, f: Real) -> Real:
    """Amplitude of the true speed per ampere of a disturbing torque, rad/s/A, at frequencies f in Hz.

    A torque acts without the current loop, so the response is that of the mechanics, times S. The law sees a
    wave above half its rate as a slower wave, and cannot act against the wave itself: the speed then has
    the full response, and the motion at the slower frequency.
    """
    seen = seen_as(f, plant.period)
    _, S = responses(plant, feedback, np.maximum(seen, FREQUENCY_LEAST))  # an integral has a pole at 0
    measured = 1.0 if plant.measures_speed else seen / f  # speed at the slower frequency / true speed
    factors = np.where(seen < f, np.hypot(1, np.abs(1 - S) * measured), np.abs(S))
    return np.asarray(np.abs(plant.driven(math.tau * f)) * factors)


def seen_as(f: Real, period: float) -> Real:
    """The frequency, Hz, from 0 to half the rate, as which samples show a wave of frequency f."""
    return np.asarray(np.abs(f - np.round(f * period) / period))


def counting(plant: SpeedLoop, feedback: Linear, source: Sampled) -> float:
    """Variance of the true speed, (rad/s)^2, that the sensor's counts cause under the feedback alone."""
    f, density = _density(plant.period, source)
    C = feedback.ratio * feedback.response(math.tau * f, plant.period)
    return float(np.sum(np.abs(responses(plant, feedback, f)[0] * C) ** 2 * density))


def _frequencies(T: float) -> Real:
    """Frequencies, Hz, up to 1 / 2T."""
    return np.asarray((np.arange(RIPPLE_FREQUENCIES) + 0.5) / RIPPLE_FREQUENCIES * 0.5 / T)


def _density(T: float, source: Sampled) -> tuple[Real, Real]:
    """Frequencies, Hz, up to 1 / 2T, and the variance of the measured speed's noise at each, (rad/s)^2."""
    f = _frequencies(T)
    if source.observer is not None:
        bandwidth, period = source.observer
        folds = (
            np.arange(round(T / period))[:, None] / T
        )  # Hz; the observer's spectrum repeats after 1 / period
        gains = np.mean(np.abs(observed(math.tau * (f + folds), bandwidth, period)) ** 2, axis=0)
    elif source.window >= T * (1 - WINDOW_ROUNDING):  # Two samples share an angle, with opposite signs.
        gains = np.abs(1 - np.exp(-1j * math.tau * f * source.window)) ** 2 / source.window**2
    else:
        gains = np.full(len(f), 2 / source.window**2)
    return f, np.asarray(source.count**2 / 12 / RIPPLE_FREQUENCIES * gains)


def _noise(loop: LearningLoop, source: Sampled, periods: float) -> tuple[float, float]:
    """Variances of the true speed, (rad/s)^2, that the sensor's counts cause without and with learning."""
    f, density = _density(loop.plant.period, source)
    w, ratio, T = math.tau * f, loop.feedback.ratio, loop.plant.period
    C = ratio * loop.feedback.response(w, T)
    passed, S = responses(loop.plant, loop.feedback, f)
    V, q = ratio * loop.gain(w) * S, loop.q(f) * loop.interpolation_gain(f, True)
    rho = np.minimum(q * np.abs(loop.share_kept(f)), 1 - 1e-9) ** 2
    times = (1 - rho**periods) / (1 - rho)
    if loop.lead:
        learned = np.abs(C) ** 2 + np.abs(V) ** 2 * q**2 * times
    else:
        V = V * loop.share_kept(f)
        learned = np.abs(C + V) ** 2 + np.abs(V) ** 2 * rho * times
    alone = counting(loop.plant, loop.feedback_before, source)
    return alone, float(np.sum(np.abs(passed) ** 2 * density * learned))
