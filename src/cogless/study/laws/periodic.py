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
    """PI with P-type learning."""
    gain: SpeedGain  # A*s/rad
    """Gain with which the law learns from the speed error."""

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
    """Acceleration per current, $K_t / J$, that the controller assumes."""
    c: RateGain  # 1/s
    """Slope of the sliding surface."""
    g: AccelerationGain  # rad/s^2
    """Switching gain."""
    eta: RateGain  # 1/s
    """Linear reaching gain."""
    q: NumberGain
    """Learning rate."""
    beta_1: AccelerationGain  # rad/s^2
    """Weight of sgn S in learning."""
    beta_2: RateGain  # 1/s
    """Weight of S in learning."""
    gamma: RateGainPerTime  # 1/s^2
    """Adaptation rate."""
    viscous: RateGain = 0.0  # 1/s
    """Viscous part of the known friction."""
    coulomb: AccelerationGain = 0.0  # rad/s^2
    """Coulomb part of the known friction."""
    tuning: AutoTuning | None = None
    """`{ rule = "auto" }`: computes the keys that are left out of this table, see [](/laws/auto.md)."""

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
