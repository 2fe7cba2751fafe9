"""Where the code can be marked: the bodies of functions, in Python each block of statements in them too."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

from mutants import c_code
from mutants.switched import SWITCH

HAVE_BLOCKS = (ast.stmt, ast.excepthandler, ast.match_case)  # in Python; no expression has any


class Block(NamedTuple):
    """Block that runs if it is entered. A line of Python belongs to the last block that has it."""

    first: int  # line in Python, position in C and C++
    last: int  # the last line; the position after the end
    mark: int  # line before which, or position at which the mark stands


@cache
def blocks_of(file: str, text: str) -> list[Block]:
    if not file.endswith(".py"):
        return [Block(begins, closes, begins) for begins, closes in c_code.functions(text)]
    lines = text.splitlines()
    return list(_of_python(ast.parse(text), False, lines))


def _of_python(node: ast.AST, inside: bool, lines: list[str]) -> Iterator[Block]:
    function = isinstance(node, ast.FunctionDef)
    inside = inside or function
    for name, field in ast.iter_fields(node):
        if not isinstance(field, list) or not field or not isinstance(field[0], ast.stmt):
            continue
        if inside and not (name == "orelse" and isinstance(node, ast.If) and _is_elif(field, lines)):
            text = isinstance(field[0], ast.Expr) and isinstance(field[0].value, ast.Constant)
            code = field[1:] if function and text else field
            if code:
                begin = min([code[0], *getattr(code[0], "decorator_list", [])], key=lambda n: n.lineno)
                # a function's head belongs to it: what it says by default is used where it runs
                first = node.lineno if isinstance(node, ast.FunctionDef) else begin.lineno
                if not lines[begin.lineno - 1][: begin.col_offset].strip(" @"):
                    yield Block(first, field[-1].end_lineno or 0, begin.lineno)
    for child in ast.iter_child_nodes(node):
        if isinstance(child, HAVE_BLOCKS):
            yield from _of_python(child, inside, lines)


def _is_elif(orelse: list[ast.stmt], lines: list[str]) -> bool:
    first = orelse[0]
    return isinstance(first, ast.If) and lines[first.lineno - 1][first.col_offset :].startswith("elif")


def block_at(file: str, text: str, position: int) -> int | None:
    """Index of the innermost block at a position; None if there is none."""
    place = text.count("\n", 0, position) + 1 if file.endswith(".py") else position
    found = [n for n, block in enumerate(blocks_of(file, text)) if block.first <= place <= block.last]
    return found[-1] if found else None


def marked(file: str, text: str, number: int) -> str:
    """A file's text with marks in its blocks, numbered from `number` on."""
    blocks = blocks_of(file, text)
    if not blocks:
        return text
    if file.endswith(".py"):
        return _marked_python(text, blocks, number)
    pieces, end = [f'#include "{SWITCH}"\n'], 0
    for n, block in enumerate(blocks, start=number):
        pieces += [text[end : block.mark], f" cogless_hits[{n}] = 1;"]
        end = block.mark
    return "".join([*pieces, text[end:]])


def _marked_python(text: str, blocks: list[Block], number: int) -> str:
    lines = text.splitlines(keepends=True)
    for n, block in sorted(enumerate(blocks, start=number), key=lambda one: -one[1].mark):
        line = lines[block.mark - 1]
        indent = line[: len(line) - len(line.lstrip())]
        lines.insert(block.mark - 1, f"{indent}_cogless_page[{n}] = 1\n")
    body = ast.parse(text).body
    first = next(
        s for s in body
        if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))
        and not (isinstance(s, ast.ImportFrom) and s.module == "__future__")
    )  # fmt: skip
    at = min([first, *getattr(first, "decorator_list", [])], key=lambda n: n.lineno).lineno - 1
    lines.insert(at, "from mutants.page import page as _cogless_page\n")
    return "".join(lines)
