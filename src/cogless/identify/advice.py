"""A sentence that advises, with each change that it advises as data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Cure = Mapping[str, Any]
RECORD = "record"  # begins the keys of what a log should have: record.kind, record.signal, record.rate (Hz)


class Advice(str):
    """A sentence, and the changes that it advises; each of them helps without the others.

    A change has values by dotted key: of the file of columns, such as motor.K_t, or of a log to record, such as
    record.kind. Whoever doubts the sentence applies one and identifies again, as the tests do.
    """

    cures: tuple[Cure, ...]

    def __new__(cls, text: str, *cures: Cure) -> Advice:
        made = super().__new__(cls, text)
        made.cures = cures
        return made


def recording(**values: Any) -> Cure:
    """A change that records a log, or records it with something more."""
    return {f"{RECORD}.{key}": value for key, value in values.items()}


def logs_of_kind(*kinds: str) -> Cure:
    """A change that adds logs of these kinds."""
    return recording(kind=kinds)
