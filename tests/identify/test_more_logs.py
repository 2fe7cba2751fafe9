"""Logs and keys that are added take no value away and double no interval, on a plant of its own."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogless.identify import plan
from cogless.identify.command import identified
from cogless.identify.result import Estimate

PLANT = Path(__file__).parents[2] / "benchmarks/identify_plant.py"
ORDER = ("slow", "accel", "fast", "middle", "drives", "brakes")
DOUBLED = 2.0


def plant() -> Any:
    spec = importlib.util.spec_from_file_location("identify_plant", PLANT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def errors(made: Estimate) -> dict[str, float]:
    told = {key: made.values[key].error for key in ("j", "c", "b") if key in made.values}
    return told | {f"cogging {wave.order}": wave.size.error for wave in made.cogging}


@pytest.mark.parametrize("kind", ["servo", "drone"])
def test_no_value_is_lost_and_no_interval_doubled_by_more_logs_and_keys(kind: str, tmp_path: Path) -> None:
    """From a slow log and ramps on, one log after the other, and in the end with references and a law."""
    source = plant()
    motor = source.drawn(kind, np.random.default_rng(8))
    (raw,) = source.simulated([motor], seed=8)
    logs = {name: source.rows_of(raw[name], motor, 1000.0, 0.0) for name in ORDER}
    steps = [(count, False) for count in range(2, len(ORDER) + 1)] + [(len(ORDER), True)]
    before: dict[str, float] = {}
    for number, (count, every_key) in enumerate(steps):
        folder = tmp_path / str(number)
        folder.mkdir()
        some = {name: logs[name] for name in ORDER[:count]}
        paths = source.write(folder, some, plan.text(source.columns(motor, every_key)))
        after = errors(identified(paths, folder / "id.toml", lambda what, share: None).estimate)
        assert before.keys() <= after.keys(), f"{ORDER[count - 1]} takes {before.keys() - after.keys()} away"
        for name, error in before.items():
            assert after[name] < DOUBLED * error, f"{ORDER[count - 1]}: {name}"
        before = after
    assert {"j", "c", "b", f"cogging {motor.cogging[0][0]}"} <= before.keys()
