"""The examples of the docs do what the docs say."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cogless

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(EXAMPLES, tmp_path / "examples"))


def ripple(results: cogless.Results, metric: str) -> dict[str, float]:
    values = {run.controller: run.metrics[metric] for run in results.runs}
    return {name: value[0] if isinstance(value, list) else value for name, value in values.items()}


def test_own_controllers_cancel_the_order_that_they_are_made_for(folder: Path) -> None:
    include = Path(cogless.__file__).parent / "include"
    command = ["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{include}"]
    subprocess.run([*command, "my_law.c", "-o", "my_law.so", "-lm"], cwd=folder, check=True)
    left = ripple(cogless.run_study(cogless.load(folder / "own_controller.toml")), "speed_order_rad_s")
    assert left["python"] < 0.1 * left["pi"]
    assert left["c"] < 0.1 * left["pi"]


def test_learning_lowers_the_ripple_of_the_smallest_study(folder: Path) -> None:
    left = ripple(cogless.run_study(cogless.load(folder / "smallest.toml")), "speed_ripple_rad_s")
    assert left["pi-ilc"] < 0.5 * left["pi"]


@pytest.mark.parametrize("script", ["batch.py", "rollout.py", "copied_state.py"])
def test_scripts_run(folder: Path, script: str) -> None:
    run = subprocess.run([sys.executable, script], cwd=folder, capture_output=True, text=True, check=True)
    expected = folder / Path(script).with_suffix(".txt")
    if expected.exists():
        assert run.stdout == expected.read_text()
