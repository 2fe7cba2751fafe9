"""One mutant of a file: some of its text replaced."""

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
    """`new` in place of text[start:end]."""

    start: int
    end: int
    new: str

    def applied(self, text: str) -> str:
        return text[: self.start] + self.new + text[self.end :]

    def line(self, text: str) -> int:
        return text.count("\n", 0, self.start) + 1

    def described(self, text: str) -> str:
        """The line that it begins in, as it was and as it is."""
        first = text.rfind("\n", 0, self.start) + 1
        before = text[first:].partition("\n")[0]
        after = self.applied(text)[first:].partition("\n")[0]
        return f"{before.strip()}  ->  {after.strip()}"


def other_numbers(literal: str) -> Iterator[str]:
    """k + 1, 0 and 2 k of a number in code, as far as they differ, in its notation and with its suffix."""
    plain = literal.replace("'", "").replace("_", "")
    hexadecimal = re.fullmatch(r"(0[xX][0-9a-fA-F]+)([uUlL]*)", plain)
    whole = re.fullmatch(r"(\d+)([uUlL]*)", plain)
    real = re.fullmatch(r"([\d.]+(?:[eE][+-]?\d+)?)([fFlL]?)", plain)
    if hexadecimal or whole:
        digits, suffix = (hexadecimal or whole).groups()  # type: ignore[union-attr]
        k: int | float = int(digits, 0) if hexadecimal else int(digits)
    elif real:
        digits, suffix = real.groups()
        k = float(digits)
    else:
        return
    for other in dict.fromkeys((k + 1, 0 * k, 2 * k)):
        if other != k:
            yield f"{hex(other) if hexadecimal and isinstance(other, int) else repr(other)}{suffix}"
