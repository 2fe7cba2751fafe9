"""Studies as `cogless new` writes them, from names and numbers."""

import sys
from pathlib import Path

import pytest

from cogless.starter import Draft, Request, draft, parse_number
from cogless.study import Study, load

OWN = {"pole-pairs": "7", "kv": "80", "resistance": "0.5"}


def request(motor: str, drive: str, encoder: str, **numbers: object) -> Request:
    given = {key.replace("_", "-"): str(value) for key, value in numbers.items()}
    if motor == "own":
        given = {**OWN, **given}
    return Request(motor, drive, encoder, {flag: parse_number(flag, text) for flag, text in given.items()})


def drafted_by_rules(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drafts have the settings of the rules, not better ones by runs."""
    monkeypatch.setattr(sys.modules[draft.__module__], "better_settings", lambda *_: {})


def written(folder: Path, of: Request) -> tuple[Draft, Study]:
    """The draft, and the study read back from its file."""
    path = folder / "mine.toml"
    made = draft(of, "Mine", path)
    path.write_text(made.text, encoding="utf-8")
    study = load(path)
    assert isinstance(study, Study)
    return made, study
