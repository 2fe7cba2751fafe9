"""A reference from a CSV file: time and speed, in the units that its heading names."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from cogless import units
from cogless.study.table import invalid
from cogless.units import Dimension

HUGE = 1e9  # s or rad/s: beyond any reference
COLUMNS = (("time", units.TIME), ("speed", units.ANGULAR_SPEED))
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]\s*$")  # speed [rpm]
Points = tuple[tuple[float, float], ...]


def points(path: Path) -> Points:
    """Time (s) and speed (rad/s) of each line; raises an error that names the line and quotes it."""
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, ValueError):
        raise invalid(f"expected a readable file at {path}", "file") from None
    found: list[tuple[float, float]] = []
    scales, expected = (1.0, 1.0), "expected time in s and speed in rad/s, with a comma between"
    for number, row in enumerate(rows, start=1):
        where = f"line {number}: "
        if not any(cell.strip() for cell in row):
            continue
        try:
            time, speed = (float(cell) for cell in row)
        except ValueError:
            if number == 1:
                scales = _scales(row)
                continue
            raise invalid(f"{where}{_shown(*row)}: {expected}", "file") from None
        for value, text, (name, _) in zip((time, speed), row, COLUMNS, strict=True):
            if not abs(value) < HUGE:
                raise invalid(f"{where}{_shown(text)}: expected a finite {name}", "file")
        if found and time * scales[0] <= found[-1][0]:
            raise invalid(f"{where}{_shown(row[0])}: expected a time after the line before", "file")
        found.append((time * scales[0], speed * scales[1]))
    if not found:
        raise invalid("expected lines of time in s and speed in rad/s", "file")
    return tuple(found)


def _scales(heading: list[str]) -> tuple[float, float]:
    """Factors that convert times and speeds to SI, from the units that a heading names."""
    if len(heading) != len(COLUMNS):
        raise invalid(
            f"line 1: {_shown(*heading)}: expected two columns, time and speed, with a comma between", "file"
        )
    time, speed = (_scale(cell, *column) for cell, column in zip(heading, COLUMNS, strict=True))
    return time, speed


def _scale(cell: str, name: str, dimension: Dimension) -> float:
    unit = _unit(cell)
    try:
        return 1.0 if unit is None else units.factor(unit, dimension)
    except units.UnitError:
        expected = f'expected a unit of {dimension.name}, such as "{name} [{dimension.unit}]"'
        raise invalid(f"line 1: {_shown(cell)}: {expected}", "file") from None


def _unit(cell: str) -> str | None:
    """Unit in "speed [rpm]", "speed (rpm)", "speed rpm", "speed_rpm" and "speed/rpm"; None without one."""
    bracketed = BRACKETS.search(cell)
    if bracketed:
        return bracketed[1].strip()
    last = (re.split(r"[\s_]+", cell.strip()) or [""])[-1]
    # a single letter is more likely an index than a unit
    return next((w for w in (last, last.partition("/")[2]) if len(w) > 1 and units.is_known(w)), None)


def _shown(*cells: str) -> str:
    """The cells as written in the file, in quotes, shortened to 40 characters."""
    text = ",".join(cells)
    return f'"{text if len(text) <= 40 else text[:37] + "..."}"'
