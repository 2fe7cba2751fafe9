"""What a proof was made of, as one hash, and the table of those that were green: proven.txt."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable
from pathlib import Path

INCLUDE_FOLDERS = ("src", "proof")
COMMENT = re.compile(
    rb"""("(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')|/\*(?!@).*?\*/|//(?!@)[^\n]*""", re.DOTALL
)  # or text in quotes
ABOUT = "# The hash of all that a run reads, written by run.py where the run was green: make proof"


def files_read(sources: Iterable[str], folder: Path) -> list[str]:
    """The sources and all that they include, whatever conditions stand around it; relative to the folder.

    What is in no folder of ours is Frama-C's own, and part of its version.
    """
    reached: set[str] = set()
    waiting = list(sources)
    while waiting:
        file = os.path.normpath(waiting.pop())
        if file in reached:
            continue
        reached.add(file)
        for line in re.findall(r"^[ \t]*#[ \t]*include\b(.*)", (folder / file).read_text(), re.MULTILINE):
            name = re.match(r'\s*["<]([^">]+)[">]', line)
            if name is None:
                raise ValueError(f"control/{file}: #include{line}: a file's name has to stand in the text")
            places = (os.path.join(place, name[1]) for place in (os.path.dirname(file), *INCLUDE_FOLDERS))
            waiting += [place for place in places if (folder / place).is_file()][:1]
    return sorted(reached)


def code_of(text: bytes) -> bytes:
    """A C text without its comments and empty lines. What Frama-C reads of comments, /*@ and //@, stays."""
    lines = COMMENT.sub(lambda match: match[1] or b" ", text).splitlines()
    return b"\n".join(line.rstrip() for line in lines if line.strip())


def stamp(command: list[str], sources: Iterable[str], folder: Path, version: str) -> str:
    """A hash of Frama-C's version and command, of the way to judge, and of all files read, by their names
    within the folder. A comment changes no proof."""
    verdict = Path(__file__).with_name("verdict.py").read_bytes()
    digest = hashlib.sha256(repr((version, command)).encode() + verdict)
    for file in files_read(sources, folder):
        text = code_of((folder / file).read_bytes())
        digest.update(f"\n{file} {len(text)}\n".encode() + text)
    return digest.hexdigest()[:16]


def read(table: Path) -> dict[str, str]:
    """Stamps by the names of runs."""
    lines = table.read_text().splitlines() if table.exists() else []
    pairs = [line.split(maxsplit=1) for line in lines if not line.startswith("#")]
    return {name: stamp for stamp, name in pairs}


def write(table: Path, stamps: dict[str, str]) -> None:
    lines = [ABOUT, *(f"{stamps[name]}  {name}" for name in sorted(stamps))]
    temporary = table.with_suffix(".new")
    temporary.write_text("\n".join(lines) + "\n")
    temporary.replace(table)
