"""Rows of a switched drive's trace between the samples of its currents, and what they show of the pulses.

Closed forms are double Fourier series of regularly sampled pulses: D. G. Holmes and T. A. Lipo, Pulse Width
Modulation for Power Converters, IEEE Press 2003, chapter 3.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from engine import RIPPLE, Signals, config, drive_of, merged, run
from numpy.typing import NDArray
from pulses import BUS, POLE_PAIRS, PWM, electrical_speed, last_turn, sinusoidal, spectrum, vector
from scipy.special import jv

from cogless import _simulator_f64
from cogless.control_library import Status
from cogless.results.metrics import evaluate
from cogless.results.trace import Trace
from cogless.study.metric import Conditions, Metric

SWITCHED: dict[str, Any] = {"drive": {"inverter": {"kind": "switched"}}}
VOLTAGES = {"u_a", "u_b", "u_c"}


@pytest.mark.parametrize("pwm", PWM)
@pytest.mark.parametrize("rows", [2, 7, 32])
def test_a_run_is_the_same_however_many_rows_it_has(pwm: str, rows: int) -> None:
    """From a speed at which functions of the angle are expanded anew within periods, down to standstill, with
    a bridge that opens as the angle is missing."""
    change = merged(
        SWITCHED,
        {
            "motor": RIPPLE,
            "initial_speed": 150.0,
            "reference": {"speed": 150.0},
            "mechanics": {"coulomb_friction": 3.0, "breakaway_friction": 3.5},
            "load": {"torque": 0.1, "lag": 0.002},
            "faults": [{"kind": "angle-missing", "time": 0.02, "duration": 0.03}],
            "energy": True,
            "drive": {"inverter": {"pwm": pwm, "dead_time": 1e-6, "device_drop": 0.7}},
        },
    )
    plain = run(change, 0.05)
    finer = run({**change, "rows_per_period": rows}, 0.05)
    assert finer.keys() - plain.keys() == VOLTAGES
    for name, values in plain.items():
        assert np.array_equal(values, finer[name][::rows], equal_nan=True), name
    assert np.allclose(np.diff(finer["time"]), 1e-4 / rows, rtol=1e-9)
    assert is_off(plain).any() and (plain["omega_m"] == 0.0).any()


def is_off(x: Signals) -> NDArray[np.bool_]:
    return np.asarray(x["status"].astype(int) & Status.OFF > 0)


def test_rows_of_an_open_bridge_obey_its_diodes() -> None:
    """Every other one of 64 rows is one of 32, which begin the engine's steps; the rest lie on the way."""
    change = merged(
        SWITCHED,
        {
            "initial_speed": 100.0,
            "reference": {"speed": 100.0},
            "load": {"torque": 2.0},
            "faults": [{"kind": "angle-missing", "time": 0.01, "duration": 0.01}],
        },
    )
    coarse, fine = (run({**change, "rows_per_period": rows}, 0.03) for rows in (32, 64))
    off = is_off(coarse)
    for phase in "abc":
        i, rows = coarse[f"i_{phase}"], fine[f"i_{phase}"]
        assert np.array_equal(rows[::2], i)
        before, between, after = i[:-1][off[1:]], rows[1:-2:2][off[1:]], i[1:][off[1:]]
        assert np.all(np.abs(between - (before + after) / 2) < 0.02)
        blocked = (np.abs(before) < 1e-12) & (np.abs(after) < 1e-12)
        assert blocked.any() and (np.abs(before) > 0.1).any()
        assert np.all(np.abs(between[blocked]) < 1e-12)


def test_rows_follow_the_reference_and_the_load_between_the_samples() -> None:
    change = merged(
        SWITCHED,
        {
            "reference": {"kind": "sine", "offset": 10.0, "amplitude": 3.0, "frequency": 40.0},
            "load": {"time_table": {"time": [0.0, 0.01, 0.02], "torque": [0.0, 0.3, 0.0]}},
            "rows_per_period": 5,
        },
    )
    x = run(change, 0.02)
    assert np.ptp(np.diff(x["tau_load"][:400])) < 1e-12
    assert np.max(np.abs(x["omega_ref"] - (10 + 3 * np.sin(2 * np.pi * 40 * x["time"])))) < 1e-6


def test_the_engine_refuses_rows_between_samples_where_nothing_switches() -> None:
    for change in ({"rows_per_period": 2}, {**SWITCHED, "rows_per_period": 0}):
        with pytest.raises(ValueError, match=r"^rows_per_period: expected 1, or more with a switched"):
            drive_of(_simulator_f64, config(change))


RESISTANCE, INDUCTANCE, FLUX, DEPTH = 8.0, 2.4e-3, 0.05, 0.8
PERIODS = 40  # of the PWM in an electrical turn: a bin of the spectrum is the turn's frequency
ROWS = 400  # rows of a period of the current loop


def leg_line(pwm: str, m: int, n: int) -> complex:
    """Coefficient, V, of a leg's voltage at m times the PWM's frequency and n times the sinusoid's.

    It is that of exp(j w t); q is w in multiples of the PWM's frequency.
    """
    q = m + n / PERIODS
    if pwm == "centre":  # symmetrical regular sampling
        bracket = jv(n, math.pi * q * DEPTH / 2) * math.sin((q + n) * math.pi / 2) * np.exp(-1j * math.pi * q)
        return complex(BUS * bracket / (math.pi * q))
    if pwm == "edge":  # of a sawtooth
        mean = 1.0 if n == 0 else 0.0
        moving = (-1j) ** n * np.exp(-1j * math.pi * q) * jv(n, math.pi * q * DEPTH)
        return complex(BUS * (mean - moving) / (2j * math.pi * q))
    # asymmetrical regular sampling: the two halves of a period have samples of their own
    halves = 1j**n - (-1) ** m * (-1j) ** n
    bracket = jv(n, math.pi * q * DEPTH / 2) * np.exp(-1j * math.pi * q / 2) * halves
    return complex(BUS * bracket / (2j * math.pi * q))


def lines(pwm: str, highest: int = 10) -> dict[int, complex]:
    """The voltage vector's spectrum, V, over bins: of three legs on one carrier, n = 1, 4, -2, ... remain."""
    near = range(1 - PERIODS // 2, PERIODS // 2 + 1)
    return {
        m * PERIODS + n: 2 * leg_line(pwm, m, n)
        for m in range(-highest, highest + 1)
        for n in near
        if n % 3 == 1
    }


@pytest.mark.parametrize("pwm", PWM)
def test_spectra_of_voltage_current_and_torque_are_the_double_fourier_series(pwm: str) -> None:
    """About the PWM's first two multiples, to 1 %; currents and torque, which have no steps, to 0.01 %."""
    ticks = PERIODS * (2 if pwm == "two-updates" else 1)
    motor = {"R_s": RESISTANCE, "L_d": INDUCTANCE, "L_q": INDUCTANCE, "psi_f": FLUX}
    x = last_turn(sinusoidal(ticks, DEPTH), motor, {"pwm": pwm}, ROWS, turns=3)
    omega = electrical_speed(ticks)
    voltage = lines(pwm)
    current = {k: u / (RESISTANCE + 1j * k * omega * INDUCTANCE) for k, u in voltage.items()}
    induced = 1j * omega * FLUX
    current[1] = (voltage[1] - induced) / (RESISTANCE + 1j * omega * INDUCTANCE)
    in_rotor = {k - 1: i for k, i in current.items()}
    torque = {
        k: 1.5 * POLE_PAIRS * FLUX * (in_rotor.get(k, 0) - np.conj(in_rotor.get(-k, 0))) / 2j
        for k in in_rotor.keys() | {-k for k in in_rotor}
    }
    # a row shows an edge up to a row late: of the voltage only the lines' amplitudes are compared
    lengths = {k: abs(u) for k, u in voltage.items()}
    compare(np.abs(spectrum(vector(x["u_a"], x["u_b"], x["u_c"]))), lengths, 0.01)
    compare(spectrum(vector(x["i_a"], x["i_b"], x["i_c"])), current, 1e-4)
    compare(spectrum(x["tau_e"]), torque, 1e-4)
    about_the_mean = [abs(line) * (1 - np.sinc(k / PERIODS)) for k, line in torque.items()]
    assert switching_ripple(x["tau_e"]) == pytest.approx(math.hypot(*about_the_mean), rel=1e-3)


def switching_ripple(turn: NDArray[np.float64]) -> Any:
    """The metric over all rows of a turn: at its end half a period of the PWM at both sides doesn't count."""
    around = len(turn) // PERIODS // 2
    x = np.pad(turn, around, "wrap")
    trace = Trace(("time", "tau_e"), ("s", "N*m"), np.column_stack([np.arange(len(x)) / 1000, x]))
    metric = Metric.model_validate({"name": "ripple", "kind": "switching-ripple", "signal": "tau_e"})
    return evaluate(metric, trace, Conditions(pwm_period=len(turn) / PERIODS / 1000))


def compare(measured: NDArray[Any], expected: dict[int, Any], tolerance: float) -> None:
    """Each main line of itself, the others and what is below the PWM's frequency of the largest."""
    about = [k for k in expected if PERIODS // 2 < abs(k) < PERIODS * 5 // 2]
    largest = max(abs(expected[k]) for k in about)
    main = [k for k in about if abs(expected[k]) > 0.2 * largest]
    assert len(main) >= 4
    for k in (*about, 0, 1):
        size = abs(expected[k]) if k in main else largest
        assert abs(measured[k] - expected.get(k, 0.0)) < tolerance * size, (k, measured[k], expected[k])
