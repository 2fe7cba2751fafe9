"""The ideal current loop: the current is what the law asks for; all torques act as with a real one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, config, drive_of, run

from cogless import _simulator_f64

K_T = 0.3  # 1.5 * 4 * 0.05
J = 5e-4
IDEAL: dict[str, Any] = {
    "drive": {"ideal_current": True},
    "controller": {"law": "python"},
    "initial_speed": 0.0,
}


class Law:
    """Asks for a function of time, A, and notes what it sees."""

    def __init__(self, current: Callable[[float], Any]) -> None:
        self.current = current
        self.seen: list[tuple[float, float]] = []

    def step(self, inputs: Any) -> Any:
        self.seen.append((inputs.i_d, inputs.i_q))
        return self.current(inputs.time)


def test_current_follows_at_once_and_ends_at_its_limit() -> None:
    law = Law(lambda time: 100.0 * time)
    x = run({**IDEAL, "drive": {"ideal_current": True, "current_limit": 4.0}}, 0.1, controller=law)
    asked = np.repeat(np.arange(100) / 1000 * 100.0, 10)
    assert x["i_q"] == pytest.approx(np.minimum(asked, 4.0))
    assert x["i_q_ref"] == pytest.approx(x["i_q"])
    assert (x["status"] == (asked > 4.0)).all()  # saturated
    assert x["tau_e"] == pytest.approx(K_T * x["i_q"])
    # a law sees the current that has flowed until then
    assert np.array(law.seen[1:]) == pytest.approx(np.stack([0 * asked[9:-1:10], x["i_q"][9:-1:10]], axis=1))
    gained = np.cumsum(x["i_q"]) * K_T / J * 1e-4
    assert x["omega_m"][1:] == pytest.approx(gained[:-1], abs=1e-9)


def test_signals_that_mean_nothing_are_absent() -> None:
    x = run({"drive": {"ideal_current": True}}, 0.01)
    angle = ["time", "theta_m", "omega_m", "omega_ref", "theta_measured", "omega_measured", "i_q", "i_q_ref"]
    torques = ["tau_e", "tau_cogging", "tau_load", "status", "term_proportional", "term_integral"]
    assert list(x) == [*angle, *torques]


def test_a_speed_loop_settles_as_the_second_order_system_that_it_is() -> None:
    kp, ki, step = 0.02, 0.3, 1e-4
    rates = {"ideal_current": True, "current_rate": 10000, "speed_divider": 1}
    x = run({"initial_speed": 0.0, "drive": rates, "controller": {"config": {"kp": kp, "ki": ki}}}, 1.0)
    damping, frequency = K_T * kp / J / 2, np.sqrt(K_T * ki / J)  # 6 and 13.4 rad/s
    ringing = np.sqrt(frequency**2 - damping**2)
    t = x["time"]
    # 10 rad/s times (1 - the answer of s^2 / (s^2 + 2 d s + w^2) to a step)
    decay = np.exp(-damping * t) * (np.cos(ringing * t) - damping / ringing * np.sin(ringing * t))
    assert x["omega_m"] == pytest.approx(10.0 * (1.0 - decay), abs=10.0 * frequency * 3 * step)


def test_ripple_torques_act() -> None:
    change = {**IDEAL, "motor": RIPPLE, "mechanics": {"viscous_friction": 1e-3}}
    x = run(change, 0.5, controller=Law(lambda time: 3.0 * np.sin(20.0 * time)))
    cogging = sum(c["torque"] * np.sin(c["order"] * x["theta_m"] + c["phase"]) for c in RIPPLE["cogging"])
    theta_e = 4 * x["theta_m"]
    linkage = 0.05 + sum(
        h["d"] * np.cos(h["order"] * theta_e + h["d_phase"])
        + h["order"] * h["q"] * np.cos(h["order"] * theta_e + h["q_phase"])
        for h in RIPPLE["flux_harmonics"]
    )
    assert x["tau_cogging"] == pytest.approx(cogging, abs=1e-12)
    assert x["tau_e"] == pytest.approx(6 * linkage * x["i_q"], abs=1e-12)
    # the change of momentum between two samples of the law is the torques' impulse, by Simpson's rule
    rest = cogging - 1e-3 * x["omega_m"]
    weight = np.array([1, 4, 2, 4, 2, 4, 2, 4, 2, 4, 1]) / 3e4
    for n in range(0, 4990, 10):
        torque = 6 * linkage[n : n + 11] * x["i_q"][n] + rest[n : n + 11]
        assert J * (x["omega_m"][n + 10] - x["omega_m"][n]) == pytest.approx(weight @ torque, abs=1e-7)


def test_friction_sticks() -> None:
    # 0.15 N m do not break the rotor away, 0.25 do, 0.05 stop it
    torque = Law(lambda time: (0.15 if time < 0.0999 else 0.25 if time < 0.1999 else 0.05) / K_T)
    friction = {"coulomb_friction": 0.1, "breakaway_friction": 0.2}
    x = run({**IDEAL, "mechanics": friction}, 0.6, controller=torque)
    time = x["time"]
    start, slower, stop = 0.1, 0.2, 0.2 + 0.1 * 0.15 / 0.05
    speed = 0.15 / J * np.clip(time - start, 0.0, 0.1) - 0.05 / J * np.clip(time - slower, 0.0, stop - slower)
    assert x["omega_m"] == pytest.approx(speed, abs=1e-9)
    assert np.all(x["omega_m"][(time <= start) | (time > stop)] == 0.0)


def test_timed_edges_of_an_encoder() -> None:
    sensor = {"kind": "encoder", "counts": 2000.0, "speed_method": "MT", "timer": 1e9}
    change = {**IDEAL, "initial_speed": 3.7, "drive": {"ideal_current": True, "position_sensor": sensor}}
    omega = run(change, 0.5, controller=Law(lambda time: 0.0))["omega_measured"][200:]
    omega = run(change, 0.5, controller=Law(lambda time: 0.0))["omega_measured"][200:]
    assert omega == pytest.approx(np.full_like(omega, 3.7), rel=2e-6)  # a tick of 1 ns in a millisecond


def test_a_load_by_angle_table_alone_acts() -> None:
    table = {"angle": [0.0, np.pi], "torque": [0.0, 0.01]}
    x = run(
        {**IDEAL, "initial_speed": 2.0, "load": {"angle_table": table}}, 0.1, controller=Law(lambda t: 0.0)
    )
    # up the ramp k theta: an oscillator
    frequency = np.sqrt(0.01 / np.pi / J)
    assert x["omega_m"] == pytest.approx(2.0 * np.cos(frequency * x["time"]), rel=1e-9)


def test_what_contradicts_it_is_refused() -> None:
    with pytest.raises(ValueError, match="energy: not with an ideal current loop"):
        drive_of(_simulator_f64, config({"drive": {"ideal_current": True}, "energy": True}))
    with pytest.raises(ValueError, match=r"drive.current_limit: expected more than 0"):
        drive_of(_simulator_f64, config({"drive": {"ideal_current": True, "current_limit": 0.0}}))
    with pytest.raises(RuntimeError, match="asked for i_d_ref"):
        run(IDEAL, 0.01, controller=Law(lambda time: (1.0, 0.0)))
