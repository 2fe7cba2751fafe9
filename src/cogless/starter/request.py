"""What a user says of his motor, drive and sensor: names of the catalogue, and numbers of datasheets."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from cogless import units
from cogless.catalogue import catalogue
from cogless.errors import StudyError
from cogless.starter.amounts import amount
from cogless.starter.part_catalogue import Kind, parts
from cogless.study.messages import toml_text
from cogless.study.table import perhaps
from cogless.units import Dimension


class RequestError(StudyError):
    """A mistake in an answer. `flag`: the option that it is about."""

    def __init__(self, flag: str, value: str, expected: str) -> None:
        super().__init__(f"--{flag}: {toml_text(value)}: {expected}")
        self.flag = flag


class Number(NamedTuple):
    """A number that may be given: its dimension, the unit of a bare number, the bounds of a whole one."""

    dimension: Dimension
    unit: str
    bounds: tuple[int, int] | None = None
    zero: bool = False  # may be zero


class Answer(NamedTuple):
    """A number as it was given: with its unit, and in SI. `per_phase`: of a phase, not between terminals.

    `written`: the user's own text, if its number was converted, such as from an rms current; "" if not.
    """

    text: str
    value: float
    per_phase: bool = False
    written: str = ""


PER_PHASE = re.compile(r"\s*(?:/|\bper)\s*phase\s*")
OF_A_WINDING = ("resistance", "inductance")
SEVERAL = re.compile(r",\s+|;\s*")  # separates speeds
EXACT_DIGITS = 6
RMS = math.sqrt(2)  # peak / rms of a sine
BETWEEN_TERMINALS = r"(.*?)\s*(?:l-l|line[ -]to[ -]line|phase[ -]to[ -]phase)"
# What datasheets write behind a number, the unit that it stands for, and the factor to that unit.
WRITTEN: Mapping[str, Sequence[tuple[str, str, float]]] = {
    "kv": [(r"kv", "rpm/V", 1)],
    "back-emf": [(r"V\s*/\s*1000\s*(?:rpm|r/min|min\^?-1)", "V/krpm", 1)],
    "torque-constant": [(r"(N\W?m)\s*/\s*A\s*\(?rms\)?", "N*m/A", 1 / RMS)],
    "rated-current": [(r"A\s*\(?rms\)?", "A", RMS), (r"A\s*(?:/|per)\s*phase", "A", 1)],
    "current-limit": [(r"A\s*\(?rms\)?", "A", RMS)],
    "resistance": [(BETWEEN_TERMINALS, r"\1", 1)],
    "inductance": [(BETWEEN_TERMINALS, r"\1", 1)],
    "bits": [(r"-?bits?", "", 1)],
    "cpr": [(r"cpr|counts", "", 1), (r"ppr|lines?|pulses", "", 4)],
    "pole-pairs": [(r"pole[ -]?pairs?", "", 1), (r"poles|magnets", "", 0.5)],
}

NUMBERS: dict[str, Number] = {
    "pole-pairs": Number(units.NONE, "", (1, 1000)),
    "slots": Number(units.NONE, "", (3, 10_000)),
    "step-angle": Number(units.ANGLE, "deg"),
    "kv": Number(units.SPEED_CONSTANT, "rpm/V"),
    "torque-constant": Number(units.TORQUE_CONSTANT, "N*m/A"),
    "back-emf": Number(units.BACK_EMF_CONSTANT, "V/rpm"),
    "resistance": Number(units.RESISTANCE, "ohm"),
    "inductance": Number(units.INDUCTANCE, "mH"),
    "inertia": Number(units.INERTIA, "kg*m^2"),
    "load-inertia": Number(units.INERTIA, "kg*m^2", zero=True),
    "rated-current": Number(units.CURRENT, "A"),
    "rated-torque": Number(units.TORQUE, "N*m"),
    "holding-torque": Number(units.TORQUE, "N*m"),
    "detent-torque": Number(units.TORQUE, "N*m"),
    "cogging": Number(units.TORQUE, "N*m", zero=True),
    "friction": Number(units.TORQUE, "N*m", zero=True),
    "bits": Number(units.NONE, "", (2, 24)),
    "cpr": Number(units.NONE, "", (4, 4_000_000)),
    "bus-voltage": Number(units.VOLTAGE, "V"),
    "current-limit": Number(units.CURRENT, "A"),
    "current-rate": Number(units.FREQUENCY, "Hz"),
    "speed-rate": Number(units.FREQUENCY, "Hz"),
    "speed": Number(units.ANGULAR_SPEED, "rpm"),
    "load": Number(units.TORQUE, "N*m", zero=True),
}


@dataclass(frozen=True)
class Request:
    """Names and numbers of a study to write; what is missing is guessed.

    `motor`, `drive`, `encoder`: names of the catalogue. `numbers`: by the names of `NUMBERS`. `faster`:
    further speeds, each above the previous one; the slowest is among the numbers.
    """

    motor: str
    drive: str
    encoder: str
    numbers: Mapping[str, Answer] = field(default_factory=dict)
    faster: tuple[Answer, ...] = ()

    def value(self, name: str) -> float | None:
        """A number in SI, None if it is not given."""
        answer = self.numbers.get(name)
        return None if answer is None else answer.value

    def between_terminals(self, name: str) -> Answer | None:
        """Resistance or inductance of two phases in series, as in a datasheet; None if it is not given."""
        answer = self.numbers.get(name)
        if answer is None or not answer.per_phase:
            return answer
        dimension = NUMBERS[name].dimension
        return Answer(amount(2 * answer.value, dimension, count=EXACT_DIGITS), 2 * answer.value)


def names(kind: Kind) -> dict[str, str]:
    """Names that a part may have, with a description: name -> what it is."""
    descriptions = {name: part.description for name, part in parts(kind).items()}
    return descriptions | catalogue()["Motors"] if kind == "motors" else descriptions


def check_name(flag: str, kind: Kind, name: str) -> str:
    """Return the name if there is such a part; if not, a RequestError proposes the nearest name."""
    choices = [*names(kind)]
    if name not in choices:
        raise RequestError(flag, name, f"expected one of {', '.join(choices)}{perhaps(name, choices)}")
    return name


def parse_number(name: str, text: str) -> Answer:
    """A number that is given as text, with a unit or without one; RequestError says what was expected."""
    plain, factor = _plain(name, text)
    try:
        answer = _read(name, plain)
    except RequestError as error:
        raise RequestError(name, text, error.expected) from None
    return answer._replace(written=text) if factor != 1 else answer


def _read(name: str, text: str) -> Answer:
    number = NUMBERS[name]
    if number.bounds is not None:
        return _whole(name, text, number.bounds)
    per_phase = name in OF_A_WINDING and PER_PHASE.search(text)
    amount_text = text[: per_phase.start()] if per_phase else text
    bare = units.NUMBER_AND_UNIT.fullmatch(amount_text)
    full = f"{amount_text.strip()} {number.unit}" if bare and not bare.group(2) else amount_text.strip()
    example = f'expected a number in {number.unit}, or with its unit, such as "1 {number.unit}"'
    try:
        value = units.parse(full, number.dimension)
    except units.UnitError as error:
        expected = str(error) if bare and bare.group(2) else example
        raise RequestError(name, text, expected) from None
    if value < 0 or (value == 0 and not number.zero):
        raise RequestError(name, text, f"expected {'zero or more' if number.zero else 'more than zero'}")
    return Answer(full, value, bool(per_phase))


def _plain(name: str, text: str) -> tuple[str, float]:
    """The text with a unit in place of a datasheet's words, and the factor on its number."""
    quantity = units.NUMBER_AND_UNIT.fullmatch(text)
    number, words = quantity.groups() if quantity is not None else ("", "")
    for written, unit, factor in WRITTEN.get(name, ()) if words else ():
        match = re.fullmatch(written, words, re.IGNORECASE)
        if match is not None:
            number = number if factor == 1 else f"{factor * float(number):.{EXACT_DIGITS}g}"
            return f"{number} {match.expand(unit)}".strip(), factor
    return text, 1


def parse_speeds(texts: Sequence[str]) -> tuple[Answer, ...]:
    """One or several speeds, each once, the slowest first. A text has one, or several as in "5, 40"."""
    parts = [part for text in texts for part in SEVERAL.split(text.strip())]
    for part in parts:
        if re.fullmatch(r"[0-9]+,[0-9]+\s*[^0-9,]*", part):
            one, two = part.replace(",", "."), part.replace(",", ", ")
            raise RequestError("speed", part, f'expected "{one}", or "{two}" for two speeds')
    speeds = {answer.value: answer for answer in (parse_number("speed", part) for part in parts)}
    return tuple(speeds[value] for value in sorted(speeds))


def _whole(name: str, text: str, bounds: tuple[int, int]) -> Answer:
    low, high = bounds
    stripped = text.strip()
    if not stripped.isascii() or not stripped.isdigit() or not low <= int(stripped) <= high:
        raise RequestError(name, text, f"expected a whole number from {low} to {high}")
    if name == "cpr" and int(stripped) % 4:
        raise RequestError(name, text, "expected a multiple of 4, since each line gives four counts")
    return Answer(str(int(stripped)), float(int(stripped)))
