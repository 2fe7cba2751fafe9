"""Checks that concern several tables of a study. Each raises an error that names the wrong key.

A fault must be in something that the drive measures, and must last long enough to be measured.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pydantic_core import PydanticCustomError

from cogless.study import metric_checks, numerics
from cogless.study.drive import OUTER_LOOPS
from cogless.study.metric_checks import FEWEST_ROWS
from cogless.study.motor import Motor
from cogless.study.position_sensor import Hall
from cogless.study.scenario import BusFault, CurrentFault, FaultBase
from cogless.study.table import Key, invalid, one_of

if TYPE_CHECKING:
    from cogless.study.base import StudyBase
    from cogless.study.speed_study import Study
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
                raise invalid(
                    "expected no faults, since a linear plant has no drive", "scenario", name, "faults"
                )
            if drive.ideal and isinstance(fault, CurrentFault | BusFault):
                expected = "expected a fault of the angle, since an ideal current loop measures nothing else"
                raise invalid(expected, *where, "kind")
            measured = "ab" if motor.phases == 2 or drive.current_sensors.sensors == 2 else "abc"
            if isinstance(fault, CurrentFault) and fault.phase not in measured:
                expected = f"expected one of the measured phases {', '.join(measured)}"
                raise invalid(expected, *where, "phase")
            _measured_once(drive.rates.current_loop, scenario.run_time, fault, where)


def _measured_once(rate: float, end: float, fault: FaultBase, where: Key) -> None:
    """Refuse a fault without a measurement: one is made per current-loop period.

    The fault must last a period or more, and begin a period or more before the end, s, of the run.
    """
    period = f"{1 / rate:g} s (one period of the current loop)"
    if fault.duration * rate < 1 - 1e-9:
        raise invalid(f"expected at least {period}", *where, "duration")
    if round(fault.time * rate) >= round(end * rate):
        expected = f"expected a time at least {period} before the scenario's end at {end:g} s"
        raise invalid(expected, *where, "time")


TRACE_OVER_ACCELEROMETER = (
    4  # rows of the trace for each sample: their mean acceleration has the sample's value
)
NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def names(study: StudyBase) -> None:
    """Check that names of scenarios and controllers can be used in file names and on the command line."""
    for table, entries in (("scenario", study.scenario), ("controller", study.controller)):
        for name in entries:
            if not NAME_PATTERN.fullmatch(name):
                raise invalid("expected a name of letters, digits, _, - and .", table, name)


def references(study: StudyBase) -> None:
    """Check that each scenario has a controller, and that the controllers that it names exist."""
    for name, scenario in study.scenario.items():
        if scenario.controllers == ():
            raise invalid(one_of(study.controller), "scenario", name, "controllers")
        for index, controller in enumerate(scenario.controllers or ()):
            if controller not in study.controller:
                raise invalid(one_of(study.controller), "scenario", name, "controllers", index)


def baseline(study: StudyBase) -> None:
    """Check that at most one controller is the baseline."""
    marked = [name for name, controller in study.controller.items() if controller.baseline]
    if len(marked) > 1:
        raise invalid(
            f'expected only one baseline, which is "{marked[0]}" already', "controller", marked[1], "baseline"
        )


def trace_rate(study: Study) -> None:
    """Check that the rate of trace rows divides the current loop's rate, or is a multiple of it.

    A multiple needs a switched inverter: without pulses, rows between current samples show nothing new.
    """
    rate, ticks, inverter = study.trace.rate, study.drive.rates.current_loop, study.drive.inverter
    if rate is None or _whole(ticks / rate):
        return
    expected = f"expected a rate that divides drive.rates.current_loop, {ticks:g} Hz"
    if inverter is not None and inverter.switches:
        if _whole(rate / ticks):
            return
        expected = f"{expected}, or a multiple of it"
    elif rate > ticks:
        expected = f'{expected}; a higher rate needs drive.inverter.kind = "switched"'
    raise invalid(expected, "trace", "rate")


def _whole(ratio: float) -> bool:
    return math.isclose(ratio, round(ratio), rel_tol=1e-12)


def durations(study: Study) -> None:
    """Check that every scenario has enough trace rows for a metric."""
    for name, scenario in study.scenario.items():
        if scenario.duration * study.trace_rate < FEWEST_ROWS * (1 - 1e-9):
            least = f"{FEWEST_ROWS / study.trace_rate:g} s"
            expected = f"expected {least} or more, so that the trace has {FEWEST_ROWS} rows"
            raise invalid(expected, "scenario", name, "duration")


def energy(study: Study | TrialStudy) -> None:
    """Refuse to record energies where there are no voltages: without a drive, or with an ideal current
    loop."""
    if study.trace.energy and (study.drive is None or study.drive.ideal):
        why = "there is no drive" if study.drive is None else "the current loop is ideal"
        raise invalid(f"expected false, since {why}", "trace", "energy")


def outer_loop(study: Study | TrialStudy) -> None:
    """Check that the outer loop is the speed loop, or in a study of trials the position loop."""
    if study.drive is not None and getattr(study.drive.rates, study.outer_loop) is None:
        (other,) = (loop for loop in OUTER_LOOPS if loop != study.outer_loop)
        raise invalid(f"expected the key {study.outer_loop} instead", "drive", "rates", other)


def laws(study: Study) -> None:
    """Check each law against the study."""
    for name, law in study.controller.items():
        law.check(study, name)


def speeds_of_laws(study: Study) -> None:
    """Check each law against the speeds of all its scenarios."""
    for name, law in study.controller.items():
        law.check_speeds(study, name)


def feedback_under_guard(study: Study) -> None:
    """Check that each law under the guard has feedback.

    The guard compares learning with the feedback alone. So without feedback the law could never learn.
    """
    if not study.drive.guard or study.drive.rates.position_loop is not None:
        return
    for name, law in study.controller.items():
        if law.missing_feedback is not None:
            expected = (
                "expected more than 0, since the guard needs feedback to compare learning with; or "
                "drive.guard = false"
            )
            raise invalid(expected, "controller", name, law.missing_feedback)


def slots(study: Study) -> None:
    """Check that the motor has `slots`, or each law that would need them for its orders has a `base`."""
    motor = study.motor
    if (
        not isinstance(motor, Motor)
        or motor.slots is not None
        or isinstance(study.drive.position_sensor, Hall)
    ):
        return
    missing = [name for name, law in study.controller.items() if law.needs_slots]
    if missing:
        keys = " and ".join(f"controller.{name}.base" for name in missing)
        raise invalid(
            f"expected the number of slots, or {keys}: they give the orders to learn",
            "motor",
            "slots",
            value="missing",
        )


def sensor_side(study: Study | TrialStudy) -> None:
    """Check that a load side exists for a sensor on it, and that the gear's ratio is a whole number."""
    if study.drive is None or study.mechanics is None or study.drive.position_sensor.side == "motor":
        return
    key = ("drive", "position_sensor", "side")
    if study.mechanics.load_side is None:
        raise invalid('expected "motor", since there is no mechanics.load_side', *key)
    if study.mechanics.ratio % 1:
        expected = f'expected "motor", since the ratio {study.mechanics.ratio:g} is not a whole number'
        raise invalid(f"{expected}, so the load's angle does not determine the motor's", *key)


def accelerometer(study: Study) -> None:
    """Check that the trace is fine enough for an accelerometer, and that no two runs have equal log names.

    A log must begin in the first half of the shortest run.
    """
    belt = study.mechanics.belt
    if belt is None or belt.accelerometer is None:
        return
    sensor, key = belt.accelerometer, ("mechanics", "belt", "accelerometer")
    least = TRACE_OVER_ACCELEROMETER * sensor.rate
    if study.trace_rate < least * (1 - 1e-9):
        expected = f"expected at most {study.trace_rate / TRACE_OVER_ACCELEROMETER:g} Hz, or trace.rate of"
        raise invalid(f"{expected} {least:g} Hz or more", *key, "rate", value=f"{sensor.rate:g} Hz")
    shortest = min(scenario.duration for scenario in study.scenario.values())
    if sensor.late >= shortest / 2:
        raise invalid(f"expected less than {shortest / 2:g} s, half the shortest run", *key, "late")
    logs = [f"{name}-{controller}" for name in study.scenario for controller in study.controllers_in(name)]
    if len(set(logs)) < len(logs):
        twice = next(log for log in logs if logs.count(log) > 1)
        raise invalid(
            f'expected other names of scenarios or controllers: two runs have the log "{twice}"', *key
        )


def calibration(study: StudyBase) -> None:
    """Check that targets name existing runs and metrics, and that their values suit the metric's kind."""
    if study.calibration is None:
        return
    for index, parameter in enumerate(study.calibration.parameters):
        if parameter.scenario is not None and parameter.scenario not in study.scenario:
            raise invalid(one_of(study.scenario), "calibration", "parameters", index, "scenario")
    for index, target in enumerate(study.calibration.targets):
        key = ("calibration", "targets", index)
        if target.scenario not in study.scenario:
            raise invalid(one_of(study.scenario), *key, "scenario")
        if target.controller not in study.controllers_in(target.scenario):
            raise invalid(one_of(study.controllers_in(target.scenario)), *key, "controller")
        scenario = study.scenario[target.scenario]
        taken = {m.name: m for m in study.metric if m.applies_in(target.scenario, scenario)}
        if target.metric not in taken:
            raise invalid(one_of(taken), *key, "metric")
        try:
            metric = taken[target.metric]
            target.values(metric, study.values_of(metric, target.scenario))
        except PydanticCustomError as error:
            raise invalid(error.message(), *key, "value") from None


Check = Callable[["Study"], None]
# Checks for both kinds of study.
BOTH: tuple[Callable[[Any], None], ...] = (
    names,
    references,
    baseline,
    outer_loop,
    sensor_side,
    numerics.heating,
    numerics.current_range,
    energy,
    metric_checks.known_signals,
    metric_checks.metrics,
)
SPEED_CHECKS: tuple[Check, ...] = (
    *BOTH,
    trace_rate,
    durations,
    numerics.integration,
    numerics.dead_time,
    numerics.size,
    metric_checks.windows,
    metric_checks.orders,
    laws,
    feedback_under_guard,
    slots,
    faults,
    accelerometer,
    calibration,
)
# Checks of the whole study only; the others are also made for each scenario with its overrides.
WHOLE: tuple[Check, ...] = (speeds_of_laws,)
