"""The exported example measures by the parts that simulated the study's sensor, and compiles."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.export.c.command import export_c
from cogless.study import load

STRICT = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-pedantic",
    "-Werror",
]
WORD = {"kind": "absolute", "bits": 14}
OBSERVER = {"speed_method": "observer", "observer_bandwidth": "400 Hz"}
CASES: list[tuple[dict[str, Any], dict[str, Any], list[str]]] = [
    ({"kind": "encoder", "lines": 2500}, {}, ["cgl_speed_count_step", "{.counts = 10000U, .window = 1U}"]),
    ({"kind": "encoder", "lines": 2500, "speed_method": "T"}, {}, ["last_interval = true", "board_timer"]),
    ({"kind": "encoder", "lines": 2500, "speed_method": "average", "window": 4}, {}, [".window = 4U"]),
    (WORD, {}, [".counts = 16384U, .range = 16384U, .absolute = true", ".window = 16U", "0 to 16383"]),
    (
        {**WORD, **OBSERVER},
        {"drive.speed_filter": "200 Hz"},
        ["cgl_angle_observer_step", "cgl_low_pass_step"],
    ),
    ({"kind": "resolver", "bits": 32}, {}, [".counts = 4294967295U"]),
    ({"kind": "hall", "edges": 3}, {}, [".pole_pairs = 4U, .edges = 3U", "board_hall()"]),
    ({"kind": "ideal"}, {"drive.speed_filter": "200 Hz"}, ["1256.637", "cgl_low_pass_init"]),
]


@pytest.mark.parametrize(("sensor", "more", "holds"), CASES)
def test_the_example_measures_as_simulated(
    sensor: dict[str, Any], more: dict[str, Any], holds: list[str], tmp_path: Path
) -> None:
    study = load(studies.write(tmp_path), {"drive.position_sensor": sensor, **more})
    export_c(study, "pi", tmp_path / "out")
    (example,) = (
        path for path in (tmp_path / "out").glob("*.c") if "measure_motion(&now)" in path.read_text()
    )
    text = example.read_text()
    assert [part for part in holds if part not in text] == []
    subprocess.run(["cc", *STRICT, "-fsyntax-only", example], cwd=tmp_path / "out", check=True)
    for header in ("low_pass.h", "hall.h", "encoder.h"):
        assert (f'"cogless/{header}"' in text) == (tmp_path / "out" / "cogless" / header).is_file()
