"""Plugin of pytest that notes after each test which marks (mutants.blocks) it passed, and its seconds."""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from time import process_time

import pytest

from mutants.switched import PAGE  # not mutants.page, which opens what COGLESS_HITS names

FOLDER = Path(__file__).parents[2] / "hits"  # of the copy of the tree in which the tests run
DIGITS = bytes([ord("0"), *[ord("1")] * 255])


# A page for this process and those that it starts. In no hook: a conftest.py loads marked code before most.
page = FOLDER / f"page-{os.environ.get('PYTEST_XDIST_WORKER', 'main')}"
page.write_bytes(bytes(PAGE))
os.environ["COGLESS_HITS"] = str(page)


def _note(test: str, seconds: float) -> None:
    """Write down a test's marks as the bits of a number, and clear the page."""
    marks = int(page.read_bytes()[::-1].translate(DIGITS), 2)
    with page.open("r+b") as file:  # the same file, which is shared
        file.write(bytes(PAGE))
    with (FOLDER / "tests").open("a") as file:
        file.write(f"{marks:x} {seconds:.3f} {test}\n")


def pytest_collection_finish() -> None:
    """Note the marks that importing the tests passes, without the name of a test."""
    _note("", 0.0)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    begin = process_time()
    result = yield
    _note(item.nodeid, process_time() - begin)
    return result
