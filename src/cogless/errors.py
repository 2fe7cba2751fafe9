"""The error that the user can correct, and the exit codes of the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

EXIT_DEFECT, EXIT_WRONG, EXIT_INTERRUPTED = 1, 2, 130  # exit codes


def first_line(error: BaseException) -> str:
    """The first line of any exception's text that is not blank; "" if there is none."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), "")


class StudyError(Exception):
    """A mistake in a study or on the command line, as `FILE: key: VALUE: expected ...`; one line per mistake.

    The command line prints the text unchanged and exits with code 2. `cures`: the changes of the study that
    the text advises. Each of them has values by dotted key, and helps without the others.
    """

    cures: tuple[Mapping[str, Any], ...] = ()

    def advising(self, *cures: Mapping[str, Any]) -> Self:
        """Attach the changes that this error advises, and return it."""
        self.cures = cures
        return self

    @property
    def mistakes(self) -> Sequence[str]:
        """The text, a line for each mistake."""
        return str(self).splitlines()

    @property
    def expected(self) -> str:
        """The last part of the first mistake's line, which says what was expected."""
        return self.mistakes[0].rpartition(": ")[2]

    def text_without(self, file: object) -> str:
        """The text without this file or key at its beginning, for places where the reader knows it."""
        return str(self).removeprefix(f"{file}: ")
