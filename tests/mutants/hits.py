"""Which tests execute a mutant's statement: one run of all tests, with a call of `hit` before each in Python,
and a mark by switch.h in C and C++, which this as a plugin of pytest reads after each test."""

from __future__ import annotations

import ast
import os
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path
from time import process_time

import pytest

from mutants.switched import PAGE

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


def pytest_configure() -> None:
    """A page for this process and those that it starts, before any of them loads the engine."""
    page = FOLDER / f"page-{os.environ.get('PYTEST_XDIST_WORKER', 'main')}"
    page.write_bytes(bytes(PAGE))
    os.environ["COGLESS_HITS"] = str(page)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    page, begin = Path(os.environ["COGLESS_HITS"]), process_time()
    result = yield
    with page.open("r+b") as file:
        for number, mark in enumerate(file.read()):
            if mark:
                _note(number, item.nodeid)
        file.seek(0)
        file.write(bytes(PAGE))
    with (FOLDER / "seconds").open("a") as spent:
        spent.write(f"{process_time() - begin:.3f} {item.nodeid.partition('::')[0]}\n")
    return result


def seconds(folder: Path) -> dict[str, float]:
    """Processor time of each test file, without that of other processes."""
    total: dict[str, float] = {}
    for line in (folder / "seconds").read_text().splitlines():
        spent, file = line.split(" ", 1)
        total[file] = total.get(file, 0.0) + float(spent)
    return total
