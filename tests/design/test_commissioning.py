"""Whether the run that fills an anti-cogging table can: against simulation, and what is said of it."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import studies
from cogless.design.closed_loop import Linear
from cogless.design.laws.anti_cogging import commissioning_warning, position_gain, share_left, unsettled
from cogless.design.speed_loop import speed_loop
from cogless.design.warnings import notes
from cogless.errors import StudyError
from cogless.run.simulate import run_study
from cogless.study import Study, load

PI = {"kp": 0.15, "ki": 3.0}
TEXT = f"""title = "A table"
{studies.IDEAL}
[scenario]
low = {{ duration = "2 s", reference = "60 rpm", initial_speed = "60 rpm" }}
[controller]
pi = {{ law = "pi", kp = {PI["kp"]}, ki = {PI["ki"]} }}
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
window = ["1 s", "2 s"]
"""
K_THETA = 20.0


def table(folder: Path, speed: float, k_theta: float = K_THETA) -> Study:
    """A drive that cogs with order 24, and whose controller t fills a table at a speed in rad/s."""
    run = {"speed": speed, "position_gain": k_theta}
    law = {"law": "anti-cogging", **PI, "cells": 1024, "calibration": run}
    return studies.study(folder, {"controller.t": law}, TEXT)


def ripple(study: Study, name: str) -> float:
    """RMS of the speed about its mean in the second half, rad/s."""
    omega = run_study(study, [f"low/{name}"]).runs[0].trace["omega_m"]
    return float(np.std(omega[len(omega) // 2 :]))


@cache
def alone(folder: Path) -> float:
    """The ripple that the PI leaves without a table, rad/s."""
    return ripple(table(folder, 1.0), "pi")


@pytest.mark.parametrize(("speed", "within"), [(3.0, 0.15), (6.0, 0.15), (12.0, 0.6), (24.0, 0.6)])
def test_a_table_leaves_in_simulation_what_is_predicted(tmp_path: Path, speed: float, within: float) -> None:
    """Order 24 is met at 11 to 92 Hz, with a crossover of 12 Hz; fast ones record while they accelerate."""
    study = table(tmp_path, speed)
    loop, feedback = speed_loop(study, "low"), Linear(ratio=1, k=PI["kp"], k_theta=K_THETA, k_i=PI["ki"])
    cogging = 4e-3 / (1.5 * 4 * 20e-3)  # A
    (share,) = share_left(loop, feedback, np.array([24 * speed]))
    predicted = math.hypot(share, unsettled(loop, feedback, speed) / cogging)
    assert ripple(study, "t") / alone(tmp_path) == pytest.approx(predicted, rel=within)


def test_the_position_loop_of_a_rule_is_a_quarter_as_fast_as_the_speed_loop(tmp_path: Path) -> None:
    """kp K_t / J is the crossover, but for the integral and half a sample."""
    loop = speed_loop(table(tmp_path, 1.0), "low")
    assert position_gain(loop, (PI["kp"], 0.0)) == pytest.approx(PI["kp"] * loop.b / 4, rel=0.01)


@pytest.mark.parametrize(
    ("speed", "k_theta", "line"),
    [
        (3.0, K_THETA, None),
        (6.0, K_THETA,
            "its calibration run in scenario low turns too fast to record order 24 (22.9 Hz) well: with the "
            'table the ripple would be 0.95 times as large as without it; speed = "7.5 rpm" would be '
            'enough by '
            "calculation"),
        (12.0, K_THETA,
            "its calibration run in scenario low begins to record 65.4 ms after a reversal, when the rotor "
            "has not settled yet: with the table the ripple would be 1.8 times as large as without it; "
            'speed = "7.5 rpm" would be enough by calculation'),
        (0.7, 2000.0,
            'its calibration run in scenario low is unstable, at 61.1 Hz; position_gain = "18.8 1/s" would '
            "be enough by calculation"),
    ],
)  # fmt: skip
def test_a_run_that_does_not_record_the_cogging_is_told(
    tmp_path: Path, speed: float, k_theta: float, line: str | None
) -> None:
    study = table(tmp_path, speed, k_theta)
    found = commissioning_warning(study, "t")
    assert (None if found is None else str(found)) == line
    assert [*map(str, notes(study, "t"))] == ([] if line is None else [f"controller.t: {line}"])
    assert commissioning_warning(study, "pi") is None


@pytest.mark.parametrize("kp", [0.0, 1e-12, 1e-4])
def test_a_loop_without_a_crossover_follows_nothing(tmp_path: Path, kp: float) -> None:
    """As a tuning may try it. It was said to leave nan of the ripple, and the run does not even end."""
    fast = {"law": "anti-cogging", "kp": kp, "ki": 0.0, "calibration": {"speed": 24.0, "position_gain": 20.0}}
    study = studies.study(tmp_path, {"controller.t": fast}, TEXT)
    told = commissioning_warning(study, "t")
    assert told is not None and told.cures == ()
    assert str(told) == (
        "its calibration run in scenario low records nothing: the speed loop has no crossover, so the rotor "
        "follows no reference"
    )
    with pytest.raises(
        StudyError,
        match=r"the calibration run is not done after 1\.77 s: expected kp and ki that hold the run's speed",
    ):
        ripple(study, "t")


def test_what_is_told_elsewhere_or_has_nothing_to_record_is_not_told(tmp_path: Path) -> None:
    """An unstable feedback, a motor that doesn't cog, a table that is there already."""
    fast = {"law": "anti-cogging", **PI, "calibration": {"speed": 24.0, "position_gain": K_THETA}}
    unstable = {**fast, "kp": 100.0}
    there = {key: value for key, value in fast.items() if key != "calibration"} | {"start": {"map": "a.bin"}}
    for law, changes in ((unstable, {}), (fast, {"motor.cogging": []}), (there, {})):
        study = studies.study(tmp_path, {"controller.t": law, **changes}, TEXT)
        assert commissioning_warning(study, "t") is None


def test_shipped_runs_record_the_cogging() -> None:
    for name in ("uomodri", "on-the-bench", "hub-motor", "gimbal"):
        study = load(name)
        tables = [key for key, law in study.controller.items() if law.law == "anti-cogging"]
        assert [commissioning_warning(study, key) for key in tables] == [None] * len(tables)
