"""Which keys of a study a page can change, and where each lands in the bytes that the engine reads.

A study's values go to the engine through design rules and units, all in Python. A page has no Python. So each
key is tried here: the study is changed as `--set` changes it, and all its descriptions are compared, number
by number.

A key is direct if every number that it moves is the key's value in SI times a constant, bit for bit, at
several irregular values. Any other key gets stops: for each of these values, all numbers that it moves are in
a table. A page sets the numbers in the same way, so it runs what `cogless run --set` runs. Of keys that move
the same number, the first one stays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np

from cogless.errors import StudyError
from cogless.live.blobs import Pair, blobs, held
from cogless.live.candidates import MOTOR, YOURS, Candidate, candidates
from cogless.live.motor import TOGETHER, Product, products
from cogless.live.packed import Number, Packed
from cogless.live.trial_candidates import trial_candidates
from cogless.study import AnyStudy, TrialStudy
from cogless.study.datasheet_words import replaced_by_any
from cogless.study.reading import changed

STOPS = 21
TRIES = 20
OTHER_SHAPE = "the run's description takes another shape with it"
Place = tuple[str, str, str]  # scenario, controller, "run" or "learn"
Samples = Callable[[Candidate], list[float]]
All = Mapping[Place, Packed]


@dataclass(frozen=True)
class Landing:
    """A number that a key sets: the key's value in SI times `scale`, or for each stop one of `values`."""

    number: Number
    scale: float = 1.0
    rounded: bool = False
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class Key:
    """A key that a page can change, with all the numbers that it sets."""

    candidate: Candidate
    lands: Mapping[Place, tuple[Landing, ...]]
    stops: tuple[float, ...] = ()


@dataclass
class Found:
    """Keys that a page can change, and why it can't change others."""

    keys: list[Key] = field(default_factory=list)
    left_out: list[tuple[str, str]] = field(default_factory=list)
    products: dict[Place, list[Product]] = field(default_factory=dict)


def adjustable(study: AnyStudy, told: bool = False) -> Found:
    """The keys of a study that a page can change. `told`: the controller is told of the motor's, too."""
    base = packed(study, held(study))
    found, taken, groups = Found(), set[tuple[Place, int]](), dict[tuple[str | None, str | None], list[Key]]()
    listed = [_bounded(study, candidate) for candidate in _candidates(study, told)]
    together = [candidate for candidate in listed if told and candidate.key in TOGETHER]
    if told:
        _check_words(study, {candidate.key for candidate in together})
        found.products = products(base, lambda values: _changed(study, values), together)
        taken |= {(place, one.number.offset) for place, all_of in found.products.items() for one in all_of}
        found.keys += [Key(candidate, {}) for candidate in together]
    for candidate in listed:
        if candidate in together:
            continue
        key, why = _tried(study, base, candidate)
        if key is None:
            found.left_out.append((candidate.key, why))
            continue
        mine = {(place, one.number.offset) for place, lands in key.lands.items() for one in lands}
        if mine & taken:
            found.left_out.append((candidate.key, "it acts on the same numbers as another key"))
        elif mine:
            taken |= mine
            found.keys.append(key)
            if not key.stops:
                groups.setdefault((candidate.scenario, candidate.controller), []).append(key)
    wrong = {id(key) for group in groups.values() for key in _disproved(study, base, group, _samples)}
    for key in [key for key in found.keys if id(key) in wrong]:
        tabulated = _tabulated(study, base, key.candidate)
        found.keys.remove(key)
        if tabulated is None:
            found.left_out.append((key.candidate.key, OTHER_SHAPE))
        else:
            found.keys.append(tabulated)
    narrow = {
        id(key)
        for group in groups.values()
        for key in _disproved(study, base, [k for k in group if id(k) not in wrong], _wide, alone=True)
    }
    found.keys = [_narrowed(key) if id(key) in narrow or key.stops else key for key in found.keys]
    return found


def _narrowed(key: Key) -> Key:
    """The key with a field that takes what its slider takes."""
    candidate = key.candidate
    return replace(key, candidate=replace(candidate, least=candidate.low, most=candidate.high))


def packed(study: AnyStudy, pairs: Sequence[Pair], like: AnyStudy | None = None) -> dict[Place, Packed]:
    """The descriptions of these runs; `like` as in `blobs`."""
    return {(*pair, what): blob for pair in pairs for what, blob in blobs(study, *pair, like).items()}


def _candidates(study: AnyStudy, told: bool) -> Iterator[Candidate]:
    return trial_candidates(study) if isinstance(study, TrialStudy) else candidates(study, told)


def _bounded(study: AnyStudy, candidate: Candidate) -> Candidate:
    """The candidate with a slider whose ends the study accepts."""
    if candidate.stops or (candidate.group == YOURS and candidate.key in TOGETHER):
        return candidate  # of one's own motor, its other keys decide
    low, high = (_accepted(study, candidate, end) for end in (candidate.low, candidate.high))
    least = low if candidate.least == candidate.low else _accepted(study, candidate, candidate.least)
    most = high if candidate.most == candidate.high else _accepted(study, candidate, candidate.most)
    return replace(candidate, low=low, high=high, least=min(least, low), most=max(most, high))


def _accepted(study: AnyStudy, candidate: Candidate, end: float) -> float:
    """The end, or if the study refuses it, a value nearer to the study's own."""
    for _ in range(5):
        try:
            changed(study, {candidate.key: candidate.text(end)})
            return end
        except StudyError:
            middle = (end + candidate.start) / 2
            end = float(round(middle)) if candidate.whole else float(f"{middle:.4g}")
    return candidate.start


def _check_words(study: AnyStudy, there: Set[str]) -> None:
    """StudyError unless the study has all keys that set numbers together."""
    if missing := [key for key in MOTOR if key in TOGETHER - there]:
        motor = study.source.tables.get("motor", {})
        others = replaced_by_any(key.removeprefix("motor.") for key in missing)
        in_place = ", ".join(key for key in motor if key in others)
        expected = f"expected with --own-motor{f', in place of {in_place}' if in_place else ''}"
        raise StudyError(f"{study.source.path}: {', '.join(missing)}: missing: {expected}")


def _tried(study: AnyStudy, base: All, candidate: Candidate) -> tuple[Key | None, str]:
    """The key as one value shows it, or why there is none; `_disproved` tries more values."""
    value = _samples(candidate)[0]
    try:
        made = {} if candidate.stops else _changed(study, [(candidate, value)])
    except (StudyError, ValueError) as error:
        return None, str(error).splitlines()[0].rpartition(": ")[2]
    if made and _same_shape(base, made):
        lands = {}
        for place, blob in made.items():
            moved = _moved(base[place], [blob])
            fits = [_fitting(study, number, candidate, value, base[place], blob) for number in moved]
            lands[place] = tuple(one for one in fits if one is not None)
            if len(lands[place]) < len(moved):
                break
        else:
            return Key(candidate, lands), ""
    tabulated = _tabulated(study, base, candidate)
    return tabulated, "" if tabulated else OTHER_SHAPE


def _disproved(
    study: AnyStudy, base: All, group: Sequence[Key], samples: Samples, alone: bool = False
) -> list[Key]:
    """The keys that don't set their numbers as `_tried` found, at several values of the group together.

    `alone`: also a key that the study refuses with such a value.
    """
    wrong: dict[int, Key] = {}
    for n in range(1, len(samples(group[0].candidate)) if group else 0):
        values = [(key, samples(key.candidate)[n]) for key in group if id(key) not in wrong]
        try:
            made = _changed(study, [(key.candidate, value) for key, value in values])
        except (StudyError, ValueError):  # such values don't go together
            if len(group) > 1:
                half = len(group) // 2
                parts = (group[:half], group[half:])
                return [key for part in parts for key in _disproved(study, base, part, samples, alone)]
            if alone:
                return list(group)
            continue
        for key, value in values:
            si = key.candidate.si(value)
            right = all(
                landed(one, si) == one.number.read(made[place].data)
                for place, lands in key.lands.items()
                for one in lands
            )
            if not (right and _same_shape(base, made)):
                wrong[id(key)] = key
    return list(wrong.values())


def _changed(study: AnyStudy, values: Sequence[tuple[Candidate, float]]) -> dict[Place, Packed]:
    """The descriptions of the runs that the keys can change, with these values."""
    other = changed(study, {candidate.key: candidate.text(value) for candidate, value in values})
    pairs = dict.fromkeys(pair for candidate, _ in values for pair in candidate.pairs(study))
    return packed(other, list(pairs), study)


def _tabulated(study: AnyStudy, base: All, candidate: Candidate) -> Key | None:
    """The key with stops; None if the descriptions take another shape with it."""
    tables = {}
    for value in candidate.stops or _grid(candidate):
        try:
            made = _changed(study, [(candidate, value)])
        except (StudyError, ValueError):
            continue  # such as a margin for which there are no gains
        if _same_shape(base, made):
            tables[value] = made
    if len(tables) < 3 or candidate.start not in tables:
        return None
    lands = {}
    for place in tables[candidate.start]:
        moved = _moved(base[place], [made[place] for made in tables.values()])
        lands[place] = tuple(
            Landing(n, values=tuple(n.read(made[place].data) for made in tables.values())) for n in moved
        )
    return Key(candidate, lands, tuple(tables))


def _same_shape(base: All, made: All) -> bool:
    return all(blob.shape == base[place].shape for place, blob in made.items())


def _moved(blob: Packed, others: Sequence[Packed]) -> list[Number]:
    """The numbers that differ in at least one of the others."""
    others = [other for other in others if other.data != blob.data]
    return (
        [n for n in blob.numbers if any(n.read(o.data) != n.read(blob.data) for o in others)]
        if others
        else []
    )


def _fitting(
    study: AnyStudy, number: Number, candidate: Candidate, value: float, base: Packed, made: Packed
) -> Landing | None:
    """How a key sets a number, judged by the study's value and another one; None if neither form fits."""
    si = candidate.si(value)
    ratio = number.read(made.data) / si if si else 1.0
    tries = [Landing(number, scale) for scale in (1.0, ratio, float(round(ratio)))]
    if number.format not in "df" and study.drive is not None:
        rates = study.drive.rates
        law, current = rates.current_loop / rates.divider, rates.current_loop
        tries += [Landing(number, rate, True) for rate in (law, current)]
    points = ((si, made), (candidate.si(candidate.start), base))
    return next((one for one in tries if all(landed(one, x) == number.read(b.data) for x, b in points)), None)


def landed(landing: Landing, si: float) -> float:
    """The number that a direct key sets, as a page computes it."""
    value = si * landing.scale
    if landing.rounded:
        return float(round(value))
    return float(np.float32(value)) if landing.number.format == "f" else value


def _samples(candidate: Candidate) -> list[float]:
    """Values across the slider, as irregular as they can be: by the golden section."""
    span = candidate.high - candidate.low
    found = [candidate.low + span * ((n * 0.6180339887498949) % 1.0) for n in range(1, TRIES + 1)]
    return [float(round(value)) if candidate.whole else float(f"{value:.7g}") for value in found]


def _wide(candidate: Candidate) -> list[float]:
    """Values that only the field takes."""
    ends = ((candidate.least, candidate.low), (candidate.high, candidate.most))
    found = [low + (high - low) * share for low, high in ends for share in (0.0, 0.1, 0.37, 1.0)]
    return [float(f"{value:.7g}") for value in found]


def _grid(candidate: Candidate) -> list[float]:
    """The stops of a slider, rounded, with the study's value among them."""
    values = np.linspace(candidate.low, candidate.high, STOPS)
    rounded = {float(round(v)) if candidate.whole else float(f"{v:.3g}") for v in values}
    return sorted(rounded | {candidate.start})
