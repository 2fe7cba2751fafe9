"""References: speed, angle and acceleration in closed form, smoothing, an hour without drift."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from engine import config, drive_of, merged, run, signals
from step_motor import LAW

from cogless import _simulator_f64

TURN = 2.0 * np.pi
TIMES, SPEEDS = [0.5, 1.0, 4.0, 40.0], [1.0, 5.0, -2.0, 3.0]
MOVES: dict[str, Any] = {"kind": "moves", "times": [1.0, 3.0, 4.0, 50.0], "angles": [2.0, 5.0, -1.0, 40.0]}


def follow(reference: dict[str, Any], seconds: float, rate: int = 1000, **more: Any) -> dict[str, np.ndarray]:
    """A rotor that a position law doesn't move; every tick records the reference."""
    memory = {"kind": "CGL_MEMORY_ANGLE", "cells": 8}
    gains = {"k_omega": 0.0, "k_theta": 0.0, "k_i": 0.0}
    idle = merged(LAW, {"config": {**gains, "memory": memory}, "learning_start": 1e9})
    drive = {"ideal_current": True, "current_rate": rate, "speed_divider": 1}
    settings = config({"initial_speed": 0.0, "drive": drive, "controller": idle, **more})
    settings["reference"] = reference
    engine = drive_of(_simulator_f64, settings)
    return signals(engine, _simulator_f64, round(seconds * rate) + 1)


def move(t: np.ndarray) -> np.ndarray:
    """Speed of the moves, each from its own time scale."""
    omega = np.zeros_like(t)
    for k in range(3):
        (start, end), (a, b) = MOVES["times"][k : k + 2], MOVES["angles"][k : k + 2]
        s = np.clip((t - start) / (end - start), 0.0, 1.0)
        omega += (b - a) / (end - start) * 30.0 * s**2 * (1.0 - s) ** 2
    return omega


# kind, speed as a function of time
KINDS: dict[str, tuple[dict[str, Any], Callable[[np.ndarray], np.ndarray]]] = {
    "constant": ({"kind": "constant", "speed": 4.0}, lambda t: np.full_like(t, 4.0)),
    "ramp": ({"kind": "ramp", "speed": -2.0, "ramp": 0.1}, lambda t: np.maximum(-0.1 * t, -2.0)),
    "profile": ({"kind": "profile", "times": TIMES, "speeds": SPEEDS}, lambda t: np.interp(t, TIMES, SPEEDS)),
    "sine": (
        {"kind": "sine", "offset": 3.0, "amplitude": 2.0, "frequency": 0.7},
        lambda t: 3.0 + 2.0 * np.sin(TURN * 0.7 * t),
    ),
    "paper": (
        {"kind": "fm", "offset": 0.3, "amplitude": 0.1, "frequency": 1.0, "depth": 1.0, "modulation": 0.5},
        lambda t: (15.0 + 5.0 * np.sin(TURN * t + np.sin(np.pi * t))) / 50,
    ),
    "fm": (
        {
            "kind": "fm",
            "offset": -1.0,
            "amplitude": 2.0,
            "frequency": 0.31,
            "depth": -7.3,
            "modulation": 0.13,
        },
        lambda t: -1.0 + 2.0 * np.sin(TURN * 0.31 * t - 7.3 * np.sin(TURN * 0.13 * t)),
    ),
    "sines": (
        {
            "kind": "sines",
            "offset": 1.0,
            "sines": [
                {"amplitude": 2.0, "frequency": 0.4, "phase": 1.1},
                {"amplitude": 0.5, "frequency": 1.7, "phase": -2.0},
                {"amplitude": 0.3, "frequency": 0.0, "phase": 0.5},
            ],
        },
        lambda t: (
            1.0 + 2.0 * np.sin(TURN * 0.4 * t + 1.1) + 0.5 * np.sin(TURN * 1.7 * t - 2.0) + 0.3 * np.sin(0.5)
        ),
    ),
    "moves": (MOVES, move),
}
BREAKS = {"ramp": [20.0], "profile": TIMES, "moves": MOVES["times"]}


@pytest.mark.parametrize("kind", KINDS)
def test_angle_is_the_integral_and_acceleration_the_derivative(kind: str) -> None:
    reference, omega = KINDS[kind]
    x = follow(reference, 100.0, 100, initial_angle=0.7)
    t = x["time"]
    assert np.abs(x["omega_ref"] - omega(t)).max() <= 1e-12
    # Gauss's rule of eight points on each sample; kinks fall on samples
    nodes, weights = np.polynomial.legendre.leggauss(8)
    middles = 0.5 * (t[1:] + t[:-1])
    steps = omega(middles[:, None] + 0.005 * nodes) @ weights * 0.005
    assert np.abs(x["theta_ref"] - 0.7 - np.concatenate([[0.0], np.cumsum(steps)])).max() <= 1e-9
    smooth = np.all([np.abs(middles - at) > 0.011 for at in BREAKS.get(kind, [-1.0])], axis=0)
    h = 1e-3
    slope = (8 * (omega(t + h) - omega(t - h)) - (omega(t + 2 * h) - omega(t - 2 * h))) / (12 * h)
    assert np.abs(x["alpha_ref"] - slope)[:-1][smooth].max() <= 1e-7


@pytest.mark.parametrize(
    ("kind", "mean"), [("paper", 0.3), ("sine", 3.0), ("sines", 1.0 + 0.3 * np.sin(0.5))]
)
def test_no_drift_in_an_hour(kind: str, mean: float) -> None:
    # the hour is a whole number of their periods
    x = follow(KINDS[kind][0], 3600.0, 100, initial_angle=0.2)
    assert x["theta_ref"][-1] == pytest.approx(0.2 + 3600.0 * mean, abs=1e-9)


@pytest.mark.parametrize("tau", [0.02, 0.5])
def test_smoothing_answers_a_step_as_two_equal_lags(tau: float) -> None:
    x = follow({"kind": "constant", "speed": 4.0, "smoothing": tau}, 5.0, 100, initial_speed=1.0)
    t = x["time"]
    decay = np.exp(-t / tau)
    assert x["omega_ref"] == pytest.approx(4.0 - 3.0 * (1.0 + t / tau) * decay, abs=1e-12)
    assert x["alpha_ref"] == pytest.approx(3.0 * t / tau**2 * decay, abs=1e-11 / tau)
    angle = 4.0 * t - 3.0 * (2.0 * tau - (2.0 * tau + t) * decay)
    assert x["theta_ref"] == pytest.approx(angle, abs=1e-12)


def test_smoothing_of_a_sine_with_fourth_order() -> None:
    tau, f, errors = 0.1, 0.8, []
    gain = 1.0 / (1.0 + 1j * TURN * f * tau) ** 2
    for rate in (50, 100, 200):
        sine = {"kind": "sine", "offset": 3.0, "amplitude": 2.0, "frequency": f, "smoothing": tau}
        x = follow(sine, 10.0, rate)
        late = x["time"] > 5.0
        expected = 3.0 + 2.0 * np.imag(gain * np.exp(1j * TURN * f * x["time"][late]))
        errors.append(np.abs(x["omega_ref"][late] - expected).max())
    assert errors[-1] < 1e-7
    assert np.log2(np.array(errors[:-1]) / np.array(errors[1:])).min() > 3.7, errors


@pytest.mark.parametrize("kind", KINDS)
def test_smoothed_angle_is_the_integral_of_the_smoothed_speed(kind: str) -> None:
    x = follow({**KINDS[kind][0], "smoothing": 0.2}, 60.0, 1000, initial_angle=-0.4)
    omega, alpha, h = x["omega_ref"], x["alpha_ref"], 1e-3
    # trapezia with their correction by the slopes
    steps = 0.5 * h * (omega[1:] + omega[:-1]) + h * h / 12 * (alpha[:-1] - alpha[1:])
    assert np.abs(x["theta_ref"] + 0.4 - np.concatenate([[0.0], np.cumsum(steps)])).max() <= 1e-8
    assert np.abs(np.diff(alpha)).max() < 0.2  # no jump: the speed is differentiable


def test_laws_of_speed_record_no_angle_but_see_it() -> None:
    seen = []

    class Law:
        def step(self, x: Any) -> float:
            seen.append((x.theta_ref, x.alpha_ref))
            return 0.0

    sine, _ = KINDS["sine"]
    x = run({"reference": sine, "controller": {"law": "python"}}, 4.0, controller=Law())
    assert "theta_ref" not in x
    there = follow(sine, 3.999)
    assert np.array(seen) == pytest.approx(
        np.stack([there["theta_ref"] % TURN, there["alpha_ref"]], axis=1), abs=1e-9
    )


def test_what_has_no_meaning_is_refused() -> None:
    with pytest.raises(ValueError, match=r"reference.times: expected rising times, one for each angle"):
        follow({**MOVES, "angles": [0.0]}, 0.1)
    with pytest.raises(ValueError, match=r"reference.smoothing: expected 0, or a tenth"):
        follow({"kind": "constant", "speed": 1.0, "smoothing": 1e-5}, 0.1)
    with pytest.raises(ValueError, match=r"reference.depth: expected at most 100 rad"):
        follow({**KINDS["fm"][0], "depth": 1e3}, 0.1)


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_a_row_between_samples_of_the_law_has_the_reference_of_its_time(smoothing: float) -> None:
    """Not the one that the law holds: an error against that would be a sawtooth."""
    reference, omega = KINDS["paper"]
    reference = {**reference, "smoothing": smoothing}
    slow = {"ideal_current": True, "current_rate": 1000, "speed_divider": 10}
    x, fine = follow(reference, 5.0, drive=slow), follow(reference, 5.0)
    bound = 1e-9 if smoothing == 0.0 else 2e-5  # straight on from the sample, and smooth
    assert np.abs(x["theta_ref"] - fine["theta_ref"]).max() <= bound
    begun = x["time"] > 0.5  # when the filter follows
    assert x["omega_ref"][begun] == pytest.approx(
        fine["omega_ref"][begun], abs=1e-9 if smoothing == 0.0 else 1e-3
    )
    if smoothing == 0.0:
        assert x["omega_ref"] == pytest.approx(omega(x["time"]), abs=1e-12)
        assert np.abs(np.diff(x["omega_ref"])).min() < np.abs(np.diff(x["omega_ref"])).max() < 2e-3
