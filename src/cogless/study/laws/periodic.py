"""Keys of the laws that learn over a period: PI-ILC and robust ILC (Liu 2018)."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from cogless.study.laws.law import AutoTuning, Feedback, LawLoop, Learning
from cogless.study.table import (
    AccelerationGain,
    CurrentToAcceleration,
    NumberGain,
    RateGain,
    RateGainPerTime,
    SpeedGain,
)

PERIODIC = {"lead": 0.0, "cells": 1024, "q_half_width": 0, "period": "mechanical"}


class PiIlc(Feedback, Learning):
    """PI with P-type iterative learning (Liu 2018, law 29)."""

    law: Literal["pi-ilc"]
    """PI with iterative learning of P type."""
    gain: SpeedGain  # A*s/rad
    """Learning gain: change of the learned current from one period to the next, per speed error."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {"gain": 0.0, **PERIODIC}
    LEARNING_GAINS: ClassVar[tuple[str, ...]] = ("gain",)

    @property
    def missing_feedback(self) -> str | None:
        return "kp" if self.gain > 0 and self.kp == 0 else None

    @property
    def learning_gain(self) -> tuple[float, float]:
        return self.gain, 0.0

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        return {"pi": self.pi_config(loop), "gain": self.gain, "memory": self.memory_config(loop)}


class RobustIlc(Learning):
    """Robust iterative learning by adaptive sliding mode (Liu 2018, law 19)."""

    law: Literal["robust-ilc"]
    """Robust ILC by adaptive sliding mode."""
    b: CurrentToAcceleration  # rad/s^2/A
    """Acceleration per current that the controller assumes: $K_t / J$, the torque constant divided by the
    inertia."""
    c: RateGain  # 1/s
    """Slope $c$ of the sliding surface $S$ ([equations](/laws/robust-ilc.md#equations))."""
    g: AccelerationGain  # rad/s^2
    r"""Gain $g$ of the switching term $g\,\mathrm{sgn}\,S$, with the sliding surface $S$
    ([equations](/laws/robust-ilc.md#equations))."""
    eta: RateGain  # 1/s
    r"""Gain $\eta$ of the linear term $\eta S$, with the sliding surface $S$
    ([equations](/laws/robust-ilc.md#equations))."""
    q: NumberGain
    r"""Learning rate $q$ of the learned acceleration $\hat f$
    ([equations](/laws/robust-ilc.md#equations))."""
    beta_1: AccelerationGain  # rad/s^2
    r"""Weight $\beta_1$ of $\mathrm{sgn}\,S$ in learning, with the sliding surface $S$
    ([equations](/laws/robust-ilc.md#equations))."""
    beta_2: RateGain  # 1/s
    r"""Weight $\beta_2$ of $S$ in learning, with the sliding surface $S$
    ([equations](/laws/robust-ilc.md#equations))."""
    gamma: RateGainPerTime  # 1/s^2
    r"""Adaptation rate $\gamma$ of the load estimate $\hat r$
    ([equations](/laws/robust-ilc.md#equations))."""
    viscous: RateGain = 0.0  # 1/s
    """Viscous part of the friction that the controller assumes, as deceleration per speed."""
    coulomb: AccelerationGain = 0.0  # rad/s^2
    """Coulomb part of the friction that the controller assumes, as a deceleration."""
    tuning: AutoTuning | None = None
    """`{ rule = "auto" }`: [a rule](/laws/auto.md) computes each number of the law that the controller's
    table leaves out. Default: no rule."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {
        **dict.fromkeys(("c", "g", "eta", "q", "beta_1", "beta_2", "gamma"), 0.0),
        "b": 1.0,
        **PERIODIC,
    }
    LEARNING_GAINS: ClassVar[tuple[str, ...]] = ("beta_1", "beta_2")

    @property
    def missing_feedback(self) -> str | None:
        return "eta" if self.q * self.beta_2 > 0 and self.c + self.eta == 0 else None

    @property
    def learns_by_switching(self) -> bool:
        return True

    @property
    def linear(self) -> tuple[float, float]:
        """kp and ki of the feedback (c e + eta S) / b with S = e + c integral(e), e the speed error."""
        return (self.c + self.eta) / self.b, self.c * self.eta / self.b

    @property
    def learning_gain(self) -> tuple[float, float]:
        """Learning gains on e and integral(e), since the memory f learns from S = e + c integral(e)."""
        gain = self.q * self.beta_2 / self.b
        return gain, gain * self.c

    @property
    def unit(self) -> float:
        return -self.b

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        same = {"b", "c", "g", "eta", "q", "beta_1", "beta_2", "gamma", "viscous", "coulomb"}
        memory = self.memory_config(loop)
        return {**self.model_dump(include=same), "limit": loop.current_limit, "memory": memory}
