"""Settings of the drive with which the learning law leaves less ripple, found by runs.

`cogless run` tries the same settings against what limits a run. So it has no cause to advise them later.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from cogless.errors import StudyError
from cogless.results.limits import HELPING_SHARE
from cogless.run.cures import Candidate, compensations, observers
from cogless.starter.ranking import LEARNING_LAW, outcomes
from cogless.study import Study, changed
from cogless.study.reading import Changes


def better_settings(study: Study, compensates: bool) -> dict[str, Any]:
    """The observer, the compensation of dead time, or both, with which `harmonic` leaves clearly less.

    The better one is taken first; the other is added if it helps clearly, too. {}: neither helps.
    `compensates`: whether the drive's firmware may compensate its dead time.
    """
    (scenario,) = study.scenario
    (least,) = outcomes([study], scenario, LEARNING_LAW)
    ways: list[Callable[[Study], Iterator[Candidate]]] = [observers]
    ways += [compensations] if compensates else []
    chosen: dict[str, Any] = {}
    while ways:
        tried = [
            (way, candidate.changes, variant)
            for way in ways
            for candidate in way(study)
            if (variant := _accepted(study, candidate.changes)) is not None
        ]
        answers = outcomes([variant for *_, variant in tried], scenario, LEARNING_LAW)
        most = HELPING_SHARE * least.ripple if least.holds else math.inf
        better = [place for place, answer in enumerate(answers) if answer.holds and answer.ripple <= most]
        if not better:
            break
        best = min(better, key=lambda place: answers[place].ripple)
        way, changes, study = tried[best]
        least = answers[best]
        chosen |= changes
        ways.remove(way)
    return chosen


def _accepted(study: Study, changes: Changes) -> Study | None:
    try:
        return changed(study, changes)
    except StudyError:
        return None
