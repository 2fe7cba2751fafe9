"""Keys of the law "anti-cogging" in a study, with the slow run that fills its table."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from cogless.study.laws.law import MOST_CELLS, Feedback, LawLoop, Startable
from cogless.study.table import LawSpeed, RateGain, StartTime, Table, invalid
from cogless.units import TURN

SETTLING = 1 / 8  # revolutions in each direction before a commissioning run begins to record


class Commissioning(Table):
    """The slow run, forwards and backwards, that fills an anti-cogging table."""

    speed: LawSpeed  # rad/s
    """Speed of the run."""
    revolutions: Annotated[int, Field(ge=1, le=100)] = 1
    """Recorded revolutions in each direction."""
    position_gain: RateGain  # 1/s
    """Gain that holds the rotor to the angle of the run's reference."""

    @property
    def duration(self) -> float:
        """Duration of the commissioning run, s."""
        return 2 * (self.revolutions + SETTLING) * TURN / self.speed


NOT_FILLED = (
    'expected calibration = { speed = "6 rpm", position_gain = "20 1/s" }, tuning = { rule = "auto" }, which '
    "gives one, or a start"
)


UNUSED = Commissioning(speed=1.0, position_gain=0.0)


class AntiCogging(Feedback, Startable):
    """PI with a current table over the mechanical angle, learned in a commissioning run or before."""

    law: Literal["anti-cogging"]
    """PI and an anti-cogging table."""
    cells: Annotated[int, Field(ge=4, le=MOST_CELLS)] = 720
    """Entries of the table over a mechanical revolution."""
    lead: StartTime = 0.0  # s
    """The table is looked up at the angle that the rotor will have after this time. This compensates the
    current loop's lag."""
    calibration: Commissioning | None = None
    """The run that fills the table; give this or `start`."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {
        "cells": 720,
        "lead": 0.0,
        "calibration": {"speed": 1.0, "position_gain": 0.0},
    }

    @model_validator(mode="after")
    def _filled_once(self) -> Self:
        if (self.calibration is None) == (self.start is None):
            raise invalid(NOT_FILLED if self.start is None else "expected a calibration or a start, not both")
        return self

    @property
    def learned(self) -> bool:
        return True

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        run = (self.calibration or UNUSED).model_dump()
        return {"pi": self.pi_config(loop), "cells": self.cells, "lead": self.lead, **run}
