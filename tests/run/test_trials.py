"""Runs of studies of trials: what is simulated is what the study says, and nothing finished is lost."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from click.testing import Result
from trial_studies import DRIVE, LINEAR
from typer.testing import CliRunner

from cogless import run_study
from cogless.cli import app
from cogless.design.kinds import DESIGNS
from cogless.design.trials.from_study import design_study
from cogless.errors import StudyError
from cogless.export.prepared import prepare
from cogless.live.description import left_out, page_runs
from cogless.report import verdicts
from cogless.results import TrialResults
from cogless.results.results_json import to_dict
from cogless.run.simulate import RunError, rollout, simulate
from cogless.study import load


def run(folder: Path, changes: dict[str, Any] | None = None, text: str = DRIVE) -> TrialResults:
    results = run_study(trial_studies.loaded(folder, changes, text), jobs=2)
    assert isinstance(results, TrialResults)
    return results


def test_learning_lowers_the_error_that_feedback_leaves(tmp_path: Path) -> None:
    fine = {"drive.position_sensor.bits": 20}
    error = {r.controller: r.metrics["error_rad"] for r in run(tmp_path, fine).runs}
    learned, feedback = error["ilc"], error["feedback"]
    assert isinstance(learned, list) and isinstance(feedback, list)
    assert len(learned) == len(feedback) == 12
    assert learned[0] == pytest.approx(feedback[0], rel=1e-6)
    assert learned[3] < 0.6 * feedback[3] and learned[7] < 0.3 * feedback[7]


def test_trials_start_where_the_reference_begins_or_as_told(tmp_path: Path) -> None:
    trace = simulate(trial_studies.loaded(tmp_path), "move", "ilc").trace
    assert np.all(trace["theta_m"].reshape(12, 200)[:, 0] == 0)
    change = "scenario.move.changes.0"
    told = {f"{change}.initial_angle": "0.1 rad", f"{change}.initial_speed": "1 rad/s"}
    trace = simulate(trial_studies.loaded(tmp_path, told), "move", "ilc").trace
    assert trace["theta_m"].reshape(12, 200)[:, 0].tolist() == [0.0] * 4 + [0.1] * 8
    assert trace["omega_m"].reshape(12, 200)[:, 0].tolist() == [0.0] * 4 + [1.0] * 8


def test_what_changes_between_trials_the_controller_isn_t_told(tmp_path: Path) -> None:
    """A heavier load changes the plant of its trials alone: the trials before are the same bit for bit."""
    light = simulate(trial_studies.loaded(tmp_path), "move", "ilc").trace
    heavier = {"scenario.move.changes.1.override": {"mechanics.inertia": "8e-4 kg*m^2"}}
    other = simulate(trial_studies.loaded(tmp_path, heavier), "move", "ilc").trace
    assert np.array_equal(light.data[: 8 * 200], other.data[: 8 * 200])
    assert not np.allclose(light["theta_m"][8 * 200 :], other["theta_m"][8 * 200 :], atol=1e-6)


def test_the_ideal_loop_is_the_limit_of_a_fast_real_one(tmp_path: Path) -> None:
    fast = {
        "drive.current_loop": {"bandwidth": "1200 Hz", "current_limit": "10 A"},
        "drive.inverter": {"bus_voltage": "300 V", "computation_delay": 0},
        "drive.rates.current_loop": "16 kHz",
        "drive.position_sensor": {"kind": "ideal"},
        "scenario.move.trials": 3,
        "scenario.move.changes": [],
    }
    ideal = {**fast, "drive.current_loop": {"kind": "ideal", "current_limit": "10 A"}}
    del ideal["drive.inverter"]
    real, without = (
        simulate(trial_studies.loaded(tmp_path, changes), "move", "ilc").trace["theta_m"]
        for changes in (fast, ideal)
    )
    assert np.max(np.abs(real - without)) < 1e-3 < np.max(np.abs(without))


def test_more_rows_than_samples_are_recorded_on_request(tmp_path: Path) -> None:
    trace = simulate(trial_studies.loaded(tmp_path, {"trace.rate": "8 kHz"}), "move", "ilc").trace
    assert len(trace) == 12 * 200 * 20
    assert np.allclose(np.diff(trace.time), 1 / 8000)
    assert np.array_equal(trace["trial"][:: 200 * 20], np.arange(1, 13))


def test_metrics_are_of_the_trial_s_samples_whatever_is_recorded(tmp_path: Path) -> None:
    few, many = (
        simulate(trial_studies.loaded(tmp_path, changes), "move", "ilc").metrics["error_rad"]
        for changes in ({}, {"trace.rate": "8 kHz"})
    )
    assert few == many


def test_a_linear_plant_is_sampled_exactly(tmp_path: Path) -> None:
    trace = simulate(trial_studies.loaded(tmp_path, text=LINEAR), "cycle", "ilc").trace
    u, load = trace["u"].reshape(6, 50), trace["load"].reshape(6, 50)
    x = np.stack([trace["x_1"].reshape(6, 50), trace["x_2"].reshape(6, 50)], axis=-1)
    for trial, a in ((0, 0.75), (5, 0.8)):
        # x_1' = -a x_1 + 2 (u - d): its closed form over a sample
        decay = math.exp(-a * 0.1)
        expected = decay * x[trial, :-1, 0] + (1 - decay) / a * 2.0 * (u - load)[trial, :-1]
        assert x[trial, 1:, 0] == pytest.approx(expected, abs=1e-12)
    assert np.all(load[:, :10] == 0) and np.all(load[:, 10:] == 0.1)


def test_every_law_learns(tmp_path: Path) -> None:
    changes = {
        "controller.older": {"law": "state-ilc"},
        "controller.matrix": {"law": "norm-optimal"},
        "scenario.cycle.changes": [],
        "scenario.cycle.trials": 30,
    }
    for found in run(tmp_path, changes, LINEAR).runs:
        error = found.metrics["error"]
        assert isinstance(error, list) and error[-1] < 0.2 * error[0], found.controller


def test_results_tell_a_floor_that_is_never_reached_as_null(tmp_path: Path) -> None:
    results = to_dict(run(tmp_path))
    text = json.dumps(results, allow_nan=False)
    runs = {r["controller"]: r["metrics"] for r in json.loads(text)["runs"]}
    assert runs["feedback"]["to_floor"][1] is None
    assert results["metrics"]["to_floor"]["floor"] == pytest.approx(1e-3)


def test_results_carry_the_phases_and_what_was_designed(tmp_path: Path) -> None:
    results = json.loads(json.dumps(to_dict(run(tmp_path)), allow_nan=False))
    assert results["trials"] == {"move": {"count": 12, "samples": 200, "phases": [1, 5, 9]}}
    for found in results["runs"]:
        design = found["design"]
        assert design["K_s"] == [*design["K_1"], design["K_2"]] and design["certificate"]["design_model"]


def test_a_study_is_the_same_in_any_order_and_on_any_number_of_threads(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path)
    both, one = run_study(study, jobs=2), run_study(study, ["move/feedback"], jobs=1)
    other = next(r for r in both.runs if r.controller == "feedback")
    assert np.array_equal(other.trace.data, one.runs[0].trace.data)


def test_a_plant_that_runs_away_is_told_with_its_trial(tmp_path: Path) -> None:
    with pytest.raises(RunError) as error:
        run(tmp_path, {"scenario.cycle.changes.0.override.a": -400}, LINEAR)
    assert str(error.value).startswith(f"{tmp_path}/study.toml: controller.ilc: scenario cycle in trial 4: ")
    assert error.value.results.runs == []


@pytest.mark.parametrize(
    ("text", "changes", "line"),
    [
        # a heated plate whose second state the input never reaches
        (LINEAR, {"plant.A": [["-a", 0.0], [0.0, "-2 * a"]]}, "plant: "),
        (LINEAR, {"plant.C": [0, 0]}, "plant.C: "),
        # a pure differentiator has no gain at rest, so that no integral action can hold it
        (LINEAR, {"plant.A": [[0.0, 1.0], [-1.0, -2.0]], "plant.B": [0, "k"], "plant.parameter.a": 1.0},
            "plant: "),
        (DRIVE, {"controller.ilc.K_s": [10.0, 1.0, 0.0]}, "controller.ilc.K_s: "),
    ],
)  # fmt: skip
def test_what_cannot_be_designed_is_one_line(
    tmp_path: Path, text: str, changes: dict[str, Any], line: str
) -> None:
    study = trial_studies.loaded(tmp_path, changes, text)
    with pytest.raises(StudyError) as error:
        run_study(study, ["*/ilc"])
    assert "\n" not in str(error.value)
    assert str(error.value).removeprefix(f"{tmp_path}/study.toml: ").startswith(line)


DISCRETE = """
title = "A cart"
[plant]
model = "discrete"
period = "10 ms"
A = [[1, 0.01], [0, 1]]
B = [5e-5, 0.01]
C = [1, 0]
[design]
state_weight = [1e4, 1, 10]
input_weight = 1
initial_state = [0.01, 0, 0]
[scenario]
move = { duration = "1 s", trials = 3, reference = [["0.1 s", 0], ["0.8 s", 1]] }
[controller]
feedback = { law = "trial-ilc", learning = false }
observed = { law = "observer-ilc" }
[[metric]]
name = "error"
kind = "final-rms"
signal = "y_error"
"""
UNSUITABLE = "plant.model: expected a continuous plant, which this law is designed for"


def test_an_unsuitable_controller_is_named_and_the_others_run(tmp_path: Path) -> None:
    path = trial_studies.write(tmp_path, DISCRETE)
    results = run_study(load(path))
    assert isinstance(results, TrialResults)
    assert [r.controller for r in results.runs] == ["feedback"] and not results.interrupted
    assert {pair: str(why) for pair, why in results.not_designed.items()} == {
        ("move", "observed"): f"{path}: {UNSUITABLE}"
    }
    written = json.loads(json.dumps(to_dict(results), allow_nan=False))
    assert written["not_designed"] == [
        {"scenario": "move", "controller": "observed", "why": f"{path}: {UNSUITABLE}"}
    ]
    (said,) = verdicts(results)
    assert f"observed: not designed: {UNSUITABLE}." in said.details


def test_the_commands_name_an_unsuitable_controller(tmp_path: Path) -> None:
    path, folder = str(trial_studies.write(tmp_path, DISCRETE)), str(tmp_path / "out")

    def invoke(*command: str) -> Result:
        return CliRunner().invoke(app, [*command], env={"COLUMNS": "200"})

    whole, printed = invoke("design", path, "--long"), invoke("run", path, "-o", folder)
    assert f"observed\n  design  none: {UNSUITABLE}\n" in invoke("design", path).stdout
    for found in (whole, printed):
        assert found.exit_code == 0 and f"observed: not designed: {UNSUITABLE}" in found.stdout
    told = json.loads(invoke("design", path, "--json").stdout)["controllers"]
    assert told["observed"] == {"not_designed": UNSUITABLE} and "certificate" in told["feedback"]
    assert page_runs(load(Path(path))) == [("move", "feedback")]
    assert left_out(load(Path(path))) == [f"observed: not designed: {UNSUITABLE}."]
    text = DISCRETE.replace('feedback = { law = "trial-ilc", learning = false }\n', "")
    alone = str(trial_studies.write(tmp_path, text))
    for command in (("design", alone), ("run", alone, "-o", folder)):
        refused = invoke(*command)
        assert isinstance(refused.exception, StudyError)  # exit code 2: cogless.cli.main
        assert str(refused.exception) == f"{alone}: {UNSUITABLE}"


def test_a_rollout_says_which_variants_cannot_be_designed(tmp_path: Path) -> None:
    study = load(trial_studies.write(tmp_path, DISCRETE))
    with pytest.raises(RunError) as error:
        rollout([study, study], jobs=1)
    for found, errors in zip(error.value.all_results, error.value.all_errors, strict=True):
        assert [r.controller for r in found.runs] == ["feedback"]
        assert list(errors) == [("move", "observed")]


# Sampled exactly, with a shift of one sample, the small drive has no K_3.
EXACT = {"design.discretisation": "exact"}
NO_K_3 = "controller.ilc.q_filter: no K_3 makes the error fall at every frequency: "


def test_a_design_without_a_learning_gain_shows_what_there_is(tmp_path: Path) -> None:
    path = trial_studies.write(tmp_path)
    found = CliRunner().invoke(app, ["design", str(path), "--set", "design.discretisation=exact", "--json"])
    assert found.exit_code == 0
    ilc, feedback = (json.loads(found.stdout)["controllers"][name] for name in ("ilc", "feedback"))
    assert ilc["K_3"] is None and feedback["K_3"] == 0
    (note,) = (note for note in ilc["notes"] if note not in feedback["notes"])
    assert note.startswith("q_filter: no K_3 makes the error fall at every frequency: ")
    assert "would choose a filter of 107 Hz and a shift of 2" in note
    for key in ("K_s", "N", "feedforward", "checks"):
        assert ilc[key] == feedback[key]
    radius = ilc["certificate"]["design_model"]["radius_along_the_trial"]
    assert radius == feedback["certificate"]["design_model"]["radius_along_the_trial"] < 1
    shown = CliRunner().invoke(app, ["design", str(path), "--set", "design.discretisation=exact", "--long"])
    assert " none " in shown.stdout and "no K_3 makes" in shown.stdout


def test_a_controller_without_its_learning_gain_does_not_run_and_the_others_do(tmp_path: Path) -> None:
    results = run(tmp_path, EXACT)
    assert [r.controller for r in results.runs] == ["feedback"]
    (line,) = results.without_design("move")
    assert line.startswith(f"ilc: not designed: {NO_K_3}") and "\n" not in line
    with pytest.raises(StudyError, match="no K_3 makes the error fall"):
        run_study(results.study, ["move/ilc"])


def test_nothing_else_takes_a_controller_without_its_learning_gain(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path, EXACT)
    with pytest.raises(StudyError) as error:
        prepare(study, "move", "ilc")
    assert str(error.value).startswith(f"{tmp_path}/study.toml: {NO_K_3}")
    warnings = DESIGNS[study.kind].warnings
    (line,) = warnings(study, "move", "ilc")
    assert str(line) == "controller.ilc: the error's largest factor from trial to trial: exact model: no K_3"
    assert warnings(study, "move", "feedback") == []


def test_an_older_law_s_mistakes_are_told_by_its_own_keys(tmp_path: Path) -> None:
    results = run(tmp_path, {"controller.older": {"law": "state-ilc", "K_stab": [10.0, 1.0]}})
    ((pair, error),) = results.not_designed.items()
    assert pair == ("move", "older")
    assert str(error).startswith(f"{tmp_path}/study.toml: controller.older.K_stab: ")


def test_no_change_of_the_initial_state_is_a_setting(tmp_path: Path) -> None:
    """Not the default, which is that of `initial_state`."""
    zero, default = (
        design_study(trial_studies.loaded(tmp_path, changes), [("move", "ilc")])["move", "ilc"]
        for changes in ({"design.initial_change": [0, 0, 0]}, {})
    )
    assert zero.gains.learning is not None and default.gains.learning is not None
    assert zero.gains.learning.check.passed and zero.gains.learning.bounds[0] == 0
    assert zero.gains.learning.bounds[1] < default.gains.learning.bounds[1]
    assert zero.K_3 < default.K_3
