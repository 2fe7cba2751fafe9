"""The exported example measures by the parts that simulated the study's sensor, and compiles."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.export.c.export_c import export_c
from cogless.study import load

WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic", "-Werror"]
WORD = {"kind": "absolute", "bits": 14}
OBSERVER = {"speed_method": "observer", "observer_bandwidth": "400 Hz"}
LINES = {"kind": "encoder", "lines": 2500}
FILTERED = {"drive.speed_filter": "200 Hz"}
SIMULATED = ", by the code that was simulated: `cogless/"
SAYS = "` says what this code measures"
CALLS = "; `measure_motion` in the example calls this code"
LOW_PASS = ", then through a low-pass of 200 Hz (`cogless/low_pass.h`)"
TABLE = {"drive.encoder_table": {"orders": [1, 20], "omega_min": "10 rev/s"}}
CORRECTED = ", of the angle without the sensor's own error (`cogless/encoder_table.h`)"
# sensor, other changes, what the example has, what the readme says of the speed
CASES: list[tuple[dict[str, Any], dict[str, Any], list[str], str]] = [
    (LINES, {},
        ["cgl_speed_count_step", "{.counts = 10000U, .window = 1U}", ".counts = 10000U, .range = 65536U}"],
        f"from an encoder of 2500 lines, 10000 counts{SIMULATED}speed_count.h{SAYS}{CALLS}"),
    ({**LINES, "speed_method": "T"}, {}, [".last_interval = true", "board_timer()", ".timer = 1e+08f",
        "cgl_speed_timed_init(&speed, &speed_config)"],
        f"from an encoder of 2500 lines, 10000 counts{SIMULATED}speed_timed.h{SAYS}{CALLS}"),
    ({**LINES, "speed_method": "average", "window": 4}, {}, [".window = 4U", "count_before[4]",
        "cgl_speed_count_init(&speed, &speed_config, 6.666667e-05f, count_before, 4U)"],
        f"from an encoder of 2500 lines, 10000 counts{SIMULATED}speed_count.h{SAYS}{CALLS}"),
    (WORD, {}, [".counts = 16384U, .range = 16384U, .absolute = true", ".window = 16U", "0 to 16383"],
        f"from an absolute encoder of 16384 counts{SIMULATED}speed_count.h{SAYS}{CALLS}"),
    ({**WORD, **OBSERVER}, FILTERED,
        ["cgl_angle_observer_step", "cgl_low_pass_step", ".bandwidth = 2513.2742f", ".bandwidth = 1256.637"],
        f"from an absolute encoder of 16384 counts{SIMULATED}angle_observer.h{SAYS}{LOW_PASS}{CALLS}"),
    (LINES, TABLE, ["cgl_encoder_table_step(&table, now, controller.drive.i_q, true);",
        "const cgl_real mean = cgl_speed_count_step(&speed, encoder.count);",
        "omega_m = cgl_encoder_table_speed(&table, mean, speed.time);",
        "cgl_encoder_table_init(&table, &table_config, 6.666667e-05f)", ".order = {1, 20}"],
        f"from an encoder of 2500 lines, 10000 counts{SIMULATED}speed_count.h{SAYS}{CORRECTED}{CALLS}"),
    ({**LINES, "speed_method": "MT"}, TABLE,
        ["const cgl_real mean = cgl_speed_timed_step(&speed, &edges, board_timer());",
        "omega_m = cgl_encoder_table_speed(&table, mean, speed.time);"],
        f"from an encoder of 2500 lines, 10000 counts{SIMULATED}speed_timed.h{SAYS}{CORRECTED}{CALLS}"),
    (WORD, TABLE,
        ["static cgl_real omega_m;", "cgl_encoder_table_speed(&table, mean, speed.time);", "0 to 16383"],
        f"from an absolute encoder of 16384 counts{SIMULATED}speed_count.h{SAYS}{CORRECTED}{CALLS}"),
    ({**WORD, **OBSERVER}, {**FILTERED, **TABLE},
        ["cgl_angle_observer_step(&speed, cgl_encoder_table_turns(&table, encoder.turns));"],
        f"from an absolute encoder of 16384 counts{SIMULATED}angle_observer.h{SAYS}"
        f"{CORRECTED}{LOW_PASS}{CALLS}"),
    ({"kind": "resolver", "bits": 32}, {}, [".counts = 4294967295U", "0 to 4294967294"],
        f"from a resolver of 4294967296 counts{SIMULATED}speed_count.h{SAYS}{CALLS}"),
    ({"kind": "hall", "edges": 3}, {},
        [".pole_pairs = 4U, .edges = 3U", "board_hall()", "cgl_hall_init(&hall, &hall_config)"],
        f"from Hall sensors{SIMULATED}hall.h{SAYS}{CALLS}"),
    ({"kind": "ideal"}, FILTERED,
        ["1256.637", "cgl_low_pass_init(&speed_filter, &filter_config, 6.666667e-05f)"],
        f"measured as in the study, by an ideal sensor{LOW_PASS}. So the gains and `.speed_window` allow "
        f"for no delay of a real sensor: to change this, put your sensor into the study and export again"),
]  # fmt: skip


@pytest.mark.parametrize(("sensor", "more", "holds", "says"), CASES)
def test_the_example_measures_as_simulated(
    sensor: dict[str, Any], more: dict[str, Any], holds: list[str], says: str, tmp_path: Path
) -> None:
    study = load(studies.write(tmp_path), {"drive.position_sensor": sensor, **more})
    export_c(study, "pi", tmp_path / "out")
    (example,) = (
        path for path in (tmp_path / "out").glob("*.c") if "measure_motion(&now)" in path.read_text()
    )
    text = example.read_text()
    assert [part for part in holds if part not in text] == []
    readme = (tmp_path / "out" / "README.md").read_text()
    assert f"| `omega_m` | rad/s, {says} |\n" in readme
    subprocess.run(
        ["cc", "-std=c99", *WARNINGS, "-DCOGLESS_NO_GUARD", "-fsyntax-only", example],
        cwd=tmp_path / "out",
        check=True,
    )
    for header in ("low_pass.h", "hall.h", "encoder.h"):
        assert (f'"cogless/{header}"' in text) == (tmp_path / "out" / "cogless" / header).is_file()
