"""Which keys of a study a page can change, and which numbers each sets in the bytes that the engine reads.

A study's values go to the engine through design rules and units, all in Python. A page has no Python. So each
key is tried here: the study is changed as `--set` changes it, and all its descriptions are compared, number
by number.

A key is direct if every number that it moves is the key's value in SI times a constant, bit for bit, at
several irregular values. Any other key gets stops: for each of these values, all numbers that it moves are in
a table. A page sets the numbers in the same way, so it runs what `cogless run --set` runs. Of keys that move
the same number, the first one stays. But the pole pairs of one's own motor share a number with a key that has
stops: its table has a row for each stop and a column for each number of pole pairs.

All keys that seem direct are tried together, each with a value of its own. If a run's bytes are wrong, each
half of the keys is tried on this run alone, and so on, until the wrong keys remain.

A value that the study refuses only narrows the range of its key.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from cogless.c_layout import MisfitError
from cogless.errors import StudyError
from cogless.live.candidates import MOTOR, PAGE_KEYS, YOURS, Candidate
from cogless.live.description import Number, Packed, PackedRuns, Place, blobs, page_runs
from cogless.live.own_motor import OWN_MOTOR_KEYS, OwnMotor, own_motor
from cogless.run.simulate import Pair
from cogless.study import AnyStudy
from cogless.study.datasheet import replaced_by_any
from cogless.study.reading import changed

STOP_COUNT = 21
TRIED_VALUES = 20
# an end is tried this often; if it is refused, it moves halfway to the study's value or the slider's end
END_HALVINGS = 5
PAIRS_REPEATS = 9  # copies of a value: all but the first are tried, each with other pole pairs
JOINT_TRIES = 6  # combinations of the motor's keys on which a table over stops and pole pairs is tested
SAME_NUMBERS = "another key of the page already sets the numbers that this key changes"
OTHER_SHAPE = "this key changes how many numbers a run needs, which is fixed in the page"
Samples = Callable[[Candidate], list[float]]
Columns = Mapping[Number, Mapping[float, float]]  # by number: its value at each stop


@dataclass(frozen=True)
class Landing:
    """A number that a key sets: the key's value in SI times `scale`, or one of `values` for each stop.

    `rounded`: the product is rounded to a whole number. `by_pairs` replaces `values` if the number also
    depends on the pole pairs of one's own motor: a row for each stop, a value for each number of pole pairs.
    """

    number: Number
    scale: float = 1.0
    rounded: bool = False
    values: tuple[float, ...] = ()
    by_pairs: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class Key:
    """A key that a page can change, with all the numbers that it sets."""

    candidate: Candidate
    lands: Mapping[Place, tuple[Landing, ...]]
    stops: tuple[float, ...] = ()


Tried = tuple[Key, float]
Failing = Callable[[Sequence[Tried], Sequence[Pair]], list[Pair] | None]


@dataclass
class AdjustableKeys:
    """Keys that a page can change, and why it can't change others."""

    keys: list[Key] = field(default_factory=list)
    left_out: list[tuple[str, str]] = field(default_factory=list)
    own_motor: OwnMotor | None = None
    base: PackedRuns = field(default_factory=dict)


def adjustable(study: AnyStudy, for_own_motor: bool = False) -> AdjustableKeys:
    """The keys that a page can change. `for_own_motor`: the controllers know the motor's keys."""
    base = packed(study, page_runs(study))
    adjustable_keys, taken = AdjustableKeys(base=base), set[tuple[Place, int]]()
    listed = [_bounded(study, candidate) for candidate in _candidates(study, for_own_motor)]
    listed = _with_all_runs(study, base, listed)
    together = [candidate for candidate in listed if for_own_motor and candidate.key in OWN_MOTOR_KEYS]
    if for_own_motor:
        _check_words(study, {candidate.key for candidate in together})
        adjustable_keys.own_motor = _own_motor(study, base, together)
        adjustable_keys.keys += [Key(candidate, {}) for candidate in adjustable_keys.own_motor.keys.values()]
    own = adjustable_keys.own_motor
    of_motor = set() if own is None else own.numbers

    def collides(key: Key) -> bool:
        return bool(_numbers(key) & taken or _numbers(key, alone=True) & of_motor)

    for candidate in listed:
        if candidate in together:
            continue
        key, why = _tried(study, base, candidate, own)
        if key is None:
            adjustable_keys.left_out.append((candidate.key, why))
        elif collides(key):
            adjustable_keys.left_out.append((candidate.key, SAME_NUMBERS))
        elif any(key.lands.values()):
            taken |= _numbers(key)
            adjustable_keys.keys.append(key)
    direct = [key for key in adjustable_keys.keys if any(key.lands.values()) and not key.stops]
    wrong = disproved(study, base, direct, samples, own)
    for key in [key for key in direct if key in wrong]:
        adjustable_keys.keys.remove(key)
        taken -= _numbers(key)
        tabulated, why = _with_stops(study, base, key.candidate, own)
        if tabulated is None or collides(tabulated):
            adjustable_keys.left_out.append((key.candidate.key, why or SAME_NUMBERS))
        else:
            taken |= _numbers(tabulated)
            adjustable_keys.keys.append(tabulated)
    right = [key for key in direct if key not in wrong]
    narrow = disproved(study, base, right, _wide, own, alone=True)
    adjustable_keys.keys = [_of_slider(key) if key.stops else key for key in adjustable_keys.keys]
    adjustable_keys.keys = [
        _narrowed(study, base, key, own) if key in narrow else key for key in adjustable_keys.keys
    ]
    return adjustable_keys


def _numbers(key: Key, alone: bool = False) -> set[tuple[Place, int]]:
    """The numbers that a key sets. `alone`: only numbers that don't depend on the pole pairs."""
    return {
        (place, one.number.offset)
        for place, all_of in key.lands.items()
        for one in all_of
        if not (alone and one.by_pairs)
    }


def _of_slider(key: Key) -> Key:
    """The key with the field's limits at the slider's ends."""
    candidate = key.candidate
    return replace(key, candidate=replace(candidate, least=candidate.low, most=candidate.high))


def _narrowed(study: AnyStudy, base: PackedRuns, key: Key, own: OwnMotor | None) -> Key:
    """The key with its field narrowed to values for which the page's numbers are right."""

    def is_right(value: float) -> bool:
        return not disproved(study, base, [key], lambda _: [value] * repeats, own, alone=True)

    def end(far: float, near: float) -> float:
        for _ in range(END_HALVINGS):
            far = float(f"{far:.4g}")
            if is_right(far):
                return far
            far = (far + near) / 2
        return near

    candidate, repeats = key.candidate, 2 if own is None else PAIRS_REPEATS  # the first isn't tried
    least, most = end(candidate.least, candidate.low), end(candidate.most, candidate.high)
    narrower = replace(key, candidate=replace(candidate, least=least, most=most))
    return _of_slider(key) if disproved(study, base, [narrower], _wide, own, alone=True) else narrower


def packed(study: AnyStudy, pairs: Sequence[Pair], like: AnyStudy | None = None) -> dict[Place, Packed]:
    """The descriptions of these runs; `like` as in `blobs`."""
    return {(*pair, what): blob for pair in pairs for what, blob in blobs(study, *pair, like).items()}


def _candidates(study: AnyStudy, for_own_motor: bool) -> Iterator[Candidate]:
    return PAGE_KEYS[study.kind].candidates(study, for_own_motor)


def _own_motor(study: AnyStudy, base: PackedRuns, keys: Sequence[Candidate]) -> OwnMotor:
    """The numbers that these keys set together.

    StudyError, which names the study's file: a number is no product of the keys' powers.
    """
    try:
        return own_motor(
            base, lambda values: _changed(study, values), keys, lambda key: _within_study(study, key)
        )
    except StudyError as error:
        raise StudyError(f"{study.source.path}: {error}") from None


def _bounded(study: AnyStudy, candidate: Candidate) -> Candidate:
    """The candidate with a slider whose ends the study accepts."""
    if candidate.stops or (candidate.group == YOURS and candidate.key in OWN_MOTOR_KEYS):
        return candidate  # `own_motor` narrows the keys of one's own motor
    return _within_study(study, candidate)


def _within_study(study: AnyStudy, candidate: Candidate) -> Candidate:
    """The candidate with the ends of slider and field moved to values that the study accepts."""
    low, high = (_accepted(study, candidate, end) for end in (candidate.low, candidate.high))
    least = low if candidate.least == candidate.low else _accepted(study, candidate, candidate.least)
    most = high if candidate.most == candidate.high else _accepted(study, candidate, candidate.most)
    return replace(candidate, low=low, high=high, least=min(least, low), most=max(most, high))


def _accepted(study: AnyStudy, candidate: Candidate, end: float) -> float:
    """The end, or if the study refuses it, a value nearer to the study's own."""
    for _ in range(END_HALVINGS):
        try:
            changed(study, {candidate.key: candidate.study_value(end)})
            return end
        except StudyError:
            middle = (end + candidate.start) / 2
            end = float(round(middle)) if candidate.whole else float(f"{middle:.4g}")
    return candidate.start


def _check_words(study: AnyStudy, present: Set[str]) -> None:
    """StudyError unless the study has all keys that set numbers together."""
    if missing := [key for key in MOTOR if key in OWN_MOTOR_KEYS - present]:
        motor = study.source.tables.get("motor", {})
        others = replaced_by_any(key.removeprefix("motor.") for key in missing)
        in_place = ", ".join(key for key in motor if key in others)
        expected = f"expected with --own-motor{f', in place of {in_place}' if in_place else ''}"
        raise StudyError(f"{study.source.path}: {', '.join(missing)}: missing: {expected}")


def _tried(
    study: AnyStudy, base: PackedRuns, candidate: Candidate, own: OwnMotor | None
) -> tuple[Key | None, str]:
    """The key as a test at one value gives it, or why there is none; `disproved` tries more values."""
    value, changed_blobs, why = _first_accepted(study, candidate)
    if why:
        return None, why
    if changed_blobs and _same_shape(base, changed_blobs):
        lands = {}
        for place, blob in changed_blobs.items():
            moved = _moved(base[place], [blob])
            fits = [_fitting(study, number, candidate, value, base[place], blob) for number in moved]
            lands[place] = tuple(one for one in fits if one is not None)
            if len(lands[place]) < len(moved):
                break
        else:
            return Key(candidate, lands), ""
    return _with_stops(study, base, candidate, own)


def _with_all_runs(study: AnyStudy, base: PackedRuns, listed: Sequence[Candidate]) -> list[Candidate]:
    """The candidates; one of a scenario is marked `elsewhere` if it moves numbers of other scenarios' runs.

    An example is the slowest reference, if the orders that a law learns depend on it.
    """
    groups: dict[str, list[Candidate]] = {}
    for candidate in listed:
        if candidate.scenario is not None and not candidate.stops:
            groups.setdefault(candidate.scenario, []).append(candidate)
    marked = {
        candidate.key
        for scenario, group in groups.items()
        if (others := [pair for pair in page_runs(study) if pair[0] != scenario])
        for end in ("low", "high")
        for candidate in _moving(study, base, group, end, others)
    }
    return [
        replace(candidate, elsewhere=True) if candidate.key in marked else candidate for candidate in listed
    ]


def _moving(
    study: AnyStudy, base: PackedRuns, group: Sequence[Candidate], end: str, runs: Sequence[Pair]
) -> list[Candidate]:
    """The candidates that move numbers of these runs, each at this end of its slider."""
    changed_blobs = _accepted_values(study, [(one, getattr(one, end)) for one in group], runs)
    if changed_blobs is not None and all(blob.data == base[at].data for at, blob in changed_blobs.items()):
        return []
    if len(group) == 1:
        return [] if changed_blobs is None else list(group)
    half = len(group) // 2
    return [one for part in (group[:half], group[half:]) for one in _moving(study, base, part, end, runs)]


def _first_accepted(study: AnyStudy, candidate: Candidate) -> tuple[float, PackedRuns, str]:
    """The first sample that the study accepts and its descriptions, or why it refuses the first one."""
    whys = []
    for value in () if candidate.stops else samples(candidate):
        try:
            return value, _changed(study, [(candidate, value)]), ""
        except (StudyError, MisfitError) as error:
            whys.append(error.expected)
    return candidate.start, {}, whys[0] if whys else ""


def disproved(
    study: AnyStudy,
    base: PackedRuns,
    keys: Sequence[Key],
    samples: Samples,
    own: OwnMotor | None,
    alone: bool = False,
) -> list[Key]:
    """The keys for which a page's bytes would differ from those of `--set`, at several values of all keys.

    The pole pairs of one's own motor change, too. `alone`: a key is also wrong if the study refuses such a
    value of this key alone.
    """
    runs, wrong, right = page_runs(study), list[Key](), list(keys)
    for n in range(1, len(samples(keys[0].candidate)) if keys else 0):
        at_sample = partial(_failing, study, base, own, n)
        wrong += _wrong(at_sample, [(key, samples(key.candidate)[n]) for key in right], runs, alone)
        right = [key for key in right if key not in wrong]
    return wrong


def _wrong(failing: Failing, tried: Sequence[Tried], runs: Sequence[Pair], alone: bool) -> list[Key]:
    """The keys that are wrong in at least one of these runs with these values; `alone` as in `disproved`."""
    bad_runs = failing(tried, runs)
    if bad_runs == []:
        return []
    if len(tried) == 1:
        return [tried[0][0]] if alone or bad_runs is not None else []
    half = len(tried) // 2
    searched = runs if bad_runs is None else bad_runs[:1]
    wrong = [key for part in (tried[:half], tried[half:]) for key in _wrong(failing, part, searched, alone)]
    if bad_runs is None or not wrong:
        return wrong
    right = [(key, value) for key, value in tried if key not in wrong]
    return wrong + (_wrong(failing, right, bad_runs, alone) if right else [])


def _failing(
    study: AnyStudy,
    base: PackedRuns,
    own: OwnMotor | None,
    n: int,
    tried: Sequence[Tried],
    runs: Sequence[Pair],
) -> list[Pair] | None:
    """The runs in which these direct keys, written into the base, don't give the changed descriptions.

    None: the study refuses the values together. `n` chooses the pole pairs of one's own motor.
    """
    values = [(key.candidate, value) for key, value in tried]
    touched = {pair for candidate, _ in values for pair in candidate.pairs(study)}
    if not (pairs := [pair for pair in runs if pair in touched]):
        return []
    unchanged, changed_blobs = base, None
    if own is not None:
        pole_pairs = round(own.pole_pairs.least) + 7 * n % len(own.turned)
        unchanged = own.turned[pole_pairs]
        changed_blobs = _accepted_values(study, [*values, (own.pole_pairs, pole_pairs)], pairs)
    if changed_blobs is None:
        unchanged, changed_blobs = base, _accepted_values(study, values, pairs)
    if changed_blobs is None:
        return None
    wrong = {
        place[:2]
        for place, blob in changed_blobs.items()
        if _as_set(unchanged[place], place, tried) != blob.data
    }
    return [pair for pair in pairs if pair in wrong]


def _as_set(unchanged: Packed, place: Place, tried: Sequence[Tried]) -> bytearray:
    """The bytes of a run with these direct keys written into it, as a page does."""
    data = bytearray(unchanged.data)
    for key, value in tried:
        for one in key.lands.get(place, ()):
            one.number.write(data, landed(one, key.candidate.si(value)))
    return data


def _accepted_values(
    study: AnyStudy, values: Sequence[tuple[Candidate, float]], pairs: Sequence[Pair] | None = None
) -> PackedRuns | None:
    """What `_changed` returns; None if the study refuses the values together."""
    try:
        return _changed(study, values, pairs)
    except (StudyError, MisfitError):
        return None


def _changed(
    study: AnyStudy, values: Sequence[tuple[Candidate, float]], pairs: Sequence[Pair] | None = None
) -> dict[Place, Packed]:
    """The descriptions with these values, for `pairs`, or for all runs that the keys can change."""
    other = changed(study, {candidate.key: candidate.study_value(value) for candidate, value in values})
    if pairs is None:
        pairs = list(dict.fromkeys(pair for candidate, _ in values for pair in candidate.pairs(study)))
    return packed(other, pairs, study)


def _with_stops(
    study: AnyStudy, base: PackedRuns, candidate: Candidate, own: OwnMotor | None
) -> tuple[Key | None, str]:
    """The key with a table over its stops, and over pole pairs where needed; or why there is no such key."""
    tabulated = _tabulated(study, base, candidate)
    if tabulated is None:
        return None, OTHER_SHAPE
    if own is None or _apart_from_pairs(study, tabulated, own):
        return tabulated, ""
    joint = _by_pairs(study, tabulated, own) if candidate.scenario else None
    return joint, "" if joint else SAME_NUMBERS


def _tabulated(study: AnyStudy, base: PackedRuns, candidate: Candidate) -> Key | None:
    """The key with stops; None if the descriptions take another shape with it.

    A run's number takes the column of an earlier run's number of the same path, if both are equal at the
    first, the middle and the last stop and at the study's value.
    """
    variants: dict[float, AnyStudy] = {}
    for value in candidate.stops or _grid(candidate):
        with suppress(StudyError):
            variants[value] = changed(study, {candidate.key: candidate.study_value(value)})
    values = list(variants)
    few = {*values[:1], *values[-1:], *values[len(values) // 2 :][:1], candidate.start} & variants.keys()
    columns: dict[Place, Columns] = {}
    by_sketch: dict[tuple[Any, ...], Mapping[float, float]] = {}
    for pair in candidate.pairs(study):
        sketch = _columns(study, base, pair, {value: variants[value] for value in few if value in variants})
        marks = {
            place: {n: (n.path, *column.items()) for n, column in of.items()} for place, of in sketch.items()
        }
        if all(mark in by_sketch for of in marks.values() for mark in of.values()) and by_sketch:
            columns |= {place: {n: by_sketch[mark] for n, mark in of.items()} for place, of in marks.items()}
            continue
        own = _columns(study, base, pair, variants)
        columns |= own
        if all(own[place].keys() == of.keys() for place, of in marks.items()):
            by_sketch |= {mark: own[place][n] for place, of in marks.items() for n, mark in of.items()}
    if len(variants) < 3 or candidate.start not in variants:
        return None
    lands = {
        place: tuple(
            Landing(n, values=tuple(column[value] for value in variants)) for n, column in of.items()
        )
        for place, of in columns.items()
    }
    return Key(candidate, lands, tuple(variants))


def _columns(
    study: AnyStudy, base: PackedRuns, pair: Pair, variants: dict[float, AnyStudy]
) -> dict[Place, Columns]:
    """By place of a run: each number that these variants of the study move, with its value in each variant.

    A variant that allows no run, or gives the run another shape, is removed from `variants`.
    """
    tables: dict[float, PackedRuns] = {}
    for value in list(variants):
        with suppress(StudyError, MisfitError):
            changed_blobs = packed(variants[value], [pair], study)
            if _same_shape(base, changed_blobs):
                tables[value] = changed_blobs
                continue
        del variants[value]
    return {
        place: {
            number: {value: number.read(blobs[place].data) for value, blobs in tables.items()}
            for number in _moved(base[place], [blobs[place] for blobs in tables.values()])
        }
        for place in next(iter(tables.values()), {})
    }


def _apart_from_pairs(study: AnyStudy, key: Key, own: OwnMotor) -> bool:
    """Whether a key with stops and the pole pairs set different numbers, tried at the ends of both."""
    candidate = key.candidate
    for pole_pairs in (own.pole_pairs.least, own.pole_pairs.most):
        for stop in (0, -1):
            values = [(candidate, key.stops[stop]), (own.pole_pairs, pole_pairs)]
            changed_blobs = _accepted_values(study, values, candidate.pairs(study)) or {}
            for place, blob in changed_blobs.items():
                data = bytearray(own.turned[round(pole_pairs)][place].data)
                for one in key.lands[place]:
                    one.number.write(data, one.values[stop])
                if data != blob.data:
                    return False
    return not _numbers(key) & own.numbers


def _by_pairs(study: AnyStudy, key: Key, own: OwnMotor) -> Key | None:
    """The key with a table over stops and pole pairs; None if its numbers depend on more than these.

    Pole pairs that the study refuses take the numbers of the nearest pole pairs that it accepts.
    """
    candidate, runs = key.candidate, key.candidate.pairs(study)
    counts = sorted(own.turned)
    tables: dict[tuple[float, int], PackedRuns] = {}
    for stop, n in product(key.stops, counts):
        changed_blobs = _accepted_values(study, [(candidate, stop), (own.pole_pairs, n)], runs)
        if changed_blobs is not None:
            tables[stop, n] = changed_blobs

    def values(number: Number, place: Place, stop: float) -> tuple[float, ...]:
        nearest = (min((m for m in counts if (stop, m) in tables), key=lambda m: abs(m - n)) for n in counts)
        return tuple(number.read(tables[stop, m][place].data) for m in nearest)

    lands = {}
    for place in key.lands:
        moved = {
            number
            for (_, n), changed_blobs in tables.items()
            for number in _moved(own.turned[n][place], [changed_blobs[place]])
        }
        if any(one.number in moved and (one.powers or one.curve) for one in own.products[place]):
            return None
        lands[place] = tuple(
            Landing(number, by_pairs=tuple(values(number, place, stop) for stop in key.stops))
            for number in sorted(moved, key=lambda number: number.offset)
        )
    joint = replace(key, lands=lands)
    return joint if _holds_beside(study, joint, own) else None


def _holds_beside(study: AnyStudy, key: Key, own: OwnMotor) -> bool:
    """Whether a table over stops and pole pairs stays right when the motor's other keys change."""
    candidate = key.candidate
    for n in range(JOINT_TRIES):
        values, stop = own.together(n, 0.3), 7 * n % len(key.stops)
        changes = [(candidate, key.stops[stop]), *((own.keys[name], x) for name, x in values.items())]
        column = round(values[own.pole_pairs.key] - own.pole_pairs.least)
        for place, blob in (_accepted_values(study, changes, candidate.pairs(study)) or {}).items():
            if any(one.by_pairs[stop][column] != one.number.read(blob.data) for one in key.lands[place]):
                return False
    return True


def _same_shape(base: PackedRuns, changed_blobs: PackedRuns) -> bool:
    return all(blob.shape == base[place].shape for place, blob in changed_blobs.items())


def _moved(blob: Packed, others: Sequence[Packed]) -> list[Number]:
    """The numbers that differ in at least one of the others."""
    others = [other for other in others if other.data != blob.data]
    if not others:
        return []
    own = np.frombuffer(blob.data, np.uint8)
    differs = np.any([np.frombuffer(other.data, np.uint8) != own for other in others], axis=0)
    places = np.flatnonzero(differs)
    ends = [n.offset for n in blob.numbers] + [len(own)]
    owners = np.searchsorted(ends, places, side="right") - 1
    return [blob.numbers[n] for n in np.unique(owners)]


def _fitting(
    study: AnyStudy, number: Number, candidate: Candidate, value: float, base: Packed, changed_blob: Packed
) -> Landing | None:
    """How a key sets a number: in proportion to its SI value, or as a time rounded to whole periods.

    It is tested at the study's value and one other. None if neither form fits both.
    """
    si = candidate.si(value)
    ratio = number.read(changed_blob.data) / si if si else 1.0
    tries = [Landing(number, scale) for scale in (1.0, ratio, float(round(ratio)))]
    if number.format not in "df" and study.drive is not None:
        rates = study.drive.rates
        law, current = rates.current_loop / rates.divider, rates.current_loop
        tries += [Landing(number, rate, True) for rate in (law, current)]
    points = ((si, changed_blob), (candidate.si(candidate.start), base))
    return next((one for one in tries if all(landed(one, x) == number.read(b.data) for x, b in points)), None)


def landed(landing: Landing, si: float) -> float:
    """The number that a direct key sets, as a page computes it."""
    value = si * landing.scale
    if landing.rounded:
        return float(round(value))
    return float(np.float32(value)) if landing.number.format == "f" else value


def samples(candidate: Candidate) -> list[float]:
    """Values across the slider, irregularly spaced by the golden section."""
    span = candidate.high - candidate.low
    values = [candidate.low + span * ((n * 0.6180339887498949) % 1.0) for n in range(1, TRIED_VALUES + 1)]
    return [float(round(value)) if candidate.whole else float(f"{value:.7g}") for value in values]


def _wide(candidate: Candidate) -> list[float]:
    """A value that `disproved` does not try, then values outside the slider that only the field takes."""
    below, above = candidate.low - candidate.least, candidate.most - candidate.high
    values = [candidate.low, candidate.least + 0.1 * below, candidate.high + 0.37 * above, candidate.most]
    return [float(f"{value:.7g}") for value in values]


def _grid(candidate: Candidate) -> list[float]:
    """The stops of a slider, rounded, with the study's value among them."""
    values = np.linspace(candidate.low, candidate.high, STOP_COUNT)
    rounded = {float(round(v)) if candidate.whole else float(f"{v:.3g}") for v in values}
    return sorted(rounded | {candidate.start})
