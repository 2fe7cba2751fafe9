"""Files that appear whole or not at all; where those are that come with cogless."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cogless.errors import StudyError


def package_folders() -> list[Path]:
    """Folders of the cogless package: more than one while it is developed, say."""
    return [Path(folder) for folder in sys.modules["cogless"].__path__]


def control_sources() -> Path:
    """The folder that holds cogless/*.h and cogless/*.c of the control library, as installed."""
    for folder in package_folders():
        found = folder / "sources" / "control" / "src"
        if found.is_dir():
            return found
    raise FileNotFoundError("cogless/sources/control/src: not installed")


def reason(error: OSError) -> str:
    """The system's words for an error, to stand within a line."""
    return error.strerror.lower() if error.strerror else str(error)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it there on success, remove it on any error or interrupt.

    StudyError: it can't be written, on a full disk say.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def writable(directory: Path) -> Iterator[None]:
    """Create `directory` where it's missing and try to write in it; StudyError if that fails.

    Entered before a run, so that no result is computed that could not be kept. What was created and is still
    empty in the end is removed.
    """
    missing = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        # a folder in which none can be made, such as /proc
        why = "can't be made there" if isinstance(error, FileNotFoundError) else reason(error)
        raise StudyError(f"{directory}: {why}: expected a directory that can be written") from error
    try:
        yield
    finally:
        with suppress(OSError):  # one that isn't empty stays
            for folder in missing:
                folder.rmdir()
