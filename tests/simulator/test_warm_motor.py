"""A motor whose winding and magnets warm up: steady temperatures, their course, energy, what they change."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, Signals, config, drive_of, merged, run, signals
from scipy.integrate import solve_ivp

from cogless import _simulator_f64

START = {"winding": 30.0, "magnet": 25.0}
GIVEN: dict[str, Any] = {
    **START,
    "reference": 20.0,
    "resistance_coefficient": 0.00393,
    "flux_coefficient": -0.0011,
    "drifts": False,
}
# time constants of a second, so that a run is short
BODIES: dict[str, Any] = {
    "ambient": 20.0,
    "winding_capacity": 0.8,
    "magnet_capacity": 1.5,
    "winding_to_ambient": 0.5,
    "winding_to_magnet": 0.9,
    "magnet_to_ambient": 0.7,
}
DRIFTS = {**GIVEN, **BODIES, "drifts": True}
HELD = {"load": {"torque": 1.0}, "initial_speed": 0.0, "reference": {"kind": "constant", "speed": 0.0}}


def slope(_: float, T: np.ndarray, cold_loss: float) -> list[float]:
    """The two bodies' balances, written out."""
    winding, magnet = T
    b = BODIES
    between = b["winding_to_magnet"] * (winding - magnet)
    loss = cold_loss * (1 + 0.00393 * (winding - 20.0))
    return [
        (loss - b["winding_to_ambient"] * (winding - b["ambient"]) - between) / b["winding_capacity"],
        (between - b["magnet_to_ambient"] * (magnet - b["ambient"])) / b["magnet_capacity"],
    ]


def temperatures(x: Signals) -> np.ndarray:
    return np.stack([x["temperature_winding"], x["temperature_magnet"]])


def ideal(current: float, motor: dict[str, Any], seconds: float) -> Signals:
    """A run with a given constant current, under an ideal current loop."""

    class Constant:
        def step(self, _: object) -> float:
            return current

    change = {
        "motor": motor,
        "mechanics": {"inertia": 1.0},
        "drive": {"ideal_current": True, "current_rate": 1000, "speed_divider": 1},
        "controller": {"law": "python"},
    }
    settings = config({**change, "initial_speed": 20.0})
    drive = drive_of(_simulator_f64, settings, Constant())
    return signals(drive, _simulator_f64, round(seconds * 1000))


def test_the_course_of_the_temperatures_agrees_with_dop853() -> None:
    current, R_s = 6.0, 0.8
    x = ideal(current, {"temperature": DRIFTS}, 4.0)
    at = x["time"]
    solved = solve_ivp(
        slope, (0.0, at[-1]), list(START.values()), method="DOP853", rtol=1e-12, atol=1e-12, t_eval=at,
        args=(1.5 * R_s * current**2,),
    )  # fmt: skip
    rise = np.ptp(temperatures(x), axis=1)
    assert rise.min() > 5.0
    # the current begins with the first tick's law, and is there at both ends of every period
    assert np.abs(temperatures(x) - solved.y).max() < 1e-9 * rise.min()


def test_the_steady_temperatures_are_those_of_the_resistances() -> None:
    """Zero of both balances; the loss grows with the winding's temperature."""
    current = 3.0
    cold = 1.5 * 0.8 * current**2
    b = BODIES
    growth = 0.00393 * cold
    matrix = [
        [b["winding_to_ambient"] + b["winding_to_magnet"] - growth, -b["winding_to_magnet"]],
        [-b["winding_to_magnet"], b["winding_to_magnet"] + b["magnet_to_ambient"]],
    ]
    right = [
        cold * (1 - 0.00393 * 20.0) + b["winding_to_ambient"] * b["ambient"],
        b["magnet_to_ambient"] * b["ambient"],
    ]
    x = ideal(current, {"temperature": DRIFTS}, 40.0)
    assert temperatures(x)[:, -1] == pytest.approx(np.linalg.solve(matrix, right), rel=1e-9)


@pytest.mark.parametrize("kind", ["averaged", "switched"])
def test_the_loss_is_what_the_bodies_hold_and_give_away(kind: str) -> None:
    change = {**HELD, "motor": {"temperature": DRIFTS}, "energy": True, "drive": {"inverter": {"kind": kind}}}
    x = run(change, 1.0)
    T = temperatures(x)
    b = BODIES
    held = b["winding_capacity"] * (T[0] - T[0, 0]) + b["magnet_capacity"] * (T[1] - T[1, 0])
    away = b["winding_to_ambient"] * (T[0] - b["ambient"]) + b["magnet_to_ambient"] * (T[1] - b["ambient"])
    given = np.concatenate([[0.0], np.cumsum(0.5 * (away[1:] + away[:-1]) * np.diff(x["time"]))])
    loss = x["energy_copper"]
    # copper loss is integrated within a period, temperatures see its ends
    assert np.abs(held + given - loss).max() <= 2e-3 * loss[-1]
    balance = loss + x["energy_friction"] + x["energy_load"] + x["energy_stored"] - x["energy_stored"][0]
    assert np.abs(balance - x["energy_electrical"]).max() <= 1e-6 * loss[-1]


def test_given_temperatures_are_another_motor() -> None:
    """R by its coefficient, psi and its harmonics by theirs, cogging by its square."""
    R, psi = 1 + 0.00393 * 60.0, 1 - 0.0011 * 40.0
    hot = {**GIVEN, "winding": 80.0, "magnet": 60.0}
    x = run({"motor": {**RIPPLE, "temperature": hot}, **HELD}, 0.2)
    flux = [{**h, "d": psi * h["d"], "q": psi * h["q"]} for h in RIPPLE["flux_harmonics"]]
    cogging = [{**h, "torque": psi**2 * h["torque"]} for h in RIPPLE["cogging"]]
    same = {"R_s": R * 0.8, "psi_f": psi * 0.05, "flux_harmonics": flux, "cogging": cogging}
    y = run({"motor": same, **HELD}, 0.2)
    for name, values in y.items():
        assert np.abs(x[name] - values).max() <= 1e-5 * max(np.abs(values).max(), 1e-9), name
    assert (x["temperature_winding"] == 80.0).all() and (x["temperature_magnet"] == 60.0).all()


def test_torque_and_resistance_drift_with_the_temperatures() -> None:
    x = ideal(3.0, {"temperature": DRIFTS}, 4.0)
    psi = 1 - 0.0011 * (x["temperature_magnet"] - 20.0)
    assert x["tau_e"][1:] == pytest.approx(1.5 * 4 * 0.05 * 3.0 * psi[1:], rel=1e-12)
    held = run({**HELD, "motor": {"temperature": DRIFTS}, "drive": {"kp_q": 1.0}}, 3.0)
    at = -1
    R = 0.8 * (1 + 0.00393 * (held["temperature_winding"][at] - 20.0))
    assert held["u_q"][at] == pytest.approx(R * held["i_q"][at], rel=1e-3)


@pytest.mark.parametrize("kind", ["averaged", "switched"])
def test_a_run_in_pieces_has_the_same_bits(kind: str) -> None:
    change = {**HELD, "motor": {**RIPPLE, "temperature": DRIFTS}, "drive": {"inverter": {"kind": kind}}}
    settings = config(change)
    drive = drive_of(_simulator_f64, settings)
    rows = []
    for ends in ((0, 900), (0, 1, 333, 900)):
        state, recorder = drive.start(), _simulator_f64.Recorder(drive, 1)
        for start, end in pairwise(ends):
            drive.advance(state, recorder, end - start)
        rows.append(recorder.take())
    assert rows[0].tobytes() == rows[1].tobytes()


def test_at_the_reference_nothing_changes_but_two_signals() -> None:
    at = {**GIVEN, "winding": 20.0, "magnet": 20.0}
    x = run({"motor": {**RIPPLE, "temperature": at}}, 0.1)
    y = run({"motor": RIPPLE}, 0.1)
    assert x.keys() - y.keys() == {"temperature_winding", "temperature_magnet"}
    for name, values in y.items():
        assert x[name].tobytes() == values.tobytes(), name


def test_drives_that_drift_are_not_alike() -> None:
    fixed, drifting = (
        drive_of(_simulator_f64, config({"motor": {"temperature": t}})) for t in (GIVEN, DRIFTS)
    )
    warmer = drive_of(_simulator_f64, config({"motor": {"temperature": merged(GIVEN, {"winding": 90.0})}}))
    assert fixed.alike(warmer)
    assert not drifting.alike(drifting)
