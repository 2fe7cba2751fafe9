"""The examples of the docs do what the docs say."""

from __future__ import annotations

import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cogless

EXAMPLES = Path(__file__).parents[2] / "examples"


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
    results = cogless.run_study(cogless.load(folder / "own_controller.toml"))
    left = ripple(results, "speed_order_rad_s")
    assert left["python"] == left["c"] < 0.1 * left["pi"]
    for run in results.runs[1:]:
        assert run.map is not None
        (folder / f"{run.controller}.bin").write_bytes(bytes(run.map))
    assert (folder / "python.bin").read_bytes() == (folder / "c.bin").read_bytes()
    start = {"controller.python.start.map": "c.bin", "controller.c.start.map": "python.bin"}
    again = cogless.run_study(cogless.load(folder / "own_controller.toml", start))
    first, then = (ripple(made, "first_order_rad_s") for made in (results, again))
    assert then["python"] == then["c"] < 0.1 * first["c"]


def test_learning_lowers_the_ripple_of_the_smallest_study(folder: Path) -> None:
    left = ripple(cogless.run_study(cogless.load(folder / "smallest.toml")), "speed_ripple_rad_s")
    assert left["pi-ilc"] < 0.5 * left["pi"]


RECORDS = ("static_holding_current.csv", "speed_test1_500Hz.csv.gz")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["identify_cogging.py"], "the following arguments are required: folder"),
        (["identify_cogging.py", "."], f"[Errno 2] No such file or directory: '{RECORDS[0]}'"),
        (["identify_cogging.py", "batch.py"], f"[Errno 20] Not a directory: 'batch.py/{RECORDS[0]}'"),
        (["identify_cogging.py", "other"], f"other/{RECORDS[0]}: expected the columns dir, iq_A, theta_rad"),
        (["identify_cogging.py", "empty"], f"empty/{RECORDS[0]}: expected the columns dir, iq_A, theta_rad"),
        (["identify_cogging.py", "words"], f"words/{RECORDS[0]}: expected 100 or more rows of numbers"),
        (["identify_cogging.py", "unpacked"], "Not a gzipped file"),
        (["co_simulation.py", "."], "./pi-ilc-drive-fmi3.fmu: no such FMU: cogless export --to fmu makes it"),
        (["co_simulation.py", ".", "--seconds=-1"], "--seconds: -1.0: expected a time above zero"),
        (["co_simulation.py", ".", "--seconds=nan"], "--seconds: nan: expected a time above zero"),
    ],
)
def test_a_wrong_input_is_told(
    folder: Path,
    arguments: list[str],
    line: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = "\n".join(f"{n / 100},0.1,{n % 2}" for n in range(200))
    records = {"other": "a,b\n1,2\n", "empty": "", "words": "theta_rad,iq_A,dir\n1,x,1\n"}
    for name, text in {**records, "unpacked": f"theta_rad,iq_A,dir\n{rows}\n"}.items():
        (folder / name).mkdir()
        (folder / name / RECORDS[0]).write_text(text)
        (folder / name / RECORDS[1]).write_text(text)
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as end:
        runpy.run_path(arguments[0], run_name="__main__")
    assert end.value.code == 2
    assert line in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("script", ["batch.py", "rollout.py", "copied_state.py"])
def test_scripts_run(
    folder: Path, script: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    runpy.run_path(script, run_name="__main__")
    expected = folder / Path(script).with_suffix(".txt")
    if expected.exists():
        assert capsys.readouterr().out == expected.read_text()
