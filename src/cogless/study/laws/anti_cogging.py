"""Keys of the law "anti-cogging" in a study, with the slow run that fills its table."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from cogless.study.drive import TRACE_ROWS_MOST
from cogless.study.laws.law import MAP_CELLS_MOST, Commissioning, Feedback, LawLoop, Startable, StudyOfLaws
from cogless.study.table import StartTime, check_one, invalid

NOT_FILLED = (
    'expected calibration = { speed = "6 rpm", position_gain = "20 1/s" }, tuning = { rule = "auto" } '
    "or a start"
)


UNUSED = Commissioning(speed=1.0, position_gain=0.0)


class AntiCogging(Feedback, Startable):
    """PI with a current table over the mechanical angle, learned in a commissioning run or before."""

    law: Literal["anti-cogging"]
    """PI and an anti-cogging table, that is, a table of currents over the rotor's angle."""
    cells: Annotated[int, Field(ge=4, le=MAP_CELLS_MOST)] = 720
    """Number of entries of the anti-cogging table in a mechanical revolution."""
    lead: StartTime = 0.0  # s
    """The law reads the anti-cogging table at the angle that the rotor will have after this time. So it
    compensates the delay of the current loop."""
    calibration: Commissioning | None = None
    """Slow run before the scenario, which fills the anti-cogging table. Give `calibration` or `start`."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {
        "cells": 720,
        "lead": 0.0,
        "calibration": {"speed": 1.0, "position_gain": 0.0},
    }

    @model_validator(mode="after")
    def _filled_once(self) -> Self:
        check_one(self, ("calibration", "start"), NOT_FILLED)
        return self

    @property
    def learned(self) -> bool:
        return True

    @property
    def commissioning(self) -> Commissioning | None:
        return self.calibration

    def check(self, study: StudyOfLaws, name: str) -> None:
        """Check that the commissioning run isn't too long to simulate."""
        if self.calibration is None:
            return
        longest, takes = TRACE_ROWS_MOST / study.drive.rates.outer_loop, self.calibration.duration
        if takes > longest:
            expected = f"expected a run of at most {longest:.6g} s, not {takes:.3g} s"
            raise invalid(expected, "controller", name, "calibration", "speed")

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        run = (self.calibration or UNUSED).model_dump()
        return {"pi": self.pi_config(loop), "cells": self.cells, "lead": self.lead, **run}
