"""The rule that computes every number of the law `harmonic`, and what it certifies: docs/laws/harmonic.md.

The measure is Gamma of harmonic_transfer.py. An order that Gamma may turn against learning is held: it acts,
but doesn't learn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from cogless.design.changes import either, helping, unit_text
from cogless.design.closed_loop import Gains, Linear, position_gains_by_rule, position_margins
from cogless.design.detent import STALLING_RATIO, snaps, swing
from cogless.design.law_rules import FeedbackRules, Gain, Values, feedback_of, pi_texts
from cogless.design.laws.harmonic_transfer import (
    ORDER_ANGLE_LEAST,
    SLOW_ORDER_ANGLE,
    at_speed,
    gamma,
    held_bands,
    is_held,
    plants,
    rate_bound,
)
from cogless.design.margins import Real
from cogless.design.speed_loop import CurrentLoop, SpeedLoop, gains, speed_loop
from cogless.errors import StudyError
from cogless.study import Study, for_scenario
from cogless.study.laws.harmonic import HARMONIC_ORDERS, ORDER_ANGLE_MOST, Harmonic, Learner
from cogless.study.laws.law import LawLoop
from cogless.study.motor import StepMotor
from cogless.study.position_sensor import Counted, Hall
from cogless.study.reading import Changes, Remark
from cogless.units import RPM

ORDER_MULTIPLES = 6  # highest learned order, in lowest common multiples of slots and poles
DELAY_ANGLE = 1.3  # rad/sample at which the delay is taken: half of what an order may have
RATE_SUM_MOST = 1 / 16  # sum of the rates of all acting orders, 1/sample; harmonic.c has it as TOGETHER
LEARNER_RATE_MOST, LEARNER_RATE_LEAST = 20.0, 0.5  # 1/s
# rad; a larger sensor error needs a base that can learn it. SURE of harmonic.c is its square.
SENSOR_ERROR_MOST = 5e-4
# Learning this many times as fast as a load turns with the rotor leaves a tenth of the load's changes.
LOAD_RATE_RATIO = 10
RATE_MARGIN = 2.4  # rate at which all orders together oscillate / the rate
BENDS_FROM = (2, 4)  # with a larger base, orders one and two away from a learned one aren't learned


# Units of what the rule of `harmonic` computes.
LEARNER = {
    "step": "rad",
    "b": "rad/s^2/A",
    "delay": "s",
    "base": "",
    "bends": "",
    "orders": "",
    "fast": "",
    "rate": "1/s",
    "rate_min": "1/s",
}


def harmonic_gains(study: Study, name: str) -> Gains:
    """k_theta, kp and ki of a controller with the law harmonic; k_theta is 0 where it controls the speed."""
    law = cast(Harmonic, study.controller[name])
    if not law.position or law.tuning is None or law.kp is not None:
        kp, ki = gains(study, name)
        return law.k_theta or 0.0, kp, ki
    return position_gains_by_rule(study, name, 1)


def learner(study: Study, name: str) -> Learner:
    """The numbers of a controller's learning part."""
    return study.once(_learner, name)


def _learner(study: Study, name: str) -> Learner:
    law, loop = cast(Harmonic, study.controller[name]), speed_loop(study)
    base, sure, highest = _orders(study, law)
    fast, orders = (max(1, min(HARMONIC_ORDERS, top // base)) for top in (sure, highest))
    step, bends = _step(study), _bends(study, base)
    learner = Learner(
        b=loop.b,
        delay=delay_of(loop),
        step=step,
        base=base,
        bends=bends,
        orders=orders,
        fast=fast,
        rate=LEARNER_RATE_MOST,
        rate_min=LEARNER_RATE_LEAST,
    )
    pi = harmonic_gains(study, name)
    speeds = _speeds(study, name, learner.base * learner.orders * loop.period)
    if not speeds:
        return learner
    learner = replace(learner, rate_min=_least_rate(study, learner, speeds[-1], loop.period))
    learner = replace(learner, held=held_bands(loop, learner, pi, *_halls(study), (speeds[0], speeds[-1])))
    if loop.shaft is None:
        return learner
    bound = min(_rate_bound(study, loop, learner, pi, omega) for omega in speeds) / RATE_MARGIN
    return replace(learner, rate=min(learner.rate, bound), rate_min=min(bound, learner.rate_min))


def _speeds(study: Study, name: str, sampled: float) -> list[float]:
    """The slowest and the fastest of a controller's references, rad/s, at which an order can be judged.

    `sampled`: angle by which the highest order turns in a sample, divided by the speed, s.
    """
    scenarios = [study.scenario[key] for key in study.scenarios_of(name)] or list(study.scenario.values())
    ends = {speed for s in scenarios for speed in (s.slowest, s.top_reference)}
    ends = {speed for speed in ends if speed * sampled > ORDER_ANGLE_LEAST}
    return sorted({min(ends), max(ends)}) if ends else []


def _halls(study: Study) -> tuple[float, int]:
    """Angle between the edges of Hall sensors, rad, and intervals that the speed is taken over; 0: none."""
    sensor = study.drive.position_sensor
    return (sensor.step(study.motor.pole_pairs), sensor.edges) if isinstance(sensor, Hall) else (0.0, 0)


def _orders(study: Study, law: Harmonic) -> tuple[int, int, int]:
    """The base, whose multiples are learned, the highest order that surely exists, and the highest order.

    Cogging has only multiples of the greatest common divisor of slots and poles. The main one is their
    lowest common multiple. It is sure, and so are the motor's orders in the study. All multiples are sure if
    dead time is not compensated, since it has every multiple of its order, or if the base is set by hand. No
    result depends on a speed: the law picks the orders that it can hold at the present speed.

    The misplacement of Hall sensors repeats once per electrical revolution. So an order from the pole
    pairs on may come from the sensors; lower orders come from the load.
    """
    if isinstance(study.drive.position_sensor, Hall):
        base = law.base or 1
        return base, max(base, study.motor.pole_pairs - 1), max(base, study.motor.pole_pairs - 1)
    poles, slots = _poles_and_slots(study)
    base, main = math.gcd(slots or poles, poles), math.lcm(slots or poles, poles)
    highest, motor = ORDER_MULTIPLES * main, study.motor.star()
    cogging = [wave.order for wave in motor.cogging if wave.torque and wave.order <= highest]
    of_current = [ripple.order for ripple in motor.torque_ripple]
    of_current += [motor.pole_pairs * flux.order for flux in motor.flux_harmonics]
    sure = max([main, *cogging, *(order for order in of_current if order <= highest)])
    chosen = law.base or _base(base, [main, *cogging], 3 * poles, least_base(study))
    return chosen, highest if law.base or loses_voltage(study) else sure, highest


def loses_voltage(study: Study) -> bool:
    """Whether the inverter has dead time or voltage drops without compensation."""
    inverter = study.drive.inverter
    lost = inverter is not None and bool(inverter.dead_time or inverter.device_drop)
    return lost and study.drive.dead_time_compensation is None


def _base(base: int, cogging: Sequence[int], inverter: int, least: int) -> int:
    """The base, or its least multiple with which `HARMONIC_ORDERS` orders reach the cogging's highest order.

    The multiple divides all orders of cogging and inverter, but may leave out what an uneven magnet or tooth
    adds. Without such a multiple the base remains. Multiples of at least `least` are preferred.
    """
    shared = math.gcd(*cogging, inverter)
    multiples = (n for n in range(base, shared + 1, base) if shared % n == 0)
    reaching = [n for n in dict.fromkeys([base, *multiples]) if n * HARMONIC_ORDERS >= max(cogging)]
    return next((n for n in reaching if n >= least), next(iter(reaching), base))


def least_base(study: Study) -> int:
    """The least base with which the law learns the sensor's error that the study gives; 1: any base."""
    sensor = study.drive.position_sensor
    if not _bends(study, 1 + BENDS_FROM[-1]) or not isinstance(sensor, Counted):
        return 1
    bases = (free + 1 for n, free in enumerate(BENDS_FROM, 1) if abs(sensor.wave(n)) > SENSOR_ERROR_MOST)
    return max(bases, default=1)


def roomy_base(study: Study) -> int:
    """A base that learns the main order and the sensor's error of `least_base`; 1 if there is none."""
    poles, slots = _poles_and_slots(study)
    least = least_base(study)
    base = _base(math.gcd(slots or poles, poles), [math.lcm(slots or poles, poles)], 3 * poles, least)
    return base if base >= least else 1


def delay_of(loop: SpeedLoop) -> float:
    """Time, s, from a current reference to its effect on the measured angle, less half of the law's period.

    The law adds that half itself, by which a held reference is late. The current loop samples the held
    reference half of its own period earlier: this time is subtracted, too.
    """
    if not isinstance(loop.current, CurrentLoop):
        return loop.delay
    w = DELAY_ANGLE / loop.period
    opened = loop.current.response(np.array([w]))
    late = -float(np.angle(opened / (1 + opened))[0]) / w
    return max(0.0, loop.delay + late - loop.current.period / 2)


@dataclass(frozen=True, kw_only=True)
class Certified:
    """One speed: how far the learned orders converge, whatever the inertia and the torque constant."""

    omega_m: float  # rad/s
    acting: int  # highest order that acts and is learned
    gamma: float  # least Re Gamma of the learned orders, for b of 0.5 to 1.5 times the model's
    late: int  # highest order up to which all converge with one more sample of delay; 0: none
    held_orders: tuple[int, ...]  # they act, but aren't learned
    rate: float  # 1/s, at which the orders begin to learn here
    most: float | None  # 1/s: all orders together settle if `rate` is below this; None: any rate
    slow: tuple[int, ...] = ()  # the lowest and the highest order that is too slow to be judged
    swing: float = 0.0  # speed ripple that the feedback alone leaves, rms / speed
    snaps: str | None = None  # why the rotor snaps there with the feedback alone: then nothing is judged

    @property
    def fine(self) -> bool:
        """Whether all acting orders converge, each by itself and all at the same time."""
        together = self.rate < (math.inf if self.most is None else self.most)
        return self.gamma > 0 and together and self.snaps is None

    def in_words(self) -> str:
        """The certificate at this speed in words."""
        if self.snaps is not None:
            return f"not judged: {self.snaps}"
        slow = ""
        if self.slow:
            several = self.slow[0] < self.slow[1]
            of = f"s {self.slow[0]} to {self.slow[1]} are" if several else f" {self.slow[0]} is"
            slow = f". Order{of} too slow to be judged"
        swings = (
            " (uncertain, since the model is for small ripple: with the feedback alone the ripple is "
            f"{100 * self.swing:.0f} % of the speed, rms)"
        )
        late = f"orders up to {self.late} converge" if self.late else "the lowest order may not converge"
        return (
            f"at {self.omega_m / RPM:.4g} rpm orders up to {self.acting}{_held_words(self.held_orders)}, "
            f"with a learning rate of {self.rate:.3g} 1/s at first. Together they settle with "
            f"{'any rate' if self.most is None else f'rates below {self.most:.3g} 1/s'}. If K_t/J is 50 % "
            f"wrong, they {'still' if self.gamma > 0 else 'may not all'} converge (least Re Gamma: "
            f"{self.gamma:.2f}; must be above 0). If a sample of delay is not in the model, {late}"
            f"{slow}{swings if self.swing > STALLING_RATIO else ''}"
        )


@dataclass(frozen=True)
class Certificate:
    """What the rule says of the learning part before a run."""

    learner: Learner
    period: float  # s, of the law
    speeds: tuple[Certified, ...]  # slowest and fastest reference
    fastest: float  # rad/s, up to which the lowest order is learned
    straight: float | None  # rad/s, up to which an eccentric sensor's error is learned; None: nowhere

    def learned_orders(self, speed: Certified) -> Real:
        """The orders that are learned at one of the speeds."""
        base = self.learner.base
        return np.setdiff1d(np.arange(base, speed.acting + 1, base), speed.held_orders).astype(float)

    @property
    def fine(self) -> bool:
        """Whether all acting orders converge at all speeds."""
        return all(speed.fine for speed in self.speeds)

    def in_words(self) -> str:
        """The certificate in one line."""
        return "; ".join(self.clauses)

    @property
    def clauses(self) -> list[str]:
        """The certificate, a statement each."""
        if not self.speeds:
            highest = self.learner.base * self.learner.orders
            least = f"{ORDER_ANGLE_LEAST:g} rad a sample"
            return [
                f"not judged: all references are too slow, since even a wave of order {highest} advances by "
                f"less than {least}"
            ]
        if all(speed.snaps is not None for speed in self.speeds):
            return [f"not judged: {self.speeds[0].snaps}"]
        phrases = [speed.in_words() for speed in self.speeds]
        ends = [f"learns up to {float(f'{self.fastest / RPM:.4g}'):.0f} rpm"]
        edges = [edge / (math.tau * self.period) for edge in self.learner.held]
        if edges:
            bands = [f"{low:.3g} to {high:.3g}" for low, high in zip(edges[::2], edges[1::2], strict=True)]
            ends = [f"learns no order of a frequency from {' or from '.join(bands)} Hz", *ends]
        if self.straight is not None:
            ends += [f"learns an eccentric sensor's error up to {self.straight / RPM:.4g} rpm"]
        return [f"learns {self.learner.order_words}", *phrases, *ends]


def _held_words(orders: tuple[int, ...]) -> str:
    if not orders:
        return ""
    exceptions = (
        f"{len(orders)} orders from {orders[0]} to {orders[-1]}" if len(orders) > 1 else f"{orders[0]}"
    )
    return f", except {exceptions}"


def certificate(study: Study, name: str) -> Certificate:
    """The certificate of a controller: at the slowest and the fastest reference of its scenarios."""
    own_learner, pi, loop = learner(study, name), harmonic_gains(study, name), speed_loop(study)
    speeds = _speeds(study, name, own_learner.base * own_learner.orders * loop.period)
    judged = ((omega, _judged(own_learner, omega, loop.period)) for omega in speeds)
    at_speeds = tuple(
        _certified_at(study, name, loop, own_learner, pi, acting, omega)
        for omega, acting in judged
        if len(acting)
    )
    straight = (
        SLOW_ORDER_ANGLE / (main_order(study, own_learner.base) * loop.period) if own_learner.bends else None
    )
    return Certificate(
        own_learner, loop.period, at_speeds, ORDER_ANGLE_MOST / (own_learner.base * loop.period), straight
    )


def _acting(own_learner: Learner, omega: float, T: float) -> Real:
    """The orders that act at a speed: all slow ones, and the fast ones that the motor is known to have.

    `T`: the law's period, s.
    """
    count = np.arange(1, own_learner.orders + 1)
    turned = own_learner.base * count * abs(omega) * T
    acts = (turned <= SLOW_ORDER_ANGLE) | ((count <= own_learner.fast) & (turned <= ORDER_ANGLE_MOST))
    return np.asarray(own_learner.base * count[acts], dtype=float)


def _judged(own_learner: Learner, omega: float, T: float) -> Real:
    """The acting orders that are fast enough to be judged."""
    acting = _acting(own_learner, omega, T)
    return np.asarray(acting[acting * abs(omega) * T > ORDER_ANGLE_LEAST])


def _too_slow(own_learner: Learner, omega: float, T: float) -> tuple[int, ...]:
    """The lowest and the highest of the orders that are too slow to be judged; empty if none is."""
    count = min(own_learner.orders, int(ORDER_ANGLE_LEAST / (own_learner.base * omega * T)))
    return (own_learner.base, own_learner.base * count) if count else ()


def _swing(study: Study, name: str, omega: float) -> tuple[float, str | None]:
    """The largest swing that the feedback alone leaves in scenarios of this speed, and why the rotor snaps.

    The swing is the rms of the speed's ripple over the speed. The reason is None if the rotor turns in all of
    them.
    """
    feedback, largest = feedback_of(study, name, omega), 0.0
    for key in study.scenarios_of(name) or list(study.scenario):
        if feedback is None or omega not in (study.scenario[key].slowest, study.scenario[key].top_reference):
            continue
        swinging = swing(study, key, feedback, omega)
        if swinging is not None and swinging.stops:
            crossover = position_margins(speed_loop(study, key), feedback).crossover
            return swinging.rms, snaps(study, swinging, omega, crossover)
        largest = max(largest, swinging.rms if swinging is not None else 0.0)
    return largest, None


def rate_at(own_learner: Learner, omega: float, T: float) -> float:
    """The rate, 1/s, at which learning begins at the speed omega, rad/s, without the limit per turn."""
    return min(own_learner.rate, RATE_SUM_MOST / (max(1, len(_acting(own_learner, omega, T))) * T))


def _rate_bound(study: Study, loop: SpeedLoop, own_learner: Learner, pi: Gains, omega: float) -> float:
    """The rate below which all orders that are learned at a speed settle together, 1/s."""
    T, w = loop.period, _judged(own_learner, omega, loop.period) * omega
    w = w[~is_held(own_learner, w * T)]
    if not len(w):
        return math.inf
    if loop.shaft is None:
        return rate_bound(T, own_learner, w)
    return rate_bound(T, own_learner, w, lambda om: gamma(loop, own_learner, pi, om / T), loop.near)


def _poles_and_slots(study: Study) -> tuple[int, int | None]:
    """Poles and slots, as cogging counts them.

    The teeth of a step motor's rotor count as poles. Each phase has two places per tooth, its slots.
    """
    if isinstance(study.motor, StepMotor):
        return study.motor.pole_pairs, 4 * study.motor.pole_pairs
    return 2 * study.motor.pole_pairs, study.motor.slots


def _step(study: Study) -> float:
    """Step of the sensor's angle, rad, if the law learns with a speed timed between edges; else 0.

    Only an unfiltered speed of this kind shows where the rotor is between two steps.
    """
    sensor, filtered = study.drive.position_sensor, study.drive.speed_filter
    return sensor.step if isinstance(sensor, Counted) and sensor.timed and not filtered else 0.0


def _bends(study: Study, base: int) -> int:
    """The highest order of the sensor's error that is learned; 0 if the law learns none of it.

    Counts that lock to the angle are a bend of their own, up to a step of the sensor. A load that varies once
    or twice a turn bends the phases of ripple that depends on the current, too.
    """
    sensor = study.drive.position_sensor
    varies = any(order <= 2 for order in _load_orders(study))
    if varies or not isinstance(sensor, Counted) or sensor.step > SENSOR_ERROR_MOST:
        return 0
    return sum(base > free for free in BENDS_FROM)


def _load_orders(study: Study) -> list[float]:
    """Orders of the load that turns with the rotor."""
    loads = [study.mechanics.load, *(s.load for s in study.scenario.values() if s.load is not None)]
    return [wave.order for load in loads for wave in load.harmonics if wave.torque]


def _least_rate(study: Study, own_learner: Learner, fastest: float, T: float) -> float:
    """The rate to which learning slows down, 1/s.

    Ripple that depends on the current changes with a load that turns with the rotor. Learning follows
    this change if the load is slow enough. An order of the load that is learned itself needs no following.
    """
    first = rate_at(own_learner, fastest, T)
    turning = [LOAD_RATE_RATIO * order * fastest for order in _load_orders(study) if order < own_learner.base]
    return max([LEARNER_RATE_LEAST, *(rate for rate in turning if rate <= first)])


def main_order(study: Study, base: int) -> int:
    """Lowest common multiple of slots and poles, the main order of cogging; `base` without known slots."""
    poles, slots = _poles_and_slots(study)
    return math.lcm(slots, poles) if slots else base


def _certified_at(
    study: Study, name: str, loop: SpeedLoop, own_learner: Learner, pi: Gains, orders: Real, omega: float
) -> Certified:
    w, sector = orders * omega, _halls(study)
    is_held_at = is_held(own_learner, w * loop.period)

    def real(late: int) -> Real:
        sectors = [
            gamma(at_speed(plant, *sector, omega), own_learner, pi, w, late).real for plant in plants(loop)
        ]
        return np.asarray(np.where(is_held_at, np.inf, np.min(sectors, axis=0)))

    bad = np.flatnonzero(real(1) <= 0)
    good = len(orders) if not len(bad) else int(bad[0])
    late, bound = int(orders[good - 1]) if good else 0, _rate_bound(study, loop, own_learner, pi, omega)
    swings, stops = _swing(study, name, omega)
    return Certified(
        omega_m=omega,
        acting=int(orders[-1]),
        gamma=float(np.min(real(0))),
        late=late,
        held_orders=tuple(int(n) for n in orders[is_held_at]),
        rate=rate_at(own_learner, omega, loop.period),
        most=bound if math.isfinite(bound) else None,
        slow=_too_slow(own_learner, omega, loop.period),
        swing=swings,
        snaps=stops,
    )


def unlearned_orders(study: Study, name: str) -> list[int]:
    """The orders of the cogging that a controller doesn't learn."""
    return _unlearned(study, name)[1]


def _unlearned(study: Study, name: str) -> tuple[list[int], list[int]]:
    """The orders of the cogging, and those that a controller doesn't learn."""
    cogging = sorted(
        {
            wave.order
            for key in study.scenarios_of(name)
            for wave in for_scenario(study, key).motor.star().cogging
            if wave.torque
        }
    )
    own_learner = learner(study, name)
    return cogging, [n for n in cogging if not own_learner.learns(n)]


def _not_learned(study: Study, name: str) -> Remark | None:
    """Warning of cogging orders that a controller doesn't learn, with a base with which it learns them."""
    (cogging, unlearned), own_learner = _unlearned(study, name), learner(study, name)
    if not unlearned:
        return None
    orders = f"order{'s' * (len(unlearned) > 1)} {', '.join(map(str, unlearned))}"
    sentence = f"it learns {own_learner.order_words}, but the cogging has {orders}"
    needed = math.gcd(*cogging)
    if cogging[-1] > needed * HARMONIC_ORDERS:
        return Remark(f"{sentence}; no base learns all of the cogging with {HARMONIC_ORDERS} orders")

    def cured(other: Study) -> bool:
        return not unlearned_orders(other, name)

    cures = helping(study, ({f"controller.{name}.base": needed},), cured)
    all_with = f"; with {either(cures)} it would learn all of them" if cures else ""
    return Remark(sentence + all_with, cures)


def _lacks_room(study: Study, name: str) -> int | None:
    """The smallest base with room to learn a sensor's error; None: the controller's base has that room."""
    own_study = max(
        (for_scenario(study, key) for key in study.scenarios_of(name)), key=least_base, default=study
    )
    least = least_base(own_study)
    return least if learner(study, name).base < least else None


def _no_room(study: Study, name: str) -> Remark | None:
    """Warning of a base without room to learn an eccentric sensor's error."""
    least = _lacks_room(study, name)
    if least is None:
        return None
    own_study = max(
        (for_scenario(study, key) for key in study.scenarios_of(name)), key=least_base, default=study
    )
    roomy = roomy_base(own_study)
    often = "twice" if least > 1 + BENDS_FROM[0] else "once"
    base = learner(study, name).base
    sentence = (
        f"base {base} puts the learned orders too close together to learn an error of the position sensor "
        f"that comes {often} a turn"
    )
    change: Changes | None = {f"controller.{name}.base": roomy} if roomy >= least else None
    cures = helping(study, (change,), lambda other: _lacks_room(other, name) is None)
    if not cures:
        return Remark(f"{sentence}: expected {least} or more")
    cogging = sorted(
        {wave.order for wave in own_study.motor.star().cogging if wave.torque and wave.order % roomy}
    )
    but = f", but not order{'s' * (len(cogging) > 1)} {', '.join(map(str, cogging))} of the cogging"
    return Remark(
        f"{sentence}; with {either(cures)} it would learn this error{but if cogging else ''}", cures
    )


def rival_bases(study: Study, name: str) -> tuple[int, int] | None:
    """A base that learns all cogging, and one with room for the sensor's error; None if one base does both.

    None too if there is no cogging, or if no base has that room.
    """
    cogging, _ = _unlearned(study, name)
    if not cogging:
        return None
    worst = max((for_scenario(study, key) for key in study.scenarios_of(name)), key=least_base, default=study)
    complete, roomy, least = math.gcd(*cogging), roomy_base(worst), least_base(worst)
    return (complete, roomy) if complete < least <= roomy else None


class HarmonicRules(FeedbackRules[Harmonic]):
    """The rules of the law `harmonic`: gains of a speed or a position loop, and a learning part by rule."""

    @property
    def pi(self) -> tuple[float, float] | None:
        return None if self.law.position else super().pi

    def fill(self, study_here: Study) -> Values:
        return dict(zip(("k_theta", "kp", "ki"), harmonic_gains(self.study, self.name), strict=True))

    def c_config(self, law: Harmonic, loop: LawLoop) -> dict[str, Any]:
        return law.c_config(loop, learner(self.study, self.name))

    def feedback(self, omega_m: float) -> Linear | None:
        k_theta, kp, ki = harmonic_gains(self.study, self.name)
        return Linear(ratio=1, k=kp, k_theta=k_theta, k_i=ki)

    def gains(self) -> dict[str, Gain]:
        k_theta, kp, ki = harmonic_gains(self.study, self.name)
        of_angle = {"k_theta": Gain(k_theta, "1/s")} if self.law.position else {}
        return {**of_angle, "kp": Gain(kp, "A*s/rad"), "ki": Gain(ki, "A/rad")}

    def numbers_used(self) -> dict[str, Gain]:
        own_learner = learner(self.study, self.name)
        return {key: Gain(getattr(own_learner, key), unit) for key, unit in LEARNER.items()}

    def slower(self, factor: float) -> Changes | None:
        if not self.law.position:
            return super().slower(factor)
        k_theta, kp, ki = harmonic_gains(self.study, self.name)
        own = pi_texts(kp / factor, ki / factor**2) | {"k_theta": unit_text(k_theta / factor, "1/s")}
        return self.by_hand(own)

    def refused(self) -> str | None:
        try:
            learner(self.study, self.name)
        except StudyError as error:  # such as a motor whose slots aren't given
            return error.text_without(self.study.source.path)
        return None

    def certificate(self) -> Certificate:
        return certificate(self.study, self.name)

    def shortfall(self) -> Remark | None:
        return _not_learned(self.study, self.name)

    def notes(self) -> Iterator[Remark]:
        shortfall = self.shortfall()
        if self.law.base in (rival_bases(self.study, self.name) or ()):
            # The study itself states one of two bases, each of which misses what the other learns.
            if shortfall is not None and not shortfall.cures:  # neither learns it
                yield shortfall
            return
        for remark in (shortfall, _no_room(self.study, self.name)):
            if remark is not None:
                yield remark
