"""What a shell completes: names of studies, motors, laws, controllers, and parts for `new`."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import typer

from cogless.files import shipped


def complete_study(incomplete: str) -> list[str]:
    """Shipped studies, then folders and TOML files."""
    return _beginning(incomplete, [*shipped("studies"), *_files(incomplete)])


def complete_controller(context: typer.Context, incomplete: str) -> list[str]:
    """Controllers of the study that the line names."""
    return _beginning(incomplete, _tables(context).get("controller", {}))


def complete_scenario(context: typer.Context, incomplete: str) -> list[str]:
    """Scenarios of the study that the line names."""
    return _beginning(incomplete, _tables(context).get("scenario", {}))


def complete_run(context: typer.Context, incomplete: str) -> list[str]:
    """SCENARIO/CONTROLLER of the study that the line names."""
    tables = _tables(context)
    pairs = [f"{s}/{c}" for s in tables.get("scenario", {}) for c in tables.get("controller", {})]
    return _beginning(incomplete, pairs)


def complete_change(context: typer.Context, incomplete: str) -> list[str]:
    """KEY=VALUE: keys of the study that the line names; laws and motors as values."""
    key, separator, _ = incomplete.partition("=")
    if not separator:
        return _beginning(incomplete, (f"{name}=" for name in _keys(_tables(context))))
    values: Iterable[str] = ()
    if key.endswith(".law"):
        values = _laws()
    elif key == "motor.datasheet":
        values = shipped("motors")
    return _beginning(incomplete, (f"{key}={value}" for value in values))


def complete_part(kind: str) -> Callable[[str], list[str]]:
    """The function that completes names of a kind of parts: motors, drives or encoders."""

    def complete(incomplete: str) -> list[str]:
        from cogless.starter.request import names

        return _beginning(incomplete, names(kind))  # type: ignore[arg-type]

    return complete


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in dict.fromkeys(names) if name.startswith(incomplete)]


def _files(incomplete: str) -> Iterator[str]:
    folder, _, begin = incomplete.rpartition("/")
    parent = Path(f"{folder}/" if incomplete.startswith("/") else folder)
    with suppress(OSError):
        for path in sorted(parent.glob(f"{_literal(begin)}*")):
            if path.is_dir() or path.suffix == ".toml":
                yield f"{path}/" if path.is_dir() else str(path)


def _literal(text: str) -> str:
    """The glob pattern that matches only this text."""
    return "".join(f"[{character}]" if character in "*?[" else character for character in text)


def _tables(context: typer.Context) -> dict[str, Any]:
    """The tables of the study that the line names; {} if there is no such study, or if it isn't TOML."""
    from cogless.errors import StudyError
    from cogless.study.reading import find

    with suppress(StudyError, OSError, ValueError):
        study = context.params.get("study") or next(
            iter(context.args), ""
        )  # before an option that has no value
        return tomllib.loads(find(study, "studies", "study").read_text("utf-8"))
    return {}


def _keys(tables: dict[str, Any], begin: str = "") -> Iterator[str]:
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from _keys(value, f"{begin}{key}.")
        elif not isinstance(value, list):
            yield f"{begin}{key}"


def _laws() -> list[str]:
    from cogless.catalogue import catalogue

    return [law for heading, laws in catalogue().items() if heading.startswith("Control") for law in laws]
