"""A scenario: what is asked of the drive, for how long, against which load."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from cogless.study.mechanics import Load
from cogless.study.table import (
    Angle,
    AngularAcceleration,
    AngularSpeed,
    Duration,
    Frequency,
    Many,
    Table,
    Time,
    Torque,
    dotted_keys,
    problem,
)

Kind = Literal["constant", "ramp", "profile", "sine"]
FORMS: dict[Kind, set[str]] = {
    "constant": {"speed"},
    "ramp": {"speed", "ramp"},
    "profile": {"profile"},
    "sine": {"offset", "amplitude", "frequency"},
}


class Reference(Table):
    """The mechanical speed reference: constant, ramp, profile, or offset + amplitude sin(2 pi f t)."""

    speed: AngularSpeed = 0.0  # rad/s
    ramp: AngularAcceleration = 0.0  # rad/s^2
    profile: Many[tuple[Time, AngularSpeed]] = ()  # s, rad/s; linear between points, ends held
    offset: AngularSpeed = 0.0  # rad/s
    amplitude: AngularSpeed = 0.0  # rad/s
    frequency: Frequency = 0.0  # Hz

    @model_validator(mode="before")
    @classmethod
    def _forms(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return {"speed": data}
        if isinstance(data.get("profile"), list):
            return {**data, "profile": tuple(tuple(p) if isinstance(p, list) else p for p in data["profile"])}
        return data

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if self.model_fields_set not in FORMS.values():
            forms = "; ".join(", ".join(sorted(form)) for form in FORMS.values())
            raise problem(f"expected the keys of one form: {forms}")
        times = [time for time, _ in self.profile]
        if self.kind == "profile" and (not times or any(b <= a for a, b in pairwise(times))):
            raise problem("expected one or more points, each later than the one before", "profile")
        return self

    @property
    def kind(self) -> Kind:
        """Which of the four forms this is."""
        return next(kind for kind, keys in FORMS.items() if keys == self.model_fields_set)

    @property
    def top_speed(self) -> float:
        """The largest magnitude that the reference takes, rad/s."""
        along = [abs(speed) for _, speed in self.profile]
        return max([abs(self.speed), abs(self.offset) + abs(self.amplitude), *along])


class Event(Table):
    """A change during the run: the constant part of the load gets a new target."""

    time: Time  # s
    load: Torque  # N*m


class Scenario(Table):
    """One experiment."""

    duration: Duration  # s
    reference: Reference
    initial_speed: AngularSpeed = 0.0  # rad/s, mechanical
    initial_angle: Angle = 0.0  # rad, mechanical
    load: Load | None = None  # replaces mechanics.load
    events: Many[Event] = ()
    # changes of motor, drive and mechanics for this scenario only
    override: dict[str, Any] = Field(default={})
    controllers: Many[str] | None = None  # default: all

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
                raise problem(expected, "events", index, "time")
            if event.time <= before:
                raise problem("expected a time after the event before", "events", index, "time")
            before = event.time
        for key in self.override:
            if key.split(".")[0] not in ("motor", "drive", "mechanics") or key == "motor.datasheet":
                expected = "expected a key of motor, drive or mechanics"
                raise problem(expected, "override", key)
        return self

    @property
    def top_speed(self) -> float:
        """The largest speed that is asked for or begun with, rad/s."""
        return max(self.reference.top_speed, abs(self.initial_speed))
