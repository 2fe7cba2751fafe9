"""Numbers that are far from what motors of the class have: mostly a slip of the unit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from cogless import units
from cogless.starter.amounts import SHORT_UNITS, amount, digits, span
from cogless.starter.motor_rules import is_balanced
from cogless.starter.motor_sections import MAGNET_CONSTANTS, MotorFacts, put_motor
from cogless.starter.request import NUMBERS, Request, parse_number
from cogless.starter.sheet import Sheet
from cogless.units import Dimension

UNUSUAL_FACTOR = 2.0  # times an end of the class's range: a number beyond is called unusual
UNLIKELY_FACTOR = 50.0  # times an end: a number beyond is doubted
LIKELY_FACTOR = 5.0  # times an end: another unit that brings a number within is proposed
OTHER_UNITS: dict[Dimension, tuple[str, ...]] = {
    units.INERTIA: ("kg*m^2", "kg*cm^2", "g*cm^2"),
    units.BACK_EMF_CONSTANT: ("V/rpm", "mV/rpm", "V*s/rad"),
}
OF_THE_SIZE = ("rated-torque", "holding-torque", "rated-current")  # answers that give the size
LOAD_INERTIA_MOST = 10.0  # load / rotor, by a usual rule for the choice of servo motors
SLOTS_NEAR = 6  # slots up or down: the search for a balanced winding goes no farther
STAR_PHASES = 3
OWN = "own"  # the class of a motor that is described by its numbers alone


def doubts(request: Request, motor: MotorFacts, slip: str) -> list[str]:
    """At most one sentence on a number that is far from the class's, and one on the slots.

    `slip`: the sentence of `magnet_slip`, or "". It replaces the one on a number, since what is usual depends
    on the magnet's constant.
    """
    numbers = (
        text
        for flag, (low, high) in _usual(request, motor).items()
        if flag in request.numbers and (text := _doubt(request, motor, flag, low, high))
    )
    return [*filter(None, [slip or next(numbers, ""), _slots_doubt(request, motor)])]


def unusual(request: Request, motor: MotorFacts) -> list[str]:
    """The given numbers that are far from what such motors have, each with the usual range."""
    return [
        f"--{flag} {answer.text} (usual: {span(low, high, NUMBERS[flag].dimension, _unit(answer.text))})"
        for flag, (low, high) in _usual(request, motor).items()
        if (answer := request.numbers.get(flag)) is not None
        and not low / UNUSUAL_FACTOR <= _value(request, motor, flag) <= high * UNUSUAL_FACTOR
        and not (flag == "resistance" and motor.part.name == OWN and not _is_sized(request))
    ]


def magnet_slip(request: Request, motor: MotorFacts, bus_voltage: float) -> str:
    """A sentence on a magnet's constant whose unit is probably wrong; "" if there is none.

    That is so if the constant contradicts other answers, and the same number with another unit does not.
    `bus_voltage`: V.
    """
    stated = [word for word in MAGNET_CONSTANTS if word in request.numbers]
    if len(stated) != 1 or motor.phases != STAR_PHASES:
        return ""
    (word,) = stated
    text, dimension = request.numbers[word].text, NUMBERS[word].dimension
    conflict = _conflict(request, motor, bus_voltage)
    number = text.split()[0]
    for unit in (SHORT_UNITS | OTHER_UNITS)[dimension] if conflict else ():
        answer = parse_number(word, f"{number} {unit}")
        meant = replace(request, numbers={**request.numbers, word: answer})
        meant_motor = put_motor(Sheet(), meant, motor.part)
        if not _conflict(meant, meant_motor, bus_voltage):
            reached = amount(meant_motor.reach(bus_voltage), units.ANGULAR_SPEED)
            return f'--{word}: "{text}": {conflict}; perhaps you mean {answer.text}, which gives {reached}'
    return ""


def _conflict(request: Request, motor: MotorFacts, bus_voltage: float) -> str:
    """What the magnet's constant contradicts among the other answers, as a clause; "" if nothing."""
    torque, current = request.value("rated-torque"), request.value("rated-current")
    constant, speed = motor.size.torque_constant, request.value("speed")
    most = motor.reach(bus_voltage)
    turns = (
        f"with it {amount(bus_voltage, units.VOLTAGE)} turn the motor at {amount(most, units.ANGULAR_SPEED)}"
    )
    if torque and current and abs(math.log(constant * current / torque)) > math.log(LIKELY_FACTOR):
        ratio = amount(torque / current, units.TORQUE_CONSTANT)
        return f"{turns} at most, and rated torque over rated current is {ratio}"
    if speed is not None and speed > most:
        return f"{turns} at most, but --speed is {request.numbers['speed'].text}"
    between = request.between_terminals("resistance")
    low, high = _usual(request, motor)["resistance"]
    if between is not None and not low / LIKELY_FACTOR <= between.value <= high * LIKELY_FACTOR:
        standstill = constant * 2 / math.sqrt(3) * bus_voltage / between.value
        through = f"with {between.text} its torque at standstill would be {amount(standstill, units.TORQUE)}"
        return f"{turns} at most, and {through}"
    return ""


def _is_sized(request: Request) -> bool:
    """Whether an answer gives the size. If none does, any resistance is right for some size."""
    return any(flag in request.numbers for flag in OF_THE_SIZE)


def _usual(request: Request, motor: MotorFacts) -> dict[str, tuple[float, float]]:
    """By answer, the least and the largest number that motors of this class and size have, SI.

    Answers that give the size come first, since `doubts` reports only the first doubt.
    """
    part, size = motor.part, motor.size
    phases_in_series = 2 if motor.phases == STAR_PHASES else 1
    # A size that is taken from the resistance would make each resistance usual.
    resistance_factor = size.resistance_factor if _is_sized(request) else size.winding_ratio
    figures = {
        "rated-torque": part["rated_torque"],
        "holding-torque": part["rated_torque"],
        "resistance": part["resistance"].scaled(phases_in_series * resistance_factor),
        "inductance": part["inductance"].scaled(phases_in_series * size.inductance_factor),
        "inertia": part["inertia"].scaled(size.inertia_factor),
    }
    shares = {"cogging": part["cogging"], "detent-torque": part["cogging"], "friction": part["friction"]}
    return {
        **{flag: (figure.low, figure.high) for flag, figure in figures.items()},
        "load-inertia": (0.0, LOAD_INERTIA_MOST * figures["inertia"].high),
        **{flag: (0.0, figure.high * size.torque) for flag, figure in shares.items()},
    }


def _doubt(request: Request, motor: MotorFacts, flag: str, low: float, high: float) -> str:
    answer, dimension = request.numbers[flag], NUMBERS[flag].dimension
    value = _value(request, motor, flag)
    if low / UNLIKELY_FACTOR <= value <= high * UNLIKELY_FACTOR:
        return ""
    ratio = value / high if value > high else low / value
    times_beyond = "times the largest" if value > high else "times below the smallest"
    extreme = amount(high if value > high else low, dimension)
    meant = _meant(answer.text, dimension, low, high)
    if flag == "resistance" and not _is_sized(request):
        return _size_doubt(answer.text, motor, meant)
    whose = "of the load of such a motor" if flag == "load-inertia" else "of such a motor"
    return (
        f'--{flag}: "{answer.text}": {digits(ratio, 2)} {times_beyond} usual value {whose}, {extreme}'
        f"{f'; perhaps you mean {meant}' if meant else ''}"
    )


def _size_doubt(text: str, motor: MotorFacts, meant: str) -> str:
    """A sentence: the resistance, which alone gives the size, makes the motor's size unusual."""
    own_flag = "rated-torque" if motor.phases == STAR_PHASES else "holding-torque"
    has = f"with this resistance the motor has a torque of about {amount(motor.size.torque, units.TORQUE)}"
    unit = f", or perhaps you mean {meant}" if meant else ""
    return f'--resistance: "{text}": {has}; if yours has another torque, give --{own_flag}{unit}'


def _value(request: Request, motor: MotorFacts, flag: str) -> float:
    """The given number, SI. A star's resistance or inductance is converted to that between two terminals."""
    between = request.between_terminals(flag)
    if between is not None and motor.phases == STAR_PHASES:
        return between.value
    return request.numbers[flag].value


def _unit(text: str) -> str:
    """The unit of a number; "" if it has none."""
    match = units.NUMBER_AND_UNIT.fullmatch(text)
    return match.group(2) if match is not None else ""


def _meant(text: str, dimension: Dimension, low: float, high: float) -> str:
    """The same number with the unit that makes it usual; "" if none does."""
    match = units.NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        return ""
    number = float(match.group(1))
    for unit in OTHER_UNITS.get(dimension, SHORT_UNITS[dimension]):
        if low / LIKELY_FACTOR <= number * units.factor(unit, dimension) <= high * LIKELY_FACTOR:
            return f"{digits(number)} {unit}"
    return ""


def _slots_doubt(request: Request, motor: MotorFacts) -> str:
    """A sentence on slots in which no winding has three equal phases; "" if one has."""
    slots = int(request.value("slots") or 0)
    if not slots or motor.phases != STAR_PHASES or is_balanced(slots, motor.pole_pairs):
        return ""
    near = [*_balanced_near(slots, motor.pole_pairs)]
    such = f": expected a number such as {' or '.join(map(str, near))}" if near else ""
    return f"--slots: {slots}: no winding has three equal phases with {2 * motor.pole_pairs} poles{such}"


def _balanced_near(slots: int, pole_pairs: int) -> Iterator[int]:
    """The next number of slots of a balanced winding below, and the next above."""
    for direction in (-1, 1):
        near = (slots + direction * distance for distance in range(1, SLOTS_NEAR + 1))
        good = next((n for n in near if n >= STAR_PHASES and is_balanced(n, pole_pairs)), None)
        if good is not None:
            yield good
