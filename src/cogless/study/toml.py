"""Values and keys as written in TOML, and a study's tables as lines that a page can change one by one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from cogless.study.base import Source

BARE = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-")
TABLES_BY_NAME = ("scenario", "controller")  # tables of tables by name


def sections(source: Source) -> list[dict[str, Any]]:
    """The study's sections in order, each with the `path` and the text of its `heading`, and its `lines`.

    A line is a dotted key below the heading, and the key's value in pieces. A piece is a text. For a number
    or text within an array, a piece is a pair: dotted key below the heading, and text.
    """
    top: dict[str, Any] = {}
    below: list[tuple[tuple[str, ...], dict[str, Any]]] = []
    for key, value in source.tables.items():
        if not isinstance(value, dict):
            top[key] = value
        elif key in TABLES_BY_NAME:
            below += [((key, name), inner) for name, inner in value.items()]
        elif key == "motor" and source.datasheet is not None:
            below.append(((key,), {k: v for k, v in value.items() if k in source.own_motor_keys}))
        else:
            below.append(((key,), value))
    return [
        {
            "path": path,
            "heading": toml_key(path),
            "lines": [[toml_key(key), list(_pieces(v, key))] for key, v in _leaves(table)],
        }
        for path, table in [((), top), *below]
    ]


def _leaves(table: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, (*above, key))
        else:
            yield (*above, key), value


def _pieces(value: Any, path: tuple[str, ...]) -> Iterator[str | tuple[str, str]]:
    """The text of `toml` in pieces; each number or text in an array is a piece of its own."""
    if not isinstance(value, list | tuple):
        yield toml(value)
        return
    yield from _table_pieces(value, path)


def _table_pieces(value: Any, path: tuple[str, ...]) -> Iterator[str | tuple[str, str]]:
    if isinstance(value, dict):
        for n, (key, inner) in enumerate(value.items()):
            yield f"{', ' if n else '{ '}{toml_key((key,))} = "
            yield from _table_pieces(inner, (*path, key))
        yield " }" if value else "{}"
    elif isinstance(value, list | tuple):
        yield "["
        for n, inner in enumerate(value):
            yield ", " if n else ""
            yield from _table_pieces(inner, (*path, str(n)))
        yield "]"
    else:
        yield toml_key(path), toml(value)


def toml_key(path: tuple[str, ...]) -> str:
    """A dotted key of these parts; a part is in quotes if TOML needs them."""
    return ".".join(part if part and set(part) <= BARE else quoted(part) for part in path)


def toml(value: Any) -> str:
    """A value as TOML in one line. A value that TOML can't express becomes a text."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, dict) and value:
        return f"{{ {', '.join(f'{toml_key((key,))} = {toml(item)}' for key, item in value.items())} }}"
    return repr(value) if isinstance(value, float) else quoted(value)  # JSON has no nan and inf


def quoted(value: Any) -> str:
    """The value as JSON in one line; characters that can't be printed are escaped."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    code = ord(character)
    return character if character.isprintable() else f"\\u{code:04x}" if code < 1 << 16 else f"\\U{code:08x}"
