"""Check that a fault is in something that the drive has, and lasts long enough to be measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cogless.study.fault import BusFault, CurrentFault, FaultBase
from cogless.study.table import Key, invalid

if TYPE_CHECKING:
    from cogless.study.study import Study
    from cogless.study.trial_study import TrialStudy


def faults(study: Study | TrialStudy) -> None:
    """Refuse faults in something that the drive doesn't measure, and faults that are too short.

    An ideal current loop measures neither currents nor bus voltage. With two sensors, phase c isn't measured.
    """
    drive, motor = study.drive, study.motor
    for name, scenario in study.scenario.items():
        for index, fault in enumerate(scenario.faults):
            where = ("scenario", name, "faults", index)
            if drive is None or motor is None:
                raise invalid("expected none, of a drive", "scenario", name, "faults")
            if drive.ideal and isinstance(fault, CurrentFault | BusFault):
                expected = "expected a fault of the angle: an ideal current loop measures no more"
                raise invalid(expected, *where, "kind")
            measured = "ab" if motor.phases == 2 or drive.current_sensors.sensors == 2 else "abc"
            if isinstance(fault, CurrentFault) and fault.phase not in measured:
                expected = f"expected one of the measured phases {', '.join(measured)}"
                raise invalid(expected, *where, "phase")
            _measured_once(drive.rates.current_loop, scenario.run_time, fault, where)


def _measured_once(rate: float, end: float, fault: FaultBase, where: Key) -> None:
    """Refuse a fault that no measurement would show; they are taken once per current-loop period."""
    period = f"{1 / rate:g} s, one period of the measurements"
    if fault.duration * rate < 1 - 1e-9:
        raise invalid(f"expected {period}, or more", *where, "duration")
    if round(fault.time * rate) >= round(end * rate):
        expected = f"expected a time before the scenario's {end:g} s by {period}, or more"
        raise invalid(expected, *where, "time")
