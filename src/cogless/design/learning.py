"""Whether learning settles: by which factor each frequency shrinks or grows from one period to the next.

At constant speed, small signals, in the frequency domain (docs/theory/learning.md derives it): P from current
reference to measured speed, S = 1 / (1 + P C) with the linear feedback C, Gamma the learning gain, Q
forgetting and Q filter, a lead of n samples of period T.

    X = Gamma S P
    without lead, u_k = Q u_{k-1} + Gamma e_k:                          factor |Q / (1 + X)|
    with lead, the error of n samples later corrects what acts next:    factor |Q (1 - X exp(jw n T))|

Below one at every frequency, learning settles, given that the feedback is stable (without a lead: with Gamma
added to it); what it leaves of the feedback's error is `residual`. Where the memory refuses to learn at a
speed (control/src/cogless/memory.c), `frozen` says why.
Friction and the switching terms of robust ILC are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cogless import units
from cogless.design.pi import gains, margins, speed_loop
from cogless.study import Study
from cogless.study.controller import PiIlc, RobustIlc

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
POINTS = 20000
SETTLED = 1.0 + 1e-3  # a factor a period that is as good as settling
LONGEST_LEAD = 30  # samples that are tried


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

    @property
    def feedback(self) -> tuple[float, float]:
        """kp and ki of C."""
        if isinstance(self.law, PiIlc):
            return gains(self.study, self.controller)
        return linear_part(self.law)

    @property
    def gamma(self) -> tuple[float, float]:
        """The learning gain as a PI's kp and ki: f of robust ILC learns on S = e + c integral(e)."""
        if isinstance(self.law, PiIlc):
            return self.law.gain, 0.0
        gain = self.law.q * self.law.beta_2 / self.law.b
        return gain, gain * self.law.c

    @property
    def stable(self) -> bool:
        """Whether the feedback is, with what learning adds to it at once."""
        kp, ki = self.feedback
        at_once = (0.0, 0.0) if self.lead else self.gamma
        return margins(speed_loop(self.study), kp + at_once[0], ki + at_once[1]).stable

    @property
    def frozen(self) -> str | None:
        """Why nothing is learnt at this speed; None where it is."""
        samples = self.study.drive.rates.speed_loop / self.periods_per_second  # in a period
        cells, wide = self.law.cells, self.law.q_half_width
        found = f"a period at {_rpm(self.omega_m)} has {round(samples, 1):.10g} samples, "
        if self.law.memory == "time":
            if samples > cells:
                return f"{found}cells {cells}"
            return f"{found}the Q filter needs {wide + 1}" if samples < wide + 1 else None
        if samples < 4:
            return f"{found}at least 4 are needed"
        return f"{found}lead {self.lead} is over a quarter" if self.lead > samples / 4 else None

    def x(self, f: ArrayLike) -> Complex:
        """X, with the lead, at frequencies f in Hz."""
        w = 2 * math.pi * np.asarray(f, dtype=float)
        loop = speed_loop(self.study)
        P = loop.plant(w)

        def pi(kp: float, ki: float) -> Complex:
            z = np.exp(1j * w * loop.period)
            return np.asarray(kp + ki * loop.period * z / (z - 1))

        return np.asarray(
            pi(*self.gamma) * P / (1 + pi(*self.feedback) * P) * np.exp(1j * w * self.lead * loop.period)
        )

    def q(self, f: ArrayLike) -> Real:
        """Forgetting and Q filter."""
        cells = self._rates[1]
        n = 2 * self.law.q_half_width + 1
        half = np.pi * np.asarray(f, dtype=float) / cells
        return np.asarray(self.law.forgetting * np.sin(n * half) / (n * np.sin(half)))

    def interpolation(self, f: ArrayLike) -> Real:
        """What the straight lines in the memory filter; by angle the mean over places between cells."""
        f = np.asarray(f, dtype=float)
        rate, cells = self._rates
        if self.law.memory == "angle":
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

    @property
    def _rates(self) -> tuple[float, float]:
        """Of samples and of cells, a second."""
        rate = self.study.drive.rates.speed_loop
        return rate, self.law.cells * self.periods_per_second if self.law.memory == "angle" else rate

    @property
    def frequencies(self) -> Real:
        """From the period's own frequency up to what samples and cells hold, Hz."""
        return np.linspace(self.periods_per_second, 0.499 * min(self._rates), POINTS)

    def worst(self) -> Worst:
        """The largest factor."""
        f = self.frequencies
        factors = self.factor(f)
        k = int(np.argmax(factors))
        return Worst(float(factors[k]), float(f[k]))

    def settling_leads(self) -> set[int]:
        """The leads, in samples, with which it would settle."""
        f, rate = self.frequencies, self.study.drive.rates.speed_loop
        turn = np.exp(2j * np.pi * f / rate)
        without, q = self.x(f) * turn**-self.lead, self.q(f)
        longest = int(min(rate / self.periods_per_second, self.law.cells) / 4)
        leads = range(1, min(longest, LONGEST_LEAD) + 1)
        return {n for n in leads if np.max(np.abs(q * (1 - without * turn**n))) <= SETTLED}


def learning(study: Study, name: str) -> Worst | None:
    """The worst factor of a controller over its scenarios' speeds; None where it learns at none of them."""
    worst = (at.worst() for at in _at_speeds(study, name) if at.frozen is None)
    return max(worst, key=lambda w: w.factor, default=None)


def settling_lead(study: Study, name: str) -> float | None:
    """The shortest lead with which a controller settles at all its scenarios' speeds, s; None for none."""
    learns = [at for at in _at_speeds(study, name) if at.frozen is None]
    common = set.intersection(*(at.settling_leads() for at in learns)) if learns else set()
    return min(common) / study.drive.rates.speed_loop if common else None


def frozen(study: Study, name: str) -> tuple[str, ...]:
    """Why a controller doesn't learn, at each of its scenarios' speeds where it doesn't."""
    return tuple(at.frozen for at in _at_speeds(study, name) if at.frozen is not None)


def stable(study: Study, name: str) -> bool:
    """Whether a learning controller's feedback is stable, with what learning adds to it at once."""
    return Learning(study, name, 0.0).stable


def linear_part(law: RobustIlc) -> tuple[float, float]:
    """kp and ki of robust ILC: (c e + eta S) / b with S = e + c integral(e)."""
    return (law.c + law.eta) / law.b, law.c * law.eta / law.b


def _at_speeds(study: Study, name: str) -> list[Learning]:
    """A controller at the top speeds of its scenarios; nowhere if it doesn't learn."""
    if not isinstance(study.controller[name], PiIlc | RobustIlc):
        return []
    scenarios = [s for key, s in study.scenario.items() if name in study.controllers_in(key)]
    tops = {scenario.top_speed for scenario in scenarios if scenario.top_speed > 0}
    return [Learning(study, name, speed) for speed in sorted(tops)]


def _rpm(omega_m: float) -> str:
    return units.format(abs(omega_m), "rpm", units.ANGULAR_SPEED, digits=4)
