"""An axis of a printer, as its file says: motor, pulley, belt, and the moves that its bed has room for.

Lengths and speeds are the carriage's. The electrical angle u of the command grows by one turn a wavelength;
the motor's tooth count N is the number of electrical turns a revolution.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from cogless import units
from cogless.study.messages import problems, study_error
from cogless.study.motor import teeth_of
from cogless.study.reading import read
from cogless.study.table import (
    CurrentLimit,
    Frequency,
    Length,
    Many,
    PositiveTorque,
    Quantity,
    Span,
    Table,
    invalid,
)
from cogless.units import Dimension

CARRIAGE_SPEED = Dimension("a speed", "m/s", "mm/s")
StartPlace = Annotated[float, Quantity(units.LENGTH, ">=")]
Speed = Annotated[float, Quantity(CARRIAGE_SPEED, ">")]

DIAGONAL = math.sqrt(0.5)
PULLEY_TEETH_LEAST = 4


class Axis(Table):
    """A motor of a printer and what it moves. Torque and current of the datasheet give friction in N m."""

    motor: Literal["x", "y"]
    kinematics: Literal["cartesian", "corexy"] = "cartesian"
    step_angle: Span  # rad
    pulley_teeth: Annotated[int, Field(ge=PULLEY_TEETH_LEAST)]
    belt_pitch: Length = 2e-3  # m
    current: CurrentLimit  # A rms, as the firmware has it
    travel: Length  # m of free straight way, along which the motor alone moves the carriage
    start_x: StartPlace  # m, where a forward move begins
    start_y: StartPlace  # m
    ramp_speed: Speed = 0.2  # m/s at the middle of a ramp
    speeds: Many[Speed] = (0.04,)  # m/s of the runs at a constant speed
    resonances: Many[Frequency] = ()  # Hz
    holding_torque: PositiveTorque | None = None  # N m, both coils at the rated current
    rated_current: CurrentLimit | None = None  # A

    @model_validator(mode="after")
    def _whole_teeth(self) -> Axis:
        if not teeth_of(self.step_angle):
            raise invalid(
                'expected 360 deg divided by four times the number of teeth, such as "1.8 deg"', "step_angle"
            )
        if (self.holding_torque is None) != (self.rated_current is None):
            raise invalid("expected it together with rated_current", "holding_torque", value="alone")
        return self

    @property
    def rotor_teeth(self) -> int:
        return teeth_of(self.step_angle)

    @property
    def path_share(self) -> float:
        """Way of the carriage / way of the belt. In CoreXY, one motor alone moves along a diagonal."""
        return DIAGONAL if self.kinematics == "corexy" else 1.0

    @property
    def wavelength(self) -> float:
        """The carriage's way in an electrical turn, m."""
        return self.pulley_teeth * self.belt_pitch / self.rotor_teeth * self.path_share

    @property
    def direction(self) -> tuple[float, float]:
        """Unit vector of the carriage's way in x and y when the motor turns forward."""
        if self.kinematics == "corexy":
            return DIAGONAL, DIAGONAL if self.motor == "x" else -DIAGONAL
        return (1.0, 0.0) if self.motor == "x" else (0.0, 1.0)

    @property
    def torque_at_current(self) -> float | None:
        """T_h: the largest torque against a deflection, at the firmware's rms current, N m.

        A datasheet's holding torque is that of both coils at the rated DC current, sqrt(2) times the torque
        of one coil. The firmware's peak current is sqrt(2) times its rms. The two factors cancel.
        """
        if self.holding_torque is None or self.rated_current is None:
            return None
        return self.holding_torque * self.current / self.rated_current


class PrinterFile(Table):
    """A file that describes an axis of a printer."""

    printer: Axis


def read_axis(path: Path) -> Axis:
    """Read the axis of a file. StudyError names the file, the key, the value and what was expected."""
    tables = read(path)
    try:
        return PrinterFile.model_validate(tables).printer
    except ValidationError as error:
        raise study_error([problem.line(path) for problem in problems(error, tables)]) from None
