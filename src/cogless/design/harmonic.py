"""The rule that computes every number of the law `harmonic`, and what it certifies: docs/laws/harmonic.md.

Gamma is a factor on the rate at which an order n learns: what the law sees of a ripple in T at that order,
over what it assumes to see. P is the response from current reference to measured speed and angle (pi.py),
C the PI, M the law's model of the angle, V its model of the delay:

    S = 1 / (1 + C P_omega),    M = b T^2 (z + 1) / (2 (z - 1)^2) V,    z = exp(jwT), w = n omega
    Gamma = S (P_theta + M C P_omega) / (b T^2 (z + 1) / (2 (z - 1)^2) exp(-jw delay))

Gamma is 1 if plant and model agree. The order converges, for a small rate, exactly if Re Gamma > 0.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from cogless.design.current_loop import CurrentLoop
from cogless.design.margins import Complex, Real
from cogless.design.pi import SpeedLoop, gains, pi_response, speed_loop
from cogless.errors import StudyError
from cogless.study import Study
from cogless.study.harmonic import FASTEST, ORDERS, Harmonic, Learner

POLE = math.exp(-0.5)  # of the observer, each sample: its bandwidth is half a radian a sample
FULLEST = 6  # highest learned order, in lowest common multiples of slots and poles
MIDDLE = 1.3  # rad a sample, where the delay is taken: half of what an order may have
SPLIT = 0.5105  # rad a sample, up to which an order learns from z
STEP = 1 / 15  # what the rates of all orders add up to, a sample: slow orders settle up to 0.16
MOST, LEAST = 20.0, 0.5  # 1/s, of the rate
WRONG = (0.5, 1.0, 1.5)  # b of the plant / b of the model
BENDS_FROM = 3  # a base order from which on an order's neighbours aren't learned themselves
FROM = 1e-3  # rad a sample: the slowest order that is judged


def learner(study: Study, name: str) -> Learner:
    """The numbers of a controller's learning part; StudyError if the motor doesn't tell its slots."""
    law, loop = study.controller[name], speed_loop(study)
    assert isinstance(law, Harmonic)
    base, highest = _orders(study, name, law)
    orders = max(1, min(ORDERS, highest // base))
    rate = min(MOST, STEP / (orders * loop.period))
    return Learner(loop.b, delay_of(loop), base, orders, rate, min(rate, LEAST))


def _orders(study: Study, name: str, law: Harmonic) -> tuple[int, int]:
    """The lowest order, whose multiples are learned, and the highest."""
    poles, slots = 2 * study.motor.pole_pairs, getattr(study.motor, "slots", None)
    if slots is None and law.base is None:
        expected = "expected their number, or controller.{name}.base, for the orders of that controller"
        raise StudyError(f"{study.source.path}: motor.slots: missing: {expected.format(name=name)}")
    common = math.lcm(slots or poles, poles)
    slowest = min((s.slowest for s in study.scenario.values() if s.slowest), default=0.0)
    sampled = SPLIT / (slowest * speed_loop(study).period) if slowest else math.inf
    return law.base or math.gcd(slots or poles, poles), int(max(common, min(FULLEST * common, sampled)))


def delay_of(loop: SpeedLoop) -> float:
    """Time from a current's reference to what it does to the measured angle, s, less half a law's period.

    The law adds that half itself: a held reference is late by it. The current loop samples the held reference
    and sees it half of its own period earlier, so that is taken off, too.
    """
    if not isinstance(loop.current, CurrentLoop):
        return loop.delay
    w = min(MIDDLE / loop.period, 0.5 * math.pi / loop.current.period)
    opened = loop.current.response(np.array([w]))
    late = -float(np.angle(opened / (1 + opened))[0]) / w
    return max(0.0, loop.delay + late - loop.current.period / 2)


def _shares(d: float, z: Complex) -> Complex:
    """V: the law's model of what a delay of d samples makes of its current."""
    if d > 1.5:
        kept = d / (1 + d)
        return np.asarray((1 - kept) / (1 - kept / z))
    m = int(d)
    return np.asarray(z ** -float(m) * (1 - (d - m) + (d - m) / z))


def gamma(loop: SpeedLoop, told: Learner, pi: tuple[float, float], w: Real, late: int = 0) -> Complex:
    """Gamma at the frequencies w, rad/s, with a plant that is `late` samples later than `loop` says."""
    T = loop.period
    z = np.exp(1j * w * T)
    P_omega, P_theta = (np.asarray(P) * z**-late for P in loop.plant(w))
    C = pi_response(w, T, *pi)
    S = 1 / (1 + C * P_omega)
    model = told.b * T**2 * (z + 1) / (2 * (z - 1) ** 2)
    seen = S * (P_theta + model * _shares(told.delay / T, z) * C * P_omega)
    return np.asarray(seen / (model * np.exp(-1j * w * told.delay)))


@dataclass(frozen=True)
class Certified:
    """One speed: how far the learned orders converge, whatever the inertia and the torque constant."""

    omega_m: float  # rad/s
    acting: int  # highest order that acts and is learned
    gamma: float  # least Re Gamma of those, b of the plant 0.5 to 1.5 times the model's
    late: int  # highest order up to which all converge with a sample that isn't told; 0: none


@dataclass(frozen=True)
class Certificate:
    """What the rule says of the learning part before a run."""

    learner: Learner
    speeds: tuple[Certified, ...]  # slowest and fastest reference
    fastest: float  # rad/s, up to which the lowest order is learned
    straight: float | None  # rad/s, up to which an eccentric sensor's error is learned; None: too low a base
    rate_most: (
        float | None
    )  # 1/s: all orders together settle, at these speeds, if the rate is below; None: any rate

    @property
    def fine(self) -> bool:
        """Whether all acting orders converge at all speeds."""
        return all(each.gamma > 0 for each in self.speeds) and self.learner.rate < (
            self.rate_most or math.inf
        )

    def words(self) -> str:
        """The certificate in one line."""
        base, rpm = self.learner.base, 30 / math.pi
        if not self.speeds:
            return "no reference moves fast enough for it to learn"
        bound = "at any rate" if self.rate_most is None else f"to {self.rate_most:.3g} 1/s"
        orders = f"orders {base} k to {base * self.learner.orders}, settles {bound}"
        found = [
            f"at {each.omega_m * rpm:.4g} rpm up to {each.acting}, Re Gamma {each.gamma:.2f} or more, "
            f"with an untold sample up to {each.late}"
            for each in self.speeds
        ]
        ends = [f"learns up to {self.fastest * rpm:.4g} rpm"]
        if self.straight is not None:
            ends += [f"an eccentric sensor's error up to {self.straight * rpm:.4g} rpm"]
        return "; ".join([orders, *found, *ends])


def certificate(study: Study, name: str) -> Certificate:
    """The certificate of a controller: at the slowest and the fastest reference of its scenarios."""
    told, pi, loop = learner(study, name), gains(study, name), speed_loop(study)
    scenarios = [study.scenario[key] for key in study.scenarios_of(name)] or list(study.scenario.values())
    ends = {speed for s in scenarios for speed in (s.slowest, s.top_reference)}
    ends = {speed for speed in ends if told.base * speed * loop.period > FROM}
    orders = told.base * np.arange(1.0, told.orders + 1)
    found, most = [], [math.inf]
    for omega in sorted({min(ends), max(ends)} if ends else ()):
        acting = orders[orders * omega * loop.period <= FASTEST]
        if len(acting):
            found.append(_at(loop, told, pi, acting, omega))
            most.append(rate_bound(loop.period, told, np.asarray(acting * omega)))
    straight = SPLIT / (_main_order(study, told.base) * loop.period) if told.base >= BENDS_FROM else None
    bound = min(most)
    return Certificate(
        told,
        tuple(found),
        FASTEST / (told.base * loop.period),
        straight,
        bound if math.isfinite(bound) else None,
    )


def _main_order(study: Study, base: int) -> int:
    """Lowest common multiple of slots and poles, the main order of cogging; `base` if slots aren't told."""
    slots = getattr(study.motor, "slots", None)
    return math.lcm(slots, 2 * study.motor.pole_pairs) if slots else base


def _at(loop: SpeedLoop, told: Learner, pi: tuple[float, float], orders: Real, omega: float) -> Certified:
    def real(late: int) -> Real:
        plants = (dataclasses.replace(loop, b=factor * loop.b) for factor in WRONG)
        return np.asarray(
            np.min(
                [gamma(plant, told, pi, np.asarray(orders * omega), late).real for plant in plants], axis=0
            )
        )

    bad = np.flatnonzero(real(1) <= 0)
    good = len(orders) if not len(bad) else int(bad[0])
    late = int(orders[good - 1]) if good else 0
    return Certified(omega, int(orders[-1]), float(np.min(real(0))), late)


def rate_bound(T: float, told: Learner, w: Real) -> float:
    """The rate below which all orders, at frequencies w in rad/s, settle together, 1/s. `T`: period, s.

    The loop from the learned current to what the law adds to it is the rate times R. The bound is the rate at
    which this first is -1. Inertia, torque constant and delay are those that the law assumes.
    """
    beside = np.add.outer(w * T, np.geomspace(1e-4, 0.5, 60) * w[0] * T)
    om = np.union1d(np.linspace(FROM, math.pi, 6000), np.ravel(beside)) * (1 + 1e-9)
    om = om[om < math.pi]
    R = all_orders(told, w * T, om, T)
    crossing = (R.real[:-1] < 0) & (R.real[1:] < 0) & (R.imag[:-1] * R.imag[1:] < 0)
    part = R.imag[:-1] / (R.imag[:-1] - R.imag[1:] + 1e-300)
    at = (R.real[:-1] + part * (R.real[1:] - R.real[:-1]))[crossing]
    return float(-1 / np.min(at)) if len(at) else math.inf


def all_orders(told: Learner, orders: Real, om: Real, T: float) -> Complex:
    """R, the loop of all orders over the rate, at om rad a sample; resonators at `orders`, rad a sample."""
    d, z = told.delay / T, np.exp(1j * om)
    sum_of = np.zeros(len(om), dtype=complex)
    for one in orders:
        Z = np.exp(1j * one)
        inverse = np.exp(1j * one * d) / seen(Z, one)
        resonator = inverse / (1 - Z / z) + np.conj(inverse) / (1 - np.conj(Z) / z)
        sum_of += T / 2 * resonator * seen(z, one) * _shares(d, z)
    return sum_of


def seen(z: Complex, order: float) -> Complex:
    """How a held current shows in the signal that an order learns from, over b T^2."""
    of_e = np.asarray((z + 1) * (z - 1) / (2 * (z - POLE) ** 3))
    return of_e if order > SPLIT else np.asarray((1 - POLE) ** 3 * z / (z - 1) * of_e)
