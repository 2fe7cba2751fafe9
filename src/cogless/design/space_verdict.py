"""What is known before a run of a law that learns in angle: whether it settles along its references.

space_learning.py has the factor at one speed and acceleration. Along a reference, with f = (1, omega, a) and
M the learning gains of the three functions delta, a period makes of what it finds of a frequency

    delta_k = Q (I - M f f' / |omega| S / (1 + mu S)) delta_{k-1}

In the norm of M^-1/2 that is a matrix with the values Q, Q and Q / (1 + mu S), whatever f is, so that

    - if the factor is below one at all speeds and accelerations of the reference, it settles;
    - its determinant is Q^n / (1 + mu S), so that the mean of its logarithm over the angle, taken at a fixed
      order of the period, is a lower bound of n times the rate of growth: if that is above zero, it grows.

At a constant speed n is one and both are the same. Between them it may grow: where the reference is often at
the speeds that are worst. All of that for references that hardly change within what the loop remembers.

Stability comes first: where 1 + mu S is unstable there is no factor. mu goes with 1 / |omega|, so that this
happens at low speed. A reference that stands or turns back passes such speeds within less than a period, and
nothing that was learned there comes back before it's over: it bursts in passing, up to the limits. So much is
said, and what happens next isn't judged.

Where the torque constant ripples over the angle the loop's gain does. "Settles" is said of its least and its
largest value, "unstable" and "grows" of its mean; what lies between "may be".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cogless import units
from cogless.design.angle_functions import angle_functions
from cogless.design.closed_loop import Linear, Oscillation, oscillation
from cogless.design.learning import SETTLED, Worst
from cogless.design.margins import Real
from cogless.design.position import feedback_at
from cogless.design.space_bounds import unfit
from cogless.design.space_learning import SpaceLoop
from cogless.study import Study
from cogless.study.mechanics import Load
from cogless.study.motion import course
from cogless.study.reading import for_scenario
from cogless.study.space_controller import SpaceLearning, SpacePosition, SpaceSpeed
from cogless.study.spoken import spoken_unit
from cogless.units import ANGULAR_SPEED

STEP = 1.06  # from one speed to the next
FEWEST_SPEEDS = 15
SAME = 1e-6  # of speeds, relative
ACCELERATIONS = 3  # at a speed, where mu depends on them
WIDEST = 400  # cells or samples on each side that are tried
ORDERS = 2000
ANGLES = 720  # in an electrical revolution
RIPPLE = 0.01  # of the torque constant, below which it counts as none
MARGIN = 2  # of omega_min over the speed that is unstable; mu goes with 1 / |omega|: a gain margin
TINY = 1e-30  # under a logarithm

Samples = NDArray[np.intp]

Kind = Literal["settles", "may grow", "grows", "may be unstable", "unstable", "feedback unstable", "rests"]


@dataclass(frozen=True)
class Passing:
    """Speeds that a reference only passes, standing or turning back, and at which it isn't settled."""

    below: float  # rad/s, mechanical
    time: float  # s, the longest at once
    frequency: float  # Hz, of what is unstable there, or grows
    unstable: bool

    def words(self, unit: str = ANGULAR_SPEED.unit) -> str:
        """In a line; `unit`: of speeds."""
        what = "is unstable" if self.unstable else "grows"
        below, above = (units.format(x, unit, ANGULAR_SPEED, 2) for x in (self.below, MARGIN * self.below))
        found = f"below {below}, which it passes within {self.time:.2g} s, it {what} "
        rests = f'omega_min = "{above}" rests there'
        return f"{found}at {self.frequency:.0f} Hz: {rests}"


@dataclass(frozen=True)
class Mean:
    """The largest mean factor of an order of the period, over the angle that is turned at each speed."""

    factor: float
    lowest: float  # Hz, that order at the slowest speed
    highest: float  # Hz, at the fastest
    sure: bool  # whether it grows for certain

    def words(self) -> str:
        """In a line."""
        return f"in the mean {self.factor:.3g}x from {self.lowest:.0f} to {self.highest:.0f} Hz"


@dataclass(frozen=True)
class Verdict:
    """Of a controller, over all its scenarios."""

    kind: Kind
    worst: Worst | None = None  # the largest factor a period, an upper bound; None where there is none
    omega_m: float = 0.0  # rad/s, where that is, or what is unstable
    unstable: Oscillation | None = None
    varies: bool = False  # the speed
    mean: Mean | None = None  # of what grows, where the speed varies
    filter: int | None = None  # of what grows: the least q_half_width with which it settles at all speeds
    passing: Passing | None = None

    @property
    def fine(self) -> bool:
        """Whether there is nothing to warn of."""
        return self.kind == "settles" and self.passing is None

    def short(self, unit: str = ANGULAR_SPEED.unit) -> str:
        """What it is, without a remedy; `unit`: of speeds."""
        speed = f" at {units.format(self.omega_m, unit, ANGULAR_SPEED, 3)}" if self.varies else ""
        if self.unstable is not None:
            with_what = "" if self.kind == "feedback unstable" else " with what learning adds at once"
            found = f"{self.kind}{with_what}, at {self.unstable.frequency:.0f} Hz{speed}"
            return found + (", where K_t is largest" if self.kind == "may be unstable" else "")
        if self.worst is None or self.kind in ("settles", "rests"):
            return self.kind
        up_to = "up to " if self.varies else ""
        factor = f"{up_to}{self.worst.factor:.4g}x a period at {self.worst.frequency:.0f} Hz"
        mean = f", {self.mean.words()}" if self.mean else ""
        return f"{self.kind}, {factor}{speed}{mean}"

    def remedy(self) -> str:
        """What mends it; empty where nothing has to be."""
        if self.kind in ("unstable", "may be unstable"):
            return "lower its learning gains, or raise omega_min"
        if self.kind == "feedback unstable":
            return "lower its gains"
        if self.kind not in ("grows", "may grow"):
            return ""
        if self.filter is None:
            return "no Q filter alone repairs it, lower its learning gains too"
        return f"q_half_width = {self.filter} repairs it"

    def words(self, unit: str = ANGULAR_SPEED.unit) -> str:
        """All of it; `unit`: of speeds."""
        passing = self.passing.words(unit) if self.passing else ""
        return "; ".join(part for part in (self.short(unit), self.remedy(), passing) if part)


@dataclass(frozen=True, eq=False)
class _At:
    """A speed and acceleration of a reference, the samples that are near it, what the loop does there."""

    loops: tuple[SpaceLoop, ...]  # at the torque constants that it may have; the last one's is the mean
    samples: Samples

    @property
    def loop(self) -> SpaceLoop:
        return self.loops[-1]

    @cached_property
    def worst(self) -> Worst:
        return max((loop.worst() for loop in self.loops), key=lambda worst: worst.factor)

    @cached_property
    def unstable(self) -> Oscillation | None:
        """At the mean torque constant."""
        return self.loop.oscillation()

    @cached_property
    def oscillation(self) -> Oscillation | None:
        """At any."""
        found = [o for loop in self.loops if (o := loop.oscillation()) is not None]
        return max(found, key=lambda o: o.rate, default=None)

    @property
    def fine(self) -> bool:
        return self.oscillation is None and self.worst.factor <= SETTLED


@dataclass(frozen=True)
class _Motion:
    """Of one scenario: what is judged, with its share of the angle, and what is only passed."""

    judged: tuple[tuple[_At, float], ...]
    passing: Passing | None


def verdict(study: Study, name: str) -> Verdict | None:
    """Of a controller that learns in angle; None where it may not, or has no scenario."""
    law = study.controller[name]
    keys = [key for key in study.scenario if name in study.controllers_in(key)]
    if not isinstance(law, SpaceLearning) or not law.learning or not keys:
        return None
    motions = [m for key in keys if (m := _motion(study, key, name)) is not None]
    if not motions:
        return Verdict("rests")
    found = [at for motion in motions for at, _ in motion.judged]
    varies = len({at.loop.omega_m for at in found}) > 1
    alone = _feedback(study, name, found)
    if alone is not None:
        return Verdict("feedback unstable", unstable=alone[1], omega_m=alone[0], varies=varies)
    passing = max((m.passing for m in motions if m.passing), key=lambda p: p.below, default=None)
    sure = [(at.unstable, at.loop.omega_m) for at in found]
    unsure = [(at.oscillation, at.loop.omega_m) for at in found]
    for some in (sure, unsure):
        grow = [(each, omega_m) for each, omega_m in some if each is not None]
        if grow:
            fastest, omega_m = max(grow, key=lambda each: each[0].rate)
            what: Kind = "unstable" if some is sure else "may be unstable"
            return Verdict(what, None, omega_m, fastest, varies, passing=passing)
    most = max(found, key=lambda at: at.worst.factor)
    if most.worst.factor <= SETTLED:
        return Verdict("settles", most.worst, most.loop.omega_m, varies=varies, passing=passing)
    means = [_mean(motion.judged, law) for motion in motions]
    mean = max(means, key=lambda m: m.factor)
    kind: Kind = "grows" if any(m.sure for m in means) else "may grow"
    return Verdict(
        kind,
        most.worst,
        most.loop.omega_m,
        varies=varies,
        mean=mean if varies and kind == "grows" else None,
        filter=_repairing(found, law),
        passing=passing,
    )


def warnings(study: Study, name: str) -> list[str]:
    """What a user should know before a run, a line each."""
    found, lines = verdict(study, name), []
    if found is None:
        return []
    if found.kind == "rests":
        lines.append("learns nothing: no reference reaches omega_min after learning_start")
    elif not found.fine:
        lines.append(found.words(spoken_unit(study, ANGULAR_SPEED)))
    reason = unfit(study, name)
    if reason:
        lines.append(f"{reason}: what doesn't repeat is learnt only as far as it stays for a period")
    return lines


def judged(study: Study, scenario: str, name: str) -> list[SpaceLoop]:
    """A controller at the slowest and at the fastest speed that it's judged at in a scenario."""
    motion = _motion(study, scenario, name)
    speeds = [at.loop.omega_m for at, _ in motion.judged] if motion else []
    ends = {min(speeds), max(speeds)} if speeds else ()
    return [SpaceLoop(study, name, speed) for speed in sorted(ends)]


def _feedback(study: Study, name: str, found: list[_At]) -> tuple[float, Oscillation] | None:
    """Where the feedback is unstable by itself, before or after the hand-over, and what oscillates."""
    law = study.controller[name]
    for at in (f(found, key=lambda at: at.loop.omega_m) for f in (min, max)):
        omega_m = at.loop.omega_m
        before = Linear(1, law.k) if isinstance(law, SpaceSpeed) else feedback_at(study, name, omega_m)
        unstable = oscillation(at.loop.plant, before) or oscillation(at.loop.plant, at.loop.feedback)
        if unstable is not None:
            return omega_m, unstable
    return None


def _motion(study: Study, scenario: str, name: str) -> _Motion | None:
    """None where it learns nothing: its reference is never fast enough."""
    law = study.controller[name]
    assert isinstance(law, SpacePosition | SpaceSpeed)
    way = course(study.scenario[scenario])
    learns = way.time >= law.learning_start
    omega, alpha = np.abs(way.omega[learns]), np.abs(way.alpha[learns])
    moving = omega >= law.omega_min
    if not np.any(moving):
        return None
    found = []
    torques = _torques(study, scenario)
    for speed, acceleration, samples in _places(omega, alpha if law.mu_h else 0 * alpha, moving):
        loops = [SpaceLoop(study, name, speed, acceleration, torque) for torque in torques]
        found.append(_At(tuple(loops), samples))
    turned = omega * way.step
    period = 2 * math.pi * float(law.period.revolutions(study.motor.pole_pairs))
    passed, longest = _passed(found, ~moving, turned, period)
    left = [at for at in found if not np.all(passed[at.samples])]
    if not left:  # it never comes further
        left, passed = found, np.zeros(len(omega), dtype=bool)
    angles = [float(np.sum(turned[at.samples][~passed[at.samples]])) for at in left]
    shares = np.array(angles) / sum(angles)
    gone = [at for at in found if at not in left]
    passing = _passing(gone, left, longest * way.step) if gone else None
    return _Motion(tuple(zip(left, shares.tolist(), strict=True)), passing)


def _torques(study: Study, scenario: str) -> list[float]:
    """The least and the largest torque constant over the angle, and its mean; one where it has no ripple."""
    here = for_scenario(study, scenario)
    motor = here.motor.star()
    theta = np.linspace(0, 2 * math.pi / motor.pole_pairs, ANGLES, endpoint=False)
    K_t = here.mechanics.inertia / angle_functions(motor, here.mechanics, Load()).h(theta)
    found = K_t / motor.K_t
    least, most = float(np.min(found)), float(np.max(found))
    return [least, most, 1.0] if most > least + RIPPLE and least > 0 else [1.0]


def _places(omega: Real, alpha: Real, moving: NDArray[np.bool_]) -> Iterator[tuple[float, float, Samples]]:
    """Speeds from the slowest to the fastest, accelerations at each, and the samples nearest to them."""
    slowest, fastest = float(np.min(omega[moving])), float(np.max(omega[moving]))
    count = 1
    if fastest > slowest * (1 + SAME):
        count = max(FEWEST_SPEEDS, math.ceil(math.log(fastest / slowest) / math.log(STEP)) + 1)
    speeds = np.geomspace(slowest, fastest, count)
    spacing = math.log(fastest / slowest) / max(count - 1, 1) or 1.0
    nearest = np.full(len(omega), -1)
    nearest[moving] = np.rint(np.log(omega[moving] / slowest) / spacing)
    for k, speed in enumerate(speeds.tolist()):
        here = np.flatnonzero(nearest == k)
        if not len(here):
            continue
        low, high = float(np.min(alpha[here])), float(np.max(alpha[here]))
        levels = np.linspace(low, high, ACCELERATIONS if high > low else 1)
        level = np.argmin(np.abs(alpha[here, None] - levels), axis=1)
        for n, acceleration in enumerate(levels.tolist()):
            if np.any(level == n):
                yield speed, acceleration, here[level == n]


def _passed(
    found: list[_At], resting: NDArray[np.bool_], turned: Real, period: float
) -> tuple[NDArray[np.bool_], int]:
    """Samples of bad speeds next to rest or reversal, less than a period long; the most at once."""
    bad = np.zeros(len(turned), dtype=bool)
    for at in found:
        bad[at.samples] = not at.fine
    passed, longest = np.zeros(len(turned), dtype=bool), 0
    changes = np.flatnonzero(np.diff(np.concatenate(([False], bad | resting, [False])).astype(int)))
    for start, end in changes.reshape(-1, 2):
        count = int(np.sum(bad[start:end]))
        if count and np.any(resting[start:end]) and np.sum(turned[start:end]) < period:
            passed[start:end] = bad[start:end]
            longest = max(longest, count)
    return passed, longest


def _passing(gone: list[_At], left: list[_At], time: float) -> Passing:
    highest = max(at.loop.omega_m for at in gone)
    above = min((at.loop.omega_m for at in left if at.loop.omega_m > highest), default=highest * STEP)
    digit = 10.0 ** (math.floor(math.log10(above)) - 1)
    below = math.ceil(above / digit - 1e-9) * digit
    unstable = [at.oscillation for at in gone if at.oscillation is not None]
    if unstable:
        return Passing(below, time, max(unstable, key=lambda o: o.rate).frequency, True)
    return Passing(below, time, max((at.worst for at in gone), key=lambda w: w.factor).frequency, False)


def _mean(judged: Sequence[tuple[_At, float]], law: SpacePosition | SpaceSpeed) -> Mean:
    """Over one scenario. Sure where the bound from below is above one: a period has a mode to each order."""
    constant = len(judged) == 1
    accelerates = any(at.loop.alpha_m for at, _ in judged)
    gains = (law.mu_alpha, law.mu_beta, law.mu_h if accelerates else 0.0)
    channels = 1 if constant else max(1, sum(gain > 0 for gain in gains))
    highest = min(at.loop.highest / at.loop.periods_per_second for at, _ in judged)
    orders = np.linspace(1, max(highest, 1), ORDERS)
    rate, bound = np.zeros(ORDERS), np.zeros(ORDERS)
    for at, share in judged:
        f = orders * at.loop.periods_per_second
        recalled = at.loop.q(f, law.q_half_width) * at.loop.lines(f, constant)
        kept = np.log(at.loop.unfiltered(f) + TINY)
        rate += share * (np.log(recalled + TINY) + kept)
        bound += share * (np.log(recalled + TINY) + kept / channels)
    window = 1 + math.ceil(1 / max(orders[1] - orders[0], 1 / ORDERS))
    least = np.min(np.lib.stride_tricks.sliding_window_view(bound, min(window, ORDERS)), axis=1)
    k = int(np.argmax(rate))
    a_second = [at.loop.periods_per_second for at, _ in judged]
    return Mean(
        math.exp(rate[k]),
        float(orders[k]) * min(a_second),
        float(orders[k]) * max(a_second),
        float(np.max(least)) > math.log(SETTLED),
    )


def _repairing(found: list[_At], law: SpacePosition | SpaceSpeed) -> int | None:
    """The fewest cells or samples on each side with which the factor is below one at all of them."""
    parts = []
    for at in found:
        f = at.loop.frequencies
        without = np.max([loop.unfiltered(f) for loop in at.loops], axis=0)
        high = without > SETTLED  # no filter is above one
        parts.append((at.loop, f[high], without[high]))
    widest = min(WIDEST, (law.cells - 1) // 2)
    return next(
        (
            n
            for n in range(widest + 1)
            if all(np.all(loop.q(f, n) * without <= SETTLED) for loop, f, without in parts)
        ),
        None,
    )
