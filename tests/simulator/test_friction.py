"""Coulomb friction: it stops the rotor at the right instant, holds it, and lets go at breakaway."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import run
from hypothesis import given, settings
from hypothesis import strategies as st

COASTING: dict[str, Any] = {
    "motor": {"psi_f": 1e-9},
    "mechanics": {"coulomb_friction": 0.02, "breakaway_friction": 0.03},
    "drive": {"kp_d": 0.0, "ki_d": 0.0, "kp_q": 0.0, "ki_q": 0.0, "decoupling": False},
}


@settings(max_examples=25, deadline=None)
@given(speed=st.floats(0.5, 20.0), coulomb=st.floats(0.01, 0.5), direction=st.sampled_from([-1.0, 1.0]))
def test_coasting_stops_after_the_energy_is_used_up(speed: float, coulomb: float, direction: float) -> None:
    change = {
        **COASTING,
        "mechanics": {"coulomb_friction": coulomb, "breakaway_friction": coulomb},
        "initial_speed": direction * speed,
    }
    stop = speed * 5e-4 / coulomb
    x = run(change, min(stop * 1.2 + 0.01, 2.0))
    moved = np.abs(x["theta_m"])
    slower = np.maximum(speed - coulomb / 5e-4 * x["time"], 0.0)
    assert np.abs(np.abs(x["omega_m"]) - slower).max() <= 1e-9
    if x["time"][-1] > stop:
        assert moved[-1] == pytest.approx(0.5 * 5e-4 * speed**2 / coulomb, rel=1e-9)
        assert x["omega_m"][-1] == 0.0


def test_holds_below_breakaway_and_lets_go_above_it() -> None:
    ramp = {"time_table": {"time": [0.0, 1.0], "torque": [0.0, -0.06]}}  # a driving load
    x = run({**COASTING, "initial_speed": 0.0, "load": ramp}, 1.0)
    before = x["time"] <= 0.5
    assert np.all(x["omega_m"][before] == 0.0)
    assert np.all(x["theta_m"][before] == 0.0)
    # from 0.5 s on: 0.06 t against the lower sliding friction of 0.02
    t = x["time"][~before]
    expected = (0.03 * (t**2 - 0.25) - 0.02 * (t - 0.5)) / 5e-4
    assert x["omega_m"][~before] == pytest.approx(expected, abs=1e-6)


def test_cogging_holds_an_unpowered_rotor_where_friction_catches_it() -> None:
    change = {
        **COASTING,
        "motor": {"psi_f": 1e-9, "cogging": [{"order": 6, "torque": 0.025, "phase": 0.0}]},
        "initial_speed": 3.0,
    }
    x = run(change, 3.0)
    assert x["omega_m"][-1] == 0.0
    assert abs(x["tau_cogging"][-1]) <= 0.03


def test_breakaway_and_capture_are_found_within_the_step() -> None:
    """Through standstill the result stays independent of the step, to the order of the method."""
    change = {
        **COASTING,
        "initial_speed": 0.0,
        "load": {
            "harmonics": [],
            "time_table": {"time": [0.0, 0.11, 0.33, 0.4], "torque": [0.0, 0.1, -0.1, 0.0]},
        },
    }
    ends = []
    for rate in (1000, 16000):
        drive = {**COASTING["drive"], "current_rate": rate, "speed_divider": 1}
        x = run({**change, "drive": drive}, 0.6)
        ends.append(x["theta_m"][-1])
    assert ends[0] == pytest.approx(ends[1], rel=1e-5)
