"""The fair rule for position feedback: it reaches its margin, and no such loop is stiffer."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import studies
from cogless import load
from cogless.design.closed_loop import Linear, open_loop, phase_margin_position, position_margins
from cogless.design.laws.space_bounds import position_gains
from cogless.design.speed_loop import CurrentLoop as SampledLoop
from cogless.design.speed_loop import SpeedLoop, speed_loop
from cogless.errors import StudyError
from cogless.study.drive import CurrentLoop
from cogless.study.laws.law import Tuning

DELAYED: dict[str, Any] = {"drive.inverter.computation_delay": 1}
SLOW: dict[str, Any] = {"drive.rates.speed_loop": "2 kHz"}


def tuning(degrees: float) -> Tuning:
    return Tuning.model_validate({"rule": "phase-margin", "phase_margin": f"{degrees} deg"})


def linear(ratio: int, k_theta: float, k_omega: float, k_i: float) -> Linear:
    return Linear(ratio=ratio, k=k_omega, k_theta=k_theta, k_i=k_i)


def loop(changes: dict[str, Any]) -> SpeedLoop:
    return speed_loop(load("verrelli2016", changes))


@pytest.mark.parametrize("changes", [{}, DELAYED, SLOW, {**DELAYED, **SLOW}])
@pytest.mark.parametrize("degrees", [20.0, 75.0])
def test_the_margin_is_reached(changes: dict[str, Any], degrees: float) -> None:
    around = loop(changes)
    for ratio in (1, 50):
        gains = phase_margin_position(around, ratio, tuning(degrees))
        found = position_margins(around, linear(ratio, *gains))
        assert found.stable
        assert math.degrees(found.phase_margin) == pytest.approx(degrees, abs=0.1)


@lru_cache(maxsize=1)
def loops(around: SpeedLoop) -> dict[tuple[int, int], NDArray[np.complex128]]:
    """Open loops with one of k_omega and k_i, without and with k_theta, all of them 1: (k_theta, k_i)."""
    w = np.geomspace(1e-3, 1, 4000) * math.pi / around.period
    return {(a, i): open_loop(around, linear(1, a, 1 - i, i), w) for a in (0, 1) for i in (0, 1)}


def stiffest(around: SpeedLoop, place: float, degrees: float) -> float:
    """Stiffness of the loop with both zeros there and the largest gain that leaves the margin, A/rad/s.

    The phase rises from -270 deg and falls again: up to where it has fallen to the margin first.
    """
    one, k_omega = loops(around), 1 - place * around.period / 2  # K = 1
    by_angle = [one[1, i] - one[0, i] for i in (0, 1)]  # the loop is linear in each of its gains
    L = k_omega * (one[0, 0] + place * by_angle[0]) + place * (one[0, 1] + place * by_angle[1])
    enough = np.append(np.degrees(np.unwrap(np.angle(-L))) >= degrees, False)
    if not np.any(enough):
        return 0.0
    begin = int(np.argmax(enough))
    end = begin + int(np.argmin(enough[begin:]))
    return float(np.max(1 / np.abs(L[begin:end]))) * place**2


IDEAL = "verrelli2016-position"
SHARES = [0.5, *np.geomspace(0.51, 0.99, 12), 1.0, *np.geomspace(1.01, 1.9, 12), 2.0]


@pytest.mark.parametrize(
    ("name", "changes"),
    [(IDEAL, {}), *(("verrelli2016", c) for c in ({}, DELAYED, SLOW, {**DELAYED, **SLOW}))],
)
@pytest.mark.parametrize("degrees", [30.0, 45.0, 60.0])
def test_no_loop_of_this_margin_with_both_zeros_at_one_place_is_stiffer(
    name: str, changes: dict[str, Any], degrees: float
) -> None:
    around = speed_loop(load(name, changes))
    k_theta, k_omega, k_i = phase_margin_position(around, 1, tuning(degrees))
    K = k_omega + k_i * around.period / 2
    assert k_i / K == pytest.approx(k_theta)
    found = {share: stiffest(around, share * k_theta, degrees) for share in SHARES}
    assert found[1.0] == pytest.approx(K * k_theta**2, rel=0.01)
    assert max(found.values()) < 1.005 * found[1.0]
    assert max(found[0.5], found[2.0]) < 0.7 * found[1.0]


def test_the_frame_only_scales_the_gains() -> None:
    around = loop({})
    mechanical = phase_margin_position(around, 1, tuning(45))
    electrical = phase_margin_position(around, 50, tuning(45))
    assert electrical[0] == pytest.approx(mechanical[0])
    assert [50 * gain for gain in electrical[1:]] == pytest.approx(mechanical[1:])
    w = np.geomspace(1, 1e4, 50)
    assert open_loop(around, linear(50, *electrical), w) == pytest.approx(
        open_loop(around, linear(1, *mechanical), w)
    )


def test_around_a_pure_delay_the_place_is_that_in_closed_form() -> None:
    around, margin = speed_loop(load(IDEAL)), math.radians(60)
    x = np.linspace(1.5, 20, 200001)
    lag = 2 * np.arctan(x) - math.pi / 2 - margin  # w T_e
    best = x[np.argmax(np.where(lag > 0, lag, 0) ** 3 / x**2)]
    w = (2 * math.atan(best) - math.pi / 2 - margin) / (around.period / 2)  # of a hold, T_e = T / 2
    assert phase_margin_position(around, 1, tuning(60))[0] == pytest.approx(w / best, rel=0.05)


def test_gains_of_a_study_are_its_own_or_by_its_rule() -> None:
    study = load("verrelli2016")
    assert position_gains(study, "pi") == (5.0, 5.0, 50.0)
    ratio = study.controller["fair"].ratio(study.motor.pole_pairs)
    rule = phase_margin_position(speed_loop(study), ratio, tuning(45))
    assert position_gains(study, "fair") == pytest.approx(rule)


def test_a_margin_that_this_loop_cannot_have_is_refused() -> None:
    around = loop({})
    assert isinstance(around, SpeedLoop)
    assert isinstance(around.current, SampledLoop)
    unstable = replace(around, current=replace(around.current, kp=1000.0))
    assert not position_margins(unstable, linear(1, 5.0, 5.0, 50.0)).stable
    with pytest.raises(ValueError, match="a loop that reaches this phase margin with some gains"):
        phase_margin_position(unstable, 1, tuning(45))


def test_a_study_names_the_current_loop_that_is_in_the_way() -> None:
    study = load("verrelli2016", {"drive.current_loop.kp": "20 V/A", "drive.inverter.computation_delay": 1})
    assert isinstance(study.drive.current_loop, CurrentLoop)
    with pytest.raises(
        StudyError, match=r'kp: "20 V/A" and \S+ki: "500 V/A/s": expected 30 deg .* controller\.fair'
    ):
        position_gains(study, "fair")


def test_no_gains_no_loop(tmp_path: Path) -> None:
    around = speed_loop(studies.study(tmp_path))
    assert position_margins(around, linear(1, 0.0, 0.0, 0.0)).stable
