"""Write the values of a configuration as C initialisers, which compile to exactly the same bits."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.control_library import Field, Headers

LINE_WIDTH = 120
INDENT_WIDTH = 4
NUMBERS_A_LINE = 8


def real(value: float, precision: str) -> str:
    """The shortest C literal that compiles to exactly this number. `precision`: "f" float, "d" double."""
    return f"{np.float32(value)!s}f" if precision == "f" else repr(float(value))


def array(values: NDArray[np.floating[Any]], precision: str) -> str:
    """The lines between the braces of an array's initialiser."""
    numbers = [real(float(value), precision) for value in values]
    rows = (numbers[n : n + NUMBERS_A_LINE] for n in range(0, len(numbers), NUMBERS_A_LINE))
    return "\n".join(f"    {', '.join(row)}," for row in rows)


def initialiser(headers: Headers, struct: str, values: dict[str, Any], precision: str) -> str:
    """The lines between the outer braces, each member with the comment from its header.

    A pointer whose value is None is left out; else its value is used as C code.
    """
    return "\n".join(_member_lines(headers, struct, values, precision, INDENT_WIDTH))


def _member_lines(
    headers: Headers, struct: str, values: dict[str, Any], precision: str, indent: int
) -> list[str]:
    lines: list[str] = []
    by_declaration: dict[int, list[Field]] = {}
    for field in headers.structs[struct]:
        by_declaration.setdefault(field.declaration, []).append(field)
    for fields in by_declaration.values():
        first = fields[0]
        if first.type in headers.structs and first.length is not None:
            entry = headers.structs[first.type]
            comment = ". ".join([first.comment, *(f"{f.name}: {f.comment}" for f in entry)])
            lines += _commented(f"{' ' * indent}.{first.name} = {{", comment)
            for item in _used(values[first.name]):
                members = ", ".join(f".{f.name} = {_value(item[f.name], f, precision)}" for f in entry)
                lines.append(f"{' ' * (indent + INDENT_WIDTH)}{{{members}}},")
            lines.append(f"{' ' * indent}}},")
            continue
        if first.type in headers.structs:
            opening = f"{' ' * indent}.{first.name} = {{"
            lines += _commented(opening, first.comment)
            lines += _member_lines(headers, first.type, values[first.name], precision, indent + INDENT_WIDTH)
            lines.append(f"{' ' * indent}}},")
            continue
        set_fields = [f for f in fields if values[f.name] is not None]
        if set_fields:
            assigned = ", ".join(f".{f.name} = {_value(values[f.name], f, precision)}" for f in set_fields)
            lines += _commented(f"{' ' * indent}{assigned},", first.comment)
    return lines


def _value(value: Any, field: Field, precision: str) -> str:
    if field.pointer:
        return str(value)
    if isinstance(value, list):
        return "{" + ", ".join(_plain(item, precision) for item in _used(value)) + "}"
    return _plain(value, precision)


def _used(values: list[Any]) -> list[Any]:
    """An array's entries without the zeros at the end, since C fills these in; at least one entry stays."""
    used = len(values)
    while used > 1 and not (any(last.values()) if isinstance(last := values[used - 1], dict) else last):
        used -= 1
    return values[:used]


def _plain(value: Any, precision: str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return real(value, precision) if isinstance(value, float) else str(value)


def _commented(code: str, comment: str) -> list[str]:
    """The code with its comment behind it, or above it if there is no room."""
    code_lines = textwrap.wrap(code, LINE_WIDTH, subsequent_indent=" " * (_margin(code) + INDENT_WIDTH)) or [
        code
    ]
    if _margin(code):
        code_lines[0] = " " * _margin(code) + code_lines[0].lstrip()
    if not comment:
        return code_lines
    column = len(code_lines[-1]) + 1
    if column + len(comment) + 6 > LINE_WIDTH and column > 48:
        return [*comment_lines(comment, _margin(code)), *code_lines]
    behind = comment_lines(comment, column)
    return [*code_lines[:-1], f"{code_lines[-1]} {behind[0].lstrip()}", *behind[1:]]


def comment_lines(text: str, column: int) -> list[str]:
    """A C comment that begins at the column, wrapped."""
    words = textwrap.wrap(text, LINE_WIDTH - column - 6)
    inner = [f"{' ' * (column + 3)}{line}" for line in words]
    inner[0] = f"{' ' * column}/* {words[0]}"
    inner[-1] += " */"
    return inner


def _margin(code: str) -> int:
    return len(code) - len(code.lstrip())
