"""Draw the variants of an ensemble from a study's `[vary]`: an axis for each key that varies.

The values come from Sobol's sequence over the axes. They are equal on every machine.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cogless import units
from cogless.errors import StudyError
from cogless.interrupts import deferred
from cogless.results.trace import Array
from cogless.study import AnyStudy, changed
from cogless.study.messages import MISSING, dotted, look_up, toml_text
from cogless.study.reading import split
from cogless.study.table import Key

PERCENT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*%\s*")
CUT_DEVIATIONS = 3.0  # standard deviations from the mean, where a normal distribution is cut
VALUE_DIGITS = 6  # digits of a value; few, so that a command that repeats a variant is legible


@dataclass(frozen=True)
class Axis:
    """A key that varies. `spread`: turns the share of variants below a value, 0 to 1, into that value."""

    key: str
    unit: str  # unit of the text in the study; "" for a plain number
    spread: Callable[[Array], Array] | None
    choices: tuple[Any, ...] = ()  # the values of a list, if there is no spread
    whole: bool = False  # takes whole numbers only

    def values(self, share: Array) -> list[Any]:
        """The values at these shares, as they stand in a study's file."""
        if self.spread is None:
            last = len(self.choices) - 1
            return [self.choices[min(int(s * len(self.choices)), last)] for s in share]
        if self.whole:
            return [round(x) for x in self.spread(share)]
        numbers = (float(f"{x:.{VALUE_DIGITS}g}") for x in self.spread(share))
        return [f"{x!r} {self.unit}" if self.unit else x for x in numbers]

    def si(self, value: Any) -> Any:
        """A value of a study's file in SI; a text without a number stays what it is."""
        if isinstance(value, str):
            unit = units.unit_of(value)
            return units.number_in(value, unit) * units.si_factor(unit) if unit else value
        return value

    @property
    def factor(self) -> float:
        """Factor from the axis' own unit to SI."""
        return units.si_factor(self.unit) if self.unit else 1.0


def axes(study: AnyStudy) -> list[Axis]:
    """The axes of a study's ensemble; StudyError names a key or a value that the study refuses."""
    if study.vary is None:
        raise StudyError(f"{study.source.path}: vary: missing: expected a table of keys that vary")
    all_axes = []
    for key, distribution in study.vary.keys.items():
        form, parameters = distribution.form
        axis = _axis(Reader(study, key, ("vary", key, form), parameters), form)
        for value in axis.choices or axis.values(np.array([0.5])):
            tried(study, "vary", {key: value})
        all_axes.append(axis)
    return all_axes


def tried(study: AnyStudy, table: str, changes: dict[str, Any]) -> None:
    """Raises StudyError, about a key of `table`, if the study refuses these changes."""
    try:
        changed(study, changes)
    except StudyError as error:
        path = str(study.source.path)
        lines = (line.removeprefix(f"{path}: ") for line in error.mistakes)
        raise StudyError("\n".join(f"{path}: {table}: {line}" for line in lines)) from None


def _axis(reader: Reader, form: str) -> Axis:
    if form == "list":
        return Axis(reader.key, reader.unit, None, tuple(reader.given))
    if form == "normal":
        return Axis(reader.key, reader.unit, _normal(*reader.mean_and_deviation()), whole=reader.whole)
    low, high = reader.range(ratio=form == "log")
    if form == "log" and not low > 0:
        raise reader.wrong("expected limits above zero")
    spread = {"uniform": _uniform, "log": _log, "corners": _corners}[form](low, high)
    if reader.whole and form in ("uniform", "log"):  # makes an end as likely as any other number
        spread = _whole_numbers(low, high, {"uniform": _uniform, "log": _log}[form](low - 0.5, high + 0.5))
    return Axis(reader.key, reader.unit, spread, whole=reader.whole)


class Reader:
    """Reads the numbers of a key's range or distribution, in the unit of the key's value in the study.

    `where`: the key at which these numbers stand, for messages.
    """

    def __init__(self, study: AnyStudy, key: str, where: Key, spread: Any) -> None:
        self.study, self.key, self.where, self.given = study, key, where, spread
        self.nominal = self._nominal()
        self.unit = self._unit()

    def range(self, ratio: bool = False) -> tuple[float, float]:
        """Two limits: as given, or the study's value with a deviation to both sides (`ratio`: a factor)."""
        if isinstance(self.given, tuple):
            low, high = (self._number(value) for value in self.given)
        else:
            middle, by = self.middle(), self._above_zero(self._number(self.given, around=0.0))
            factor = 1 + by / abs(middle) if middle else math.inf
            low, high = (middle / factor, middle * factor) if ratio else (middle - by, middle + by)
        if self.whole:
            low, high = float(math.ceil(low)), float(math.floor(high))
            if not low < high:
                raise self.wrong("expected a range that contains two or more whole numbers")
        if not low < high:
            raise self.wrong("expected a range whose second limit is above its first")
        return low, high

    @cached_property
    def whole(self) -> bool:
        """Whether the key takes whole numbers only, that is, the study refuses its own value as a float."""
        if not isinstance(self.nominal, int) or isinstance(self.nominal, bool):
            return False
        try:
            changed(self.study, {self.key: float(self.nominal)})
        except StudyError:
            return True
        return False

    def mean_and_deviation(self) -> tuple[float, float]:
        """Mean and deviation; the mean is the study's value unless it is given."""
        if isinstance(self.given, tuple):
            mean, deviation = (self._number(value) for value in self.given)
        else:
            mean, deviation = self.middle(), self._number(self.given, around=0.0)
        return mean, self._above_zero(deviation)

    def _nominal(self) -> Any:
        try:
            nominal = look_up(self.study.source.tables, split(self.key))
        except StudyError as error:
            raise StudyError(f"{self.study.source.path}: {self.where[0]}: {error}") from None
        motor = getattr(self.study, "motor", None)
        if self.key == "motor.K_t" and nominal is MISSING and motor is not None:
            return f"{motor.star().K_t!r} N*m/A"  # the study gives the magnet's flux by another key
        return nominal

    def _unit(self) -> str:
        """The unit of the study's own value, or else the first unit among the given numbers; "" if none."""
        parameters = self.given if isinstance(self.given, tuple) else (self.given,)
        texts = [text for text in (self.nominal, *parameters) if isinstance(text, str)]
        return next((u for u in map(units.unit_of, texts) if u and u != "%"), "")

    def middle(self) -> float:
        """The study's own value, in the axis' unit."""
        if self.nominal is MISSING:
            raise self.wrong("expected two limits, since the study has no value at this key")
        if isinstance(self.nominal, bool) or not isinstance(self.nominal, str | int | float):
            raise self.wrong("expected the key of a number, or a list of values")
        if self.unit and not isinstance(self.nominal, str):
            # a plain number in a controller's table is SI; the rule auto gives such numbers, too
            number = self.nominal / units.si_factor(self.unit)
            tried(self.study, str(self.where[0]), {self.key: f"{number!r} {self.unit}"})
            return number
        return self._plain(self.nominal)

    def _number(self, value: Any, around: float | None = None) -> float:
        """A given number; a percentage is a share of the study's value, added to this value or `around`."""
        percent = PERCENT.fullmatch(value) if isinstance(value, str) else None
        if percent is None:
            return self._plain(value)
        middle = self.middle()
        return (middle if around is None else around) + abs(middle) * float(percent[1]) / 100

    def _plain(self, value: Any) -> float:
        if isinstance(value, str):
            try:
                return units.number_in(value, self.unit)
            except units.UnitError as error:
                raise self.wrong(str(error), value) from None
        if self.unit:
            raise self.wrong(f'expected a text with a unit, such as "{value} {self.unit}", or with %', value)
        return float(value)

    def _above_zero(self, by: float) -> float:
        if not by > 0:
            raise self.wrong("expected a deviation above zero")
        return by

    def wrong(self, expected: str, value: Any = None) -> StudyError:
        faulty = self.given if value is None else value
        text = toml_text(list(faulty) if isinstance(faulty, tuple) else faulty)
        return StudyError(f"{self.study.source.path}: {'.'.join(map(str, self.where))}: {text}: {expected}")


def _uniform(low: float, high: float) -> Callable[[Array], Array]:
    return lambda share: low + (high - low) * share


def _whole_numbers(low: float, high: float, spread: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda share: np.clip(np.floor(spread(share) + 0.5), low, high)


def _log(low: float, high: float) -> Callable[[Array], Array]:
    return lambda share: low * (high / low) ** share


def _normal(mean: float, deviation: float) -> Callable[[Array], Array]:
    from scipy.special import ndtr, ndtri  # a worker starts sooner without it

    edge = float(ndtr(-CUT_DEVIATIONS))
    return lambda share: mean + deviation * ndtri(edge + (1 - 2 * edge) * share)


def _corners(low: float, high: float) -> Callable[[Array], Array]:
    return lambda share: np.where(share < 0.5, low, high)


def together(shares: Array, axes: Sequence[Axis], study: AnyStudy) -> Array:
    """The shares [variant, axis] with the correlations of `[vary]`, by a Gaussian copula.

    Each column stays evenly spread; only the combinations of its values with other columns change.
    """
    from scipy.special import ndtr, ndtri  # a worker starts sooner without it

    correlated = shares.copy()
    assert study.vary is not None
    places = {axis.key: place for place, axis in enumerate(axes)}
    for group in study.vary.together:
        columns = [places[key] for key in group.keys]
        matrix = np.full((len(columns), len(columns)), group.correlation)
        np.fill_diagonal(matrix, 1.0)
        # the symmetric square root also exists for a correlation of one
        strength, direction = np.linalg.eigh(matrix)
        root = direction * np.sqrt(np.maximum(strength, 0.0)) @ direction.T
        inside = np.clip(shares[:, columns], 2.0**-40, 1 - 2.0**-40)
        correlated[:, columns] = ndtr(ndtri(inside) @ root)
    return correlated


SEED = "seed"  # a study's key: the seed of the sensors' noise
FRESH_SEED_OFFSET = 1 << 32  # between the seeds of an ensemble and of a fresh one


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The variants of a study. `drawn`: by varied key a value for each variant, in the file's notation.

    `places`: by varied key of the plant and by scenario, the override that sets this key in the scenario.
    Only overrides vary, so the controllers are designed for the study and don't know their variant.
    """

    axes: tuple[Axis, ...]
    drawn: Mapping[str, list[Any]]
    count: int
    places: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def changes(self, variant: int, scenario: str | None = None) -> dict[str, Any]:
        """The changes of the study that make a variant, by dotted key: for one scenario, or for all."""
        changes = {}
        for key, values in self.drawn.items():
            places = self.places.get(key)
            if places is None:
                changes[key] = values[variant]
            else:
                overrides = (
                    places.values() if scenario is None else [places[scenario]] if scenario in places else []
                )
                changes |= dict.fromkeys(overrides, values[variant])
        return changes

    @cached_property
    def si(self) -> dict[str, list[Any]]:
        """The values of each varied key in SI; values that are no quantities are unchanged."""
        of_axes = {axis.key: list(map(axis.si, self.drawn[axis.key])) for axis in self.axes}
        return {**self.drawn, **of_axes}


def seeds(study: AnyStudy, count: int, fresh: int = 0) -> list[int]:
    """A seed of the sensors' noise for each variant."""
    first = study.seed + 1 + fresh * FRESH_SEED_OFFSET
    return [(first + variant) % 2**64 for variant in range(count)]


def draw(study: AnyStudy, count: int, fresh: int = 0) -> Ensemble:
    """Draw `count` variants; a longer ensemble begins with these, too. StudyError: a mistake in [vary].

    `fresh`: another number gives other variants.
    """
    from scipy.stats import qmc

    all_axes = axes(study)
    assert study.vary is not None
    drawn: dict[str, list[Any]] = {}
    if all_axes:
        generator = np.random.default_rng([study.seed, fresh])
        with deferred() as requests:  # SciPy's compiled code drops the exception, and draws equal variants
            sequence = qmc.Sobol(len(all_axes), scramble=True, rng=generator)
            shares = sequence.random_base2(max(0, count - 1).bit_length())[:count]
        if requests.count:
            raise KeyboardInterrupt
        columns = together(shares, all_axes, study).T
        drawn = {axis.key: axis.values(column) for axis, column in zip(all_axes, columns, strict=True)}
    if study.vary.seeds:
        drawn[SEED] = seeds(study, count, fresh)
    return Ensemble(tuple(all_axes), drawn, count, _places(study, drawn))


def _places(study: AnyStudy, keys: Iterable[str]) -> dict[str, dict[str, str]]:
    """By key of the plant and scenario, the override that sets the key; none if the scenario has its own."""
    of_plant = tuple(f"{table}." for table in study.overridable)
    return {
        key: {
            name: dotted(("scenario", name, "override", key))
            for name, scenario in study.scenario.items()
            if key not in (scenario.override or {})
        }
        for key in keys
        if key.startswith(of_plant)
    }
