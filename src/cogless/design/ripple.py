"""The speed ripple that learning will leave, beside that of the same feedback without, at one speed.

With P_t from current reference to the true speed, and S, C, Gamma, kept of learning_loop.py, small signals:

    what motor and load have of an order, d, in A      without P_t S d       with P_t S d residual
    what the sensor's counts add to the speed, n       without P_t S C n
    and with learning, N periods on, rho = Q kept,
        without a lead   |P_t S|^2 (|C + V|^2 + |V|^2 rho^2 R) n^2,    V = Gamma S / (1 + X)
        with one         |P_t S|^2 (|C|^2 + |V|^2 Q^2 R) n^2,          V = Gamma S
        R = (1 - rho^2N) / (1 - rho^2)

R is what accumulates where learning hardly decays: counts that every period adds to what was learned. An
angle in counts of q has an error of variance q^2 / 12; a speed that is its difference over W has it twice:
white where W is below a sample, else with the spectrum |1 - exp(-jwW)|^2 of samples that share an angle.
A speed timed from edge to edge has no such error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.learning_loop import LearningLoop, plants, sensitivity
from cogless.design.margins import Complex, Real
from cogless.design.pi import pi_response
from cogless.study import Study, for_scenario
from cogless.study.drive import Encoder, Resolver
from cogless.study.spoken import speed_text

FREQUENCIES = 2000
FEW = 1.0  # counts in a sample of the speed, below which it comes in pulses, or late
LARGE = 0.4  # of the speed: the peaks of several orders, 2 to 3 times their rms, then stop the rotor
ROUNDING = 1e-9


@dataclass(frozen=True)
class Sampled:
    """A speed sample of an encoder: an angle's counts, and the time that they are counted over."""

    count: float  # rad
    window: float  # s
    timed: bool  # from edge to edge

    def counts(self, omega_m: float) -> float:
        """Counts in a sample at a speed."""
        return abs(omega_m) * self.window / self.count


def sampled(study: Study, scenario: str) -> Sampled | None:
    """The counts of the position sensor in a scenario; None of an ideal one."""
    drive = for_scenario(study, scenario).drive
    sensor = drive.position_sensor
    if isinstance(sensor, Encoder):
        timed = sensor.speed_method != "M"
        return Sampled(math.tau / (4 * sensor.lines), 1 / drive.rates.outer_loop, timed)
    if isinstance(sensor, Resolver):
        return Sampled(math.tau / 2**sensor.bits, sensor.window / drive.rates.current_loop, False)
    return None


@dataclass(frozen=True)
class Ripple:
    """RMS of the speed about its mean, rad/s, once settled."""

    without: float  # of the feedback alone
    learned: float

    @property
    def ratio(self) -> float:
        """Ratio of the ripple with learning to that of the feedback; 1 where neither has any."""
        return self.learned / self.without if self.without > 0 else 1.0


def ripple(loop: LearningLoop, duration: float) -> Ripple:
    """The ripple at a loop's speed, after learning for so many seconds."""
    f, d = _orders(loop)
    P_t, S = _responses(loop, f)
    passed = np.abs(P_t * S) * d
    left = passed * loop.residual(f) if len(f) else passed
    before, after = float(np.sum(passed**2)) / 2, float(np.sum(left**2)) / 2
    source = _sensor(loop)
    if source is not None and not source.timed:
        noise = _noise(loop, source, max(1.0, duration * loop.periods_per_second))
        before, after = before + noise[0], after + noise[1]
    return Ripple(math.sqrt(before), math.sqrt(after))


def doubts(loops: Sequence[LearningLoop]) -> tuple[str, ...]:
    """Reasons why small signals are a poor guide at some of the speeds of a controller, a phrase each."""
    found = [reason for loop in loops if (reason := loop.doubt) is not None][:1]
    slowest = min(loops, key=lambda loop: loop.omega_m)
    source = _sensor(slowest)
    if source is not None and source.counts(slowest.omega_m) < FEW * (1 - ROUNDING):
        few = f"{source.counts(slowest.omega_m):.2g} counts come in a speed sample"
        found.append(f"at {speed_text(slowest.study, slowest.omega_m)} {few}")
    swings = [(ripple(loop, 0.0).without / loop.omega_m, loop) for loop in loops]
    swing, where = max(swings, key=lambda pair: pair[0])
    if swing > LARGE:
        speed = speed_text(where.study, where.omega_m)
        found.append(f"at {speed} its feedback lets the speed swing by {100 * swing:.0f} % rms")
    return tuple(found)


def _sensor(loop: LearningLoop) -> Sampled | None:
    assert loop.scenario is not None
    return sampled(loop.study, loop.scenario)


def _orders(loop: LearningLoop) -> tuple[Real, Real]:
    """Frequencies, Hz, of the orders that motor and load have, and their amplitudes, A."""
    assert loop.scenario is not None
    functions = functions_in(loop.study, loop.scenario)
    points = 4 * max([*functions.orders, 16])
    current = functions.current(np.arange(points) / points * math.tau, loop.omega_m)
    wave = 2 * np.abs(np.fft.rfft(current)) / points
    orders = np.flatnonzero(wave > 1e-9 * (1 + wave[0]))
    orders = orders[orders > 0]
    return np.asarray(orders * abs(loop.omega_m) / math.tau), np.asarray(wave[orders], dtype=float)


def _responses(loop: LearningLoop, f: Real) -> tuple[Complex, Complex]:
    """P_t and S at frequencies in Hz."""
    grid, P_omega, P_theta = plants(loop.plant)
    w = math.tau * f
    P_omega, P_theta = np.interp(f, grid, P_omega), np.interp(f, grid, P_theta)
    return 1j * w * P_theta, sensitivity(loop.plant, loop.feedback, w, P_omega, P_theta)


def _noise(loop: LearningLoop, source: Sampled, periods: float) -> tuple[float, float]:
    """Variances, (rad/s)^2, of what counts make of the speed, without and with learning."""
    nyquist = 0.5 / loop.plant.period
    f = (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES * nyquist
    w, ratio, T = math.tau * f, loop.feedback.ratio, loop.plant.period
    density = source.count**2 / 12 / source.window**2 / nyquist
    shared = source.window >= T * (1 - ROUNDING)  # an angle that two samples have in common, with other signs
    density = density * (np.abs(1 - np.exp(-1j * w * source.window)) ** 2 if shared else 2.0)
    P_t, S = _responses(loop, f)
    C = ratio * pi_response(w, T, loop.feedback.k, loop.feedback.k_i)
    V, q = ratio * loop.gain(w) * S, loop.q(f) * loop.lines(f, True)
    rho = np.minimum(q * np.abs(loop.kept(f)), 1 - 1e-9) ** 2
    times = (1 - rho**periods) / (1 - rho)
    if loop.lead:
        learned = np.abs(C) ** 2 + np.abs(V) ** 2 * q**2 * times
    else:
        V = V * loop.kept(f)
        learned = np.abs(C + V) ** 2 + np.abs(V) ** 2 * rho * times
    passed = np.abs(P_t * S) ** 2 * density * nyquist / FREQUENCIES
    return float(np.sum(passed * np.abs(C) ** 2)), float(np.sum(passed * learned))
