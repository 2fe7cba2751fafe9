"""Laws of the control library, read from its laws.def: names in C, memory, recorded parts of the output."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from cogless.files import control_sources

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
ROW = re.compile(r"^CGL_(\w+)\((.*?)\)$", re.DOTALL | re.MULTILINE)
MEMBER = re.compile(r"\bc\.([\w.]+)")


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
        """Whether its memory holds amplitudes of orders, and no cells over the angle."""
        return self.length is not None and "c.orders" in self.length

    @property
    def map(self) -> str:
        """Name of the C function that makes a stored map from what the law has learned."""
        return f"cgl_map_of_{self.stem}"

    def entries(self, config: Mapping[str, Any]) -> str | None:
        """The C expression `length` with the numbers of a decoded configuration put in.

        Whole numbers get C's suffix U. None if `length` is None.
        """

        def value(found: re.Match[str]) -> str:
            member: Any = config
            for part in found[1].split("."):
                member = member[part]
            return f"{member}U" if isinstance(member, int) else str(member)

        return None if self.length is None else MEMBER.sub(value, self.length)


def _arguments(text: str) -> Iterator[str]:
    """Yield the arguments of a macro call in laws.def: its text, split at commas outside inner
    parentheses."""
    depth, start = 0, 0
    for place, character in enumerate(text):
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            yield " ".join(text[start:place].split()).strip('"')
            start = place + 1
    yield " ".join(text[start:].split()).strip('"')


def _laws() -> Iterator[CLaw]:
    text = COMMENT.sub("", (control_sources() / "cogless" / "laws.def").read_text(encoding="utf-8"))
    rows = [(kind, list(_arguments(row))) for kind, row in ROW.findall(text)]
    terms: dict[str, list[Term]] = {}
    for kind, (stem, *row) in rows:
        if kind == "TERM":
            signal, unit, _, share, _ = row
            terms.setdefault(stem, []).append(Term(signal, unit, share == "learned"))
    for kind, row in rows:
        if kind != "TERM":
            name, stem, header, step, *memory = row
            cells, length = memory or (None, None)
            yield CLaw(name, stem, header, step, cells, length, tuple(terms.get(stem, ())))


C_LAWS = {law.name: law for law in _laws()}
