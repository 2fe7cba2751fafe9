"""Whether learning in angle stays stable: by which factor each frequency shrinks or grows in a period.

The theorems of Verrelli 2016 hold for continuous time without a current loop. Sampled, at a constant speed
omega of the frame, small signals: i_hat_k = Q i_hat_{k-1} - mu omega_t, with omega_t what the law feeds back.
From i_hat to it

    S = G / (1 + C G + k_v ratio P_theta),  G = ratio (P_omega + k_theta P_theta),
    C = k_omega + v + share_i k_i T z / (z - 1)

with the exact plants P of pi.py, and the learning gains of (6), at constant speed, are one:

    mu = mu_alpha / |omega| + mu_beta |omega|          factor |Q / (1 + mu S)|

Law (4) is the same with G = P_omega, C = k. The factor is above one where S has turned by more than a
quarter: where current loop, sampling and delay have the word, some hundred Hz. Without Q nothing keeps it
below one there. Q is the mean over 2 n + 1 cells or samples.

A map with fewer cells than samples can't tell f from f + m f_c, f_c cells a second: its straight lines
between cells bring out all of them, with weights sinc^2(f / f_c + m) that add up to one, and each comes back:

    factor |Q sum_m sinc^2(f / f_c + m) / (1 + mu S(f + m f_c))|

What interpolation between samples filters besides is left out: an upper bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.learning import POINTS, SETTLED, Worst
from cogless.design.margins import Complex, Real
from cogless.design.pi import margins, speed_loop
from cogless.design.position import frame_ratio, position_gains, position_margins
from cogless.study import Study
from cogless.study.space_controller import SpaceLearning, SpacePosition, SpaceSpeed

IMAGES = 50  # the weights of the others add up to less than a percent
WIDEST = 400  # cells or samples on each side that are tried


@dataclass(frozen=True)
class SpaceLoop:
    """A controller of a study that learns in angle, at a constant speed."""

    study: Study
    controller: str
    omega_m: float  # rad/s, mechanical

    @property
    def law(self) -> SpacePosition | SpaceSpeed:
        """The controller; it has to be one that learns in angle."""
        law = self.study.controller[self.controller]
        if not isinstance(law, SpacePosition | SpaceSpeed):
            raise TypeError(f"controller {self.controller}: expected one that learns in angle")
        return law

    @property
    def mu(self) -> float:
        """The learning gain at this speed, A*s/rad of what is fed back."""
        omega = abs(frame_ratio(self.study, self.law) * self.omega_m)
        return self.law.mu_alpha / omega + self.law.mu_beta * omega

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

    def sensitivity(self, w: Real) -> Complex:
        """S, see above, at w in rad/s."""
        loop, law = speed_loop(self.study), self.law
        P_omega = loop.plant(w)
        if isinstance(law, SpaceSpeed):
            return np.asarray(P_omega / (1 + law.k * P_omega))
        ratio = frame_ratio(self.study, law)
        P_theta = loop.angle(w)
        k_theta, k_omega, k_i = position_gains(self.study, self.controller)
        z = np.exp(1j * w * loop.period)
        integral = 0.0 if law.hand_over else k_i * loop.period * z / (z - 1)
        C = k_omega + law.v_0 + law.v_2 * (ratio * self.omega_m) ** 2 + integral
        G = ratio * (P_omega + k_theta * P_theta)
        return np.asarray(G / (1 + C * G + law.k_v * ratio * P_theta))

    def q(self, f: ArrayLike, half_width: int) -> Real:
        """The Q filter of so many cells or samples on each side."""
        n = 2 * half_width + 1
        half = np.pi * np.asarray(f, dtype=float) / self.cells_per_second
        return np.asarray(np.abs(np.sinc(n * half / np.pi) / np.sinc(half / np.pi)))

    def factor(self, f: ArrayLike, half_width: int | None = None) -> Real:
        """Of what is learned, from period to period, at frequencies f in Hz; with the law's own Q filter."""
        width = self.law.q_half_width if half_width is None else half_width
        return self.q(f, width) * self._without_filter(f)

    def _without_filter(self, f: ArrayLike) -> Real:
        """The factor for Q = 1."""
        f, rate, cells = np.asarray(f, dtype=float), self.study.drive.rates.speed_loop, self.cells_per_second
        if self.law.memory == "delay" or cells >= rate:
            return np.abs(self._kept(f))
        grid = np.geomspace(min(0.1 * cells, float(np.min(f))), rate / 2, POINTS)
        kept = self._kept(grid)
        total, weights = np.zeros(f.shape, dtype=complex), np.zeros(f.shape)
        images = min(math.ceil(rate / 2 / cells), IMAGES)
        for m in range(-images, images + 1):
            image = f + m * cells
            weight = np.where(np.abs(image) <= rate / 2, np.sinc(image / cells) ** 2, 0.0)
            value = np.interp(np.abs(image), grid, kept)
            total += weight * np.where(image > 0, value, np.conj(value))
            weights += weight
        return np.abs(total / weights)

    def _kept(self, f: Real) -> Complex:
        """Of what was recalled, at a sample."""
        return np.asarray(1 / (1 + self.mu * self.sensitivity(2 * math.pi * f)))

    @property
    def frequencies(self) -> Real:
        """From the period's own frequency up to what samples and cells hold, Hz."""
        highest = min(self.cells_per_second, self.study.drive.rates.speed_loop)
        return np.linspace(self.periods_per_second, 0.499 * highest, POINTS)

    def worst(self) -> Worst:
        """The largest factor."""
        f = self.frequencies
        factors = self.factor(f)
        k = int(np.argmax(factors))
        return Worst(float(factors[k]), float(f[k]))

    def repairs(self) -> int | None:
        """The fewest cells or samples on each side with which it would settle; None where none does."""
        f = self.frequencies
        without = self._without_filter(f)
        widest = min(WIDEST, (self.law.cells - 1) // 2)
        return next((n for n in range(widest + 1) if np.max(self.q(f, n) * without) <= SETTLED), None)


def space_learning(study: Study, name: str) -> Worst | None:
    """The worst factor over the speeds that a controller learns at; None where it learns at none."""
    return max((at.worst() for at in _at_speeds(study, name)), key=lambda w: w.factor, default=None)


def repairing_filter(study: Study, name: str) -> int | None:
    """q_half_width with which a controller settles at all the speeds that it learns at; None for none."""
    widths = [at.repairs() for at in _at_speeds(study, name)]
    found = [width for width in widths if width is not None]
    return max(found) if found and len(found) == len(widths) else None


def space_stable(study: Study, name: str) -> bool:
    """Whether a controller's feedback is stable with what learning adds to it at once, at all its speeds."""
    loop = speed_loop(study)
    for at in _at_speeds(study, name):
        law = at.law
        if isinstance(law, SpaceSpeed):
            found = margins(loop, law.k + at.mu, 0.0)
        else:
            k_theta, k_omega, k_i = position_gains(study, name)
            gains = (k_theta, k_omega + at.mu, 0.0 if law.hand_over else k_i)
            found = position_margins(loop, frame_ratio(study, law), gains)
        if not found.stable:
            return False
    return True


def warning(study: Study, name: str) -> str | None:
    """What a user should know before a run: that learning grows, at which frequency, what repairs it."""
    worst = space_learning(study, name)
    if worst is None or worst.factor <= SETTLED:
        return None
    line = f"learning grows {worst.factor:.3g}x a period at {worst.frequency:.0f} Hz"
    width = repairing_filter(study, name)
    return line + (f"; q_half_width = {width} repairs it" if width is not None else "; lower its gains")


def _at_speeds(study: Study, name: str) -> list[SpaceLoop]:
    """A controller at the slowest and the fastest speed of its scenarios; nowhere if it doesn't learn."""
    law = study.controller[name]
    if not isinstance(law, SpaceLearning) or not law.learning:
        return []
    scenarios = [s for key, s in study.scenario.items() if name in study.controllers_in(key)]
    speeds = {
        speed
        for scenario in scenarios
        for speed in (max(scenario.reference.slowest, law.omega_min), scenario.reference.top_speed)
        if speed >= law.omega_min
    }
    return [SpaceLoop(study, name, speed) for speed in sorted(speeds)]
