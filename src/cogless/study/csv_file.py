"""Read a CSV file whose heading names columns and their units, with errors that name the line."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cogless import units
from cogless.files import no_device
from cogless.study.table import invalid
from cogless.units import Dimension

POINTS = ", and decimal points in numbers"
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
HUGE = 1e9  # in the column's unit: beyond any drive
NAME = re.compile(r"\s*([^\W\d_]+)")  # in "error [deg]" and "error_deg"
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]\s*$")  # speed [rpm]


def lines(path: Path) -> list[list[str]]:
    """The cells of each line of the file; an error if it can't be read."""
    try:
        no_device(path)
        return list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, ValueError, csv.Error):
        raise invalid(f"expected a readable file at {path}", "file") from None


def finite(text: str, number: float, name: str, where: str) -> float:
    """The number, if it is finite and not absurd; else an error that quotes its cell."""
    if not abs(number) < HUGE:
        raise invalid(f"{where}{shown(text)}: expected a finite {name}", "file")
    return number


def scale(cell: str, name: str, dimension: Dimension) -> float | None:
    """Factor to SI of the unit that a cell of the heading names; None without one."""
    unit = _unit(cell)
    try:
        return None if unit is None else units.factor(unit, dimension)
    except units.UnitError:
        expected = f'expected a unit of {dimension.name}, such as "{name} [{dimension.unit}]"'
        raise invalid(f"line 1: {shown(cell)}: {expected}", "file") from None


def _unit(cell: str) -> str | None:
    """Unit in "speed [rpm]", "speed (rpm)", "speed rpm", "speed_rpm" and "speed/rpm"; None without one."""
    bracketed = BRACKETS.search(cell)
    if bracketed:
        return bracketed[1].strip()
    last = (re.split(r"[\s_]+", cell.strip()) or [""])[-1]
    # a single letter is more likely an index than a unit
    return next((w for w in (last, last.partition("/")[2]) if len(w) > 1 and units.is_known(w)), None)


def shown(*cells: str) -> str:
    """The cells as written in the file, in quotes, shortened to 40 characters."""
    text = ",".join(cells)
    return f'"{text if len(text) <= 40 else text[:37] + "..."}"'


@dataclass(frozen=True)
class Rising:
    """A value along another that rises from line to line, both SI."""

    name: str  # of the value's column
    along: list[float] = field(default_factory=list)
    value: list[float] = field(default_factory=list)
    line: list[int] = field(default_factory=list)  # of the file, from 1


def rising(path: Path, along: tuple[str, Dimension], columns: Mapping[str, Dimension]) -> Rising:
    """Read the column `along`, which must rise, and one of `columns`, whichever the heading has.

    Other columns are left alone. The errors' key is "file".
    """
    heading, *rows = lines(path) or [[]]
    if len(heading) == 1 and any(other in heading[0] for other in ";\t"):
        raise invalid(f"line 1: {shown(*heading)}: expected commas between columns{POINTS}", "file")
    names = [word[1].lower() if (word := NAME.match(cell)) else "" for cell in heading]
    axis, dimension = along
    name = _only(heading, names, columns)
    units_of = {axis: dimension, name: columns[name]}
    if names.count(axis) != 1:
        example = f'"{axis} [{dimension.example or dimension.unit}]"'
        raise invalid(f"line 1: {shown(*heading)}: expected one column such as {example}", "file")
    places = {
        column: (names.index(column), _scale(heading, names, column, units_of[column])) for column in units_of
    }
    found = Rising(name)
    for number, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(heading):
            points = POINTS if len(row) > len(heading) else ""
            raise invalid(f"line {number}: {shown(*row)}: expected {len(heading)} columns{points}", "file")
        here, there = (
            _number(row[place], column, number) * factor for column, (place, factor) in places.items()
        )
        if found.along and here <= found.along[-1]:
            cell, article = shown(row[places[axis][0]]), "an" if axis[0] in "aeiou" else "a"
            raise invalid(f"line {number}: {cell}: expected {article} {axis} above the one before", "file")
        found.along.append(here)
        found.value.append(there)
        found.line.append(number)
    return found


def _only(heading: list[str], names: list[str], columns: Mapping[str, Dimension]) -> str:
    """The name of the value's column."""
    found = [name for name in names if name in columns]
    if len(found) == 1:
        return found[0]
    examples = " or ".join(
        f'"{name} [{dimension.example or dimension.unit}]"' for name, dimension in columns.items()
    )
    raise invalid(f"line 1: {shown(*heading)}: expected one column such as {examples}", "file")


def _scale(heading: list[str], names: list[str], column: str, dimension: Dimension) -> float:
    cell = heading[names.index(column)]
    factor = scale(cell, column, dimension)
    if factor is None:
        example = f'"{column} [{dimension.example or dimension.unit}]"'
        raise invalid(f"line 1: {shown(cell)}: expected a unit too, such as {example}", "file")
    return factor


def _number(text: str, name: str, line: int) -> float:
    where = f"line {line}: "
    try:
        number = float(text)
    except ValueError:
        how = " with a decimal point" if DECIMAL_COMMA.fullmatch(text) else ""
        raise invalid(f"{where}{shown(text)}: expected a number{how}", "file") from None
    return finite(text, number, name, where)
