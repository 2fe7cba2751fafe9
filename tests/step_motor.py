"""The step motor of Verrelli 2016, Section 5, and its drive, as the engine's plain dict (tests/engine.py)."""

from __future__ import annotations

from typing import Any

from engine import BASE, merged

N_R = 50  # rotor teeth
I_F = 1.0  # A, fictitious rotor current
L_M = [5e-3, 0.5e-3, 0.166e-3, 0.0625e-3]  # H, L_m1 to L_m4
L_F4 = 1.766e-3  # H
L_0 = 0.7e-3  # H
J, D, R, N_T = 0.0733, 0.002, 1.0, 1.7201


def motor(L_1: float = 0.0) -> dict[str, Any]:
    """The motor in the engine's terms: L_mj is the flux harmonic of order j - 1 in both axes, L_fj cogging of
    order j N_r."""
    orders = range(1, len(L_M))
    return {
        "phases": 2,
        "pole_pairs": N_R,
        "R_s": R,
        "L_d": L_0 + L_1,
        "L_q": L_0 - L_1,
        "psi_f": I_F * L_M[0],
        "flux_harmonics": [
            {"order": k, "d": I_F * L_M[k], "q": I_F * L_M[k], "d_phase": 0.0, "q_phase": 0.0} for k in orders
        ],
        "cogging": [{"order": 4 * N_R, "torque": -N_R * I_F**2 / 2 * 4 * L_F4, "phase": 0.0}],
    }


# PI current loop in V/A and V/A/s, 100 us, voltages turned ahead by half a period
DRIVE: dict[str, Any] = {
    "current_rate": 10000,
    "speed_divider": 1,
    "kp_d": 1.0,
    "ki_d": 500.0,
    "kp_q": 1.0,
    "ki_q": 500.0,
    "decoupling": False,
    "current_limit": 15.0,
    "belief": {"R_s": R, "L_d": L_0, "L_q": L_0, "psi_f": I_F * L_M[0]},
    "inverter": {"bus_voltage": 100.0, "computation_delay": 0},
}
# The printed scheme: all angles and speeds are electrical, and the memory's period is an electrical one.
LAW: dict[str, Any] = {
    "law": "space-position",
    "config": {
        "ratio": N_R,
        "k_theta": 5.0,
        "k_omega": 5.0,
        "k_i": 50.0,
        "mu_alpha": 250.0,
        "mu_beta": 0.1,
        "mu_h": 0.1,
        "hand_over": True,
        "ramp": 1.0,
        "omega_min": 0.02,
        "memory": {
            "kind": "CGL_MEMORY_DELAY",
            "channels": 3,
            "forgetting": 1.0,
            "cells": 16000,
            "turns": 1,
            "parts": 1,
            "limit": [15.0, 15.0, 15.0],
            "k_pp": 10.0,
        },
    },
    "learning_start": 5.0,
}
FM: dict[str, Any] = {
    "kind": "fm",
    "offset": 15.0 / N_R,
    "amplitude": 5.0 / N_R,
    "frequency": 1.0,
    "depth": 1.0,
    "modulation": 0.5,
}
SECTION_5: dict[str, Any] = merged(
    BASE,
    {
        "motor": motor(),
        "mechanics": {"inertia": J, "viscous_friction": D},
        "load": {"harmonics": [{"order": 1, "torque": N_T, "phase": 0.0}]},
        "reference": FM,
        "initial_speed": 15.0 / N_R,
        "drive": DRIVE,
        "controller": LAW,
    },
)
