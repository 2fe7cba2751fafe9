"""Conditions of Verrelli 2016 on the gains of a law that learns in angle, compared with the law's own gains.

All quantities are mechanical. The bounds are those of angle_functions.py, over all scenarios of a controller.
The theorems are for continuous time, an ideal current loop and no current limit. space.py is for the
sampled loop.

Section 3, law (4). With W = eta^2 / 2 and f+^2 = 1 + (eta_bar + omega+)^2 + (top acceleration)^2 the proof
needs W' < 0 for |eta| >= eta_bar:

    W' = g (-delta~' f eta - k eta^2),   |delta~| <= |sat(delta)| + delta+ + mu |eta| f+ / (omega- - eta_bar)

    as printed   k > g+ / g- (2 delta+ + mu eta_bar / (omega- - eta_bar)) f+ / eta_bar
    corrected    k > g+ / g- ((1 + sqrt m) delta+ + mu f+ eta_bar / (omega- - eta_bar)) f+ / eta_bar

The printed condition has two errors. Step iii of the proof bounds the norm of the saturated part by delta+.
But each of its m components is saturated at delta+, so its norm is up to sqrt m delta+, with m = 3 for alpha,
beta and h. And step iii has the term mu eta f+ |q|, whose f+ is missing in the printed B_W. Since f+ / eta
falls with eta, the condition at eta_bar covers larger errors too.

A weaker condition is enough, because g is a common factor of W', and because the law saturates each component
at its own limit l_i:

    own limits   k eta_bar > sum_i (l_i + bound_i + mu_i f_i eta_bar / (omega- - eta_bar)) f_i

Then V' <= -(k - g_d (eta_bar + omega+) / 2) eta^2 needs k > g_d (eta_bar + omega+) / 2, as printed.

Section 4, law (6). With |g| <= s_1 |theta~| + g_2 |omega~| (footnote 6)

    V' <= -k_v k_theta theta~^2 - (k_omega + v - |h' omega| / 2) omega~^2 + |g omega~|

Footnote 6 leaves k and k_omega_bar free. With g_1 five times the sum of the squares of s_1's terms, it
requires at least

    k_omega + v(omega) > g_1 / (2 k_theta k_v) + g_2 + k_h |omega| / 2

which needs k_v > 0. A weaker condition is enough for the proof, with c theta~^2 in V in place of k_v
theta~^2, for any c > 0:

    k_omega + v(omega) > min_c (|c - k_v| + s_1)^2 / (4 c k_theta) + g_2 + k_h |omega| / 2

The minimum is (s_1 - k_v) / k_theta for 2 k_v < s_1, which includes k_v = 0, and s_1^2 / (4 k_theta k_v)
otherwise. Both conditions are evaluated at the reference's top speed: with a small error the speed stays near
the reference.

The paper takes the bounds as known, but they are only known if the motor is. So they are reported, and aren't
used as defaults: a limit that a study leaves out follows from the current limit.
"""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import cast

from cogless.design.angle_functions import AngleFunctions, Bounds, angle_functions
from cogless.design.closed_loop import Gains, Linear, position_gains_by_rule
from cogless.study import Study, for_scenario
from cogless.study.laws.space import SpaceLearning, SpacePosition, SpaceSpeed
from cogless.study.scenario import Scenario

RATE_FLOOR = 1e-6  # rad/s or rad/s^2, smallest value used to derive a limit, so as not to divide by zero


@dataclass(frozen=True)
class Motion:
    """Bounds of a reference's speed and acceleration."""

    slowest: float  # rad/s, omega-
    top_speed: float  # rad/s, omega+
    top_acceleration: float  # rad/s^2


@dataclass(frozen=True)
class Condition:
    """A bound that a gain has to exceed."""

    name: str
    asks: float  # A*s/rad; infinite if no gain is enough
    needed: bool = False  # True: the proof needs it; False: it is as printed, or stricter than needed
    wants: str = ""  # the setting without which no gain is enough

    def ratio(self, has: float) -> float:
        """The gain divided by the bound; the condition is met if this is above one."""
        return has / self.asks if self.asks > 0 else math.inf

    def in_words(self, has: float) -> str:
        """How the gain `has` compares with the bound, as words that follow "is"."""
        if self.asks <= 0:
            return f"above {self.name} (0)"
        return f"{self.ratio(has):.2g} times {self.name} ({self.asks:.3g})"


@dataclass(frozen=True)
class Theorem:
    """The theorem for a law: its conditions on the gain, and which of its other assumptions aren't met."""

    section: str
    gain: str  # name of the gain that has to exceed the conditions
    has: float  # A*s/rad, mechanical
    bounds: Bounds | None  # None if the torque per current reaches zero
    conditions: tuple[Condition, ...]
    obstacles: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether the proof covers this law with these gains."""
        enough = all(condition.ratio(self.has) > 1 for condition in self.conditions if condition.needed)
        return self.bounds is not None and enough and not self.obstacles

    def verdict(self) -> str:
        """The theorem's verdict in words, with the gain as a multiple of each condition."""
        met = [c for c in self.conditions if math.isfinite(c.asks)]
        never = [c.name + (c.wants and f" without {c.wants}") for c in self.conditions if c not in met]
        asked = " and ".join(condition.in_words(self.has) for condition in met)
        gain_compared = f"{self.gain} = {self.has:.3g}"
        gain_compared += (f" is {asked}" if met else "") + (";" if met and never else "")
        gain_compared += f" no {self.gain} is enough for {_either(never)}" if never else ""
        reasons = f", because {'; '.join(self.obstacles)}" if self.obstacles else ""
        covers = "the proof holds" if self.holds else "not covered by the proof"
        return f"{self.section}: {covers}{reasons}" + (f". {gain_compared}" if self.conditions else "")


def position_gains(study: Study, name: str) -> Gains:
    """k_theta, k_omega and k_i of a position law: as the study gives them, or from its tuning rule."""
    law = cast(SpacePosition, study.controller[name])
    if law.tuning is None:
        return law.k_theta or 0.0, law.k_omega or 0.0, law.k_i
    return position_gains_by_rule(study, name, law.ratio(study.motor.pole_pairs))


def feedback_at(study: Study, name: str, omega_m: float) -> Linear:
    """A position law's feedback before it learns, with v and k_v, at mechanical speed omega_m in rad/s."""
    law = cast(SpacePosition, study.controller[name])
    ratio, (k_theta, k_omega, k_i) = law.ratio(study.motor.pole_pairs), position_gains(study, name)
    v = law.v_0 + law.v_2 * (ratio * omega_m) ** 2
    return Linear(ratio=ratio, k=k_omega + v, k_theta=k_theta, k_i=k_i, k_v=law.k_v)


def theorem(study: Study, name: str) -> Theorem | None:
    """The theorem for a controller that learns in angle; None if it doesn't learn, or is in no scenario."""
    law = study.controller[name]
    keys = study.scenarios_of(name)
    if not isinstance(law, SpacePosition | SpaceSpeed) or not law.learning or not keys:
        return None
    functions = [function for key in keys for function in _in_scenario(study, key)]
    scenarios = [study.scenario[key] for key in keys]
    motion = Motion(
        min(s.slowest for s in scenarios),
        max(s.top_reference for s in scenarios),
        max(s.top_acceleration for s in scenarios),
    )
    bounds = worst([function.bounds() for function in functions])
    obstacles = [*_in_the_way(study, name, law, functions, bounds, motion), *_changing_loads(study, keys)]
    if bounds is None:
        obstacles.insert(0, "the torque per current comes down to zero")
    if isinstance(law, SpaceSpeed):
        limits = learned_limits(study, law, study.scenario.values())
        conditions = speed_conditions(bounds, motion, law, limits) if bounds else ()
        return Theorem(
            section="law (4) of Verrelli 2016, section 3",
            gain="k",
            has=law.k,
            bounds=bounds,
            conditions=conditions,
            obstacles=tuple(obstacles),
        )
    feedback = feedback_at(study, name, motion.top_speed)
    conditions = position_conditions(bounds, motion, feedback) if bounds else ()
    return Theorem(
        section="law (6) of Verrelli 2016, section 4",
        gain="k_omega + v",
        has=feedback.ratio * feedback.k,
        bounds=bounds,
        conditions=conditions,
        obstacles=tuple(obstacles),
    )


def speed_conditions(
    bounds: Bounds, motion: Motion, law: SpaceSpeed, limits: tuple[float, ...]
) -> tuple[Condition, ...]:
    """Conditions on k of law (4): see the top of this file. `limits`: of alpha, beta, h; 0 if not learned."""
    eta, least = law.eta_bar, motion.slowest - law.eta_bar
    mu = (law.mu_alpha, law.mu_beta, law.mu_h)
    per = eta / least if least > 0 else math.inf
    f = (1.0, eta + motion.top_speed, motion.top_acceleration)
    f_plus, (g_minus, g_plus) = math.hypot(*f), bounds.g
    spread, delta = g_plus / g_minus, bounds.delta
    printed = spread * (2 * delta + _times(max(mu), per)) * f_plus / eta
    learned = math.hypot(*map(operator.mul, mu, f))  # mu f+ if all three mu are equal
    corrected = spread * ((1 + math.sqrt(law.channels)) * delta + _times(learned, per)) * f_plus / eta
    bounds_learned = (bounds.k_alpha1, bounds.k_beta1, bounds.h_M)
    parts = zip(mu, f, limits, bounds_learned, strict=True)
    own = sum((_times(gain * x, per) + limit + bound) * x for gain, x, limit, bound in parts) / eta
    drift = bounds.k_h * (eta + motion.top_speed) / 2
    return (
        Condition("the printed bound", printed),
        Condition("the corrected bound", corrected),
        Condition("the bound with its own limits", own, needed=True),
        Condition("g_d (eta_bar + omega+) / 2", drift, needed=True),
    )


def _times(gain: float, per: float) -> float:
    """gain * per; 0 for a gain of 0 even if `per` is infinite, because nothing is learned then."""
    return gain * per if gain else 0.0


def position_conditions(bounds: Bounds, motion: Motion, feedback: Linear) -> tuple[Condition, ...]:
    """Conditions on k_omega + v of law (6): see the top of this file."""
    k_theta, k_v = feedback.k_theta, feedback.ratio * feedback.k_v
    if k_theta <= 0:
        return (Condition("what the proof needs, without k_theta", math.inf, needed=True),)
    squares, s_1, g_2 = error_terms(bounds, motion, k_theta)
    drift = bounds.k_h * motion.top_speed / 2
    printed = 5 * squares / (2 * k_theta * k_v) if k_v > 0 else math.inf
    cross = (s_1 - k_v) / k_theta if 2 * k_v < s_1 else s_1**2 / (4 * k_theta * k_v)
    return (
        Condition("what footnote 6 asks", printed + g_2 + drift, wants="k_v"),
        Condition("what the proof needs", cross + g_2 + drift, needed=True),
    )


def error_terms(bounds: Bounds, motion: Motion, k_theta: float) -> tuple[float, float, float]:
    """Terms of footnote 6 at the top speed: g_1 / 5 (the sum of the squares of s_1's terms), s_1, g_2."""
    parts = (
        bounds.h_M * k_theta**2,
        bounds.k_h * motion.top_acceleration,
        bounds.k_beta1 * k_theta,
        bounds.k_beta2 * motion.top_speed,
        bounds.k_alpha2,
    )
    return sum(part**2 for part in parts), sum(parts), bounds.k_beta1 + bounds.h_M * k_theta


def learned_limits(study: Study, law: SpaceLearning, scenarios: Iterable[Scenario]) -> tuple[float, ...]:
    """Limits of alpha, beta and h in the law's frame: as given, or as they follow from the current limit."""
    limit, ratio = study.drive.current_loop.current_limit, law.ratio(study.motor.pole_pairs)
    scenarios = list(scenarios)
    speed = ratio * max(s.top_reference for s in scenarios)
    acceleration = ratio * max(s.top_acceleration for s in scenarios)
    limits = (
        law.alpha_limit or limit,
        law.beta_limit or limit / max(speed, RATE_FLOOR),
        law.h_limit or limit / max(acceleration, RATE_FLOOR),
    )
    return tuple(limits[n] if n < law.channels else 0.0 for n in range(3))


def worst(several: list[Bounds | None]) -> Bounds | None:
    """Bounds that hold for all in `several`; None if one of them is None."""
    all_ = [dataclasses.asdict(one) for one in several if one is not None]
    if len(all_) < len(several):
        return None
    return Bounds(**{key: (min if key == "h_m" else max)(b[key] for b in all_) for key in all_[0]})


def _in_scenario(study: Study, key: str) -> list[AngleFunctions]:
    """Angle functions in a scenario, for its smallest and for its largest load torque."""
    study_here = for_scenario(study, key)
    experiment = study_here.scenario[key]
    load = experiment.load or study_here.mechanics.load
    levels = [load.torque, *(event.load for event in experiment.events)]
    by_time = load.time_table.torque if load.time_table else (0.0,)
    extremes = {min(levels) + min(by_time), max(levels) + max(by_time)}
    return [angle_functions(study_here.motor.star(), study_here.mechanics, load, level) for level in extremes]


def _in_the_way(
    study: Study,
    name: str,
    law: SpacePosition | SpaceSpeed,
    functions: list[AngleFunctions],
    bounds: Bounds | None,
    motion: Motion,
) -> list[str]:
    """Assumptions of the theorem that a controller and its scenarios don't meet, in words."""
    obstacles = [reason] if (reason := _unfit(study, law, functions)) else []
    if not law.mu_alpha:
        obstacles.append("it does not learn alpha")
    if law.q_half_width:
        obstacles.append("its Q filter forgets a part of what it learned")
    if not study.drive.ideal:
        obstacles.append("the current loop isn't ideal")
    if isinstance(law, SpaceSpeed) and motion.slowest <= law.eta_bar:
        obstacles.append(f"eta_bar isn't below the slowest reference, {motion.slowest:.3g} rad/s")
    if isinstance(law, SpacePosition) and motion.slowest <= 0:
        obstacles.append(f"the reference's least speed is {motion.slowest:.3g} rad/s, not above zero")
    if isinstance(law, SpacePosition) and not law.hand_over and position_gains(study, name)[2] > 0:
        obstacles.append("its integral action stays on")
    if isinstance(law, SpacePosition) and law.index == "rotor":
        obstacles.append("it learns over the rotor's angle")
    if motion.top_acceleration > 0:
        friction = bounds is not None and bounds.k_beta1 > 0
        missing = ["mu_beta"] if friction and not law.mu_beta else []
        missing += [] if law.mu_h else ["mu_h"]
        if missing:
            are = "are" if len(missing) > 1 else "is"
            obstacles.append(f"the speed varies, but {' and '.join(missing)} {are} zero")
    if bounds is not None:
        obstacles += _tight_limits(study, law, bounds)
    return obstacles


def unfit(study: Study, name: str) -> str | None:
    """Warning that motor or load doesn't repeat with the learning period in a scenario; None if they do."""
    law = study.controller[name]
    if not isinstance(law, SpaceLearning) or not law.learning:
        return None
    functions = [function for key in study.scenarios_of(name) for function in _in_scenario(study, key)]
    return _unfit(study, law, functions)


def _unfit(study: Study, law: SpaceLearning, functions: list[AngleFunctions]) -> str | None:
    revolutions = law.period.revolutions(study.motor.pole_pairs)
    others = sorted(
        {n for function in functions for n in function.orders if (n * revolutions).denominator != 1}
    )
    lacks = f"its period, {revolutions} of a revolution, holds no whole number of waves of order"
    return f"{lacks} {others[0]}" if others else None


def _tight_limits(study: Study, law: SpacePosition | SpaceSpeed, bounds: Bounds) -> list[str]:
    """Messages on limits below the bounds of the learned functions; beta and h are in the law's frame."""
    ratio = law.ratio(study.motor.pole_pairs)
    asked = (bounds.k_alpha1, bounds.k_beta1 / ratio, bounds.h_M / ratio)
    limits = learned_limits(study, law, study.scenario.values())
    keys = ("alpha_limit", "beta_limit", "h_limit")
    return [
        f"{key} is {limit:.3g}, less than the bound {least:.3g}"
        for key, limit, least in list(zip(keys, limits, asked, strict=True))[: law.channels]
        if limit < least
    ]


def _changing_loads(study: Study, keys: list[str]) -> list[str]:
    """The reason why the load isn't a function of the angle, if it changes with time in a scenario."""
    for key in keys:
        scenario = study.scenario[key]
        if scenario.events or (scenario.load or study.mechanics.load).time_table:
            return [f"the load changes with time in scenario {key}"]
    return []


def _either(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
