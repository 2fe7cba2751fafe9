"""Studies of step motors and of laws that learn in angle: what they mean, and mistakes as one line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.errors import StudyError
from cogless.study import load
from cogless.study.reference import Reference
from cogless.study.step_motor import StepMotor

STEP = {
    "kind": "step",
    "teeth": 50,
    "R_s": "1 ohm",
    "L_0": "0.7 mH",
    "L_m": ["5 mH", "0.5 mH"],
    "L_f": ["1.766 mH"],
}
SPACE = {"law": "space-position", "k_theta": 5, "k_omega": 0.1, "mu_alpha": 5.0}
SPEED = {"law": "space-speed", "k": 0.1, "eta_bar": "1 rad/s", "period": {"of": "mechanical"}}


def line_of(folder: Path, changes: dict[str, Any]) -> str:
    path = studies.write(folder)
    with pytest.raises(StudyError) as error:
        load(path, changes)
    assert "\n" not in str(error.value)
    return str(error.value).replace(f"{folder}/study.toml: ", "")


def test_a_step_motor_in_the_words_of_the_plant() -> None:
    star = StepMotor.model_validate(STEP).star()
    assert (star.phases, star.pole_pairs, star.power_factor) == (2, 50, 1.0)
    assert star.K_t == pytest.approx(50 * 5e-3)
    (harmonic,) = star.flux_harmonics
    assert (harmonic.order, harmonic.d, harmonic.q) == (1, 0.5e-3, 0.5e-3)
    (cogging,) = star.cogging
    assert cogging.order == 200 and cogging.torque == pytest.approx(-0.5 * 50 * 4 * 1.766e-3)


@pytest.mark.parametrize(
    ("reference", "top", "slowest", "acceleration"),
    [
        ({"speed": "2 rad/s"}, 2.0, 2.0, 0.0),
        ({"offset": "3 rad/s", "amplitude": "1 rad/s", "frequency": "2 Hz"}, 4.0, 2.0, 4 * math.pi),
        ({"offset": "3 rad/s", "amplitude": "1 rad/s", "frequency": "2 Hz", "depth": 0.5,
          "modulation": "1 Hz"},
            4.0, 2.0, 5 * math.pi),
        ({"offset": "1 rad/s", "sines": [{"amplitude": "2 rad/s", "frequency": "1 Hz"}]},
            3.0, -1.0, 4 * math.pi),
        ({"moves": [["0 s", "0 rad"], ["2 s", "4 rad"]]}, 3.75, -3.75, 10 / math.sqrt(3)),
        ({"profile": [["0 s", "1 rad/s"], ["2 s", "5 rad/s"]]}, 5.0, 1.0, 2.0),
    ],
)  # fmt: skip
def test_what_a_reference_asks_at_most(
    reference: dict[str, Any], top: float, slowest: float, acceleration: float
) -> None:
    found = Reference.model_validate(reference)
    assert found.top_speed == pytest.approx(top)
    assert found.slowest == pytest.approx(slowest)
    assert found.top_acceleration == pytest.approx(acceleration)


def test_a_reference_from_a_file(tmp_path: Path) -> None:
    path = studies.write(tmp_path)
    (tmp_path / "speeds.csv").write_text("time,speed\n0,1.0\n0.2,3.0\n\n0.4,2.0\n")
    study = load(path, {"scenario.low.reference": {"file": "speeds.csv"}})
    assert study.scenario["low"].reference.points == ((0.0, 1.0), (0.2, 3.0), (0.4, 2.0))
    assert study.scenario["low"].top_speed == pytest.approx(2 * math.pi)  # it begins at 60 r/min


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time,speed\n0,1\n0,2\n", "line 3: expected a time after the line before"),
        ("time,speed\n0,1\n1,fast\n", "line 3: expected time in s and speed in rad/s"),
        ("time,speed\n", "expected lines of time in s and speed in rad/s"),
        (None, "expected a readable file at {folder}/speeds.csv"),
    ],
)
def test_a_file_that_is_no_reference(tmp_path: Path, text: str | None, problem: str) -> None:
    if text is not None:
        (tmp_path / "speeds.csv").write_text(text)
    found = line_of(tmp_path, {"scenario.low.reference": {"file": "speeds.csv"}})
    assert found == f'scenario.low.reference.file: "speeds.csv": {problem.format(folder=tmp_path)}'


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"controller.pi": {**SPEED, "period": {"of": "electrical", "turns": 3}}},
            "controller.pi.period: expected a period that fits into a revolution of the rotor, not 0.75 of "
            "one"),
        ({"controller.pi": {**SPACE, "memory": "delay"},
          "scenario.low.reference": {"offset": "1 rad/s", "amplitude": "1 rad/s", "frequency": "1 Hz"}},
            'controller.pi.memory: "delay": expected "map": the reference of scenario low comes down to 0 '
            "rad/s, and a delay line needs omega_min, 0.01 rad/s, or more"),
        ({"controller.pi": {**SPACE, "memory": "delay", "cells": 100}},
            "controller.pi.cells: 100: expected 250 or more, the samples of a period at the slowest speed of "
            "scenario low"),
        ({"controller.pi": {**SPACE, "period": {"parts": 100}}},
            "controller.pi.period: expected a longer one: at the top speed of scenario low it has 2.5 "
            "samples, at least 4 are needed"),
        ({"controller.pi": {**SPACE, "q_half_width": 600}},
            "controller.pi.q_half_width: 600: expected a filter within the 1024 cells of the memory"),
        ({"controller.pi": {**SPACE, "omega_min": "0 rad/s"}},
            'controller.pi.omega_min: "0 rad/s": expected a speed above zero'),
        ({"controller.pi": {"law": "space-position", "k_theta": 5}},
            "controller.pi: expected either k_theta and k_omega or tuning, such as "
            '{ rule = "phase-margin", phase_margin = "60 deg" }'),
        ({"motor": {**STEP, "L_1": "0.8 mH"}}, 'motor.L_1: "0.8 mH": expected less than L_0'),
        ({"motor": {**STEP, "L_m": []}}, "motor.L_m: []: expected L_m1, above zero, and the others after it"),
        ({"drive.current_loop": {"kind": "ideal", "current_limit": "3 A"}},
            "drive.inverter: expected none, since the current loop is ideal"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, changes: dict[str, Any], line: str) -> None:
    assert line_of(tmp_path, changes) == line


def test_metrics_in_the_electrical_frame(tmp_path: Path) -> None:
    from cogless import run_study

    changes = {
        "metric": [
            {"name": "m", "kind": "peak-to-peak", "signal": "omega_m", "frame": frame, "scenarios": ["low"]}
            for frame in ("mechanical",)
        ]
    }
    study = load(studies.write(tmp_path), changes)
    turned = load(studies.write(tmp_path), {"metric": [{**changes["metric"][0], "frame": "electrical"}]})
    (one,), (other,) = (run_study(s, ["low/pi"]).runs for s in (study, turned))
    assert other.metrics["m_rad_s"] == pytest.approx(4 * np.float64(one.metrics["m_rad_s"]))
