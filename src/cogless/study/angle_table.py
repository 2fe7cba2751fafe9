"""A value over one revolution from a CSV file: angle and value, in the units that its heading names."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from pydantic_core import PydanticCustomError

from cogless import units
from cogless.study.csv_file import rising
from cogless.study.table import invalid
from cogless.units import Dimension

TURN = 2 * math.pi
FEWEST = 8  # points
GAP = 5.0  # times the median spacing: a wider one is a hole in the table
SEAM = 3.0  # times the largest step between neighbours: a larger one from the end to the start is a mistake


@dataclass(frozen=True)
class OverAngle:
    """A value over one revolution, at rising angles less than a revolution apart."""

    name: str  # of the value's column
    angle: tuple[float, ...]  # rad
    value: tuple[float, ...]  # SI

    def harmonics(self, highest: int) -> list[tuple[float, float]]:
        """Amplitude (SI) and phase (rad) of each order from 0 to `highest`.

        An order is amplitude sin(order angle + phase); order 0 is the mean, with the phase pi/2. Equally
        spaced points are transformed as they are, others are interpolated by a periodic cubic spline first.
        `highest`: below half the number of points.
        """
        import numpy as np

        angle, value = np.array(self.angle), np.array(self.value)
        count, step = len(angle), TURN / len(angle)
        if highest >= count / 2:
            raise ValueError(f"expected orders below {count / 2:g}, half the number of points")
        if np.abs(np.diff(angle) - step).max() > 1e-6 * step:
            from scipy.interpolate import CubicSpline

            spline = CubicSpline([*angle, angle[0] + TURN], [*value, value[0]], bc_type="periodic")
            count *= 8
            value = spline(angle[0] + TURN / count * np.arange(count))
        order = np.arange(highest + 1)
        waves = np.fft.rfft(value)[: highest + 1] / count * np.exp(-1j * order * angle[0])
        waves[1:] *= 2
        return [(float(abs(c)), float(np.angle(1j * c))) for c in waves]


def read(path: Path, columns: Mapping[str, Dimension], key: str = "file") -> OverAngle:
    """Read the column `angle` and one of `columns`, whichever the heading has; others are left alone.

    A last point a revolution after the first closes the table and is left out. `key`: of the study's table,
    whose value is the file. The errors name it and the line.
    """
    try:
        return _read(path, columns)
    except PydanticCustomError as error:
        raise invalid((error.context or {})["expected"], key) from None


def _read(path: Path, columns: Mapping[str, Dimension]) -> OverAngle:
    found = rising(path, ("angle", units.ANGLE), columns)
    return _whole(found.name, found.along, found.value, found.line)


def _whole(name: str, angle: list[float], value: list[float], at: list[int]) -> OverAngle:
    """The table, if it covers a revolution without holes and its end fits its start."""
    if len(angle) < FEWEST:
        raise invalid(f"{len(angle)} lines of numbers: expected {FEWEST} or more over a revolution", "file")
    span, last = angle[-1] - angle[0], at[-1]
    if span > TURN * (1 + 1e-6):
        raise invalid(
            f"line {last}: {math.degrees(span):.6g} deg after the first: expected one revolution", "file"
        )
    largest = max(abs(b - a) for a, b in pairwise(value[:-1]))  # the last may be the start again
    step = abs(value[-1] - value[0])
    if step > SEAM * largest:
        raise invalid(
            f"line {last}: the {name} does not close over the revolution: from the last to the first it "
            f"steps {step / largest if largest else math.inf:.3g} times as far as anywhere else",
            "file",
        )
    if span > TURN * (1 - 1e-6):
        del angle[-1], value[-1]
    gaps = [b - a for a, b in pairwise([*angle, angle[0] + TURN])]
    widest = max(range(len(gaps)), key=gaps.__getitem__)
    usual = statistics.median(gaps)
    if gaps[widest] > GAP * usual:
        raise invalid(
            f"line {at[widest]}: the next angle comes after {math.degrees(gaps[widest]):.3g} deg: expected "
            f"at most {math.degrees(GAP * usual):.3g} deg, {GAP:g} times the usual",
            "file",
        )
    return OverAngle(name, tuple(angle), tuple(value))
