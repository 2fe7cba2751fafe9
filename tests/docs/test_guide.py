"""The guide's pages on studies have a table of every model, and say what the models say."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest

from cogless.design.ripple import HARMFUL_RATIO
from cogless.design.speed_loop import BELIEF_FACTORS
from cogless.study import Study, TrialStudy
from cogless.study.base import Base
from cogless.study.position_sensor import Absolute, Encoder
from cogless.study.table import Quantity, Table
from cogless.study.trial_study import EitherWay

GUIDE = Path(__file__).parents[2] / "docs" / "guide"


PAGES = [*(GUIDE.parent / "reference").glob("*.md"), GUIDE / "command-line.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_with_tables_of_keys_says_at_its_top_where_they_are_before_the_docs_are_built(
    page: Path,
) -> None:
    """The tables are made from models: the note links each of their files."""
    text = page.read_text(encoding="utf-8")
    modules = re.findall(r"^```\{study-table\} (.*)\.[A-Z]\w*$", text, re.MULTILINE)
    note = text.split("\n\n")[1]
    assert note.startswith("*Without `make docs`") is bool(modules or "```{command}" in text)
    linked = [page.parent / link for link in re.findall(r"\]\((.*?)\)", note)] if modules else []
    files = [GUIDE.parents[1] / "src" / "cogless" / "study" / f"{m.replace('.', '/')}.py" for m in modules]
    assert all(link.exists() for link in linked)
    assert all(any(file.samefile(p) or file.parent.samefile(p) for p in linked) for file in files)


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
        "forgetting", "q", "pole", "outlier", "depth", "gain_error", "weight", "order", "correlation",
        "share", "over", "ratio",
    ),
    *("K_s", "N", "K_3", "K_stab", "K_ilc", "change_weight", "learned_limit"),
    *("state_weight", "input_weight", "initial_state", "initial_change", "initial_error"),
    *("percent", "percent_peak_to_peak"),
    *("voltage_share", "damping_ratio", "rate_error"),
}  # fmt: skip
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


REFERENCE = GUIDE.parent / "reference"


def test_every_table_is_in_the_reference_once() -> None:
    pages = "\n".join(path.read_text(encoding="utf-8") for path in sorted(REFERENCE.glob("*.md")))
    shown = re.findall(r"^```\{study-table\} [\w.]+\.(\w+)$", pages, re.MULTILINE)
    assert len(shown) == len(set(shown))
    assert {model.__name__ for model in MODELS} - set(shown) == set()


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> Callable[[type[Table]], dict[str, str]]:
    """The meanings of a model's keys, as the docs have them."""
    monkeypatch.syspath_prepend(str(GUIDE.parent / "_ext"))
    return import_module("meanings").meanings  # type: ignore[no-any-return]


@pytest.mark.parametrize("model", sorted(MODELS, key=lambda m: f"{m.__module__}.{m.__name__}"))
def test_every_key_has_a_meaning_of_whole_sentences(
    model: type[Table], texts: Callable[[type[Table]], dict[str, str]]
) -> None:
    for key, text in texts(model).items():
        assert text.endswith("."), key
        assert not re.search(r"\b(likewise|as above|see below)\b", text, re.IGNORECASE), key


def test_a_key_declared_anew_has_its_own_meaning(texts: Callable[[type[Table]], dict[str, str]]) -> None:
    assert texts(Absolute)["latency"] == texts(Encoder)["latency"]
    assert texts(Absolute)["speed_method"] != texts(Encoder)["speed_method"]


def test_the_words_that_a_key_takes_are_those_of_its_meaning(
    texts: Callable[[type[Table]], dict[str, str]],
) -> None:
    """What stands as code where a meaning is told is a word that the key takes, or a key, law or metric."""
    words = {key for model in MODELS for key in model.model_fields}
    words |= {str(word) for model in MODELS for key in ("law", "kind") for word in choices(model, key)}
    for model in MODELS:
        for key, meaning in texts(model).items():
            own = set(map(str, choices(model, key)))
            if own:
                used = {word.strip('"').rpartition(".")[2] for word in re.findall(r"`([^`=]+)`", meaning)}
                assert used <= own | words, f"{model.__name__}.{key}"


def choices(model: type[Table], key: str) -> tuple[Any, ...]:
    field = model.model_fields.get(key)
    return get_args(field.annotation) if field and get_origin(field.annotation) is Literal else ()


def test_the_frame_of_a_metric_is_told() -> None:
    text = (GUIDE / "metrics.md").read_text(encoding="utf-8")
    assert "\n## Frame\n" in text and "multiplied by the pole pairs" in " ".join(text.split())


def test_no_line_of_a_page_is_taken_for_a_comment() -> None:
    """MyST drops a line that begins with %, and the rest of its paragraph stands alone."""
    for path in GUIDE.parent.rglob("*.md"):
        if "_build" not in path.parts:
            text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
            assert not re.search(r"^ *%", text, re.MULTILINE), path


def test_the_page_gives_the_bounds_beyond_which_an_answer_is_not_sure() -> None:
    lines = (GUIDE / "command-line.md").read_text("utf-8").splitlines()
    (row,) = (line for line in lines if line.startswith("| not sure |"))
    assert f"more than {HARMFUL_RATIO:g} times the ripple (rms) of the feedback alone" in row
    assert f"less than {min(BELIEF_FACTORS):g} or more than {max(BELIEF_FACTORS):g}" in row
