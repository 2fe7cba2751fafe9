"""PI with adaptive feedforward cancellation at one speed: a resonator at each order (docs/laws/pi-afc.md).

This law learns without delay: nothing is recalled from an earlier period. So the poles of the sampled loop
with its resonators show, for any gain, whether learning settles and by which factor per revolution. For a
small gain the equations can be averaged over an order's period. The coefficients then change per revolution
by the factor

    exp(-gain / 2 Re{G S exp(j w lead)} revolution)

Along a reference of varying speed, the factors of each order multiply.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.closed_loop import Oscillation, Resonator, poles
from cogless.design.laws.periodic import LONGEST_LEAD
from cogless.design.learning_loop import FACTOR_MOST, LearningLoop, Worst
from cogless.design.margins import Complex, Real
from cogless.study.base import speed_text
from cogless.study.laws.pi_afc import PiAfc
from cogless.units import TURN

FIXED = 1e-6  # tolerance of the fixed pole at z = 1: the angle, which has no feedback


class OrderLoop(LearningLoop):
    """PI with adaptive feedforward cancellation at a constant speed."""

    @property
    def law(self) -> PiAfc:
        law = self.study.controller[self.controller]
        if not isinstance(law, PiAfc):
            raise TypeError(f"controller {self.controller}: expected pi-afc")
        return law

    @property
    def gamma(self) -> tuple[float, float]:
        return 0.0, 0.0  # resonators have no such constant gains: see gain()

    @property
    def frozen(self) -> str | None:
        if abs(self.omega_m) < self.law.omega_min:
            return f"{speed_text(self.study, self.omega_m)} is below omega_min"
        if len(self.orders):
            return None
        lowest = f"order {self.law.orders[0]} has less than two samples"
        return f"{lowest} at {speed_text(self.study, self.omega_m)}"

    @property
    def orders(self) -> Real:
        """The orders with more than two samples per cycle at this speed: only these are learned."""
        orders = np.array(self.law.orders, dtype=float)
        return orders[orders * abs(self.omega_m) * self.plant.period < math.pi]

    @property
    def frequencies(self) -> Real:
        return self.orders * self.periods_per_second

    @property
    def cells_per_second(self) -> float:
        return 1 / self.plant.period  # there are no cells

    def gain(self, w: Real) -> Complex:
        resonators = self._resonators(self.law.lead)
        return np.asarray(sum(each.response(w, self.plant.period) for each in resonators))

    def q(self, f: ArrayLike, half_width: int | None = None) -> Real:
        return np.zeros(np.shape(f))  # nothing is recalled from the last period

    def recalled(self, f: ArrayLike, constant: bool) -> Real:
        return np.ones(np.shape(f))

    def unfiltered(self, f: ArrayLike, lead: int | None = None) -> Real:
        """The averaged factor per revolution; 1 for an order too fast to be learned.

        `lead`, in samples, replaces the law's.
        """
        f = np.asarray(f, dtype=float)
        time = self.law.lead if lead is None else lead * self.plant.period
        seen = (self.closed(f) * np.exp(2j * np.pi * f * time)).real
        power = -self.law.gain / 2 * seen / self.periods_per_second
        return np.asarray(np.exp(np.where(2 * f * self.plant.period < 1, power, 0.0)))

    def yet(self, f: ArrayLike, periods: float) -> Real:
        """Of its own orders as far as they are learned, by the averaged factor; of others as it stays."""
        f, settled = np.asarray(f, dtype=float), self.residual(f)
        order = f / self.periods_per_second
        own = np.any(np.isclose(order[..., None], self.orders), axis=-1)
        return np.asarray(settled + np.where(own, self.unfiltered(f) ** periods * (1 - settled), 0.0))

    def oscillation(self) -> Oscillation | None:
        """The oscillation that grows only because the gain is too large; None if there is none."""
        if self._worst.factor <= FACTOR_MOST or np.any(self.unfiltered(self.frequencies) > 1):
            return None
        return Oscillation(self._worst.frequency, math.log(self._worst.factor) * self.periods_per_second)

    def worst(self) -> Worst:
        return self._worst

    @cached_property
    def _worst(self) -> Worst:
        return self._worst_with(self.law.lead)

    @property
    def sure(self) -> bool:
        return self._worst.factor > FACTOR_MOST

    def settling_leads(self) -> set[int]:
        averaged = (n for n in range(LONGEST_LEAD + 1) if np.all(self.unfiltered(self.frequencies, n) < 1))
        return {n for n in averaged if self._worst_with(n * self.plant.period).factor <= FACTOR_MOST}

    def _resonators(self, lead: float) -> list[Resonator]:
        return [Resonator(self.law.gain, h * abs(self.omega_m), lead) for h in self.orders.tolist()]

    def _worst_with(self, lead: float) -> Worst:
        """Factor per revolution and frequency of the largest pole, other than the fixed pole at z = 1."""
        found = poles(self.plant, self.feedback, self._resonators(lead))
        found = found[np.abs(found - 1) > FIXED]
        largest = found[np.argmax(np.abs(found))]
        samples = 1 / self.plant.period / self.periods_per_second  # in a revolution
        factor = math.exp(min(samples * math.log(max(abs(largest), 1e-300)), 700.0))
        return Worst(factor, abs(float(np.angle(largest))) / (TURN * self.plant.period))
