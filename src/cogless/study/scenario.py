"""A scenario of a speed study: reference, load, faults and duration of an experiment.

Faults of sensors and supply voltage in a scenario, each for a limited time.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from cogless.study.mechanics import Load
from cogless.study.reference import Reference
from cogless.study.table import (
    Angle,
    AngularSpeed,
    Current,
    Duration,
    Many,
    Override,
    Table,
    Time,
    Torque,
    Voltage,
    dotted_keys,
    excluded,
    invalid,
)


class FaultBase(Table):
    """A fault: the keys that every kind has."""

    time: Time  # s
    """Time of the run at which the fault begins."""
    duration: Duration  # s
    """Time for which the fault lasts."""

    @property
    def end(self) -> float:
        """End of the fault, s."""
        return self.time + self.duration


class AngleFault(FaultBase):
    """The position sensor gives no number, or keeps giving the last angle."""

    kind: Literal["angle-missing", "angle-stuck"]
    """`angle-missing`: the position sensor gives no angle and no speed (not a number). `angle-stuck`: the
    position sensor keeps giving its last angle."""

    @property
    def effect(self) -> str:
        return "position sensor gives no number" if self.kind == "angle-missing" else "position sensor stuck"


class AngleJump(FaultBase):
    """The position sensor's angle has a constant error."""

    kind: Literal["angle-jump"]
    """`angle-jump`: the measured angle has a constant error, the key `angle`. A jump that lasts to the end of
    the scenario is like a slipped index or lost counts."""
    angle: Angle  # rad
    """Mechanical angle that is added to the measured angle."""

    @property
    def effect(self) -> str:
        return f"position sensor off by {math.degrees(self.angle):.3g}°"


class CurrentFault(FaultBase):
    """The current sensor of a phase gives no number, or zero."""

    kind: Literal["current-missing", "current-zero"]
    """`current-missing`: a current sensor gives no value (not a number). `current-zero`: a current sensor
    measures zero."""
    phase: Literal["a", "b", "c"]
    """Phase of the faulty current sensor. In a drive with two current sensors, the current of phase c is
    computed from those of a and b."""

    @property
    def effect(self) -> str:
        reads = "gives no number" if self.kind == "current-missing" else "reads zero"
        return f"current sensor of phase {self.phase} {reads}"


class BusFault(FaultBase):
    """The bus has another voltage, and the controller measures it."""

    kind: Literal["bus-voltage"]
    """`bus-voltage`: the bus has another voltage during the fault. The controller measures this voltage."""
    voltage: Voltage  # V
    """Bus voltage during the fault."""

    @property
    def effect(self) -> str:
        return f"bus at {self.voltage:.3g} V"


Fault = Annotated[AngleFault | AngleJump | CurrentFault | BusFault, Field(discriminator="kind")]


class Event(Table):
    """A change during a run: the constant part of the load gets a new set value."""

    time: Time  # s
    """Time of the run at which the load changes."""
    load: Torque  # N*m
    """Constant part of the load torque from `time` on."""

    def is_at(self, time: float) -> bool:
        """Whether the event is at this time, s, apart from rounding in the conversion of units."""
        return math.isclose(self.time, time, abs_tol=1e-9)


class TorqueMode(Table):
    """Torque mode for a part of a run: an outer loop's current replaces the speed loop.

    What the law has learned acts on beside it, frozen.
    """

    time: Time  # s
    """Time of the run at which [torque mode](/laws/torque-mode.md) begins. In torque mode the drive does not
    follow the speed reference."""
    duration: Duration | None = None  # s
    """Time for which torque mode lasts. Default: until the end of the run."""
    current: Current = 0.0  # A
    """Current $i_q$ of your command in torque mode, to which the drive adds what the law has learned."""
    profile: Many[tuple[Time, Current]] = ()  # s
    """Points `[time, current]` that replace `current`. Between two points the current is linear; before the
    first and after the last point it is constant."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("profile"), list):
            return {**data, "profile": tuple(tuple(p) if isinstance(p, list) else p for p in data["profile"])}
        return data

    @model_validator(mode="after")
    def _one_current(self) -> Self:
        forms = {"current", "profile"} & self.model_fields_set
        if len(forms) == 2:
            raise excluded("profile", "current")
        if not forms:
            raise invalid("expected either current or profile")
        if any(b <= a for (a, _), (b, _) in pairwise(self.profile)):
            raise invalid("expected points, each later than the previous one", "profile")
        return self

    @property
    def end(self) -> float:
        """End of torque mode, s; infinite if it lasts to the end of the run."""
        return math.inf if self.duration is None else self.time + self.duration

    def acts_within(self, begin: float, end: float) -> bool:
        """Whether torque mode acts in some part of the time from `begin` to `end`, s."""
        return begin < self.end and end > self.time

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """Points of the current: time, s, and current, A."""
        return self.profile or ((0.0, self.current),)


class Experiment(Table):
    """Keys that a scenario of a speed study and one of trials have in common."""

    duration: Duration  # s
    """Simulated time of the scenario. In a study of trials: duration of one trial, a whole number of samples
    from 4 to 65535."""
    faults: Many[Fault] = ()
    """Faults of the sensors and of the bus voltage. In a study of trials, the time of a fault counts from the
    start of the run, not of a trial."""
    controllers: Many[str] | None = None
    """Names of the controllers that run in this scenario. Default: all controllers of the study."""

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

    IN_PLACE: ClassVar[dict[str, str]] = dict.fromkeys(
        ("speed", "velocity", "setpoint", "target", "speed_reference", "omega_ref"), "reference"
    ) | dict.fromkeys(("time", "length"), "duration")

    reference: Reference = Field(examples=['"60 rpm"'])
    """Motion that the law follows. A plain speed is short for `{ speed = ... }`."""
    initial_speed: AngularSpeed = 0.0  # rad/s
    """Speed of the rotor at the start of the run."""
    initial_angle: Angle = 0.0  # rad
    """Mechanical angle of the rotor at the start of the run."""
    load: Load | None = None
    """Load torque in this scenario. It replaces `mechanics.load`."""
    events: Many[Event] = ()
    """Changes of the load during the run, in the order of their times."""
    torque_mode: TorqueMode | None = None
    """Time in which a given current replaces the output of the speed loop ([torque
    mode](/laws/torque-mode.md)). Default: no torque mode."""
    override: Override = Field(default={})
    """Values of `motor`, `drive` or `mechanics` by dotted key that are valid only in this scenario. The
    controllers do not know these values: their gains are computed from the study without `override`."""

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
                raise invalid("expected a time after the previous event", "events", index, "time")
            before = event.time
        if self.torque_mode is not None and self.torque_mode.time >= self.duration:
            expected = f"expected a time within the scenario's {self.duration:g} s"
            raise invalid(expected, "torque_mode", "time")
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
    def constant_speed(self) -> float | None:
        """Magnitude of the one speed that the reference holds, rad/s; None if it varies or stands still."""
        return self.slowest if self.slowest == self.top_reference != 0 else None

    @property
    def top_acceleration(self) -> float:
        """Largest magnitude of the reference's acceleration, rad/s^2."""
        return self.reference.top_acceleration(self.initial_speed)

    @property
    def top_speed(self) -> float:
        """Largest magnitude of the reference's speed and of the initial speed, rad/s."""
        return max(self.top_reference, abs(self.initial_speed))
