"""Mechanics that the motor turns: inertia, friction, shaft, gear and load."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from cogless import units
from cogless.study.table import (
    AccelerationMagnitude,
    Angle,
    AngleMagnitude,
    AngularSpeedMagnitude,
    BeltStiffness,
    CarriageMass,
    File,
    Force,
    Frequency,
    Inertia,
    Length,
    Many,
    Stiffness,
    Table,
    Time,
    Torque,
    TorqueMagnitude,
    ViscousFriction,
    check_one,
    excluded,
    invalid,
)
from cogless.units import TURN

Order = Annotated[int, Field(ge=1, le=10_000)]


class TorqueHarmonic(Table):
    """A part of a torque: torque sin(order theta + phase), with theta the mechanical angle."""

    order: Order
    """Waves per mechanical revolution."""
    torque: Torque  # N*m
    r"""Amplitude of this harmonic, torque sin(order $\theta$ + phase), which is added to the load torque
    $\tau_L$ or to the friction $\tau_C$."""
    phase: Angle = 0.0  # rad
    """Phase of this harmonic."""


class AngleTable(Table):
    """Torque over the mechanical angle, linear between points, periodic in one revolution."""

    angle: Many[Angle] = ()  # rad
    """Rising angles. From the first to the last is less than one revolution."""
    torque: Many[Torque] = ()  # N*m
    """Torque at each angle. Between two angles it is linear, and it repeats with each revolution."""
    file: File | None = None
    """CSV file that replaces `angle` and `torque`: columns `angle` and `torque` with their units in the
    heading. The path is relative to the study."""

    @model_validator(mode="after")
    def _shape(self, info: ValidationInfo) -> Self:
        if self.file is not None:
            for name in ("angle", "torque"):
                if getattr(self, name):
                    raise excluded("file", name, instead="delete angle and torque")
            return self._read(info)
        check_table("angle", self.angle, self.torque)
        if self.angle[-1] - self.angle[0] >= TURN * (1 - 1e-9):
            raise invalid("expected less than one revolution from the first to the last angle", "angle")
        return self

    def _read(self, info: ValidationInfo) -> Self:
        from cogless.study.csv_table import read

        if not info.context or self.file is None:
            return self
        column = read(info.context["folder"] / self.file, {"torque": units.TORQUE})
        return self.model_copy(update={"angle": column.angle, "torque": column.value})


class TimeTable(Table):
    """Torque over time, linear between points, constant before the first and after the last point."""

    time: Many[Time]  # s
    """Rising times."""
    torque: Many[Torque]  # N*m
    """Torque at each time. Between two times it is linear; before the first and after the last it is
    constant."""

    @model_validator(mode="after")
    def _shape(self) -> Self:
        check_table("time", self.time, self.torque)
        return self


def check_table(axis: str, points: Sequence[float], values: Sequence[float]) -> None:
    """Refuse a table without points, with points that don't increase, or without one value per point."""
    if not points or any(b <= a for a, b in pairwise(points)):
        raise invalid("expected one or more values, each above the previous one", axis)
    if len(points) != len(values):
        raise invalid(f"expected {len(points)} values, as many as {axis} has", "torque")


class Load(Table):
    """A load torque, the sum of its parts. The constant part follows its set value with a first-order lag."""

    torque: Torque = 0.0  # N*m
    """Constant part of the load. A positive torque acts against positive rotation."""
    lag: Time = 0.0  # s
    """Time constant with which the constant part of the load changes at an event."""
    harmonics: Many[TorqueHarmonic] = ()
    """Parts of the load that depend on the angle."""
    angle_table: AngleTable | None = None
    """Table of a load torque over the mechanical angle."""
    time_table: TimeTable | None = None
    """Table of a load torque over time."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        return data if isinstance(data, dict) else {"torque": data}


class Mass(Table):
    """Inertia and friction of what turns as one body."""

    inertia: Inertia  # kg*m^2
    """Inertia of rotor and load together. With a `load_side`, each side has an inertia of its own."""
    viscous_friction: ViscousFriction = 0.0  # N*m*s/rad
    """Friction torque per speed."""
    coulomb_friction: TorqueMagnitude = 0.0  # N*m
    """Friction torque while moving."""
    breakaway_friction: TorqueMagnitude | None = None  # N*m
    """Largest torque against which friction holds a rotor at standstill, at least `coulomb_friction`.
    Default: `coulomb_friction`."""
    stribeck_speed: AngularSpeedMagnitude = 0.0  # rad/s
    r"""Speed $\omega_s$ at which friction has fallen most of the way from `breakaway_friction` to
    `coulomb_friction`: $\tau_C + (\tau_{breakaway} - \tau_C)\, e^{-(\omega/\omega_s)^2}$. 0: friction falls
    at once."""
    friction_harmonics: Many[TorqueHarmonic] = ()  # N*m
    """Parts of `coulomb_friction` and `breakaway_friction` that depend on the angle."""
    friction_table: AngleTable | None = None  # N*m
    """Torque over the angle that is added to `coulomb_friction` and `breakaway_friction`."""

    @property
    def breakaway(self) -> float:
        """Friction at standstill, N m, without the parts that depend on the angle."""
        return self.coulomb_friction if self.breakaway_friction is None else self.breakaway_friction

    @model_validator(mode="after")
    def _breakaway(self) -> Self:
        if self.breakaway < self.coulomb_friction:
            raise invalid("expected coulomb_friction or more", "breakaway_friction")
        if self.stribeck_speed and self.breakaway == self.coulomb_friction:
            since = "breakaway_friction is not above coulomb_friction"
            raise excluded("stribeck_speed", "breakaway_friction", since, "raise breakaway_friction")
        return self

    @model_validator(mode="after")
    def _never_drives(self) -> Self:
        """Refuse friction that is below zero at some angle."""
        lowest = min(self.friction_table.torque, default=0.0) if self.friction_table else 0.0
        least = self.coulomb_friction + lowest
        if least < 0:
            raise invalid(
                "expected torques with which coulomb_friction plus table is nowhere negative",
                "friction_table",
            )
        if sum(abs(h.torque) for h in self.friction_harmonics) > least * (1 + 1e-9):
            raise invalid(
                f"expected amplitudes whose sum is at most {least:.6g} N*m, so that friction is "
                "nowhere negative",
                "friction_harmonics",
            )
        return self


class GearError(Table):
    """A part of a gear's transmission error: angle sin(order theta + phase), theta of its input or output."""

    side: Literal["input", "output"]
    """Shaft in whose revolutions `order` counts: the gear's `input` (motor) or its `output`."""
    order: Order
    """Waves per revolution."""
    angle: AngleMagnitude  # rad
    r"""Amplitude of this part of the error. The part adds `angle` times sin(`order` $\theta$ + `phase`) to
    the position of the gear's output; $\theta$ is the position of the shaft that `side` names."""
    phase: Angle = 0.0  # rad
    """Phase of this part of the error: 360 deg are one of its waves."""


class LoadSide(Mass):
    """A second mass behind a gear and a soft shaft with backlash; inertia and friction are its own."""

    stiffness: Stiffness  # N*m/rad
    """Torque of the shaft per twist. The twist is that on the load's side of the gear."""
    damping: ViscousFriction = 0.0  # N*m*s/rad
    """Torque of the shaft per speed of its twist."""
    backlash: AngleMagnitude = 0.0  # rad
    """Whole gap as an angle of the load. Within the gap the shaft has no torque."""
    ratio: Annotated[float, Field(gt=0)] = 1.0
    """Speed of the motor over that of the load."""
    gear_errors: Many[GearError] = ()
    """Parts of the gear's transmission error, by order."""

    @model_validator(mode="after")
    def _turns_on(self) -> Self:
        if self.slope[0] <= 0:
            raise invalid(
                "expected smaller errors: with these errors the gear's output would turn back", "gear_errors"
            )
        return self

    @property
    def slope(self) -> tuple[float, float]:
        """Bounds of the output's speed over the input's."""
        spread = sum(
            e.order * e.angle * (1.0 if e.side == "input" else 1 / self.ratio) for e in self.gear_errors
        )
        return 1 / self.ratio - spread, 1 / self.ratio + spread


class Accelerometer(Table):
    """An accelerometer on a carriage, whose logs `cogless run` writes as Klipper does."""

    axis: Literal["x", "y"]
    """Axis of the sensor along which the carriage moves. The logs' names contain it."""
    rate: Frequency = 3200.0  # Hz
    """Samples per second. `trace.rate` must be at least four times as high."""
    rate_error: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    """The sensor's own clock is wrong by a random relative error of at most this, drawn for each log. Klipper
    measures the clock, so the times in a log are right."""
    noise: AccelerationMagnitude = 0.0  # m/s^2
    """Standard deviation of the noise on each axis of each sample."""
    resolution: AccelerationMagnitude = 0.0  # m/s^2
    """Step of the sampled acceleration, such as 0.0392 m/s^2 of an ADXL345. 0: no steps."""
    late: Time = 0.0  # s
    """Each log begins later than its run, by a random time of at most this."""
    logs: Annotated[int, Field(ge=1, le=100)] = 1
    """Number of logs of each run. Each draws its own noise, clock error and beginning."""


class Belt(Table):
    """A toothed belt on the motor's pulley that pulls a carriage: a `load_side` in the carriage's words."""

    pulley_teeth: Annotated[int, Field(ge=4, le=1000)]
    """Teeth of the pulley on the motor's shaft."""
    pitch: Length = 2e-3  # m
    """Length of a tooth of the belt."""
    mass: CarriageMass  # kg
    """Mass of the carriage and of all that moves with it. For one axis of a CoreXY printer give half of the
    mass that moves along this axis."""
    resonance: Frequency | None = None  # Hz
    """Frequency at which the carriage swings on its belt while the motor's shaft is held. Give this or
    `stiffness`. An input shaper measures another resonance, in which the shaft also gives way against the
    motor's field."""
    stiffness: BeltStiffness | None = None  # N/m
    """Force of the belt per stretch, both halves of the belt together."""
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Damping of the carriage that swings on its belt, relative to critical damping."""
    friction: Force = 0.0  # N
    """Friction force of the carriage while it moves."""
    accelerometer: Accelerometer | None = None
    """Accelerometer of which each run writes logs. It does not change the motion."""

    @model_validator(mode="after")
    def _one_word(self) -> Self:
        expected = 'expected either resonance, such as "75 Hz", or stiffness, such as "110 N/mm"'
        check_one(self, ("resonance", "stiffness"), expected, "resonance")
        return self

    @property
    def radius(self) -> float:
        """Distance that the carriage moves per angle of the motor, m/rad."""
        return self.pulley_teeth * self.pitch / TURN

    @property
    def load_side(self) -> LoadSide:
        """The carriage as a mass that turns with the pulley."""
        stiffness = self.stiffness or self.mass * (TURN * (self.resonance or 0.0)) ** 2
        return LoadSide.model_construct(
            inertia=self.mass * self.radius**2,
            coulomb_friction=self.friction * self.radius,
            stiffness=stiffness * self.radius**2,
            damping=2 * self.damping_ratio * math.sqrt(stiffness * self.mass) * self.radius**2,
        )


class Mechanics(Mass):
    """Inertia, friction and load of everything that turns with the rotor."""

    load_side: LoadSide | None = None
    """A second mass behind a gear and a soft shaft. `inertia` and the frictions of `[mechanics]` are then
    those of the motor's side."""
    belt: Belt | None = None
    """A carriage on a belt. It replaces `load_side`."""
    load: Load = Load()
    """Load that belongs to the machine and also acts in commissioning runs. A plain torque is short for `{
    torque = ... }`."""

    @model_validator(mode="after")
    def _carriage(self) -> Self:
        if self.belt is None:
            return self
        if self.load_side is not None:
            raise excluded("belt", "load_side")
        return self.model_copy(update={"load_side": self.belt.load_side})

    @property
    def ratio(self) -> float:
        """The motor's speed over the load's."""
        return self.load_side.ratio if self.load_side else 1.0

    @property
    def stiff(self) -> Mechanics:
        """The mechanics for the motor, with rigid shaft and gear: sums of inertia and sliding friction."""
        side = self.load_side
        if side is None:
            return self
        return self.model_copy(
            update={
                "inertia": self.inertia + side.inertia / side.ratio**2,
                "viscous_friction": self.viscous_friction + side.viscous_friction / side.ratio**2,
                "coulomb_friction": self.coulomb_friction + side.coulomb_friction / side.ratio,
                "load_side": None,
            }
        )
