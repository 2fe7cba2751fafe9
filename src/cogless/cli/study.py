"""The study that a command line asks for, and the command line that asks for it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cogless.errors import StudyError

if TYPE_CHECKING:
    from cogless.study import AnyStudy


def command_line(name: str, study: str, changes: list[str] | None, options: list[str]) -> str:
    """The whole command line, quoted for a shell."""
    sets = [word for change in changes or () for word in ("--set", change)]
    return shlex.join(["cogless", name, study, *options, *sets])


def load(study: str, changes: list[str] | None) -> AnyStudy:
    from cogless.design.auto import load
    from cogless.study.reading import changes_from

    return load(study, changes_from(changes or ()))


def to_run(study: str, changes: list[str] | None, no_code: bool) -> AnyStudy:
    """The study, whose own code is named before any of it runs."""
    loaded = load(study, changes)
    path = loaded.source.path
    name_code(path, "controller", loaded.controller, no_code, lambda code: str(path.parent / code))
    return loaded


def name_code(
    path: Path, table: str, laws: Mapping[str, Any], no_code: bool, found: Callable[[str], str]
) -> None:
    """Say which files' code these laws run, or refuse it. `found`: where a file that a law names is."""
    from cogless.study.controller import LibraryLaw, PythonLaw

    for name, law in laws.items():
        if isinstance(law, PythonLaw | LibraryLaw):
            if no_code:
                where = f'{path}: {table}.{name}.law: "{law.law}"'
                raise StudyError(f"{where}: expected no code of the file's own, with --no-code")
            print(f"Code: {table}.{name} runs {found(law.code)}.")
