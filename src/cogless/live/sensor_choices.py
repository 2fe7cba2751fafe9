"""Other position sensors and speed methods that a page can choose: for each the runs' descriptions.

A sensor of another kind changes the shape of a description, which no key can. So a page holds all runs'
descriptions with each sensor. A direct key works there too, if a test at some values of all keys confirms it;
a key with stops keeps the study's value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cogless.c_layout import MisfitError
from cogless.errors import StudyError
from cogless.live.candidates import Candidate
from cogless.live.description import Packed, Place, page_runs
from cogless.live.keys import AdjustableKeys, Key, Landing, disproved, packed, samples
from cogless.study import Study
from cogless.study.reading import changed
from cogless.study.toml import toml

SENSOR = "drive.position_sensor"
METHODS = {"encoder": ("M", "MT"), "absolute": ("M", "average"), "resolver": ("M", "average")}
METHOD_WORDS = {
    "M": "speed by counts in a period",
    "average": "speed by counts over a window",
    "MT": "speed by counts and their time",
    "observer": "speed by an observer",
}
OTHER_SENSORS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("a perfect sensor", {"kind": "ideal"}),
    ("absolute, 12 bits", {"kind": "absolute", "bits": 12}),
    ("absolute, 14 bits", {"kind": "absolute", "bits": 14}),
    ("incremental, 1024 lines", {"kind": "encoder", "lines": 1024, "speed_method": "MT"}),
)
OBSERVER_SHARE = 40  # ratio of the speed loop's rate to the observer's bandwidth
SENSOR_VALUES = 2  # values of each key with another sensor; the first is not tried


@dataclass(frozen=True)
class SensorChoice:
    """A sensor: its words, its TOML, the runs' descriptions, and by key the numbers that it sets there."""

    words: str
    text: str
    runs: Mapping[Place, Packed]
    lands: Mapping[str, Mapping[Place, tuple[Landing, ...]]]


def sensor_choices(study: Study, page_keys: AdjustableKeys, spares: Sequence[Key]) -> list[SensorChoice]:
    """The sensors that the study accepts in place of its own; none if no keys were looked for."""
    if not page_keys.base:
        return []
    choices = []
    for words, table in _tables(study):
        try:
            other = changed(study, {SENSOR: table})
            base = packed(other, page_runs(study), study)
        except (StudyError, MisfitError):
            continue
        keys = [
            moved for key in page_keys.keys if not key.stops and (moved := _moved(key, page_keys.base, base))
        ]
        wrong = disproved(other, base, keys, _few, None, alone=True)
        right = [key for key in keys if key not in wrong]
        right += [moved for key in spares if (moved := _moved(key, page_keys.base, base))]
        lands = {key.candidate.key: key.lands for key in right}
        choices.append(SensorChoice(words, toml(table), base, lands))
    return choices


def _few(candidate: Candidate) -> list[float]:
    return samples(candidate)[:SENSOR_VALUES]


def _tables(study: Study) -> Iterator[tuple[str, dict[str, Any]]]:
    """Sensors as tables of the study, with their words: the study's own by other methods, then others."""
    own: dict[str, Any] = dict(study.source.tables["drive"].get("position_sensor", {}))
    sensor = study.drive.position_sensor
    current = getattr(sensor, "speed_method", "")
    plain = {k: v for k, v in own.items() if k not in ("speed_method", "window", "observer_bandwidth")}
    for method in METHODS.get(sensor.kind, ()):
        if method != current:
            yield f"the study's, {METHOD_WORDS[method]}", plain | {"speed_method": method}
    if sensor.kind in METHODS and current != "observer":
        rates = study.drive.rates
        bandwidth = f"{rates.current_loop / rates.divider / OBSERVER_SHARE:.3g} Hz"
        table = plain | {"speed_method": "observer", "observer_bandwidth": bandwidth}
        yield f"the study's, {METHOD_WORDS['observer']} of {bandwidth}", table
    yield from ((words, table) for words, table in OTHER_SENSORS if table != own)


def _moved(key: Key, base: Mapping[Place, Packed], other: Mapping[Place, Packed]) -> Key | None:
    """The key with each number that it sets looked up by its path in `other`.

    None: a number is missing there or has another format, or the key sets none.
    """
    lands = {}
    for place, landings in key.lands.items():
        numbers = {number.path: number for number in other[place].numbers}
        if any(one.number.path not in numbers for one in landings):
            return None
        if any(numbers[one.number.path].format != one.number.format for one in landings):
            return None
        lands[place] = tuple(replace(one, number=numbers[one.number.path]) for one in landings)
    return replace(key, lands=lands) if any(lands.values()) else None
