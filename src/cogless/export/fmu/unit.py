"""Contents of one FMU, whether of the controller or of the drive."""

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
    """A model as an FMU: its variables and its own sources. `rate` in 1/s, `stop_time` in s."""

    name: str
    about: str
    language: Literal["C", "C++"]
    rate: int
    stop_time: float
    variables: Sequence[Variable]
    sources: Mapping[str, str]  # name below sources/ -> text

    @property
    def identifier(self) -> str:
        """The name as a C identifier."""
        return re.sub(r"\W", "_", self.name if self.name[:1].isalpha() else f"unit_{self.name}")


def asset(name: str) -> str:
    """Text of a source file that comes with cogless for all FMUs."""
    return (Path(__file__).parents[1] / "assets" / "fmu" / name).read_text(encoding="utf-8")


def texts(files: Iterable[Path], under: str = "") -> dict[str, str]:
    """Texts of these files, by their name in the FMU's folder sources/."""
    return {under + path.name: path.read_text(encoding="utf-8") for path in sorted(files)}


def in_precision(sources: dict[str, str], bits: int) -> dict[str, str]:
    """The control library's sources for numbers of 32 or 64 bits.

    For 64 bits, real.h itself defines the macro COGLESS_DOUBLE, so that no compiler option is needed.
    """
    if bits == 32:
        return sources
    return sources | {"cogless/real.h": DOUBLE + sources["cogless/real.h"]}
