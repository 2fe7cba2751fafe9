"""Microstepping: whether its correction was made for its current (docs/laws/microstepping.md)."""

from __future__ import annotations

from collections.abc import Iterator

from cogless.design.law_rules import LawRules
from cogless.study.laws.microstepping import Microstepping, wrong_current
from cogless.study.reading import Remark


class MicrosteppingRules(LawRules[Microstepping]):
    """The rules of the law `microstepping`."""

    def notes(self) -> Iterator[Remark]:
        correction = self.law.correction
        own = None if correction is None else correction.current
        text = "" if own is None else wrong_current(own, self.law.current)
        if text:
            yield Remark(text)
