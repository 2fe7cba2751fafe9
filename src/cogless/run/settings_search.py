"""Search for settings of the drive by runs, one setting on top of another.

`cogless new` searches settings for a first study, `cogless run` for a speed that no controller holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from cogless.results.limits import HELPING_SHARE
from cogless.run.cures import OCTAVES, Candidate, compensations, observers, rates_of_law, slower_current_loops
from cogless.study import Study
from cogless.study.reading import Changes

QUICK_OCTAVES = (1, 2, *OCTAVES)  # law's rate / observer's bandwidth, where a speed is not held


@dataclass(frozen=True, kw_only=True)
class Way:
    """A kind of setting, in words, and the changes of a study that try it."""

    words: str
    candidates: Callable[[Study], Iterable[Candidate]]


HOLDING_WAYS = (
    Way(words="the rate of the speed loop", candidates=rates_of_law),
    Way(words="an observer", candidates=partial(observers, octaves=QUICK_OCTAVES)),
    Way(words="dead-time compensation", candidates=compensations),
    Way(words="a slower current loop", candidates=slower_current_loops),
)


class Shortfall(NamedTuple):
    """What runs at some speeds lack, less is better: the number of speeds that are not held comes first.

    `ripple`: the largest of the held speeds. `error`: the largest of the other speeds. Both are shares of the
    speed.
    """

    lost: int
    ripple: float
    error: float


Tried = Callable[[Sequence[Changes]], Sequence[Shortfall | None]]


def searched(
    ways: Sequence[Way],
    studies: Callable[[Changes], Study],
    tried: Tried,
    until_held: bool = False,
) -> tuple[dict[str, Any], list[str]]:
    """Changes that help, and the ways that were tried in vain, in words.

    `studies`: the study with changes. `tried`: what runs with each of these changes lack; None: the study
    refuses them. The best way comes first, then another if it helps clearly, too. `until_held`: only until
    all speeds are held. Then, where no way helps alone, the ways are also tried on top of the nearest one.
    """
    (least,) = tried([{}])
    changes, nearest, vain, untried = dict[str, Any](), dict[str, Any](), dict[str, bool](), [*ways]
    below: list[Way] = []  # the nearest way, which doesn't help alone
    while least is not None and untried and not (until_held and least.lost == 0):
        options = _options(untried, studies, {**changes, **nearest})
        answers = tried([change for _, change in options])
        able = [(*pair, answer) for pair, answer in zip(options, answers, strict=True) if answer is not None]
        better = [(way, change, answer) for way, change, answer in able if _is_better(answer, least)]
        helpful = {way.words for way in ([way for way, *_ in better] + below if better else [])}
        vain |= {way.words: vain.get(way.words, True) for way, *_ in able}
        vain |= dict.fromkeys(helpful, False)
        if better:
            way, changes, least = min(better, key=lambda option: option[2])
            nearest, below = {}, []
        elif until_held and able and not below:
            way, nearest, _ = min(able, key=lambda option: option[2].error)
            below = [way]
        else:
            break
        untried.remove(way)
    return changes, [words for words, is_vain in vain.items() if is_vain]


def _options(
    ways: Sequence[Way], studies: Callable[[Changes], Study], changes: Mapping[str, Any]
) -> list[tuple[Way, dict[str, Any]]]:
    """The candidates of each way, each on top of these changes."""
    study = studies(changes)
    return [(way, {**changes, **option.changes}) for way in ways for option in way.candidates(study)]


def _is_better(size: Shortfall, least: Shortfall) -> bool:
    """Whether more speeds are held, or as many with clearly less ripple."""
    clearly_less = math.isfinite(size.ripple) and size.ripple <= HELPING_SHARE * least.ripple
    return size.lost < least.lost or (size.lost == least.lost and clearly_less)
