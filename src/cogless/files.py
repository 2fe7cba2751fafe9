"""Write files completely or not at all, find the files that are installed with cogless, and find versions."""

from __future__ import annotations

import errno
import os
import secrets
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from cogless.errors import StudyError


def package_folders() -> list[Path]:
    """Folders of the cogless package; there may be several, for example in a development install."""
    return [Path(folder) for folder in sys.modules["cogless"].__path__]


def shipped(room: str) -> dict[str, Path]:
    """TOML files that come with cogless: name -> path. `room`: a folder, such as "studies" or "motors"."""
    folders = [folder / room for folder in package_folders()]
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def control_sources() -> Path:
    """The installed folder that contains cogless/*.h and cogless/*.c of the control library."""
    for folder in package_folders():
        sources = folder / "sources" / "control" / "src"
        if sources.is_dir():
            return sources
    raise FileNotFoundError("cogless/sources/control/src: not installed")


def reason(error: OSError) -> str:
    """The operating system's text for an error, in lower case, for use within a message."""
    return error.strerror.lower() if error.strerror else str(error)


def no_device(path: Path) -> None:
    """Raise OSError if a path is a device or a pipe, which may take for ever to read."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "not a regular file", str(path))


def no_link(path: Path) -> None:
    """Raise OSError if a path is a symbolic link: in a folder from elsewhere it may lead anywhere."""
    if path.is_symlink():
        raise OSError(errno.ELOOP, "a symbolic link, which may lead anywhere", str(path))


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a path for a temporary file, which replaces `path` on success and is removed otherwise.

    A symbolic link stays, and the file that it leads to is replaced. A device or a pipe would be lost if a
    file replaced it, so `path` itself is yielded then.

    StudyError: the file can't be written, for example on a full disk.
    """
    direct = os.path.exists(path) and not os.path.isfile(path)
    target = Path(os.path.realpath(path))
    # The temporary name does not contain the file's own, which may already be as long as a name can be.
    temporary = path if direct else target.with_name(f".cogless-{secrets.token_hex(8)}.tmp")
    try:
        yield temporary
        if not direct:
            os.replace(temporary, target)
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error
    finally:
        if not direct:
            with suppress(OSError):
                temporary.unlink()


def check_replaceable(path: Path) -> None:
    """Raise StudyError if `replacing` would fail. So nothing is computed that can't be written."""
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if path.is_file() or not path.exists():  # A device or a pipe is written in place.
            with tempfile.TemporaryFile(dir=Path(os.path.realpath(path)).parent):
                pass
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error


def check_utf8(path: Path, expected: str) -> None:
    """Raise StudyError if a path isn't UTF-8, and so can't be written to results and reports."""
    if any("\ud800" <= character <= "\udfff" for character in str(path)):
        printable = str(path).encode(errors="backslashreplace").decode()
        raise StudyError(f"{printable}: not UTF-8: expected {expected} with a name in UTF-8")


@contextmanager
def writable(directory: Path) -> Iterator[None]:
    """Create `directory` if it is missing, and try to write in it; StudyError if that fails.

    A run is made within this context, so that no result is computed that can't be saved. At the end, folders
    that were created here and are still empty are removed.
    """
    check_utf8(directory, "a directory")
    missing = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    try:
        try:
            directory.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=directory):
                pass
        except OSError as error:
            # A FileNotFoundError means that the parent, such as /proc, allows no new folders.
            why = "can't be made there" if isinstance(error, FileNotFoundError) else reason(error)
            raise StudyError(f"{directory}: {why}: expected a directory that can be written") from error
        yield
    finally:
        with suppress(OSError):  # A folder that isn't empty stays.
            for folder in missing:
                folder.rmdir()


@cache
def versions() -> dict[str, str]:
    """Versions of cogless, Python and NumPy, which compute the numbers."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    try:
        cogless = version("cogless")
    except PackageNotFoundError:
        cogless = "not installed"
    return {"cogless": cogless, "python": platform.python_version(), "numpy": version("numpy")}
