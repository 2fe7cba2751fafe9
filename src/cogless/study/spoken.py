"""Units in which speeds and angles are shown: a user who wrote rpm in his study reads rpm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cogless import units
from cogless.study.base import StudyBase
from cogless.units import ANGLE, ANGULAR_SPEED, Dimension, UnitError, factor, unit_of

SPOKEN = (ANGULAR_SPEED, ANGLE)
TOLD_IN = ("scenario", "drive")  # tables whose units describe a run, unlike a motor's or a controller's


def spoken_unit(study: StudyBase, dimension: Dimension) -> str:
    """Unit in which to show a quantity: an angle or a speed as in the study, others in SI.

    For an angle or a speed it is the unit of the first metric of this dimension, else of the first such
    quantity in the scenarios or the drive, else the SI unit.
    """
    if dimension not in SPOKEN:
        return dimension.unit
    metrics = (m.unit for m in study.metric if m.unit and m.dimension == dimension)
    texts = (unit_of(text) for room in TOLD_IN for text in _texts(study.source.tables.get(room)))
    return next(metrics, None) or next((u for u in texts if u and _fits(u, dimension)), dimension.unit)


def speed_text(study: StudyBase, omega_m: float, digits: int = 4) -> str:
    """Magnitude of a speed as a text, in the unit that the study uses. `omega_m`: in rad/s."""
    return units.format(abs(omega_m), spoken_unit(study, ANGULAR_SPEED), ANGULAR_SPEED, digits)


def _texts(value: Any) -> Iterator[str]:
    """Every string in a table, including the tables and lists within it."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def _fits(unit: str, dimension: Dimension) -> bool:
    try:
        return bool(factor(unit, dimension))
    except UnitError:
        return False
