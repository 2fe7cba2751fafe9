"""A study made ready to travel: its tables, and the files that it names, for a worker on any machine."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from cogless.study import AnyStudy
from cogless.study.base import Source
from cogless.study.named_files import named_files
from cogless.study.reading import checked


@dataclass(frozen=True, eq=False)
class Parcel:
    """`files`: content by path relative to the study. Two parcels are the same if their digests are."""

    source: Source
    files: Mapping[str, bytes]
    digest: str

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parcel) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)


def pack(study: AnyStudy) -> Parcel:
    """Pack a study as it was read, with its changes."""
    source = study.source
    files = {name: (source.folder / name).read_bytes() for name in sorted(_named(study))}
    text = json.dumps(source.tables, sort_keys=True, default=str)
    found = hashlib.sha256(text.encode())
    for name, content in files.items():
        found.update(f"\n{name} {len(content)}\n".encode() + content)
    return Parcel(source, files, found.hexdigest())


@lru_cache(maxsize=8)
def unpacked(parcel: Parcel) -> AnyStudy:
    """The study of a parcel: where it came from if its files are there, else in a folder of its own."""
    source = parcel.source
    if all(_is(source.folder / name, content) for name, content in parcel.files.items()):
        return checked(source)
    up = max(name.count("../") for name in parcel.files)
    folder = Path(tempfile.mkdtemp(prefix="cogless-"), *("in",) * up)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in parcel.files.items():
        place = Path(os.path.normpath(folder / name))
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    return checked(replace(source, path=folder / source.path.name, directory=folder))


def _is(path: Path, content: bytes) -> bool:
    try:
        return path.read_bytes() == content
    except OSError:
        return False


def _named(study: AnyStudy) -> set[str]:
    """Files that a study names by a path relative to it; of a controller in Python also its neighbours."""
    folder = study.source.folder
    names = set()
    for file in named_files(type(study), study.source.tables):
        path = folder / file.path
        if os.path.isabs(file.path) or not os.path.isfile(path):
            continue
        names.add(file.path)
        if path.suffix == ".py":
            inside = os.path.dirname(file.path)
            names |= {os.path.join(inside, beside.name) for beside in path.parent.glob("*.py")}
    return names
