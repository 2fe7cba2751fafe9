"""What speed, or what path, is asked of the drive: one of several forms."""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import PrivateAttr, ValidationInfo, model_validator

from cogless.study.table import (
    Angle,
    AngularAcceleration,
    AngularSpeed,
    Frequency,
    Many,
    Table,
    Time,
    problem,
)

Kind = Literal["constant", "ramp", "profile", "sine", "fm", "sines", "moves", "file"]
FORMS: dict[Kind, set[str]] = {
    "constant": {"speed"},
    "ramp": {"speed", "ramp"},
    "profile": {"profile"},
    "sine": {"offset", "amplitude", "frequency"},
    "fm": {"offset", "amplitude", "frequency", "depth", "modulation"},
    "sines": {"offset", "sines"},
    "moves": {"moves"},
    "file": {"file"},
}
HUGE = 1e9  # s or rad/s: beyond any reference
Points = tuple[tuple[float, float], ...]


class Sine(Table):
    """A part of a speed: amplitude sin(2 pi frequency t + phase)."""

    amplitude: AngularSpeed  # rad/s
    frequency: Frequency  # Hz
    phase: Angle = 0.0  # rad


class Reference(Table):
    """The mechanical speed reference, in one form; its angle is the integral from the initial angle on.

    constant, ramp, profile; offset + amplitude sin(2 pi f t), where depth and modulation are given with
    + depth sin(2 pi modulation t) in the argument; a sum of sines; smooth moves from angle to angle; a file.
    """

    speed: AngularSpeed = 0.0  # rad/s
    ramp: AngularAcceleration = 0.0  # rad/s^2
    profile: Many[tuple[Time, AngularSpeed]] = ()  # s, rad/s; linear between points, ends held
    offset: AngularSpeed = 0.0  # rad/s
    amplitude: AngularSpeed = 0.0  # rad/s
    frequency: Frequency = 0.0  # Hz
    depth: float = 0.0  # rad, of frequency modulation
    modulation: Frequency = 0.0  # Hz, of frequency modulation
    sines: Many[Sine] = ()
    moves: Many[tuple[Time, Angle]] = ()  # s, rad; at rest at each, polynomials of the fifth degree between
    file: str | None = None  # CSV of time [s] and speed [rad/s], relative to the study
    smoothing: Time = 0.0  # s, of a critically damped filter on the speed, so that it is differentiable
    _from_file: Points = PrivateAttr(default=())

    @model_validator(mode="before")
    @classmethod
    def _forms(cls, data: Any) -> Any:
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
        if self.model_fields_set - {"smoothing"} not in FORMS.values():
            forms = "; ".join(", ".join(sorted(form)) for form in FORMS.values())
            raise problem(f"expected the keys of one form: {forms}")
        for key in ("profile", "moves"):
            times = [time for time, _ in getattr(self, key)]
            if self.kind == key and (not times or any(b <= a for a, b in pairwise(times))):
                raise problem("expected one or more points, each later than the one before", key)
        return self

    @model_validator(mode="after")
    def _file(self, info: ValidationInfo) -> Self:
        if self.file is not None and info.context:
            self._from_file = _points(info.context["folder"] / self.file)
        return self

    @property
    def kind(self) -> Kind:
        """Which of the forms this is."""
        return next(kind for kind, keys in FORMS.items() if keys == self.model_fields_set - {"smoothing"})

    @property
    def points(self) -> Points:
        """Time, s, and speed, rad/s, of a profile or of a file."""
        return self._from_file or self.profile

    @property
    def top_speed(self) -> float:
        """The largest magnitude that the reference can take, rad/s."""
        along = [abs(speed) for _, speed in self.points]
        # a polynomial of the fifth degree, at rest at both ends, is 15/8 of its mean speed at most
        moving = [15 / 8 * abs((b - a) / (end - start)) for (start, a), (end, b) in pairwise(self.moves)]
        waves = abs(self.offset) + abs(self.amplitude) + sum(abs(sine.amplitude) for sine in self.sines)
        return max([abs(self.speed), waves, *along, *moving])

    @property
    def slowest(self) -> float:
        """The smallest speed that the reference can take, signed, rad/s."""
        if self.kind == "ramp" or self.kind == "moves":
            return min(0.0, self.speed) if self.kind == "ramp" else -self.top_speed
        if self.points:
            return min(speed for _, speed in self.points)
        waves = abs(self.amplitude) + sum(abs(sine.amplitude) for sine in self.sines)
        return self.speed + self.offset - waves

    @property
    def top_acceleration(self) -> float:
        """The largest magnitude that the reference's acceleration can take, rad/s^2."""
        turn = 2 * math.pi
        slopes = [abs((b - a) / (end - start)) for (start, a), (end, b) in pairwise(self.points)]
        # of a polynomial of the fifth degree at rest at both ends: 10 / sqrt(3) of distance over time squared
        moving = [
            10 / math.sqrt(3) * abs(b - a) / (end - start) ** 2
            for (start, a), (end, b) in pairwise(self.moves)
        ]
        rate = turn * self.frequency + turn * abs(self.depth) * self.modulation
        waves = abs(self.amplitude) * rate
        waves += sum(turn * abs(sine.amplitude) * sine.frequency for sine in self.sines)
        return max([waves, self.ramp, *slopes, *moving])


def _points(path: Path) -> Points:
    """Time and speed of each line of a CSV file; raises the error that names the line."""
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError):
        raise problem(f"expected a readable file at {path}", "file") from None
    points: list[tuple[float, float]] = []
    for number, row in enumerate(rows, start=1):
        try:
            time, speed = (float(cell) for cell in row)
        except ValueError:
            if number == 1 or not any(row):
                continue  # a heading, an empty line
            raise problem(f"line {number}: expected time in s and speed in rad/s", "file") from None
        if not (abs(time) < HUGE and abs(speed) < HUGE) or (points and time <= points[-1][0]):
            raise problem(f"line {number}: expected a time after the line before", "file")
        points.append((time, speed))
    if not points:
        raise problem("expected lines of time in s and speed in rad/s", "file")
    return tuple(points)
