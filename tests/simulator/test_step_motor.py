"""The step motor: against the paper's equations; its energy, its inverter and sensors."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from engine import drive_of, merged, run, signals
from scipy.integrate import solve_ivp
from step_motor import DRIVE, I_F, L_0, L_F4, L_M, N_R, N_T, SECTION_5, D, J, R, motor

from cogless import _simulator_f64

STEP: dict[str, Any] = {
    "motor": motor(),
    "mechanics": {"inertia": J, "viscous_friction": D},
    "load": {"harmonics": [{"order": 1, "torque": N_T, "phase": 0.0}]},
    "drive": DRIVE,
}
L_1 = 0.1e-3


def cogging(theta: Any) -> Any:
    return -N_R * I_F**2 / 2 * 4 * L_F4 * np.sin(4 * N_R * theta)


def printed(_: float, y: np.ndarray, u_d: float, u_q: float) -> list[float]:
    """Section 5, full order in the rotor's frame, as printed; voltages held in the stationary frame."""
    i_d, i_q, omega, theta = y
    a = N_R * theta
    v_d, v_q = np.cos(a) * u_d + np.sin(a) * u_q, np.cos(a) * u_q - np.sin(a) * u_d
    sines = sum(j * L * np.sin((1 - j) * a) for j, L in enumerate(L_M, 1))
    cosines = sum(j * L * np.cos((1 - j) * a) for j, L in enumerate(L_M, 1))
    torque = I_F * N_R * (sines * i_d + cosines * i_q) + cogging(theta) - N_T * np.sin(theta)
    return [
        -R / L_0 * i_d + N_R * i_q * omega + v_d / L_0 - I_F * N_R / L_0 * sines * omega,
        -R / L_0 * i_q - N_R * i_d * omega + v_q / L_0 - I_F * N_R / L_0 * cosines * omega,
        (torque - D * omega) / J,
        omega,
    ]


def by_energy(_: float, y: np.ndarray, u_a: float, u_b: float) -> list[float]:
    """The same machine with L_1, in the stationary frame, from its flux linkages and its coenergy."""
    i_a, i_b, omega, theta = y.tolist()
    a = N_R * theta
    c, s = L_1 * math.cos(2 * a), L_1 * math.sin(2 * a)  # L = [L_0 + c, s; s, L_0 - c], in plain numbers
    L_a, L_b = 2 * N_R * (c * i_b - s * i_a), 2 * N_R * (c * i_a + s * i_b)  # dL/dtheta i
    # the rotor's flux is L_mj cos(j a) in phase a, L_mj cos(j a - pi/2) in b
    flux_a = -I_F * N_R * sum(j * Lm * math.sin(j * a) for j, Lm in enumerate(L_M, 1))
    flux_b = I_F * N_R * sum(j * Lm * math.cos(j * a) for j, Lm in enumerate(L_M, 1))
    v_a, v_b = u_a - R * i_a - omega * (L_a + flux_a), u_b - R * i_b - omega * (L_b + flux_b)
    det = L_0**2 - c**2 - s**2
    torque = i_a * (0.5 * L_a + flux_a) + i_b * (0.5 * L_b + flux_b) + cogging(theta) - N_T * math.sin(theta)
    return [
        ((L_0 - c) * v_a - s * v_b) / det,
        ((L_0 + c) * v_b - s * v_a) / det,
        (torque - D * omega) / J,
        omega,
    ]


@pytest.mark.parametrize("equations", [printed, by_energy])
def test_follows_the_papers_full_order_model(equations: Any) -> None:
    rate, salient = 2000, equations is by_energy
    holding: dict[str, Any] = {
        **STEP,
        "motor": motor(L_1 if salient else 0.0),
        "reference": {"kind": "sine", "offset": 0.6, "amplitude": 0.5, "frequency": 2.0},
        "initial_speed": 0.6,
        "drive": {
            **DRIVE,
            "current_rate": rate,
            "integration_steps": 20,
            "kp_d": 0.3,
            "kp_q": 0.3,
            "ki_d": 200.0,
            "ki_q": 200.0,
        },
        "controller": {"law": "python"},
    }

    class Law:
        def step(self, x: Any) -> tuple[float, float]:
            return (-1.5, 60.0 * (x.omega_ref - x.omega_m))

    # half of the reference's rise, more than a whole electrical period
    x = run(holding, 0.25 + 1 / rate, controller=Law())
    # the voltage acts in the tick that computes it, at the angle expected for its middle
    angle = N_R * (x["theta_m"] + 0.5 / rate * x["omega_m"])
    u_a = np.cos(angle) * x["u_d"] - np.sin(angle) * x["u_q"]
    u_b = np.sin(angle) * x["u_d"] + np.cos(angle) * x["u_q"]
    currents = ("i_a", "i_b") if salient else ("i_d", "i_q")
    states = np.stack([*(x[name] for name in currents), x["omega_m"], x["theta_m"]], axis=1)
    y = states[0]
    path = [y]
    for n in range(rate // 4):
        piece = (0.0, 1.0 / rate)
        held = (u_a[n], u_b[n])
        y = solve_ivp(equations, piece, y, method="DOP853", rtol=1e-12, atol=1e-12, args=held).y[:, -1]
        path.append(y)
    error = np.abs(states - np.array(path)) / np.ptp(states, axis=0)
    assert error.max() < 1e-6, error.max(axis=0)


def test_torque_has_the_mended_reluctance_term() -> None:
    """2 N_r L_1 i_d i_q over J, which the first model of Section 2 prints without J."""

    class Both:
        def step(self, x: Any) -> tuple[float, float]:
            return (3.0, 4.0 * np.sin(50.0 * x.time))

    x = run({**STEP, "motor": motor(L_1), "controller": {"law": "python"}}, 0.2, controller=Both())
    a = N_R * x["theta_m"]
    torque = 2 * N_R * L_1 * x["i_d"] * x["i_q"]
    for j, L in enumerate(L_M, 1):
        torque += I_F * N_R * j * L * (np.cos((1 - j) * a) * x["i_q"] + np.sin((1 - j) * a) * x["i_d"])
    assert x["tau_e"] == pytest.approx(torque, abs=1e-12)
    assert x["tau_cogging"] == pytest.approx(cogging(x["theta_m"]), abs=1e-12)


def test_current_fed_model_is_the_ideal_current_loop() -> None:
    seconds = 1.0
    asked = []

    class Steps:
        def step(self, x: Any) -> float:
            asked.append(4.0 * np.sin(9.0 * x.time) + 1.0)
            return float(asked[-1])

    drive = {**DRIVE, "ideal_current": True, "speed_divider": 100}
    x = run(
        {**STEP, "drive": drive, "initial_speed": 1.0, "controller": {"law": "python"}},
        seconds,
        controller=Steps(),
    )

    def current_fed(_: float, y: np.ndarray, i_q: float) -> list[float]:
        omega, theta = y
        gain = sum(j * L * np.cos((1 - j) * N_R * theta) for j, L in enumerate(L_M, 1))
        return [(I_F * N_R * gain * i_q + cogging(theta) - N_T * np.sin(theta) - D * omega) / J, omega]

    y = np.array([1.0, 0.0])
    states = np.stack([x["omega_m"], x["theta_m"]], axis=1)
    for n, i_q in enumerate(asked):
        assert np.abs(states[100 * n] - y) / np.ptp(states, axis=0) == pytest.approx(0.0, abs=1e-6)
        y = solve_ivp(current_fed, (0, 0.01), y, method="DOP853", rtol=1e-12, atol=1e-12, args=(i_q,)).y[
            :, -1
        ]


def residual(x: dict[str, np.ndarray]) -> float:
    out = x["energy_copper"] + x["energy_friction"] + x["energy_load"]
    balance = x["energy_electrical"] - out - (x["energy_stored"] - x["energy_stored"][0])
    return float(np.abs(balance).max())


def test_energy_balance_closes_with_the_fourth_power_of_the_step() -> None:
    change: dict[str, Any] = {
        **STEP,
        "motor": motor(L_1),
        "energy": True,
        "reference": {"kind": "sine", "offset": 1.0, "amplitude": 0.7, "frequency": 2.0},
        "initial_speed": 1.0,
        "controller": {"config": {"kp": 60.0, "ki": 100.0}},
    }
    gains = {"current_rate": 2000, "kp_d": 0.3, "kp_q": 0.3, "ki_d": 100.0, "ki_q": 100.0}
    residuals = [
        residual(run({**change, "drive": {**DRIVE, **gains, "integration_steps": steps}}, 1.0))
        for steps in (2, 4, 8)
    ]
    orders = np.log2(np.array(residuals[:-1]) / np.array(residuals[1:]))
    assert residuals[-1] < 1e-6
    assert orders.min() > 3.7, (residuals, orders)


def test_energy_balance_with_bridges_that_switch() -> None:
    change = {**STEP, "energy": True, "drive": {**DRIVE, "inverter": {"kind": "switched", "dead_time": 1e-6}}}
    x = run(
        {**change, "initial_speed": 0.5, "reference": {"speed": 0.5}, "controller": {"config": {"kp": 60.0}}},
        0.5,
    )
    assert residual(x) < 1e-6 * x["energy_electrical"].max()


def test_copper_loss_at_standstill_is_that_of_two_phases() -> None:
    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (3.0, 0.0)

    still = {**STEP, "mechanics": {"inertia": 1e6}, "initial_speed": 0.0, "energy": True}
    x = run({**still, "controller": {"law": "python"}}, 1.0, controller=HoldD())
    square = R * (x["i_a"] ** 2 + x["i_b"] ** 2)
    lost = np.concatenate([[0.0], np.cumsum(0.5 * (square[1:] + square[:-1])) / 10000])
    assert x["energy_copper"] == pytest.approx(lost, abs=1e-4 * lost[-1])
    assert x["i_a"][-1] ** 2 + x["i_b"][-1] ** 2 == pytest.approx(9.0, rel=1e-3)


def test_signals_have_two_phases() -> None:
    x = run({**STEP, "initial_angle": 0.3}, 0.05)
    assert "i_c" not in x
    a = N_R * x["theta_m"]
    assert x["i_a"] == pytest.approx(np.cos(a) * x["i_d"] - np.sin(a) * x["i_q"], abs=1e-12)
    assert x["i_b"] == pytest.approx(np.sin(a) * x["i_d"] + np.cos(a) * x["i_q"], abs=1e-12)


def test_an_offset_of_one_current_sensor_turns_once_in_the_rotors_frame() -> None:
    class Constant:
        def step(self, _: object) -> float:
            return 2.0

    change: dict[str, Any] = {
        **STEP,
        "motor": {**motor(), "flux_harmonics": []},
        "mechanics": {"inertia": 1e9},
        "initial_speed": 0.5,
        "drive": {**DRIVE, "current_sensors": {"offset": [0.2, 0.0, 0.0]}},
        "controller": {"law": "python"},
    }
    x = run(change, 1.0, controller=Constant())
    late = slice(5000, None)
    a = N_R * x["theta_m"][late]
    # the loop brings the measured currents to their references, so the true ones lack the offset
    assert x["i_d"][late] == pytest.approx(-0.2 * np.cos(a), abs=0.01)
    assert x["i_q"][late] == pytest.approx(2.0 + 0.2 * np.sin(a), abs=0.01)


# ---- two H-bridges ----


@pytest.mark.parametrize("kind", ["averaged", "switched"])
def test_dead_time_of_a_bridge_costs_twice_that_of_a_leg(kind: str) -> None:
    dead_time, bus, i_d, theta = 2e-6, 40.0, 4.0, 0.01

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (i_d, 0.0)

    change: dict[str, Any] = {
        **STEP,
        "motor": {**motor(), "L_d": 10e-3, "L_q": 10e-3},
        "mechanics": {"inertia": 1e6},
        "initial_speed": 0.0,
        "initial_angle": theta,
        "drive": {**DRIVE, "inverter": {"kind": kind, "dead_time": dead_time, "bus_voltage": bus}},
        "controller": {"law": "python"},
    }
    x = run(change, 0.3, controller=HoldD())
    lost = 2 * bus * dead_time * 10000  # of each phase; both currents are positive at half a radian
    assert x["i_d"][-1] == pytest.approx(i_d, abs=0.01)
    assert x["u_d"][-1] == pytest.approx(R * i_d + lost * (np.cos(0.5) + np.sin(0.5)), abs=0.01)
    assert x["u_q"][-1] == pytest.approx(lost * (np.cos(0.5) - np.sin(0.5)), abs=0.01)


def test_voltage_reaches_the_bus_and_not_beyond() -> None:
    change: dict[str, Any] = {
        **STEP,
        "drive": {**DRIVE, "inverter": {"bus_voltage": 6.0, "computation_delay": 0}},
        "reference": {"speed": 30.0},
        "initial_speed": 0.0,
        "controller": {"config": {"kp": 100.0}},
    }
    x = run(change, 1.0)
    u = np.hypot(x["u_d"], x["u_q"])
    assert u.max() == pytest.approx(6.0, rel=1e-9)
    assert np.any(x["status"].astype(int) & 1)


@pytest.mark.parametrize(
    ("dead_time", "angle", "minimum"),
    [(0.0, 0.2, 0.0), (2e-6, 0.9, 0.0), (4e-6, 2.5, 0.0), (4e-6, 4.0, 0.0), (0.0, 0.2, 9e-6)],
)
def test_averaged_voltage_is_the_mean_of_the_pulses(dead_time: float, angle: float, minimum: float) -> None:
    """With a shortest pulse of 18 % of a centred half, phase A gets all of the bus voltage for 69 % of it."""

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (5.0, 0.0)

    change: dict[str, Any] = {
        **STEP,
        "motor": {**motor(), "L_d": 10.0, "L_q": 10.0},
        "mechanics": {"inertia": 1e9},
        "initial_speed": 0.0,
        "initial_angle": angle / N_R,
        "controller": {"law": "python"},
    }
    after = []
    for kind in ("averaged", "switched"):
        inverter = {
            "kind": kind,
            "dead_time": dead_time,
            "bus_voltage": 50.0,
            "minimum_pulse": minimum,
        }
        gains = {"kp_d": 7.0, "kp_q": 7.0, "ki_d": 0.0, "ki_q": 0.0}
        x = run({**change, "drive": {**DRIVE, **gains, "inverter": inverter}}, 0.02, controller=HoldD())
        after.append([x["i_d"][-1], x["i_q"][-1]])
    assert after[1] == pytest.approx(after[0], rel=1e-4, abs=1e-6)
    if not dead_time:
        volts = 50.0 if minimum else 35.0 * np.cos(angle)
        assert x["i_a"][-1] == pytest.approx(volts * x["time"][-1] / 10.0, rel=0.02)


def test_switched_currents_approach_the_averaged_ones_as_the_carrier_rises() -> None:
    errors = []
    for rate in (10000, 20000, 40000):
        runs = []
        for kind in ("averaged", "switched"):
            drive = {"current_rate": rate, "inverter": {"kind": kind, "bus_voltage": 24.0}}
            change = merged(
                SECTION_5, {"drive": drive, "controller": {"config": {"memory": {"cells": 60000}}}}
            )
            runs.append(signals(drive_of(_simulator_f64, change), _simulator_f64, rate))
        errors.append(np.sqrt(np.mean((runs[1]["i_q"] - runs[0]["i_q"])[rate // 2 :] ** 2)))
    assert all(coarse > 1.7 * fine for coarse, fine in pairwise(errors)), errors


def test_other_numbers_of_phases_are_refused() -> None:
    with pytest.raises(ValueError, match=r"motor.phases: expected 2 or 3"):
        run({"motor": {"phases": 5}}, 0.01)
