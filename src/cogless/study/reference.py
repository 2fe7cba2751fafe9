"""References of the drive: a speed, or moves from angle to angle, in one of several forms."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, Self

from pydantic import PrivateAttr, ValidationInfo, model_validator

from cogless.study.csv_table import Points, points
from cogless.study.table import (
    Angle,
    AngularAcceleration,
    AngularSpeed,
    File,
    Frequency,
    Many,
    Table,
    Time,
    invalid,
)
from cogless.units import TURN

Kind = Literal["constant", "ramp", "profile", "sine", "fm", "sines", "moves", "file"]
REFERENCE_FORMS: dict[Kind, set[str]] = {
    "constant": {"speed"},
    "ramp": {"speed", "ramp"},
    "profile": {"profile"},
    "sine": {"offset", "amplitude", "frequency"},
    "fm": {"offset", "amplitude", "frequency", "depth", "modulation"},
    "sines": {"offset", "sines"},
    "moves": {"moves"},
    "file": {"file"},
}


class Sine(Table):
    """A sinusoidal part of a speed reference: amplitude sin(2 pi frequency t + phase)."""

    amplitude: AngularSpeed  # rad/s
    """Amplitude of this sine, a speed."""
    frequency: Frequency  # Hz
    """Frequency of this sine."""
    phase: Angle = 0.0  # rad
    """Phase of this sine at the start of the run."""


class Reference(Table):
    """The mechanical speed reference, in one of several forms.

    Its integral, which begins at the initial angle, is the angle reference. Forms: a constant; a ramp; a
    profile; offset + amplitude sin(2 pi f t); the same with frequency modulation, offset + amplitude sin(2 pi
    f t + depth sin(2 pi modulation t)); a sum of sines; smooth moves from angle to angle; a file.
    """

    speed: AngularSpeed = 0.0  # rad/s
    """Constant speed of the reference. With `ramp`: the speed at which the ramp ends."""
    ramp: AngularAcceleration = 0.0  # rad/s^2
    """Slope of a ramp of the speed, which begins at `initial_speed` and ends at `speed`."""
    profile: Many[tuple[Time, AngularSpeed]] = ()  # s
    """Points `[time, speed]` of the reference. Between two points the speed is linear; before the first and
    after the last point it is constant."""
    offset: AngularSpeed = 0.0  # rad/s
    """Mean speed of the reference, to which the sine of `amplitude` and `frequency`, or the `sines`, are
    added."""
    amplitude: AngularSpeed = 0.0  # rad/s
    """Amplitude of the sine in the speed of the reference."""
    frequency: Frequency = 0.0  # Hz
    """Frequency of the sine in the speed of the reference."""
    depth: float = 0.0
    """Modulation index of a frequency modulation: largest change of the frequency, divided by `modulation`.
    The speed at the time $t$ is `offset` + `amplitude` sin(2π `frequency` $t$ + `depth` sin(2π `modulation`
    $t$))."""
    modulation: Frequency = 0.0  # Hz
    """Frequency with which the frequency of the sine is modulated (see `depth`)."""
    sines: Many[Sine] = ()
    """Sines of the speed that are added to `offset`."""
    moves: Many[tuple[Time, Angle]] = ()  # s
    """Points `[time, angle]` of the reference, which is at rest at each point. Between two points the angle
    is a polynomial of the fifth degree."""
    file: File | None = None
    """CSV file with the time and the speed of the reference, in s and rad/s, or in the units of its first
    line: `time [s],speed [rpm]`. The path is relative to the study."""
    smoothing: Time = 0.0  # s
    """Time constant of a critically damped filter that removes [steps](/theory/references.md) from the speed
    of the reference. Every form of reference may have it. 0: no filter."""
    _from_file: Points = PrivateAttr(default=())

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return {"speed": data}
        pairs = {
            key: tuple(tuple(p) if isinstance(p, list) else p for p in data[key])
            for key in ("profile", "moves")
            if isinstance(data.get(key), list)
        }
        return {**data, **pairs}

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if self.model_fields_set - {"smoothing"} not in REFERENCE_FORMS.values():
            forms = "; ".join(", ".join(sorted(form)) for form in REFERENCE_FORMS.values())
            raise invalid(f"expected the keys of one form: {forms}")
        for key in ("profile", "moves"):
            times = [time for time, _ in getattr(self, key)]
            if self.kind == key and (not times or any(b <= a for a, b in pairwise(times))):
                raise invalid("expected one or more points, each later than the previous one", key)
        return self

    @model_validator(mode="after")
    def _file(self, info: ValidationInfo) -> Self:
        if self.file is not None and info.context:
            self._from_file = points(info.context["folder"] / self.file)
        return self

    @cached_property
    def kind(self) -> Kind:
        """Name of the form that this reference has."""
        return next(
            kind for kind, keys in REFERENCE_FORMS.items() if keys == self.model_fields_set - {"smoothing"}
        )

    @property
    def points(self) -> Points:
        """Points (time in s, speed in rad/s) of a profile or a file; empty for other forms."""
        return self._from_file or self.profile

    def speeds(self, initial_speed: float = 0.0) -> tuple[float, float]:
        """Lowest and highest speed that the reference can take, signed, rad/s.

        `initial_speed`, rad/s: speed at which a ramp and the smoothing filter start.
        """
        ends = [initial_speed, self.speed] if self.kind == "ramp" else [self.speed]
        if self.points:
            ends = [speed for _, speed in self.points]
        elif self.moves:
            # a fifth-degree polynomial at rest at both ends has at most 15/8 of its mean speed
            means = [(b - a) / (end - start) for (start, a), (end, b) in pairwise(self.moves)]
            ends = [0.0, *(15 / 8 * mean for mean in means)]
        waves = abs(self.amplitude) + sum(abs(sine.amplitude) for sine in self.sines)
        start = [initial_speed] if self.smoothing else []  # the filter starts at this speed
        return (
            min([*start, min(ends) + self.offset - waves]),
            max([*start, max(ends) + self.offset + waves]),
        )

    def top_acceleration(self, initial_speed: float = 0.0) -> float:
        """Largest magnitude that the reference's acceleration can take, rad/s^2.

        `initial_speed`, rad/s: speed at which the smoothing filter starts.
        """
        slopes = [abs((b - a) / (end - start)) for (start, a), (end, b) in pairwise(self.points)]
        # a fifth-degree polynomial at rest at both ends has at most 10 / sqrt(3) distance / time^2
        moving = [
            10 / math.sqrt(3) * abs(b - a) / (end - start) ** 2
            for (start, a), (end, b) in pairwise(self.moves)
        ]
        rate = TURN * self.frequency + TURN * abs(self.depth) * self.modulation
        waves = abs(self.amplitude) * rate
        waves += sum(TURN * abs(sine.amplitude) * sine.frequency for sine in self.sines)
        jump = self._at_start() - initial_speed if self.smoothing and self.kind != "ramp" else 0.0
        # the critically damped filter's response to a unit step has the largest slope 1 / (e smoothing)
        return max([waves, self.ramp, *slopes, *moving]) + abs(jump) / (math.e * (self.smoothing or 1.0))

    def _at_start(self) -> float:
        """Speed at time zero before the smoothing filter, rad/s. Not valid for a ramp."""
        for (start, a), (end, b) in pairwise(self.points):
            if start <= 0 < end:
                return a - (b - a) * start / (end - start)
        if self.points:
            return self.points[0 if self.points[0][0] > 0 else -1][1]
        waves = sum(sine.amplitude * math.sin(sine.phase) for sine in self.sines)
        return self.speed + self.offset + waves
