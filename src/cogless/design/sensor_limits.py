"""What the sensors leave of the ripple that the law `harmonic` would take away.

The steps of the angle are noise, which the feedback turns into ripple of the true speed (`counting` of
ripple.py), and which no order holds. The orders learn some of it, too. The angle's noise of density s, in
rad^2/Hz, looks like a load of w^2 / b times as much at the frequency w of an order. An order that learns at
the rate r averages it over r / 2 Hz:

    ripple that the steps make while the orders learn, squared:
        sum over orders of |P_t S|^2 (w^2 / b)^2 s r / 2

If this ripple and that of the feedback together are more than the guard allows, the answer is in doubt. The
rate falls later, and so does this ripple.

The noise is white while a count or more comes in each sample of the law. With fewer, several samples show the
same angle, and its error swings with the counts. No model of learning here covers that case. Where the
counts come nearly as often as the samples, or a whole number of times as often, the noise is denser among the
orders than white noise would be (`steps_density`).

The noise of the current sensors is no order either. It makes ripple with learning and without.

An error e(theta) of the angle turns the phase of an order n over the measured angle:

    exp(j n (theta_m - e)) = sum_k c_k exp(j (n + k) theta_m),    c_k = mean of exp(-j (n e + k theta_m))

The law holds those n + k that are multiples of its base, sum |c_k|^2 of the order's power. The rest is left.
For one wave of amplitude a, |c_k| is J_k(n a).

At speeds up to `Certificate.straight` the law also learns e once or twice a turn, from the phases that all
orders gain together. There is such a phase up to the first zero of J_0, where the mean of an order over the
turn vanishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.design.closed_loop import Linear
from cogless.design.law_rules import feedback_of
from cogless.design.laws.harmonic import BENDS_FROM, Certificate, Certified, main_order
from cogless.design.margins import Real
from cogless.design.ripple import (
    HARMFUL_RATIO,
    Sampled,
    counting,
    current_noise,
    disturbed,
    orders,
    responses,
    sampled,
    seen_as,
)
from cogless.design.speed_loop import SpeedLoop, speed_loop
from cogless.design.verdict import SAMPLE_COUNTS_LEAST
from cogless.design.warnings import CURED_RATIO
from cogless.study import Study, for_scenario
from cogless.study.position_sensor import Counted
from cogless.units import TURN

BEND_ANGLE_MOST = 2.404825557695773  # rad, the first zero of J_0
ERROR_ANGLES = 8  # angles in a wave of the highest order, at which a sensor's error is evaluated
ERROR_TABLE_ORDERS = 32  # orders of a sensor's error table that are taken
SAWTOOTH_WAVES = 32  # waves of a step's error that `steps_density` has; the others hold 2 % of its power
DECAY_DEVIATIONS = 3.5  # standard deviations from which on a normal curve is taken for 0
DENSITY_WIDTH_LEAST = 1e-4  # per sample, least width of a band over which the density is a mean
SPREAD_ROUNDS = 4  # rounds until the ripple of learning and its spread agree to some percent
WHITE_DENSITY_MOST = 2.0  # density above which the design says where the steps' noise comes from


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """The speed's ripple at one speed, rad/s rms: of feedback alone, and what learning leaves."""

    scenario: str
    omega_m: float  # rad/s
    alone: float  # the least that the feedbacks of the scenario's controllers leave
    steps: float  # part of the learned ripple that the sensor's steps make
    error: float  # part of the learned ripple that the sensor's error makes
    unlearned: float  # part of the learned ripple by orders that are not learned
    noise: float  # part of the learned ripple by noise of the current sensors
    counts: float  # counts in a sample of the law; infinite where the edges are timed
    law_rate: float  # samples of the law a second
    steps_density: float  # density of the steps' noise at the learned orders / that of white noise
    steps_learning: float  # ripple that the steps make while the orders learn at their first rate

    @property
    def learned(self) -> float:
        """The ripple after learning."""
        return math.hypot(self.steps, self.error, self.unlearned, self.noise)

    @property
    def worth_it(self) -> bool:
        """Whether learning takes away a tenth or more."""
        return self.learned <= CURED_RATIO * self.alone

    @property
    def few_counts(self) -> bool:
        """Whether several samples of the law show the same angle."""
        return self.counts < SAMPLE_COUNTS_LEAST

    @property
    def modelled(self) -> bool:
        """Whether the model of learning still holds with the sensor's steps."""
        learning = math.hypot(self.alone, self.steps_learning)
        return not self.few_counts and learning <= HARMFUL_RATIO * self.alone

    @property
    def beat(self) -> float | None:
        """Frequency, Hz, of the beat between counts and samples, if it makes the noise dense; else None."""
        if self.steps_density <= WHITE_DENSITY_MOST:
            return None
        return self.law_rate * abs(self.counts - round(self.counts))


def remaining(study: Study, name: str, certified: Certificate) -> list[Remaining]:
    """The ripple at the judged speeds that scenarios of a controller with the law `harmonic` hold."""
    at_speeds = []
    for scenario in study.scenarios_of(name):
        omega = study.scenario[scenario].constant_speed
        sensor = for_scenario(study, scenario).drive.position_sensor
        if omega is None or not isinstance(sensor, Counted):
            continue
        speed = next((at for at in certified.speeds if math.isclose(at.omega_m, omega)), None)
        if speed is not None:
            at_speeds.append(_remaining(study, name, scenario, certified, speed, sensor))
    return at_speeds


@dataclass(frozen=True)
class _Alone:
    """The speed's ripple that a feedback leaves without learning, rad/s."""

    orders: Real  # amplitude of each order of motor, load and current sensors
    steps: float  # rms
    error: float  # rms, of the true speed, since the feedback follows the sensor's error
    noise: float  # rms

    @property
    def ripple(self) -> float:
        """The rms of all parts together."""
        return math.hypot(_rms(self.orders), self.steps, self.error, self.noise)


def _remaining(
    study: Study, name: str, scenario: str, certified: Certificate, speed: Certified, sensor: Counted
) -> Remaining:
    source, omega, loop = sampled(study, scenario), speed.omega_m, speed_loop(study, scenario)
    of_scenario = for_scenario(study, scenario)
    assert source is not None
    n, d = orders(study, scenario, omega)
    names = [key for key in study.controllers_in(scenario) if not study.controller[key].learned]
    feedbacks = [
        feedback for key in (name, *names) if (feedback := feedback_of(study, key, omega)) is not None
    ]
    own, *others = (
        _alone(of_scenario, loop, feedback, omega, (n, d), source, sensor) for feedback in feedbacks
    )
    base = certified.learner.base
    learned = np.isin(n, certified.learned_orders(speed))
    turned = main_order(study, base) * sum(abs(sensor.wave(k)) for k, _ in enumerate(BENDS_FROM, 1))
    bent = turned < BEND_ANGLE_MOST and certified.straight is not None and omega <= certified.straight
    bends = certified.learner.bends if bent else 0
    shares = [held_share(sensor, int(order), base, speed.acting, bends) for order in n]
    missed = own.orders * np.sqrt(1 - np.minimum(shares, 1.0))
    steps_learning, density = 0.0, 0.0
    if not source.timed:
        steps_learning, density = _learned_steps(loop, feedbacks[0], source, certified, speed, own.ripple)
    return Remaining(
        scenario=scenario,
        omega_m=omega,
        alone=min(alone.ripple for alone in (own, *others)),
        steps=own.steps,
        error=math.hypot(own.error, _rms(missed[learned])),
        unlearned=_rms(own.orders[~learned]),
        noise=own.noise,
        counts=math.inf if source.timed else omega * loop.period / source.count,
        law_rate=1 / loop.period,
        steps_density=density,
        steps_learning=steps_learning,
    )


def _learned_steps(
    plant: SpeedLoop,
    feedback: Linear,
    source: Sampled,
    certified: Certificate,
    speed: Certified,
    ripple: float,
) -> tuple[float, float]:
    """Ripple that the sensor's steps make while the orders learn, rad/s rms, and the noise's `steps_density`.

    `ripple`: of the feedback alone, rad/s rms.
    """
    omega, period, base = speed.omega_m, plant.period, certified.learner.base
    n = certified.learned_orders(speed)
    w = n * omega
    passed = (np.abs(responses(plant, feedback, w / TURN)[0]) * w**2 / plant.b) ** 2
    white = source.count**2 / 12 * 2 * period  # rad^2/Hz
    rate = min(speed.rate, base * omega / math.pi)  # the law has this bound, too
    turned = omega * period / TURN  # turns in a sample
    per_sample, width = period / source.count, max(base * turned / 2, DENSITY_WIDTH_LEAST)
    density = 1.0
    learning = math.sqrt(white * rate / 2 * float(np.sum(passed)))
    for _ in range(SPREAD_ROUNDS):  # The ripple spreads the noise that makes it.
        spread = math.hypot(ripple, learning) * per_sample
        at_orders = steps_density(omega * per_sample, spread, n * turned, width)
        density = max(0.0, float(passed @ at_orders)) / max(float(np.sum(passed)), 1e-300)
        learning = math.sqrt(white * rate / 2 * density * float(np.sum(passed)))
    return learning, density


def steps_density(counts: float, spread: float, f: Real, width: float) -> Real:
    """Density of the noise of an angle's steps at frequencies, over that of white noise.

    `counts`: steps in a sample; `spread`: rms by which ripple of the speed changes this number. `f`:
    frequencies, and `width`: band over which each density is a mean; both per sample. The error of the angle
    is a sawtooth. Its wave k has 6 / (pi k)^2 of the power and turns k counts times in a sample. Ripple
    spreads the wave over a band, by Woodward's theorem in the shape of the speed's distribution, here normal.
    """
    k = np.arange(1, SAWTOOTH_WAVES + 1)[:, None]
    lag = np.arange(1, math.ceil(DECAY_DEVIATIONS / (math.tau * width)) + 1)  # samples
    waves = 6 / (math.pi * k) ** 2 * np.cos(math.tau * k * counts * lag)
    correlation = np.sum(
        waves * np.exp(-((math.tau * lag) ** 2) * ((k * spread) ** 2 + width**2) / 2), axis=0
    )
    return np.asarray(1 + 2 * np.cos(math.tau * np.multiply.outer(f, lag)) @ correlation)


def _alone(
    study: Study,
    loop: SpeedLoop,
    feedback: Linear,
    omega: float,
    waves: tuple[NDArray[np.intp], Real],
    source: Sampled,
    sensor: Counted,
) -> _Alone:
    """What a feedback leaves. `waves`: orders of motor, load and current sensors, and amplitudes in A."""
    n, d = waves
    of_error = np.array(_error_orders(sensor), dtype=float)
    amplitudes = np.array([abs(sensor.wave(int(order))) for order in of_error])
    seen = seen_as(of_error * omega / TURN, loop.period)
    _, S = responses(loop, feedback, seen)
    return _Alone(
        disturbed(loop, feedback, np.asarray(n * omega / TURN)) * d,
        0.0 if source.timed else math.sqrt(counting(loop, feedback, source)),
        _rms(TURN * seen * amplitudes * np.abs(1 - S)),
        math.sqrt(current_noise(study, loop, feedback)),
    )


def _rms(amplitudes: Real) -> float:
    """The rms of a sum of waves."""
    return math.sqrt(float(np.sum(amplitudes**2)) / 2)


def _error_orders(sensor: Counted) -> list[int]:
    """The orders of a sensor's error."""
    of_table = range(1, ERROR_TABLE_ORDERS + 1) if sensor.error_table is not None else ()
    return sorted({*(part["order"] for part in sensor.orders), *of_table})


def held_share(sensor: Counted, order: int, base: int, highest: int, bends: int) -> float:
    """The share of an order's power, 0 to 1, that the multiples of `base` up to `highest` hold.

    The multiples are orders of the measured angle. Up to the order `bends` the law learns the sensor's error.
    """
    angles = ERROR_ANGLES * max(order, highest, ERROR_TABLE_ORDERS)
    theta, error = TURN / angles * np.arange(angles), np.zeros(angles)
    for k in _error_orders(sensor):
        if k > bends:
            error += abs(sensor.wave(k)) * np.sin(k * theta + np.angle(sensor.wave(k)))
    power = np.abs(np.fft.fft(np.exp(1j * order * (theta - error))) / angles) ** 2
    return float(np.sum(power[np.arange(base, highest + 1, base)]))
