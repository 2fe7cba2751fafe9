"""The journal of a sweep: what is finished, kept while the rest goes on, so that an ended sweep can go on.

A file of JSON lines, each written in one go: first what the sweep is, then a line for each finished chunk.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import RawIOBase
from pathlib import Path
from typing import Any

from cogless.errors import StudyError
from cogless.files import reason

Chunk = int


class Journal:
    """An open journal. `finished`: rows of each chunk, as `work.rows` returns them."""

    def __init__(self, path: Path, file: RawIOBase, finished: dict[Chunk, Any]) -> None:
        self.path, self.finished = path, finished
        self._file = file

    def add(self, chunk: Chunk, rows: Any) -> None:
        """Keep a finished chunk. StudyError: the file can't be written, such as on a full disk."""
        _append(self.path, self._file, [chunk, rows])
        self.finished[chunk] = rows


@contextmanager
def opened(path: Path, about: Mapping[str, Any]) -> Iterator[Journal]:
    """Open the journal of the sweep `about`, and go on with it if there is one.

    StudyError: it belongs to another sweep, another process writes it, it can't be written.
    """
    try:
        file = open(path, "a+b", buffering=0)  # noqa: SIM115
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StudyError(f"{path}: in use: expected no other sweep that writes here") from None
        file.seek(0)
        content = file.read()
        whole = content.rfind(b"\n") + 1  # a line that a kill cut off doesn't count
        file.truncate(whole)
        lines = content[:whole].splitlines()
        if lines:
            finished = _read(path, lines, about)
        else:
            finished = {}
            _append(path, file, about)
        yield Journal(path, file, finished)


def read(path: Path, about: Mapping[str, Any]) -> dict[Chunk, Any]:
    """The finished chunks of a journal that nobody writes any more."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a shard's file") from error
    return _read(path, content[: content.rfind(b"\n") + 1].splitlines(), about)


def _append(path: Path, file: RawIOBase, value: Any) -> None:
    """Write a line at once, without a buffer that would be tried again when the file is closed."""
    line = memoryview(json.dumps(value, separators=(",", ":")).encode() + b"\n")
    try:
        while line:
            line = line[file.write(line) :]
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error


def _read(path: Path, lines: list[bytes], about: Mapping[str, Any]) -> dict[Chunk, Any]:
    try:
        found = json.loads(lines[0])
        finished = dict(json.loads(line) for line in lines[1:])
        different = next((key for key in about if found[key] != about[key]), None)
    except (ValueError, TypeError, KeyError, IndexError):
        raise StudyError(f"{path}: not readable: expected a file that cogless sweep has written") from None
    if different is not None:
        has, wanted = found[different], about[different]
        expected = f"expected {wanted}, as here" if different != "study" else "expected the same study"
        raise StudyError(f"{path}: {different}: {has}: {expected}, or another directory")
    return finished
