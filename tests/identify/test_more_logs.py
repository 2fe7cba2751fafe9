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


KEYS = ("omega", "kind", "reference", "law")
BARE = frozenset[str]()
BY_LOGS = [(count, BARE) for count in range(2, len(ORDER) + 1)]
LOGS_THEN_KEYS = [*BY_LOGS, (len(ORDER), frozenset(KEYS))]
KEYS_THEN_LOGS = [(2, BARE), *((2, frozenset(KEYS[-n:])) for n in (2, 3, 4)), (len(ORDER), frozenset(KEYS))]


def columns(source: Any, motor: Any, keys: frozenset[str]) -> dict[str, Any]:
    """The file of columns with these of its further keys."""
    bare, whole = source.columns(motor), source.columns(motor, True)
    if "omega" in keys:
        bare["columns"]["omega"] = "omega"
    if "law" in keys:
        bare["controller"] = whole["controller"]
    for rule in whole["log"]:
        if "kind" not in keys and rule["kind"] != "load":
            del rule["kind"]
        if "law" not in keys:
            del rule["controller"]
        if "reference" not in keys:
            del rule["reference"]
    return bare | {"log": whole["log"]}


@pytest.mark.parametrize(
    ("kind", "order", "steps"),
    [
        ("servo", ORDER, LOGS_THEN_KEYS),
        ("drone", ORDER, LOGS_THEN_KEYS),
        ("hub", ("drives", "accel", "brakes", "fast", "slow", "middle"), BY_LOGS),
        ("gimbal", ("fast", "accel", "middle", "brakes", "slow", "drives"), BY_LOGS),
        ("servo", ("accel", "slow", "drives", "middle", "fast", "brakes"), KEYS_THEN_LOGS),
    ],
)
def test_no_value_is_lost_and_no_interval_doubled_by_more_logs_and_keys(
    kind: str, order: tuple[str, ...], steps: list[tuple[int, frozenset[str]]], tmp_path: Path
) -> None:
    """From two logs on, one log after the other, with references and a law in the end or from the start."""
    source = plant()
    motor = source.drawn(kind, np.random.default_rng(8))
    (raw,) = source.simulated([motor], seed=8)
    logs = {name: source.rows_of(raw[name], motor, 1000.0, 0.0) for name in order}
    before: dict[str, float] = {}
    for number, (count, keys) in enumerate(steps):
        folder = tmp_path / str(number)
        folder.mkdir()
        some = {name: logs[name] for name in order[:count]}
        paths = source.write(folder, some, plan.to_toml(columns(source, motor, keys)))
        after = errors(identified(paths, folder / "id.toml", lambda what, share: None).estimate)
        more = f"{order[count - 1]} with {sorted(keys)}"
        assert before.keys() <= after.keys(), f"{more} takes {before.keys() - after.keys()} away"
        for name, error in before.items():
            assert after[name] < DOUBLED * error, f"{more}: {name}"
        before = after
    assert {"j", "c", "b", f"cogging {motor.cogging[0][0]}"} <= before.keys()
