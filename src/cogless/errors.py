"""The error that the user can correct, and how the command line tells of it."""

from __future__ import annotations

import sys
from contextlib import suppress

WRONG, INTERRUPTED = 2, 130  # exit codes


class StudyError(Exception):
    """A mistake in a study or on the command line, as `FILE: key: VALUE: expected ...`; one line per mistake.

    The command line prints the text unchanged and exits with code 2.
    """


def say(line: str) -> None:
    """Print a line on stderr, if that can be written."""
    with suppress(OSError):
        print(line, file=sys.stderr)
