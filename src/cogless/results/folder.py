"""The folder of a run's results: one set of files. A new set appears all at once, or not at all.

A new set is first written to a folder within. Then each file's name becomes a link to the old file, and all
these links lead through one link, SET. A single rename lets SET lead to the new files. At last the new files
replace the links, so links exist for a moment only. If a run is killed, the next run finishes or undoes this.

On a file system without links, the new files replace the old ones one after the other.

The folder may be from elsewhere: the directories in it must be real ones, so that no link leads out of it.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from cogless.errors import StudyError
from cogless.files import reason, writable
from cogless.interrupts import deferred

NEW, OLD, SET, LINK_NAME = ".cogless-new", ".cogless-old", ".cogless-set", ".cogless-link"
TRIAL = ".cogless-try-"  # the start of a name
INDEX_FILE = "results.json"  # has the other files' names in "files"
DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def locked_folder(folder: Path, names: Iterable[str] = ()) -> Iterator[None]:
    """Make the folder if it's missing, and keep other runs out of it. `names`: the new set's files.

    What a killed run has left is cleaned first. StudyError: the folder can't be written, a file can't have
    one of the names there, or another run has locked the folder.
    """
    with writable(folder), _alone(folder):
        with _refused(folder):
            _settle(folder)
        check_names(folder, names)
        yield


def check_names(folder: Path, names: Iterable[str]) -> None:
    """Check that files of these names can be written, by empty files in a temporary folder within.

    StudyError: a file can't be written, or a directory or link is in its way. So no run computes results that
    it can't save.
    """
    with deferred() as requests:  # Ctrl-C waits until the empty files are removed
        _try_names(folder, names)
    if requests.count:
        raise KeyboardInterrupt


def _try_names(folder: Path, names: Iterable[str]) -> None:
    trial = None
    try:
        with _refused(folder):
            trial = Path(tempfile.mkdtemp(prefix=TRIAL, dir=folder))
        for name in names:
            _place(folder, name)
            with _refused(folder / name, "a name that can be written"):
                (trial / name).parent.mkdir(parents=True, exist_ok=True)
                (trial / name).touch()
    finally:
        if trial is not None:
            shutil.rmtree(trial, ignore_errors=True)


@contextmanager
def new_set(folder: Path) -> Iterator[Path]:
    """Yield a folder for the files of a new set; at the end it replaces the old set, all files at once.

    After any error the old set is back. `folder` must be locked. A StudyError names the file's final path.
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
def _refused(path: Path, expected: str = "a directory that can be written") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected {expected}") from error


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock a folder while the block runs, if the system has file locks. StudyError: another run holds it."""
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
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return sorted(path.as_posix() for path in paths)


def _listed(folder: Path) -> list[str]:
    """The names of the set's files in a folder, without files that somebody has changed since."""
    try:
        digests = json.loads((folder / INDEX_FILE).read_text(encoding="utf-8"))["files"]
        listed: Mapping[str, str] = {str(PurePosixPath(name)): digest for name, digest in digests.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []
    return [name for name in listed if _is_own(folder, name) and _hash(folder / name) == listed[name]]


def _is_own(folder: Path, name: str) -> bool:
    """Whether a name is a file's within the folder, and neither the file nor a directory of it is a link."""
    path = PurePosixPath(name)
    way = [folder / inside for inside in (path, *path.parents)][:-1]
    within = not path.is_absolute() and ".." not in path.parts
    return within and not any(map(os.path.islink, way)) and os.path.isfile(folder / name)


def _place(folder: Path, name: str, make: bool = False) -> Path:
    """The path of a file of the set. `make`: whether to make its directories.

    StudyError: a directory on the way is a link or a file, or a directory is in the file's place.
    """
    path, expected = folder, "a directory of its own, or another directory for the results"
    *inside, last = PurePosixPath(name).parts
    for part in inside:
        path /= part
        if path.is_symlink():
            raise StudyError(f"{path}: a symbolic link, which may lead anywhere: expected {expected}")
        if path.exists() and not path.is_dir():
            raise StudyError(f"{path}: a file: expected {expected}")
        if make:
            path.mkdir(exist_ok=True)
    path /= last
    if path.is_dir() and not path.is_symlink():
        raise StudyError(f"{path}: a directory: expected a file, or another directory for the results")
    return path


def _switch(folder: Path) -> None:
    new, old, link = folder / NEW, folder / OLD, folder / LINK_NAME
    names = _files(new)
    run = (
        _listed(folder) if INDEX_FILE in names else []
    )  # a sweep's table and report leave a run's files alone
    before = sorted({*run, *(name for name in names if (folder / name).is_file())})
    try:
        for name in before:
            (old / name).parent.mkdir(parents=True, exist_ok=True)
            os.link(folder / name, old / name)
        os.symlink(OLD, folder / SET)
    except OSError as error:
        if error.errno in DISK_FULL_ERRORS:
            raise
        for name in names:  # a file system without links: one after the other
            os.replace(new / name, _place(folder, name, make=True))
        _remove(folder, [name for name in before if name not in names])
        return
    for name in {*before, *names}:
        path = _place(folder, name, make=True)
        os.symlink(os.path.relpath(folder / SET / name, path.parent), link)
        os.replace(link, path)
    os.symlink(NEW, link)
    os.replace(link, folder / SET)  # here the new set appears


def _settle(folder: Path) -> None:
    """Give the files of the set to which SET leads their names; remove what else a run has left."""
    new, old, link = folder / NEW, folder / OLD, folder / SET
    own = [new, old, *folder.glob(f"{TRIAL}*")]
    for path in own:
        if path.is_symlink() or path.is_file():  # not from a run, which only makes directories of these names
            path.unlink()
    if link.is_symlink():
        stands, other = (new, old) if os.readlink(link) == NEW else (old, new)
        for name in _files(stands):
            os.replace(stands / name, _place(folder, name, make=True))
        _remove(folder, [name for name in _files(other) if (folder / name).is_symlink()])
        link.unlink()
    (folder / LINK_NAME).unlink(missing_ok=True)
    for path in own:
        shutil.rmtree(path, ignore_errors=True)


def _remove(folder: Path, names: list[str]) -> None:
    """Remove files, and folders left empty."""
    for name in names:
        path = _place(folder, name)
        path.unlink()
        with suppress(OSError):
            for parent in path.parents:
                if parent == folder:
                    break
                parent.rmdir()
