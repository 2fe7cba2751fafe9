"""Inverter: pulses and their mean, dead time, voltage limit."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, merged, run
from hypothesis import given, settings
from hypothesis import strategies as st

from cogless.c_layout import control_layout


def test_switched_currents_approach_the_averaged_ones_as_the_carrier_rises() -> None:
    errors = []
    for rate in (5000, 10000, 20000, 40000):
        drive: dict[str, Any] = {"current_rate": rate, "speed_divider": rate // 1000}
        runs = [
            run(
                {"motor": RIPPLE, "load": {"torque": 0.3}, "drive": {**drive, "inverter": {"kind": kind}}},
                0.3,
            )
            for kind in ("averaged", "switched")
        ]
        differences = runs[1]["i_q"] - runs[0]["i_q"]
        errors.append(np.sqrt(np.mean(differences[rate // 10 :] ** 2)))
    assert all(coarse > 1.7 * fine for coarse, fine in pairwise(errors)), errors


@pytest.mark.parametrize(
    ("kind", "pwm"),
    [
        *product(("averaged", "switched"), ("centre", "two-updates")),
        ("averaged", "edge"),  # samples of the other lie on an edge of the current's ripple, off the mean
    ],
)
def test_dead_time_costs_the_known_voltage(kind: str, pwm: str) -> None:
    """At standstill with a d current, each phase loses u_dc t_d / T against its current's sign.

    T is the PWM's period: with two updates two of the current loop's.
    """
    dead_time, bus, i_d = 2e-6, 100.0, 6.0

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (i_d, 0.0)

    change: dict[str, Any] = {
        "initial_speed": 0.0,
        "initial_angle": 0.1,  # phases at different currents, none at zero
        "mechanics": {"inertia": 1e3},
        "reference": {"speed": 0.0},
        "drive": {"inverter": {"kind": kind, "pwm": pwm, "dead_time": dead_time}},
        "controller": {"law": "python"},
    }
    x = run(change, 0.2, controller=HoldD())
    theta_e = 0.4
    currents = np.array([x["i_a"][-1], x["i_b"][-1], x["i_c"][-1]])
    lost = bus * dead_time * (5000 if pwm == "two-updates" else 10000) * np.sign(currents)
    alpha = (2 * lost[0] - lost[1] - lost[2]) / 3
    beta = (lost[1] - lost[2]) / np.sqrt(3)
    expected = 0.8 * i_d + np.cos(theta_e) * alpha + np.sin(theta_e) * beta
    assert x["i_d"][-2:].mean() == pytest.approx(i_d, abs=0.02)
    assert x["u_d"][-2:].mean() == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("kind", ["averaged", "switched"])
@pytest.mark.parametrize(("dead_time", "drop"), [(2e-6, 0.0), (0.0, 1.5), (2e-6, 1.5)])
def test_compensation_gives_back_dead_time_and_drop(kind: str, dead_time: float, drop: float) -> None:
    """At standstill with a d current the loop asks for the winding's voltage alone; without compensation for
    the lost one too."""

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (6.0, 0.0)

    change: dict[str, Any] = {
        "initial_speed": 0.0,
        "initial_angle": 0.1,  # phases at different currents, none at zero
        "mechanics": {"inertia": 1e3},
        "reference": {"speed": 0.0},
        "drive": {"inverter": {"kind": kind, "dead_time": dead_time, "device_drop": drop}},
        "controller": {"law": "python"},
    }
    values = {"time": dead_time, "drop": drop, "band": 0.1, "lag": 1e-3, "advance": 1.5, "phases": 3}
    compensation = {"dead_time": control_layout("double").pack("cgl_dead_time_config", values)}
    lost = run(change, 0.2, controller=HoldD())["u_d"][-1] - 0.8 * 6.0
    assert lost > 0.9 * (100.0 * dead_time * 10000 + drop)
    kept = run(merged(change, {"drive": compensation}), 0.2, controller=HoldD())["u_d"][-1] - 0.8 * 6.0
    assert abs(kept) < 0.01


def test_voltage_stays_within_the_hexagons_circle() -> None:
    change: dict[str, Any] = {
        "drive": {"inverter": {"bus_voltage": 12.0}},
        "reference": {"speed": 200.0},
        "initial_speed": 0.0,
        "controller": {"config": {"kp": 5.0}},
    }
    x = run(change, 1.0)
    u = np.hypot(x["u_d"], x["u_q"])
    assert u.max() == pytest.approx(12.0 / np.sqrt(3.0), rel=1e-9)
    assert np.any(x["status"].astype(int) & 1)  # saturated


PWM = ("centre", "edge", "two-updates")


@pytest.mark.parametrize("pwm", PWM)
def test_currents_are_those_of_a_timer_that_compares(pwm: str) -> None:
    """An independent winding at standstill, under legs that a timer switches, has the same sampled currents.

    The duty cycles are those of the recorded voltages, by min-max modulation, one period late.
    """

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (6.0, 0.0)

    bus, rate, angle, R, L = 100.0, 10000, 0.4, 0.8, 2.4e-3
    change: dict[str, Any] = {
        "motor": {"R_s": R, "L_d": L, "L_q": L},
        "initial_speed": 0.0,
        "initial_angle": angle / 4,
        "mechanics": {"inertia": 1e9},
        "reference": {"speed": 0.0},
        "drive": {"inverter": {"kind": "switched", "pwm": pwm, "bus_voltage": bus}, "integration_steps": 20},
        "controller": {"law": "python"},
    }
    x = run(change, 0.02, controller=HoldD())
    rising = (np.arange(100_000) + 0.5) / 100_000
    triangle = np.abs(1.0 - 2.0 * rising)
    carriers = {
        "centre": (triangle, triangle),
        "edge": (rising, rising),
        "two-updates": (1.0 - rising, rising),
    }
    phase = np.exp(2j * np.pi / 3 * np.arange(3))
    i, duty = 0j, np.full(3, 0.5)
    decay = np.exp(-R / L / rate * (1.0 - rising))  # from an instant to the period's end
    for n, (u_d, u_q) in enumerate(zip(x["u_d"], x["u_q"], strict=True)):
        in_frame = i * np.exp(-1j * angle)
        assert (x["i_d"][n], x["i_q"][n]) == pytest.approx((in_frame.real, in_frame.imag), abs=2e-3)
        high = carriers[pwm][n % 2][:, None] < duty  # as a timer compares
        i = np.exp(-R / L / rate) * i + (2 / 3) * bus / L / rate * np.mean(decay * (high @ phase))
        wanted = np.real((u_d + 1j * u_q) * np.exp(1j * angle) * np.conj(phase))
        duty = 0.5 + (wanted - (wanted.max() + wanted.min()) / 2) / bus
    assert abs(i) > 5.9


def test_computation_delay_is_one_period() -> None:
    """The first voltage acts one period later."""
    first = []
    for delay in (0, 1):
        change = {"initial_speed": 0.0, "drive": {"inverter": {"computation_delay": delay}}}
        x = run(change, 0.01)
        first.append(int(np.flatnonzero(np.abs(x["i_q"]) > 0)[0]))
    assert first == [1, 2]


@settings(max_examples=90, deadline=None)
@given(
    pwm=st.sampled_from(PWM),
    i_d=st.floats(0.5, 15.0),
    angle=st.floats(0.0, 1.5),
    dead_time=st.floats(0.0, 4e-6),
    bus=st.floats(14.0, 60.0),
    minimum=st.floats(0.0, 8e-6),
)
def test_averaged_voltage_is_the_mean_of_the_pulses(
    pwm: str, i_d: float, angle: float, dead_time: float, bus: float, minimum: float
) -> None:
    """At standstill, with inductance so large that the current hardly ripples, both inverters do the same."""

    class HoldD:
        def step(self, _: object) -> tuple[float, float]:
            return (i_d, 0.0)

    change: dict[str, Any] = {
        "motor": {"L_d": 10.0, "L_q": 10.0},
        "initial_speed": 0.0,
        "initial_angle": angle,
        "mechanics": {"inertia": 1e6},
        "reference": {"speed": 0.0},
        "controller": {"law": "python"},
    }
    drive = {"kp_d": 1e4, "kp_q": 1e4, "ki_d": 0.0, "ki_q": 0.0, "decoupling": False}  # far into the limit
    i_d_after = []
    for kind in ("averaged", "switched"):
        inverter = {"kind": kind, "pwm": pwm, "dead_time": dead_time, "bus_voltage": bus}
        inverter["minimum_pulse"] = minimum
        x = run({**change, "drive": {**drive, "inverter": inverter}}, 0.02, controller=HoldD())
        i_d_after.append(x["i_d"][-1])
    assert i_d_after[1] == pytest.approx(i_d_after[0], rel=1e-4, abs=1e-7)
