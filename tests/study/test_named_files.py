"""The files that a study names are found by the types of its keys."""

import os
import tomllib
from collections.abc import Iterator
from typing import Any

from cogless.files import shipped
from cogless.study import Study, TrialStudy, load
from cogless.study.named_files import named_files

TEXT = """
title = "notes"
description = "notes"
[motor]
datasheet = "sheet.toml"
cogging_table = { file = "cogging.csv", frame = "mechanical" }
back_emf_table.file = "voltage.csv"
saturation.q.file = "flux.csv"
[mechanics]
friction_table.file = "friction.csv"
load.angle_table.file = "load.csv"
[drive]
position_sensor = { kind = "encoder", error_table = "error.csv" }
[scenario.low]
duration = "notes"
reference = { file = "speed.csv" }
load.angle_table = { file = "heavy.csv" }
[scenario.low.override]
motor.cogging_table.file = "nested.csv"
"mechanics.friction_table.file" = "dotted.csv"
[controller.own]
law = "python"
object = "sub:way/law.py:Law"
label = "notes"
params = { file = "notes", list = ["notes"] }
[controller."a.b"]
law = "library"
library = "law.so"
[controller.list]
law = "pi-ilc"
start.map = "map.bin"
[controller.table]
law = "pi-ilc"
start = { table = "start.csv", sign = "holding" }
[[metric]]
name = "notes"
[vary]
controller.list.start.map = { list = ["one.bin", "two.bin"] }
"controller.table.start" = { list = [{ table = "three.csv" }] }
scenario.low.override."motor.cogging_table.file" = { list = ["four.csv"] }
mechanics.inertia = { uniform = "20 %" }
"""
EXPECTED = [
    *("sheet.toml", "cogging.csv", "voltage.csv", "flux.csv", "friction.csv", "load.csv", "error.csv"),
    *("speed.csv", "heavy.csv", "nested.csv", "dotted.csv", "sub:way/law.py", "law.so", "map.bin"),
    *("start.csv", "one.bin", "two.bin", "three.csv", "four.csv"),
]


def test_every_key_of_a_file_is_found_and_no_other_text() -> None:
    tables = tomllib.loads(TEXT)
    found = named_files(Study, tables)
    assert sorted(file.path for file in found) == sorted(EXPECTED)
    for file in found:  # its key leads to it
        value: Any = tables
        for part in file.key:
            value = value[part]
        assert value == file.path + file.rest
    assert [file.rest for file in found if file.rest] == [":Law"]


def test_a_shipped_datasheet_is_no_file_of_the_study() -> None:
    name = next(iter(shipped("motors")))
    assert named_files(Study, {"motor": {"datasheet": name}}) == []


def test_trials_name_files_too() -> None:
    changes = {"override": {"mechanics": {"friction_table": {"file": "late.csv"}}}}
    tables = {
        "scenario": {"low": {"changes": [changes], **changes}},
        "controller": {"own": {"law": "library", "library": "law.so"}},
    }
    assert [file.path for file in named_files(TrialStudy, tables)] == ["late.csv", "late.csv", "law.so"]


def texts(value: Any) -> Iterator[str]:
    if isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from texts(inner)
    elif isinstance(value, str):
        yield value


def test_the_shipped_studies_name_no_file_at_another_key() -> None:
    """Met from the other side: every text that is a file's path there is found by its key."""
    count = 0
    for path in shipped("studies").values():
        if "law" in tomllib.loads(path.read_text()):
            continue  # an arena
        study = load(path)
        tables, folder = study.source.tables, path.parent
        paths = {text.rpartition(":")[0] if ".py:" in text else text for text in texts(tables)}
        beside = {text for text in paths if text and os.path.isfile(folder / text)}
        found = {file.path for file in named_files(type(study), tables)}
        assert beside == {name for name in found if os.path.isfile(folder / name)}
        count += len(beside)
    assert count > 1
