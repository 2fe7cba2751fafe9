"""A law that learns from period to period, in its drive at one speed: by which factor each frequency changes.

Small signals at a speed that hardly changes within what the loop remembers. P from current reference to
measured speed and angle (pi.py), C the linear feedback, Gamma the learning gain on the error that it feeds
back, T the period of the samples:

    G = ratio (P_omega + k_theta P_theta),    C = k + k_i T z / (z - 1)
    S = 1 / (1 + C G + k_v ratio P_theta),    X = Gamma G S

    factor |Q kept|,    kept = 1 / (1 + X), or 1 - X exp(jw n T) with a lead of n samples

derived in docs/theory/learning.md and learning-in-angle.md. A map with fewer cells than samples can't tell f
from f + m f_c, f_c cells a second, and brings out all of them, with weights that add up to one:

    factor |Q sum_m sinc^2(f / f_c + m) kept(f + m f_c)|

What straight lines between samples filter besides is left out of the factor, an upper bound; `lines` has its
mean over the places between them.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.closed_loop import Linear, Oscillation, oscillation
from cogless.design.feedback import feedback_of
from cogless.design.margins import Complex, Real
from cogless.design.pi import SpeedLoop, pi_response, speed_loop
from cogless.study import Study
from cogless.study.controller import Learning
from cogless.study.pi_afc import PiAfc
from cogless.study.space_controller import SpaceLearning

SETTLED = 1.0 + 1e-3  # a factor a period that is as good as settling
POINTS = 3000  # of a curve
GRID = 8000  # of a plant
LOWEST = 1e-4  # Hz
IMAGES = 50  # the weights of the others add up to less than a percent
PLACES = (np.arange(32) + 0.5) / 32  # between two samples


@dataclass(frozen=True)
class Worst:
    """The largest factor a period, an upper bound, and where it is."""

    factor: float
    frequency: float  # Hz


@dataclass(frozen=True)
class LearningLoop(ABC):
    """A controller of a study that learns, at a speed and an acceleration."""

    study: Study
    controller: str
    omega_m: float  # rad/s, mechanical
    alpha_m: float = 0.0  # rad/s^2
    torque: float = 1.0  # of the mean torque constant: where K_t ripples, what it is at an angle
    scenario: str | None = None  # whose plant it acts on; None: the one it was told

    @property
    @abstractmethod
    def law(self) -> Learning | SpaceLearning | PiAfc:
        """The controller; TypeError: not one that learns so."""

    @property
    @abstractmethod
    def gamma(self) -> tuple[float, float]:
        """The learning gain, A*s/rad, and that on the integral of the same error, A/rad."""

    @property
    def frozen(self) -> str | None:
        """The reason why nothing is learned at this speed; None where something is."""
        return None

    @property
    def doubt(self) -> str | None:
        """The reason why small signals about this speed may not be all; None where the law gives none."""
        return None

    @property
    def forgetting(self) -> float:
        """The share of the memory that is kept in each period."""
        return 1.0

    @property
    def lead(self) -> int:
        """Samples by which a correction is earlier than the error."""
        return 0

    @property
    def feedback_before(self) -> Linear:
        """The linear feedback before the law learns."""
        found = feedback_of(self.study, self.controller, self.omega_m)
        assert found is not None
        return found

    @cached_property
    def feedback(self) -> Linear:
        """The linear feedback while the law learns, without what learning adds at once."""
        return self.feedback_before

    def gain(self, w: Real) -> Complex:
        """The learning gain at w in rad/s."""
        return pi_response(w, self.plant.period, *self.gamma)

    @property
    def at_once(self) -> Linear:
        """The feedback with what learning adds within the same sample."""
        kp, ki = (0.0, 0.0) if self.lead else self.gamma
        return dataclasses.replace(self.feedback, k=self.feedback.k + kp, k_i=self.feedback.k_i + ki)

    @cached_property
    def plant(self) -> SpeedLoop:
        """The speed loop that the law acts on, at this torque constant."""
        loop = speed_loop(self.study, self.scenario)
        return dataclasses.replace(loop, b=loop.b * self.torque)

    @property
    def periods_per_second(self) -> float:
        """Periods of what is learned, Hz."""
        revolutions = float(self.law.revolutions(self.study.motor.pole_pairs))
        return abs(self.omega_m) / (2 * math.pi * revolutions)

    @property
    def cells_per_second(self) -> float:
        """Rate of what the Q filter counts, Hz: cells of a map, or samples of a delay line."""
        return self.law.cells * self.periods_per_second if self.law.over_angle else 1 / self.plant.period

    @property
    def widest_filter(self) -> int:
        """The largest q_half_width that a period holds."""
        return int((min(self.law.cells, self.cells_per_second / self.periods_per_second) - 1) / 2)

    def oscillation(self) -> Oscillation | None:
        """The oscillation that grows with what learning adds within a sample; None where none does."""
        return oscillation(self.plant, self.at_once)

    def q(self, f: ArrayLike, half_width: int | None = None) -> Real:
        """Forgetting and the Q filter; with another filter of so many cells or samples on each side."""
        n = 2 * (self.law.q_half_width if half_width is None else half_width) + 1
        part = np.asarray(f, dtype=float) / self.cells_per_second
        return np.asarray(self.forgetting * np.abs(np.sinc(n * part) / np.sinc(part)))

    def recalled(self, f: ArrayLike, constant: bool) -> Real:
        """The share of what was learned that comes back after a period, at frequencies f in Hz."""
        return self.q(f) * self.lines(f, constant)

    def factor(self, f: ArrayLike) -> Real:
        """Factor a period of what is learned at frequencies f in Hz."""
        return self.q(f) * self.unfiltered(f)

    def unfiltered(self, f: ArrayLike, lead: int | None = None) -> Real:
        """The factor for Q = 1; with another lead, in samples."""
        f, rate, cells = np.asarray(f, dtype=float), 1 / self.plant.period, self.cells_per_second
        if not self.law.over_angle or cells >= rate:
            return np.abs(self.kept(f, lead))
        images = min(math.ceil(rate / 2 / cells), IMAGES)
        image = np.add.outer(np.arange(-images, images + 1) * cells, f)
        weight = np.where(np.abs(image) <= rate / 2, np.sinc(image / cells) ** 2, 0.0)
        return np.asarray(np.abs((weight * self.kept(image, lead)).sum(axis=0) / weight.sum(axis=0)))

    def lines(self, f: ArrayLike, constant: bool) -> Real:
        """Gain of straight lines between samples, besides the images of a coarse map.

        A mean over places between samples; for a delay line at a constant speed, at its one place.
        """
        f, rate = np.asarray(f, dtype=float), 1 / self.plant.period
        if self.law.over_angle:
            return np.asarray(np.sinc(f / rate) ** 2 * np.sinc(f / max(self.cells_per_second, rate)) ** 2)
        turn = np.exp(-2j * np.pi * f / rate)
        places = [rate / self.periods_per_second % 1] if constant else PLACES
        mean = sum(np.log(np.abs(1 - part + part * turn) + 1e-30) for part in places) / len(places)
        return np.asarray(np.exp(mean))

    def kept(self, f: ArrayLike, lead: int | None = None) -> Complex:
        """The share of what was recalled that the loop leaves, at a sample, at frequencies f in Hz."""
        lead = self.lead if lead is None else lead
        x = self.x(f, lead)
        return np.asarray(1 - x if lead else 1 / (1 + x))

    def closed(self, f: Real) -> Complex:
        """G S at frequencies f in Hz, 0 or more."""
        return _closed_at(self.plant, self.feedback, f.tobytes()).reshape(f.shape)

    def x(self, f: ArrayLike, lead: int | None = None) -> Complex:
        """X, with the lead, at frequencies f in Hz."""
        f, lead = np.asarray(f, dtype=float), self.lead if lead is None else lead
        positive = np.abs(f)
        value = self.gain(2 * math.pi * positive) * self.closed(positive)
        value = np.where(f >= 0, value, np.conj(value))
        return np.asarray(value * np.exp(2j * np.pi * f * lead * self.plant.period) if lead else value)

    def residual(self, f: ArrayLike, constant: bool = True) -> Real:
        """Share of the error under feedback alone that stays once learning has settled.

        What isn't of the period comes back shifted, and learning may double it.
        """
        f = np.asarray(f, dtype=float)
        q = self.q(f) * self.lines(f, constant) * np.exp(-2j * np.pi * f / self.periods_per_second)
        kept = self.kept(f)
        left = (1 - q) / (1 - q * kept)
        return np.abs(left if self.lead else left * kept)

    @property
    def highest(self) -> float:
        """The highest frequency that samples and cells hold, Hz."""
        return 0.499 * min(self.cells_per_second, 1 / self.plant.period)

    @property
    def orders(self) -> Real | None:
        """The orders of the period that it learns; None of a law that learns all."""
        return None

    def settling_leads(self) -> set[int]:
        """The leads, in samples, with which it would settle."""
        return set()

    @property
    def sure(self) -> bool:
        """Whether what is learned grows for certain at this speed, were it constant."""
        return False

    @property
    def frequencies(self) -> Real:
        """Frequencies from the period's own up to the highest, Hz."""
        return np.linspace(self.periods_per_second, self.highest, POINTS)

    def worst(self) -> Worst:
        """The largest factor."""
        f = self.frequencies
        factors = self.factor(f)
        k = int(np.argmax(factors))
        return Worst(float(factors[k]), float(f[k]))


def opened(feedback: Linear, P_omega: Complex, P_theta: Complex) -> Complex:
    """G."""
    return np.asarray(feedback.ratio * (P_omega + feedback.k_theta * P_theta))


def sensitivity(loop: SpeedLoop, feedback: Linear, w: Real, P_omega: Complex, P_theta: Complex) -> Complex:
    """S; both plants at w in rad/s."""
    C = pi_response(w, loop.period, feedback.k, feedback.k_i)
    around = C * opened(feedback, P_omega, P_theta) + feedback.k_v * feedback.ratio * P_theta
    return np.asarray(1 / (1 + around))


@lru_cache(maxsize=16)  # of one plant and feedback at all speeds
def _closed(loop: SpeedLoop, feedback: Linear) -> tuple[Real, Complex]:
    """Frequencies, Hz, and G S there."""
    f, P_omega, P_theta = plants(loop)
    S = sensitivity(loop, feedback, 2 * math.pi * f, P_omega, P_theta)
    return f, opened(feedback, P_omega, P_theta) * S


@lru_cache(maxsize=128)  # of one speed, at all accelerations
def _closed_at(loop: SpeedLoop, feedback: Linear, frequencies: bytes) -> Complex:
    """G S between the frequencies of the curve, at some that fill a buffer of doubles, Hz."""
    return np.interp(np.frombuffer(frequencies), *_closed(loop, feedback))


@lru_cache(maxsize=16)
def plants(loop: SpeedLoop) -> tuple[Real, Complex, Complex]:
    """Frequencies, Hz, and both plants of pi.py there."""
    f = np.geomspace(LOWEST, 0.5 / loop.period, GRID)
    return f, *loop.plant(2 * math.pi * f)
