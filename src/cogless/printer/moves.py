"""Straight moves of a carriage: position and speed over time, as the planner of a firmware makes them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.printer.axis import Axis
from cogless.printer.records import Numbers


@dataclass(frozen=True)
class Move:
    """A move from rest to rest at constant acceleration: a trapezoid of speed, or a triangle. m, s."""

    length: float
    speed: float
    acceleration: float

    @property
    def top_speed(self) -> float:
        """The highest speed of the move, m/s."""
        return min(self.speed, math.sqrt(self.length * self.acceleration))

    @property
    def ramp_time(self) -> float:
        return self.top_speed / self.acceleration

    @property
    def cruise_time(self) -> float:
        return self.length / self.top_speed - self.ramp_time

    @property
    def duration(self) -> float:
        return 2 * self.ramp_time + self.cruise_time

    def speed_at(self, t: Numbers) -> Numbers:
        """The speed at these times since the start, m/s."""
        ends = np.minimum(t, self.duration - t)
        return np.asarray(np.clip(self.acceleration * ends, 0.0, self.top_speed))

    def position_at(self, t: Numbers) -> Numbers:
        """The way at these times since the start, m."""
        rise = np.clip(t, 0.0, self.ramp_time)
        cruise = np.clip(t - self.ramp_time, 0.0, self.cruise_time)
        fall = np.clip(t - self.ramp_time - self.cruise_time, 0.0, self.ramp_time)
        way = 0.5 * self.acceleration * (rise**2 - fall**2) + self.top_speed * (cruise + fall)
        return np.asarray(way)


def ramp(axis: Axis) -> Move:
    """The move along the axis's whole travel that rises to the ramp speed at the middle, and falls again."""
    return Move(axis.travel, axis.ramp_speed, axis.ramp_speed**2 / axis.travel)
