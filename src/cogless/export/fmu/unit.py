"""Contents of one FMU, whichever model it has."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cogless.export.fmu.variables import Variable

DOUBLE = "#define COGLESS_DOUBLE /* this study's controller computes in double */\n"


@dataclass(frozen=True)
class Unit:
    """A model: its variables and its own sources. `rate` in 1/s, `stop_time` in s."""

    name: str
    about: str
    language: Literal["C", "C++"]
    rate: int
    stop_time: float
    variables: Sequence[Variable]
    sources: Mapping[str, str]  # name below sources/ -> text

    @property
    def identifier(self) -> str:
        """The name as one of C."""
        return re.sub(r"\W", "_", self.name if self.name[:1].isalpha() else f"unit_{self.name}")


def asset(name: str) -> str:
    """A template of FMUs as text."""
    return (Path(__file__).parents[1] / "assets" / "fmu" / name).read_text(encoding="utf-8")


def texts(files: Iterable[Path], under: str = "") -> dict[str, str]:
    """Files by their name in sources/."""
    return {under + path.name: path.read_text(encoding="utf-8") for path in sorted(files)}


def in_precision(sources: dict[str, str], bits: int) -> dict[str, str]:
    """The control library's sources in numbers of 32 or 64 bits: no compiler's option is needed then."""
    if bits == 32:
        return sources
    return sources | {"cogless/real.h": DOUBLE + sources["cogless/real.h"]}
