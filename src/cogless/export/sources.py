"""The C sources that come with cogless, and the folder of an export, written completely or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cogless.errors import StudyError
from cogless.files import control_sources, reason

DEFINITION = re.compile(r"^\w[\w ]*[ *](cgl_\w+)\(", re.MULTILINE)
STORE = ("map", "map_store", "crc32")
INCLUDE = re.compile(r'^#include "(?:cogless/)?(\w+\.h)"', re.MULTILINE)


def licence() -> Path:
    """Path of the licence that must accompany every copy of the C sources."""
    return control_sources().parent / "LICENSE"


def closure(needed: Iterable[str], *, code: bool = True) -> list[str]:
    """Sorted names of the needed files, of all headers that these include, and of the headers' .c files.

    `needed`: names such as "drive.h". `code` false: no .c files are added to the headers.
    """
    folder = control_sources() / "cogless"
    closed: set[str] = set()
    waiting = list(needed)
    while waiting:
        name = waiting.pop()
        if name in closed:
            continue
        closed.add(name)
        text = (folder / name).read_text(encoding="utf-8")
        waiting += INCLUDE.findall(text)
        source = Path(name).with_suffix(".c").name
        if code and name.endswith(".h") and (folder / source).is_file():
            waiting.append(source)
    return sorted(closed)


def store() -> list[str]:
    """Names of the files that store maps in flash: their .c files, and all headers that these include.

    The headers include those of all laws, since they name the laws' structs. No law's .c file is needed.
    """
    return closure((f"{name}{end}" for name in STORE for end in (".h", ".c")), code=False)


def with_library(texts: Mapping[str, str], names: Iterable[str]) -> dict[str, bytes]:
    """Contents of an export: `texts`, the control library's files called `names`, and its licence."""
    library = control_sources() / "cogless"
    copied = {f"cogless/{name}": (library / name).read_bytes() for name in names}
    own = {name: text.encode() for name, text in texts.items()}
    return own | copied | {"cogless/LICENSE": licence().read_bytes()}


def defined_in() -> dict[str, str]:
    """{function of the control library: name of the .c file that defines it, without suffix}."""
    files = sorted((control_sources() / "cogless").glob("*.c"))
    return {
        name: path.stem for path in files for name in DEFINITION.findall(path.read_text(encoding="utf-8"))
    }


MANIFEST = "export.json"
COMPILED = (".o", ".obj", ".d", ".exe", "")  # suffixes of files that compilers write next to sources


def check(folder: Path) -> None:
    """Raise StudyError if the folder holds a file that no export wrote, or that was changed since."""
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{folder}: is a file: expected a new or empty folder, or an earlier export")
    if not folder.exists() or not any(folder.iterdir()):
        return
    sums = _sums(folder)
    paths = folder.rglob("*")
    for path in paths if sums is None else sorted(paths):  # no sums: any file is refused, so no sorting
        name = path.relative_to(folder).as_posix()
        if path.is_dir() or name == MANIFEST:
            continue
        if sums is not None and name not in sums and _is_compiled(path, sums):
            continue
        if sums is None or name not in sums:
            raise StudyError(
                f"{folder}: not empty: {name}: expected a new or empty folder, or an unchanged earlier export"
            )
        if sums[name] != _sum(path.read_bytes()):
            raise StudyError(f"{folder}: {name}: changed since its export: expected a new or empty folder")


def write(folder: Path, files: Mapping[str, bytes], facts: Mapping[str, Any]) -> None:
    """Replace the folder by these files (by path in the folder) and a manifest.

    The manifest holds `facts` and the files' checksums. StudyError: the folder can't be written, or it holds
    something other than an unchanged export.
    """
    check(folder)
    manifest = {**facts, "files": {name: _sum(data) for name, data in sorted(files.items())}}
    text = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
    target = folder.absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as scratch:
            fresh = Path(scratch) / "new"
            for name, data in {**files, MANIFEST: text.encode()}.items():
                path = fresh / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
            _swap(fresh, target, Path(scratch) / "old")
    except OSError as error:
        raise StudyError(f"{folder}: {reason(error)}: expected a folder that can be written") from error


def size(files: Mapping[str, bytes], matrix: int) -> str:
    """Text on the size of an export's files and of its learning matrix. `matrix`: bytes of the matrix."""
    whole, largest = sum(map(len, files.values())), max(files, key=lambda name: len(files[name]))
    return (
        f"{whole / 1e6:.3g} MB of files, {len(files[largest]) / 1e6:.3g} MB of them {largest}; "
        f"the learning matrix takes {matrix / 1e6:.3g} MB of flash"
    )


def _swap(fresh: Path, target: Path, old: Path) -> None:
    """Move the folder `target` to `old` if it exists, then `fresh` to `target`; on an error, undo this."""
    if not target.exists():
        os.rename(fresh, target)
        return
    os.rename(target, old)
    try:
        os.rename(fresh, target)
    except BaseException:
        os.rename(old, target)
        raise


def _sums(folder: Path) -> dict[str, str] | None:
    """Checksums of the files of an earlier export; None if the folder isn't an export."""
    try:
        sums = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
        return {str(name): str(value) for name, value in sums.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _is_compiled(path: Path, sums: Mapping[str, str]) -> bool:
    """Whether a file has the name that a compiler gives to its output from one of the export's sources."""
    return path.suffix in COMPILED and any(
        source.suffix == ".c" and source.stem == path.stem for source in map(Path, sums)
    )


def _sum(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
