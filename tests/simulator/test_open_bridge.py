"""An inverter whose transistors are off, as a safe output leaves it: diodes, bus and a turning motor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, Signals, merged, run

START = 0.05  # s
NO_CURRENT = {"kind": "current-missing", "phase": "a", "time": START, "duration": 100.0}
OFF = 1024


def coasting(change: dict[str, Any], duration: float = 0.3) -> Signals:
    """A drive whose current sensor fails at START, for good."""
    drive = {"monitor": {"hold": 1e-3}}
    return run(merged({"drive": drive, "faults": [NO_CURRENT], "energy": True}, change), duration)


def after(x: Signals, delay: float = 1e-3) -> Signals:
    return {name: values[x["time"] > START + delay] for name, values in x.items()}


def amplitude(x: Signals) -> np.ndarray[Any, Any]:
    return np.hypot(x["i_d"], x["i_q"])


MOTORS: dict[str, dict[str, Any]] = {
    "star": {},
    "two phases": {"motor": {"phases": 2}},
    "ripple": {"motor": RIPPLE},
}


@pytest.mark.parametrize("change", MOTORS.values(), ids=MOTORS)
@pytest.mark.parametrize("speed", [10.0, -200.0])
def test_below_the_bus_no_current_flows_and_the_rotor_coasts(change: dict[str, Any], speed: float) -> None:
    """200 rad/s induce 69 V between the terminals of 100 V; viscous friction alone brakes."""
    friction = 2e-4
    x = coasting(
        merged(
            change,
            {
                "initial_speed": speed, "reference": {"speed": speed}, "load": {"torque": 0.5},
                "mechanics": {"viscous_friction": friction}, "events": [{"time": START, "load": 0.0}],
            },
        )
    )  # fmt: skip
    before, coast = x["time"] < START, after(x)
    assert amplitude({k: v[before] for k, v in x.items()}).max() > 0.5
    assert np.all(coast["status"].astype(int) & OFF)
    assert amplitude(coast).max() < 1e-6
    if "cogging" not in change.get("motor", {}):
        decay = np.exp(-friction / 5e-4 * (coast["time"] - coast["time"][0]))
        np.testing.assert_allclose(coast["omega_m"], coast["omega_m"][0] * decay, rtol=1e-6)


@pytest.mark.parametrize(("share", "flows"), [(0.98, False), (1.02, True)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_current_flows_as_soon_as_two_terminals_differ_by_more_than_the_bus(
    share: float, flows: bool, sign: int
) -> None:
    """At any angle: sqrt(3) omega_e psi_f is the largest difference."""
    speed = sign * share * 100.0 / (np.sqrt(3) * 4 * 0.05)
    x = coasting(
        {"initial_speed": speed, "reference": {"speed": speed}, "mechanics": {"inertia": 1.0},
         "drive": {"integration_steps": 4}},
        0.1,
    )  # fmt: skip
    coast = after(x, 5e-3)
    assert coast["omega_m"][[0, -1]] == pytest.approx([speed, speed], rel=2e-3)
    assert (amplitude(coast).max() > 1e-3) == flows
    if flows:  # by each phase alike
        theta_e = 4 * coast["theta_m"] - np.array([[0.0], [2.0], [-2.0]]) * np.pi / 3
        phases = coast["i_d"] * np.cos(theta_e) - coast["i_q"] * np.sin(theta_e)
        rms = np.sqrt(np.mean(phases**2, axis=1))
        assert rms == pytest.approx(np.full(3, rms.mean()), rel=0.1)


def test_a_current_dies_out_against_the_bus() -> None:
    """At rest the d axis' current falls by 2/3 of the bus over L_d."""
    i_d, bus = 12.0, 100.0

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (i_d, 0.0)

    change: dict[str, Any] = {
        "initial_speed": 0.0, "reference": {"speed": 0.0}, "mechanics": {"inertia": 1e3},
        "drive": {"current_rate": 100_000, "speed_divider": 100, "kp_d": 20.0},
        "controller": {"law": "python"}, "faults": [NO_CURRENT],
    }  # fmt: skip
    x = run(merged({"drive": {"monitor": {"hold": 1e-3}}}, change), 0.052, controller=HoldD())
    t = x["time"] - START
    falling = (t > 3e-5) & (x["i_d"] > 1.0)
    slope = np.polyfit(t[falling], x["i_d"][falling], 1)[0]
    # 0.8 ohm add to it: 8 V of 67 at the start
    assert -(2 / 3 * bus + 0.8 * i_d) / 2e-3 < slope < -2 / 3 * bus / 2e-3
    assert np.abs(x["i_d"][t > 5e-4]).max() < 1e-6


@pytest.mark.parametrize("phases", [3, 2])
def test_above_the_bus_the_motor_brakes_into_it_and_energy_is_kept(phases: int) -> None:
    motor = {"phases": phases, "L_d": 3e-3}
    x = coasting(
        {"motor": motor, "initial_speed": 700.0, "reference": {"speed": 700.0},
         "mechanics": {"inertia": 5e-3}, "drive": {"integration_steps": 4}},
        0.1,
    )  # fmt: skip
    coast = after(x, 5e-3)
    assert coast["tau_e"].mean() < -0.1
    gained = np.diff(coast["energy_electrical"])
    assert gained.sum() < 0  # the bus gets it
    assert np.diff(coast["omega_m"])[-1] < 0
    assert amplitude(coast).max() < 2 * 0.05 / 2e-3
    losses = coast["energy_copper"] + coast["energy_friction"] + coast["energy_load"]
    balance = coast["energy_electrical"] - losses - coast["energy_stored"]
    assert np.ptp(balance) < 5e-3 * abs(gained.sum())


def test_the_drive_goes_on_from_where_the_rotor_coasted() -> None:
    fault = {**NO_CURRENT, "duration": 0.03}
    x = run(
        {"initial_speed": 200.0, "reference": {"speed": 200.0}, "faults": [fault],
         "drive": {"monitor": {"hold": 1e-3, "current_max": 40.0}}},
        0.4,
    )  # fmt: skip
    assert amplitude(x).max() < 2.0
    assert x["omega_m"][-1] == pytest.approx(200.0, rel=1e-3)
    assert x["omega_m"].min() > 195.0


def test_a_bus_of_nothing_shorts_the_motor_through_its_diodes() -> None:
    """Rectified into no voltage: the current of a short circuit, psi_f / L at speed."""
    sag = {"kind": "bus-voltage", "voltage": 0.0, "time": START, "duration": 100.0}
    x = run(
        {"initial_speed": 400.0, "mechanics": {"inertia": 1.0}, "faults": [sag], "motor": {"L_q": 2e-3}}, 0.3
    )
    late = x["time"] > 0.2
    omega_e = 4 * x["omega_m"][late].mean()
    expected = omega_e * 0.05 / np.hypot(0.8, omega_e * 2e-3)
    assert amplitude(x)[late].mean() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("delay", [0, 1])
def test_the_bridge_opens_with_the_duties_of_the_same_step(delay: int) -> None:
    """With a period's computation delay the old voltage acts for that period still."""

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (12.0, 0.0)

    change: dict[str, Any] = {
        "initial_speed": 0.0, "reference": {"speed": 0.0}, "mechanics": {"inertia": 1e3},
        "drive": {"kp_d": 1.0, "monitor": {"hold": 1e-3}, "inverter": {"computation_delay": delay}},
        "controller": {"law": "python"}, "faults": [NO_CURRENT],
    }  # fmt: skip
    x = run(change, 0.06, controller=HoldD())
    off = int(np.argmax(x["status"].astype(int) & OFF > 0))
    assert x["time"][off] >= START
    opens = off + delay
    # in the period after, the bus takes more than a quarter of it
    assert abs(x["i_d"][opens] - 12.0) < 0.2
    assert x["i_d"][opens + 1] < 0.8 * 12.0
