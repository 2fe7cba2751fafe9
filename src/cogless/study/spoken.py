"""The units in which a study speaks of speeds and angles, so that whoever wrote rpm reads rpm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cogless import units
from cogless.study.base import StudyBase
from cogless.units import ANGLE, ANGULAR_SPEED, Dimension, UnitError, factor, unit_of

SPOKEN = (ANGULAR_SPEED, ANGLE)
TOLD_IN = ("scenario", "drive")  # tables: a motor's phases and a controller's gains say nothing of a run


def spoken_unit(study: StudyBase, dimension: Dimension) -> str:
    """The unit of the first such metric, else of the first such quantity in the scenarios or the drive.

    SI where the study has neither, and of what is no speed and no angle.
    """
    if dimension not in SPOKEN:
        return dimension.unit
    metrics = (m.unit for m in study.metric if m.unit and m.dimension == dimension)
    texts = (unit_of(text) for room in TOLD_IN for text in _texts(study.source.tables.get(room)))
    return next(metrics, None) or next((u for u in texts if u and _fits(u, dimension)), dimension.unit)


def speed_text(study: StudyBase, omega_m: float, digits: int = 4) -> str:
    """The magnitude of a speed in rad/s, as the study speaks."""
    return units.format(abs(omega_m), spoken_unit(study, ANGULAR_SPEED), ANGULAR_SPEED, digits)


def _texts(value: Any) -> Iterator[str]:
    """Every text of a table and of the tables and lists in it."""
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
