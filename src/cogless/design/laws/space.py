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

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.closed_loop import Linear
from cogless.design.learning_loop import LearningLoop
from cogless.study.base import speed_text
from cogless.study.laws.space import SpacePosition, SpaceSpeed
from cogless.units import TURN

ANGLES = np.linspace(0, TURN, 720, endpoint=False)


class SpaceLoop(LearningLoop):
    """A law that learns in angle, at a speed and an acceleration."""

    @property
    def law(self) -> SpacePosition | SpaceSpeed:
        law = self.study.controller[self.controller]
        if not isinstance(law, SpacePosition | SpaceSpeed):
            raise TypeError(f"controller {self.controller}: expected space-position or space-speed")
        return law

    @property
    def gamma(self) -> tuple[float, float]:
        ratio = self.law.ratio(self.study.motor.pole_pairs)
        omega, a = abs(ratio * self.omega_m), ratio * self.alpha_m
        return (self.law.mu_alpha + self.law.mu_beta * omega**2 + self.law.mu_h * a**2) / omega, 0.0

    @property
    def doubt(self) -> str | None:
        if not isinstance(self.law, SpaceSpeed) or self.scenario is None:
            return None
        needed = functions_in(self.study, self.scenario).current(ANGLES, abs(self.omega_m))
        error = float(np.max(np.abs(needed))) / self.law.k
        if error <= self.law.eta_bar:
            return None
        leaves = f"k alone leaves an error of up to {speed_text(self.study, error)}"
        return f"{leaves}, above eta_bar: it may never learn"

    @cached_property
    def feedback(self) -> Linear:
        """The linear feedback while the law learns: without the integral if the law has `hand_over`."""
        law, before = self.law, self.feedback_before
        handed = isinstance(law, SpacePosition) and law.hand_over
        return dataclasses.replace(before, k_i=0.0) if handed else before
