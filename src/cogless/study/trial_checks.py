"""Checks that concern several tables of a study of trials. Each raises an error that names the wrong key."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING

from pydantic_core import PydanticCustomError

from cogless.study import checks, metric_checks, numerics
from cogless.study.drive import TRACE_ROWS_MOST
from cogless.study.table import Key, excluded, invalid
from cogless.study.trial_study import Deviations, TrialConditions, WithUnit

if TYPE_CHECKING:
    from cogless.study.trial_study import TrialStudy

FEWEST_SAMPLES = 4  # least samples of a trial
TRIAL_SAMPLES_MOST = 65_535
MOST_RANGES = 12  # parameters with a range, which have 4096 corners
# How a load or position is written: first in a drive's study, then in a linear plant's.
LOADS = ('a torque with a unit, such as [100, "1 N*m"]', "a number in the unit of u, such as [100, 1.0]")
POSITIONS = ('an angle with a unit, such as ["1 s", "1 rad"]', 'a plain number, such as ["1 s", 1.0]')
LARGEST_MATRIX = 4_000  # samples of the longest trial for a law that learns by a matrix


def plant(study: TrialStudy) -> None:
    """Check that the study has either a linear plant, or motor, mechanics and drive."""
    drive = {"motor": study.motor, "mechanics": study.mechanics, "drive": study.drive}
    for key, table in drive.items():
        if study.plant is not None and table is not None:
            since = "the table [plant] is a linear plant without a drive"
            raise excluded(key, "plant", since, "delete plant")
        if study.plant is None and table is None:
            raise invalid(
                "expected this table, or [plant] in place of [motor], [mechanics] and [drive]",
                key,
                value="missing",
            )


def corners(study: TrialStudy) -> None:
    """Check that a plant's matrices have values at every corner of its parameters' ranges."""
    if study.plant is None or study.plant.vertex:
        return
    ends = {name: p.range for name, p in study.plant.parameter.items() if p.range is not None}
    if len(ends) > MOST_RANGES:
        raise invalid(f"expected at most {MOST_RANGES} parameters with a range", "plant", "parameter")
    for corner in product(*ends.values()):
        try:
            study.plant.matrices_at(dict(zip(ends, corner, strict=True)))
        except PydanticCustomError as error:
            key = (error.context or {}).get("key", ())
            raise invalid(error.message(), "plant", *key) from None


def ranges(study: TrialStudy) -> None:
    """Refuse design.range for a linear plant, whose parameters' ranges belong in plant.parameter."""
    if study.plant is not None and study.design.range:
        since, instead = "there is a linear plant", "give plant.parameter.NAME.range in its place"
        raise excluded(("design", "range"), "plant", since, instead)


def samples(study: TrialStudy) -> None:
    """Check that a trial is a whole number of samples, neither too few nor too many."""
    for name, scenario in study.scenario.items():
        count = scenario.duration / study.period
        if not math.isclose(count, round(count), rel_tol=1e-9):
            expected = f"expected a whole number of samples of {study.period:g} s"
            raise invalid(expected, "scenario", name, "duration")
        if not FEWEST_SAMPLES <= round(count) <= TRIAL_SAMPLES_MOST:
            expected = f"expected {FEWEST_SAMPLES} to {TRIAL_SAMPLES_MOST} samples, not {round(count)}"
            raise invalid(expected, "scenario", name, "duration")
        rows = round(count) * scenario.trials * max(1.0, study.period * (study.trace.rate or 0.0))
        if rows > TRACE_ROWS_MOST:
            most = TRACE_ROWS_MOST * scenario.trials / rows
            expected = f"expected at most {most:.0f}: {scenario.trials} trials make {rows:.3g} rows"
            raise invalid(f"{expected}, too many for the trace", "scenario", name, "trials")
        for controller in study.controllers_in(name):
            if study.controller[controller].BY_MATRIX and round(count) > LARGEST_MATRIX:
                expected = (
                    f'expected at most {LARGEST_MATRIX} samples, since "{controller}" learns by a matrix'
                )
                raise invalid(expected, "scenario", name, "duration")


def trace_rate(study: TrialStudy) -> None:
    """Check that trace rows coincide with samples of the fastest loop, and that each sample of a trial has a
    row."""
    rate = study.trace.rate
    ticks = study.drive.rates.current_loop if study.drive is not None else 1 / study.period
    if rate is not None and not math.isclose(ticks / rate, round(ticks / rate), rel_tol=1e-12):
        raise invalid(f"expected a rate that divides {ticks:g} Hz", "trace", "rate")
    if rate is not None and not math.isclose(rate * study.period, round(rate * study.period), rel_tol=1e-9):
        expected = (
            f"expected {1 / study.period:g} Hz or a multiple of it, so that each sample of a trial has a row"
        )
        raise invalid(expected, "trace", "rate")


def conditions(study: TrialStudy) -> None:
    """Check that the conditions of each phase suit the kind of plant, drive or linear plant."""
    linear = study.plant is not None
    for name, scenario in study.scenario.items():
        count = study.samples(name)
        places: list[tuple[TrialConditions, tuple[str | int, ...]]] = [(scenario, ("scenario", name))]
        places += [(c, ("scenario", name, "changes", i)) for i, c in enumerate(scenario.changes)]
        for phase, where in places:
            for key in ("load", "initial_angle", "initial_speed") if linear else ("initial_state",):
                if getattr(phase, key) is not None:
                    raise _for_another_plant(linear, where, key)
            if phase.initial_state is not None and len(phase.initial_state) != study.states:
                raise invalid(f"expected {study.states} numbers, one for each state", *where, "initial_state")
            for form in ("normal", "uniform") if phase.each_trial is not None else ():
                _deviations(study, getattr(phase.each_trial, form), (*where, "each_trial", form))
            for index, (sample, amount) in enumerate(phase.load_steps or ()):
                if sample >= count:
                    expected = f"expected a sample below {count}, within the trial"
                    raise invalid(expected, *where, "load_steps", index)
                if isinstance(amount, WithUnit) == linear:
                    raise invalid(f"expected {LOADS[linear]}", *where, "load_steps", index)
            for index, (time, position) in enumerate(phase.reference.points if phase.reference else ()):
                if time > scenario.duration:
                    expected = f"expected a time within the {scenario.duration:g} s of the trial"
                    raise invalid(expected, *where, "reference", index)
                if isinstance(position, WithUnit) == linear:
                    raise invalid(f"expected {POSITIONS[linear]}", *where, "reference", index)
            for key, value in (phase.override or {}).items():
                _override(study, key, value, (*where, "override", key))
        for (_, phase), (_, where) in zip(scenario.phases, places, strict=True):
            _start(study, name, phase, where)


def _for_another_plant(linear: bool, where: Key, key: str) -> PydanticCustomError:
    """The error of a condition that only the other kind of plant has."""
    if not linear:
        since, instead = "the plant is a drive", "give initial_angle and initial_speed"
    elif key == "load":
        since, instead = "the plant is linear", "give load_steps"
    else:
        since, instead = "the plant is linear", "give initial_state"
    return excluded((*where, key), "plant" if linear else "drive", since, f"{instead} in its place")


def _deviations(study: TrialStudy, deviations: Deviations, where: tuple[str | int, ...]) -> None:
    """Check that deviations suit the kind of plant."""
    linear = study.plant is not None
    for key in ("initial_angle", "initial_speed") if linear else ("initial_state",):
        if getattr(deviations, key) is not None:
            raise _for_another_plant(linear, where, key)
    if deviations.initial_state is not None and len(deviations.initial_state) != study.states:
        raise invalid(f"expected {study.states} numbers, one for each state", *where, "initial_state")
    if deviations.load is not None and isinstance(deviations.load, WithUnit) == linear:
        expected = "a number in the unit of u" if linear else 'a torque with a unit, such as "0.1 N*m"'
        raise invalid(f"expected {expected}", *where, "load")


def _start(study: TrialStudy, scenario: str, phase: TrialConditions, where: tuple[str | int, ...]) -> None:
    """Check that a phase's plant has values, and that the sensor can resolve its initial angle.

    The sensor doesn't count turns, so the start must be within half a turn of the reference.
    """
    if study.plant is not None:
        try:
            study.plant.matrices_at(phase.override or {})
        except PydanticCustomError as error:
            raise invalid(error.message(), *where, "override") from None
    else:
        begin = float(study.reference(scenario, phase)[0])
        begins = f"from where the reference begins, {begin:.4g} rad"
        away = 0.0 if phase.initial_angle is None else abs(phase.initial_angle - begin)
        if away >= math.pi:
            expected = f"expected an angle less than half a turn {begins}"
            raise invalid(f"{expected}: the sensor doesn't count turns", *where, "initial_angle")
        if phase.each_trial is not None and away + phase.each_trial.most("initial_angle") >= math.pi:
            form, _ = phase.each_trial.form_of("initial_angle")
            expected = f"expected deviations that keep the start less than half a turn {begins}"
            key = (*where, "each_trial", form, "initial_angle")
            raise invalid(f"{expected}: the sensor doesn't count turns", *key)


def _override(study: TrialStudy, key: str, value: object, where: tuple[str | int, ...]) -> None:
    if study.plant is None:
        if key.split(".")[0] not in ("motor", "mechanics") or key == "motor.datasheet":
            raise invalid("expected a key of motor or mechanics, such as mechanics.inertia", *where)
    elif study.plant.vertex:
        count = len(study.plant.vertex)
        if key != "vertex" or isinstance(value, bool) or value not in range(1, count + 1):
            raise invalid(f"expected vertex = 1 to {count}, or no vertex for the mean of all", *where)
    elif key not in study.plant.parameter:
        raise invalid(
            f"expected a parameter of the plant: {', '.join(study.plant.parameter) or 'none'}", *where
        )
    elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise invalid("expected a number", *where)


def controllers(study: TrialStudy) -> None:
    """Check that given gains and the state weight have one number per state, and one for an integrator."""
    n = study.states
    if len(study.design.state_weight) not in (n, n + 1):
        raise invalid(
            f"expected {n + 1} numbers: one for each state, and one for the integrator",
            "design",
            "state_weight",
        )
    for name, controller in study.controller.items():
        if controller.of_trials:
            study.trial_law(name).check_trials(study, name)
        elif study.plant is not None:
            expected = "expected a law of trials, since a law of your own needs a drive"
            raise invalid(expected, "controller", name, "law")
        elif controller.begins_with is not None:
            expected = (
                "expected no such key, since what is learned from trial to trial fits only the reference of "
                "these trials: delete start"
            )
            raise invalid(expected, "controller", name, "start")


def integration(study: TrialStudy) -> None:
    """Check that the integration step is short compared with the fastest time constant of the plant."""
    if study.drive is None or study.motor is None or study.mechanics is None:
        return
    rates = study.drive.rates
    top, name = max((study.top_speed(name), name) for name in study.scenario)
    rates_of_plant = numerics.natural_rates(
        study.motor.star(), study.mechanics, top, electrical=not study.drive.ideal
    )
    step = 1 / (rates.current_loop * rates.integration_steps)
    numerics.check_step(step, rates.integration_steps, rates_of_plant, numerics.top_speed(top, name))
    numerics.check_dead_time(study.drive)


def no_accelerometer(study: TrialStudy) -> None:
    """Refuse an accelerometer: only runs of speed studies have its logs."""
    belt = None if study.mechanics is None else study.mechanics.belt
    if belt is not None and belt.accelerometer is not None:
        expected = "expected no such key in a study of trials: delete accelerometer"
        raise invalid(expected, "mechanics", "belt", "accelerometer")


Check = Callable[["TrialStudy"], None]
TRIAL_CHECKS: tuple[Check, ...] = (
    plant,
    *checks.BOTH,
    corners,
    ranges,
    samples,
    trace_rate,
    conditions,
    controllers,
    no_accelerometer,
    integration,
    metric_checks.of_trials,
    checks.faults,
    checks.calibration,
)
