"""A sentence that advises, with each change that it advises as data."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import Any

from cogless.errors import StudyError
from cogless.study.datasheet_words import replaced_by

Cure = Mapping[str, Any]
RECORD = "record"  # begins the keys of what a log should have: record.kind, record.signal, record.rate (Hz)


class Advice(str):
    """A sentence, and the changes that it advises; each of them helps without the others.

    A change has values by dotted key: of the file of columns, such as motor.K_t, or of a log to record, such
    as record.kind. Whoever doubts the sentence applies one and identifies again, as the tests do.
    """

    cures: tuple[Cure, ...]

    def __new__(cls, text: str, *cures: Cure) -> Advice:
        made = super().__new__(cls, text)
        made.cures = cures
        return made


class AdvisedError(StudyError):
    """A mistake, as sentences of which some advise."""

    def __init__(self, *lines: str) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


def recording(**values: Any) -> Cure:
    """A change that records a log, or records it with something more."""
    return {f"{RECORD}.{key}": value for key, value in values.items()}


def logs_of_kind(*kinds: str) -> Cure:
    """A change that adds logs of these kinds."""
    return recording(kind=kinds)


def advice_of(lines: Iterable[str]) -> list[Advice]:
    """Those lines that advise."""
    return [line for line in lines if isinstance(line, Advice)]


def changed(tables: Mapping[str, Any], cure: Cure) -> dict[str, Any]:
    """The tables of a file of columns with a change; a word of the datasheet that says the same goes.

    ValueError: the change is of a log.
    """
    made = copy.deepcopy(dict(tables))
    for key, value in cure.items():
        room, *path, last = key.split(".")
        if room == RECORD:
            raise ValueError(f"{key}: a log, not the file of columns")
        table = made.setdefault(room, {})
        for name in path:
            if isinstance(table.get(name), str):  # the heading of a column
                table[name] = {"name": table[name]}
            table = table.setdefault(name, {})
        table[last] = value
        for word in replaced_by(last) if room == "motor" else ():
            table.pop(word, None)
    return made
