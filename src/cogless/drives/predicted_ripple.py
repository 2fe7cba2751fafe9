"""The identified motor under its drive's own law: its ripple without the drive's table and with it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cogless.drives import firmware_laws
from cogless.drives.adapter import TableFrame, TableText
from cogless.identify import plan
from cogless.run.simulate import run_study
from cogless.study.base import Source
from cogless.study.reading import checked, load
from cogless.units import RPM

RIPPLE_SPEEDS = (30, 120)  # r/min
# The share of the table that acts, by controller.
TABLE_SHARES = {"without": 0.0, "table": 1.0, "third": 0.3, "turned-third": -0.3}
RIPPLE_TURNS, RIPPLE_TIME_LEAST = (
    2,
    1.0,
)  # A run turns so far and lasts so long, s; its second half is measured.
TRACE_RATE = 5000.0  # Hz, at most
STUDY_NAME, LAW_FILE = "study.toml", Path(firmware_laws.__file__)


@dataclass(frozen=True)
class Ripple:
    """The ripple of the speed at one speed, r/min rms, by controller as in `TABLE_SHARES`."""

    speed: float  # r/min
    by_controller: Mapping[str, float]


def law_table(law: str, params: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a controller that runs a class of `firmware_laws`, found by the path of its file."""
    return {"law": "python", "object": f"{LAW_FILE}:{law}", "params": dict(params)}


def study_tables(folder: Path, frame: TableFrame, table: TableText, law: str) -> dict[str, Any]:
    """A study of the motor in a folder of identify, under the law of its drive at two speeds.

    `law`: the class of the law. StudyError: the folder has no study.
    """
    study = load(folder / STUDY_NAME)
    assert study.drive is not None
    identified, rate = study.source.tables, study.drive.rates.current_loop
    params = {**frame.gains, **table.table_params}
    durations = {
        speed: max(RIPPLE_TIME_LEAST, RIPPLE_TURNS * math.tau / (speed * RPM)) for speed in RIPPLE_SPEEDS
    }
    return {
        "title": f"{identified['title']}: ripple under the drive's own law, with and without table",
        "motor": {key: value for key, value in identified["motor"].items() if key != "datasheet"},
        "mechanics": identified["mechanics"],
        "drive": identified["drive"],
        "trace": {"rate": f"{rate / max(1, -(-rate // TRACE_RATE))!r} Hz"},
        "scenario": {
            f"at-{speed}-rpm": {
                "duration": f"{duration:g} s",
                "reference": f"{speed} rpm",
                "initial_speed": f"{speed} rpm",
            }
            for speed, duration in durations.items()
        },
        "controller": {
            name: {**law_table(law, {**params, "share": share}), "baseline": not share}
            for name, share in TABLE_SHARES.items()
        },
        "metric": [
            {
                "name": "ripple",
                "kind": "ripple-rms",
                "signal": "omega_m",
                "unit": "rpm",
                "scenarios": [f"at-{speed}-rpm"],
                "last": f"{duration / 2:g} s",
            }
            for speed, duration in durations.items()
        ],
    }


def write_study(stage: Path, tables: dict[str, Any]) -> None:
    """Write a study of `study_tables`, and the file of its law beside it."""
    (stage / STUDY_NAME).write_text(plan.to_toml(tables), "utf-8")
    place_law(stage)


def place_law(stage: Path) -> None:
    """Copy the file of the laws into a folder. If a study is there, it names this copy from now on."""
    shutil.copyfile(LAW_FILE, stage / LAW_FILE.name)
    path = stage / STUDY_NAME
    if path.is_file():
        path.write_text(path.read_text("utf-8").replace(f"{LAW_FILE}:", f"{LAW_FILE.name}:"), "utf-8")


def ripples(tables: dict[str, Any], path: Path) -> list[Ripple]:
    """Run the study of these tables. `path`: its file, for messages. StudyError: a run failed."""
    study = checked(Source(path, tables))
    measured: dict[str, dict[str, float]] = {}
    for run in run_study(study).runs:
        value = run.metrics["ripple_rad_s"]
        assert isinstance(value, float)
        measured.setdefault(run.scenario, {})[run.controller] = value / RPM
    return [Ripple(speed, measured[f"at-{speed}-rpm"]) for speed in RIPPLE_SPEEDS]
