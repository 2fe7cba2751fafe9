"""Settings of the drive with which the learning law leaves less ripple, or holds a speed, by runs.

`cogless run` tries the same settings against what limits a run. So it has no cause to advise them later.
All speeds count: a setting is as good as it is at the speed where it is worst (`shortfall`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from cogless.design.gentler import timed_edges
from cogless.errors import StudyError
from cogless.results.limits import HELPING_SHARE
from cogless.run.cures import OCTAVES, Candidate, compensations, observers, rates_of_law, slower_current_loops
from cogless.run.suspects import SENSOR
from cogless.starter.ranking import LEARNING_LAW, Outcomes, outcomes, shortfall
from cogless.study import Study, changed
from cogless.study.numerics import voltage_reach
from cogless.study.reading import Changes

QUICK_OCTAVES = (1, 2, *OCTAVES)  # law's rate / observer's bandwidth, where a speed is not held


@dataclass(frozen=True, kw_only=True)
class Way:
    """A kind of setting, in words, and the changes of a study that try it."""

    words: str
    candidates: Callable[[Study], Iterable[Candidate]]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Changes that runs show to help. `outcomes`: with them. `vain`: the ways that do not help, in words."""

    changes: Changes = field(default_factory=dict)
    outcomes: Outcomes = field(default_factory=dict)
    vain: Sequence[str] = ()


def better_settings(study: Study, timer: str, compensates: bool) -> dict[str, Any]:
    """The speed method, the compensation of dead time, or both, with which `harmonic` leaves clearly less.

    `timer`: the rate of the drive's clock that times edges; "": it has none. `compensates`: whether the
    drive's firmware may compensate its dead time.
    """
    ways = [Way(words="the speed method", candidates=partial(_speed_methods, timer=timer))]
    ways += [Way(words="dead-time compensation", candidates=compensations)] if compensates else []
    changes, _ = _searched(study, ways, [*study.scenario])
    return changes


def holding_settings(study: Study, lost: Sequence[str]) -> Settings:
    """Settings with which `harmonic` holds speeds that it does not hold now, if the bus voltage allows them.

    `lost`: the scenarios with these speeds.
    """
    lost = [name for name in lost if study.scenario[name].top_reference <= voltage_reach(study)]
    if not lost:
        return Settings()
    ways = [
        Way(words="the rate of the speed loop", candidates=rates_of_law),
        Way(words="an observer", candidates=partial(observers, octaves=QUICK_OCTAVES)),
        Way(words="dead-time compensation", candidates=compensations),
        Way(words="a slower current loop", candidates=slower_current_loops),
    ]
    changes, vain = _searched(study, ways, lost, until_held=True)
    (answer,) = outcomes([changed(study, changes)], LEARNING_LAW) if changes else [{}]
    return Settings(changes=changes, outcomes=answer, vain=vain)


def _searched(
    study: Study, ways: Sequence[Way], scenarios: Sequence[str], until_held: bool = False
) -> tuple[dict[str, Any], list[str]]:
    """Changes that help in scenarios, and the ways that were tried in vain, in words.

    The best way comes first, then another if it helps clearly, too. `until_held`: only until all speeds are
    held.
    """
    (answer,) = outcomes([study], LEARNING_LAW, scenarios)
    least, changes, vain = shortfall(study, answer), dict[str, Any](), dict[str, bool]()
    untried = [*ways]
    while untried and not (until_held and least[0] == 0):
        tried = [
            (way, candidate.changes, variant)
            for way in untried
            for candidate in way.candidates(study)
            if (variant := _accepted(study, candidate.changes)) is not None
        ]
        answers = outcomes([variant for *_, variant in tried], LEARNING_LAW, scenarios)
        sizes = [shortfall(study, of_variant) for of_variant in answers]
        better = [place for place, size in enumerate(sizes) if _is_better(size, least)]
        helpful = {tried[place][0].words for place in better}
        vain |= {way.words: vain.get(way.words, True) and way.words not in helpful for way, *_ in tried}
        if not better:
            break
        best = min(better, key=lambda place: sizes[place])
        way, change, study = tried[best]
        least = sizes[best]
        changes |= change
        untried.remove(way)
    return changes, [words for words, is_vain in vain.items() if is_vain]


def _is_better(size: tuple[int, float], least: tuple[int, float]) -> bool:
    """Whether more speeds are held, or as many with clearly less ripple."""
    (lost, ratio), (lost_before, ratio_before) = size, least
    clearly_less = math.isfinite(ratio) and ratio <= HELPING_SHARE * ratio_before
    return lost < lost_before or (lost == lost_before and clearly_less)


def _speed_methods(study: Study, timer: str) -> Iterable[Candidate]:
    """Candidates with an observer, and one that times the edges where the drive can."""
    yield from observers(study)
    timed = timed_edges(study) if timer else None
    if timed is not None and SENSOR in timed:
        yield Candidate({SENSOR: {**timed[SENSOR], "timer": timer}})


def _accepted(study: Study, changes: Changes) -> Study | None:
    try:
        return changed(study, changes)
    except StudyError:
        return None
