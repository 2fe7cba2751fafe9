"""A key that another key excludes: the one line says which, where both are from, and how to delete it."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from commands import cogless

import studies
from cogless.errors import StudyError
from cogless.study import load
from cogless.study.reading import changes_from
from cogless.study.toml import toml

OBSERVER = {"kind": "encoder", "lines": 1024, "speed_method": "observer", "observer_bandwidth": "200 Hz"}
WINDOW = {"kind": "encoder", "lines": 1024, "speed_method": "average", "window": 8}
BITS = {"kind": "absolute", "bits": 14}
SENSOR = "drive.position_sensor"
DELETION = re.compile(r"--set (\S+=) to delete")


def study_with(folder: Path, sensor: Mapping[str, Any] | None) -> Path:
    """The small study with another position sensor."""
    text = studies.BASE if sensor is None else f"{studies.BASE}[{SENSOR}]\n"
    return studies.write(folder, text + "".join(f"{k} = {toml(v)}\n" for k, v in (sensor or {}).items()))


@pytest.mark.parametrize(
    ("in_file", "change", "gone"),
    [
        (OBSERVER, f"{SENSOR}.speed_method=MT", [f"{SENSOR}.observer_bandwidth"]),
        (WINDOW, f"{SENSOR}.speed_method=M", [f"{SENSOR}.window"]),
        (BITS, f"{SENSOR}.positions=10000", [f"{SENSOR}.bits"]),
        (
            OBSERVER,
            f"{SENSOR}.kind=hall",
            [f"{SENSOR}.{key}" for key in ("lines", "speed_method", "observer_bandwidth")],
        ),
        (None, "drive.current_loop.kind=ideal", ["drive.current_loop.bandwidth", "drive.inverter"]),
        (None, "drive.rates.position_loop=1 kHz", ["drive.rates.speed_loop"]),
    ],
)
def test_the_line_gives_the_option_that_deletes_the_file_s_key(
    in_file: Mapping[str, Any] | None, change: str, gone: list[str], tmp_path: Path
) -> None:
    path = study_with(tmp_path, in_file)
    options, deleted = [change], []
    for _ in range(4):
        try:
            load(path, changes_from(options))
            break
        except StudyError as error:
            lines = [line for line in error.mistakes if "no such key" in line]
            if not lines:  # another mistake: the study is of trials now
                break
            for line in lines:
                assert line.startswith(f"{path}: ") and "from the file" in line and "from --set" in line
                option = DELETION.search(line)
                assert option is not None, line
                deleted.append(option[1].removesuffix("="))
                options.append(option[1])
    assert deleted == gone


def test_a_key_and_its_rival_from_one_place_name_no_place(tmp_path: Path) -> None:
    both = {**OBSERVER, "speed_method": "MT"}
    with pytest.raises(StudyError, match=r'set speed_method = "observer"$'):
        load(study_with(tmp_path, both))
    with pytest.raises(StudyError, match=r'set speed_method = "observer"$'):
        load(studies.write(tmp_path), {SENSOR: both})


def test_an_override_cannot_delete_but_replace(tmp_path: Path) -> None:
    path = study_with(tmp_path, OBSERVER)
    override = {f"{SENSOR}.speed_method": "MT"}
    with pytest.raises(StudyError) as refused:
        load(path, {"scenario.low.override": override})
    line = str(refused.value)
    assert "observer_bandwidth is from the file, speed_method from the override" in line
    assert line.endswith(f"write all of table {SENSOR} except observer_bandwidth into the override")
    whole = {
        key: value for key, value in {**OBSERVER, "speed_method": "MT"}.items() if "bandwidth" not in key
    }
    load(path, {"scenario.low.override": {SENSOR: whole}})


def test_a_command_deletes_a_key_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = study_with(tmp_path, OBSERVER)
    method = ("--set", f"{SENSOR}.speed_method=MT")
    code, _, line = cogless(capsys, "design", path, *method)
    assert code == 2 and line.count("\n") == 1 and 'since speed_method = "MT"' in line
    option = DELETION.search(line)
    assert option is not None
    code, out, err = cogless(capsys, "design", path, "--json", *method, "--set", option[1])
    assert code == 0 and json.loads(out)
    assert f"Deleted for this command: {SENSOR}.observer_bandwidth" in err
    code, _, err = cogless(capsys, "design", path, "--set", "drive.guard=")
    assert code == 2 and "drive.guard: missing: expected a key of the file" in err
