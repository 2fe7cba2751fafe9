"""Read a CSV file whose heading names columns and their units, with errors that name the line."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from cogless import units
from cogless.study.table import invalid
from cogless.units import Dimension

HUGE = 1e9  # in the column's unit: beyond any drive
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]\s*$")  # speed [rpm]


def lines(path: Path) -> list[list[str]]:
    """The cells of each line of the file; an error if it can't be read."""
    try:
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
