"""Faults must be of something that the drive has, and last long enough to be measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cogless.study.fault import BusFault, CurrentFault, FaultBase
from cogless.study.table import Key, invalid

if TYPE_CHECKING:
    from cogless.study.study import Study


def faults(study: Study) -> None:
    """Refuse faults of what isn't measured (currents and bus of an ideal loop, a phase), or too short."""
    drive = study.drive
    for name, scenario in study.scenario.items():
        for index, fault in enumerate(scenario.faults):
            where = ("scenario", name, "faults", index)
            if drive.ideal and isinstance(fault, CurrentFault | BusFault):
                expected = "expected a fault of the angle: an ideal current loop measures no more"
                raise invalid(expected, *where, "kind")
            if isinstance(fault, CurrentFault) and fault.phase not in _measured(study):
                expected = f"expected one of the measured phases {', '.join(_measured(study))}"
                raise invalid(expected, *where, "phase")
            _measured_once(study, scenario.duration, fault, where)


def _measured_once(study: Study, end: float, fault: FaultBase, where: Key) -> None:
    """Measurements come once a period of the current loop: one at least must show the fault."""
    rate = study.drive.rates.current_loop
    period = f"{1 / rate:g} s, one period of the measurements"
    if fault.duration * rate < 1 - 1e-9:
        raise invalid(f"expected {period}, or more", *where, "duration")
    if round(fault.time * rate) >= round(end * rate):
        expected = f"expected a time before the scenario's {end:g} s by {period}, or more"
        raise invalid(expected, *where, "time")


def _measured(study: Study) -> str:
    two = study.motor.star().phases == 2 or study.drive.current_sensors.sensors == 2
    return "ab" if two else "abc"
