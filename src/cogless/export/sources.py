"""The C sources that come with cogless, and which of them a law needs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from cogless.files import control_sources

DEFINITION = re.compile(r"^\w[\w ]*[ *](cgl_\w+)\(", re.MULTILINE)
STORE = ("map", "map_store", "crc32")
INCLUDE = re.compile(r'^#include "(?:cogless/)?(\w+\.h)"', re.MULTILINE)


def licence() -> Path:
    """Path of the licence that must accompany every copy of the C sources."""
    return control_sources().parent / "LICENSE"


def closure(needed: Iterable[str], *, code: bool = True) -> list[str]:
    """Names of these headers, of all headers that they include, and of the .c files that belong to them;
    sorted.

    `needed`: headers, such as "drive.h". `code` false: headers only.
    """
    folder = control_sources() / "cogless"
    found: set[str] = set()
    waiting = list(needed)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        text = (folder / name).read_text(encoding="utf-8")
        waiting += INCLUDE.findall(text)
        beside = Path(name).with_suffix(".c").name
        if code and name.endswith(".h") and (folder / beside).is_file():
            waiting.append(beside)
    return sorted(found)


def store() -> list[str]:
    """Files that store maps in flash: .c files, and all headers that they include.

    The headers name the structs of all laws; the .c files of those laws aren't needed.
    """
    return closure((f"{name}{end}" for name in STORE for end in (".h", ".c")), code=False)


def defined_in() -> dict[str, str]:
    """For each function of the control library, the name of the .c file that defines it, without suffix."""
    files = sorted((control_sources() / "cogless").glob("*.c"))
    return {
        name: path.stem for path in files for name in DEFINITION.findall(path.read_text(encoding="utf-8"))
    }
