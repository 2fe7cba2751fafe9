"""A reference from a CSV file: time and speed, in the units that its heading names."""

from __future__ import annotations

from pathlib import Path

from cogless import units
from cogless.study.csv_file import POINTS, finite, lines, scale, shown
from cogless.study.table import invalid

COLUMNS = (("time", units.TIME), ("speed", units.ANGULAR_SPEED))
Points = tuple[tuple[float, float], ...]


def points(path: Path) -> Points:
    """Time (s) and speed (rad/s) of each line; raises an error that names the line and quotes it."""
    found: list[tuple[float, float]] = []
    scales, expected = (1.0, 1.0), f"expected time in s and speed in rad/s, with a comma between{POINTS}"
    for number, row in enumerate(lines(path), start=1):
        where = f"line {number}: "
        if not any(cell.strip() for cell in row):
            continue
        try:
            time, speed = (float(cell) for cell in row)
        except ValueError:
            if number == 1:
                scales = _scales(row)
                continue
            raise invalid(f"{where}{shown(*row)}: {expected}", "file") from None
        for value, text, (name, _) in zip((time, speed), row, COLUMNS, strict=True):
            finite(text, value, name, where)
        if found and time * scales[0] <= found[-1][0]:
            raise invalid(f"{where}{shown(row[0])}: expected a time after the line before", "file")
        found.append((time * scales[0], speed * scales[1]))
    if not found:
        raise invalid("expected lines of time in s and speed in rad/s", "file")
    return tuple(found)


def _scales(heading: list[str]) -> tuple[float, float]:
    """Factors that convert times and speeds to SI, from the units that a heading names."""
    if len(heading) != len(COLUMNS):
        raise invalid(
            f"line 1: {shown(*heading)}: expected two columns, time and speed, with a comma between", "file"
        )
    time, speed = (scale(cell, *column) or 1.0 for cell, column in zip(heading, COLUMNS, strict=True))
    return time, speed
