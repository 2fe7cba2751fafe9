"""The writer of TOML: what it writes reads back as the same value."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from cogless.study.toml import toml, toml_key


@pytest.mark.parametrize(
    "value",
    [
        True,
        -0.0,
        1e30,
        "60 rpm",
        'a "quoted" \\ text',
        "ü, 😀 and a line\nmore",
        "\x07\x7f\x80\u2028\U000e0001",
        {"a b": 1, "motor.R_s": "1 ohm", "ü": {}, "": [1, {"y z": ["x"]}]},
    ],
)
def test_a_value_reads_back(value: Any) -> None:
    line = f"value = {toml(value)}"
    assert line.isprintable() and tomllib.loads(line) == {"value": value}


def test_a_tuple_is_an_array() -> None:
    assert toml((1, (2.5, "x"))) == '[1, [2.5, "x"]]'


def test_a_key_reads_back() -> None:
    path = ("scenario", "my run", "override", "motor.R_s", "ü")
    assert toml_key(path) == 'scenario."my run".override."motor.R_s"."ü"'
    tables: Any = tomllib.loads(f"{toml_key(path)} = 1")
    for part in path:
        tables = tables[part]
    assert tables == 1
