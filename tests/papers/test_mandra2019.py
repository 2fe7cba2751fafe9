"""What the shipped study of Mandra 2019 must show."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cogless import run_study
from cogless.cli import app
from cogless.results import Run
from cogless.study import load

STEP = 2 * math.pi / 2**14  # of the resolver, rad
STARTS = (1, 31, 61, 91)


@pytest.fixture(scope="module")
def design() -> dict[str, Any]:
    """The user's own way to it."""
    found = CliRunner().invoke(app, ["design", "mandra2019", "--json"])
    assert found.exit_code == 0
    return dict(json.loads(found.stdout))


@pytest.fixture(scope="module")
def runs() -> dict[str, Run]:
    """All 500 trials of the two that must stay at the floor, and 120 of the others, for comparison."""
    few = load("mandra2019", {"scenario.table-1.trials": 120})
    lasting = run_study(load("mandra2019"), ["*/ilc", "*/observer"], jobs=2)
    brief = run_study(few, ["*/no-ilc", "*/ilc-input", "*/ilc-no-integral"], jobs=2)
    return {run.controller: run for results in (lasting, brief) for run in results.runs}


def test_the_paper_s_gains(design: dict[str, Any]) -> None:
    gains = design["controllers"]["ilc"]
    assert np.abs(np.subtract(gains["K_s"], [-99.4484, -0.9270, 1.3916])) == pytest.approx(0, abs=0.02)
    assert gains["K_s"][1:] == pytest.approx([-0.9270, 1.3916], abs=0.0005)
    assert gains["K_3"] == pytest.approx(0.6942, abs=0.001)
    # (40): N and the gain at rest are one number, and belong to the K_s that is held to 0.02
    assert gains["N"] == pytest.approx(99.4484, abs=0.02)
    assert gains["N"] == pytest.approx(-gains["K_s"][0], rel=1e-12)
    assert gains["dc_gain"] == pytest.approx(0.01005547, abs=2e-6)


def test_the_paper_s_nominal_model(design: dict[str, Any]) -> None:
    plant = design["plant"]
    assert np.round(plant["nominal"]["A"], 4).tolist() == [[1.0, 0.0025], [0.0, 0.9958]]
    assert np.round(plant["nominal"]["B"], 4).tolist() == [0.0, 1.1212]
    assert (plant["order"], plant["relative_degree"], len(plant["vertices"])) == (2, 2, 6)
    assert plant["hull_of_the_corners"]


def test_the_paper_s_feedforward(design: dict[str, Any]) -> None:
    ahead = design["controllers"]["ilc"]["feedforward"]
    numerator = np.array(ahead["numerator"])
    assert ahead["method"] == "perfect tracking" and ahead["preview"] == 2
    assert round(1 / numerator[0], 4) == 0.0028
    assert np.round(numerator / numerator[0], 4).tolist() == [1.0, -0.9564, 0.2352]
    # unrounded: on the nominal model its gain at rest is N
    assert numerator.sum() == pytest.approx(design["controllers"]["ilc"]["N"], rel=1e-9)


def test_every_solution_was_checked(design: dict[str, Any]) -> None:
    for check in design["controllers"]["ilc"]["checks"].values():
        assert check["passed"] and check["true_cost"] <= check["bound"] * (1 + 1e-6)


def test_the_certificate_says_of_which_model_it_speaks(design: dict[str, Any]) -> None:
    certificate = design["controllers"]["ilc"]["certificate"]
    euler, exact = certificate["design_model"], certificate["exactly_sampled"]
    assert euler["radius_of_phi"] < 1 and euler["without_filter"]["contracting"]
    assert euler["without_filter"]["norm"] < 0.98
    nyquist = exact["without_filter"]
    assert nyquist["norm"] == pytest.approx(1.0, abs=5e-4) and not nyquist["contracting"]
    assert nyquist["norm_at_Hz"] == pytest.approx(200, abs=2)
    # one more sample of delay is one too many
    assert not exact["stable_with_one_more_sample_of_delay"]


def first_and_settled(run: Run) -> tuple[list[float], list[float]]:
    first, final = run.metrics["first_error_rad"], run.metrics["final_error_rad"]
    assert isinstance(first, list) and isinstance(final, list)
    return first, final


def test_fig_1_is_at_the_resolver_s_step_within_five_trials(runs: dict[str, Run]) -> None:
    needed = runs["ilc"].metrics["trials_to_floor"]
    assert isinstance(needed, list) and max(needed) <= 5
    _, final = first_and_settled(runs["ilc"])
    assert all(0.3 * STEP < error < 2 * STEP for error in final)


def test_the_simplified_structure_takes_four_times_as_many_after_the_load(runs: dict[str, Run]) -> None:
    fig_1, simplified = runs["ilc"].metrics["trials_to_floor"], runs["ilc-input"].metrics["trials_to_floor"]
    assert isinstance(fig_1, list) and isinstance(simplified, list)
    assert simplified[1] >= 4 * fig_1[1]


def test_without_integral_action_the_load_hits_four_times_harder(runs: dict[str, Run]) -> None:
    assert first_and_settled(runs["ilc-no-integral"])[0][1] >= 4 * first_and_settled(runs["ilc"])[0][1]


def test_without_learning_the_load_s_error_stays(runs: dict[str, Run]) -> None:
    first, final = first_and_settled(runs["no-ilc"])
    assert final == pytest.approx(first, rel=1e-3)
    assert final[1] > 5 * first_and_settled(runs["ilc"])[1][1]


def test_the_observer_is_at_the_floor_in_one_or_two_trials(runs: dict[str, Run]) -> None:
    """The published structure needs 2, 4, 1 and 4, and makes 5.8 mrad when the load comes."""
    observer, fig_1 = runs["observer"], runs["ilc"]
    assert observer.metrics["trials_to_floor"] == [1, 2, 1, 2]
    first, final = first_and_settled(observer)
    assert first[1] < 2e-3 < first_and_settled(fig_1)[0][1] / 2.5
    assert max(final) < 2 * STEP


def test_the_observer_is_certified_over_the_ranges(design: dict[str, Any]) -> None:
    """The design has no weight of its own, and holds for every exactly sampled plant."""
    found = design["controllers"]["observer"]
    plants = found["certificate"]["design_model"]
    assert plants["stable_along_the_trial"] and plants["with_filter"]["contracting"]
    assert plants["with_filter"]["norm"] < 0.67 and plants["growth_with_the_trial_s_ends"] < 0.75
    weights = {"design.state_weight": [1.0, 1.0, 1.0], "design.input_weight": 1.0}
    other = CliRunner().invoke(
        app, ["design", "mandra2019", "--json", *(f"--set={key}={value}" for key, value in weights.items())]
    )
    assert json.loads(other.stdout)["controllers"]["observer"]["observer"] == found["observer"]


def test_errors_by_trial_are_those_of_the_trace(runs: dict[str, Run]) -> None:
    trace = runs["ilc"].trace
    error = trace["theta_error_measured"].reshape(500, 1000)
    assert runs["ilc"].metrics["error_rms_rad"] == pytest.approx(np.sqrt(np.mean(error**2, axis=1)))
    assert trace["trial"].reshape(500, 1000)[:, 0] == pytest.approx(np.arange(1, 501))
    load_torque = trace["tau_load"].reshape(500, 1000)
    assert np.all(load_torque[:30] == 0) and np.all(load_torque[30:90, :100] == 0)
    assert np.all(load_torque[30:90, 100:] == 1.11) and np.all(load_torque[90:, 250:] == 0.74)
