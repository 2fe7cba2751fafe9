"""Parts shared by all readers of logs: the columns that they return, limits of size, errors in one line."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cogless.errors import StudyError, first_line
from cogless.files import reason
from cogless.results.trace import Array

Columns = dict[str, Array]
NUMBERS_MOST = 1 << 27  # numbers in the wanted columns of a file
PACKED_MOST = 1 << 32  # bytes that a file's packed parts unpack to
MESSAGE_MOST = 160  # characters of a library's message


@dataclass(frozen=True, eq=False)
class LogColumns:
    """The columns of a log. `name`: the run's name, or "". `columns`: the wanted columns, by heading.

    `headings`: all headings of the log. `remarks`: sentences on guesses about the file. `clocks`: headings of
    columns of times of day, which are in s.
    """

    name: str
    columns: Mapping[str, NDArray[Any]]
    headings: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    clocks: tuple[str, ...] = ()


@contextmanager
def readable(path: Path, kind: str) -> Iterator[None]:
    """Turn any exception of a library within this context into a StudyError of one line; drop warnings.

    Only libraries of foreign formats are called in this context, so a defect of cogless keeps its traceback.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except StudyError:
        raise
    except Exception as error:
        raise StudyError(f"{path}: {_line(error, path)}: expected a readable {kind} file") from error


def _line(error: Exception, path: Path) -> str:
    """The first line of an exception's text, without the file's name; with the type if the text needs it."""
    if isinstance(error, OSError):
        return printable(reason(error).replace(f"{path}: ", ""))
    line = first_line(error).strip(" :.")
    if isinstance(error, LookupError | MemoryError) or not line:
        line = f"{type(error).__name__} {line}".strip()
    return printable(line)


def printable(text: str) -> str:
    """A file's text for a message: shortened, with a question mark for each character that can't be shown."""
    printable = "".join(
        character if character.isprintable() else "?" for character in text[: MESSAGE_MOST + 1]
    )
    return printable if len(printable) <= MESSAGE_MOST else f"{printable[: MESSAGE_MOST - 3]}..."


def no_numbers(path: Path, name: str) -> StudyError:
    """The error of a column that holds something other than numbers."""
    return StudyError(f"{path}: {name}: expected numbers")


def require_numbers(path: Path, count: int) -> None:
    """Raise StudyError if a log has too many numbers. This is called before their memory is allocated."""
    if count > NUMBERS_MOST:
        raise StudyError(
            f"{path}: its columns have {count:,} numbers or more, {in_bytes(8 * count)}: expected a log of "
            f"{NUMBERS_MOST:,}, {in_bytes(8 * NUMBERS_MOST)}, or fewer"
        )


def require_unpacked(path: Path, parts: Iterable[Iterable[bytes]]) -> None:
    """Raise StudyError if these deflated parts, each in pieces, unpack to too many bytes. Nothing is kept."""
    size = 0
    for pieces in parts:
        unpacker = zlib.decompressobj()
        for piece in pieces:
            packed = piece
            while packed and not unpacker.eof:
                size += len(unpacker.decompress(packed, 1 << 20))
                packed = unpacker.unconsumed_tail
                require_bytes(path, size)


def require_bytes(path: Path, size: int) -> None:
    """Raise StudyError if a log unpacks to too many bytes."""
    if size > PACKED_MOST:
        raise StudyError(
            f"{path}: it unpacks to {in_bytes(size)} or more: "
            f"expected a log of {in_bytes(PACKED_MOST)} or less"
        )


def in_bytes(size: int) -> str:
    """A size in bytes with a binary prefix."""
    units = ("B", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB")
    power = min(len(units) - 1, max(0, (size.bit_length() - 1) // 10))
    return f"{size / 1024**power:.3g} {units[power]}"
