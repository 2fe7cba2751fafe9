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
from typing import ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.auto import (
    GAIN_HALVINGS,
    GAIN_MARGIN,
    IN_PHASE,
    known_orders,
    loops_in_corners,
    no_gain_error,
    numbers_by_hand,
    phase_cosine,
    with_numbers,
)
from cogless.design.closed_loop import Oscillation, Resonator, poles
from cogless.design.law_rules import FeedbackRules, Values
from cogless.design.laws.periodic import LONGEST_LEAD
from cogless.design.learning_loop import FACTOR_MOST, LearningLoop, Worst
from cogless.design.margins import Complex, Real
from cogless.design.speed_loop import gains, speed_loop
from cogless.study import Study
from cogless.study.base import speed_text
from cogless.study.laws.harmonic import ORDER_ANGLE_MOST
from cogless.study.laws.law import Memory
from cogless.study.laws.pi_afc import PI_AFC_ORDERS, PiAfc
from cogless.units import TURN

FIXED_POLE_TOLERANCE = 1e-6  # tolerance of the fixed pole at z = 1: the angle, which has no feedback


class OrderLoop(LearningLoop):
    """PI with adaptive feedforward cancellation at a constant speed."""

    FILTERED: ClassVar[bool] = False

    @property
    def law(self) -> PiAfc:
        return cast("PiAfc", self.study.controller[self.controller])

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
        return np.asarray(sum(resonator.response(w, self.plant.period) for resonator in resonators))

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
        """The error after `periods` / that under feedback alone; it shrinks only at the law's orders."""
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
        roots = poles(self.plant, self.feedback, self._resonators(lead))
        roots = roots[np.abs(roots - 1) > FIXED_POLE_TOLERANCE]
        largest = roots[np.argmax(np.abs(roots))]
        samples = 1 / self.plant.period / self.periods_per_second  # samples/revolution
        factor = math.exp(min(samples * math.log(max(abs(largest), 1e-300)), 700.0))
        return Worst(factor, abs(float(np.angle(largest))) / (TURN * self.plant.period))


class PiAfcRules(FeedbackRules[PiAfc]):
    """The rules of the law `pi-afc`."""

    @property
    def memory(self) -> Memory:
        return self.law

    @property
    def loop(self) -> type[OrderLoop]:
        return OrderLoop

    def fastest(self) -> float:
        """The speed, rad/s, at which the lowest order has two samples in a cycle."""
        return math.pi * self.study.drive.rates.outer_loop / self.law.orders[0]

    def auto(self) -> Values:
        return _auto(self.study, self.name)


def _auto(study: Study, name: str) -> Values:
    """Orders that are known and can settle in every corner, the largest first; one lead, one gain for all."""
    candidates = known_orders(study, name)
    settling = [n for n in candidates if _settles(study, name, n)] or candidates[:1]
    by_hand = numbers_by_hand(study, name)
    orders = list(by_hand.get("orders", sorted(settling[:PI_AFC_ORDERS]) or [1]))
    T = speed_loop(study).period
    loops = list(
        loops_in_corners(OrderLoop, with_numbers(study, name, {"orders": tuple(orders), "gain": 1.0}), name)
    )

    def in_phase(n: int) -> float:
        return min(float(np.min(phase_cosine(loop, loop.frequencies, n), initial=1.0)) for loop in loops)

    lead = by_hand.get("lead", max(range(LONGEST_LEAD + 1), key=in_phase) * T)
    kp, ki = gains(study, name)
    gain = (ki or kp / T) / len(orders)
    for _ in range(2 * GAIN_HALVINGS):
        tried = with_numbers(study, name, {"orders": tuple(orders), "gain": GAIN_MARGIN * gain, "lead": lead})
        if all(loop.worst().factor <= FACTOR_MOST for loop in loops_in_corners(OrderLoop, tried, name)):
            return {"orders": orders, "gain": gain, "lead": lead}
        gain /= 2
    raise no_gain_error(study, name)


def _settles(study: Study, name: str, order: int) -> bool:
    """Whether a lead exists with which the order is learned at all speeds and corners.

    An order that turns by more than ORDER_ANGLE_MOST in a sample looks almost like its image: it is left out.
    """
    loops = list(
        loops_in_corners(OrderLoop, with_numbers(study, name, {"orders": (order,), "gain": 1.0}), name)
    )
    turned = max(order * abs(loop.omega_m) * loop.plant.period for loop in loops)
    if turned > ORDER_ANGLE_MOST:
        return False
    leads = range(LONGEST_LEAD + 1)
    return any(
        all(np.all(phase_cosine(loop, loop.frequencies, n) > IN_PHASE) for loop in loops) for n in leads
    )
