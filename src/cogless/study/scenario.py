"""A scenario of a speed study: reference, load, faults and duration of an experiment."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from cogless.study.fault import Fault
from cogless.study.mechanics import Load
from cogless.study.reference import Reference
from cogless.study.table import (
    Angle,
    AngularSpeed,
    Duration,
    Many,
    Table,
    Time,
    Torque,
    dotted_keys,
    invalid,
)


class Event(Table):
    """A change during a run: the constant part of the load gets a new set value."""

    time: Time  # s
    load: Torque  # N*m

    def is_at(self, time: float) -> bool:
        """Whether the event is at this time, s, apart from rounding in the conversion of units."""
        return math.isclose(self.time, time, abs_tol=1e-9)


class Experiment(Table):
    """Keys that a scenario of a speed study and one of trials have in common."""

    duration: Duration  # s, of the run, or of one trial
    faults: Many[Fault] = ()  # of sensors and supply; their times are from the start of the run
    controllers: Many[str] | None = None  # default: all

    @property
    def run_time(self) -> float:
        """Duration of a run, s."""
        return self.duration

    @model_validator(mode="after")
    def _faults(self) -> Self:
        for index, fault in enumerate(self.faults):
            if fault.time >= self.run_time:
                expected = f"expected a time within the scenario's {self.run_time:g} s"
                raise invalid(expected, "faults", index, "time")
        return self

    def has_event(self, time: float) -> bool:
        """Whether the scenario has an event at this time, s."""
        return False


class Scenario(Experiment):
    """An experiment of a speed study."""

    reference: Reference
    initial_speed: AngularSpeed = 0.0  # rad/s, mechanical
    initial_angle: Angle = 0.0  # rad, mechanical
    load: Load | None = None  # replaces mechanics.load
    events: Many[Event] = ()
    # changes of motor, drive and mechanics for this scenario only
    override: dict[str, Any] = Field(default={})

    @field_validator("override")
    @classmethod
    def _dotted(cls, override: dict[str, Any]) -> dict[str, Any]:
        return dotted_keys(override)

    @model_validator(mode="after")
    def _events(self) -> Self:
        before = -1.0
        for index, event in enumerate(self.events):
            if event.time > self.duration:
                expected = f"expected a time within the scenario's {self.duration:g} s"
                raise invalid(expected, "events", index, "time")
            if event.time <= before:
                raise invalid("expected a time after the event before", "events", index, "time")
            before = event.time
        for key in self.override:
            if key.split(".")[0] not in ("motor", "drive", "mechanics") or key == "motor.datasheet":
                expected = "expected a key of motor, drive or mechanics"
                raise invalid(expected, "override", key)
        return self

    def has_event(self, time: float) -> bool:
        return any(event.is_at(time) for event in self.events)

    @cached_property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest speed of the reference, signed, rad/s."""
        return self.reference.speeds(self.initial_speed)

    @property
    def slowest(self) -> float:
        """Smallest magnitude of the reference's speed, rad/s; 0 if it stops or reverses."""
        low, high = self.speeds
        return 0.0 if low <= 0 <= high else min(abs(low), abs(high))

    @property
    def top_reference(self) -> float:
        """Largest magnitude of the reference's speed, rad/s."""
        return max(map(abs, self.speeds))

    @property
    def top_acceleration(self) -> float:
        """Largest magnitude of the reference's acceleration, rad/s^2."""
        return self.reference.top_acceleration(self.initial_speed)

    @property
    def top_speed(self) -> float:
        """Largest magnitude of the reference's speed and of the initial speed, rad/s."""
        return max(self.top_reference, abs(self.initial_speed))
