"""The guard in a whole drive: learning that would grow is stopped, and what helps is left alone."""

from pathlib import Path

import numpy as np
import pytest

import cogless
from cogless.control_library import Status
from cogless.design.speed_loop import gains
from cogless.run.simulate import simulate

DRIVE = Path(__file__).parents[2] / "benchmarks" / "criterion.toml"
K_T, INERTIA = 0.05, 1.2e-5


def study(law, omega, *, guard=True, lead="0 ms", start="0 s"):
    """A drive of 7 pole pairs with an encoder of 14 bits, currents at 20 kHz, the law at 2 kHz."""
    changes = {
        "motor.cogging": [{"order": 84, "torque": "5 mN*m"}, {"order": 42, "torque": "4 mN*m"}],
        "motor.K_t": f"{K_T} N*m/A",
        "mechanics.inertia": f"{INERTIA} kg*m^2",
        "mechanics.viscous_friction": "1e-5 N*m*s/rad",
        "mechanics.coulomb_friction": "2 mN*m",
        "drive.rates": {"current_loop": "20 kHz", "speed_loop": "2 kHz"},
        "drive.inverter.bus_voltage": "48 V",
        "drive.current_loop.bandwidth": "800 Hz",
        "drive.position_sensor": {"kind": "encoder", "lines": 4096},
        "drive.guard": guard,
        "scenario.run.reference": f"{omega} rad/s",
        "scenario.run.initial_speed": f"{omega} rad/s",
        "scenario.run.duration": "8 s",
        "trace.rate": "2 kHz",
    }
    tuning = {"rule": "phase-margin", "phase_margin": "60 deg"}
    kp, _ = gains(cogless.load(DRIVE, {**changes, "controller.law": {"law": "pi", "tuning": tuning}}), "law")
    memory = {"memory": "angle", "period": "mechanical", "cells": 2048, "q_half_width": 1, "lead": lead}
    controller = {"law": "pi-ilc", "tuning": tuning, "gain": f"{kp} A*s/rad"}
    if law == "robust-ilc":
        b, half = K_T / INERTIA, K_T / INERTIA * kp / 2
        controller = {"law": law, "b": f"{b} rad/s^2/A", "q": 1.0, "beta_2": f"{2 * half} 1/s"}
        controller |= {"c": f"{half} 1/s", "eta": f"{half} 1/s", "beta_1": "0 rad/s^2", "g": "0 rad/s^2"}
        controller["gamma"] = "0 1/s^2"
    return cogless.load(
        DRIVE, {**changes, "controller.law": {**controller, **memory, "learning_start": start}}
    )


def ripple(trace, first, last):
    error = (trace["omega_m"] - trace["omega_ref"])[trace.window(first, last)]
    return float(np.std(error))


@pytest.mark.parametrize(
    "law, omega", [("pi-ilc", 30), ("pi-ilc", 100), ("robust-ilc", 20), ("robust-ilc", 100)]
)
def test_learning_that_grows_ends_as_the_feedback_alone(law, omega):
    alone = ripple(simulate(study(law, omega, start="1e6 s"), "run", "law").trace, 6.5, 8)
    grown = ripple(simulate(study(law, omega, guard=False), "run", "law").trace, 6.5, 8)
    trace = simulate(study(law, omega), "run", "law").trace
    assert grown > 10 * alone
    assert ripple(trace, 6.5, 8) < 1.25 * alone
    assert np.any(trace["status"].astype(int) & Status.GUARDED)


def test_learning_that_helps_is_tested_by_a_quarter_of_it_at_most():
    """It begins after two seconds, so the ripple before is known. In a test a quarter of it comes back."""
    with_guard, without = (
        simulate(study("pi-ilc", 20, guard=guard, lead="1 ms", start="2 s"), "run", "law").trace
        for guard in (True, False)
    )
    alone = ripple(with_guard, 1, 2)
    assert ripple(with_guard, 6, 8) < np.hypot(ripple(without, 6, 8), alone / 4)
    assert ripple(with_guard, 6, 8) < 0.5 * alone
