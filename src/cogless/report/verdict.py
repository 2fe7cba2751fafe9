"""The frame of a verdict: a few sentences a scenario, from its numbers alone, whichever way they fall."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cogless.report.packing import number
from cogless.study import AnyStudy
from cogless.study.base import StudyBase

CLEARLY = 1.5  # times another's: worth a sentence
TONES = ("worse", "even", "better")  # the worst first


@dataclass(frozen=True)
class Told:
    """A fault, and a sentence about each controller."""

    heading: str
    sentences: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class ScenarioVerdict:
    """Verdict on a scenario: a headline, details and, where something breaks, what is told of each fault.

    `tone`: "better" where a law that learns is the best, "worse" where the baseline is, else "even". With
    faults the headline is their account's, and the tone no better than theirs.
    """

    scenario: str
    tone: str
    headline: str
    details: Sequence[str]
    told: Sequence[Told] = ()


@dataclass(frozen=True)
class Contest:
    """The controllers of a scenario beside each other."""

    study: AnyStudy

    @property
    def baseline(self) -> str:
        return self.study.baseline

    def label(self, controller: str) -> str:
        return called(self.study, controller)

    def labels(self, controllers: Sequence[str]) -> str:
        """Labels of controllers, for a sentence."""
        return listed([self.label(name) for name in controllers])

    def learns(self, controller: str) -> bool:
        """Whether what a controller asks for is learned."""
        return self.study.controller[controller].learned

    def tone(self, winners: Sequence[str]) -> str:
        """Tone of a verdict with these controllers at its head."""
        if self.baseline in winners:
            return "worse" if list(winners) == [self.baseline] else "even"
        return "better" if all(self.learns(name) for name in winners) else "even"


def worst(*tones: str) -> str:
    """The worst of some tones."""
    return min(tones, key=TONES.index)


def called(study: StudyBase, controller: str) -> str:
    """A controller's label, in quotation marks if it has a comma, since sentences list labels."""
    label = study.label(controller)
    return f"“{label}”" if "," in label else label


def listed(parts: Sequence[str]) -> str:
    """ "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def over(value: float, other: float) -> float:
    """A value over another; infinite where only the other is zero."""
    return value / other if other else math.inf if value else 1.0


def times(ratio: float) -> str:
    """A ratio in words: "1.60 times"."""
    if not math.isfinite(ratio):
        return "infinitely"
    return f"{number(ratio) if ratio < 100 else f'{ratio:.0f}'} times"
