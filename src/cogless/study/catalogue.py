"""Catalogue for `cogless list`: shipped studies and motors, and the laws that a controller can have."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from cogless.study.laws import AnyController
from cogless.study.reading import read, shipped
from cogless.study.trial_controller import AnyTrialController


def catalogue() -> dict[str, dict[str, str]]:
    """Entries of the catalogue: heading -> name -> description in one line."""
    return {
        "Studies": {name: str(read(path).get("title", "")) for name, path in shipped("studies").items()},
        "Motors": {name: _first_comment(path) for name, path in shipped("motors").items()},
        "Control laws": {_law(model): _first_line(model.__doc__ or "") for model in get_args(AnyController)},
        "Control laws of trials": {
            _law(model): _first_line(model.__doc__ or "") for model in get_args(AnyTrialController)
        },
    }


def _law(model: type) -> str:
    annotation = model.model_fields["law"].annotation  # type: ignore[attr-defined]
    return str(get_args(annotation)[0])


def _first_comment(path: Path) -> str:
    first = _first_line(path.read_text(encoding="utf-8"))
    return first.lstrip("# ").rstrip() if first.startswith("#") else ""


def _first_line(text: str) -> str:
    return text.partition("\n")[0]
