"""Which tests execute a mutant's statement: one run of all tests, with a call of `hit` before each."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "hits"  # of the copy of the tree in which the tests run


def with_probes(text: str, positions: dict[int, int]) -> tuple[str, set[int]]:
    """A module's text with a probe before the statement at each position, and which probes it got.

    `positions`: by the probe's number. Outside of functions there is none: importing executes that for
    every test.
    """
    lines, numbers = text.splitlines(keepends=True), set()
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line))
    statements = list(_in_functions(ast.parse(text)))
    for number, position in positions.items():
        row = next(n for n, begin in enumerate(begins) if begin > position)
        found = [s for s in statements if s.lineno <= row <= (s.end_lineno or 0)]
        if found:
            at = min(found, key=lambda s: ((s.end_lineno or 0) - s.lineno, -s.lineno)).lineno - 1
            indent = " " * (len(lines[at]) - len(lines[at].lstrip(" ")))
            lines[at] = f"{indent}__import__('mutants.hits').hits.hit({number})\n{lines[at]}"
            numbers.add(number)
    return "".join(lines), numbers


def _in_functions(node: ast.AST, inside: bool = False) -> Iterator[ast.stmt]:
    """The statements in functions before which a line can stand: no elif, no function with a decorator."""
    inside = inside or isinstance(node, ast.FunctionDef)
    for name, field in ast.iter_fields(node):
        for child in field if isinstance(field, list) else [field]:
            if isinstance(child, ast.AST):
                is_elif = name == "orelse" and isinstance(node, ast.If) and isinstance(child, ast.If)
                decorated = getattr(child, "decorator_list", [])
                if inside and isinstance(child, ast.stmt) and not is_elif and not decorated:
                    yield child
                yield from _in_functions(child, inside)


@cache
def _note(number: int, test: str) -> None:
    with (FOLDER / str(number)).open("a") as file:
        file.write(test + "\n")


def hit(number: int) -> None:
    """Note the test that is running, once, in whatever process of it."""
    _note(number, os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0])


def noted(folder: Path, number: int) -> list[str]:
    """Tests that executed the statement, "" among them if importing a test did."""
    path = folder / str(number)
    return sorted(set(path.read_text().splitlines())) if path.exists() else []
