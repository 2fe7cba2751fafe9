"""Laws that learn over the angle (Verrelli 2016): for position law (6) and its sampled form, for speed law
(4)."""

from __future__ import annotations

from fractions import Fraction
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from cogless import units
from cogless.study.laws.law import AutoTuning, Cells, LawLoop, LearnsWhileRunning, Tuning, check_cells
from cogless.study.table import (
    CurrentBound,
    LawSpeed,
    Quantity,
    RateGain,
    SpeedGain,
    SpeedIntegralGain,
    StartTime,
    Table,
    invalid,
)

NEVER = 1e18  # s
Whole = Annotated[int, Field(ge=1, le=65535)]


class Period(Table):
    """The period of what is learned: turns / parts of an electrical or mechanical revolution."""

    of: Literal["electrical", "mechanical"] = "electrical"
    turns: Whole = 1
    parts: Whole = 1

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the period in mechanical revolutions."""
        return Fraction(self.turns, self.parts * (pole_pairs if self.of == "electrical" else 1))


class SpaceLearning(LearnsWhileRunning):
    """The memory of a law that learns over the angle."""

    learning: bool = True
    period: Period = Period()
    memory: Literal["map", "delay"] = "map"  # map over the angle, or delay line over time; P_t is its delay
    delay_method: Literal["ode", "inversion"] = "ode"  # how P_t is found
    k_pp: Annotated[float, Quantity(units.RATE, ">", bare=True)] = 10.0  # 1/s, gain of the ODE for P_t
    cells: Cells = 1024  # cells of the map; samples of the delay line's longest period
    q_half_width: Annotated[int, Field(ge=0)] = 5  # cells, or samples, on each side of the Q filter; 0: none
    # learning gains of alpha, beta and h; a rad in their units is of the angle that the law uses
    mu_alpha: Annotated[float, Quantity(units.CURRENT, ">=", bare=True)] = 0.0  # A
    mu_beta: Annotated[float, Quantity(units.SPEED_LEARNING, ">=", bare=True)] = 0.0  # A*s^2/rad^2
    mu_h: Annotated[float, Quantity(units.ACCELERATION_LEARNING, ">=", bare=True)] = 0.0  # A*s^4/rad^2
    alpha_limit: CurrentBound | None = None  # A; default: the current limit
    # A*s/rad; default: the current limit over the reference's top speed
    beta_limit: Annotated[float, Quantity(units.SPEED_GAIN, ">", bare=True)] | None = None
    # A*s^2/rad; default: the current limit over the reference's top acceleration
    h_limit: Annotated[float, Quantity(units.CURRENT_PER_ACCELERATION, ">", bare=True)] | None = None
    omega_min: LawSpeed = 0.01  # rad/s, mechanical: below it learning pauses, but the learned part stays on

    @model_validator(mode="after")
    def _cells_fit(self) -> Self:
        check_cells(self.cells, self.q_half_width, self.memory == "delay")
        return self

    @model_validator(mode="after")
    def _learns_something(self) -> Self:
        if self.learning and not (self.mu_alpha or self.mu_beta or self.mu_h):
            raise invalid("expected false, or a learning gain: mu_alpha, mu_beta or mu_h", "learning")
        return self

    @property
    def learns(self) -> bool:
        return self.learning

    @property
    def learns_from(self) -> float:
        return super().learns_from if self.learning else NEVER

    @property
    def over_angle(self) -> bool:
        """Whether the memory is a map over the angle; if not, it is a delay line over time."""
        return self.memory == "map"

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""
        return self.period.revolutions(pole_pairs)

    @property
    def channels(self) -> int:
        """Number of learned functions of the angle: 1 is alpha, 2 adds beta, 3 adds h."""
        return 3 if self.mu_h else 2 if self.mu_beta else 1

    def memory_config(self, loop: LawLoop) -> dict[str, Any]:
        """Members of the C struct cgl_memory_config."""
        period = self.ratio(loop.pole_pairs) * self.revolutions(loop.pole_pairs)
        limits = (self.alpha_limit, self.beta_limit, self.h_limit)
        return {
            "kind": "CGL_MEMORY_ANGLE" if self.over_angle else "CGL_MEMORY_DELAY",
            "channels": self.channels,
            "cells": self.cells,
            "turns": period.numerator,
            "parts": period.denominator,
            "q_half_width": self.q_half_width,
            "lead": 0,
            "forgetting": 1.0,
            "limit": limits[: self.channels],
            "method": f"CGL_DELAY_{self.delay_method.upper()}",
            "k_pp": self.k_pp,
        }


MECHANICAL = {"period": {"of": "mechanical"}, "mu_alpha": 1.0, "cells": 1024, "q_half_width": 0}


class SpacePosition(SpaceLearning):
    """Position control that learns in angle, with hand-over from integral action (Verrelli 2016, law 6)."""

    law: Literal["space-position"]
    frame: Literal["electrical", "mechanical"] = "electrical"  # of the angle that the gains multiply
    k_theta: RateGain | None = None  # 1/s
    k_omega: SpeedGain | None = None  # A*s/rad
    k_i: SpeedIntegralGain = 0.0  # A/rad, until learning takes over
    tuning: Tuning | None = None  # in place of k_theta, k_omega and k_i
    k_v: SpeedIntegralGain = 0.0  # A/rad
    v_0: SpeedGain = 0.0  # A*s/rad
    v_2: Annotated[float, Quantity(units.CUBIC_SPEED_GAIN, ">=", bare=True)] = 0.0  # A*s^3/rad^3
    hand_over: bool = True  # integral action fades out as learning fades in
    ramp: StartTime = 1.0  # s
    index: Literal["reference", "rotor"] = "reference"  # the angle that the memory is over

    AUTOMATIC: ClassVar[dict[str, Any]] = {"frame": "mechanical", "hand_over": False, **MECHANICAL}

    @property
    def holds_position(self) -> bool:
        return True

    @model_validator(mode="after")
    def _gains_or_rule(self) -> Self:
        given = (self.k_theta is not None, self.k_omega is not None)
        if given not in ((True, True), (False, False)) or all(given) == (self.tuning is not None):
            rule = '{ rule = "phase-margin", phase_margin = "60 deg" }'
            raise invalid(f"expected either k_theta and k_omega or tuning, such as {rule}")
        return self

    @property
    def by_rotor(self) -> bool:
        return self.index == "rotor"

    def ratio(self, pole_pairs: int) -> int:
        return pole_pairs if self.frame == "electrical" else 1

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        same = {"k_theta", "k_omega", "k_i", "k_v", "v_0", "v_2", "mu_alpha", "mu_beta", "mu_h"}
        return {
            **self.model_dump(include=same | {"hand_over", "ramp", "omega_min"}),
            "ratio": self.ratio(loop.pole_pairs),
            "index": f"CGL_SPACE_BY_{self.index.upper()}",
            "limit": loop.current_limit,
            "memory": self.memory_config(loop),
        }


class SpaceSpeed(SpaceLearning):
    """Speed control that learns in angle (Verrelli 2016, law 4); all of its quantities are mechanical."""

    law: Literal["space-speed"]
    k: SpeedGain  # A*s/rad
    eta_bar: LawSpeed  # rad/s: learning pauses while the speed error is larger
    tuning: AutoTuning | None = None  # in place of the gains

    AUTOMATIC: ClassVar[dict[str, Any]] = {"k": 0.0, "eta_bar": 1.0, **MECHANICAL}

    @property
    def linear(self) -> tuple[float, float]:
        return self.k, 0.0

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        same = {"k", "mu_alpha", "mu_beta", "mu_h", "eta_bar", "omega_min"}
        return {
            **self.model_dump(include=same),
            "limit": loop.current_limit,
            "ratio": self.ratio(loop.pole_pairs),
            "memory": self.memory_config(loop),
        }
