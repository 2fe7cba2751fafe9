"""Noise of linear plants, and starts and loads that differ at random from trial to trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from trial_studies import DRIVE, LINEAR

from cogless import run_study
from cogless.errors import StudyError
from cogless.report.trial_case import case
from cogless.results import TrialResults
from cogless.study import load

MOVE, CYCLE = "scenario.move", "scenario.cycle"
MASK = (1 << 64) - 1
STEP = 0x9E3779B97F4A7C15


def split_mix(seed: int, count: int) -> list[int]:
    """Steele, Lea, Flood: Fast splittable pseudorandom number generators, 2014."""
    numbers = []
    for n in range(1, count + 1):
        z = (seed + n * STEP) & MASK
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
        numbers.append(z ^ (z >> 31))
    return numbers


def uniforms(seed: int, trials: int, count: int) -> np.ndarray:
    """In [-1, 1], of each trial's own stream."""
    seeds = split_mix(seed ^ 0x747269616C73, trials)
    return np.array([[2 * ((n >> 11) + 1) * 2.0**-53 - 1 for n in split_mix(s, count)] for s in seeds])


def run(folder: Path, changes: dict[str, Any], text: str = DRIVE, jobs: int = 1) -> TrialResults:
    results = run_study(trial_studies.loaded(folder, changes, text), jobs=jobs)
    assert isinstance(results, TrialResults)
    return results


def test_a_drive_starts_each_trial_elsewhere(tmp_path: Path) -> None:
    """Uniform deviations are those of a transcription of the generator; all controllers get the same."""
    spread = {"initial_angle": "0.05 rad", "initial_speed": "2 rad/s", "load": "0.2 N*m"}
    changes = {f"{MOVE}.each_trial.uniform": spread, "seed": 99, f"{MOVE}.initial_speed": "1 rad/s"}
    results = run(tmp_path, changes)
    deviations = uniforms(99, 12, 3) * (0.05, 2.0, 0.2)
    for found in results.runs:
        trace = found.trace
        assert trace["theta_m"].reshape(12, 200)[:, 0] == pytest.approx(deviations[:, 0], abs=1e-15)
        assert trace["omega_m"].reshape(12, 200)[:, 0] == pytest.approx(1 + deviations[:, 1], abs=1e-14)
        loads = trace["tau_load"].reshape(12, 200)
        steps = np.where(np.arange(12) < 4, 0.0, 0.5)
        assert loads[:, 1] == pytest.approx(deviations[:, 2], abs=1e-15)
        assert loads[:, -1] == pytest.approx(deviations[:, 2] + steps, abs=1e-15)
    assert np.array_equal(results.runs[0].trace.data, run(tmp_path, changes, jobs=2).runs[0].trace.data)


def test_a_change_changes_how_trials_differ_but_not_the_draws(tmp_path: Path) -> None:
    changes = {
        f"{MOVE}.each_trial": {"normal": {"initial_angle": "0.01 rad"}},
        f"{MOVE}.changes.0.each_trial": {"normal": {"initial_angle": "0.03 rad"}},
        f"{MOVE}.changes.1.each_trial": {},
    }
    starts = run(tmp_path, changes).runs[0].trace["theta_m"].reshape(12, 200)[:, 0]
    same = run(tmp_path, {f"{MOVE}.each_trial": {"normal": {"initial_angle": "0.01 rad"}}})
    draws = same.runs[0].trace["theta_m"].reshape(12, 200)[:, 0]
    assert starts == pytest.approx(draws * ([1] * 4 + [3] * 4 + [0] * 4), abs=1e-15)
    assert len(set(draws)) == 12


def test_normal_starts_and_loads_of_a_linear_plant(tmp_path: Path) -> None:
    """Their mean and spread over 2000 trials, and that neither follows the other."""
    changes = {
        f"{CYCLE}.trials": 2000,
        f"{CYCLE}.duration": "1 s",
        f"{CYCLE}.reference": [["0 s", 0], ["0.4 s", 0.1]],
        f"{CYCLE}.load_steps": [],
        f"{CYCLE}.changes": [],
        f"{CYCLE}.initial_state": [0.5, 0],
        f"{CYCLE}.each_trial.normal": {"initial_state": [0.2, 0], "load": 0.3},
        "controller.ilc.learning": False,
    }
    (found,) = run(tmp_path, changes, LINEAR).runs
    x_1, x_2, loads = (found.trace[name].reshape(2000, 10)[:, 0] for name in ("x_1", "x_2", "load"))
    for draws, mean, spread in ((x_1, 0.5, 0.2), (loads, 0.0, 0.3)):
        assert abs(np.mean(draws) - mean) < 5 * spread / np.sqrt(2000)
        assert np.std(draws) == pytest.approx(spread, rel=5 / np.sqrt(4000))
        assert abs(np.corrcoef(draws[1:], draws[:-1])[0, 1]) < 5 / np.sqrt(2000)
    assert not np.any(x_2)
    assert abs(np.corrcoef(x_1, loads)[0, 1]) < 5 / np.sqrt(2000)


@pytest.mark.parametrize(
    "changes",
    [
        {"plant.noise": [0.0, 0.05]},
        {"plant.load_noise": 0.5},
        {f"{CYCLE}.each_trial.normal.initial_state": [0.3, 0.1]},
    ],
)
def test_what_is_learned_stands_beside_all_trials_without_learning(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    """Where trials differ at random one without learning says little: as many run as with learning."""
    results = run(tmp_path, {**changes, f"{CYCLE}.trials": 40}, LINEAR)
    quiet = run(tmp_path, {f"{CYCLE}.trials": 40}, LINEAR)
    trace, one_each = results.runs[0].feedback, quiet.runs[0].feedback
    assert trace is not None and one_each is not None
    assert (len(trace), len(one_each)) == (40 * 50, 2 * 50)
    about = case(results, results.runs)
    assert about is not None
    of_trials = np.sqrt(np.mean((trace["y_ref"] - trace["y"]).reshape(40, 50) ** 2, axis=1))
    first, later = of_trials[1:3], of_trials[22:]
    settled = [np.sqrt(np.mean(trials**2)) for trials in (first, later)]
    assert about.feedback["ilc"] == pytest.approx(settled, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "changes", "line"),
    [
        (DRIVE, {f"{MOVE}.each_trial.normal.initial_state": [0.1, 0.1]},
            "initial_state: {value}: expected no such key, since the plant is a drive: delete initial_state, "
            "or give initial_angle and initial_speed in its place; initial_state is from --set, drive from "
            "the file"),
        (LINEAR, {f"{CYCLE}.each_trial.normal.initial_angle": "0.1 rad"},
            "initial_angle: {value}: expected no such key, since the plant is linear: delete initial_angle, "
            "or give initial_state in its place; initial_angle is from --set, plant from the file"),
        (LINEAR, {f"{CYCLE}.each_trial.normal.initial_state": [0.1]},
            "initial_state: {value}: expected 2 numbers, one for each state"),
        (LINEAR, {f"{CYCLE}.each_trial.uniform.load": "1 N*m"},
            "load: {value}: expected a number in the unit of u"),
        (DRIVE, {f"{MOVE}.each_trial.uniform.load": 1.0},
            'load: {value}: expected a torque with a unit, such as "0.1 N*m"'),
        (DRIVE, {f"{MOVE}.each_trial.uniform.load": "-1 N*m"},
            'load: {value}: expected a torque of zero or more, such as "1 N*m"'),
        (DRIVE, {f"{MOVE}.each_trial.normal.initial_angle": "0.7 rad"},
            "initial_angle: {value}: expected deviations that keep the start less than half a turn from "
            "where the reference begins, "
            "0 rad: the sensor doesn't count turns"),
        (LINEAR, {"plant.noise": [0.1]}, "plant.noise: {value}: expected 2 numbers, one for each state"),
        (LINEAR, {"plant.load_noise": -1.0}, "plant.load_noise: {value}: expected a number of 0 or more"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, text: str, changes: dict[str, Any], line: str) -> None:
    ((key, value),) = changes.items()
    with pytest.raises(StudyError) as error:
        load(trial_studies.write(tmp_path, text), changes)
    shown = f'"{value}"' if isinstance(value, str) else str(value)
    key_and_text = line.format(value=shown)
    assert str(error.value).endswith(key_and_text)
    assert f"{key}: " in str(error.value)


def test_a_key_has_one_form(tmp_path: Path) -> None:
    both = {"normal": {"load": "1 N*m"}, "uniform": {"load": "1 N*m"}}
    with pytest.raises(
        StudyError, match=r"each_trial.uniform.load: .*expected no such key, since normal.load is given"
    ):
        trial_studies.loaded(tmp_path, {f"{MOVE}.each_trial": both})


def test_fast_starts_need_short_steps(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path, {f"{MOVE}.each_trial.normal.initial_speed": "10 rad/s"})
    assert study.top_speed("move") == pytest.approx(50.0)
