"""Catalogue for `cogless list`: shipped studies and motors, and the laws that a controller can have."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from cogless.control_library import C_LAWS
from cogless.files import shipped
from cogless.lines import print_text

TRIAL_LAWS, OWN_LAWS = "trial", "own"  # files of laws that are not listed in the order of laws.def
ANY_SENSOR = "absolute"  # key of a part: a sensor whose bits the user gives
LAW = re.compile(r"law: Literal\['(.+?)'\]")


def catalogue() -> dict[str, dict[str, str]]:
    """Entries of the catalogue: heading -> name -> description in one line."""
    laws = _laws()
    own, of_trials = laws.pop(OWN_LAWS, {}), laws.pop(TRIAL_LAWS, {})
    of_speed = {name: description for file in laws.values() for name, description in file.items()}
    return {
        "Studies": {name: _title(path) for name, path in shipped("studies").items()},
        "Motors": {name: _first_comment(path) for name, path in shipped("motors").items()},
        "Control laws": {**{name: of_speed[name] for name in C_LAWS if name in of_speed}, **of_speed, **own},
        "Control laws of trials": {**of_trials, **own},
    }


def sensor_words(bits: int) -> str:
    """Names of the sensors of `cogless new` that have `bits` or more, as text; or a text that none has."""
    fine = [name for name, has in sensor_bits().items() if has >= bits]
    return ", ".join(fine) or "more than any chip that `cogless new` knows"


@cache
def sensor_bits() -> Mapping[str, int]:
    """The bits of each absolute sensor of `cogless new`, by the sensor's name there."""
    parts = tomllib.loads(shipped("parts")["encoders"].read_text(encoding="utf-8"))
    named = [part for name, part in parts.items() if "bits" in part and name != ANY_SENSOR]
    return {part["about"].partition(",")[0]: part["bits"]["typical"] for part in named}


@cache
def edge_timers() -> Mapping[str, bool]:
    """Whether a drive has a clock that times edges, by its name in `cogless new --drive`."""
    parts = tomllib.loads(shipped("parts")["drives"].read_text(encoding="utf-8"))
    return {name: "timer" in part for name, part in parts.items()}


def show() -> None:
    """Print the catalogue."""
    bold, plain = ("\033[1m", "\033[0m") if sys.stdout.isatty() else ("", "")
    for heading, entries in catalogue().items():
        print(f"{bold}{heading}{plain}")
        width = max((len(name) for name in entries), default=0)
        for name, description in entries.items():
            print_text(f"{name:<{width}}  {description}", "  ", " " * (width + 4))


def _laws() -> dict[str, dict[str, str]]:
    """Laws by the file of their models: file -> name -> description.

    Read from the source: importing the models takes longer than all else that the command does.
    """
    laws: dict[str, dict[str, str]] = {}
    for path in (Path(__file__).parent / "study" / "laws").glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            law = LAW.search(ast.unparse(node)) if isinstance(node, ast.ClassDef) else None
            if isinstance(node, ast.ClassDef) and law:
                laws.setdefault(path.stem, {})[law[1]] = _first_line(ast.get_docstring(node) or "")
    return laws


def _title(path: Path) -> str:
    return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))


def _first_comment(path: Path) -> str:
    first = _first_line(path.read_text(encoding="utf-8"))
    return first.lstrip("# ").rstrip() if first.startswith("#") else ""


def _first_line(text: str) -> str:
    return text.partition("\n")[0]
