"""The files that a study names. The type of a key in its model says whether the text is a file's name."""

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
    """A file that a study names. `key`: place in the tables as read; a part of the key may have dots.

    `path`: as written in the study, relative to it. `rest`: text behind the path, such as ":Class".
    """

    key: Key
    path: str
    rest: str = ""


def named_files(model: type[StudyBase], tables: Mapping[str, Any]) -> list[NamedFile]:
    """The files that the tables of a study name, without files that come with cogless.

    The keys in a scenario's override and in [vary] are dotted keys of the study.
    """
    return list(dict.fromkeys(_files(model, tables, (), model)))


def _files(of: Any, value: Any, key: Key, model: type[StudyBase]) -> Iterator[NamedFile]:
    """The files that `value`, of the type `of`, names."""
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
        if isinstance(choices, list):  # a distribution `list` in [vary]
            for place, item in enumerate(choices):
                yield from _files(of, item, (*key, "list", place), model)
        for name, item in value.items():
            for inner in _types_at(of, name, model):
                yield from _files(inner, item, (*key, name), model)


def _types_at(of: Any, name: str, model: type[StudyBase]) -> list[Any]:
    """The types that the value at a key `name` of type `of` may have. The key may be dotted."""
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
    """The types that the value at a key or index `part` of type `of` may have."""
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
    """The annotations of a type; for a union, the annotations of each of its types."""
    origin, inner = get_origin(of), get_args(of)
    if origin is Annotated:
        yield from inner[1:]
        yield from _marks(inner[0])
    elif origin in (Union, types.UnionType):
        for one in inner:
            yield from _marks(one)
