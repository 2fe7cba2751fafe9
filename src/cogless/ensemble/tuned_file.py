"""The text of a study with other values, its text and comments as they were."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cogless.study import AnyStudy
from cogless.study.reading import put


def text(study: AnyStudy, changes: Mapping[str, Any], folder: Path, about: str) -> str:
    """The file of a study with changes, by dotted key. `about`: a comment for its top.

    Files that it names beside itself are named from `folder`, where it is to stand.
    """
    import tomlkit

    source = study.source.path
    document = tomlkit.parse(source.read_text(encoding="utf-8-sig"))
    _moved(document, source.parent, folder)
    for key, value in changes.items():
        put(document, key, value)
    return f"# {about}\n{tomlkit.dumps(document)}"


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
