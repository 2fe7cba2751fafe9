"""The current loop at speed, against a motor of a few lines of NumPy in the stator's frame."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import studies
from cogless.design.turning import growth, late_angle, unstable_turning
from cogless.run.simulate import simulate
from cogless.study import Study, changed


def turning(folder: Path, decoupling: bool, delay: int, salient: bool) -> Study:
    changes = {
        "motor.L_d": "20 mH" if salient else "30 mH",
        "drive.rates": {"current_loop": "2 kHz", "speed_loop": "1 kHz", "integration_steps": 8},
        "drive.current_loop": {"bandwidth": "120 Hz", "decoupling": decoupling, "current_limit": "3 A"},
        "drive.inverter.computation_delay": delay,
        "controller.fair": {"law": "pi", "kp": 0.1, "ki": 1.0},
    }
    return studies.study(folder, changes)


def own_growth(study: Study, omega_m: float) -> float:
    """The factor from period to period of a small current, by the winding's equation in the stator's frame,
    integrated by Euler's method in 100 steps a period, under the same controller."""
    motor, T, w = study.motor.star(), 1 / 2000, study.motor.star().pole_pairs * omega_m
    loop, delay = study.drive.current_loop, study.drive.inverter.computation_delay
    gains, L = loop.gains(motor), np.array([motor.L_d, motor.L_q])
    kp, ki = np.array([gains["kp_d"], gains["kp_q"]]), np.array([gains["ki_d"], gains["ki_q"]])

    def turn(x, angle):
        c, s = math.cos(angle), math.sin(angle)
        return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])

    i, integral, waiting, theta = np.array([1e-3, 2e-3]), np.zeros(2), np.zeros(2), 0.3
    sizes = []
    for _ in range(200):
        u = -kp * i + integral
        if loop.decoupling:
            u = u + w * np.array([-L[1] * i[1], L[0] * i[0]])
        integral = integral - ki * T * i
        stator = turn(u, theta + (1.5 if delay else 0.5) * w * T)
        acting, waiting = (waiting, stator) if delay else (stator, waiting)
        for _ in range(100):
            h = T / 100
            flux = L * i
            d = turn(acting, -theta) - motor.R_s * i - w * np.array([-flux[1], flux[0]])
            i, theta = i + h * d / L, theta + w * h
        size = float(np.linalg.norm(np.concatenate([i, integral / kp])))
        sizes.append(size)
        if not 1e-200 < size < 1e200:
            break
    n = len(sizes) // 2
    return (sizes[-1] / sizes[n - 1]) ** (1 / (len(sizes) - n))


@pytest.mark.parametrize("salient", [False, True])
@pytest.mark.parametrize(("decoupling", "delay"), [(True, 1), (True, 0), (False, 1)])
def test_the_growth_is_that_of_an_own_motor(tmp_path, decoupling, delay, salient):
    study = turning(tmp_path, decoupling, delay, salient)
    for speed in (100.0, 400.0):
        assert growth(study, "low", speed) == pytest.approx(own_growth(study, speed), abs=0.01)


def test_the_drive_loses_its_current_where_the_growth_is_above_one(tmp_path):
    """Between the speeds at which the growth is .97 and 1.06 the current leaves its limit."""
    study = turning(tmp_path, True, 1, False)
    speeds = np.linspace(10, 1200, 120)
    factors = np.array([growth(study, "low", speed) for speed in speeds])
    calm, wild = speeds[factors < 0.97][-1], speeds[factors > 1.06][0]
    quiet = {
        "metric": [],
        "motor.cogging": [],
        "scenario.low.duration": "0.3 s",
        "drive.inverter.bus_voltage": "2000 V",
    }

    def run(speed):
        at = {"scenario.low.reference": f"{speed} rad/s", "scenario.low.initial_speed": f"{speed} rad/s"}
        there = changed(study, {**quiet, **at})
        trace = simulate(there, "low", "fair").trace
        return unstable_turning(there, "low"), float(np.max(np.abs(trace["i_d"][len(trace) // 2 :])))

    (said, small), (warned, large) = run(calm), run(wild)
    assert said is None and small < 0.3
    assert warned is not None and large > 3


def test_a_late_angle_counts_in_electrical_turns(tmp_path):
    sensor = {"kind": "absolute", "bits": 16, "latency": "1 ms"}
    study = studies.study(
        tmp_path, {"drive.position_sensor": sensor, "drive.rates.integration_steps": 4, "metric": []}
    )
    at = [changed(study, {"scenario.low.reference": f"{w} rad/s"}) for w in (175, 200, 500)]
    assert late_angle(at[0], "low") is None  # 4 pole pairs: 40 degrees
    assert "46 deg (electrical) late, which leaves 70 % of the torque" in str(late_angle(at[1], "low"))
    assert "115 deg (electrical) late, which reverses the torque" in str(late_angle(at[2], "low"))
