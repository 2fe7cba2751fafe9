"""Errors that don't repeat: the design's numbers against a transcription of the law, and against runs."""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reference.trial import Trial
from rich.console import Console
from test_prediction import axis

from cogless import run_study
from cogless.design.trials.from_study import design_study
from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.trial_summary import summary, table, to_dict

SAMPLES = 80
SHORT = {
    "scenario.moves.duration": "0.16 s",
    "scenario.moves.reference": [["0.01 s", 0], ["0.1 s", 0.5]],
    "scenario.moves.changes": [],
    "scenario.moves.initial_state": [0, 0],
}
NAMES = ["error", "signal", "optimal", "observer"]


def designed(folder: Path, name: str, changes: dict[str, Any] | None = None) -> TrialDesign:
    return design_study(axis(folder, {**SHORT, **(changes or {})}), [("moves", name)])["moves", name]


def transcribed(design: TrialDesign) -> Trial:
    """The law of tests/reference without its feedforward: a linear map of v, load, noise and start."""
    q, observer = design.q_filter, design.gains.observer
    return Trial(
        samples=SAMPLES,
        k_1=design.K_1.tolist(),
        k_2=design.K_2,
        n=design.N,
        c=design.C.tolist(),
        through_integrator=design.through_integrator,
        k_3=design.K_3,
        shift=design.shift,
        limit=1e9,
        learned_limit=1e9,
        unguarded=True,
        learning_matrix=design.learning_matrix,
        filter_signal=design.filtered == "signal",
        response=observer.response if observer else 0.0,
        pole=observer.pole if observer else 0.0,
        **({"b": list(q.b), "a": list(q.a), "odd": q.odd} if q else {}),
    )


def trial(
    law: Trial,
    A: np.ndarray,
    B: np.ndarray,
    v: np.ndarray,
    load: np.ndarray,
    noise: np.ndarray,
    x: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The error of y in one trial, and v after it."""
    law.v = v.copy()
    law.begin(np.zeros(SAMPLES))
    e = np.zeros(SAMPLES)
    for p in range(SAMPLES):
        e[p] = -x[0]
        u = law.step(x + np.array([noise[p], 0.0]))
        x = A @ x + B * (u - load[p])
    assert law.end()
    return e, law.v


def plant(k: float) -> tuple[np.ndarray, np.ndarray]:
    """x'' = k u - 2 x', held for 2 ms."""
    decay = np.exp(-2.0 * 0.002)
    A = np.array([[1.0, (1 - decay) / 2], [0.0, decay]])
    return A, k * np.array([0.001 - (1 - decay) / 4, (1 - decay) / 2])


@pytest.mark.parametrize("name", NAMES)
def test_the_amplification_is_the_stationary_covariance(tmp_path: Path, name: str) -> None:
    """By unit vectors through the transcription: all trials that a trial's noise acts in, added up."""
    design = designed(tmp_path, name)
    found = design.amplification
    assert found is not None
    law, zero, unit = transcribed(design), np.zeros(SAMPLES), np.eye(SAMPLES)
    for label, k in (("k = 450", 450.0), ("k = 800", 800.0), ("the nominal plant", 625.0)):
        A, B = plant(k)
        at, rest = found.labels.index(label), np.zeros(2)
        G, M = (
            np.array(x).T for x in zip(*(trial(law, A, B, v, zero, zero, rest) for v in unit), strict=True)
        )
        for values, columns in (
            (found.load, [trial(law, A, B, zero, d, zero, rest) for d in unit]),
            (found.noise, [trial(law, A, B, zero, zero, n, rest) for n in unit]),
        ):
            W, L = (np.array(x).T for x in zip(*columns, strict=True))
            alone, later = np.sum(W**2), 0.0
            for _ in range(3000):
                later, L = later + np.sum((G @ L) ** 2), M @ L
            expected = np.sqrt(1 + later / alone)
            assert values[at] == pytest.approx(expected, rel=0.03)
            assert expected > 1.01


@pytest.mark.parametrize("name", NAMES)
def test_runs_with_noise_have_it(tmp_path: Path, name: str) -> None:
    """600 trials at a corner: the error of the noise, with learning and without, is what was predicted."""
    for noise in ({"plant.noise": [1e-3, 0]}, {"plant.load_noise": 0.5}):
        changes = {
            **SHORT,
            **noise,
            f"controller.{name}.guard": False,
            "scenario.moves.override": {"k": 800.0},
            "scenario.moves.trials": 600,
        }
        quiet = {**changes, "plant.noise": [0, 0], "plant.load_noise": 0}
        (run,), (without,) = (run_study(axis(tmp_path, c), [f"*/{name}"]).runs for c in (changes, quiet))
        assert run.design is not None and run.feedback is not None and without.feedback is not None
        assert run.design.amplification is not None and run.design.prediction is not None
        repeated = without.trace["y_error"].reshape(600, -1)
        random = (run.trace["y_error"].reshape(600, -1) - repeated)[100:]
        alone = (run.feedback["y_error"].reshape(600, -1) - without.feedback["y_error"])[100:]
        at = run.design.prediction.labels.index("k = 800")
        (phase,) = run.design.prediction.phases
        assert np.sqrt(np.mean(random**2)) == pytest.approx(phase.random[at], rel=0.05)
        assert np.sqrt(np.mean(alone**2)) == pytest.approx(phase.feedback_random[at], rel=0.05)
        kind = run.design.amplification.noise if "plant.noise" in noise else run.design.amplification.load
        assert np.sqrt(np.mean(random**2) / np.mean(alone**2)) == pytest.approx(kind[at], rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_random_starts_and_loads_are_predicted(tmp_path: Path, name: str) -> None:
    """Exact series, so only the draws of 600 trials differ."""
    spread = {"normal": {"initial_state": [0.01, 0.2]}, "uniform": {"load": 0.3}}
    changes = {**SHORT, "scenario.moves.override": {"k": 450.0}, "scenario.moves.trials": 600}
    changes["scenario.moves.each_trial"] = spread
    (run,) = run_study(axis(tmp_path, changes), [f"*/{name}"]).runs
    assert run.design is not None and run.design.prediction is not None and run.feedback is not None
    (phase,), at = run.design.prediction.phases, run.design.prediction.labels.index("k = 450")
    settled = run.trace["y_error"].reshape(600, -1)[100:]
    assert np.sqrt(np.mean(settled**2)) == pytest.approx(phase.learned[at, -1], rel=0.06)
    assert np.sqrt(np.mean(run.feedback["y_error"] ** 2)) == pytest.approx(phase.feedback[at], rel=0.06)
    assert phase.random[at] > 1.01 * phase.feedback_random[at]


def test_learning_from_nothing_but_chance_is_not_certified(tmp_path: Path) -> None:
    """Where all of the error is random, learning ends above the feedback."""
    random = {"scenario.moves.each_trial.normal.initial_state": [0.01, 0]}
    still = {"scenario.moves.reference": [["0.01 s", 0], ["0.1 s", 1e-6]]}
    for changes, certified in ((still, True), ({**still, **random}, False)):
        assert designed(tmp_path, "optimal", changes).certified is certified


def test_the_table_and_the_json_have_it(tmp_path: Path) -> None:
    study = axis(tmp_path, SHORT)
    found = summary(study)
    amplification = found.designs["optimal"].amplification
    assert amplification is not None
    as_json = to_dict(study, found)["controllers"]
    assert as_json["feedback"]["amplification"] is None
    told = as_json["optimal"]["amplification"]
    assert told["plants"] == ["k = 450", "k = 800", "the nominal plant"]
    assert told["noise_on_the_load"] == amplification.load.tolist()
    console = Console(width=250, record=True, file=StringIO())
    console.print(table(study, found))
    text = console.export_text()
    assert "load noise" in text and f"{max(amplification.noise):.3f}" in text
