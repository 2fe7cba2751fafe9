"""An arena's steps one by one: which laws run on which plant, from which angle, and its run of an hour."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_arena import LAWS, PLANT, arena

from cogless.ensemble import arena as room
from cogless.ensemble import arena_scores
from cogless.ensemble.arena import _controller, _seeded, _tuned, chosen, prepared
from cogless.errors import StudyError


def test_a_run_of_an_hour_is_measured_in_its_last_minute(tmp_path: Path) -> None:
    """It has about 20 rows a second, by an odd divider of the current loop's rate, and no step or fault."""
    study, _ = prepared(arena(tmp_path), "drone", ["bar"])
    hour = room.hour(study)
    (scenario,) = hour.scenario.values()
    assert (scenario.duration, scenario.events, scenario.faults) == (3600.0, (), ())
    (metric,) = hour.metric
    assert (metric.name, metric.kind, metric.last) == ("after_hour", "rms", 60.0)
    divider = study.drive.rates.current_loop / hour.trace.rate
    assert round(divider) % 2 == 1 and hour.trace.rate == pytest.approx(20.0, rel=0.01)
    assert divider == pytest.approx(round(divider))


def test_seeds_begin_a_golden_angle_apart(tmp_path: Path) -> None:
    study, _ = prepared(arena(tmp_path), "drone", ["bar"])
    for seed, degrees in ((0, 0.0), (1, 137.508), (3, 3 * 137.508 - 360)):
        seeded = _seeded(study, seed)
        assert seeded.seed == seed and set(seeded.scenario) == set(study.scenario)
        angles = [scenario.initial_angle for scenario in seeded.scenario.values()]
        assert angles == pytest.approx([math.radians(degrees)] * 4)


def test_pairs_are_chosen_by_patterns(tmp_path: Path) -> None:
    fight = arena(tmp_path, plant={"drone": PLANT, "slow": PLANT}, trials={"moves": {"study": "mandra2019"}})
    both = ["bar", "pi-ilc"]
    assert chosen(fight, None) == chosen(fight, []) == {"drone": both, "slow": both}
    assert chosen(fight, ["*/bar", "slow/*"]) == {"drone": ["bar"], "slow": both}
    assert chosen(fight, ["moves/*"]) == {}
    with pytest.raises(StudyError) as error:
        chosen(fight, ["moves/*", "x"])
    assert str(error.value) == (
        f'{fight.path}: --only: "x": expected PLANT/LAW of the plants drone, slow and laws bar, pi-ilc'
    )


def test_a_feedback_by_hand_is_for_laws_with_a_pi_that_is_tuned(tmp_path: Path) -> None:
    """A law of one's own brings its feedback along. All laws that learn begin when the plant says so."""
    (tmp_path / "own.py").write_text("class P:\n    def step(self, inputs):\n        return 0.0\n")
    own = {"law": "python", "object": f"{tmp_path}/own.py:P", "learning": True}
    laws = {
        **LAWS,
        "by-hand": {"law": "pi", "kp": "1 A*s/rad", "ki": "1 A/rad"},
        "margin": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}},
        "own": own,
        "still": {**own, "learning": False},
    }
    feedback = {"kp": 0.05, "ki": 2.0}
    fight = arena(tmp_path, law=laws, plant={"drone": PLANT, "hand": {**PLANT, "feedback": feedback}})
    free, hand = fight.plant["drone"], fight.plant["hand"]
    learns = {"learning_start": "0.5 s"}
    assert _controller(fight, free, "bar") == laws["bar"]
    assert _controller(fight, free, "pi-ilc") == learns | laws["pi-ilc"]
    assert _controller(fight, hand, "bar") == laws["bar"] | feedback
    assert _controller(fight, hand, "own") == learns | own
    assert _controller(fight, hand, "still") == laws["still"]
    assert _controller(fight, hand, "by-hand") is None and _controller(fight, hand, "margin") is None


def test_a_law_without_numbers_leaves_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study, _ = prepared(arena(tmp_path), "drone", ["bar", "pi-ilc"])

    def automatic(study: Any, name: str) -> dict[str, str]:
        raise StudyError(f"{study.source.path}: controller.{name}.tuning: none fits")

    monkeypatch.setattr(room, "missing", lambda study: ["pi-ilc"])
    monkeypatch.setattr(room, "automatic", automatic)
    left, absent = _tuned(study, {"other": "why"})
    assert list(left.controller) == ["bar"] and absent == {"other": "why", "pi-ilc": "none fits"}
    monkeypatch.setattr(room, "missing", lambda study: [])
    assert _tuned(study, {}) == (study, {})


def test_numbers_that_are_not_finite_are_none_in_json() -> None:
    for value, plain in (
        (None, None),
        (math.inf, None),
        (math.nan, None),
        (0.5, 0.5),
        ([1.0, math.inf, math.nan], [1.0, None, None]),
    ):
        assert arena_scores._plain(value) == plain


def test_trials_run_with_each_seed_and_keep_what_has_a_number_for_each_phase(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fight = arena(tmp_path, seeds=[3, 4], trials={"moves": {"study": "mandra2019"}, "more": {"study": "x"}})
    rolled: list[tuple[list[int], int]] = []

    def roll(studies: Any, jobs: int) -> list[Any]:
        rolled.append(([study.seed for study in studies], jobs))
        metrics = {"first_error_rad": [1.0, 2.0], "other": [3.0], "final_error_rad": 4.0}
        run = SimpleNamespace(controller="ilc", metrics=metrics)
        return [SimpleNamespace(runs=[run]) for _ in studies]

    monkeypatch.setattr(room, "_rolled", roll)
    found = room.run_arena(fight, ["moves/*"], jobs=5)
    assert rolled == [([3, 4], 5)] and found.runs == []
    assert [(run.trials, run.law, run.seed, run.metrics) for run in found.trials] == [
        ("moves", "ilc", seed, {"first_error_rad": [1.0, 2.0]}) for seed in (3, 4)
    ]
