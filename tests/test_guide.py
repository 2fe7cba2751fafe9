"""The guide's page on the study file has a table of every model that a study of speed is made of."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

from cogless.study import Study
from cogless.study.table import Table

GUIDE = Path(__file__).parents[1] / "docs" / "guide"


def models_within(entry: Any, found: set[type[Table]]) -> set[type[Table]]:
    """The models of a type, and of their fields."""
    if isinstance(entry, type) and issubclass(entry, Table):
        if entry not in found:
            found.add(entry)
            for field in entry.model_fields.values():
                models_within(field.annotation, found)
    else:
        for inner in get_args(entry):
            models_within(inner, found)
    return found


def test_every_table_is_on_the_page() -> None:
    text = (GUIDE / "study-file.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^```\{study-table\} \w+\.(\w+)$", text, re.MULTILINE))
    assert {model.__name__ for model in models_within(Study, set())} - told == set()


def test_the_frame_of_a_metric_is_told() -> None:
    text = (GUIDE / "metrics.md").read_text(encoding="utf-8")
    assert "\n## Frame\n" in text and "multiplied by the pole pairs" in text
