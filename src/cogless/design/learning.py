"""Whether learning settles: by which factor each frequency shrinks or grows from one period to the next.

At constant speed, small signals, in the frequency domain (docs/theory/learning.md derives it): P from current
reference to measured speed, S = 1 / (1 + P C) with the linear feedback C, Gamma the learning gain, Q
forgetting and Q filter, a lead of n samples of period T.

    X = Gamma S P
    without lead, u_k = Q u_{k-1} + Gamma e_k:                          factor |Q / (1 + X)|
    with lead, the error of n samples later corrects what acts next:    factor |Q (1 - X exp(jw n T))|

Below one at every frequency, learning settles; what it leaves of the feedback's error is `residual`.
Friction and the switching terms of robust ILC are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cogless.design.pi import SpeedLoop, gains, speed_loop
from cogless.study import Study
from cogless.study.controller import PiIlc, RobustIlc

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
POINTS = 20000


@dataclass(frozen=True)
class Worst:
    """The largest factor a period, an upper bound, and where it is."""

    factor: float
    frequency: float  # Hz


@dataclass(frozen=True)
class Learning:
    """A learning controller of a study at a constant speed."""

    study: Study
    controller: str
    omega_m: float  # rad/s, mechanical

    @property
    def law(self) -> PiIlc | RobustIlc:
        """The controller; it has to be one that learns."""
        law = self.study.controller[self.controller]
        if not isinstance(law, PiIlc | RobustIlc):
            raise TypeError(f"controller {self.controller}: expected one that learns")
        return law

    @property
    def periods_per_second(self) -> float:
        """Of the memory, Hz."""
        per_turn = self.study.motor.pole_pairs if self.law.period == "electrical" else 1
        return abs(self.omega_m) / (2 * math.pi) * per_turn

    @property
    def lead(self) -> int:
        """Samples."""
        return round(self.law.lead * self.study.drive.rates.speed_loop)

    def x(self, f: ArrayLike) -> Complex:
        """X, with the lead, at frequencies f in Hz."""
        w = 2 * math.pi * np.asarray(f, dtype=float)
        loop = speed_loop(self.study)
        if isinstance(self.law, PiIlc):
            kp, ki = gains(self.study, self.controller)
            gamma: float | Complex = self.law.gain
        else:  # f learns on S = e + c integral(e)
            kp = (self.law.c + self.law.eta) / self.law.b
            ki = self.law.c * self.law.eta / self.law.b
            gamma = self.law.q * self.law.beta_2 / self.law.b * (1 + self.law.c * _integral(loop, w))
        answer = loop.response(w, 1.0, 0.0) / (1 + loop.response(w, kp, ki))
        return np.asarray(gamma * answer * np.exp(1j * w * self.lead * loop.period))

    def q(self, f: ArrayLike) -> Real:
        """Forgetting and Q filter."""
        rate = self.study.drive.rates.speed_loop
        cells = self.law.cells * self.periods_per_second if self.law.memory == "angle" else rate  # a second
        n = 2 * self.law.q_half_width + 1
        half = np.pi * np.asarray(f, dtype=float) / cells
        return np.asarray(self.law.forgetting * np.sin(n * half) / (n * np.sin(half)))

    def interpolation(self, f: ArrayLike) -> Real:
        """What the straight lines in the memory filter; by angle the mean over places between cells."""
        f = np.asarray(f, dtype=float)
        rate = self.study.drive.rates.speed_loop
        if self.law.memory == "angle":
            cells = self.law.cells * self.periods_per_second
            return np.asarray((np.sinc(f / rate) * np.sinc(f / cells)) ** 2)
        part = rate / self.periods_per_second % 1
        return np.abs(1 - part + part * np.exp(-2j * np.pi * f / rate))

    def factor(self, f: ArrayLike) -> Real:
        """Of what is learnt, from period to period; an upper bound, without what interpolation filters."""
        x, q = self.x(f), self.q(f)
        return np.abs(q * (1 - x)) if self.lead else np.abs(q / (1 + x))

    def residual(self, f: ArrayLike) -> Real:
        """What stays of the error that the feedback alone leaves."""
        x, q = self.x(f), self.q(f) * self.interpolation(f)
        return np.abs((1 - q) / (1 - q + (q * x if self.lead else x)))

    def worst(self) -> Worst:
        """The largest factor between the period's own frequency and half the speed loop's rate."""
        f = np.linspace(self.periods_per_second, 0.499 * self.study.drive.rates.speed_loop, POINTS)
        factors = self.factor(f)
        k = int(np.argmax(factors))
        return Worst(float(factors[k]), float(f[k]))


def learning(study: Study, name: str) -> Worst | None:
    """The worst factor of a controller over the speeds of its scenarios; None where it doesn't learn."""
    if not isinstance(study.controller[name], PiIlc | RobustIlc):
        return None
    speeds = {
        scenario.top_speed
        for key, scenario in study.scenario.items()
        if name in study.controllers_in(key) and scenario.top_speed > 0
    }
    return max(
        (Learning(study, name, speed).worst() for speed in speeds), key=lambda w: w.factor, default=None
    )


def _integral(loop: SpeedLoop, w: Real) -> Complex:
    z = np.exp(1j * w * loop.period)
    return np.asarray(loop.period * z / (z - 1))
