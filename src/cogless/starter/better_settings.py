"""Settings of the drive with which the learning law leaves less ripple, or holds a speed, by runs.

`cogless run` tries the same settings against what limits a run. So it has no cause to advise them later.
All speeds count: a setting is as good as it is at the speed where it is worst (`shortfall`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from cogless.design.gentler import timed_edges
from cogless.errors import StudyError
from cogless.run.cures import Candidate, compensations, observers
from cogless.run.settings_search import HOLDING_WAYS, Shortfall, Way, searched
from cogless.run.suspects import SENSOR
from cogless.starter.ranking import LEARNING_LAW, Outcomes, outcomes, shortfall
from cogless.study import Study, changed
from cogless.study.numerics import voltage_reach
from cogless.study.reading import Changes


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
    changes, vain = _searched(study, HOLDING_WAYS, lost, until_held=True)
    (answer,) = outcomes([changed(study, changes)], LEARNING_LAW) if changes else [{}]
    return Settings(changes=changes, outcomes=answer, vain=vain)


def _searched(
    study: Study, ways: Sequence[Way], scenarios: Sequence[str], until_held: bool = False
) -> tuple[dict[str, Any], list[str]]:
    """Changes that help in scenarios, and the ways that were tried in vain, as `searched` gives them."""

    def tried(of: Sequence[Changes]) -> list[Shortfall | None]:
        variants = [_accepted(study, changes) for changes in of]
        answers = iter(outcomes([variant for variant in variants if variant], LEARNING_LAW, scenarios))
        return [shortfall(study, next(answers)) if variant else None for variant in variants]

    return searched(ways, partial(changed, study), tried, until_held)


def _speed_methods(study: Study, timer: str) -> Iterable[Candidate]:
    """Candidates with an observer, and one that times the edges where the drive can."""
    yield from observers(study)
    timed = timed_edges(study)
    if timed is not None and SENSOR in timed:
        yield Candidate({SENSOR: {**timed[SENSOR], "timer": timer}})


def _accepted(study: Study, changes: Changes) -> Study | None:
    try:
        return changed(study, changes)
    except StudyError:
        return None
