"""Read expressions of the units that describe drives, such as "kg*cm^2".

Angle is a dimension of its own here, so "60 rpm" and "60 Hz" can be told apart. The package pint reads units,
too; its import takes a third of a second at every start.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass
from functools import cache

PREFIX_FACTORS = {
    **dict.fromkeys(("pico", "p"), 1e-12),
    **dict.fromkeys(("nano", "n"), 1e-9),
    **dict.fromkeys(("micro", "u", "µ", "μ"), 1e-6),
    **dict.fromkeys(("milli", "m"), 1e-3),
    **dict.fromkeys(("centi", "c"), 1e-2),
    **dict.fromkeys(("kilo", "k"), 1e3),
    **dict.fromkeys(("mega", "M"), 1e6),
    **dict.fromkeys(("giga", "G"), 1e9),
}
BASE_UNITS = (
    "meter m",
    "second s sec",
    "ampere A",
    "gram g",
    "kelvin K",
    "celsius degC",
    "radian rad",
)
# (names, a number, an expression): a unit is the number times the expression
DERIVED_UNITS = (
    ("degree deg °", math.pi / 180, "radian"),
    ("revolution rev turn r", math.tau, "radian"),
    ("arcminute arcmin", 1 / 60, "degree"),
    ("arcsecond arcsec", 1 / 60, "arcminute"),
    ("minute min", 60.0, "second"),
    ("hour h", 60.0, "minute"),
    ("rpm RPM", 1.0, "revolution/minute"),
    ("rps", 1.0, "revolution/second"),
    ("hertz Hz", 1.0, "1/second"),
    ("newton N", 1.0, "kilogram*meter/second^2"),
    ("newton_meter Nm", 1.0, "newton*meter"),
    ("joule J", 1.0, "newton*meter"),
    ("watt W", 1.0, "joule/second"),
    ("volt V", 1.0, "watt/ampere"),
    ("ohm Ω Ohm", 1.0, "volt/ampere"),
    ("henry H", 1.0, "volt*second/ampere"),
    ("weber Wb", 1.0, "volt*second"),
    ("inch in", 0.0254, "meter"),
    ("foot ft", 0.3048, "meter"),
    ("ounce oz", 28.349523125, "gram"),
    ("pound lb", 453.59237, "gram"),
    ("dyne dyn", 1e-5, "newton"),
    ("gram_force gf", 9.80665e-3, "newton"),
    ("ounce_force ozf", 28.349523125, "gram_force"),
    ("pound_force lbf", 453.59237, "gram_force"),
)
BASE_BY_NAME = {name: names.split()[0] for names in BASE_UNITS for name in names.split()}
DERIVED_BY_NAME = {
    name: (number, expression) for names, number, expression in DERIVED_UNITS for name in names.split()
}
EXPRESSION_LETTERS_MOST = 100
PLURAL_ENDING = "s"
PLURAL_LETTERS_LEAST = 2  # least letters of a name before a plural's "s": "ms" is a millisecond

UNIT_TOKEN = re.compile(r"\s*(?:(?P<power>(?:\^|\*\*)(?P<exponent>-?\d))|[A-Za-zµμΩ°_]+|[*/()]|1)")


@dataclass(frozen=True, slots=True)
class Unit:
    """A product of powers. `bases`: exponent of each base unit. `numbers`: exponent of each number."""

    bases: Counter[str]
    numbers: Counter[float]

    def raised(self, exponent: int) -> Unit:
        return Unit(
            Counter({base: power * exponent for base, power in self.bases.items()}),
            Counter({number: power * exponent for number, power in self.numbers.items()}),
        )

    def times(self, other: Unit) -> Unit:
        bases, numbers = self.bases.copy(), self.numbers.copy()
        bases.update(other.bases)
        numbers.update(other.numbers)
        return Unit(bases, numbers)

    def is_like(self, other: Unit) -> bool:
        """Whether both have the same dimension."""
        return self.bases == other.bases

    def ratio(self, other: Unit) -> float:
        """How many `other` units this unit has. Both must have the same dimension.

        A number in both is cancelled, not divided, so a ratio of powers of ten is free of rounding.
        """
        powers = self.times(other.raised(-1)).numbers
        above = math.prod(number**power for number, power in powers.items() if power > 0)
        return math.prod((number**power for number, power in powers.items() if power < 0), start=float(above))


PLAIN_NUMBER = Unit(Counter(), Counter())


@cache
def read_unit(expression: str) -> Unit | None:
    """The unit of an expression with products, quotients and powers; None if the text is no unit."""
    tokens = _tokens(expression)
    if tokens is None or len(expression) > EXPRESSION_LETTERS_MOST:
        return None
    if not tokens:
        return PLAIN_NUMBER
    try:
        unit = _product(tokens)
    except _NoUnitError:
        return None
    return None if tokens else unit


class _NoUnitError(Exception):
    """The tokens are no expression, or a word in them is no unit."""


def _tokens(expression: str) -> list[str] | None:
    """Words, powers such as "^-2", signs and ones; None if the text has anything else."""
    tokens, place, text = [], 0, expression.strip()
    while place < len(text):
        match = UNIT_TOKEN.match(text, place)
        if match is None:
            return None
        tokens.append(f"^{match.group('exponent')}" if match.group("power") else match.group().strip())
        place = match.end()
    return tokens


def _product(tokens: list[str]) -> Unit:
    """Read and remove factors up to the end or a closing parenthesis. A missing sign is a product."""
    unit = _power(tokens)
    while tokens and tokens[0] != ")":
        sign = tokens.pop(0) if tokens[0] in "*/" else "*"
        unit = unit.times(_power(tokens).raised(-1 if sign == "/" else 1))
    return unit


def _power(tokens: list[str]) -> Unit:
    """Read and remove a word, a one or a parenthesis, with its exponent."""
    if not tokens:
        raise _NoUnitError
    token = tokens.pop(0)
    if token == "(":
        unit = _product(tokens)
        if not tokens or tokens.pop(0) != ")":
            raise _NoUnitError
    elif token == "1":
        unit = PLAIN_NUMBER
    else:
        unit = _word(token)
    if tokens and tokens[0].startswith("^"):
        unit = unit.raised(int(tokens.pop(0)[1:]))
    return unit


def _word(word: str) -> Unit:
    """The unit with this name, which may have a prefix and a plural's "s"."""
    singular = [word, *([word[:-1]] if word.endswith(PLURAL_ENDING) else [])]
    for name in singular:
        for prefix in ("", *PREFIX_FACTORS):
            unit = _named(name[len(prefix) :]) if name.startswith(prefix) else None
            letters = len(name) - len(prefix)
            if unit is None or (name != word and letters < PLURAL_LETTERS_LEAST):
                continue
            return Unit(Counter(), Counter({PREFIX_FACTORS[prefix]: 1})).times(unit) if prefix else unit
    raise _NoUnitError


def _named(name: str) -> Unit | None:
    """The unit with exactly this name; None if there is none."""
    if name in BASE_BY_NAME:
        return Unit(Counter({BASE_BY_NAME[name]: 1}), Counter())
    if name not in DERIVED_BY_NAME:
        return None
    number, expression = DERIVED_BY_NAME[name]
    unit = read_unit(expression)
    return unit and Unit(Counter(), Counter({number: 1})).times(unit)
