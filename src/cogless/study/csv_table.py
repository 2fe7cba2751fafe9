"""Read tables in CSV files. The heading names columns and their units, and errors name the line.

`rising`: a value along another that rises. `read`: a value over the angle of one revolution. `points`: a
reference, speed over time, whose file may lack the heading.
"""

from __future__ import annotations

import csv
import math
import re
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

from pydantic_core import PydanticCustomError

from cogless import units
from cogless.files import no_device
from cogless.study.table import invalid
from cogless.units import TURN, Dimension

DECIMAL_POINT_HINT = ", and decimal points in numbers"
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
VALUE_MOST = 1e9  # bound of a value in the column's unit, beyond any drive
COLUMN_NAME = re.compile(r"\s*([^\W\d_]+)")  # finds "error" in "error [deg]" and "error_deg"
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]\s*$")  # speed [rpm]


def cell_lines(path: Path) -> list[list[str]]:
    """The cells of each line of the file; an error if it can't be read."""
    try:
        no_device(path)
        return list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, ValueError, csv.Error):
        raise invalid(f"expected a readable file at {path}", "file") from None


def finite(text: str, number: float, name: str, where: str) -> float:
    """Return the number; raise an error that quotes the cell if the number isn't below VALUE_MOST."""
    if not abs(number) < VALUE_MOST:
        raise invalid(f"{where}{quoted_cells(text)}: expected a finite {name}", "file")
    return number


def scale(cell: str, name: str, dimension: Dimension) -> float | None:
    """Factor to SI of the unit that a cell of the heading names; None if the cell names no unit."""
    unit = _unit(cell)
    try:
        return None if unit is None else units.factor(unit, dimension)
    except units.UnitError:
        expected = f'expected a unit of {dimension.name}, such as "{name} [{dimension.unit}]"'
        raise invalid(f"line 1: {quoted_cells(cell)}: {expected}", "file") from None


def _unit(cell: str) -> str | None:
    """Unit in "speed [rpm]", "speed (rpm)", "speed rpm", "speed_rpm" and "speed/rpm"; None without one."""
    bracketed = BRACKETS.search(cell)
    if bracketed:
        return bracketed[1].strip()
    last = (re.split(r"[\s_]+", cell.strip()) or [""])[-1]
    # a single letter is more likely an index than a unit
    return next((w for w in (last, last.partition("/")[2]) if len(w) > 1 and units.is_known(w)), None)


def quoted_cells(*cells: str) -> str:
    """The cells as written in the file, in quotes, shortened to 40 characters."""
    text = ",".join(cells)
    return f'"{text if len(text) <= 40 else text[:37] + "..."}"'


@dataclass(frozen=True)
class Rising:
    """A column of values, and a column along which they are given and which rises; both SI."""

    name: str  # heading of the value's column
    along: list[float] = field(default_factory=list)
    value: list[float] = field(default_factory=list)
    line: list[int] = field(default_factory=list)  # the file's first is 1


def rising(path: Path, along: tuple[str, Dimension], columns: Mapping[str, Dimension]) -> Rising:
    """Read the column `along`, which must rise, and the one of `columns` that the heading has.

    Other columns are ignored. Errors name the key "file".
    """
    heading, *rows = cell_lines(path) or [[]]
    if len(heading) == 1 and any(other in heading[0] for other in ";\t"):
        raise invalid(
            f"line 1: {quoted_cells(*heading)}: expected commas between columns{DECIMAL_POINT_HINT}", "file"
        )
    names = [word[1].lower() if (word := COLUMN_NAME.match(cell)) else "" for cell in heading]
    axis, dimension = along
    name = _only(heading, names, columns)
    units_of = {axis: dimension, name: columns[name]}
    if names.count(axis) != 1:
        example = f'"{axis} [{dimension.example or dimension.unit}]"'
        raise invalid(f"line 1: {quoted_cells(*heading)}: expected one column such as {example}", "file")
    places = {
        column: (names.index(column), _scale(heading, names, column, units_of[column])) for column in units_of
    }
    rising_column = Rising(name)
    for number, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(heading):
            points = DECIMAL_POINT_HINT if len(row) > len(heading) else ""
            raise invalid(
                f"line {number}: {quoted_cells(*row)}: expected {len(heading)} columns{points}", "file"
            )
        place_here, value_there = (
            _number(row[place], column, number) * factor for column, (place, factor) in places.items()
        )
        if rising_column.along and place_here <= rising_column.along[-1]:
            cell, article = quoted_cells(row[places[axis][0]]), "an" if axis[0] in "aeiou" else "a"
            raise invalid(
                f"line {number}: {cell}: expected {article} {axis} above that of the previous line", "file"
            )
        rising_column.along.append(place_here)
        rising_column.value.append(value_there)
        rising_column.line.append(number)
    return rising_column


def _only(heading: list[str], names: list[str], columns: Mapping[str, Dimension]) -> str:
    """The name of the value's column."""
    value_names = [name for name in names if name in columns]
    if len(value_names) == 1:
        return value_names[0]
    examples = " or ".join(
        f'"{name} [{dimension.example or dimension.unit}]"' for name, dimension in columns.items()
    )
    raise invalid(f"line 1: {quoted_cells(*heading)}: expected one column such as {examples}", "file")


def _scale(heading: list[str], names: list[str], column: str, dimension: Dimension) -> float:
    cell = heading[names.index(column)]
    factor = scale(cell, column, dimension)
    if factor is None:
        example = f'"{column} [{dimension.example or dimension.unit}]"'
        raise invalid(f"line 1: {quoted_cells(cell)}: expected a unit, too, such as {example}", "file")
    return factor


def _number(text: str, name: str, line: int) -> float:
    where = f"line {line}: "
    try:
        number = float(text)
    except ValueError:
        how = " with a decimal point" if DECIMAL_COMMA.fullmatch(text) else ""
        raise invalid(f"{where}{quoted_cells(text)}: expected a number{how}", "file") from None
    return finite(text, number, name, where)


POINTS_LEAST = 8  # points in a revolution
GAP_RATIO = 5.0  # largest spacing of angles / median spacing; above, the table has a hole
# step of the value from the end to the start / largest other step; above, the table doesn't close
SEAM_RATIO = 3.0


@dataclass(frozen=True)
class OverAngle:
    """A value over one revolution, at rising angles less than a revolution apart."""

    name: str  # heading of the value's column
    angle: tuple[float, ...]  # rad
    value: tuple[float, ...]  # SI

    def harmonics(self, highest: int) -> tuple[tuple[float, float], ...]:
        """Amplitude (SI) and phase (rad) of each order from 0 to `highest`.

        An order is amplitude sin(order angle + phase); order 0 is the mean, with the phase pi/2. Equally
        spaced points are transformed as they are, others are interpolated by a periodic cubic spline first.
        `highest`: below half the number of points.
        """
        return _harmonics(self, highest)


@lru_cache(maxsize=16)  # the runs of a study, and its changed copies, begin with the same tables
def _harmonics(table: OverAngle, highest: int) -> tuple[tuple[float, float], ...]:
    import numpy as np

    angle, value = np.array(table.angle), np.array(table.value)
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
    return tuple((float(abs(c)), float(np.angle(1j * c))) for c in waves)


def read(path: Path, columns: Mapping[str, Dimension], key: str = "file") -> OverAngle:
    """Read the column `angle` and the one of `columns` that the heading has; other columns are ignored.

    A last point a revolution after the first closes the table and is left out. `key`: the key of the study
    that names the file. Errors name this key and the line.
    """
    try:
        return _read(path, columns)
    except PydanticCustomError as error:
        raise invalid((error.context or {})["expected"], key) from None


def _read(path: Path, columns: Mapping[str, Dimension]) -> OverAngle:
    column = rising(path, ("angle", units.ANGLE), columns)
    return _whole(column.name, column.along, column.value, column.line)


def _whole(name: str, angle: list[float], value: list[float], at: list[int]) -> OverAngle:
    """Return the table; refuse one with holes, of another length than a revolution, or that doesn't close."""
    if len(angle) < POINTS_LEAST:
        raise invalid(
            f"{len(angle)} lines of numbers: expected {POINTS_LEAST} or more in a revolution", "file"
        )
    span, last = angle[-1] - angle[0], at[-1]
    if span > TURN * (1 + 1e-6):
        raise invalid(
            f"line {last}: {math.degrees(span):.6g} deg after the first line: expected one revolution at "
            "most",
            "file",
        )
    largest = max(abs(b - a) for a, b in pairwise(value[:-1]))  # the last point may repeat the start
    step = abs(value[-1] - value[0])
    if step > SEAM_RATIO * largest:
        raise invalid(
            f"line {last}: the {name} jumps from the last line to the first, "
            f"{step / largest if largest else math.inf:.3g} times as far as anywhere else: expected a whole "
            "revolution",
            "file",
        )
    if span > TURN * (1 - 1e-6):
        del angle[-1], value[-1]
    gaps = [b - a for a, b in pairwise([*angle, angle[0] + TURN])]
    widest = max(range(len(gaps)), key=gaps.__getitem__)
    usual = statistics.median(gaps)
    if gaps[widest] > GAP_RATIO * usual:
        raise invalid(
            f"line {at[widest]}: the next angle comes after {math.degrees(gaps[widest]):.3g} deg: expected "
            f"at most {math.degrees(GAP_RATIO * usual):.3g} deg, {GAP_RATIO:g} times the usual spacing",
            "file",
        )
    return OverAngle(name, tuple(angle), tuple(value))


SPEED_COLUMNS = (("time", units.TIME), ("speed", units.ANGULAR_SPEED))
Points = tuple[tuple[float, float], ...]


def points(path: Path) -> Points:
    """Time (s) and speed (rad/s) of each line of the file. Errors name the wrong line and quote it."""
    time_and_speed: list[tuple[float, float]] = []
    scales, expected = (
        (1.0, 1.0),
        f"expected a time in s and a speed in rad/s, with a comma between them{DECIMAL_POINT_HINT}",
    )
    for number, row in enumerate(cell_lines(path), start=1):
        where = f"line {number}: "
        if not any(cell.strip() for cell in row):
            continue
        try:
            time, speed = (float(cell) for cell in row)
        except ValueError:
            if number == 1:
                scales = _scales(row)
                continue
            raise invalid(f"{where}{quoted_cells(*row)}: {expected}", "file") from None
        for value, text, (name, _) in zip((time, speed), row, SPEED_COLUMNS, strict=True):
            finite(text, value, name, where)
        if time_and_speed and time * scales[0] <= time_and_speed[-1][0]:
            raise invalid(
                f"{where}{quoted_cells(row[0])}: expected a time after that of the previous line", "file"
            )
        time_and_speed.append((time * scales[0], speed * scales[1]))
    if not time_and_speed:
        raise invalid("expected lines with a time in s and a speed in rad/s", "file")
    return tuple(time_and_speed)


def _scales(heading: list[str]) -> tuple[float, float]:
    """Factors that convert times and speeds to SI, from the units that a heading names."""
    if len(heading) != len(SPEED_COLUMNS):
        raise invalid(
            f"line 1: {quoted_cells(*heading)}: expected two columns, time and speed, with a comma between "
            "them",
            "file",
        )
    time, speed = (scale(cell, *column) or 1.0 for cell, column in zip(heading, SPEED_COLUMNS, strict=True))
    return time, speed
