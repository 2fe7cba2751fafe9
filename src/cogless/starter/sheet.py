"""A study as sections of keys with comments, and its guesses."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cogless.starter.amounts import amount, span, unit_for
from cogless.starter.part_catalogue import Figure
from cogless.study.toml import toml
from cogless.units import Dimension

COMMENT_WIDTH = 100
GUESS_MARK = "guess: "  # begins the comment above a guessed value


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A value of the study that is a guess.

    `key`: its key in the study. `name`: in words. `span`: its range, as text. `variants`: label -> changes of
    the study that put the guess at an end of its range, or at another choice.
    """

    key: str
    name: str
    span: str
    variants: Mapping[str, Mapping[str, Any]]


@dataclass
class Section:
    """A table of the study: heading, such as "[motor]", and lines. `guessed`: the guessed values by key."""

    heading: str
    lines: list[str] = field(default_factory=list)
    guessed: dict[str, Any] = field(default_factory=dict)

    def put(self, key: str, value: Any, *comments: str, note: str = "") -> None:
        """Add a key with its value. Comments stand above the key, a note behind the value."""
        for comment in comments:
            self.lines += textwrap.wrap(
                comment, COMMENT_WIDTH, initial_indent="# ", subsequent_indent="#   ", break_on_hyphens=False
            )
        self.lines.append(f"{key} = {toml(value)}{f'  # {note}' if note else ''}")
        if any(comment.startswith(GUESS_MARK) for comment in comments):
            self.guessed[key] = value

    def put_text(self, key: str, text: str) -> None:
        """Add a key whose value is TOML already."""
        self.lines.append(f"{key} = {text}")


@dataclass
class Sheet:
    """Sections in the order of the file, and the guesses in them.

    `remarks`: sentences on how a number was understood. `doubts`: warnings of numbers that are unlikely.
    `unusual`: numbers that such a motor seldom has. `answers`: guessed answers, as text by flag, that the
    study has in another form or in several keys.
    """

    sections: list[Section] = field(default_factory=list)
    guesses: list[Guess] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    unusual: list[str] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)

    def section(self, heading: str) -> Section:
        self.sections.append(Section(heading))
        return self.sections[-1]

    def guess(
        self,
        section: Section,
        key: str,
        figure: Figure,
        dimension: Dimension,
        *,
        path: str,
        name: str,
        ends: Figure | None = None,
    ) -> None:
        """Add a guessed key. `path`: of the section in the study. `ends`: range in place of the figure's."""
        ends = ends or figure
        unit = unit_for(figure.typical, dimension)
        low, high = (amount(end, dimension, unit) for end in (ends.low, ends.high))
        text = span(ends.low, ends.high, dimension, unit)
        section.put(key, amount(figure.typical, dimension, unit), f"guess: {text}; {figure.reason}")
        self.guesses.append(
            Guess(
                key=f"{path}.{key}",
                name=name,
                span=text,
                variants={end: {f"{path}.{key}": end} for end in (low, high)},
            )
        )

    def file_text(self, head: Iterable[str]) -> str:
        """The text of the file. `head`: its first lines."""
        blocks = [[*head], *([*filter(None, [section.heading]), *section.lines] for section in self.sections)]
        return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def origin(figure: Figure) -> str:
    """The comment of a figure that is not varied: who published it, or that it is a guess."""
    return f"{'guess' if figure.is_guess else 'from'}: {figure.reason}"


def because(figure: Figure, reason: str) -> Figure:
    """The figure with another reason."""
    return Figure(
        typical=figure.typical, low=figure.low, high=figure.high, reason=reason, is_guess=figure.is_guess
    )


def round_125(value: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    return min((m * power for m in (1.0, 2.0, 5.0, 10.0)), key=lambda number: abs(math.log(number / value)))
