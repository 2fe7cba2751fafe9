"""The catalogue of motors by class, of encoders and of drives: the files of the folder parts/.

A figure is a typical value, its range, and a reason: who published it, or the rule by which it is guessed.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from cogless import units
from cogless.files import shipped
from cogless.units import Dimension

Kind = Literal["motors", "encoders", "drives"]

DIMENSIONS: dict[str, Dimension] = {
    "rated_torque": units.TORQUE,
    "rated_current": units.CURRENT,
    "kv": units.SPEED_CONSTANT,
    "resistance": units.RESISTANCE,
    "inductance": units.INDUCTANCE,
    "inertia": units.INERTIA,
    "bus_voltage": units.VOLTAGE,
    "voltage": units.VOLTAGE,
    "step_angle": units.ANGLE,
    "once": units.ANGLE,
    "twice": units.ANGLE,
    "placement": units.ANGLE,
    "latency": units.TIME,
    "reading": units.TIME,
    "current_loop": units.FREQUENCY,
    "speed_loop": units.FREQUENCY,
    "timer": units.FREQUENCY,
    "current_limit": units.CURRENT,
    "current_range": units.CURRENT,
    "dead_time": units.TIME,
}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A value of the catalogue, SI. `reason`: its source, or the rule of a guess (`is_guess`)."""

    typical: float
    low: float
    high: float
    reason: str
    is_guess: bool

    def scaled(self, factor: float) -> Figure:
        """The figure with value and range times a factor."""
        low, typical, high = (factor * value for value in (self.low, self.typical, self.high))
        return Figure(typical=typical, low=low, high=high, reason=self.reason, is_guess=self.is_guess)


@dataclass(frozen=True, kw_only=True)
class Part:
    """An entry of the catalogue: a class of motors, an encoder or a drive."""

    name: str
    description: str
    figures: dict[str, Figure]
    table: dict[str, Any]

    def __getitem__(self, key: str) -> Figure:
        return self.figures[key]

    @property
    def layouts(self) -> tuple[tuple[int, int], ...]:
        """Slots and poles that motors of the class have, the usual first; empty for a step motor."""
        table = self.table.get("layouts")
        return tuple((s, p) for s, p in (table["typical"], *table["others"])) if table else ()


def _figure(key: str, table: dict[str, Any]) -> Figure:
    dimension = DIMENSIONS.get(key)

    def number(value: Any) -> float:
        return units.parse(value, dimension) if dimension and isinstance(value, str) else float(value)

    low, high = table.get("range", (table.get("typical"),) * 2)
    return Figure(
        typical=number(table.get("typical", low)),
        low=number(low),
        high=number(high),
        reason=table.get("source") or table["guess"],
        is_guess="source" not in table,
    )


@cache
def parts(kind: Kind) -> dict[str, Part]:
    """The parts of a kind, by name."""
    return {name: _part(name, table) for name, table in _file(kind).items() if name != "named"}


@cache
def named_motors() -> dict[str, dict[str, Any]]:
    """The shipped motors that the catalogue knows: class, slots and rated current, by name."""
    named: dict[str, dict[str, Any]] = _file("motors")["named"]
    return named


def _part(name: str, table: dict[str, Any]) -> Part:
    figures = {key: _figure(key, value) for key, value in table.items() if _is_figure(value)}
    return Part(name=name, description=table["about"], figures=figures, table=table)


def _is_figure(value: Any) -> bool:
    return isinstance(value, dict) and not isinstance(value.get("typical"), list)


@cache
def _file(kind: Kind) -> dict[str, Any]:
    return tomllib.loads(shipped("parts")[kind].read_text(encoding="utf-8"))
