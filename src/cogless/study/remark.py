"""A sentence about a study, with each change that it advises as data.

A sentence that advises a change carries that change as data. The tests apply each change and run the study
again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from cogless.study.reading import AStudy, Changes, changed


@dataclass(frozen=True)
class Remark:
    """One line on a study. It begins with the key that it is about."""

    text: str
    cures: tuple[Changes, ...] = ()  # values by dotted key; each of these changes helps without the others

    def __str__(self) -> str:
        return self.text

    def about(self, key: str) -> Remark:
        """The same remark with a key in front."""
        return replace(self, text=f"{key}: {self.text}")

    def cured(self, study: AStudy) -> Iterator[AStudy]:
        """The study with one advised change at a time. StudyError: the study refuses the change."""
        return (changed(study, cure) for cure in self.cures)
