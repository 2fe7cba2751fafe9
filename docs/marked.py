"""Puts generated tables into a page, between <!-- begin NAME --> and <!-- end NAME -->."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

RPM = math.pi / 30  # rad/s
Metrics = dict[tuple[str, str], dict[str, Any]]  # (scenario, controller) -> name -> SI value
Blocks = dict[str, list[str]]


def metrics_of(path: Path) -> Metrics:
    """The metrics of all runs in a results.json."""
    runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
    return {(run["scenario"], run["controller"]): run["metrics"] for run in runs}


def row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [row(head), row(["---"] + ["---:"] * (len(head) - 1)), *map(row, rows)]


def number(value: float | None, digits: int = 3) -> str:
    """A value to so many significant digits, without an exponent; "-" for None."""
    if value is None:
        return "-"
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def replaced(page: str, blocks: Blocks) -> str:
    """The page with each block between its marks; KeyError if there is no block for a mark."""

    def fill(found: re.Match[str]) -> str:
        name = found.group(1)
        return f"<!-- begin {name} -->\n\n" + "\n".join(blocks[name]) + f"\n\n<!-- end {name} -->"

    return re.sub(r"<!-- begin (\S+) -->\n.*?<!-- end \1 -->", fill, page, flags=re.DOTALL)


def main(page: Path, make: Callable[[Path], Blocks]) -> None:
    """Command line: RESULTS_JSON prints the tables, --write RESULTS_JSON puts them into the page."""
    arguments = [a for a in sys.argv[1:] if a != "--write"]
    if len(arguments) != 1:
        sys.exit(f"usage: python {sys.argv[0]} [--write] RESULTS_JSON")
    blocks = make(Path(arguments[0]))
    if "--write" in sys.argv:
        page.write_text(replaced(page.read_text(encoding="utf-8"), blocks), encoding="utf-8")
        return
    for name, lines in blocks.items():
        print(f"## {name}\n", *lines, "", sep="\n")
