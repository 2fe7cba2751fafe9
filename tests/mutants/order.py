"""Put the test files in order: first those that are most likely to notice a mutant."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

LIKELY = 6  # test files whose tests run first


@cache
def files_for(root: Path, file: str, function: str) -> list[str]:
    """All test files; first those that have a similar name, test the room, import the file, or name the
    function."""
    path = Path(file)
    words = set(re.split(r"[/_]", path.with_suffix("").as_posix())) - {"src", "cogless", "control"}
    imports = re.compile(rf"^(?:from|import) .*\b{path.stem}\b", re.MULTILINE)
    package = re.compile(rf"^from cogless\.{path.parent.name} import", re.MULTILINE)

    def weight(test: Path) -> tuple[float, int]:
        text = test.read_text()
        named_for = set(test.stem.split("_")) - {"test"}
        like = 3 * len(words & named_for) - len(named_for - words)
        named = bool(function) and len(re.findall(rf"\b{function}\b", text))
        mentions = len(re.findall(rf"\b(?:cgl_)?{path.stem}\b", text))
        imported = bool(imports.search(text) or package.search(text))
        room = test.parent.name in (path.parts[0], path.parent.name)
        return -(like + 3 * room + 4 * imported + 4 * min(named, 2) + min(mentions, 4)), len(text)

    found = sorted((root / "tests").rglob("test_*.py"), key=weight)
    return [test.relative_to(root).as_posix() for test in found]


def in_order(tests: dict[str, float], files: list[str]) -> list[str]:
    """Tests with their seconds, file by file: first those of the likely files, then of the quickest."""
    total: dict[str, float] = dict.fromkeys(files[:LIKELY], 0.0)
    for test, seconds in tests.items():
        file = test.partition("::")[0]
        if file not in files[:LIKELY]:
            total[file] = total.get(file, 0.0) + seconds
    place = {file: n for n, file in enumerate(sorted(total, key=lambda file: total[file]))}
    return sorted(tests, key=lambda test: place[test.partition("::")[0]])


def importers(file: str, texts: dict[str, str]) -> list[str]:
    """Other files that import or include this one, or its package."""
    path = Path(file)
    if path.suffix == ".py":
        module = ".".join(path.with_suffix("").parts[1:]).removesuffix(".__init__")
        package, _, name = module.rpartition(".")
        by = rf"^\s*(?:from|import) {re.escape(module)}\b|^\s*from {re.escape(package)} import .*\b{name}\b"
    else:
        by = rf'^#include ["<](?:.*/)?{re.escape(path.name)}[">]'
    found = [other for other, text in texts.items() if other != file and re.search(by, text, re.MULTILINE)]
    package = (path.parent / "__init__.py").as_posix()
    if package in found and package != file:
        found += importers(package, texts)
    return list(dict.fromkeys(found))


def function_at(file: str, text: str, position: int) -> str:
    """Name of the last function that begins before a position in a file; empty if there is none."""
    python, other = r"^ *def (\w+)", r"^[ ]{0,4}[A-Za-z_][\w:<>*&, ]*?[ *&](?:\w+::)*(\w+)\([^;]*$"
    found = re.findall(python if file.endswith(".py") else other, text[:position], re.MULTILINE)
    return found[-1] if found else ""
