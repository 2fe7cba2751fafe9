"""A changed reference keeps what was learned, by functions of it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from reference.trial_basis import carried
from test_prediction import axis

from cogless import run_study
from cogless.design.trials import prediction
from cogless.design.trials.from_study import design_study

OTHER = [["0.05 s", 0], ["0.25 s", -1.2], ["0.4 s", 0.5]]
CHANGES: dict[str, Any] = {
    "scenario.moves.trials": 60,
    "scenario.moves.initial_state": [0, 0],
    "scenario.moves.changes": [{"trial": 41, "reference": OTHER}],
    "scenario.moves.override": {"k": 800.0},
}


def errors(folder: Path, name: str, changes: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """RMS of each trial, of the feedback in each phase, and as predicted."""
    (run,) = run_study(axis(folder, {**CHANGES, **changes}), [f"*/{name}"]).runs
    assert run.design is not None and run.design.prediction is not None and run.feedback is not None
    at = run.design.prediction.labels.index("k = 800")
    predicted = np.concatenate([phase.learned[at] for phase in run.design.prediction.phases])
    alone = np.sqrt(np.mean(run.feedback["y_error"].reshape(2, -1) ** 2, axis=1))
    return np.asarray(run.metrics["error"]), alone, predicted


@pytest.mark.parametrize(
    ("name", "changes"),
    [("error", {}), ("error", {"controller.error.acts_on": "input"}), ("optimal", {}), ("observer", {})],
)
def test_the_trial_after_a_change_is_near_the_floor(
    tmp_path: Path, name: str, changes: dict[str, Any]
) -> None:
    """Without functions it is back at the feedback's error; and the prediction is what the engine does."""
    plain = {**changes, f"controller.{name}.guard": False}
    jump, alone, _ = errors(tmp_path, name, plain)
    error, _, predicted = errors(tmp_path, name, {**plain, f"controller.{name}.basis_functions": True})
    assert np.array_equal(error[:40], jump[:40])
    assert jump[40] > alone[1] and error[40] < 0.1 * alone[1]
    if name != "optimal":  # whose floor is rounding
        assert error[40] < 5 * max(error[39], error[59])
    np.testing.assert_allclose(error, predicted, rtol=1e-6, atol=1e-12)


def test_with_the_guard_too(tmp_path: Path) -> None:
    error, alone, _ = errors(tmp_path, "error", {"controller.error.basis_functions": True})
    assert error[40] < 0.1 * alone[1] and np.all(error[40:] < 0.1 * alone[1])


def test_friction_and_inertia_of_a_drive_move_along(tmp_path: Path) -> None:
    """In float, with Coulomb friction, a resolver and an inertia that the design does not know.

    The gains are given to the last digit. Those of another machine's solver differ in the sixth: then the
    resolver's steps come at other samples, and a single trial has another error.
    """
    changes = {
        "controller.ilc.K_s": [-98.09313517306917, -0.8985316978894085, 1.373928046311717],
        "controller.ilc.K_3": 0.7506988589460293,
        "mechanics.coulomb_friction": "0.05 N*m",
        "mechanics.inertia": "10.6e-4 kg*m^2",
        "scenario.move.trials": 40,
        "scenario.move.reference": [["0.05 s", "0 rad"], ["0.25 s", "2 rad"], ["0.45 s", "0 rad"]],
        "scenario.move.changes": [{"trial": 31, "reference": [["0.05 s", "0 rad"], ["0.35 s", "-2 rad"]]}],
    }
    found = []
    for functions in (False, True):
        more = {**changes, "controller.ilc.basis_functions": functions}
        (run,) = run_study(trial_studies.loaded(tmp_path, more), ["*/ilc"]).runs
        assert run.feedback is not None
        alone = np.sqrt(np.mean(run.feedback["theta_error"].reshape(2, -1) ** 2, axis=1))
        found.append(np.asarray(run.metrics["error_rad"]))
    assert np.array_equal(found[0][:30], found[1][:30])
    assert found[0][30] > 2 * alone[1]  # what was learned for the other motion
    assert found[1][30] < 0.7 * alone[1] and found[1][30] < 1.5 * found[1][29]
    guide = (Path(__file__).parents[2] / "docs" / "guide" / "trial-studies.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| .* \| ([\d.]+) mrad \| ([\d.]+) mrad \|$", guide, re.MULTILINE)
    for row, rms in zip(rows, (alone, found[0][29:31], found[1][29:31]), strict=True):
        assert [float(x) for x in row] == pytest.approx(1e3 * rms, rel=0.05)


def test_the_design_moves_as_the_transcription() -> None:
    time = np.arange(200) / 200
    old, new = np.sin(5 * time), np.cos(7 * time**2)
    v = np.random.default_rng(2).normal(size=(3, 200))
    for n, k_2 in ((90.0, 1.3), (1.0, 0.0)):
        wanted = [carried(row, old, new, n, k_2) for row in v]
        np.testing.assert_allclose(prediction.carried(v, old, new, n, k_2), wanted, rtol=1e-9, atol=1e-12)
    assert prediction.carried(v, old, new, 1.0, -0.1) is v and prediction.carried(v, old, new, 0.0, 0.0) is v


def test_certified_looks_at_what_moves_along(tmp_path: Path) -> None:
    """One trial after the change: without functions it ends above the feedback, with them below."""
    once = {**CHANGES, "scenario.moves.trials": 41}
    for functions in (False, True):
        study = axis(tmp_path, {**once, "controller.error.basis_functions": functions})
        design = design_study(study, [("moves", "error")])["moves", "error"]
        assert design.certified is functions
