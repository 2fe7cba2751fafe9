"""What is said about a study, with each change that it advises as data.

A sentence that tells the user to change something carries that change. Whoever prints it prints the text;
whoever doubts it applies the change and runs the study again, as the tests do with every remark that advises.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from cogless.study.reading import AStudy, Changes, changed


@dataclass(frozen=True)
class Remark:
    """One line on a study, which begins with the key that it is about."""

    text: str
    cures: tuple[Changes, ...] = ()  # values by dotted key; each of these changes helps without the others

    def __str__(self) -> str:
        return self.text

    def about(self, key: str) -> Remark:
        """The same remark, said of a key."""
        return replace(self, text=f"{key}: {self.text}")

    def cured(self, study: AStudy) -> Iterator[AStudy]:
        """The study with each of the advised changes. StudyError: the study can't be changed so."""
        return (changed(study, cure) for cure in self.cures)
