"""The plant: energy balance, order of the integrator, agreement with DOP853 and with closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, Signals, config, run
from scipy.integrate import solve_ivp

LOADED: dict[str, Any] = {
    "motor": RIPPLE,
    "mechanics": {"viscous_friction": 1e-3},
    "load": {"torque": 0.2, "harmonics": [{"order": 1, "torque": 0.05, "phase": 0.2}]},
    "energy": True,
    "reference": {"kind": "sine", "offset": 20.0, "amplitude": 15.0, "frequency": 3.0},
}


def residual(x: Signals) -> float:
    """Largest |electrical in - copper - friction - load - stored| over the run, J."""
    out = x["energy_copper"] + x["energy_friction"] + x["energy_load"]
    balance = x["energy_electrical"] - out - (x["energy_stored"] - x["energy_stored"][0])
    return float(np.max(np.abs(balance)))


def test_energy_balance_closes_with_the_fourth_power_of_the_step() -> None:
    rates = {"current_rate": 1000, "speed_divider": 1, "kp_d": 0.2, "kp_q": 0.3, "ki_d": 20.0, "ki_q": 20.0}
    residuals = [
        residual(run({**LOADED, "drive": {**rates, "integration_steps": steps}}, 1.0))
        for steps in (1, 2, 4, 8)
    ]
    orders = np.log2(np.array(residuals[:-1]) / np.array(residuals[1:]))
    assert residuals[-1] < 1e-5
    assert orders.min() > 3.7, (residuals, orders)


def test_energy_balance_at_the_usual_step() -> None:
    x = run(LOADED, 1.0)
    assert residual(x) < 1e-6 * x["energy_electrical"].max()


@pytest.mark.parametrize("kind", ["averaged", "switched"])
def test_energy_balance_with_sticking_friction_and_dead_time(kind: str) -> None:
    change: dict[str, Any] = {
        **LOADED,
        "mechanics": {"coulomb_friction": 0.05, "breakaway_friction": 0.08},
        "reference": {"kind": "sine", "offset": 0.0, "amplitude": 5.0, "frequency": 2.0},
        "initial_speed": 0.0,
        "load": {"torque": 0.0},
        "drive": {"inverter": {"kind": kind, "dead_time": 2e-6}},
    }
    x = run(change, 1.0)
    assert np.count_nonzero(np.diff(x["theta_m"]) == 0.0) > 100  # it did stick
    assert residual(x) < 1e-5 * x["energy_electrical"].max()


def slope(
    motor: dict[str, Any], mechanics: dict[str, Any], y: np.ndarray, u: np.ndarray, load: float
) -> list[float]:
    """The motor's equations in scalar form, transcribed from Liu (1) to (4) with both axes' harmonics."""
    i_d, i_q, omega, theta = y
    p = motor["pole_pairs"]
    th = p * theta
    u_d = np.cos(th) * u[0] + np.sin(th) * u[1]
    u_q = -np.sin(th) * u[0] + np.cos(th) * u[1]
    psi_d, psi_q, dpsi_d, dpsi_q = motor["psi_f"], 0.0, 0.0, 0.0
    for h in motor["flux_harmonics"]:
        n = h["order"]
        psi_d += h["d"] * np.cos(n * th + h["d_phase"])
        dpsi_d -= n * h["d"] * np.sin(n * th + h["d_phase"])
        psi_q += h["q"] * np.sin(n * th + h["q_phase"])
        dpsi_q += n * h["q"] * np.cos(n * th + h["q_phase"])
    lambda_d = psi_d + motor["L_d"] * i_d
    lambda_q = psi_q + motor["L_q"] * i_q
    e_d, e_q = dpsi_d - lambda_q, dpsi_q + lambda_d
    torque = 1.5 * p * (e_d * i_d + e_q * i_q)
    torque += sum(c["torque"] * np.sin(c["order"] * theta + c["phase"]) for c in motor["cogging"])
    return [
        (u_d - motor["R_s"] * i_d - p * omega * e_d) / motor["L_d"],
        (u_q - motor["R_s"] * i_q - p * omega * e_q) / motor["L_q"],
        (torque - load - mechanics["viscous_friction"] * omega) / mechanics["inertia"],
        omega,
    ]


def test_agrees_with_dop853_at_tight_tolerance_after_one_second() -> None:
    rate = 1000
    change: dict[str, Any] = {
        "motor": RIPPLE,
        "mechanics": {"viscous_friction": 1e-3},
        "load": {"torque": 0.1},
        "reference": {"kind": "sine", "offset": 12.0, "amplitude": 8.0, "frequency": 2.0},
        "drive": {
            "current_rate": rate,
            "speed_divider": 1,
            "integration_steps": 16,
            "kp_d": 0.3,
            "kp_q": 0.4,
            "ki_d": 30.0,
            "ki_q": 30.0,
        },
        "controller": {"config": {"kp": 0.05, "ki": 0.3}},
    }
    settings = config(change)
    x = run(change, 1.001)
    states = np.stack([x["i_d"], x["i_q"], x["omega_m"], x["theta_m"]], axis=1)

    # the voltage that tick n computes acts in tick n + 1, at the angle expected for its middle
    angle = settings["motor"]["pole_pairs"] * (x["theta_m"] + 1.5 / rate * x["omega_m"])
    alpha = np.cos(angle) * x["u_d"] - np.sin(angle) * x["u_q"]
    beta = np.sin(angle) * x["u_d"] + np.cos(angle) * x["u_q"]
    voltages = np.vstack([[0.0, 0.0], np.stack([alpha, beta], axis=1)])

    y = states[0]
    for n in range(rate):
        solved = solve_ivp(
            lambda _, y, u: slope(settings["motor"], settings["mechanics"], y, u, 0.1),
            (0.0, 1.0 / rate),
            y,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            args=(voltages[n],),
        )
        y = solved.y[:, -1]
    error = np.abs(states[rate] - y) / np.ptp(states, axis=0)
    assert error.max() < 1e-6, error


def test_coasting_follows_the_exponential() -> None:
    change: dict[str, Any] = {
        "motor": {"psi_f": 1e-9},
        "mechanics": {"viscous_friction": 2e-3},
        "drive": {"kp_d": 0.0, "ki_d": 0.0, "kp_q": 0.0, "ki_q": 0.0, "decoupling": False},
    }
    x = run(change, 0.5)
    assert x["omega_m"] == pytest.approx(10.0 * np.exp(-2e-3 / 5e-4 * x["time"]), rel=1e-9)


def test_torque_of_flux_harmonics_is_power_over_speed() -> None:
    x = run({"motor": RIPPLE, "load": {"torque": 0.5}, "energy": True}, 0.3)
    # between two instants, what goes in and is neither burnt nor stored is torque times the angle turned
    work = np.cumsum(0.5 * (x["tau_e"][1:] + x["tau_e"][:-1]) * np.diff(x["theta_m"]))
    stored = 0.75 * (2e-3 * x["i_d"] ** 2 + 3e-3 * x["i_q"] ** 2)
    expected = (x["energy_electrical"] - x["energy_copper"] - stored)[1:] - (-stored[0])
    assert work == pytest.approx(expected, abs=2e-4 * np.ptp(expected))


def test_load_lag_is_first_order() -> None:
    change: dict[str, Any] = {"load": {"torque": 0.1, "lag": 0.03}, "events": [{"time": 0.1, "load": 0.4}]}
    x = run(change, 0.3)
    after = x["time"] >= 0.1
    expected = 0.4 - 0.3 * np.exp(-(x["time"][after] - 0.1) / 0.03)
    assert x["tau_load"][after] == pytest.approx(expected, abs=1e-12)
    assert np.all(x["tau_load"][~after] == 0.1)


def test_a_lagging_load_acts_as_the_integral_of_its_exponential() -> None:
    """To the error of Simpson's rule: h^4 / 2880 of the third derivative's rise."""
    lag, rise, inertia, h = 1e-3, -0.3, 5e-4, 1e-4
    change: dict[str, Any] = {
        "motor": {"psi_f": 1e-9},
        "drive": {"kp_d": 0.0, "ki_d": 0.0, "kp_q": 0.0, "ki_q": 0.0, "decoupling": False},
        "load": {"lag": lag},
        "events": [{"time": 0.0, "load": rise}],
    }
    x = run(change, 0.01)
    t = x["time"]
    expected = -rise / inertia * (t - lag * (1 - np.exp(-t / lag)))
    bound = h**4 / 2880 * abs(rise) / inertia / lag**3
    assert x["omega_m"] - 10.0 == pytest.approx(expected, abs=1.01 * bound)


def test_load_tables_by_angle_and_by_time() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 5)[:-1]
    change: dict[str, Any] = {
        "load": {
            "angle_table": {"angle": angles.tolist(), "torque": [0.0, 0.1, 0.2, 0.1]},
            "time_table": {"time": [0.1, 0.2], "torque": [0.0, 0.3]},
        }
    }
    x = run(change, 0.4)
    by_angle = np.interp(x["theta_m"], angles, [0.0, 0.1, 0.2, 0.1], period=2.0 * np.pi)
    by_time = np.interp(x["time"], [0.1, 0.2], [0.0, 0.3])
    assert x["tau_load"] == pytest.approx(by_angle + by_time, abs=1e-12)


def test_torque_constant_ripple_at_constant_current() -> None:
    """K_t (1 + share sin(order theta_m + phase)), at orders of the mechanical revolution, also odd ones."""
    ripple = [{"order": 12, "share": 0.015, "phase": 0.4}, {"order": 1, "share": 0.02, "phase": -1.0}]

    class Constant:
        def step(self, _: object) -> float:
            return 2.0

    x = run(
        {
            "motor": {"torque_ripple": ripple},
            "drive": {"ideal_current": True},
            "mechanics": {"inertia": 1.0},
            "controller": {"law": "python"},
        },
        0.7,
        controller=Constant(),
    )
    shape = 1 + sum(r["share"] * np.sin(r["order"] * x["theta_m"] + r["phase"]) for r in ripple)
    assert x["tau_e"][1:] == pytest.approx((1.5 * 4 * 0.05 * 2.0 * shape)[1:], rel=1e-12)


@pytest.mark.parametrize("kind", ["averaged", "switched"])
def test_torque_constant_ripple_keeps_the_balance_of_power(kind: str) -> None:
    ripple = [{"order": 7, "share": 0.05, "phase": 0.4}, {"order": 12, "share": 0.03, "phase": 0.0}]
    x = run({**LOADED, "motor": {"torque_ripple": ripple}, "drive": {"inverter": {"kind": kind}}}, 1.0)
    assert residual(x) < 2e-6 * x["energy_electrical"].max()
