"""The files that a study names: a key is a file's if the type of its model says so, whatever its text is."""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin

from cogless.files import shipped
from cogless.study.base import StudyBase
from cogless.study.reading import split
from cogless.study.table import FileName, Key, StudyKeys, Table


@dataclass(frozen=True)
class NamedFile:
    """A file that a study names. `key`: in the tables as they are in the file, where a key may have dots.

    `path`: as it is there, relative to the study; `rest`: what follows, such as ":Class".
    """

    key: Key
    path: str
    rest: str = ""


def named_files(model: type[StudyBase], tables: Mapping[str, Any]) -> list[NamedFile]:
    """The files that the tables of a study name, without those that come with cogless.

    In a scenario's override and in [vary] the keys are the study's.
    """
    return list(dict.fromkeys(_files(model, tables, (), model)))


def _files(of: Any, value: Any, key: Key, model: type[StudyBase]) -> Iterator[NamedFile]:
    """The files that a value of a type names."""
    if isinstance(value, str):
        for mark in _marks(of):
            if isinstance(mark, FileName) and not (mark.room and value in shipped(mark.room)):
                path, colon, rest = value.rpartition(":") if mark.with_name else (value, "", "")
                yield NamedFile(key, path, colon + rest)
    elif isinstance(value, list):
        for place, item in enumerate(value):
            for inner in _types_within(of, place, model):
                yield from _files(inner, item, (*key, place), model)
    elif isinstance(value, dict):
        choices = value.get("list")
        if isinstance(choices, list):  # a spread of the table vary
            for place, item in enumerate(choices):
                yield from _files(of, item, (*key, "list", place), model)
        for name, item in value.items():
            for inner in _types_at(of, name, model):
                yield from _files(inner, item, (*key, name), model)


def _types_at(of: Any, name: str, model: type[StudyBase]) -> list[Any]:
    """The types that a name within a type may have; in a table of dotted keys it has several parts."""
    inner = list(_types_within(of, name, model))
    if inner or "." not in name:
        return inner
    inner = [of]
    for part in split(name):
        if isinstance(part, str):
            inner = [type_ for outer in inner for type_ in _types_at(outer, part, model)]
        else:
            inner = [type_ for outer in inner for type_ in _types_within(outer, part, model)]
    return inner


def _types_within(of: Any, part: str | int, model: type[StudyBase]) -> Iterator[Any]:
    """The types that a key or an index within a type may have."""
    origin, inner = get_origin(of), get_args(of)
    if any(isinstance(mark, StudyKeys) for mark in _marks(of)):
        yield from _types_within(model, part, model)
    elif origin is Annotated:
        yield from _types_within(inner[0], part, model)
    elif origin in (Union, types.UnionType):
        for one in inner:
            yield from _types_within(one, part, model)
    elif origin is tuple:
        yield inner[0]
    elif isinstance(origin, type) and issubclass(origin, Mapping):
        yield inner[1]
    elif isinstance(of, type) and issubclass(of, Table) and part in of.model_fields:
        field = of.model_fields[str(part)]
        yield Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation


def _marks(of: Any) -> Iterator[Any]:
    """What annotates a type, or one of those that it may be."""
    origin, inner = get_origin(of), get_args(of)
    if origin is Annotated:
        yield from inner[1:]
        yield from _marks(inner[0])
    elif origin in (Union, types.UnionType):
        for one in inner:
            yield from _marks(one)
