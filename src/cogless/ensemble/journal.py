"""The journal of a sweep or a search: what is finished is kept, so that one which ended goes on.

A file of lines, each written in one go: first what it is of, then a line for each finished chunk. A line
is the CRC-32 of a JSON text in eight hex digits, a space, and that text. A damaged line isn't used, so that
its chunk runs again.
"""

from __future__ import annotations

import fcntl
import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import RawIOBase
from pathlib import Path
from typing import Any

from cogless.errors import StudyError, say
from cogless.files import no_device, no_link, reason

Chunk = int
CHECKSUM_BYTES = 9  # at the start of a line


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
        no_link(path)
        no_device(path)
        file = open(path, "a+b", buffering=0)  # noqa: SIM115
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StudyError(f"{path}: in use: expected no other command that writes here") from None
        file.seek(0)
        content = file.read()
        lines = _whole_lines(content)
        begun = lines or not _line(about).startswith(content)
        finished = _read(path, lines, about) if begun else {}
        file.truncate(sum(len(line) + 1 for line in lines))  # without a line that a kill cut off
        if not begun:
            _append(path, file, about)
        yield Journal(path, file, finished)


def read(path: Path, about: Mapping[str, Any]) -> dict[Chunk, Any]:
    """The finished chunks of a journal that nobody writes any more."""
    try:
        no_device(path)
        content = path.read_bytes()
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a shard's file") from error
    return _read(path, _whole_lines(content), about)


def _whole_lines(content: bytes) -> list[bytes]:
    """The lines that end, without their ends; a kill may have cut off the last one."""
    return content.split(b"\n")[:-1]


def _append(path: Path, file: RawIOBase, value: Any) -> None:
    """Write a line at once, without a buffer that would be tried again when the file is closed."""
    line = memoryview(_line(value))
    try:
        while line:
            line = line[file.write(line) :]
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error


def _line(value: Any) -> bytes:
    text = json.dumps(value, separators=(",", ":")).encode()
    return _checksum(text) + text + b"\n"


def _checksum(text: bytes) -> bytes:
    return b"%08x " % zlib.crc32(text)


def _value(line: bytes) -> Any:
    """What a line holds; None if it is damaged."""
    text = line[CHECKSUM_BYTES:]
    try:
        return json.loads(text) if line.startswith(_checksum(text)) else None
    except (ValueError, RecursionError):
        return None


def _read(path: Path, lines: list[bytes], about: Mapping[str, Any]) -> dict[Chunk, Any]:
    has = _value(lines[0]) if lines else None
    if not isinstance(has, dict):
        expected = "expected a file that this command has written"
        if lines and lines[0].startswith(b"{"):
            expected = "has no checksums, as of an earlier cogless: expected another directory"
        raise StudyError(f"{path}: not readable: {expected}")
    different = next((key for key in about if has.get(key) != about[key]), None)
    if different is not None:
        wanted = f"{about[different]}, as here" if different != "study" else "the same study"
        where = f"{path}: {different}: {has.get(different)}"
        raise StudyError(f"{where}: expected {wanted}, or another directory")
    finished: dict[Chunk, Any] = {}
    for number, line in enumerate(lines[1:], 2):
        match _value(line):
            case [int(chunk), list(rows)]:
                finished[chunk] = rows
            case _:
                say(f"Warning: {path}: line {number} is damaged and not used.")
    return finished
