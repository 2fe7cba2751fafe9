"""Changes of a study that its design advises, as values by dotted key, and their words.

A change is advised only if the design, asked again with it, no longer finds what it is to cure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice
from typing import Any

from cogless.errors import StudyError
from cogless.study import changed
from cogless.study.error_messages import toml
from cogless.study.reading import AStudy, Changes

GAINS = ("k_theta", "kp", "ki")
NUMBER = ".3g"  # digits of a value that is advised


def helping(
    study: AStudy, tried: Iterable[Changes | None], cured: Callable[[AStudy], bool]
) -> tuple[Changes, ...]:
    """Those of the changes that the study can have, and with which it is cured."""
    return tuple(each for each in tried if each is not None and helps(study, each, cured))


def first(study: AStudy, tried: Iterable[Changes], cured: Callable[[AStudy], bool]) -> tuple[Changes, ...]:
    """The first of these changes with which the study is cured, as one or none; the mildest come first."""
    return tuple(islice((each for each in tried if helps(study, each, cured)), 1))


def helps(study: AStudy, change: Changes, cured: Callable[[AStudy], bool]) -> bool:
    """Whether the study can be changed so, and is cured then."""
    try:
        return cured(changed(study, change))
    except StudyError:
        return False


def words(change: Changes, within: str = "") -> str:
    """A change as a study writes it, such as `controller.pi.kp = "0.02 A*s/rad"`; keys `within` a table are
    relative to it."""
    return " and ".join(_words(key.removeprefix(f"{within}."), value) for key, value in change.items())


def either(changes: Iterable[Changes], within: str = "") -> str:
    """Several changes, each of which is enough; "" if there is none."""
    return ", or ".join(words(each, within) for each in changes)


def _words(key: str, value: Any) -> str:
    if isinstance(value, dict):  # gains in place of a rule
        gains = [f"{each} = {toml(value[each])}" for each in GAINS if each in value]
        return f"{' and '.join(gains)} in place of tuning"
    if value is None:
        return f"no {key}"
    return f"{key} = {toml(value)}"


def text(value: float, unit: str) -> str:
    """A number in SI as a study writes it."""
    return f"{value:{NUMBER}} {unit}"
