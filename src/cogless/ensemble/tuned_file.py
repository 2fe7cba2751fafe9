"""Write a study anew with other values, its text and comments as they were."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cogless.files import replacing
from cogless.study import AnyStudy
from cogless.study.reading import put


def write(study: AnyStudy, changes: Mapping[str, Any], path: Path, about: str) -> None:
    """Write the file of a study with changes, by dotted key. `about`: a comment for its top.

    Files that it names beside itself are named from the new place.
    """
    import tomlkit

    source = study.source.path
    document = tomlkit.parse(source.read_text(encoding="utf-8-sig"))
    _moved(document, source.parent, path.parent)
    for key, value in changes.items():
        put(document, key, value)
    with replacing(path) as temporary:
        temporary.write_text(f"# {about}\n{tomlkit.dumps(document)}", encoding="utf-8")


def _moved(tables: Any, here: Path, there: Path) -> None:
    items = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for key, value in list(items):
        if isinstance(value, dict | list):
            _moved(value, here, there)
        elif isinstance(value, str):
            name, colon, rest = value.partition(".py:")
            file = name + colon.rstrip(":")
            if (
                file
                and len(file) < 256
                and "\n" not in file
                and not os.path.isabs(file)
                and (here / file).is_file()
            ):
                tables[key] = os.path.relpath(here / file, there) + (":" + rest if colon else "")
