"""What the logs are simulated with: a dead time as they tell it, where a drive can have it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.commissioned import MOTORS

from cogless.identify.config import LogRule
from cogless.identify.log import Log
from cogless.identify.replay import (
    _bandwidth,
    _kept,
    _likely,
    _more,
    _rate,
    _said_of_dead_time,
    _with_dead_time,
    simulated_log,
)
from cogless.identify.result import Value
from cogless.results.trace import Trace
from cogless.study.drive import Drive
from cogless.study.motor import Motor

OWN = 1e-7  # s, that the file of columns says


def drive_tables() -> dict[str, Any]:
    inverter = {"bus_voltage": "24 V", "dead_time": f"{OWN} s"}
    return {**MOTORS["gimbal"]["drive"], "inverter": inverter}


@pytest.fixture
def drive() -> Drive:
    return Drive.model_validate(drive_tables())


@pytest.mark.parametrize("told", [2e-7, -0.5e-7])
def test_a_dead_time_that_stands_out_is_simulated(drive, told):
    assert _likely(Value(told, 1e-8), drive) == told


@pytest.mark.parametrize(
    ("told", "error"),
    [
        (2e-7, 1.1e-7),  # within its error
        (-1.5e-7, 1e-8),  # less than none
        (1e-5, 1e-8),  # a tenth of the current loop's period
    ],
)
def test_a_dead_time_that_no_drive_has_is_not(drive, told, error):
    assert _likely(Value(told, error), drive) == 0


def test_a_dead_time_is_told_where_it_stands_out():
    assert _said_of_dead_time(Value(2e-7, 0.9e-7)).startswith(
        "The currents follow as with about 200 ns more dead time than the file of columns says"
    )
    assert _said_of_dead_time(Value(2e-7, 1.1e-7)) == _said_of_dead_time(Value(0.0, 0.0)) == ""


def known(**more: Any) -> Any:
    """As much of an estimate as a replay asks for."""
    motor, rates = SimpleNamespace(pole_pairs=4), SimpleNamespace(current_loop=10e3)
    given = {"motor": motor, "step": 2e-3, "angle_offset": None, "drive": SimpleNamespace(rates=rates)}
    return SimpleNamespace(known=SimpleNamespace(**{**given, **more}))


@pytest.mark.parametrize(
    ("dt", "rate"),
    [
        (1e-3, 10e3),  # ten rows of the trace for each of the log
        (1.2e-3, 5e3),  # six, since ten do not divide the twelve periods of the current loop
        (1.3e-3, 10e3 / 13),
        (1e-4, 10e3),
        (1.009e-3, 10e3),  # a clock that is off by less than a hundredth
        (1.011e-3, None),
        (0.991e-3, 10e3),
        (0.989e-3, None),
        (0.4e-4, None),  # faster than the current loop
    ],
)
def test_rows_of_a_trace_are_those_of_the_log_and_some_between(dt, rate):
    found = _rate(known(), SimpleNamespace(dt=dt))
    assert found is None if rate is None else found == pytest.approx(rate)


def test_a_drive_s_current_loop_has_its_bandwidth():
    study = MOTORS["gimbal"]
    made = SimpleNamespace(known=SimpleNamespace(
        motor=Motor.model_validate(study["motor"]), drive=Drive.model_validate(study["drive"])
    ))  # fmt: skip
    assert _bandwidth(made) == pytest.approx(2 * np.pi * 500)


def test_more_dead_time_is_not_known_to_the_compensation(drive):
    """Which keeps what it believed, whether that was given or the inverter's."""
    table = {"inverter": {"bus_voltage": "24 V", "dead_time": "1e-7 s"}, "seed": 1}
    made = _with_dead_time(table, drive, 2e-7)
    assert made == {"inverter": {"bus_voltage": "24 V", "dead_time": "3e-07 s"}, "seed": 1}
    for given, believed in (({}, {"time": "1e-07 s"}), ({"time": "5e-8 s"}, {"time": "5e-8 s"})):
        compensation = {"band": "10 mA", **given}
        compensated = Drive.model_validate({**drive_tables(), "dead_time_compensation": compensation})
        found = _with_dead_time({**table, "dead_time_compensation": compensation}, compensated, 2e-7)
        assert found["dead_time_compensation"] == {"band": "10 mA", **believed}
    assert _more(drive) == pytest.approx(0.002 / drive.rates.current_loop)


def trace_with(error: float) -> Trace:
    """40 rows of 0.1 ms; the angle is measured so much further, rad."""
    t = 1e-4 * np.arange(40)
    columns = {
        "time": ("s", t),
        "theta_m": ("rad", 30 * t),
        "theta_measured": ("rad", (30 * t + error) % (2 * np.pi)),
        "i_d": ("A", 0.5 + 0 * t),
        "i_q": ("A", 100 * t),
        "omega_measured": ("rad/s", 7 + t),
        "tau_e": ("N*m", t),
    }
    units, data = zip(*columns.values(), strict=True)
    return Trace(tuple(columns), units, np.column_stack(data))


def test_a_trace_keeps_the_signals_that_a_log_has():
    kept = _kept(trace_with(0.0))
    assert kept.names == ("time", "theta_measured", "theta_m", "omega_measured", "i_q", "i_d")
    assert kept.units == ("s", "rad", "rad", "rad/s", "A", "A")
    for name in kept.names:
        assert np.array_equal(kept[name], trace_with(0.0)[name])


@pytest.mark.parametrize(("offset", "added"), [(None, 1e-3), (0.3, 0.3)])
def test_a_simulated_log_has_the_drive_s_angle_and_its_currents_late(offset, added):
    """The drive sees the current's vector turned back by the electrical angle that its sensor is ahead."""
    error, late = 0.1, 0.25e-3
    log = Log("a", LogRule(file="*"), 1e-3, {"theta": np.zeros(4), "i_d": np.zeros(4)}, (slice(0, 4),))
    made = simulated_log(known(angle_offset=offset), log, trace_with(error), late)
    t = 1e-3 * np.arange(4)
    assert (made.name, made.dt, made.stretches) == ("a", pytest.approx(1e-3), (slice(0, 4),))
    assert made["theta"] == pytest.approx(30 * t + error + added)
    assert made["omega"] == pytest.approx(7 + t)
    seen = (0.5 + 100j * np.maximum(t - late, 0)) * np.exp(-4j * error)
    assert made["i_q"] == pytest.approx(seen.imag) and made["i_d"] == pytest.approx(seen.real)
    assert "i_d" not in simulated_log(
        known(), replace(log, signals={"theta": np.zeros(4)}), trace_with(error)
    )
