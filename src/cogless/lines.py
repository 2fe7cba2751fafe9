"""Print lines of text on stdout and stderr. For a terminal they are broken between words."""

from __future__ import annotations

import shutil
import sys
import textwrap
from contextlib import suppress
from typing import TextIO


def terminal_columns(stream: TextIO | None = None) -> int | None:
    """Columns of the terminal on stdout, or on another stream; None if the stream is no terminal."""
    return shutil.get_terminal_size().columns if (stream or sys.stdout).isatty() else None


def print_text(text: str, indent: str = "", others: str | None = None) -> None:
    """Print lines of text. On a terminal they break between words; elsewhere they stay whole.

    `indent`: text before each line. `others`: text before a line's continuations; None: `indent`, too.
    """
    for line in text.split("\n"):
        print(_broken(line, terminal_columns(), indent, indent if others is None else others))


def warn(line: str) -> None:
    """Print a warning on stderr, if that can be written; on a terminal it breaks between words."""
    with suppress(OSError):
        print(_broken(f"Warning: {line}.", terminal_columns(sys.stderr)), file=sys.stderr)


def say(line: str) -> None:
    """Print a line on stderr, if that can be written."""
    with suppress(OSError):
        print(line, file=sys.stderr)


def _broken(line: str, columns: int | None, indent: str = "", others: str = "") -> str:
    """A line, broken between words if it is longer than `columns`; None: the line stays whole."""
    if columns is None or len(indent + line) <= columns:
        return f"{indent}{line}".rstrip()
    own = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line.strip(),
        columns,
        initial_indent=indent + own,
        subsequent_indent=others + own,
        break_long_words=False,
        break_on_hyphens=False,
    )
