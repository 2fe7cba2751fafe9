"""A motor whose flux linkages saturate: against closed forms, DOP853 and the balance of energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, Signals, config, drive_of, run
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from cogless import _simulator_f64

REACH = np.linspace(-20.0, 20.0, 21)
L_D, L_Q, PSI_F, P, R_S = 2e-3, 3e-3, 0.05, 4, 0.8


def curve(flux: np.ndarray) -> dict[str, list[float]]:
    slope = PchipInterpolator(REACH, flux).derivative()(REACH)
    return {"current": REACH.tolist(), "flux": flux.tolist(), "slope": slope.tolist()}


# halved inductances at 20 A, and a tenth of the magnets' flux lost
CURVES = {
    "d": curve(L_D * 20 * np.arctan(REACH / 20)),
    "q": curve(L_Q * 15 * np.tanh(REACH / 15)),
    "cross": curve(-0.005 * (1 - np.cos(np.pi * REACH / 20)) / 2),
}
D, Q, CROSS = (CubicHermiteSpline(c["current"], c["flux"], c["slope"]) for c in CURVES.values())
SATURATED: dict[str, Any] = {"saturation": CURVES}
DRIVEN: dict[str, Any] = {
    "motor": {**RIPPLE, **SATURATED},
    "mechanics": {"viscous_friction": 1e-3},
    "load": {"torque": 1.5},
    "reference": {"kind": "sine", "offset": 12.0, "amplitude": 8.0, "frequency": 2.0},
}


def residual(x: Signals) -> float:
    out = x["energy_copper"] + x["energy_friction"] + x["energy_load"]
    balance = x["energy_electrical"] - out - (x["energy_stored"] - x["energy_stored"][0])
    return float(np.max(np.abs(balance)))


def test_constant_inductances_as_curves_are_the_linear_motor() -> None:
    straight = {name: curve(L * REACH) for name, L in (("d", L_D), ("q", L_Q))}
    x = run({**DRIVEN, "motor": {**RIPPLE, "saturation": straight}, "energy": True}, 0.2)
    y = run({**DRIVEN, "motor": RIPPLE, "energy": True}, 0.2)
    for name, values in y.items():
        assert np.abs(x[name] - values).max() <= 1e-6 * np.abs(values).max(), name


def test_torque_over_current() -> None:
    """With i_d = 0: 3/2 p (psi_f + cross(i_q)) i_q; the flux over i_q has no part in it."""
    x = run({"motor": SATURATED, "load": {"torque": 2.0}, "energy": True}, 0.3)
    i_d, i_q = x["i_d"], x["i_q"]
    assert np.ptp(i_q) > 5.0
    lambda_d, lambda_q = PSI_F + D(i_d) + CROSS(i_q), Q(i_q) + i_d * CROSS(i_q, 1)
    assert x["tau_e"] == pytest.approx(1.5 * P * (lambda_d * i_q - lambda_q * i_d), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("kind", ["averaged", "switched"])
def test_the_balance_of_energy_closes(kind: str) -> None:
    change = {**DRIVEN, "energy": True, "drive": {"inverter": {"kind": kind}, "integration_steps": 4}}
    x = run(change, 0.5)
    assert np.abs(x["i_q"]).max() > 4.0
    assert residual(x) < 2e-6 * x["energy_electrical"].max()


def slope(_: float, y: np.ndarray, u: np.ndarray) -> list[float]:
    """In the flux linkages as states, whose inductances are not needed: the currents are solved for."""
    i_d, i_q, omega, theta = y
    th = P * theta
    u_d = np.cos(th) * u[0] + np.sin(th) * u[1]
    u_q = -np.sin(th) * u[0] + np.cos(th) * u[1]
    lambda_d, lambda_q = PSI_F + D(i_d) + CROSS(i_q), Q(i_q) + i_d * CROSS(i_q, 1)
    jacobian = [[D(i_d, 1), CROSS(i_q, 1)], [CROSS(i_q, 1), Q(i_q, 1) + i_d * CROSS(i_q, 2)]]
    induced = [u_d - R_S * i_d + P * omega * lambda_q, u_q - R_S * i_q - P * omega * lambda_d]
    di_d, di_q = np.linalg.solve(jacobian, induced)
    torque = 1.5 * P * (lambda_d * i_q - lambda_q * i_d)
    return [di_d, di_q, (torque - 1.5 - 1e-3 * omega) / 5e-4, omega]


def test_agrees_with_dop853() -> None:
    rate, ticks = 2000, 60
    change = {
        **DRIVEN,
        "motor": SATURATED,
        "drive": {
            "current_rate": rate,
            "speed_divider": 1,
            "integration_steps": 32,
            "kp_d": 0.3,
            "kp_q": 0.4,
        },
    }
    x = run(change, (ticks + 1) / rate)
    states = np.stack([x["i_d"], x["i_q"], x["omega_m"], x["theta_m"]], axis=1)
    angle = P * (x["theta_m"] + 1.5 / rate * x["omega_m"])
    alpha = np.cos(angle) * x["u_d"] - np.sin(angle) * x["u_q"]
    beta = np.sin(angle) * x["u_d"] + np.cos(angle) * x["u_q"]
    voltages = np.vstack([[0.0, 0.0], np.stack([alpha, beta], axis=1)])
    y = states[0]
    for n in range(ticks):
        y = solve_ivp(
            slope, (0.0, 1.0 / rate), y, method="DOP853", rtol=1e-12, atol=1e-12, args=(voltages[n],)
        ).y[:, -1]
    error = np.abs(states[ticks] - y) / np.ptp(states, axis=0)
    assert np.ptp(states, axis=0)[1] > 3.0
    assert error.max() < 1e-6, error


def test_saturated_drives_run_alone() -> None:
    one = drive_of(_simulator_f64, config({"motor": SATURATED}))
    assert not one.alike(one)
