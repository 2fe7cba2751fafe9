"""Sentences of `cogless identify` that advise, each with its changes as data."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import Any

from cogless.errors import StudyError
from cogless.study.datasheet import replaced_by

Cure = Mapping[str, Any]
RECORD = "record"  # begins the keys of what a log should have: record.kind, record.signal, record.rate (Hz)


class Advice(str):
    """A sentence and the changes that it advises; each change helps without the others.

    A change maps dotted keys to values. A key names a value in the file of columns, such as motor.K_t, or a
    property of a log to record, such as record.kind. The tests apply each change and identify again.
    """

    cures: tuple[Cure, ...]

    def __new__(cls, text: str, *cures: Cure) -> Advice:
        advice = super().__new__(cls, text)
        advice.cures = cures
        return advice


class AdvisedError(StudyError):
    """A mistake of the user, with several sentences as its message. Some sentences advise."""

    def __init__(self, *lines: str) -> None:
        super().__init__("\n".join(lines))
        self._mistakes = lines

    @property
    def mistakes(self) -> tuple[str, ...]:
        """The sentences. A sentence that advises is an `Advice`, which has its changes."""
        return self._mistakes


def recording(**values: Any) -> Cure:
    """The change that asks for a log with these properties."""
    return {f"{RECORD}.{key}": value for key, value in values.items()}


def logs_of_kind(*kinds: str) -> Cure:
    """The change that asks for logs of these kinds."""
    return recording(kind=kinds)


def advice_of(lines: Iterable[str]) -> list[Advice]:
    """The lines that advise something."""
    return [line for line in lines if isinstance(line, Advice)]


def changed(tables: Mapping[str, Any], cure: Cure) -> dict[str, Any]:
    """The tables of a file of columns after a change. Datasheet keys that give the changed value are removed.

    ValueError: the change is to a log, not to the file of columns.
    """
    new_tables = copy.deepcopy(dict(tables))
    for key, value in cure.items():
        room, *path, last = key.split(".")
        if room == RECORD:
            raise ValueError(f"{key}: a log, not the file of columns")
        table = new_tables.setdefault(room, {})
        for name in path:
            if isinstance(table.get(name), str):  # the heading of a column
                table[name] = {"name": table[name]}
            table = table.setdefault(name, {})
        table[last] = value
        for word in replaced_by(last) if room == "motor" else ():
            table.pop(word, None)
    return new_tables
