"""Norm-optimal learning with a filter on the learned signal: a weight of the signal itself over frequency."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reference.trial import zero_phase
from test_prediction import axis
from test_random_errors import SHORT, transcribed

from cogless import run_study
from cogless.design.trials.from_study import design_study
from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.response import Loop, TrialMap
from cogless.errors import StudyError

KEY = "controller.optimal"
SMOOTH = {f"{KEY}.q_filter": {"cutoff": "30 Hz"}}


def designed(folder: Path, changes: dict[str, Any]) -> TrialDesign:
    return design_study(axis(folder, changes), [("moves", "optimal")])["moves", "optimal"]


@pytest.mark.parametrize("ends", ["even", "odd"])
def test_the_law_does_what_is_predicted(tmp_path: Path, ends: str) -> None:
    """The C law on the engine, trial by trial, with load and start; and the transcription's v."""
    changes = {
        **SMOOTH,
        f"{KEY}.q_filter.ends": ends,
        f"{KEY}.guard": False,
        "scenario.moves.override": {"k": 800.0},
    }
    (run,) = run_study(axis(tmp_path, changes), ["*/optimal"]).runs
    assert run.design is not None and run.design.prediction is not None
    at = run.design.prediction.labels.index("k = 800")
    learned = np.concatenate([phase.learned[at] for phase in run.design.prediction.phases])
    np.testing.assert_allclose(learned, np.asarray(run.metrics["error"]), rtol=1e-6)
    assert learned[1] < 0.9 * learned[0]


def test_the_update_is_q_of_v_and_l_e(tmp_path: Path) -> None:
    design = designed(tmp_path, {**SHORT, **SMOOTH})
    law, rng = transcribed(design), np.random.default_rng(3)
    assert design.learning_matrix is not None and design.q_filter is not None
    law.v = v = rng.normal(size=80)
    law.begin(np.zeros(80))
    x = rng.normal(size=(80, 2))
    for sample in x:
        law.step(sample)
    assert law.end()
    e = -x[:, 0]
    e[: design.shift] = 0.0
    q = design.q_filter
    assert law.v == pytest.approx(zero_phase(q.b, q.a, v + design.learning_matrix @ e), abs=1e-9)


def test_the_transposed_maps_are_those_of_the_maps(tmp_path: Path) -> None:
    design = designed(tmp_path, {**SHORT, **SMOOTH})
    loops = [
        Loop(np.array([[pole, 0.2], [0.0, 0.7]]), np.array([[0.0], [1.0]]), np.array([1.0, 0.0]))
        for pole in (0.5, 0.9)
    ]
    trial = TrialMap(
        loops, 0.0, design.shift, design.q_filter, design.filtered, samples=80, matrix=design.learning_matrix
    )
    assert trial.matrix is not None and trial.q_filter is not None
    a, b = np.random.default_rng(1).normal(size=(2, len(trial.loops), 80))
    for there, back in (
        (trial.step, trial.step_transposed),
        (lambda d: trial.remaining(d, 5), lambda e: trial.remaining_transposed(e, 5)),
    ):
        assert np.sum(there(a) * b, axis=1) == pytest.approx(np.sum(a * back(b), axis=1), rel=1e-9)


def test_it_learns_as_fast_and_takes_less_noise_into_the_next_trial(tmp_path: Path) -> None:
    """A larger weight of the change takes less noise, too, but learns slowly."""
    plain, smooth, slow = (
        designed(tmp_path, changes) for changes in ({}, SMOOTH, {f"{KEY}.change_weight": 1.0})
    )
    noise, second = [], []
    for design in (plain, smooth, slow):
        assert design.amplification is not None and design.prediction is not None
        noise.append(max(design.amplification.noise))
        second.append(float(design.prediction.phases[1].learned[:, 1].max()))
    assert noise[0] > 2 > 1.3 > noise[1] and noise[2] < 1.3
    assert second[1] < 1.4 * second[0] < 0.8 * second[2]


def test_high_frequencies_are_forgotten_whatever_the_plant(tmp_path: Path) -> None:
    """Over a range of 1 to 7 |F| of the matrix alone is 1 at some frequency, with the filter below 0.7."""
    wide = {
        "plant.parameter.k": [200.0, 1500.0],
        "plant.input_limit": 1e3,
        "design.discretisation": "exact",
        "design.state_weight": [1e3, 0.1, 0.01],
    }
    norms = []
    for changes in (wide, {**wide, **SMOOTH}):
        learning = designed(tmp_path, changes).certificate.design.learning
        assert learning is not None
        norms.append(learning.norm)
    assert norms[0] > 0.999 and norms[1] < 0.7


def test_a_cutoff_beyond_half_the_rate_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r'q_filter.cutoff: "400 Hz": expected less than half the sampling rate'
    ):
        axis(tmp_path, {f"{KEY}.q_filter": {"cutoff": "400 Hz"}})
