"""Cells of a CSV as numbers: decimal points or commas, separators of thousands, times of a day."""

from __future__ import annotations

import re
from collections.abc import Iterable

NO_NUMBER = ("", "na", "n/a", "null", "none")  # cells without a number, in small letters; float reads "nan"
OTHER = {".": ",", ",": "."}
SPACES = " '\u2019\u00a0\u2009\u202f"  # which separate thousands in some languages
GROUPED = {  # Numbers with separators of thousands, by the decimal mark. They do not begin with a zero.
    decimal: re.compile(rf"([+-]?[1-9]\d{{0,2}}(?:([{re.escape(other)}{SPACES}])\d{{3}})(?:\2\d{{3}})*)"
                        rf"(?:{re.escape(decimal)}(\d*))?")
    for decimal, other in OTHER.items()
}  # fmt: skip
CLOCK = re.compile(
    r"(?:[\d./-]+[ T])?(?:(\d+):)?(\d+):(\d+(?:[.,]\d*)?)\s*(?:([AP])\.?M\.?|Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)


def lacks_number(text: str) -> bool:
    """Whether a cell is empty or says that there is no number."""
    return text.strip().lower() in NO_NUMBER


def is_number(text: str) -> bool:
    """Whether Python's float reads a cell."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def is_number_of_a_language(text: str) -> bool:
    """Whether a cell is a number with a decimal point or comma, or a time."""
    return any(is_number(plain(text, decimal)) for decimal in OTHER) or seconds(text) is not None


def seconds(text: str) -> float | None:
    """Seconds of a time such as "12:00:00.000", "00:12.345" (minutes first) or "1:00:00 PM"; None: no time.

    A date before the time is ignored.
    """
    time = CLOCK.fullmatch(text.strip())
    if time is None:
        return None
    hours, minutes, rest, half = time.groups()
    whole = float(hours or 0)
    if half:
        whole = whole % 12 + (12 if half in "pP" else 0)
    return 3600 * whole + 60 * float(minutes) + float(rest.replace(",", "."))


def decimal_mark(cells: Iterable[str]) -> str:
    """The mark before decimals, "." or ","; "": both are possible, or the cells contradict each other.

    In a cell with both marks the last one is decimal. A mark that comes twice alone separates thousands. One
    mark before three digits may be either.
    """
    marks = {mark for cell in cells if (mark := _decimal_of(cell))}
    return marks.pop() if len(marks) == 1 else ""


def _decimal_of(cell: str) -> str:
    text = cell.strip()
    marks = [character for character in text if character in OTHER]
    if not marks:
        return ""
    last = marks[-1]
    if len(marks) > 1 and len(set(marks)) == 1:
        return OTHER[last]
    if len(marks) == 1 and GROUPED[OTHER[last]].fullmatch(text):
        return ""
    return last


def plain(text: str, decimal: str) -> str:
    """The cell as text for Python's float, without separators of thousands. `decimal`: the decimal mark."""
    text = text.strip()
    if grouped := GROUPED[decimal].fullmatch(text):
        return grouped[1].replace(grouped[2], "") + "." + (grouped[3] or "0")
    if decimal == "," and "." in text:
        return text.replace(".", "?")  # The point separates no thousands, so float must refuse the text.
    return text.replace(decimal, ".")
