"""Draw the mutants that a run judges: by seed, evenly over all lines that can have a mutant."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from mutants import c_code, python_code
from mutants.change import Change

COMPILED = (".py", ".c", ".h", ".cpp", ".hpp")  # the longer a change takes to compile, the later
ROOMS = (("src/cogless", (".py",)), ("simulator", (".cpp", ".hpp")), ("control/src", (".c", ".h")))


def sources(root: Path, wanted: Sequence[str]) -> list[str]:
    """Source files in ROOMS, as paths from the root; if `wanted` isn't empty, only those in its paths."""
    files = [
        path.relative_to(root).as_posix()
        for room, endings in ROOMS
        for path in sorted((root / room).rglob("*"))
        if path.suffix in endings and "assets" not in path.parts
    ]
    return [file for file in files if not wanted or any(Path(file).is_relative_to(path) for path in wanted)]


@cache
def changes(file: str, text: str) -> list[Change]:
    return python_code.changes(text) if file.endswith(".py") else c_code.changes(text)


def drawn(root: Path, wanted: Sequence[str], count: int, seed: int) -> list[Iterator[tuple[str, Change]]]:
    """Make `count` draws in random order. Each yields a mutant, then others nearby in case it doesn't
    compile."""
    texts = {file: (root / file).read_text() for file in sources(root, wanted)}
    at: dict[tuple[str, int], list[Change]] = {}
    for file, text in texts.items():
        for change in sorted(changes(file, text), key=lambda change: change.start):
            at.setdefault((file, change.line(text)), []).append(change)
    lines = list(at)
    chance = random.Random(seed)
    step, offset = len(lines) / count, chance.random()
    places = [int((n + offset) * step) for n in range(count)] if lines else []
    chance.shuffle(places)
    places.sort(key=lambda place: COMPILED.index(Path(lines[place][0]).suffix))

    def draw(place: int) -> Iterator[tuple[str, Change]]:
        for file, line in lines[place:] + lines[:place]:
            there = list(at[file, line])
            random.Random(f"{seed} {file} {line}").shuffle(there)
            yield from ((file, change) for change in there)

    return [draw(place) for place in places]
