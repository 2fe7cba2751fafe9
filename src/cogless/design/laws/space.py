"""Learning in angle at one speed (Verrelli 2016), as a learning loop: docs/theory/learning-in-angle.md.

At speed omega and acceleration a in the law's frame, the law learns i_hat_k = Q i_hat_{k-1} - mu omega_t,
where omega_t is the error that it feeds back. The learning gains of (6) belong to functions that multiply 1,
omega and a. At one speed they act as a single gain:

    mu = mu_alpha / |omega| + mu_beta |omega| + mu_h a^2 / |omega|

C is k_omega + v, plus the integral unless the law has `hand_over`. For law (4), G = P_omega and C = k.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import ClassVar, Generic, TypeVar, cast

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.auto import (
    GAIN_MARGIN,
    frequency_grid,
    gain_and_filter,
    loops_in_corners,
    map_cells,
    numbers_by_hand,
    phase_margin_gains,
    scenarios_tuned_for,
    with_numbers,
)
from cogless.design.changes import unit_text
from cogless.design.closed_loop import Linear
from cogless.design.law_rules import Gain, LawRules, Values
from cogless.design.laws.space_bounds import (
    Theorem,
    feedback_at,
    learned_limits,
    position_gains,
    theorem,
    unfit,
)
from cogless.design.learning_loop import LearningLoop, fastest_over_period
from cogless.study import Study
from cogless.study.base import speed_text
from cogless.study.laws.law import Memory
from cogless.study.laws.space import MECHANICAL, SpaceLearning, SpacePosition, SpaceSpeed
from cogless.study.messages import dotted
from cogless.study.reading import Changes
from cogless.units import TURN

CURRENT_ANGLES = np.linspace(0, TURN, 720, endpoint=False)


class SpaceLoop(LearningLoop):
    """A law that learns in angle, at a speed and an acceleration."""

    RISES_AT_REST: ClassVar[bool] = True

    @property
    def law(self) -> SpacePosition | SpaceSpeed:
        return cast("SpacePosition | SpaceSpeed", self.study.controller[self.controller])

    @property
    def gamma(self) -> tuple[float, float]:
        ratio = self.law.ratio(self.study.motor.pole_pairs)
        omega, a = abs(ratio * self.omega_m), ratio * self.alpha_m
        return (self.law.mu_alpha + self.law.mu_beta * omega**2 + self.law.mu_h * a**2) / omega, 0.0

    @property
    def doubt(self) -> str | None:
        if not isinstance(self.law, SpaceSpeed) or self.scenario is None:
            return None
        needed = functions_in(self.study, self.scenario).current(CURRENT_ANGLES, abs(self.omega_m))
        error = float(np.max(np.abs(needed))) / self.law.k
        if error <= self.law.eta_bar:
            return None
        leaves = f"the gain k alone leaves a speed error of up to {speed_text(self.study, error)}"
        return f"{leaves}. The law learns only below eta_bar, so it may never learn"

    @cached_property
    def feedback(self) -> Linear:
        """The linear feedback while the law learns: without the integral if the law has `hand_over`."""
        law, before = self.law, self.feedback_before
        handed = isinstance(law, SpacePosition) and law.hand_over
        return dataclasses.replace(before, k_i=0.0) if handed else before


S = TypeVar("S", bound=SpaceLearning)


class SpaceRules(LawRules[S], Generic[S]):
    """The rules of a law that learns functions of the angle."""

    @property
    def memory(self) -> Memory | None:
        return self.law if self.law.learning else None

    @property
    def loop(self) -> type[SpaceLoop] | None:
        return SpaceLoop if self.law.learning else None

    def fill(self, study_here: Study) -> Values:
        limits = learned_limits(self.study, self.law, study_here.scenario.values())
        return dict(zip(("alpha_limit", "beta_limit", "h_limit"), limits, strict=True))

    def fastest(self) -> float | None:
        return fastest_over_period(self.study, self.law, 0) if self.law.learning else None

    def never(self, scenario: str) -> str | None:
        fast = self.study.scenario[scenario].top_reference
        return "the reference never reaches omega_min" if fast < self.law.omega_min else None

    def unfit(self) -> str | None:
        return unfit(self.study, self.name)

    def theorem(self) -> Theorem | None:
        return theorem(self.study, self.name)


class SpaceSpeedRules(SpaceRules[SpaceSpeed]):
    """The rules of the law `space-speed`."""

    def slower(self, factor: float) -> Changes:
        return {f"{dotted(('controller', self.name))}.k": unit_text(self.law.k / factor, "A*s/rad")}

    def auto(self) -> Values:
        """k is the PI's kp; learning pauses while the error alone asks for all the current that there is."""
        study, name = self.study, self.name
        k = phase_margin_gains(study, name)[0]
        values = {"k": k, "eta_bar": study.drive.current_loop.current_limit / k} | numbers_by_hand(
            study, name
        )
        return values | _in_angle(with_numbers(study, name, values), name)


class SpacePositionRules(SpaceRules[SpacePosition]):
    """The rules of the law `space-position`."""

    def fill(self, study_here: Study) -> Values:
        gains = dict(zip(("k_theta", "k_omega", "k_i"), position_gains(self.study, self.name), strict=True))
        return super().fill(study_here) | gains

    def feedback(self, omega_m: float) -> Linear:
        return feedback_at(self.study, self.name, omega_m)

    def gains(self) -> dict[str, Gain]:
        units = ("k_theta", "1/s"), ("k_omega", "A*s/rad"), ("k_i", "A/rad")
        numbers = position_gains(self.study, self.name)
        return {key: Gain(number, unit) for (key, unit), number in zip(units, numbers, strict=True)}

    def slower(self, factor: float) -> Changes | None:
        k_theta, k_omega, k_i = position_gains(self.study, self.name)
        if self.law.tuning is not None:
            return None
        slower = {
            "k_theta": unit_text(k_theta / factor, "1/s"),
            "k_omega": unit_text(k_omega / factor, "A*s/rad"),
        }
        slower |= {"k_i": unit_text(k_i / factor**2, "A/rad")} if k_i else {}
        key = dotted(("controller", self.name))
        return {f"{key}.{gain}": value for gain, value in slower.items()}

    def auto(self) -> Values:
        """The integral stays on while the law learns: a load may change at any angle."""
        study, name = self.study, self.name
        values = {"frame": "mechanical", "hand_over": False} | numbers_by_hand(study, name)
        return values | _in_angle(with_numbers(study, name, values), name)


def _in_angle(study: Study, name: str) -> Values:
    """Map, gain, Q filter and omega_min of a law that learns over the angle and has no lead.

    If learning is off, these numbers have no effect, and the study's own stay.
    """
    law = study.controller[name]
    if not law.learns:
        return {key: value for key, value in law.AUTOMATIC.items() if key in MECHANICAL}
    map_ = {"cells": map_cells(study, name)} | _above(study, name)
    unit = list(loops_in_corners(SpaceLoop, with_numbers(study, name, map_ | {"mu_alpha": 1.0}), name))
    f = frequency_grid(unit)
    gain = 1 / max(float(np.max(np.abs(loop.x(f)))) for loop in unit)
    values = gain_and_filter(study, name, SpaceLoop, gain, lambda gain: map_ | {"mu_alpha": gain})
    return values | map_ | {"period": {"of": "mechanical"}}


def _above(study: Study, name: str) -> Values:
    """omega_min where a reference stops: a gain in 1 / |omega| can't settle at every speed that it passes.

    Learning rests below 1 / GAIN_MARGIN of the top speed: a sine turns 87 % of its angle above, a move 83 %.
    """
    scenarios = [study.scenario[key] for key in scenarios_tuned_for(study, name)]
    stop = [s.top_reference / GAIN_MARGIN for s in scenarios if s.top_reference and not s.slowest]
    if not stop or "omega_min" in study.source.tables["controller"][name]:
        return {}
    return {"omega_min": min([*stop, *(s.slowest for s in scenarios if s.slowest)])}
