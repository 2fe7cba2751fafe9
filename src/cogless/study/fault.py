"""Faults of sensors and supply voltage in a scenario, each for a limited time."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from cogless.study.table import Angle, Duration, Table, Time, Voltage


class FaultBase(Table):
    """A fault: the keys that every kind has."""

    time: Time  # s, when it begins
    duration: Duration  # s

    @property
    def end(self) -> float:
        """End of the fault, s."""
        return self.time + self.duration


class AngleFault(FaultBase):
    """The position sensor gives no number, or keeps giving the last angle."""

    kind: Literal["angle-missing", "angle-stuck"]

    @property
    def words(self) -> str:
        return "position sensor gives no number" if self.kind == "angle-missing" else "position sensor stuck"


class AngleJump(FaultBase):
    """The position sensor's angle has a constant error."""

    kind: Literal["angle-jump"]
    angle: Angle  # rad, mechanical

    @property
    def words(self) -> str:
        return f"position sensor off by {math.degrees(self.angle):.3g}°"


class CurrentFault(FaultBase):
    """The current sensor of a phase gives no number, or zero."""

    kind: Literal["current-missing", "current-zero"]
    phase: Literal["a", "b", "c"]

    @property
    def words(self) -> str:
        reads = "gives no number" if self.kind == "current-missing" else "reads zero"
        return f"current sensor of phase {self.phase} {reads}"


class BusFault(FaultBase):
    """The bus has another voltage, and the controller measures it."""

    kind: Literal["bus-voltage"]
    voltage: Voltage  # V

    @property
    def words(self) -> str:
        return f"bus at {self.voltage:.3g} V"


Fault = Annotated[AngleFault | AngleJump | CurrentFault | BusFault, Field(discriminator="kind")]
