"""The catalogue of `cogless new`: each figure has a range around it, and a source or the word guess."""

import re
import tomllib
from typing import Any

import pytest
import typer

from cogless.cli import app
from cogless.files import shipped
from cogless.starter.part_catalogue import DIMENSIONS, named_motors, parts
from cogless.starter.request import NUMBERS, names

KINDS = ("motors", "encoders", "drives")
WORDS = 12  # of the shortest source or rule, in characters


def figures(kind: str) -> list[tuple[str, dict[str, Any]]]:
    tables = tomllib.loads(shipped("parts")[kind].read_text(encoding="utf-8"))
    return [
        (f"{name}.{key}", value)
        for name, table in tables.items()
        if name != "named"
        for key, value in table.items()
        if isinstance(value, dict)
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_each_entry_of_the_catalogue_has_a_source_or_the_word_guess(kind: str) -> None:
    found = figures(kind)
    assert len(found) > 20
    for key, value in found:
        origin = [value[word] for word in ("source", "guess") if word in value]
        assert len(origin) == 1 and len(origin[0]) >= WORDS, key


@pytest.mark.parametrize("kind", KINDS)
def test_a_typical_value_lies_in_its_range(kind: str) -> None:
    for name, part in parts(kind).items():
        for key, figure in part.figures.items():
            assert 0 <= figure.low <= figure.typical <= figure.high, (name, key)
            assert key in DIMENSIONS or figure.high <= 1 or key in ("bits", "counts"), (name, key)


def test_shipped_motors_are_named_with_a_class_that_there_is() -> None:
    assert named_motors().keys() == shipped("motors").keys()
    for name, table in named_motors().items():
        assert table["class"] in parts("motors") and table["guess"], name


def test_rates_of_the_drives_divide_each_other() -> None:
    for name, drive in parts("drives").items():
        current, speed = drive["current_loop"].typical, drive["speed_loop"].typical
        assert current % speed == 0 and current % 1 == 0, name


def test_the_help_names_every_part_and_every_number() -> None:
    command = typer.main.get_command(app).commands["new"]  # type: ignore[attr-defined]
    options = {option: each for each in command.params for option in each.opts}
    for flag, kind in (("--motor", "motors"), ("--drive", "drives"), ("--encoder", "encoders")):
        for name in parts(kind):
            assert re.search(rf"\b{name}\b", options[flag].help), (flag, name)
    assert {f"--{flag}" for flag in NUMBERS} <= options.keys()
    for flag, number in NUMBERS.items():
        unit = number.unit.replace("rpm/V", "r/min").replace("rpm", "r/min").replace("V/rpm", "mV/rpm")
        said = options[f"--{flag}"].help
        assert flag == "back-emf" or unit in said or flag in ("rated-torque",), flag
    assert {*parts("motors"), *shipped("motors")} == names("motors").keys()
