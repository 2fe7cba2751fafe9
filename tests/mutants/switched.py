"""Several mutants of a file of C or C++ in one text, compiled once; switch.h chooses one as it runs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from mutants.c_code import functions
from mutants.change import Change

SWITCH = Path(__file__).with_name("switch.h")
PAGE = 1 << 15  # marks that switch.h has room for


def switched(text: str, changes: Mapping[int, Change]) -> tuple[str, dict[int, int]]:
    """A file's text with mutants by their number, and the number of the mutant at a line, where there is one.

    A function with mutants has its body once for each, and as it was. Mutants outside of functions, and of
    those that a compiler calls, are left out.
    """
    pieces, lines, end = [f'#include "{SWITCH}"\n'], {}, 0
    for begins, closes in functions(text):
        inside = {n: c for n, c in changes.items() if begins <= c.start and c.end <= closes}
        if not inside:
            continue
        pieces.append(text[end:begins])
        for number, change in inside.items():
            body = Change(change.start - begins, change.end - begins, change.new).applied(text[begins:closes])
            pieces.append(f"if (cogless_mutant == {number}) {{")
            first = "".join(pieces).count("\n") + 1
            lines |= dict.fromkeys(range(first, first + body.count("\n") + 1), number)
            pieces.append(f"{body} }} else ")  # no brace begins a line: to control_library.py that is the end
        pieces.append(f"{{{text[begins:closes]} }}\n")
        end = closes
    return "".join([*pieces, text[end:]]), lines


def culprits(said: str, file: str, lines: Mapping[int, int]) -> set[int]:
    """Numbers of the mutants of a file to which a compiler's errors point."""
    places = re.findall(rf"{re.escape(file)}:(\d+):(?:\d+:)? (?:fatal )?(?:error|  required)", said)
    return {lines[int(place)] for place in places if int(place) in lines}
