"""The folder of a run's results: one set of files, which appears at once, whatever happens on the way.

A new set is written to a folder within. Then each name becomes a link that leads through one link, SET, to
the old file; a single rename lets SET lead to the new files; and these take their names. So links are there
for a moment only. What a run that was killed has left, the next run finishes or undoes.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from cogless.errors import StudyError
from cogless.files import reason, writable

NEW, OLD, SET, LINK = ".cogless-new", ".cogless-old", ".cogless-set", ".cogless-link"
INDEX = "results.json"  # has the other files' names in "files"
NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Make the folder if it's missing, and keep other runs out of it.

    What a killed run has left is cleaned first. StudyError: it can't be written, or another run has it.
    """
    with writable(folder), _alone(folder):
        with _refused(folder):
            _settle(folder)
        yield


@contextmanager
def new_set(folder: Path) -> Iterator[Path]:
    """Yield a folder for the files of a new set; at the end it replaces the old set, all files at once.

    After any error the old set is there. `folder` is held. StudyError names the file as it would have been.
    """
    stage = folder / NEW
    try:
        with _refused(folder):
            stage.mkdir()
            yield stage
            _switch(folder)
    except StudyError as error:
        raise StudyError(str(error).replace(str(stage), str(folder))) from error
    finally:
        with _refused(folder):
            _settle(folder)


def hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of each file in a folder, by name."""
    return {name: _hash(folder / name) for name in _files(folder)}


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def _refused(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StudyError(f"{folder}: {reason(error)}: expected a directory that can be written") from error


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock a folder as long as this process lives, where the system can."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise StudyError(f"{folder}: another run is writing there: expected another directory") from None
    except OSError:  # a file system without locks
        pass
    try:
        yield
    finally:
        os.close(handle)


def _files(folder: Path) -> list[str]:
    found = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return sorted(path.as_posix() for path in found)


def _listed(folder: Path) -> list[str]:
    """Files of the set in a folder, as they were written; those that somebody has changed aren't its own."""
    try:
        found = json.loads((folder / INDEX).read_text(encoding="utf-8"))["files"]
        listed: Mapping[str, str] = {str(PurePosixPath(name)): digest for name, digest in found.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return []
    inside = folder.resolve()
    names = [name for name in listed if (folder / name).resolve().is_relative_to(inside)]
    return [name for name in names if (folder / name).is_file() and _hash(folder / name) == listed[name]]


def _switch(folder: Path) -> None:
    new, old, link = folder / NEW, folder / OLD, folder / LINK
    names = _files(new)
    run = _listed(folder) if INDEX in names else []  # a sweep's table and report leave a run's files alone
    before = sorted({*run, *(name for name in names if (folder / name).is_file())})
    try:
        for name in before:
            (old / name).parent.mkdir(parents=True, exist_ok=True)
            os.link(folder / name, old / name)
        os.symlink(OLD, folder / SET)
    except OSError as error:
        if error.errno in NO_ROOM:
            raise
        for name in names:  # a file system without links: one after the other
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(new / name, folder / name)
        _remove(folder, [name for name in before if name not in names])
        return
    for name in {*before, *names}:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.symlink(os.path.relpath(folder / SET / name, (folder / name).parent), link)
        os.replace(link, folder / name)
    os.symlink(NEW, link)
    os.replace(link, folder / SET)  # here the new set appears


def _settle(folder: Path) -> None:
    """Let the files of the set that stands take their names; remove what else a run has left."""
    new, old, link = folder / NEW, folder / OLD, folder / SET
    if link.is_symlink():
        stands, other = (new, old) if os.readlink(link) == NEW else (old, new)
        for name in _files(stands):
            os.replace(stands / name, folder / name)
        _remove(folder, [name for name in _files(other) if (folder / name).is_symlink()])
        link.unlink()
    (folder / LINK).unlink(missing_ok=True)
    for rest in (new, old):
        shutil.rmtree(rest, ignore_errors=True)


def _remove(folder: Path, names: list[str]) -> None:
    """Remove files, and folders left empty."""
    for name in names:
        path = folder / name
        path.unlink()
        with suppress(OSError):
            for parent in path.parents:
                if parent == folder:
                    break
                parent.rmdir()
