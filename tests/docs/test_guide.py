"""The guide's pages on studies have a table of every model, and say what the models say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest

from cogless.study import Study, TrialStudy
from cogless.study.base import Base
from cogless.study.table import Quantity, Table
from cogless.study.trial_study import EitherWay

GUIDE = Path(__file__).parents[2] / "docs" / "guide"


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


MODELS = models_within(Study, set()) | models_within(TrialStudy, set())
OF_CONTROLLERS = {inner for law in MODELS if issubclass(law, Base) for inner in models_within(law, set())}

# Numbers without a dimension, or with one that depends on what is designed.
RATIOS = {
    *(
        "forgetting",
        "q",
        "pole",
        "outlier",
        "depth",
        "gain_error",
        "weight",
        "order",
        "correlation",
        "share",
        "over",
        "ratio",
    ),
    *("K_s", "N", "K_3", "K_stab", "K_ilc", "change_weight", "learned_limit"),
    *("state_weight", "input_weight", "initial_state", "initial_change", "initial_error"),
    *("percent", "percent_peak_to_peak"),
}
# Read by their own validators, as quantities of what they are about.
OF_ANOTHER = {"range", "band", "floor", "limit", "initial", "lower", "upper"}
OF_ANOTHER |= {"uniform", "log", "normal", "corners", "keys"}
# A linear plant's numbers are in whatever units its matrices are, a library's in its own.
PLAIN = {"LinearPlant", "Parameter", "PlantVertex", "LibraryLaw"}


def parts(annotation: Any, metadata: Any = ()) -> Iterator[tuple[Any, Any]]:
    """(type, metadata) of every plain type in an annotation."""
    inner = get_args(annotation)
    if hasattr(annotation, "__metadata__"):
        yield from parts(inner[0], annotation.__metadata__)
    elif inner and get_origin(annotation) is not Literal:
        for part in inner:
            yield from parts(part, metadata)
    else:
        yield annotation, metadata


@pytest.mark.parametrize("model", sorted(MODELS, key=lambda m: f"{m.__module__}.{m.__name__}"))
def test_one_rule_for_plain_numbers(model: type[Table]) -> None:
    """A quantity takes a text with a unit; in a controller's tables, and only there, a plain number is SI."""
    for key, field in model.model_fields.items():
        for kind, metadata in parts(field.annotation, field.metadata):
            quantity = next((m for m in metadata if isinstance(m, Quantity)), None)
            if quantity is None and kind is float:
                assert key in RATIOS | OF_ANOTHER or model.__name__ in PLAIN, key
            elif quantity is not None and not isinstance(quantity, EitherWay):
                assert quantity.bare == (model in OF_CONTROLLERS), key


def test_every_table_is_on_the_page() -> None:
    text = (GUIDE / "study-file.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^```\{study-table\} [\w.]+\.(\w+)$", text, re.MULTILINE))
    assert {model.__name__ for model in models_within(Study, set())} - told == set()


@pytest.mark.parametrize("page", ["study-file", "trial-studies"])
def test_the_words_that_a_key_takes_are_those_that_are_told(page: str) -> None:
    """What stands in quotes, or as code, where a meaning is told is a word that the key takes, or a key."""
    text = (GUIDE / f"{page}.md").read_text(encoding="utf-8")
    keys = {key for model in MODELS for key in model.model_fields}
    for module, name, rows in re.findall(r"```\{study-table\} ([\w.]+)\.(\w+)\n(.*?)```", text, re.DOTALL):
        model = getattr(import_module(f"cogless.study.{module}"), name)
        for key, meaning in re.findall(r"^(\w+): (.*(?:\n  .*)*)", rows, re.MULTILINE):
            annotation = model.model_fields[key].annotation
            if get_origin(annotation) is Literal:
                choices = set(map(str, get_args(annotation)))
                told = {word.strip('"').rpartition(".")[2] for word in re.findall(r"`([^`=]+)`", meaning)}
                assert told <= choices | keys, f"{name}.{key}"


def test_the_frame_of_a_metric_is_told() -> None:
    text = (GUIDE / "metrics.md").read_text(encoding="utf-8")
    assert "\n## Frame\n" in text and "multiplied by the pole pairs" in text
