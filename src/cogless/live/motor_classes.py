"""The catalogue's classes of motors as values of a page's keys, for one's own motor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cogless.live.keys import Key
from cogless.starter.motor_rules import cogging_orders
from cogless.starter.part_catalogue import Part, parts

OWN_CLASS = "own"  # stands for any motor; a page doesn't offer it


def motor_classes(keys: Sequence[Key]) -> list[dict[str, Any]]:
    """Each class with a winding of three phases: its name, its words, and a value for each key of the motor.

    A value is the class's typical one in the key's unit, to four digits. Keys that the page lacks get none.
    """
    candidates = {key.candidate.key: key.candidate for key in keys}
    classes = []
    for name, part in parts("motors").items():
        if name != OWN_CLASS and part.layouts:
            usual = {key: value for key, value in _usual(part).items() if key in candidates}
            values = {key: float(f"{x / candidates[key].factor:.4g}") for key, x in usual.items()}
            classes.append({"name": name, "words": part.description, "values": values})
    return classes


def _usual(part: Part) -> dict[str, float]:
    """The typical values of a class, SI, by the keys of a study. R and L are between two terminals."""
    slots, poles = part.layouts[0]
    torque = part["rated_torque"].typical
    values = {
        "motor.pole_pairs": poles / 2,
        "motor.resistance_line_to_line": 2 * part["resistance"].typical,
        "motor.inductance_line_to_line": 2 * part["inductance"].typical,
        "motor.kv": part["kv"].typical,
        "mechanics.inertia": part["inertia"].typical,
        "mechanics.coulomb_friction": part["friction"].typical * torque,
        "drive.inverter.bus_voltage": part["bus_voltage"].typical,
    }
    for n, (word, order) in enumerate(cogging_orders(slots, poles).items()):
        values[f"motor.cogging.{n}.order"] = float(order)
        values[f"motor.cogging.{n}.torque"] = part[word].typical * torque
    return values
