"""The guessed values of a study, by the flag that sets each, or by its key in the study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from cogless.starter.motor_sections import class_of, put_inertia, put_motor, put_step_motor
from cogless.starter.request import NUMBERS, Answer, Request
from cogless.starter.sheet import Sheet

KEY_FLAGS = {
    "motor.pole_pairs": "pole-pairs",
    "motor.slots": "slots",
    "motor.step_angle": "step-angle",
    "motor.kv": "kv",
    "motor.resistance_line_to_line": "resistance",
    "motor.R_s": "resistance",
    "motor.inductance_line_to_line": "inductance",
    "motor.L_0": "inductance",
    "motor.rated_current": "rated-current",
    "motor.holding_torque": "holding-torque",
    "motor.detent_torque": "detent-torque",
    "mechanics.inertia": "inertia",
    "mechanics.coulomb_friction": "friction",
    "drive.inverter.bus_voltage": "bus-voltage",
    "drive.current_loop.current_limit": "current-limit",
    "drive.rates.current_loop": "current-rate",
    "drive.rates.speed_loop": "speed-rate",
    "drive.position_sensor.bits": "bits",
    "scenario.slow.reference": "speed",
}
PARTS_OF_ANSWERS = ("motor.cogging.", "drive.position_sensor.lines")  # `Sheet.answers` has the whole


def guessed_values(sheet: Sheet) -> dict[str, str]:
    """The guessed values as text, by flag such as "--inertia" where one sets it, else by key; flags first."""
    values = sheet.answers | {KEY_FLAGS.get(key, key): text for key, text in _keys(sheet)}
    flags = {f"--{flag}": values.pop(flag) for flag in NUMBERS if flag in values}
    return flags | values


def motor_guesses(motor: str, numbers: Mapping[str, Answer]) -> dict[str, str]:
    """The guesses of a motor's own numbers beside those that are known, as text by flag without dashes.

    The inertia is among them.
    """
    request, sheet = Request(motor=motor, drive="", encoder="", numbers=numbers), Sheet()
    part = class_of(request)
    facts = (put_motor if part.layouts else put_step_motor)(sheet, request, part)
    put_inertia(sheet, sheet.section("[mechanics]"), request, facts)
    return {label.removeprefix("--"): text for label, text in guessed_values(sheet).items()}


def _keys(sheet: Sheet) -> Iterator[tuple[str, str]]:
    """The guessed keys of the study with their values; entries of a list are numbered."""
    places = Counter[str]()
    for section in sheet.sections:
        path = section.heading.strip("[]")
        if section.heading.startswith("[["):
            places[path] += 1
            path = f"{path}.{places[path] - 1}"
        for key, value in section.guessed.items():
            if not f"{path}.{key}".startswith(PARTS_OF_ANSWERS):
                yield f"{path}.{key}", ", ".join(value) if isinstance(value, list) else str(value)
