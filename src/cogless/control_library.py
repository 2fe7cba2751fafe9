"""The control library as its laws.def and C headers declare it: laws, structs, enums, numbers, status bits.

The headers are the only place where the fields are declared.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cache
from pathlib import Path
from typing import Any

from cogless.files import control_sources

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
LAW_ROW = re.compile(r"^CGL_(\w+)\((.*?)\)$", re.DOTALL | re.MULTILINE)
CONFIG_MEMBER = re.compile(r"\bc\.([\w.]+)")


@dataclass(frozen=True)
class Term:
    """A part of a law's output that is recorded as a signal. `learned`: whether it is the learned part."""

    signal: str
    unit: str
    learned: bool


@dataclass(frozen=True)
class CLaw:
    """Names of a law in C, and its memory.

    `cells`: member of the law's state that points to memory which the caller provides. `length`: number of
    entries of that memory, a C expression in members of the configuration `c`. Both are None if the law needs
    no memory besides its state.
    """

    name: str
    stem: str
    header: str
    step: str
    cells: str | None
    length: str | None
    terms: tuple[Term, ...]

    @property
    def state(self) -> str:
        """C type of the law's state; the names of the law's functions begin with it."""
        return f"cgl_{self.stem}"

    @property
    def config(self) -> str:
        """C type of the law's configuration."""
        return f"{self.state}_config"

    @property
    def by_order(self) -> bool:
        """Whether the law's memory holds amplitudes of orders, not cells over the angle."""
        return self.length is not None and "c.orders" in self.length

    @property
    def map(self) -> str:
        """Name of the C function that makes a stored map from what the law has learned."""
        return f"cgl_map_of_{self.stem}"

    def entries(self, config: Mapping[str, Any]) -> str | None:
        """The C expression `length` with the numbers of a decoded configuration put in.

        Whole numbers get C's suffix U. None if `length` is None.
        """

        def value(match: re.Match[str]) -> str:
            member: Any = config
            for part in match[1].split("."):
                member = member[part]
            return f"{member}U" if isinstance(member, int) else str(member)

        return None if self.length is None else CONFIG_MEMBER.sub(value, self.length)


def _arguments(text: str) -> Iterator[str]:
    """Yield the arguments of a macro call in laws.def. `text`: the text between the call's parentheses."""
    depth, start = 0, 0
    for place, character in enumerate(text):
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            yield " ".join(text[start:place].split()).strip('"')
            start = place + 1
    yield " ".join(text[start:].split()).strip('"')


def _laws() -> Iterator[CLaw]:
    text = COMMENT.sub("", (control_sources() / "cogless" / "laws.def").read_text(encoding="utf-8"))
    rows = [(kind, list(_arguments(row))) for kind, row in LAW_ROW.findall(text)]
    terms: dict[str, list[Term]] = {}
    for kind, (stem, *row) in rows:
        if kind == "TERM":
            signal, unit, _, share, _ = row
            terms.setdefault(stem, []).append(Term(signal, unit, share == "learned"))
    for kind, row in rows:
        if kind != "TERM":
            name, stem, header, step, *memory = row
            cells, length = memory or (None, None)
            yield CLaw(
                name=name,
                stem=stem,
                header=header,
                step=step,
                cells=cells,
                length=length,
                terms=tuple(terms.get(stem, ())),
            )


C_LAWS = {law.name: law for law in _laws()}
# Microstepping has no drive around it, and so no row in laws.def.
MICROSTEPPING = CLaw(
    name="microstepping",
    stem="microstepping",
    header="microstepping.h",
    step="cgl_microstepping_step",
    cells=None,
    length=None,
    terms=(),
)


STRUCT = re.compile(r"typedef struct \{(.*?)\n\} (\w+);", re.DOTALL)
SAME_TYPE = re.compile(r"^typedef (cgl_\w+) (cgl_\w+);", re.MULTILINE)
ENUM = re.compile(r"typedef enum \{(.*?)\} (\w+);", re.DOTALL)
NUMBER_MACRO = re.compile(r"^#define (\w+) +(\d+)U?(?: */\*.*)?$", re.MULTILINE)
REAL_NUMBER = re.compile(r"^#define (\w+) +\w+\(([\d.e+-]+)\)", re.MULTILINE)
BIT = re.compile(r"\b(CGL_STATUS_\w+) = (\d+)")
# a comment on its own, or a declaration and the comment that follows it
STRUCT_MEMBER = re.compile(r"\s*(?:/\*.*?\*/|([^;{}/]+);(?:[ \t]*/\*(.*?)\*/)?)", re.DOTALL)
FUNCTION = re.compile(r"\w+ \(\*(\w+)\)\(.*\)", re.DOTALL)
DECLARATION = re.compile(r"(?:const )?(\w+) (.+)", re.DOTALL)
DECLARATOR = re.compile(r"(\*?)(\w+)(?:\[(.+)\])?")


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
    declaration: int  # number of the declaration in the struct; one declaration may have several members


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


@cache
def _texts() -> tuple[str, ...]:
    headers = sorted((control_sources() / "cogless").glob("*.h"))
    return tuple(path.read_text(encoding="utf-8") for path in headers)


@cache
def _numbers() -> dict[str, str]:
    return {
        name: value
        for text in _texts()
        for form in (NUMBER_MACRO, REAL_NUMBER)
        for name, value in form.findall(text)
    }


def whole_number(macro: str) -> int:
    """The whole number that a header defines as a macro."""
    return int(_numbers()[macro])


def real_number(macro: str) -> float:
    """The real number that a header defines as a macro."""
    return float(_numbers()[macro])


@cache
def status_bits() -> dict[str, int]:
    """The bits of a step's status by their names in C."""
    return {name: int(value) for text in _texts() for name, value in BIT.findall(text)}


def parse(headers: Iterable[Path]) -> Headers:
    """Read structs and enums from header files. ValueError: a struct member that this parser can't read."""
    texts = [path.read_text(encoding="utf-8") for path in headers]
    numbers = {name: int(value) for text in texts for name, value in NUMBER_MACRO.findall(text)}
    structs = {name: _members(name, body, numbers) for text in texts for body, name in STRUCT.findall(text)}
    for text in texts:
        structs |= {name: structs[of] for of, name in SAME_TYPE.findall(text)}
    enums = {name: _constants(body) for text in texts for body, name in ENUM.findall(text)}
    return Headers(structs, enums)


def _members(struct: str, body: str, numbers: Mapping[str, int]) -> tuple[Field, ...]:
    fields: list[Field] = []
    place, count, body = 0, 0, body.rstrip()
    while place < len(body):
        member = STRUCT_MEMBER.match(body, place)
        if member is None:
            raise ValueError(f"{struct}: not readable: {body[place:].strip()[:40]!r}")
        place = member.end()
        if member.group(1) is None:
            continue
        function = FUNCTION.fullmatch(member.group(1).strip())
        if function is not None:
            comment = " ".join((member.group(2) or "").split())
            fields.append(
                Field(
                    name=function.group(1),
                    type="void",
                    length=None,
                    pointer=True,
                    comment=comment,
                    declaration=count,
                )
            )
            count += 1
            continue
        whole = DECLARATION.fullmatch(member.group(1).strip())
        if whole is None:
            raise ValueError(f"{struct}: not readable: {member.group(1).strip()!r}")
        comment = " ".join((member.group(2) or "").split())
        for part in whole.group(2).split(","):
            one = DECLARATOR.fullmatch(part.strip())
            if one is None:
                raise ValueError(f"{struct}: not readable: {part.strip()!r}")
            length = _length(one.group(3), numbers) if one.group(3) else None
            fields.append(
                Field(
                    name=one.group(2),
                    type=whole.group(1),
                    length=length,
                    pointer=bool(one.group(1)),
                    comment=comment,
                    declaration=count,
                )
            )
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


_BITS = status_bits()


class Status(IntFlag):
    """Status bits that a controller returns with each step."""

    SATURATED = _BITS["CGL_STATUS_SATURATED"]
    FAULT = _BITS["CGL_STATUS_FAULT"]
    FROZEN = _BITS["CGL_STATUS_FROZEN"]
    BUSY = _BITS["CGL_STATUS_BUSY"]
    ANGLE_LOST = _BITS["CGL_STATUS_ANGLE_LOST"]
    ANGLE_SHIFTED = _BITS["CGL_STATUS_ANGLE_SHIFTED"]
    ANGLE_STUCK = _BITS["CGL_STATUS_ANGLE_STUCK"]
    CURRENT = _BITS["CGL_STATUS_CURRENT"]
    BUS = _BITS["CGL_STATUS_BUS"]
    OUTLIER = _BITS["CGL_STATUS_OUTLIER"]
    OFF = _BITS["CGL_STATUS_OFF"]
    GUARDED = _BITS["CGL_STATUS_GUARDED"]


SAFE_OUTPUT = Status.FAULT | Status.OFF  # the controller holds its safe output
NOTICED = {  # the monitor sets these
    Status.ANGLE_LOST: "angle missing",
    Status.ANGLE_SHIFTED: "angle shifted",
    Status.ANGLE_STUCK: "angle stuck",
    Status.CURRENT: "current not plausible",
    Status.BUS: "bus voltage not plausible",
}
