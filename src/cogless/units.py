"""Convert texts with a unit to SI numbers and back."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import product

from cogless.unit_expressions import Unit, read_unit

# Datasheets write a product of units without a sign, with a point, or with a hyphen.
UNIT_TERM = r"[A-Za-zµμΩ]+(?:\^-?\d)?"
SIGNS = str.maketrans({"²": "^2", "³": "^3", "⋅": "*", "·": "*"})
JOINED = re.compile(rf"(?<![A-Za-z]){UNIT_TERM}(?:[.-]{UNIT_TERM})+")
EXPONENT = re.compile(r"(?<=[A-Za-zµμ])(?=[23](?![A-Za-z0-9]))")
FORCES, LENGTHS = r"[mcku]?N|k?gf?|ozf?|lbf?", r"cm|mm|m|in|ft"
GLUED = re.compile(
    rf"(?<![A-Za-zµμ])(?:({FORCES})({LENGTHS})(s?)|(in|ft)(ozf?|lbf?)()|([mkuµμ]?V)(s)())(\^-?\d)?(?![A-Za-z])"
)
GRAM = "gm"  # Some write this for a gram, so it may not be read as a gram times a meter.
MASSES = re.compile(r"(?<![A-Za-z])([mk]?)(oz|lb|g)s?(?![A-Za-z])")  # a mass, or its weight if a force fits
UNIT_WORD = re.compile("[A-Za-zµμΩ]+")
SYMBOLS = re.findall(r"\S+", "m s A g K rad deg rev min h rpm Hz N Nm J W V ohm H Wb oz lb in ft")
LONGEST_MISSPELT = 4  # most words of a unit for which other capitals are tried
PREFIXES = ("", "m", "k", "u", "M", "c", "n")

NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
COMMA = re.compile(r",\d")  # a decimal comma, after the whole part of a number
UNIT = re.compile(r"(?:1\s*/)?[A-Za-zµμΩΩ°·*/^()\s]*(?:(?:\^|\*\*)-?\d[A-Za-zµμΩΩ°·*/^()\s]*)*")


class UnitError(ValueError):
    """A text that is not a quantity of the wanted dimension; the message starts with "expected"."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """A kind of quantity.

    `unit`: its SI unit. `example`: the unit shown in error messages, default `unit`. `also`: other SI units
    that are accepted as equal to `unit`. `angular`: if not 0, the SI unit rad/s is accepted, too, and
    1 rad/s is `angular` times `unit`.
    """

    name: str
    unit: str
    example: str = ""
    also: tuple[str, ...] = ()
    angular: float = 0.0

    def sample(self, number: object) -> str:
        """A sample text for error messages: the number with the unit `example`."""
        return f'"{number} {self.example or self.unit}"'


TURN = math.tau  # rad
RPM = TURN / 60  # rad/s
DEGREE = math.radians(1)  # rad

ANGLE = Dimension("an angle", "rad", "deg")
ANGULAR_SPEED = Dimension("an angular speed", "rad/s", "rpm")
ANGULAR_ACCELERATION = Dimension("an angular acceleration", "rad/s^2", "rpm/s")
TIME = Dimension("a time", "s")
FREQUENCY = Dimension("a frequency", "Hz", angular=1 / math.tau)
CURRENT = Dimension("a current", "A")
VOLTAGE = Dimension("a voltage", "V")
POWER = Dimension("a power", "W")
TORQUE = Dimension("a torque", "N*m")
RESISTANCE = Dimension("a resistance", "ohm")
INDUCTANCE = Dimension("an inductance", "H", "mH")
FLUX_LINKAGE = Dimension("a flux linkage", "Wb", "mWb")
TORQUE_CONSTANT = Dimension("a torque constant", "N*m/A")
BACK_EMF_CONSTANT = Dimension("a voltage per speed", "V*s/rad", "V/rpm")
SPEED_CONSTANT = Dimension("a speed per voltage", "rad/s/V", "rpm/V")
TEMPERATURE = Dimension("a temperature", "degC")
TEMPERATURE_COEFFICIENT = Dimension("a change per kelvin", "1/K")
THERMAL_RESISTANCE = Dimension("a thermal resistance", "K/W")
HEAT_CAPACITY = Dimension("a heat capacity", "J/K")
INERTIA = Dimension("an inertia", "kg*m^2")
STIFFNESS = Dimension("a torsional stiffness", "N*m/rad")
LENGTH = Dimension("a length", "m", "mm")
MASS = Dimension("a mass", "kg")
FORCE = Dimension("a force", "N")
ACCELERATION = Dimension("an acceleration", "m/s^2")
BELT_STIFFNESS = Dimension("a stiffness", "N/m", "N/mm")
VISCOUS_FRICTION = Dimension("a viscous friction", "N*m*s/rad", also=("N*m*s",))
CURRENT_GAIN = Dimension("a gain of the current loop", "V/A")
CURRENT_INTEGRAL_GAIN = Dimension("an integral gain of the current loop", "V/A/s")
LAW_SPEED = Dimension("an angular speed", "rad/s")  # in a controller's table; messages show rad/s, not rpm
SPEED_GAIN = Dimension("a gain of the speed loop", "A*s/rad", "A/rpm")
SPEED_INTEGRAL_GAIN = Dimension("an integral gain of the speed loop", "A/rad", "A/rpm/s")
CURRENT_TO_ACCELERATION = Dimension("an acceleration per current", "rad/s^2/A", "rpm/s/A")
CUBIC_SPEED_GAIN = Dimension("a current per speed cubed", "A*s^3/rad^3")
CURRENT_PER_ACCELERATION = Dimension("a current per acceleration", "A*s^2/rad")
SPEED_LEARNING = Dimension("a learning gain on speed", "A*s^2/rad^2")
ACCELERATION_LEARNING = Dimension("a learning gain on acceleration", "A*s^4/rad^2")
RATE = Dimension("a gain per time", "1/s", angular=1.0)
RATE_PER_TIME = Dimension("a gain per time squared", "1/s^2")
NONE = Dimension("a plain number", "")
# Two readings of a unit: (the dimension's SI unit, "Hz" or "1/s" for the unit) -> what the user may mean
READINGS = {
    ("Hz", "1/s"): 'may be "Hz" or "rad/s"',
    ("1/s", "Hz"): 'may be "1/s" or 2 pi "rad/s"',
    ("rad/s", "Hz"): 'may be "rev/s", or the frequency of the current, pole_pairs times as much',
    ("rad/s", "1/s"): 'may be "rad/s" or "rev/s"',
}
NAMED_DIMENSIONS = tuple(value for value in list(vars().values()) if isinstance(value, Dimension))


@cache
def dimension_of(unit: str) -> Dimension:
    """The first of the NAMED_DIMENSIONS dimensions with this SI unit, else a dimension without a name.

    UnitError: the unit is unknown.
    """
    named = next((dimension for dimension in NAMED_DIMENSIONS if dimension.unit == unit), None)
    if named is not None:
        return named
    if not is_known(unit):
        raise UnitError(f'expected a known unit, not "{unit}"')
    return Dimension(f"a quantity in {unit}", unit)


def parse(text: str, dimension: Dimension) -> float:
    """The SI value of a text such as "60 rpm"; UnitError unless it is a finite number with a fitting unit."""
    match = NUMBER_AND_UNIT.fullmatch(text)
    if not match:
        raise UnitError(f"expected a number and a unit, such as {dimension.sample(1)}")
    number, unit = match.groups()
    if COMMA.match(unit):
        raise UnitError(f"expected a decimal point in place of the comma, such as {dimension.sample('1.5')}")
    if not unit:
        raise UnitError(
            f"expected a unit, too, such as {dimension.sample(number if len(number) < 20 else 1)}"
        )
    value = float(number) * factor(unit, dimension)
    if not math.isfinite(value):
        raise UnitError(f"expected a finite number with a unit, such as {dimension.sample(1)}")
    return value


def unit_of(text: str) -> str:
    """The unit of a text such as "60 rpm"; empty if it has none or the text is no quantity."""
    match = NUMBER_AND_UNIT.fullmatch(text)
    return match.group(2) if match else ""


def is_known(unit: str) -> bool:
    """Whether a word is the name of a unit, of any dimension."""
    return _unit(unit) is not None


def convert(value_si: float, unit: str, dimension: Dimension) -> float:
    """Convert an SI value to another unit of its dimension."""
    return value_si / factor(unit, dimension)


def number_in(text: str, unit: str) -> float:
    """The number of a text such as "0.1 N*m", converted to `unit`; UnitError if that is impossible."""
    match = NUMBER_AND_UNIT.fullmatch(text)
    if not match:
        raise _unlike(unit)
    return float(match.group(1)) * _ratio(match.group(2), unit)


@cache
def _ratio(unit: str, other: str) -> float:
    """Factor from a unit to another unit of the same dimension; UnitError if the dimensions differ."""
    source, target = _unit(unit), _unit(other)
    if source is None or target is None or not source.is_like(target):
        raise _unlike(other)
    return source.ratio(target)


def in_si(text: str) -> float:
    """The SI value of a text with a unit of any dimension; UnitError: unknown unit."""
    match = NUMBER_AND_UNIT.fullmatch(text)
    if not match:
        raise UnitError("expected a number and a unit")
    return float(match.group(1)) * si_factor(match.group(2))


def _unlike(unit: str) -> UnitError:
    return UnitError(f'expected a number with a unit like "{unit}"')


def format(value_si: float, unit: str, dimension: Dimension, digits: int = 6) -> str:
    """An SI value as a text in the given unit, such as "60 rpm"."""
    return f"{convert(value_si, unit, dimension):.{digits}g} {unit}"


@cache
def si_factor(unit: str) -> float:
    """Factor from a unit of any dimension to SI; UnitError: unknown unit."""
    written = _unit(unit)
    if written is None:
        raise UnitError(f'expected a known unit, not "{unit}"')
    if any(written.is_like(_si(product)) for product in ("kg*m", "kg*m*s^2", "kg*m/A")):
        written = _unit(_with_forces(unit)) or written  # nobody means a mass times a length
    return written.ratio(Unit(written.bases, Counter())) * math.pow(1e-3, written.bases["gram"])


@cache
def factor(unit: str, dimension: Dimension) -> float:
    """Factor from `unit` to the SI unit of the dimension; UnitError: other dimension or unknown unit."""
    expected = f"expected {dimension.name}, such as {dimension.sample(1)}"
    written = _unit(unit)
    if written is not None and (reading := _reading(unit, written, dimension)):
        raise UnitError(f'{expected}; the unit "{unit}" {reading}')
    factor = _fitting(unit, dimension)
    if factor is not None:
        return factor
    near = _perhaps(unit, dimension)
    perhaps = f', perhaps "{near}"' if near else ""
    raise UnitError(
        f'{expected}; the unit "{unit}" is not known{perhaps}' if written is None else expected + perhaps
    )


def _reading(unit: str, written: Unit, dimension: Dimension) -> str | None:
    """The two readings of a unit of 1/s in a dimension; None if it has only one reading."""
    if not written.is_like(_si("1/s")):
        return None
    return READINGS.get((dimension.unit, "Hz" if "Hz" in unit else "1/s"))


def _fitting(unit: str, dimension: Dimension) -> float | None:
    """Factor from a unit to the dimension's unit; None if the unit fits the dimension in no reading.

    If a product fits in no other way, its words of mass stand for the weights of these masses. So "oz*in" is
    a torque, while "oz*in^2" and "oz*in*s^2" are inertias.
    """
    for written in (_unit(unit), _unit(_with_forces(unit))):
        if written is None:
            continue
        for si in (dimension.unit, *dimension.also):
            if written.is_like(_si(si)):
                return written.ratio(_si(si))
        if dimension.angular and written.is_like(_si("rad/s")):
            return written.ratio(_si("rad/s")) * dimension.angular
    return None


def _perhaps(unit: str, dimension: Dimension) -> str | None:
    """The unit in other capitals, so that it fits the dimension; None if no such spelling fits."""
    words = UNIT_WORD.findall(unit)
    if not 1 <= len(words) <= LONGEST_MISSPELT:
        return None
    for spelling in product(*map(_spellings, words)):
        other = _with_words(unit, spelling)
        if other != unit and _fitting(other, dimension) is not None:
            return other
    return None


def _with_words(unit: str, words: Iterable[str]) -> str:
    """The unit with its words replaced by `words`, in their order."""
    following = iter(words)
    return UNIT_WORD.sub(lambda _: next(following), unit)


def _spellings(word: str) -> list[str]:
    """The word, then known units that differ from it in capitals; those with the same first letter first."""
    spellings = [prefix + symbol for prefix in PREFIXES for symbol in SYMBOLS]
    alike = [name for name in spellings if name.lower() == word.lower() and name != word]
    return [word, *sorted(alike, key=lambda name: name[0] != word[0])]


def _with_forces(unit: str) -> str:
    return MASSES.sub(r"\1\2f", _spelled_out(unit))


def _spelled_out(unit: str) -> str:
    """A datasheet's unit, such as "gcm2" or "oz-in/A", with signs between its factors."""
    unit = EXPONENT.sub("^", unit.replace("°C", "degC").translate(SIGNS))
    unit = JOINED.sub(lambda group: f"({re.sub('[.-](?=[A-Za-z])', '*', group.group())})", unit)
    return GLUED.sub(_product_of, unit)


def _product_of(group: re.Match[str]) -> str:
    *words, exponent = group.groups("")
    if "".join(words) == GRAM:
        return group.group()
    return f"({'*'.join(word for word in words if word)}{exponent})"


def _unit(unit: str) -> Unit | None:
    """The unit of a text in a study; None if unknown. The text's only numbers may be "1 /" and exponents."""
    spelled_out = _spelled_out(unit)
    return read_unit(spelled_out) if UNIT.fullmatch(spelled_out) else None


def _si(unit: str) -> Unit:
    """The unit of a Dimension; UnitError if it is unknown."""
    written = _unit(unit)
    if written is None:
        raise UnitError(f'expected a known unit, not "{unit}"')
    return written
