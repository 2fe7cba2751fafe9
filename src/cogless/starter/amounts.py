"""Numbers as a study writes them: with a unit whose prefix keeps them short."""

from __future__ import annotations

import math

from cogless import units
from cogless.units import Dimension

# Units from the largest to the smallest. A value is written in the first unit in which it is not too small.
SHORT_UNITS: dict[Dimension, tuple[str, ...]] = {
    units.TORQUE: ("N*m", "mN*m", "uN*m"),
    units.CURRENT: ("A", "mA", "uA"),
    units.VOLTAGE: ("V",),
    units.RESISTANCE: ("ohm", "mohm"),
    units.INDUCTANCE: ("mH", "uH", "nH"),
    units.TIME: ("s", "ms", "us", "ns"),
    units.FREQUENCY: ("MHz", "kHz", "Hz"),
    units.ANGLE: ("deg",),
    units.ANGULAR_SPEED: ("rpm",),
    units.SPEED_CONSTANT: ("rpm/V",),
    units.TORQUE_CONSTANT: ("N*m/A", "mN*m/A"),
    units.INERTIA: ("kg*m^2",),
}
LEAST_AMOUNT = 0.1  # least number in such a unit
LEAST_DURATION = 1.0  # least number in a unit of time
LEAST_PLAIN, MOST_PLAIN = 1e-3, 1e9  # smaller and larger numbers have a power of ten
FINE_DIGITS = 3  # significant digits of a number, unless a caller wants more


def unit_for(value: float, dimension: Dimension) -> str:
    """The unit of this dimension in which a value, SI, is a short number."""
    choices = SHORT_UNITS[dimension]
    if dimension is units.FREQUENCY:  # whole numbers, since rates must be whole
        return next((unit for unit in choices[:-1] if value >= units.factor(unit, dimension)), choices[-1])
    least = LEAST_DURATION if dimension is units.TIME else LEAST_AMOUNT
    return next(
        (unit for unit in choices if abs(value) >= least * units.factor(unit, dimension)), choices[-1]
    )


def digits(value: float, count: int = FINE_DIGITS) -> str:
    """A number as text, rounded to `count` significant digits, as short as it can be written."""
    text = f"{value:.{count}g}"
    number = float(text)
    if number == 0 or LEAST_PLAIN <= abs(number) < MOST_PLAIN:
        return f"{number:.15g}"
    mantissa, exponent = f"{number:.{count - 1}e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def amount(value: float, dimension: Dimension, unit: str = "", count: int = FINE_DIGITS) -> str:
    """A value in SI as text with a unit, such as "4 mN*m"; `unit`: "": `unit_for` chooses it."""
    unit = unit or unit_for(value, dimension)
    return f"{digits(units.convert(value, unit, dimension), count)} {unit}"


def exact_rate(hertz: float) -> str:
    """A whole rate, Hz, as text with all its digits, such as "12.345 kHz"."""
    unit = "kHz" if hertz >= 1000 else "Hz"
    return f"{hertz / (1000 if unit == 'kHz' else 1):.9g} {unit}"


def span(low: float, high: float, dimension: Dimension | None, unit: str = "") -> str:
    """A range as text with one unit, such as "1 to 8 mN*m"."""
    if dimension is None:
        return f"{digits(low)} to {digits(high)}"
    unit = unit or unit_for(math.sqrt(low * high) if low > 0 else high, dimension)
    ends = (digits(units.convert(end, unit, dimension)) for end in (low, high))
    return f"{' to '.join(ends)} {unit}"
