"""The factor per period by which a learning law changes each frequency of what it learned, at one speed.

The analysis is for small signals, at a speed that hardly changes within the loop's memory. P is the response
from current reference to measured speed and angle (speed_loop.py), C the linear feedback, Gamma the learning
gain on the error that is fed back, and T the sample period:

    G = ratio (P_omega + k_theta P_theta),    C = k + k_i T z / (z - 1), and what closed_loop.py adds
    S = 1 / (1 + C G + k_v ratio P_theta),    X = Gamma G S

    factor |Q kept|,    kept = 1 / (1 + X), or 1 - X exp(jw n T) with a lead of n samples

docs/theory/learning.md and learning-in-angle.md derive this. A map with fewer cells than samples can't
distinguish f from f + m f_c, where f_c is its number of cells per second. It reproduces all of these
frequencies, with weights that add up to one:

    factor |Q sum_m sinc^2(f / f_c + m) kept(f + m f_c)|

Linear interpolation between samples attenuates further. The factor leaves this out, so it is an upper bound.
`interpolation_gain` is the interpolation's gain, as a mean over the positions between two samples.

Above the highest speed at which a law learns, the memory is frozen, and what was learned goes on acting.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.closed_loop import Linear, Oscillation, oscillation
from cogless.design.law_rules import feedback_of
from cogless.design.margins import Complex, Real
from cogless.design.speed_loop import SpeedLoop, pi_response, speed_loop
from cogless.study import Study
from cogless.study.laws.law import Memory
from cogless.units import TURN

FACTOR_MOST = 1.0 + 1e-3  # largest factor per period that counts as settling
LOOP_CURVE_POINTS = 3000  # frequencies at which the factor per period is computed
PLANT_POINTS = 8000  # frequencies at which a plant's response is stored
FREQUENCY_LEAST = 1e-4  # Hz
IMAGES_MOST = 50  # largest m; the weights of further images add up to less than a percent
SAMPLE_PHASES = (np.arange(32) + 0.5) / 32  # phases of an order's frequency between two samples


@dataclass(frozen=True)
class Worst:
    """The largest factor per period, which is an upper bound, and its frequency."""

    factor: float
    frequency: float  # Hz


@dataclass(frozen=True)
class LearningLoop(ABC):
    """A learning controller of a study, at one speed and one acceleration."""

    study: Study
    controller: str
    omega_m: float  # rad/s, mechanical
    alpha_m: float = 0.0  # rad/s^2
    torque: float = 1.0  # torque constant at an angle / its mean: differs from 1 if K_t ripples
    scenario: str | None = None  # whose true plant is used; None: the plant that the controller assumes
    late: float = 0.0  # s, delay that the study doesn't have

    # whether the learned signal passes a Q filter, whose width may be chosen
    FILTERED: ClassVar[bool] = True
    # whether the law has a forgetting, which the design may choose
    FORGETS: ClassVar[bool] = False
    # whether the learning gain is proportional to 1 / |omega_m|
    RISES_AT_REST: ClassVar[bool] = False

    @property
    @abstractmethod
    def law(self) -> Memory:
        """The controller's law; TypeError if it isn't one that learns in this way."""

    @property
    @abstractmethod
    def gamma(self) -> tuple[float, float]:
        """The learning gains on the error, A*s/rad, and on its integral, A/rad."""

    @property
    def frozen(self) -> str | None:
        """The reason why nothing is learned at this speed; None if the law learns."""
        return None

    @property
    def doubt(self) -> str | None:
        """The reason why the small-signal analysis may not hold at this speed; None if there is no reason."""
        return None

    @property
    def learns_more(self) -> bool:
        """Whether the law also learns from what the small-signal analysis leaves out."""
        return False

    @property
    def forgetting(self) -> float:
        """The share of the learned signal that the memory keeps in each period."""
        return 1.0

    @property
    def lead(self) -> int:
        """Samples by which a correction is earlier in the period than the error that it was learned from."""
        return 0

    @property
    def feedback_before(self) -> Linear:
        """The linear feedback before the law learns."""
        feedback = feedback_of(self.study, self.controller, self.omega_m)
        assert feedback is not None
        return feedback

    @cached_property
    def feedback(self) -> Linear:
        """The linear feedback while the law learns; learning's effect within the same sample is left out."""
        return self.feedback_before

    def gain(self, w: Real) -> Complex:
        """The learning gain at w in rad/s."""
        return pi_response(w, self.plant.period, *self.gamma)

    @property
    def at_once(self) -> Linear:
        """The linear feedback plus the gains that learning adds within the same sample."""
        kp, ki = (0.0, 0.0) if self.lead else self.gamma
        return dataclasses.replace(self.feedback, k=self.feedback.k + kp, k_i=self.feedback.k_i + ki)

    @cached_property
    def plant(self) -> SpeedLoop:
        """The speed loop that the law acts on, with the mean torque constant times `torque`."""
        loop = speed_loop(self.study, self.scenario)
        return dataclasses.replace(loop, b=loop.b * self.torque, delay=loop.delay + self.late)

    @property
    def periods_per_second(self) -> float:
        """Learning periods per second at this speed, Hz."""
        revolutions = float(self.law.revolutions(self.study.motor.pole_pairs))
        return abs(self.omega_m) / (TURN * revolutions)

    @property
    def cells_per_second(self) -> float:
        """Rate of the values that the Q filter averages, Hz: cells of a map, or samples of a delay line."""
        return self.law.cells * self.periods_per_second if self.law.over_angle else 1 / self.plant.period

    @property
    def widest_filter(self) -> int:
        """The largest q_half_width that fits into a period."""
        return int((min(self.law.cells, self.cells_per_second / self.periods_per_second) - 1) / 2)

    def oscillation(self) -> Oscillation | None:
        """The oscillation that grows in the loop with the feedback `at_once`; None if that loop is stable."""
        return oscillation(self.plant, self.at_once)

    def q(self, f: ArrayLike, half_width: int | None = None) -> Real:
        """Gain of forgetting and Q filter at f, Hz; `half_width`, cells or samples, replaces the law's."""
        n = 2 * (self.law.q_half_width if half_width is None else half_width) + 1
        part = np.asarray(f, dtype=float) / self.cells_per_second
        return np.asarray(self.forgetting * np.abs(np.sinc(n * part) / np.sinc(part)))

    def recalled(self, f: ArrayLike, constant: bool) -> Real:
        """The share of the learned signal that is recalled after a period, at frequencies f in Hz."""
        return self.q(f) * self.interpolation_gain(f, constant)

    def factor(self, f: ArrayLike) -> Real:
        """The factor per period on the learned signal, at frequencies f in Hz."""
        return self.q(f) * self.unfiltered(f)

    def unfiltered(self, f: ArrayLike, lead: int | None = None) -> Real:
        """The factor per period for Q = 1; `lead`, in samples, replaces the law's."""
        f, rate, cells = np.asarray(f, dtype=float), 1 / self.plant.period, self.cells_per_second
        if not self.law.over_angle or cells >= rate:
            return np.abs(self.share_kept(f, lead))
        images = min(math.ceil(rate / 2 / cells), IMAGES_MOST)
        image = np.add.outer(np.arange(-images, images + 1) * cells, f)
        sine = np.sin(np.pi * f / cells) / np.pi  # the same for every image, up to its sign
        with np.errstate(divide="ignore", invalid="ignore"):
            sinc = np.where(image == 0, 1.0, sine / (image / cells))
        weight = np.where(np.abs(image) <= rate / 2, sinc**2, 0.0)
        return np.asarray(np.abs((weight * self.share_kept(image, lead)).sum(axis=0) / weight.sum(axis=0)))

    def interpolation_gain(self, f: ArrayLike, constant: bool) -> Real:
        """Gain of the linear interpolation between samples; the images of a coarse map aren't included.

        It is a mean over positions between two samples. A delay line at a constant speed reads at one
        position only, and the gain is the one there.
        """
        f, rate = np.asarray(f, dtype=float), 1 / self.plant.period
        if self.law.over_angle:
            return np.asarray(np.sinc(f / rate) ** 2 * np.sinc(f / max(self.cells_per_second, rate)) ** 2)
        turn = np.exp(-2j * np.pi * f / rate)
        places = [rate / self.periods_per_second % 1] if constant else SAMPLE_PHASES
        mean = sum(np.log(np.abs(1 - part + part * turn) + 1e-30) for part in places) / len(places)
        return np.asarray(np.exp(mean))

    def share_kept(self, f: ArrayLike, lead: int | None = None) -> Complex:
        """kept, the share of the recalled signal that remains after learning, at frequencies f in Hz."""
        lead = self.lead if lead is None else lead
        x = self.x(f, lead)
        return np.asarray(1 - x if lead else 1 / (1 + x))

    def closed(self, f: Real) -> Complex:
        """G S, the closed loop without C, at frequencies f >= 0 in Hz."""
        return _closed_at(self.plant, self.feedback, f.tobytes()).reshape(f.shape)

    def x(self, f: ArrayLike, lead: int | None = None) -> Complex:
        """X exp(jw n T), with the lead of n samples, at frequencies f in Hz."""
        f, lead = np.asarray(f, dtype=float), self.lead if lead is None else lead
        positive = np.abs(f)
        value = self.gain(TURN * positive) * self.closed(positive)
        value = np.where(f >= 0, value, np.conj(value))
        return np.asarray(value * np.exp(2j * np.pi * f * lead * self.plant.period) if lead else value)

    def residual(self, f: ArrayLike) -> Real:
        """The size of `share_left`: an error that isn't periodic with the learning period may double."""
        return np.abs(self.share_left(f))

    def share_left(self, f: ArrayLike) -> Complex:
        """The error after learning at a constant speed has settled, divided by that under feedback alone.

        An error that isn't periodic with the learning period is recalled with a shifted phase.
        """
        q, share = self._turned(f), self.share_kept(f)
        remaining = (1 - q) / (1 - q * share)
        return np.asarray(remaining if self.lead else remaining * share)

    def yet(self, f: ArrayLike, periods: float) -> Real:
        """The size of the error after this many periods of learning, over that under feedback alone.

        The difference to the settled error shrinks by the same factor in each period. In the first period the
        error is that of the feedback alone, or smaller where learning acts within the sample.
        """
        settled, share = self.share_left(f), self.share_kept(f)
        begins = 1.0 if self.lead else share
        return np.abs(settled + (self._turned(f) * share) ** round(periods) * (begins - settled))

    def _turned(self, f: ArrayLike) -> Complex:
        """Complex factor between the learned signal and what the memory recalls of it a period later."""
        f = np.asarray(f, dtype=float)
        turn = np.exp(-2j * np.pi * f / self.periods_per_second)
        return np.asarray(self.q(f) * self.interpolation_gain(f, True) * turn)

    @property
    def highest(self) -> float:
        """The highest frequency that both samples and cells can represent, Hz."""
        return 0.499 * min(self.cells_per_second, 1 / self.plant.period)

    @property
    def orders(self) -> Real | None:
        """The orders, relative to the learning period, that the law learns; None if it learns all."""
        return None

    def settling_leads(self) -> set[int]:
        """The leads, in samples, with which learning would settle."""
        return set()

    @property
    def sure(self) -> bool:
        """Whether the learned signal would certainly grow if this speed were held."""
        return False

    @property
    def frequencies(self) -> Real:
        """Frequencies from that of the learning period up to `highest`, Hz."""
        even = np.linspace(self.periods_per_second, self.highest, LOOP_CURVE_POINTS)
        return _with_near(even, self.plant)

    def worst(self) -> Worst:
        """The largest factor per period over `frequencies`."""
        f = self.frequencies
        factors = self.factor(f)
        k = int(np.argmax(factors))
        return Worst(float(factors[k]), float(f[k]))

    @property
    def settled(self) -> bool:
        """Whether the loop is stable, and no frequency grows from period to period."""
        return self.oscillation() is None and self.worst().factor <= FACTOR_MOST


def _with_near(f: Real, loop: SpeedLoop) -> Real:
    """Frequencies f, Hz, and between their ends those around the resonances of the loop's soft shaft."""
    if loop.near is None:
        return f
    more = loop.near / TURN
    return np.union1d(f, more[(more > f[0]) & (more < f[-1])])


def opened(feedback: Linear, P_omega: Complex, P_theta: Complex) -> Complex:
    """G = ratio (P_omega + k_theta P_theta)."""
    return np.asarray(feedback.ratio * (P_omega + feedback.k_theta * P_theta))


def sensitivity(loop: SpeedLoop, feedback: Linear, w: Real, P_omega: Complex, P_theta: Complex) -> Complex:
    """The sensitivity S at w in rad/s, from both plants at w."""
    C = feedback.response(w, loop.period)
    around = C * opened(feedback, P_omega, P_theta) + feedback.k_v * feedback.ratio * P_theta
    return np.asarray(1 / (1 + around))


@lru_cache(maxsize=16)  # the same for all speeds of one plant and feedback
def _closed(loop: SpeedLoop, feedback: Linear) -> tuple[Real, Complex]:
    """A grid of frequencies, Hz, and G S at these."""
    f, P_omega, P_theta = plants(loop)
    S = sensitivity(loop, feedback, TURN * f, P_omega, P_theta)
    return f, opened(feedback, P_omega, P_theta) * S


@lru_cache(maxsize=128)  # the same for all accelerations at one speed
def _closed_at(loop: SpeedLoop, feedback: Linear, frequencies: bytes) -> Complex:
    """G S, interpolated, at frequencies in Hz, as bytes of an array so that they can be a cache key."""
    return np.interp(np.frombuffer(frequencies), *_closed(loop, feedback))


@lru_cache(maxsize=16)
def plants(loop: SpeedLoop) -> tuple[Real, Complex, Complex]:
    """Frequencies, Hz, and the plants P_omega and P_theta of speed_loop.py at them."""
    f = np.geomspace(FREQUENCY_LEAST, 0.5 / loop.period, PLANT_POINTS)
    f = _with_near(f, loop)
    return f, *loop.plant(TURN * f)


def fewest_samples(law: Memory, lead: int) -> int:
    """Fewest samples in a period with which a law learns.

    A sample, and the lead (samples), are at most a quarter of the period. A delay line's Q filter is within
    the period.
    """
    within_quarter = 4 * max(1, lead)
    return within_quarter if law.over_angle else max(within_quarter, law.q_half_width + 1)


def fastest_over_period(study: Study, memory: Memory, lead: int) -> float:
    """The highest mechanical speed at which a memory over a period learns, rad/s; `lead` in samples."""
    rate, revolutions = study.drive.rates.outer_loop, float(memory.revolutions(study.motor.pole_pairs))
    return TURN * revolutions * rate / fewest_samples(memory, lead)
