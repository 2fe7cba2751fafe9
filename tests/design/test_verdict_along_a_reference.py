"""At which speeds a reference is judged, what of it only passes by, and how that is put."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import studies
from cogless.design.closed_loop import Oscillation
from cogless.design.learning_loop import Worst
from cogless.design.verdict import Passing, _passed, _passing, _places, _torques
from cogless.study import Study


def test_every_moving_sample_is_judged_once_at_the_nearest_speed() -> None:
    """From 1 to 4 rad/s in ratios of at most 1.06: 25 speeds, those without a sample left out."""
    omega = np.concatenate([np.zeros(5), np.geomspace(1.0, 4.0, 200), [3.97]])
    moving = omega > 0
    found = list(_places(omega, np.zeros(len(omega)), moving))
    assert sorted(np.concatenate([samples for *_, samples in found])) == np.flatnonzero(moving).tolist()
    speeds = [speed for speed, *_ in found]
    assert speeds == pytest.approx(np.geomspace(1.0, 4.0, 25))
    step = 4 ** (1 / 24)
    for speed, acceleration, samples in found:
        assert acceleration == 0.0
        assert np.all(np.abs(np.log(omega[samples] / speed)) <= 0.5001 * np.log(step))


def test_a_narrow_range_of_speeds_is_judged_at_15_and_a_steady_speed_once() -> None:
    narrow = np.linspace(1.0, 1.01, 500)
    all_ = np.ones(500, dtype=bool)
    assert [speed for speed, *_ in _places(narrow, 0 * narrow, all_)] == pytest.approx(
        np.geomspace(1.0, 1.01, 15)
    )
    steady = np.linspace(2.0, 2.0 * (1 + 9e-7), 500)  # but for rounding
    ((speed, acceleration, samples),) = _places(steady, 0 * steady, all_)
    assert (speed, acceleration, len(samples)) == (2.0, 0.0, 500)


def test_each_speed_is_judged_at_its_least_middle_and_largest_acceleration() -> None:
    omega, alpha = np.full(5, 2.0), np.array([1.0, 1.4, 2.1, 3.0, 9.0])
    moving = np.array([True, True, True, True, False])
    found = [(a, samples.tolist()) for _, a, samples in _places(omega, alpha, moving)]
    assert found == [(1.0, [0, 1]), (2.0, [2]), (3.0, [3])]
    assert [a for _, a, _ in _places(omega, alpha * [1, 1, 0, 1, 1], moving)] == [0.0, 1.5, 3.0]
    assert [a for _, a, _ in _places(omega, np.array([1.0, 1.1, 1.1, 3.0, 9.0]), moving)] == [1.0, 3.0]


def at(samples: list[int], fine: bool) -> Any:
    return SimpleNamespace(samples=np.array(samples), fine=fine)


LOOP: Any = SimpleNamespace(omega_m=4.0, periods_per_second=2.0)  # a period of 2 rad


def test_bad_speeds_next_to_a_stop_are_passed_if_they_turn_less_than_a_period() -> None:
    """Samples 0 to 3 and 8 to 11 lead to a stop, 16 and 17 don't, 20 to 22 turn too far."""
    resting = np.zeros(25, dtype=bool)
    resting[[2, 10, 11, 22]] = True
    turned = np.full(25, 0.3)
    turned[resting] = 0.0
    turned[20:22] = 1.0  # 2 rad: a whole period
    bad = at([0, 1, 3, 8, 9, 12, 13, 16, 17, 20, 21], False)
    good = at([4, 5, 6, 7, 14, 15, 18, 19, 23, 24], True)
    passed, longest = _passed([bad, good], resting, turned, LOOP)
    assert np.flatnonzero(passed).tolist() == [0, 1, 3, 8, 9, 12, 13]
    assert longest == 4  # 8, 9, 12 and 13; the stop between doesn't count
    turned[21] = 0.99
    passed, longest = _passed([bad, good], resting, turned, LOOP)
    assert np.flatnonzero(passed).tolist() == [0, 1, 3, 8, 9, 12, 13, 20, 21]
    assert _passed([good], resting, turned, LOOP)[1] == 0


def point(omega_m: float, factor: float = 1.0, growing: Oscillation | None = None) -> Any:
    worst = Worst(factor, 100 * omega_m)
    return SimpleNamespace(loop=SimpleNamespace(omega_m=omega_m), worst=worst, oscillation=growing)


def test_a_passage_ends_at_the_next_good_speed_in_two_digits_rounded_up() -> None:
    gone = [point(0.1, 3.0), point(0.2, 2.0)]
    left = [point(0.05), point(0.311), point(0.4)]
    assert _passing(gone, left, 0.7) == Passing(pytest.approx(0.32), 0.7, 10.0, False)
    assert _passing(gone, [point(0.31)], 0.7).below == pytest.approx(0.31)  # stays
    assert _passing(gone, [point(31.2)], 0.7).below == pytest.approx(32.0)
    assert _passing(gone, [point(0.05)], 0.7).below == pytest.approx(0.22)  # a step of 1.06 beyond 0.2


def test_a_passage_names_its_fastest_instability_before_any_growth() -> None:
    gone = [point(0.1, 9.0), point(0.2, 1.0, Oscillation(80.0, 3.0)), point(0.3, 1.0, Oscillation(90.0, 2.0))]
    found = _passing(gone, [], 0.7)
    assert (found.frequency, found.unstable) == (80.0, True)


@pytest.mark.parametrize(("percent", "found"), [(10.0, [0.9, 1.1, 1.0]), (0.6, [0.994, 1.006, 1.0])])
def test_a_torque_constant_that_ripples_is_judged_at_its_ends(
    tmp_path: Path, percent: float, found: list[float]
) -> None:
    ripple = {"motor.torque_ripple": [{"order": 24, "percent": percent}]}
    study = studies.study(tmp_path, ripple)
    assert isinstance(study, Study)
    scenario = next(iter(study.scenario))
    assert _torques(study, scenario) == pytest.approx(found, rel=1e-3)
    less = studies.study(tmp_path, {"motor.torque_ripple": [{"order": 24, "percent": 0.4}]})
    assert isinstance(less, Study)
    assert _torques(less, scenario) == [1.0]
