"""Validate a variant of a study by what changed in it; the rest is taken over."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, create_model

from cogless.study.base import StudyBase
from cogless.study.error_messages import MISSING
from cogless.study.table import Key, Table

Check = Callable[[Any], None]
AStudy = TypeVar("AStudy", bound=StudyBase)
THERE = ""  # below a key: whether the table is there, or which tables are, whatever they have
TYPES = ("kind", "law")  # keys that decide which type a table is of


def reused(new: Any, old: Any, made: Any) -> Any:
    """Tables as read, with what is alike in `old` replaced by the models `made` from it, at any depth."""
    if isinstance(made, Table):
        if alike(new, old):
            return made
        if isinstance(new, dict) and isinstance(old, dict):
            return {
                key: reused(value, old.get(key, MISSING), getattr(made, key, None))
                for key, value in new.items()
            }
    elif isinstance(made, Mapping) and isinstance(new, dict) and isinstance(old, dict):
        return {key: reused(value, old.get(key, MISSING), made.get(key)) for key, value in new.items()}
    elif isinstance(made, tuple) and made and isinstance(made[0], Table) and alike(new, old):
        return made
    elif isinstance(made, tuple) and isinstance(new, list) and isinstance(old, list):
        same = len(new) == len(old) == len(made)
        return [reused(*parts) for parts in zip(new, old, made, strict=True)] if same else new
    return new


def alike(new: Any, old: Any) -> bool:
    """Whether two values of a file are the same; 1, 1.0 and true are not."""
    if new is old:
        return True
    if type(new) is not type(old):
        return False
    if isinstance(new, dict):
        if list(new) != list(old):
            return False
        return all([value is old[key] or alike(value, old[key]) for key, value in new.items()])
    if isinstance(new, list):
        return len(new) == len(old) and all(map(alike, new, old))
    return bool(new == old)


def derived(like: AStudy, tables: dict[str, Any], checks: tuple[Check, ...], folder: Path) -> AStudy:
    """A copy of a study with these tables in place of its own.

    ValueError: they are wrong; validate the whole for what to say about it.
    """
    before = like.source.tables
    differ = [key for key, table in tables.items() if not alike(table, before.get(key, MISSING))]
    if not before.keys() <= tables.keys():
        raise ValueError("a table is gone")
    parts = {key: _new(tables[key], before.get(key, MISSING), getattr(like, key, None)) for key in differ}
    model = _part(type(like), tuple(sorted(differ)))
    made = model.model_validate(parts, context={"folder": folder})
    found = {key: _whole(getattr(made, key), tables[key], getattr(like, key)) for key in differ}
    study = like.model_copy(update=found)
    study._made = {}
    keys = tuple(_differences(tables, before, like, ()))
    for check in like.once(_needed, (checks, keys)):
        check(study)
    return study


def _new(new: Any, old: Any, made: Any) -> Any:
    """A table with its unchanged parts reused; of all scenarios or controllers only the changed ones."""
    if isinstance(made, Mapping) and isinstance(new, dict) and isinstance(old, dict):
        differ = [name for name in new if not alike(new[name], old.get(name, MISSING))]
        return {name: reused(new[name], old.get(name, MISSING), made.get(name)) for name in differ}
    return reused(new, old, made)


def _whole(validated: Any, new: Any, made: Any) -> Any:
    """The counterpart of `_new`: all scenarios or controllers, in the order of the file."""
    if isinstance(made, Mapping) and isinstance(new, dict):
        return {name: validated[name] if name in validated else made[name] for name in new}
    return validated


@cache
def _part(model: type[StudyBase], keys: tuple[str, ...]) -> type[Table]:
    """A model of some of a study's tables; ValueError: it has no such table."""
    if not set(keys) <= model.model_fields.keys():
        raise ValueError("an unknown table")
    fields: dict[str, Any] = {
        key: (model.model_fields[key].annotation, model.model_fields[key]) for key in keys
    }
    return create_model("Part", __base__=Table, **fields)


def _needed(study: StudyBase, of: tuple[tuple[Check, ...], tuple[Key, ...]]) -> list[Check]:
    """The checks that may find something else once these keys have changed."""
    checks, keys = of
    reads = study.once(_reads, checks)
    return [c for c in checks if any(_touches(read, key) for read in reads[c] for key in keys)]


def _reads(study: StudyBase, checks: tuple[Check, ...]) -> dict[Check, set[Key]]:
    """The keys that each check looked at; with others changed, it does and finds the same again."""
    found = {}
    for check in checks:
        read: set[Key] = set()
        check(_Watched(study, (), read))
        found[check] = read
    return found


class _Watched:
    """A table that notes which of its keys are read, in the tables within it, too."""

    def __init__(self, table: Table, key: Key, read: set[Key]) -> None:
        self.table, self.key, self.read = table, key, read

    @property  # type: ignore[misc]
    def __class__(self) -> type:  # for isinstance
        self._read_type()
        return type(self.table)

    def __getattr__(self, name: str) -> Any:
        kind = type(self.table)
        if name in kind.model_fields:
            return self._watched(getattr(self.table, name), (*self.key, name))
        found = getattr(kind, name, None)
        self._read_type()
        if isinstance(found, property) and found.fget is not None:
            return found.fget(self)
        if isinstance(found, cached_property):
            return found.func(self)
        if callable(found) and not hasattr(BaseModel, name):
            return partial(found, self)
        self.read.add(self.key)  # in a way that can't be watched
        return getattr(self.table, name)

    def _read_type(self) -> None:
        self.read |= {(*self.key, name) for name in TYPES} if self.key else set()

    def _watched(self, value: Any, key: Key) -> Any:
        within = isinstance(value, Mapping) and any(isinstance(inner, Table) for inner in value.values())
        self.read.add((*key, THERE) if within or isinstance(value, Table) else key)
        if within:
            return {name: self._watched(inner, (*key, name)) for name, inner in value.items()}
        return _Watched(value, key, self.read) if isinstance(value, Table) else value


def _differences(new: dict[str, Any], old: dict[str, Any], made: Any, key: Key) -> Iterator[Key]:
    """Keys of a table, or of tables by name, whose values differ, as deep as there are tables."""
    for name in old.keys() | new.keys():
        value, before = new.get(name, MISSING), old.get(name, MISSING)
        if value is before or alike(value, before):
            continue
        inner = made.get(name) if isinstance(made, Mapping) else getattr(made, name, None)
        same = isinstance(inner, Table) or (isinstance(inner, Mapping) and _names(value) == _names(before))
        if same and isinstance(value, dict) and isinstance(before, dict):
            yield from _differences(value, before, inner, (*key, name))
        else:
            yield (*key, name)


def _names(table: Any) -> list[str] | None:
    return list(table) if isinstance(table, dict) else None


def _touches(read: Key, changed: Key) -> bool:
    return all(a == b for a, b in zip(read, changed, strict=False))
