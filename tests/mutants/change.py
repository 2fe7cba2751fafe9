"""One mutant of a file: a piece of its text is replaced."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

OPPOSITE = {"+": "-", "*": "/", "<": "<=", ">": ">=", "==": "!=", "+=": "-=", "*=": "/="}
OPPOSITE |= {"&&": "||", "and": "or", "min": "max", "minimum": "maximum", "fmin": "fmax"}
OPPOSITE |= {"min_element": "max_element", "argmin": "argmax", "floor": "ceil"}
OPPOSITE |= {"True": "False", "true": "false"}
OPPOSITE |= {new: old for old, new in OPPOSITE.items()}


@dataclass(frozen=True)
class Change:
    """Replacement of text[start:end] by `new`."""

    start: int
    end: int
    new: str

    def applied(self, text: str) -> str:
        return text[: self.start] + self.new + text[self.end :]

    def line(self, text: str) -> int:
        return text.count("\n", 0, self.start) + 1

    def described(self, text: str) -> str:
        """The line in which the change begins, before and after it."""
        first = text.rfind("\n", 0, self.start) + 1
        before = text[first:].partition("\n")[0]
        after = self.applied(text)[first:].partition("\n")[0]
        return f"{before.strip()}  ->  {after.strip()}"


def other_numbers(literal: str) -> Iterator[str]:
    """Replacements for a number k in code: k + 1, 0 and 2 k, except k itself, in the same notation and
    type."""
    plain = literal.replace("'", "").replace("_", "")
    hexadecimal = re.fullmatch(r"(0[xX][0-9a-fA-F]+)([uUlL]*)", plain)
    whole = re.fullmatch(r"(\d+)([uUlL]*)", plain)
    real = re.fullmatch(r"([\d.]+(?:[eE][+-]?\d+)?)([fFlL]?)", plain)
    if hexadecimal or whole:
        digits, suffix = (hexadecimal or whole).groups()
        k: int | float = int(digits, 0) if hexadecimal else int(digits)
    elif real:
        digits, suffix = real.groups()
        k = float(digits)
    else:
        return
    for other in dict.fromkeys((k + 1, 0 * k, 2 * k)):
        if other != k:
            yield f"{hex(other) if hexadecimal and isinstance(other, int) else repr(other)}{suffix}"
