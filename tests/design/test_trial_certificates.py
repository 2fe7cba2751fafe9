"""What a certificate says of learning holds in simulation, on plants of every kind."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogless import run_study
from cogless.design.trials.certificate import Certificate
from cogless.design.trials.from_study import design_study
from cogless.results import Run
from cogless.study import TrialStudy, load

EXAMPLES = Path(__file__).parents[2] / "examples"

# The nominal plant of Mandra 2019, sampled as its design has it (Euler), with the resolver's noise left out.
NOMINAL = """
title = "The nominal plant"
[plant]
model = "discrete"
period = "2.5 ms"
C = [1, 0]
vertex = [{ A = [[1, 0.0025], [0, 0.9957575757575757]], B = [0, 1.1212121212121212] }]
[design]
state_weight = [1.8e4, 0.1, 4]
input_weight = 0.9
initial_state = [0.01, 0, 0]
[scenario.moves]
duration = "1 s"
trials = 500
reference = [["0.1 s", 0], ["0.5 s", 1], ["0.9 s", 0]]
load_steps = [[50, 1.0], [200, -1.0], [300, 0.5]]
[controller.ilc]
law = "trial-ilc"
K_s = [-99.4484, -0.9270, 1.3916]
K_3 = 0.6942
"""


def study(path: Path, changes: dict[str, Any] | None = None) -> TrialStudy:
    loaded = load(path, changes)
    assert isinstance(loaded, TrialStudy)
    return loaded


def certificate(run: Run) -> Certificate:
    """Of the controller that ran."""
    assert run.design is not None
    return run.design.certificate


def by_trial(run: Run, signal: str, trials: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return run.trace[signal].reshape(trials, -1)


def sizes(rows: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> np.ndarray[Any, Any]:
    return np.asarray(np.linalg.norm(rows, axis=1))


def test_the_nominal_error_contracts_as_certified_until_rounding(tmp_path: Path) -> None:
    path = tmp_path / "nominal.toml"
    path.write_text(NOMINAL)
    nominal = study(path)
    (run,) = run_study(nominal).runs
    certified = certificate(run).design.without_filter
    assert certified is not None and 0.8 < certified.norm < 0.95
    error = sizes(by_trial(run, "y_error", 500))
    above = np.flatnonzero(error > 1e-11)
    assert above[-1] > 100 and error[-1] < 1e-11 < error[0]
    ratio = error[1 : above[-1]] / error[: above[-1] - 1]
    assert np.all(ratio <= certified.norm * (1 + 1e-9))
    # what is left in the end is the slowest part, and it goes down by the certified factor
    assert ratio[-20:] == pytest.approx(certified.norm, rel=0.02)


def runs_at(
    corners: list[dict[str, float]], name: str, scenario: dict[str, Any], controllers: tuple[str, ...]
) -> list[Run]:
    """Of an example: the scenario with each of these values, under each controller."""
    scenarios = {f"corner-{n}": {**scenario, "override": corner} for n, corner in enumerate(corners)}
    of_file = study(EXAMPLES / f"{name}.toml", {f"scenario.{key}": each for key, each in scenarios.items()})
    chosen = [f"{key}/{controller}" for key in scenarios for controller in controllers]
    runs = run_study(of_file, chosen).runs
    assert len(runs) == len(chosen)
    return list(runs)


def scenario_of(name: str, scenario: str) -> dict[str, Any]:
    tables = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    return dict(tables["scenario"][scenario])


def test_relative_degree_one() -> None:
    batch = scenario_of("winder", "batch") | {"changes": [], "load_steps": [[200, 5.0], [400, 0.0]]}
    corners = [{"J": J, "B": B} for J in (0.01, 0.017, 0.03) for B in (0.01, 0.05)]
    for run in runs_at(corners, "winder", batch, ("ilc", "older")):
        exact = certificate(run).exact
        assert exact is not None and exact.without_filter is not None
        factor = exact.without_filter.norm
        error = sizes(by_trial(run, "y_error", 20))
        assert factor < 0.9 and error[-1] < 0.06 * error[0]
        assert np.all(error[1:] <= factor * error[:-1] + 1e-9)


@pytest.mark.parametrize(
    ("name", "corners"),
    [
        ("current_lag", [{"J": 6e-4, "K_t": 0.38}, {"J": 9e-4, "K_t": 0.36}, {"J": 7e-4, "K_t": 0.37}]),
        ("two_mass", [{"J_l": 3e-4, "c": 65.0}, {"J_l": 6e-4, "c": 55.0}]),
    ],
)
def test_a_zero_outside_the_unit_circle_and_order_four(name: str, corners: list[dict[str, float]]) -> None:
    """With the filter on the learned signal, its change from trial to trial is what shrinks."""
    moves = scenario_of(name, "moves") | {"changes": [], "load_steps": [[100, 0.3]]}
    for run in runs_at(corners, name, moves, ("ilc",)):
        exact = certificate(run).exact
        assert exact is not None and exact.stable and exact.with_filter is not None
        assert exact.with_filter.contracting and exact.growth is not None
        # what the filter does at the trial's ends is beyond any factor by frequency
        factor = max(exact.with_filter.norm, exact.growth)
        assert factor < 0.995
        trials = moves["trials"]
        change = sizes(np.diff(by_trial(run, "learned", trials), axis=0))
        assert np.all(change[1:] <= factor * change[:-1] * 1.02 + 1e-9)
        error = sizes(by_trial(run, "y_error", trials))
        assert error[-1] < 0.7 * error[0]


def test_plants_that_need_a_filter_say_so(tmp_path: Path) -> None:
    from cogless.errors import StudyError

    unfiltered = study(EXAMPLES / "current_lag.toml", {"controller.ilc.q_filter": {"cutoff": "40 Hz"}})
    refused = design_study(unfiltered, [("moves", "ilc")])["moves", "ilc"].no_K_3
    assert isinstance(refused, StudyError)
    assert "controller.ilc.q_filter: " in str(refused)
    assert refused.cures == ({"controller.ilc.q_filter": "auto", "controller.ilc.shift": "auto"},)
