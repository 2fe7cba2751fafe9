"""Put the test files in order: first those that are most likely to notice a mutant."""

from __future__ import annotations

import re
from pathlib import Path

LIKELY = 6  # test files that run first; pytest collects the others only if these pass


def files_for(root: Path, file: str, function: str) -> list[str]:
    """All test files; first those that have a similar name, import the file, or name the function."""
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
        return -(like + 4 * imported + 4 * min(named, 2) + min(mentions, 4)), len(text)

    found = sorted((root / "tests").rglob("test_*.py"), key=weight)
    return [test.relative_to(root).as_posix() for test in found]


def those_of(files: list[str], tests: list[str]) -> list[list[str]]:
    """What to run in turn for a mutant that only these tests execute: first they, then all of their files,
    since a test may judge what another one has run. If importing a file executes it (""), then all files."""
    place = {file: n for n, file in enumerate(files)}
    first = sorted(filter(None, tests), key=lambda test: place[test.partition("::")[0]])
    if "" in tests:
        return [first or files[:LIKELY], files if first else files[LIKELY:]]
    return [first, list(dict.fromkeys(test.partition("::")[0] for test in first))]


def others_of(files: list[str], tests: list[str], seconds: dict[str, float]) -> list[str]:
    """Files of these tests beside the likely ones, the quickest first."""
    found = {test.partition("::")[0] for test in tests} - set(files[:LIKELY])
    return sorted(found, key=lambda file: seconds.get(file, 0.0))


def function_at(file: str, text: str, position: int) -> str:
    """Name of the last function that begins before a position in a file; empty if there is none."""
    python, other = r"^ *def (\w+)", r"^[ ]{0,4}[A-Za-z_][\w:<>*&, ]*?[ *&](?:\w+::)*(\w+)\([^;]*$"
    found = re.findall(python if file.endswith(".py") else other, text[:position], re.MULTILINE)
    return found[-1] if found else ""
