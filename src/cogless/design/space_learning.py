"""Learning in angle at one speed: by which factor each frequency shrinks or grows in a period.

The theorems of Verrelli 2016 hold for continuous time without a current loop. Sampled, at a speed omega and
an acceleration a of the frame that hardly change within what the loop remembers, small signals: i_hat_k = Q
i_hat_{k-1} - mu omega_t, with omega_t what the law feeds back. From i_hat to it

    S = G / (1 + C G + k_v ratio P_theta),  G = ratio (P_omega + k_theta P_theta),
    C = k_omega + v + share_i k_i T z / (z - 1)

with the exact plants P of pi.py, and the learning gains of (6), whose functions see 1, omega and a, are one:

    mu = mu_alpha / |omega| + mu_beta |omega| + mu_h a^2 / |omega|          factor |Q / (1 + mu S)|

Law (4) is the same with G = P_omega, C = k. The factor is above one where S has turned by more than a
quarter: where current loop, sampling and delay have the word, some hundred Hz. Without Q nothing keeps it
below one there. Q is the mean over 2 n + 1 cells or samples. It means something only while 1 + mu S, the
feedback with what learning adds to it at once, is stable itself.

A map with fewer cells than samples can't tell f from f + m f_c, f_c cells a second: its straight lines
between cells bring out all of them, with weights sinc^2(f / f_c + m) that add up to one, and each comes back:

    factor |Q sum_m sinc^2(f / f_c + m) / (1 + mu S(f + m f_c))|

What straight lines between samples filter besides, of a delay line or of a map finer than samples, is left
out of the factor, an upper bound; `lines` has its mean over the places between them.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.closed_loop import Linear, Oscillation, oscillation
from cogless.design.learning import Worst
from cogless.design.margins import Complex, Real
from cogless.design.pi import SpeedLoop, speed_loop
from cogless.design.position import feedback_at, frame_ratio
from cogless.study import Study
from cogless.study.space_controller import SpacePosition, SpaceSpeed

POINTS = 3000  # of a curve
GRID = 8000  # of a plant
LOWEST = 1e-4  # Hz
IMAGES = 50  # the weights of the others add up to less than a percent
PLACES = (np.arange(32) + 0.5) / 32  # between two samples


@dataclass(frozen=True)
class SpaceLoop:
    """A controller of a study that learns in angle, at a speed and an acceleration."""

    study: Study
    controller: str
    omega_m: float  # rad/s, mechanical
    alpha_m: float = 0.0  # rad/s^2
    torque: float = 1.0  # of the mean torque constant: where K_t ripples, what it is at an angle

    @property
    def law(self) -> SpacePosition | SpaceSpeed:
        """The controller; it has to be one that learns in angle."""
        law = self.study.controller[self.controller]
        if not isinstance(law, SpacePosition | SpaceSpeed):
            raise TypeError(f"controller {self.controller}: expected one that learns in angle")
        return law

    @property
    def mu(self) -> float:
        """The learning gain here, A*s/rad of what is fed back."""
        ratio = frame_ratio(self.study, self.law)
        omega, a = abs(ratio * self.omega_m), ratio * self.alpha_m
        return (self.law.mu_alpha + self.law.mu_beta * omega**2 + self.law.mu_h * a**2) / omega

    @property
    def periods_per_second(self) -> float:
        """Of what is learned, Hz."""
        revolutions = float(self.law.period.revolutions(self.study.motor.pole_pairs))
        return abs(self.omega_m) / (2 * math.pi * revolutions)

    @property
    def cells_per_second(self) -> float:
        """What the Q filter counts, Hz: cells of the map, or samples of the delay line."""
        if self.law.memory == "map":
            return self.law.cells * self.periods_per_second
        return self.study.drive.rates.speed_loop

    @cached_property
    def feedback(self) -> Linear:
        """What stands while the law learns: without the integral that it has handed over."""
        law = self.law
        if isinstance(law, SpaceSpeed):
            return Linear(1, law.k)
        before = feedback_at(self.study, self.controller, self.omega_m)
        return dataclasses.replace(before, k_i=0.0) if law.hand_over else before

    @cached_property
    def plant(self) -> SpeedLoop:
        """What the law acts on, at this torque constant."""
        loop = speed_loop(self.study)
        return dataclasses.replace(loop, b=loop.b * self.torque)

    def sensitivity(self, w: Real) -> Complex:
        """S, see above, at w in rad/s."""
        loop = self.plant
        return _sensitivity(self.feedback, loop.period, w, loop.plant(w), loop.angle(w))

    def oscillation(self) -> Oscillation | None:
        """What grows within the samples, with what learning adds at once: of 1 + mu S; None where nothing."""
        with_mu = dataclasses.replace(self.feedback, k=self.feedback.k + self.mu)
        return oscillation(self.plant, with_mu)

    def q(self, f: ArrayLike, half_width: int) -> Real:
        """The Q filter of so many cells or samples on each side."""
        n = 2 * half_width + 1
        half = np.pi * np.asarray(f, dtype=float) / self.cells_per_second
        return np.asarray(np.abs(np.sinc(n * half / np.pi) / np.sinc(half / np.pi)))

    def factor(self, f: ArrayLike, half_width: int | None = None) -> Real:
        """Of what is learned, from period to period, at frequencies f in Hz; with the law's own Q filter."""
        width = self.law.q_half_width if half_width is None else half_width
        return self.q(f, width) * self.unfiltered(f)

    def unfiltered(self, f: ArrayLike) -> Real:
        """The factor for Q = 1."""
        f, rate, cells = np.asarray(f, dtype=float), self.study.drive.rates.speed_loop, self.cells_per_second
        if self.law.memory == "delay" or cells >= rate:
            return np.abs(self._kept(f))
        total, weights = np.zeros(f.shape, dtype=complex), np.zeros(f.shape)
        images = min(math.ceil(rate / 2 / cells), IMAGES)
        for m in range(-images, images + 1):
            image = f + m * cells
            weight = np.where(np.abs(image) <= rate / 2, np.sinc(image / cells) ** 2, 0.0)
            total += weight * self._kept(image)
            weights += weight
        return np.abs(total / weights)

    def lines(self, f: ArrayLike, constant: bool) -> Real:
        """What straight lines between samples filter, besides the images of a coarse map.

        In the mean over places between samples, of a delay line at a constant speed at its one place.
        """
        f, rate = np.asarray(f, dtype=float), self.study.drive.rates.speed_loop
        if self.law.memory == "map":
            return np.asarray(np.sinc(f / rate) ** 2 * np.sinc(f / max(self.cells_per_second, rate)) ** 2)
        turn = np.exp(-2j * np.pi * f / rate)
        places = [rate / self.periods_per_second % 1] if constant else PLACES
        mean = sum(np.log(np.abs(1 - part + part * turn) + 1e-30) for part in places) / len(places)
        return np.asarray(np.exp(mean))

    def _kept(self, f: Real) -> Complex:
        """Of what was recalled, at a sample."""
        grid, kept = self._on_grid
        value = np.interp(np.abs(f), grid, kept)
        return np.where(f >= 0, value, np.conj(value))

    @cached_property
    def _on_grid(self) -> tuple[Real, Complex]:
        grid, S = _sensitivity_on_grid(self.plant, self.feedback)
        return grid, 1 / (1 + self.mu * S)

    @property
    def highest(self) -> float:
        """What samples and cells hold, Hz."""
        return 0.499 * min(self.cells_per_second, self.study.drive.rates.speed_loop)

    @property
    def frequencies(self) -> Real:
        """From the period's own frequency up to the highest, Hz."""
        return np.linspace(self.periods_per_second, self.highest, POINTS)

    def worst(self) -> Worst:
        """The largest factor."""
        f = self.frequencies
        factors = self.factor(f)
        k = int(np.argmax(factors))
        return Worst(float(factors[k]), float(f[k]))


def _sensitivity(feedback: Linear, T: float, w: Real, P_omega: Complex, P_theta: Complex) -> Complex:
    z = np.exp(1j * w * T)
    G = feedback.ratio * (P_omega + feedback.k_theta * P_theta)
    C = feedback.k + (feedback.k_i * T * z / (z - 1) if feedback.k_i else 0.0)
    return np.asarray(G / (1 + C * G + feedback.k_v * feedback.ratio * P_theta))


@lru_cache(maxsize=16)
def _sensitivity_on_grid(loop: SpeedLoop, feedback: Linear) -> tuple[Real, Complex]:
    """Frequencies, Hz, and S there: the same at all speeds where the feedback is."""
    f, P_omega, P_theta = _plants(loop)
    return f, _sensitivity(feedback, loop.period, 2 * math.pi * f, P_omega, P_theta)


@lru_cache(maxsize=16)
def _plants(loop: SpeedLoop) -> tuple[Real, Complex, Complex]:
    """Frequencies, Hz, and both plants of pi.py there."""
    f = np.geomspace(LOWEST, 0.5 / loop.period, GRID)
    return f, loop.plant(2 * math.pi * f), loop.angle(2 * math.pi * f)
