"""Read the struct and enum definitions of the control library from its C headers.

The headers are the only place where the fields are declared.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cogless.files import control_sources

STRUCT = re.compile(r"typedef struct \{(.*?)\n\} (\w+);", re.DOTALL)
SAME = re.compile(r"^typedef (cgl_\w+) (cgl_\w+);", re.MULTILINE)
ENUM = re.compile(r"typedef enum \{(.*?)\} (\w+);", re.DOTALL)
NUMBER = re.compile(r"^#define (\w+) +(\d+)U?(?: */\*.*)?$", re.MULTILINE)
# a comment on its own, or a declaration and the comment that follows it
MEMBER = re.compile(r"\s*(?:/\*.*?\*/|([^;{}/]+);(?:[ \t]*/\*(.*?)\*/)?)", re.DOTALL)
FUNCTION = re.compile(r"\w+ \(\*(\w+)\)\(.*\)", re.DOTALL)
DECLARATION = re.compile(r"(?:const )?(\w+) (.+)", re.DOTALL)
DECLARATOR = re.compile(r"(\*?)(\w+)(?:\[(.+)\])?")
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True)
class Field:
    """A member of a C struct.

    `length`: number of entries of an array, None if it isn't one. `comment`: unit and meaning from the
    header; only the first member of a declaration has it.
    """

    name: str
    type: str
    length: int | None
    pointer: bool
    comment: str
    declaration: int  # its number in the struct; members of one declaration share it


@dataclass(frozen=True)
class Headers:
    """Definitions in the C headers.

    `structs`: name -> members, in order. `enums`: name -> constant -> value.
    """

    structs: Mapping[str, tuple[Field, ...]]
    enums: Mapping[str, Mapping[str, int]]


@cache
def control_headers() -> Headers:
    """Definitions in the headers of the control library that is installed with cogless."""
    return parse(sorted((control_sources() / "cogless").glob("*.h")))


def parse(headers: Iterable[Path]) -> Headers:
    """Read structs and enums from header files. ValueError: a struct member that this parser can't read."""
    texts = [path.read_text(encoding="utf-8") for path in headers]
    numbers = {name: int(value) for text in texts for name, value in NUMBER.findall(text)}
    structs = {name: _members(name, body, numbers) for text in texts for body, name in STRUCT.findall(text)}
    for text in texts:
        structs |= {name: structs[of] for of, name in SAME.findall(text)}
    enums = {name: _constants(body) for text in texts for body, name in ENUM.findall(text)}
    return Headers(structs, enums)


def _members(struct: str, body: str, numbers: Mapping[str, int]) -> tuple[Field, ...]:
    fields: list[Field] = []
    place, count, body = 0, 0, body.rstrip()
    while place < len(body):
        found = MEMBER.match(body, place)
        if found is None:
            raise ValueError(f"{struct}: not readable: {body[place:].strip()[:40]!r}")
        place = found.end()
        if found.group(1) is None:
            continue
        function = FUNCTION.fullmatch(found.group(1).strip())
        if function is not None:
            comment = " ".join((found.group(2) or "").split())
            fields.append(Field(function.group(1), "void", None, True, comment, count))
            count += 1
            continue
        whole = DECLARATION.fullmatch(found.group(1).strip())
        if whole is None:
            raise ValueError(f"{struct}: not readable: {found.group(1).strip()!r}")
        comment = " ".join((found.group(2) or "").split())
        for part in whole.group(2).split(","):
            one = DECLARATOR.fullmatch(part.strip())
            if one is None:
                raise ValueError(f"{struct}: not readable: {part.strip()!r}")
            length = _length(one.group(3), numbers) if one.group(3) else None
            fields.append(Field(one.group(2), whole.group(1), length, bool(one.group(1)), comment, count))
            comment = ""
        count += 1
    return tuple(fields)


def _length(text: str, numbers: Mapping[str, int]) -> int:
    """Length of an array, which is written as a number, a macro, or a sum of these."""
    return sum(numbers[term] if term in numbers else int(term) for term in text.replace(" ", "").split("+"))


def _constants(body: str) -> dict[str, int]:
    constants: dict[str, int] = {}
    for item in COMMENT.sub("", body).split(","):
        if item.strip():
            name, _, value = item.partition("=")
            following = max(constants.values(), default=-1) + 1
            constants[name.strip()] = int(value) if value else following
    return constants
