"""Common parts of the verdicts: a few sentences per scenario, from its values alone, favourable or not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cogless.report.markup import number
from cogless.study import AnyStudy
from cogless.study.base import StudyBase

EQUAL_DIFFERENCE = 0.05  # relative difference below which two values count as equal
REPORTED_RATIO = 1.5  # a value / another controller's, from which on a sentence reports the difference
TONES = ("worse", "even", "better")  # the worst first


@dataclass(frozen=True)
class Paragraph:
    """A fault's heading, and pairs of a controller and a sentence on its response."""

    heading: str
    sentences: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class ScenarioVerdict:
    """Verdict on a scenario: a headline, details and, with faults, sentences on each fault.

    `tone`: "better" if a learning law is the best, "worse" if the baseline is, else "even". With faults the
    headline is about the faults, and the tone is no better than that of the response to them.
    `cost`: a sentence on what the best controller costs; "" where that is unknown. `doubts`: sentences on
    winners whose next run may end otherwise. `best`: the controller that the headline recommends; "" if
    none, such as if all are alike, or learning does not help.
    """

    scenario: str
    tone: str
    headline: str
    details: Sequence[str]
    paragraphs: Sequence[Paragraph] = ()
    cost: str = ""
    doubts: Sequence[str] = ()
    best: str = ""


@dataclass(frozen=True)
class Answer:
    """The large figures of a scenario: for each a controller, a word on its run, and a value with unit."""

    figures: Sequence[tuple[str, str, str]]
    change: str  # the last against the first, such as "72.4 times less"
    quantity: str  # such as "speed ripple, 26 to 30 s"


@dataclass(frozen=True)
class LearningHelps:
    """What learning does to the best law: the tone, and words such as "as much as with learning off (2 rpm)".

    `text`: what the law leaves with learning off, with the unit. `value`: the number in `text`; None if the
    law with learning off does not hold the speed.
    """

    controller: str
    tone: str
    words: str
    text: str
    value: float | None

    @property
    def remark(self) -> str:
        """The words without the value."""
        return self.words.partition(" (")[0]


@dataclass(frozen=True)
class Contest:
    """The comparison of a scenario's controllers."""

    study: AnyStudy

    @property
    def baseline(self) -> str:
        return self.study.baseline

    def label(self, controller: str) -> str:
        return called(self.study, controller)

    def labels(self, controllers: Sequence[str]) -> str:
        """Labels of controllers, listed for a sentence."""
        return listed([self.label(name) for name in controllers])

    def learns(self, controller: str) -> bool:
        """Whether the controller's output is learned in part, in this run or before."""
        return self.study.controller[controller].learned

    def tone(self, winners: Sequence[str]) -> str:
        """The tone of a verdict with these controllers as the winners."""
        if self.baseline in winners:
            return "worse" if list(winners) == [self.baseline] else "even"
        return "better" if all(self.learns(name) for name in winners) else "even"


def worst(*tones: str) -> str:
    """The worst of the given tones, in the order of `TONES`."""
    return min(tones, key=TONES.index)


def called(study: StudyBase, controller: str) -> str:
    """A controller's label, in quotation marks if it has a comma, since sentences list labels."""
    label = study.label(controller)
    return f"“{label}”" if "," in label else label


def listed(parts: Sequence[str]) -> str:
    """The parts as a list in words, such as "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def ratio(value: float, other: float) -> float:
    """A value divided by another; 1 if both are zero, infinite if only the other is."""
    return value / other if other else math.inf if value else 1.0


def times(ratio: float) -> str:
    """A ratio in words, such as "1.60 times"."""
    if not math.isfinite(ratio):
        return "infinitely"
    return f"{number(ratio) if ratio < 100 else f'{ratio:.0f}'} times"


def change_words(ratio: float) -> str:
    """A value's ratio to another in words, such as "46.2 times less"."""
    if abs(ratio - 1) <= EQUAL_DIFFERENCE:
        return "as much"
    if ratio < 1:
        return f"{times(1 / ratio)} less" if ratio else "nothing left"
    return f"worse: {times(ratio)} as much" if math.isfinite(ratio) else "worse"
