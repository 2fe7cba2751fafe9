"""Dead time and the shortest pulses of a switched inverter, in the rows of a trace between the samples.

The dead time's closed form is a square wave against the sign of the current. The rule for short pulses is
that of the PWM unit of Analog Devices' motor controllers (data sheet ADMC328, PWMPD register).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from engine import Signals, config, drive_of
from numpy.typing import NDArray
from pulses import BUS, PWM, RATE, Reals, electrical_speed, last_turn, sinusoidal, spectrum, vector

from cogless import _simulator_f64

RESISTANCE, INDUCTANCE, FLUX = 8.0, 24e-3, 0.05
MOTOR = {"R_s": RESISTANCE, "L_d": INDUCTANCE, "L_q": INDUCTANCE, "psi_f": FLUX}
PERIODS = 240  # of the PWM in an electrical turn
MINIMUM, DEAD_TIME = 3e-6, 2e-6  # s


def ticks_of(pwm: str) -> int:
    """Current-loop periods of an electrical turn."""
    return PERIODS * (2 if pwm == "two-updates" else 1)


def voltage_by_currents(x: Signals, ticks: int, order: int) -> complex:
    """The voltage vector's line at an order, V, by the currents, which have no steps for rows to miss."""
    omega = electrical_speed(ticks)
    current = spectrum(vector(x["i_a"], x["i_b"], x["i_c"]))[order]
    induced = 1j * omega * FLUX if order == 1 else 0.0
    return complex((RESISTANCE + 1j * order * omega * INDUCTANCE) * current + induced)


@pytest.mark.parametrize("pwm", PWM)
def test_dead_time_has_the_spectrum_of_a_square_wave(pwm: str) -> None:
    """In opposition to the currents' sign, of the amplitude u_dc t_d / T, with the PWM's period T.

    Its orders 3, 9, ... are the same in all phases, so 6k - 1 turns backward and 6k + 1 forward. Voltages to
    3 %, as a row shows an edge late; by the currents to 1 %. The sign acts up to a period late.
    """
    dead_time, ticks = 4e-6, ticks_of(pwm)
    x = last_turn(sinusoidal(ticks, 0.8), MOTOR, {"pwm": pwm, "dead_time": dead_time}, rows=1600, turns=2)
    amplitude = BUS * dead_time * RATE * PERIODS / ticks
    voltage = spectrum(vector(x["u_a"], x["u_b"], x["u_c"]))
    lag = np.angle(spectrum(vector(x["i_a"], x["i_b"], x["i_c"]))[1])
    for order in (-5, 7, -11, 13):
        n = abs(order)
        square = -4 / (math.pi * n) * amplitude * (-1) ** (n // 2) * np.exp(1j * order * lag)
        assert abs(voltage[order]) == pytest.approx(abs(square), rel=0.03)
        by_currents = voltage_by_currents(x, ticks, order)
        assert abs(by_currents) == pytest.approx(abs(square), rel=0.01)
        for line in (voltage[order], by_currents):
            assert abs(np.angle(line / square)) < n * 2 * math.pi / PERIODS


def edges(duty: Reals, positive: NDArray[np.bool_], pwm: str, dead_time: float) -> tuple[Reals, Reals]:
    """Times at which a leg rises and falls in a turn, in ticks, by its duty cycles and its current's signs.

    A comparator's pulses that touch are one. Then each edge waits for the dead time if the current is against
    it; not the edge between a period and one without pulses, as in the engine.
    """
    count = len(duty)
    ticks = np.arange(count)
    before = {"centre": 0.5, "edge": 0.0, "two-updates": 1.0 - ticks % 2}[pwm] * (1 - duty)
    rise, fall = (ticks + before)[duty > 0], (ticks + before + duty)[duty > 0]
    apart = np.abs((np.roll(rise, -1) - fall + count / 2) % count - count / 2) > 1e-9
    rise, fall = rise[np.roll(apart, 1)], fall[apart]
    rises, falls = ((edge + 1e-9).astype(int) % count for edge in (rise, fall))
    waits = (rise % 1 > 1e-9) | ((pwm == "edge") & (duty[rises] < 1)), fall % 1 > 1e-9
    late = dead_time * RATE
    return rise + late * (waits[0] & positive[rises]), fall + late * (waits[1] & ~positive[falls])


def line_of(rise: Reals, fall: Reals, ticks: int, order: int) -> complex:
    """Coefficient of exp(j order angle) of a leg's rectangles, V."""
    turn = -2j * np.pi * order / ticks
    return complex(BUS * (np.exp(turn * rise).sum() - np.exp(turn * fall).sum()) / (2j * np.pi * order))


def without_short(duty: Reals, pwm: str, dead_time: float) -> Reals:
    """Duty cycles by which no transistor is on for less than MINIMUM in half a PWM period."""
    half = (0.5 if pwm == "centre" else 1.0) / RATE
    short_high = duty * half - dead_time < MINIMUM
    short_low = (1 - duty) * half - dead_time < MINIMUM
    return np.where(short_high, 0.0, np.where(short_low, 1.0, duty))


@pytest.mark.parametrize("dead_time", [0.0, DEAD_TIME])
@pytest.mark.parametrize("pwm", PWM)
def test_lines_are_those_of_the_rectangles_without_short_pulses(pwm: str, dead_time: float) -> None:
    """At a depth at which pulses are dropped: a sum of rectangles in NumPy against the engine's currents."""
    ticks = ticks_of(pwm)
    duties = sinusoidal(ticks, 0.98)
    inverter = {"pwm": pwm, "dead_time": dead_time, "minimum_pulse": MINIMUM}
    x = last_turn(duties, MOTOR, inverter, rows=32, turns=3)
    kept = without_short(duties, pwm, dead_time)
    assert 0.05 < np.mean((kept == 0) | (kept == 1)) < 0.5
    phase = np.exp(2j * np.pi / 3 * np.arange(3))
    currents = np.stack([x[f"i_{p}"][::32] for p in "abc"], axis=1)
    for order in (1, -5, 7, -11, 13):
        legs = [edges(kept[:, leg], currents[:, leg] >= 0, pwm, dead_time) for leg in range(3)]
        lines = [line_of(*leg, ticks, order) for leg in legs]
        expected = 2 / 3 * np.dot(phase, lines)
        assert abs(voltage_by_currents(x, ticks, order) - expected) < 1e-3, order


@pytest.mark.parametrize("pwm", PWM)
def test_the_fundamental_of_dropped_pulses_has_its_closed_form(pwm: str) -> None:
    """Of a cosine that is 1 above a share, in V: what is dropped near the rails makes the voltage larger."""
    ticks, depth = ticks_of(pwm), 0.98
    x = last_turn(sinusoidal(ticks, depth), MOTOR, {"pwm": pwm, "minimum_pulse": MINIMUM}, rows=32, turns=3)
    least = MINIMUM * RATE * (2 if pwm == "centre" else 1)
    a = math.acos((1 - 2 * least) / depth)
    share = 4 / math.pi * (math.sin(a) + depth / 2 * (math.pi / 2 - a - math.sin(a) * math.cos(a)))
    assert share - depth > 0.005
    assert abs(voltage_by_currents(x, ticks, 1)) == pytest.approx(share * BUS / 2, rel=1e-3)


def test_the_engine_refuses_a_shortest_pulse_that_leaves_none() -> None:
    for pwm, longest in (("centre", 25e-6), ("edge", 50e-6), ("two-updates", 50e-6)):
        for minimum, dead_time in ((longest, 0.0), (longest - DEAD_TIME, DEAD_TIME)):
            inverter = {"pwm": pwm, "dead_time": dead_time}
            wrong, right = (
                config({"drive": {"inverter": {**inverter, "minimum_pulse": share * minimum}}})
                for share in (1.0, 0.99)
            )
            drive_of(_simulator_f64, right)
            with pytest.raises(ValueError, match=r"^drive\.inverter\.minimum_pulse: expected a shorter one"):
                drive_of(_simulator_f64, wrong)


def widths(levels: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Rows between edges."""
    return np.diff(np.flatnonzero(np.diff(levels.astype(int))))


@pytest.mark.parametrize("others", [0.0, 1.0], ids=["current-out", "current-in"])
@pytest.mark.parametrize("dead_time", [0.0, DEAD_TIME])
@pytest.mark.parametrize("pwm", PWM)
def test_no_pulse_is_shorter_than_the_shortest(pwm: str, dead_time: float, others: float) -> None:
    """Duty cycles at random, most of them near the rails, with the other legs low or high.

    Without the key there are shorter ones. The mean of each period is off by a dropped pulse's at most.
    """
    rows, draw = 500, np.random.default_rng(1)
    near = draw.uniform(0.0, 0.15, 400)
    duty = np.where(draw.random(400) < 0.5, near, 1 - near)
    duty[draw.random(400) < 0.1] = 1.0
    duty[draw.random(400) < 0.1] = 0.0
    duty[0] = 0.5  # from then on the current has its sign
    duties = np.column_stack([duty, np.full((400, 2), others)])
    shortest = {}
    for minimum in (0.0, MINIMUM):
        inverter = {"pwm": pwm, "dead_time": dead_time, "minimum_pulse": minimum}
        x = last_turn(duties, MOTOR | {"psi_f": 1e-6}, inverter, rows, turns=1)
        high = x["u_a"] > (1 / 3 if others == 0 else -1 / 3) * BUS
        assert np.all(x["i_a"][rows:] * (1 - 2 * others) > 0)
        shortest[minimum] = widths(high).min() / rows / RATE
    row = 1 / rows / RATE
    assert shortest[0.0] < MINIMUM / 2
    assert MINIMUM - row <= shortest[MINIMUM] < MINIMUM + dead_time + 2 * row
    share = high.reshape(-1, rows).mean(axis=1)
    half = (0.5 if pwm == "centre" else 1.0) / RATE
    assert np.max(np.abs(share - duty)) < (MINIMUM + dead_time) / half + 2 / rows
