"""A scenario's prediction against the C laws on the engine, and what is said of a scenario before it runs."""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from trial_studies import DRIVE, loaded

from cogless import run_study
from cogless.design.trials.from_study import design_study
from cogless.design.trials.prediction import PhasePrediction, trials_to_floor
from cogless.design.trials.trial_summary import summary, table, to_dict
from cogless.report.trial_case import case
from cogless.report.trial_verdict import verdict
from cogless.results import Run
from cogless.study import TrialStudy

AXIS = """
title = "An axis with a start offset"
[plant]
period = "2 ms"
A = [[0, 1], [0, "-d"]]
B = [0, "k"]
C = [1, 0]
input_limit = 50.0
[plant.parameter]
k = [450.0, 800.0]
d = 2.0
[design]
state_weight = [2e4, 0.1, 4]
input_weight = 0.9
initial_state = [0.01, 0, 0]
[scenario.moves]
duration = "0.6 s"
trials = 24
initial_state = [0.01, 0]
reference = [["0.05 s", 0], ["0.35 s", 2]]
changes = [{ trial = 13, load_steps = [[100, 0.8]] }]
[controller]
error = { law = "trial-ilc", q_filter = { cutoff = "30 Hz" } }
[controller.signal]
law = "trial-ilc"
acts_on = "input"
q_filter = { cutoff = "25 Hz", acts_on = "signal", ends = "odd" }
[controller.optimal]
law = "norm-optimal"
[controller.observer]
law = "observer-ilc"
[controller.feedback]
law = "trial-ilc"
learning = false
[[metric]]
name = "error"
kind = "rms"
signal = "y_error"
"""


def axis(folder: Path, changes: dict[str, Any] | None = None) -> TrialStudy:
    return loaded(folder, changes, text=AXIS)


# The prediction is of learning without the guard.
UNGUARDED = {f"controller.{name}.guard": False for name in ("error", "signal", "optimal", "observer")}


@pytest.fixture(scope="module", params=[450.0, 800.0])
def runs(request: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Run]]:
    """All controllers at one corner, and the corner's name."""
    folder = tmp_path_factory.mktemp("axis")
    study = axis(folder, {"scenario.moves.override": {"k": request.param}} | UNGUARDED)
    found = run_study(study).runs
    return f"k = {request.param:g}", {run.controller: run for run in found}


@pytest.mark.parametrize("name", ["error", "signal", "optimal", "observer", "feedback"])
def test_it_is_what_the_engine_does(runs: tuple[str, dict[str, Run]], name: str) -> None:
    label, found = runs
    run = found[name]
    assert run.design is not None and run.design.prediction is not None
    prediction = run.design.prediction
    at = prediction.labels.index(label)
    learned = np.concatenate([phase.learned[at] for phase in prediction.phases])
    measured = np.asarray(run.metrics["error"])
    np.testing.assert_allclose(learned, measured, rtol=1e-6, atol=1e-12)
    u = np.abs(run.trace["u"].reshape(24, -1)).max(axis=1)
    assert prediction.phases[0].peak[at] == pytest.approx(u[11], rel=1e-6)
    assert prediction.phases[1].peak[at] == pytest.approx(u[23], rel=1e-6)


@pytest.mark.parametrize("name", ["error", "signal", "optimal", "observer"])
def test_a_run_has_the_trials_of_its_own_feedback(runs: tuple[str, dict[str, Run]], name: str) -> None:
    """They equal the first trial, in which nothing is learned, and what was predicted."""
    label, found = runs
    run = found[name]
    assert run.feedback is not None and run.design is not None and run.design.prediction is not None
    alone = run.feedback["y_error"].reshape(2, -1)
    np.testing.assert_array_equal(alone[0], run.trace["y_error"].reshape(24, -1)[0])
    at = run.design.prediction.labels.index(label)
    for row, phase in zip(alone, run.design.prediction.phases, strict=True):
        assert np.sqrt(np.mean(row**2)) == pytest.approx(phase.feedback[at], rel=1e-6)
    if name in ("error", "optimal"):  # the study's feedback is theirs
        same = np.asarray(found["feedback"].trace["y_error"]).reshape(24, -1)
        np.testing.assert_allclose(alone, same[[0, 12]], rtol=1e-9, atol=1e-12)
    assert found["feedback"].feedback is None


def test_a_feedback_that_needs_more_than_the_limit_is_not_certified_and_its_vertex_is_named(
    tmp_path: Path,
) -> None:
    study = axis(tmp_path)
    design = design_study(study, [("moves", "optimal")])["moves", "optimal"]
    assert design.certified and design.over_limit is None
    assert design.prediction is not None
    most = max(float(np.max([*phase.peak, *phase.feedback_peak])) for phase in design.prediction.phases)
    low = axis(tmp_path, {"plant.input_limit": 0.9 * most})
    limited = design_study(low, [("moves", "optimal")])["moves", "optimal"]
    assert not limited.certified and limited.over_limit is not None
    plant, needed = limited.over_limit
    assert needed == pytest.approx(most)
    assert plant == "k = 450"  # the weakest
    found = summary(low)
    assert to_dict(low, found)["controllers"]["optimal"]["certified"] is False
    console = Console(width=250, record=True, file=StringIO())
    console.print(table(low, found))
    assert f"at k = 450, above the limit of {0.9 * most:.4g}" in console.export_text()


def test_certified_means_that_the_scenario_ends_no_higher_than_without_learning(tmp_path: Path) -> None:
    """The odd reflection with a start offset: no frequency grows, yet the error ends above the feedback's.

    The run and its verdict say so, and the even one doesn't do it.
    """
    changes = {
        "scenario.moves.initial_state": [0.05, 0],
        "scenario.moves.trials": 30,
        "scenario.moves.changes": [],
        "scenario.moves.reference": [["0.05 s", 0], ["0.35 s", 0.001]],
        "controller.signal.q_filter.cutoff": "6 Hz",
    }
    said = {}
    for ends in ("odd", "even"):
        study = axis(tmp_path, changes | UNGUARDED | {"controller.signal.q_filter.ends": ends})
        results = run_study(study, ["*/signal"])
        (run,) = results.runs
        assert run.design is not None and run.design.prediction is not None and run.feedback is not None
        error = np.asarray(run.metrics["error"])
        alone = float(np.sqrt(np.mean(run.feedback["y_error"] ** 2)))
        text = verdict(results, results.runs)
        assert text is not None
        said[ends] = (run.design, error[-1] / alone, " ".join([text.headline, *text.details]))
    design, share, words = said["odd"]
    learning = (design.certificate.exact or design.certificate.design).learning
    assert learning is not None and learning.monotone  # all that was looked at before
    assert share > 1.05 and not design.certified
    assert design.prediction.share >= share * (1 - 1e-6)
    assert "is worse than without learning" in words and "is not certified" in words
    design, share, words = said["even"]
    assert share < 1 and design.certified
    assert "worse than without learning" not in words and "Certified: " in words


def test_a_floor_excuses_an_error_below_it(tmp_path: Path) -> None:
    results = run_study(loaded(tmp_path, text=DRIVE), ["*/ilc"])
    judged = case(results, results.runs)
    assert judged is not None
    judged.__dict__["final"] = {"ilc": [0.9e-3, 3e-3, 2e-3]}
    judged.__dict__["feedback"] = {"ilc": [1e-4, 2e-3, 1.5e-3]}
    above = judged.above_feedback("ilc")
    assert above is not None and (above[0].start, above[1:]) == (5, (3e-3, 2e-3))
    judged.__dict__["final"] = {"ilc": [0.9e-3, 2e-3, 1.5e-3]}
    assert judged.above_feedback("ilc") is None


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([8.0, 4, 2, 1.09, 1, 1, 1, 1], 4),
        ([8.0, 4, 2, 1.11, 1, 1, 1, 1], 5),
        ([8.0, 1, 2, 1, 1, 1, 1, 1], 4),  # it has to stay there
        ([1.0, 1, 1, 1], 1),
        ([1.0, 2, 4, 8], 1),  # it ends with the largest
        ([3.0], 1),
        ([8.0, 4, np.nan, 1, 1, 1], None),
    ],
)
def test_the_trials_to_the_floor_are_counted_from_the_end(errors: list[float], expected: int | None) -> None:
    if np.isnan(errors).any():
        assert trials_to_floor(np.array([*errors, np.nan])) == expected
    else:
        assert trials_to_floor(np.array(errors)) == expected


def test_a_phase_that_still_falls_after_the_trials_that_are_tried_has_no_floor_yet() -> None:
    falling, settled = 0.98 ** np.arange(80.0), np.hypot(0.9 ** np.arange(80.0), 0.1)

    def phase(trials: int, steps: float) -> PhasePrediction:
        both, one = np.array([falling, settled]), np.ones(2)
        return PhasePrediction(both, one, one, one, one, one, steps * one, one, trials)

    settles = int(np.argmax(settled <= 1.1 * settled[-10])) + 1
    assert phase(200, 0.0).trials_to_floor == (None, settles)
    assert phase(200, 10.0).trials_to_floor == (1, 1)  # nothing can be seen of it
    (first, _) = phase(80, 0.0).trials_to_floor
    assert first is not None and 60 < first <= 80


# The window is short: the delay of a speed over a longer one is not in the models.
FINE = {"drive.position_sensor.bits": 22, "drive.position_sensor.window": 2, "scenario.move.trials": 60}
PHASES = ((0, 20), (20, 40), (40, 60))


@pytest.mark.parametrize("q_filter", ["auto", {"cutoff": "30 Hz", "acts_on": "signal"}])
@pytest.mark.parametrize("seed", range(4))
def test_the_predicted_trials_to_the_floor_and_the_floor_are_those_of_the_run(
    tmp_path: Path, q_filter: Any, seed: int
) -> None:
    """Of drives at random, inside the ranges: within 30 % or a trial, and the floor within 30 %.

    The guard's trial of the feedback alone, some trials after a change, is left out.
    """
    rng = np.random.default_rng(seed)
    J, load_step = rng.uniform(5.9e-4, 10.6e-4, 2), rng.uniform(-0.6, 0.6)
    changes = [
        {"trial": 21, "load_steps": [[int(rng.integers(20, 100)), f"{load_step} N*m"]]},
        {
            "trial": 41,
            "load_steps": [[50, f"{-load_step} N*m"]],
            "override": {"mechanics.inertia": f"{J[1]} kg*m^2"},
        },
    ]
    more = {
        "controller.ilc": {"law": "trial-ilc", "q_filter": q_filter},
        "scenario.move.override": {"mechanics.inertia": f"{J[0]} kg*m^2"},
        "scenario.move.changes": changes,
    }
    (run,) = run_study(loaded(tmp_path, FINE | more), ["*/ilc"]).runs
    assert run.design is not None and run.design.prediction is not None
    prediction, errors = run.design.prediction, np.asarray(run.metrics["error_rad"], dtype=float)
    assert prediction.labels[-1] == "the simulated plant"
    for (begin, end), predicted, floor in zip(
        PHASES, prediction.trials_to_floor, prediction.floor, strict=True
    ):
        own = errors[begin:end]
        own = np.delete(own, 1 + np.flatnonzero(own[1:] > 0.9 * own[0])) if begin else own
        needed = trials_to_floor(own)
        assert predicted is not None and needed is not None
        if not begin:
            continue  # all that is learned there is the sensor's delay
        assert abs(predicted - needed) <= max(1, 0.3 * needed), (begin, predicted, needed)
        assert floor == pytest.approx(np.max(own[-10:]), rel=0.3)


def test_the_prediction_leaves_a_plant_outside_the_ranges_out(tmp_path: Path) -> None:
    outside = {"scenario.move.override": {"mechanics.inertia": "12e-4 kg*m^2"}}
    study = loaded(tmp_path, outside)
    prediction = design_study(study, [("move", "ilc")])["move", "ilc"].prediction
    assert prediction is not None and prediction.labels[-1] == "the nominal plant"
