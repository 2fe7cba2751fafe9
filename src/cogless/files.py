"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cogless.errors import StudyError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it there on success, remove it on any error or interrupt."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


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
        reason = (error.strerror or str(error)).lower()
        if isinstance(error, FileNotFoundError):  # of what is to be made, as in /proc
            reason = "can't be made there"
        raise StudyError(f"{directory}: {reason}: expected a directory that can be written") from error
    try:
        yield
    finally:
        with suppress(OSError):  # one that isn't empty stays
            for folder in missing:
                folder.rmdir()
