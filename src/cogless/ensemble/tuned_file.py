"""The text of a study with other values, its text and comments as they were."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cogless.study import AnyStudy
from cogless.study.error_messages import look_up
from cogless.study.named_files import named_files
from cogless.study.reading import put


def text(study: AnyStudy, changes: Mapping[str, Any], folder: Path, about: str) -> str:
    """The file of a study with changes, by dotted key. `about`: a comment for its top.

    Files that it names beside itself are named from `folder`, where it is to stand.
    """
    import tomlkit

    source = study.source.path
    document = tomlkit.parse(source.read_text(encoding="utf-8-sig"))
    for key, value in changes.items():
        put(document, key, value)
    for file in named_files(type(study), document):
        if not os.path.isabs(file.path):
            table = look_up(document, file.key[:-1])
            table[file.key[-1]] = os.path.relpath(study.source.folder / file.path, folder) + file.rest
    return f"# {about}\n{tomlkit.dumps(document)}"
