"""Faults must be of something that the drive has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cogless.study.fault import BusFault, CurrentFault
from cogless.study.table import problem

if TYPE_CHECKING:
    from cogless.study.study import Study


def faults(study: Study) -> None:
    """No fault of currents or bus with an ideal current loop, none of a phase that isn't measured."""
    drive = study.drive
    for name, scenario in study.scenario.items():
        for index, fault in enumerate(scenario.faults):
            where = ("scenario", name, "faults", index)
            if drive.ideal and isinstance(fault, CurrentFault | BusFault):
                expected = "expected a fault of the angle: an ideal current loop measures no more"
                raise problem(expected, *where, "kind")
            if isinstance(fault, CurrentFault) and fault.phase not in _measured(study):
                expected = f"expected one of the measured phases {', '.join(_measured(study))}"
                raise problem(expected, *where, "phase")


def _measured(study: Study) -> str:
    two = study.motor.star().phases == 2 or study.drive.current_sensors.sensors == 2
    return "ab" if two else "abc"
