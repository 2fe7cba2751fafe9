"""Whatever a law's init in C refuses, the study refuses first, by the name of its key."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import pytest
import trial_studies
from laws import OF_SPEED, ROWS

import studies
from cogless.errors import StudyError
from cogless.run.drive_config import engine_config
from cogless.run.run_plan import compiled
from cogless.study import changed, load
from cogless.study.laws import AnyController
from cogless.study.laws.law import Commissioning
from cogless.study.laws.space import Period

MEMORIES = {"pi-ilc": ("angle", "time"), "robust-ilc": ("angle", "time")}
AWKWARD = (0.0, -1.0, 1e-60, 1e-42, 1e-20, 1e20, 1e39, 1e300, 1, 4, 65535, 65536, 2**33)
ELSEWHERE = {"k_pp", "turns"}  # checked with others


def cases(law: str) -> list[tuple[str, ...]]:
    """The keys of a law that hold a number."""
    (model,) = (m for m in get_args(AnyController) if get_args(m.model_fields["law"].annotation) == (law,))
    inner = {"calibration": Commissioning.model_fields, "period": Period.model_fields}
    words = {"law", "label", "baseline", "tuning", "memory", "delay_method", "index", "frame", "of"}
    keys = [(key, each) for key in inner if key in model.model_fields for each in inner[key]]
    keys += [(key,) for key in model.model_fields if key not in inner]
    return [key for key in keys if key[-1] not in words | ELSEWHERE]


def written(law: str, key: tuple[str, ...], value: float) -> Any:
    return f"{value} rad/s" if key[-1] in ("speed", "eta_bar", "omega_min") else value


@pytest.mark.parametrize("law", OF_SPEED)
def test_a_number_is_refused_by_its_key_or_taken_by_the_law(law: str, tmp_path: Path) -> None:
    base = studies.study(tmp_path)
    engine, refused = compiled(base), 0
    for memory in MEMORIES.get(law, ("map", "delay") if law.startswith("space") else (None,)):
        for key in cases(law):
            for value in AWKWARD:
                table = {**ROWS[law].keys, **({"memory": memory} if memory else {})}
                number = written(law, key, value)
                table[key[0]] = {**table.get(key[0], {}), key[1]: number} if len(key) == 2 else number
                try:
                    study = changed(base, {"controller.pi": table})
                except StudyError as error:
                    refused += 1
                    assert "controller.pi." in str(error), (key, value)
                else:
                    engine.Drive(engine_config(study, "low", "pi", "run"), None)
    assert refused > 0


def test_limits_that_come_from_the_drive(tmp_path: Path) -> None:
    for value in ("1e39 A", "1e-60 A"):
        with pytest.raises(StudyError, match=r"drive\.current_loop\.current_limit: .*single precision"):
            studies.study(tmp_path, {"drive.current_loop.current_limit": value})


@pytest.mark.parametrize(
    ("key", "value"), [("learned_limit", 1e-60), ("K_s", [1.0, 1e39, 1.0]), ("N", 1e39), ("K_3", 1e-60)]
)
def test_of_trials_too(key: str, value: Any, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=rf"controller\.ilc\.{key}: .*single precision"):
        load(trial_studies.write(tmp_path, trial_studies.DRIVE), {f"controller.ilc.{key}": value})
