"""A load side behind gear, gap and soft shaft, and friction by speed and position: closed forms, SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import Signals, config, drive_of, run
from scipy.integrate import solve_ivp

from cogless import _simulator_f64

J_M, J_L, STIFFNESS = 5e-4, 2e-4, 30.0
SIDE: dict[str, Any] = {
    "inertia": J_L,
    "viscous_friction": 0.0,
    "coulomb_friction": 0.0,
    "breakaway_friction": 0.0,
    "stiffness": STIFFNESS,
    "damping": 0.0,
    "backlash": 0.0,
    "ratio": 1.0,
    "gear_errors": [],
}
# a motor without torque but its cogging
COASTING: dict[str, Any] = {
    "motor": {"psi_f": 1e-9},
    "drive": {"kp_d": 0.0, "ki_d": 0.0, "kp_q": 0.0, "ki_q": 0.0, "decoupling": False},
}
GEAR = {
    "ratio": 5.0,
    "inertia": 2e-3,
    "stiffness": 300.0,
    "damping": 0.02,
    "gear_errors": [
        {"side": "input", "order": 1, "angle": 2e-3, "phase": 0.2},
        {"side": "output", "order": 3, "angle": 1e-3, "phase": -0.4},
    ],
}
GAP = {"backlash": 0.02, "damping": 4e-3}
STRIBECK = {
    "coulomb_friction": 0.02,
    "breakaway_friction": 0.05,
    "stribeck_speed": 0.5,
    "friction_harmonics": [{"order": 3, "torque": 0.01, "phase": 0.3}],
}
TABLE = {"friction_table": {"angle": [0.0, 2.0, 4.0], "torque": [0.01, 0.03, 0.015]}}


def with_side(change: dict[str, Any] | None = None, **motor: Any) -> dict[str, Any]:
    return {"mechanics": {**motor, "load_side": {**SIDE, **(change or {})}}}


# Closed forms.


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_both_masses_swing_at_the_resonance(ratio: float) -> None:
    """A torque on the load from rest: the shaft's torque swings about its mean at one frequency."""
    torque, k = 0.05, STIFFNESS
    x = run(
        {
            **COASTING,
            **with_side({"ratio": ratio}),
            "initial_speed": 0.0,
            "load": {"torque": torque},
        },
        0.5,
    )
    seen = J_M * ratio**2  # the motor's inertia from the load
    resonance = np.sqrt(k * (1 / J_L + 1 / seen))
    mean = -torque * seen / (seen + J_L)
    wave = mean * (1 - np.cos(resonance * x["time"]))
    assert -x["tau_shaft"] == pytest.approx(wave, abs=2e-3 * abs(mean))
    crossings = x["time"][:-1][np.diff(np.sign(x["tau_shaft"] + mean)) > 0]
    found = 2 * np.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])
    assert found == pytest.approx(resonance, rel=1e-3)


def test_the_load_swings_at_the_antiresonance_where_the_motor_stands() -> None:
    torque = 0.05
    x = run(
        {
            **COASTING,
            **with_side(coulomb_friction=1.0, breakaway_friction=1.0),
            "initial_speed": 0.0,
            "load": {"torque": torque},
        },
        0.5,
    )
    assert np.all(x["omega_m"] == 0.0)
    w = np.sqrt(STIFFNESS / J_L)
    assert x["omega_load"] == pytest.approx(
        -torque / (J_L * w) * np.sin(w * x["time"]), abs=2e-3 * torque / (J_L * w)
    )
    crossings = x["time"][:-1][np.diff(np.sign(x["omega_load"])) > 0]
    found = 2 * np.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])
    assert found == pytest.approx(w, rel=1e-3)


def test_a_stiff_shaft_is_one_mass() -> None:
    """What is left falls with the stiffness: it is the twist."""
    change = {
        "reference": {"kind": "sine", "offset": 10.0, "amplitude": 5.0, "frequency": 3.0},
        "load": {"torque": 0.1},
    }
    one = run({**change, "mechanics": {"inertia": J_M + J_L}}, 0.3)
    apart = []
    for stiffness in (1e3, 1e4):
        side = {"stiffness": stiffness, "damping": 1e-2 * np.sqrt(stiffness)}
        x = run({**change, **with_side(side), "drive": {"integration_steps": 8}}, 0.3)
        settled = x["time"] > 0.1
        apart.append(np.abs(x["omega_m"] - one["omega_m"])[settled].max())
    assert apart[1] < 0.2 * apart[0] < 2e-3


def test_no_torque_passes_the_gap() -> None:
    """Until the load has crossed half the gap it moves alone; then it meets the damper first."""
    x = run({**COASTING, **with_side(GAP), "initial_speed": 0.0, "load": {"torque": 0.01}}, 0.05)
    free = x["time"] < np.sqrt(2 * 0.01 * J_L / 0.01)  # half the gap at the load's acceleration
    assert np.all(x["tau_shaft"][free] == 0.0)
    assert x["omega_load"][free] == pytest.approx(-0.01 / J_L * x["time"][free], rel=1e-9, abs=1e-12)
    assert x["tau_shaft"][~free][0] == pytest.approx(GAP["damping"] * 1.0, rel=1e-2)  # it meets at 1 rad/s


# SciPy, from the equations: its own events, modes and orders of evaluation.


def by_scipy(settings: dict[str, Any], seconds: float) -> np.ndarray:
    """theta_m, omega_m, theta_load, omega_load at the end of a run with cogging but no current."""
    mechanics, load = settings["mechanics"], settings["load"]
    side, motor = mechanics.get("load_side"), settings["motor"]
    half, d = (0.5 * side["backlash"], side["damping"]) if side else (0.0, 0.0)

    def waves(all_: list[dict[str, Any]], theta: float, key: str = "torque") -> float:
        return sum(h[key] * np.sin(h["order"] * theta + h["phase"]) for h in all_)

    def gear(theta: float) -> tuple[float, float]:
        g, slope = theta / side["ratio"], 1 / side["ratio"]
        for e in side["gear_errors"]:
            per = 1.0 if e["side"] == "input" else 1 / side["ratio"]
            g += e["angle"] * np.sin(e["order"] * theta * per + e["phase"])
            slope += e["angle"] * e["order"] * per * np.cos(e["order"] * theta * per + e["phase"])
        return g, slope

    def dry(m: dict[str, Any], omega: float, theta: float) -> float:
        level = m["coulomb_friction"] + waves(m.get("friction_harmonics", []), theta)
        if m.get("friction_table"):
            level += np.interp(
                theta, m["friction_table"]["angle"], m["friction_table"]["torque"], period=2 * np.pi
            )
        if m.get("stribeck_speed"):
            rise = m["breakaway_friction"] - m["coulomb_friction"]
            level += rise * np.exp(-((omega / m["stribeck_speed"]) ** 2))
        return level

    def shaft(y: np.ndarray, contact: int) -> float:
        if contact == 0:
            return 0.0
        g, slope = gear(y[0])
        return side["stiffness"] * (g - y[2] - contact * half) + d * (slope * y[1] - y[3])

    def driving(y: np.ndarray, contact: int) -> tuple[float, float]:
        torque = waves(motor["cogging"], y[0])
        if side is None:
            return torque - load["torque"] - waves(load["harmonics"], y[0]), 0.0
        s = shaft(y, contact)
        return torque - gear(y[0])[1] * s, s - load["torque"] - waves(load["harmonics"], y[2])

    def slope_of(_: float, y: np.ndarray, sliding: list[int], contact: int) -> list[float]:
        on_motor, on_load = driving(y, contact)
        friction = mechanics["viscous_friction"] * y[1] + sliding[0] * dry(mechanics, y[1], y[0])
        rates = [y[1], (on_motor - friction) / mechanics["inertia"] if sliding[0] else 0.0, 0.0, 0.0, 0.0]
        if side:
            friction = side["viscous_friction"] * y[3] + sliding[1] * dry(side, y[3], y[2])
            rates[2:4] = [y[3], (on_load - friction) / side["inertia"] if sliding[1] else 0.0]
            rates[4] = -side["stiffness"] / d * y[4] if contact == 0 and d else 0.0
        return rates

    y = np.array([settings["initial_angle"], settings["initial_speed"], 0.0, 0.0, 0.0])
    contact = [0 if half else 1]
    if side:
        y[2], y[3] = gear(y[0])[0], gear(y[0])[1] * y[1]
    masses = [mechanics, *([side] if side else [])]
    sliding = [int(np.sign(y[1])), int(np.sign(y[3])) if side else 1]
    for n, m in enumerate(masses):
        if not dry(m, 0.0, 0.0):
            sliding[n] = 1
    time = 0.0
    while time < seconds:
        events: dict[str, Any] = {}
        for n, m in enumerate(masses):
            if not dry(m, 0.0, 0.0):
                continue
            if sliding[n]:
                events[f"stop {n}"] = lambda _, y, n=n: sliding[n] * y[1 + 2 * n]
            else:
                events[f"go {n}"] = lambda _, y, n=n, m=m: (
                    dry(m, 0.0, y[2 * n]) - abs(driving(y, contact[0])[n])
                )
        if half and contact[0]:
            events["part"] = lambda _, y: contact[0] * shaft(y, contact[0])
        elif half:
            for way in (1, -1):
                events[f"meet {way}"] = lambda _, y, way=way: half - way * (gear(y[0])[0] - y[2] - y[4])
        for event in events.values():
            event.terminal, event.direction = True, -1
        solved = solve_ivp(
            lambda t, y: slope_of(t, y, sliding, contact[0]),
            (time, seconds),
            y,
            "DOP853",
            rtol=1e-12,
            atol=1e-13,
            events=list(events.values()),
            max_step=1e-2,
        )
        time, y = float(solved.t[-1]), solved.y[:, -1].copy()
        if solved.status != 1:
            break
        name = next(key for key, found in zip(events, solved.t_events, strict=True) if len(found))
        what, which = name.split() if " " in name else (name, "0")
        if what == "part":
            y[4] = gear(y[0])[0] - y[2] - contact[0] * half if d else 0.0
            contact[0] = 0
        elif what == "meet":
            contact[0], y[4] = int(which), 0.0
        else:
            n = int(which)
            torque = driving(y, contact[0])[n]
            if what == "stop":
                y[1 + 2 * n] = 0.0
            held = what == "stop" and abs(torque) <= dry(masses[n], 0.0, y[2 * n])
            sliding[n] = 0 if held else int(np.sign(torque))
    return y[:4]


COGGING = {"psi_f": 1e-9, "cogging": [{"order": 6, "torque": 0.04, "phase": 0.3}]}
LOAD = {"torque": 0.02, "harmonics": [{"order": 2, "torque": 0.01, "phase": 0.1}]}
CASES: dict[str, tuple[dict[str, Any], float]] = {
    "two masses": (with_side({"damping": 4e-3, "viscous_friction": 1e-4}, viscous_friction=1e-3), 10.0),
    "gear": (with_side(GEAR), 10.0),
    "backlash": (with_side(GAP, viscous_friction=1e-3), 4.0),
    "backlash undamped": (with_side({"backlash": 0.02}, viscous_friction=1e-3), 4.0),
    "gear with backlash": (with_side({**GEAR, "backlash": 0.004}), 6.0),
    "stribeck": ({"mechanics": STRIBECK}, 3.0),
    "position": (
        {"mechanics": {**STRIBECK, **TABLE, "stribeck_speed": 0.0, "breakaway_friction": 0.02}},
        8.0,
    ),
    "stick-slip on both sides": (
        with_side(
            {**GAP, "coulomb_friction": 0.01, "breakaway_friction": 0.02, "stribeck_speed": 1.0}, **STRIBECK
        ),
        3.0,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_agrees_with_dop853_at_tight_tolerance(case: str) -> None:
    change, speed = CASES[case]
    seconds = 0.2
    change = {
        **COASTING,
        **change,
        "motor": COGGING,
        "load": LOAD,
        "initial_speed": speed,
        "initial_angle": 0.3,
    }
    drive = {**COASTING["drive"], "integration_steps": 4}
    settings = config({**change, "drive": drive})
    x = run({**change, "drive": drive}, seconds + 1e-4)
    names = [
        "theta_m",
        "omega_m",
        *(["theta_load", "omega_load"] if "load_side" in settings["mechanics"] else []),
    ]
    found = np.array([x[name][-1] for name in names])
    expected = by_scipy(settings, x["time"][-1])[: len(names)]
    ranges = np.array([np.ptp(x[name]) for name in names])
    assert np.all(np.abs(found - expected) < 1e-6 * ranges), (found, expected)
    if "backlash" in case:  # it crossed the gap more than once
        assert np.count_nonzero(np.diff(np.sign(x["tau_shaft"]))) > 4


# Energy.

MOVING: dict[str, Any] = {
    "energy": True,
    "reference": {"kind": "sine", "offset": 0.0, "amplitude": 5.0, "frequency": 3.0},
    "initial_speed": 0.0,
    "load": LOAD,
}


def residual(x: Signals) -> float:
    out = x["energy_copper"] + x["energy_friction"] + x["energy_load"]
    return float(np.max(np.abs(x["energy_electrical"] - out - (x["energy_stored"] - x["energy_stored"][0]))))


@pytest.mark.parametrize("case", CASES)
def test_energy_balance_closes_with_the_fourth_power_of_the_step(case: str) -> None:
    drive = {"current_rate": 4000, "speed_divider": 4, "kp_q": 1.5, "kp_d": 1.0}
    found = [
        residual(run({**MOVING, **CASES[case][0], "drive": {**drive, "integration_steps": steps}}, 0.7))
        for steps in (1, 2, 4)
    ]
    if case != "position":  # the table's kinks cost the order
        assert np.log2(np.array(found[:-1]) / np.array(found[1:])).min() > 3.7, found
    assert found[-1] < 1e-7


@pytest.mark.parametrize("case", ["gear with backlash", "stick-slip on both sides"])
def test_energy_balance_with_pulses(case: str) -> None:
    x = run({**MOVING, **CASES[case][0], "drive": {"inverter": {"kind": "switched", "dead_time": 2e-6}}}, 0.5)
    assert residual(x) < 1e-5 * x["energy_electrical"].max()
    assert len(np.unique(x["tau_shaft"])) > 100


# Friction that depends on the angle or speed.


def test_friction_by_position_holds_where_it_is_high() -> None:
    """From rest, against a rising torque, the rotor breaks away at the friction of its own angle."""
    for angle in (0.0, 2.0, 3.0):
        ramp = {"time_table": {"time": [0.0, 1.0], "torque": [0.0, -0.1]}}
        change = {
            **COASTING,
            "mechanics": {**STRIBECK, **TABLE},
            "initial_speed": 0.0,
            "initial_angle": angle,
        }
        x = run({**change, "load": ramp}, 1.0)
        level = 0.05 + 0.01 * np.sin(3 * angle + 0.3) + np.interp(angle, [0.0, 2.0, 4.0], [0.01, 0.03, 0.015])
        moves = x["time"][np.flatnonzero(x["omega_m"] > 0)[0]]
        assert moves == pytest.approx(level / 0.1, abs=2e-4)


def test_friction_falls_with_speed_as_stribeck_says() -> None:
    """At a held speed the motor's torque is the friction."""
    mechanics = {**STRIBECK, "friction_harmonics": [], "viscous_friction": 1e-3}
    for speed in (0.2, 0.5, 1.0, 3.0):
        change = {
            "mechanics": mechanics,
            "initial_speed": speed,
            "reference": {"kind": "constant", "speed": speed},
        }
        x = run({**change, "controller": {"config": {"kp": 1.0, "ki": 20.0}}}, 1.0)
        expected = 0.02 + 0.03 * np.exp(-((speed / 0.5) ** 2)) + 1e-3 * speed
        assert x["tau_e"][-1] == pytest.approx(expected, rel=1e-6)


# The sensor on the load's side, and drives side by side.


def test_a_sensor_on_the_load_gives_its_angle_times_the_ratio() -> None:
    for sensor in (
        {"kind": "ideal"},
        {"kind": "encoder", "counts": 1e5, "speed_method": "M", "timer": 1e8},
    ):
        x = run({**with_side(GEAR), "drive": {"position_sensor": {**sensor, "side": "load"}}}, 1.5)
        counts = 5.0 * 2 * np.pi / 1e5 if sensor["kind"] == "encoder" else 1e-9
        assert np.abs(x["theta_measured"] - 5.0 * x["theta_load"]).max() < 1.01 * counts
        assert np.ptp(x["theta_load"]) > 2.5  # more than a turn of the motor
        assert np.abs(x["theta_measured"] - x["theta_m"]).max() > 5e-3  # the gear's error
        late = x["time"] > 0.5
        assert np.mean(x["omega_measured"][late]) == pytest.approx(10.0, rel=1e-3)


def test_such_drives_do_not_go_together_in_lanes() -> None:
    base = drive_of(_simulator_f64, config({}))
    for change in (with_side(), {"mechanics": STRIBECK}, {"mechanics": TABLE}):
        one = drive_of(_simulator_f64, config(change))
        assert not one.alike(base)
        assert not one.alike(one)
