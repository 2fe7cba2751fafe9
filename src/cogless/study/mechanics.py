"""Mechanics that the motor turns: inertia, friction and load."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from cogless.study.table import (
    Angle,
    Inertia,
    Many,
    Table,
    Time,
    Torque,
    TorqueMagnitude,
    ViscousFriction,
    invalid,
)


class LoadHarmonic(Table):
    """A part of the load torque: torque sin(order theta_m + phase), with theta_m the mechanical angle."""

    order: Annotated[int, Field(ge=1, le=10_000)]
    torque: Torque  # N*m
    phase: Angle = 0.0  # rad


class AngleTable(Table):
    """Torque over the mechanical angle, linear between points, periodic in one revolution."""

    angle: Many[Angle]  # rad
    torque: Many[Torque]  # N*m

    @model_validator(mode="after")
    def _shape(self) -> Self:
        check_table("angle", self.angle, self.torque)
        if self.angle[-1] - self.angle[0] >= 2 * math.pi * (1 - 1e-9):
            raise invalid("expected less than one revolution from the first to the last angle", "angle")
        return self


class TimeTable(Table):
    """Torque over time, linear between points, constant before the first and after the last point."""

    time: Many[Time]  # s
    torque: Many[Torque]  # N*m

    @model_validator(mode="after")
    def _shape(self) -> Self:
        check_table("time", self.time, self.torque)
        return self


def check_table(axis: str, points: Sequence[float], values: Sequence[float]) -> None:
    """Refuse a table without points, with points that don't increase, or without one value per point."""
    if not points or any(b <= a for a, b in pairwise(points)):
        raise invalid("expected one or more values, each above the one before", axis)
    if len(points) != len(values):
        raise invalid(f"expected as many values as {axis} has, {len(points)}", "torque")


class Load(Table):
    """A load torque, the sum of its parts. The constant part follows its set value with a first-order lag."""

    torque: Torque = 0.0  # N*m
    lag: Time = 0.0  # s
    harmonics: Many[LoadHarmonic] = ()
    angle_table: AngleTable | None = None
    time_table: TimeTable | None = None

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        return data if isinstance(data, dict) else {"torque": data}


class Mechanics(Table):
    """Inertia, friction and load of everything that turns with the rotor."""

    inertia: Inertia  # kg*m^2, rotor and load together
    viscous_friction: ViscousFriction = 0.0  # N*m*s/rad
    coulomb_friction: TorqueMagnitude = 0.0  # N*m
    breakaway_friction: TorqueMagnitude | None = None  # N*m, default: coulomb_friction
    load: Load = Load()

    @model_validator(mode="after")
    def _breakaway(self) -> Self:
        if self.breakaway_friction is not None and self.breakaway_friction < self.coulomb_friction:
            raise invalid("expected no less than coulomb_friction", "breakaway_friction")
        return self
