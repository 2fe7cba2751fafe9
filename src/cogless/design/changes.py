"""Changes that the design advises for a study: values by dotted key, and their words.

A change is advised only if it works: the design is computed again with it, and the fault is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from itertools import islice
from typing import Any

from cogless.catalogue import sensor_words
from cogless.errors import StudyError
from cogless.study import changed
from cogless.study.reading import AStudy, Changes
from cogless.study.toml import toml

SENSOR = "drive.position_sensor"
SENSOR_BITS = f"{SENSOR}.bits"
GAINS = ("k_theta", "kp", "ki")
SPEED_RESERVE = 1.2  # speed that is advised, or at which a change must work / the least speed that would do
ADVISED_FORMAT = ".3g"  # digits of a value that is advised


def helping(
    study: AStudy, tried: Iterable[Changes | None], cured: Callable[[AStudy], bool]
) -> tuple[Changes, ...]:
    """The changes that the study accepts and that cure it, out of those tried."""
    return tuple(change for change in tried if change is not None and helps(study, change, cured))


def first(study: AStudy, tried: Iterable[Changes], cured: Callable[[AStudy], bool]) -> tuple[Changes, ...]:
    """The first change that cures the study, as a tuple of one or none; the mildest must come first."""
    return tuple(islice((change for change in tried if helps(study, change, cured)), 1))


def helps(study: AStudy, change: Changes, cured: Callable[[AStudy], bool]) -> bool:
    """Whether the study accepts this change, and the change cures it."""
    try:
        return cured(changed(study, change))
    except StudyError:
        return False


def change_words(change: Changes, within: str = "") -> str:
    """A change in the study's notation, such as `controller.pi.kp = "0.02 A*s/rad"`.

    Keys of the table `within` are written relative to it.
    """
    return " and ".join(_value_words(key.removeprefix(f"{within}."), value) for key, value in change.items())


def either(changes: Iterable[Changes], within: str = "") -> str:
    """The words of several changes, each of which is enough; "" without changes."""
    return ", or ".join(change_words(change, within) for change in changes)


def cure_words(changes: Collection[Changes], within: str = "") -> str:
    """The end of a sentence on a fault: the changes, each of which ends the fault; "" without changes."""
    return f"; {either(changes, within)} would be enough by calculation" if changes else ""


def _value_words(key: str, value: Any) -> str:
    gains = (
        [f"{gain} = {toml(value[gain])}" for gain in GAINS if gain in value]
        if isinstance(value, dict)
        else []
    )
    if gains:
        return f"{' and '.join(gains)} in place of tuning"
    if value is None:
        return f"no {key}"
    return f"{key} = {toml(value)}{_part_words(key, value)}"


def _part_words(key: str, value: Any) -> str:
    """The note that a value needs another position sensor, and which sensors have it; "" for a setting."""
    if key == SENSOR_BITS:
        return f" (another sensor: {sensor_words(value)})"
    is_other = key == SENSOR and "speed_method" not in value  # a setting keeps the sensor's other keys
    return " (another sensor)" if is_other or key in (f"{SENSOR}.lines", f"{SENSOR}.positions") else ""


def unit_text(value: float, unit: str) -> str:
    """A number in an SI unit, in the study's notation."""
    return f"{float(f'{value:{ADVISED_FORMAT}}'):g} {unit}"
