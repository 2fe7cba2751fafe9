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
    """Order of this harmonic: number of its waves per mechanical revolution."""
    torque: Torque  # N*m
    r"""Amplitude of this harmonic. The harmonic is `torque` sin(`order` $\theta$ + `phase`) at the mechanical
    angle $\theta$. In `harmonics` it is added to the load torque, in `friction_harmonics` to the friction."""
    phase: Angle = 0.0  # rad
    """Phase of this harmonic: 360 deg are one of its waves."""


class AngleTable(Table):
    """Torque over the mechanical angle, linear between points, periodic in one revolution."""

    angle: Many[Angle] = ()  # rad
    """Mechanical angles of the table, rising. The last one is less than one revolution above the first
    one."""
    torque: Many[Torque] = ()  # N*m
    """Torque at each mechanical angle of the table. Between two angles it is linear. It repeats with each
    revolution."""
    file: File | None = None
    """CSV file that replaces `angle` and `torque`: it has columns of these names, with their units in the
    first line. The path is relative to the study."""

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
    """Times of the table, rising."""
    torque: Many[Torque]  # N*m
    """Torque at each time of the table. Between two times it is linear; before the first and after the last
    time it is constant."""

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
    """Constant part of the load torque. A positive torque acts against positive rotation."""
    lag: Time = 0.0  # s
    """Time constant with which the constant part of the load torque follows its new value after an event."""
    harmonics: Many[TorqueHarmonic] = ()
    """Parts of the load torque that are sines of the mechanical angle."""
    angle_table: AngleTable | None = None
    """Part of the load torque that a table over the mechanical angle gives."""
    time_table: TimeTable | None = None
    """Part of the load torque that a table over time gives."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        return data if isinstance(data, dict) else {"torque": data}


class Mass(Table):
    """Inertia and friction of what turns as one body."""

    inertia: Inertia  # kg*m^2
    """Inertia of rotor and load together. With a `load_side`: in `[mechanics]` the inertia of the motor's
    side, and in `[mechanics.load_side]` that of the load's side, not converted by `ratio`."""
    viscous_friction: ViscousFriction = 0.0  # N*m*s/rad
    """Viscous friction: friction torque per speed."""
    coulomb_friction: TorqueMagnitude = 0.0  # N*m
    """Coulomb friction: friction torque during motion, which does not depend on the speed."""
    breakaway_friction: TorqueMagnitude | None = None  # N*m
    """Largest torque against which friction holds a body at standstill, at least `coulomb_friction`. Default:
    `coulomb_friction`."""
    stribeck_speed: AngularSpeedMagnitude = 0.0  # rad/s
    r"""Stribeck speed $\omega_s$: at this speed, friction has fallen by 63 % of the way from
    `breakaway_friction` $\tau_{breakaway}$ to `coulomb_friction` $\tau_C$. At the speed $\omega$, friction
    without its viscous part is $\tau_C + (\tau_{breakaway} - \tau_C)\, e^{-(\omega/\omega_s)^2}$. 0: it is
    $\tau_C$ at any speed except standstill."""
    friction_harmonics: Many[TorqueHarmonic] = ()  # N*m
    """Sines of the mechanical angle that are added to `coulomb_friction` and `breakaway_friction`."""
    friction_table: AngleTable | None = None  # N*m
    """Table over the mechanical angle whose torque is added to `coulomb_friction` and
    `breakaway_friction`."""

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
    """Shaft in whose revolutions `order` counts: the `input` of the gear (the motor) or the `output` of the
    gear."""
    order: Order
    """Order of this part of the gear's error: number of its waves per revolution of the shaft that `side`
    names."""
    angle: AngleMagnitude  # rad
    r"""Amplitude of this part of the gear's error. The part adds `angle` sin(`order` $\theta$ + `phase`) to
    the output's angle. $\theta$ is the angle of the shaft that `side` names."""
    phase: Angle = 0.0  # rad
    """Phase of this part of the gear's error: 360 deg are one of its waves."""


class LoadSide(Mass):
    """A second mass behind a gear and a soft shaft with backlash; inertia and friction are its own."""

    stiffness: Stiffness  # N*m/rad
    """Stiffness of the shaft between gear and load: torque per angle of twist, on the load's side of the
    gear."""
    damping: ViscousFriction = 0.0  # N*m*s/rad
    """Damping of the shaft between gear and load: torque per speed of twist, on the load's side of the
    gear."""
    backlash: AngleMagnitude = 0.0  # rad
    """Whole width of the gap between shaft and load, as an angle of the load. Within the gap the shaft has no
    torque."""
    ratio: Annotated[float, Field(gt=0)] = 1.0
    """Ratio of the gear: speed of the motor divided by the speed of the load."""
    gear_errors: Many[GearError] = ()
    """Parts of the gear's angle error (transmission error), one for each order."""

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
    """Axis of the accelerometer along which the carriage moves. The name of each log contains it."""
    rate: Frequency = 3200.0  # Hz
    """Number of samples per second. `trace.rate` must be at least four times as high."""
    rate_error: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    """Largest relative error of the sample rate, since the accelerometer has its own clock. The error is
    drawn at random for each log. The times in a log are right, as Klipper measures the clock; only their
    spacing differs from 1/`rate`."""
    noise: AccelerationMagnitude = 0.0  # m/s^2
    """Standard deviation of the noise in each axis of each sample."""
    resolution: AccelerationMagnitude = 0.0  # m/s^2
    """Step of the measured acceleration, such as 0.0392 m/s^2 of an ADXL345. 0: no steps."""
    late: Time = 0.0  # s
    """Largest time by which a log begins later than its run. The time is drawn at random for each log."""
    logs: Annotated[int, Field(ge=1, le=100)] = 1
    """Number of logs that are written for each run. Each log has its own random noise, clock error and
    start."""


class Belt(Table):
    """A toothed belt on the motor's pulley that pulls a carriage: a `load_side` in the carriage's words."""

    pulley_teeth: Annotated[int, Field(ge=4, le=1000)]
    """Number of teeth of the pulley on the motor's shaft."""
    pitch: Length = 2e-3  # m
    """Length of the belt per tooth."""
    mass: CarriageMass  # kg
    """Mass of the carriage and of everything that moves with it. For one axis of a CoreXY printer, give half
    of the mass that moves along this axis."""
    resonance: Frequency | None = None  # Hz
    """Frequency at which the carriage oscillates on its belt while the motor's shaft is held. Give
    `resonance` or `stiffness`. Do not give the resonance that is measured for an input shaper: in that
    measurement the motor's shaft moves, too."""
    stiffness: BeltStiffness | None = None  # N/m
    """Stiffness of the belt: force per change of length, both halves of the belt together. Give `resonance`
    or `stiffness`."""
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Damping of the carriage's oscillation on its belt, relative to critical damping."""
    friction: Force = 0.0  # N
    """Friction force on the carriage while it moves."""
    accelerometer: Accelerometer | None = None
    """Accelerometer on the carriage, whose logs each run writes. It does not change the motion. Default: no
    logs."""

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
    """Second mass, behind a gear and an elastic shaft. `inertia` and the frictions in `[mechanics]` are then
    those of the motor's side. Default: one mass."""
    belt: Belt | None = None
    """Carriage on a belt. It replaces `load_side`. Default: no belt."""
    load: Load = Load()
    """Load torque that belongs to the machine: it also acts in the calibration run of the law `anti-cogging`.
    A plain torque is short for `{ torque = ... }`."""

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
