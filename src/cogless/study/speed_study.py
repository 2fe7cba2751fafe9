"""A speed study: a drive, the controllers to compare, the scenarios that they run in, the metrics."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PrivateAttr

from cogless.study.base import StudyBase
from cogless.study.drive import Drive, StarBelief
from cogless.study.laws import Controller
from cogless.study.mechanics import Mechanics
from cogless.study.motor import AnyMotor
from cogless.study.scenario import Scenario


class Study(StudyBase):
    """A validated study, all SI. Made by `cogless.study.load`."""

    motor: AnyMotor
    """The motor."""
    mechanics: Mechanics
    """Inertia, friction and load."""
    drive: Drive
    """Inverter, sensors, rates, current loop."""
    scenario: Annotated[dict[str, Scenario], Field(min_length=1)]
    """Experiments by name, `[scenario.NAME]`."""
    controller: Annotated[dict[str, Controller], Field(min_length=1)]
    """Controllers by name; `[controller.NAME]`."""
    _scenarios: dict[str, Study] = PrivateAttr(default={})  # scenario -> study with its overrides applied

    @property
    def belief(self) -> StarBelief:
        """Motor parameters that the controller assumes, for the star equivalent."""
        return self.drive.belief.resolved(self.motor.star())

    @property
    def K_t(self) -> float:
        """Torque constant that the controller assumes, N*m/A."""
        motor = self.motor.star()
        return motor.power_factor * motor.pole_pairs * self.belief.psi_f

    @property
    def trace_rate(self) -> float:
        """Recorded rows per second, Hz."""
        return self.trace.rate or self.drive.rates.current_loop
