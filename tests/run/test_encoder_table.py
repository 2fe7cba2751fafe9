"""A sensor's error of a high order is learned at speed, and angle and every kind of speed are corrected."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.errors import StudyError
from cogless.results.trace import Trace
from cogless.run.simulate import simulate

# 10 pole pairs, 600 r/min, an error of order 20 and 0.4 degrees; the law runs at 1 kHz
TABLE = """
title = "A sensor with an error of order 20"
[motor]
pole_pairs = 10
R_s = "0.5 ohm"
L_d = "0.5 mH"
L_q = "0.5 mH"
psi_f = "20 mWb"
[mechanics]
inertia = "2e-4 kg*m^2"
[trace]
rate = "10 kHz"
[drive]
rates = { current_loop = "10 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "800 Hz", current_limit = "20 A" }
inverter = { bus_voltage = "48 V" }
[scenario]
fast = { duration = "3 s", reference = "600 rpm", initial_speed = "600 rpm" }
[controller.pi]
law = "pi"
kp = "0.08 A*s/rad"
ki = "4 A/rad"
"""
ERROR = [{"order": 20, "amplitude": "0.4 deg"}]
ENCODER = {"kind": "encoder", "lines": 16384, "error": ERROR}
WORD = {"kind": "absolute", "bits": 16, "error": ERROR}
SENSORS: dict[str, dict[str, Any]] = {
    "encoder M": {**ENCODER, "speed_method": "M"},
    "encoder average": {**ENCODER, "speed_method": "average", "window": 10},
    "encoder T": {**ENCODER, "speed_method": "T"},
    "encoder MT": {**ENCODER, "speed_method": "MT"},
    "encoder observer": {**ENCODER, "speed_method": "observer", "observer_bandwidth": "300 Hz"},
    "absolute M": {**WORD, "speed_method": "M"},
    "absolute average": {**WORD, "window": 10},
    "resolver observer": {
        "kind": "resolver", "bits": 16, "error": ERROR,
        "speed_method": "observer", "observer_bandwidth": "300 Hz",
    },
}  # fmt: skip


def order_of(trace: Trace, signal: str) -> float:
    """Amplitude of order 20 over the last ten turns."""
    late = trace.time >= trace.time[-1] - 1.0
    wave = np.exp(-20j * trace["theta_m"][late])
    return float(2 * abs(np.mean((trace[signal][late] - trace[signal][late].mean()) * wave)))


def traced(folder: Path, sensor: dict[str, Any], learned: bool, **changes: Any) -> Trace:
    table = {"orders": [20], "omega_min": "300 rpm", "time_constant": "0.2 s"}
    more = {"drive.position_sensor": sensor, **({"drive.encoder_table": table} if learned else {}), **changes}
    return simulate(studies.study(folder, more, TABLE), "fast", "pi").trace


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("sensor", SENSORS)
def test_the_learned_error_is_out_of_the_speed(sensor: str, filtered: bool, tmp_path: Path) -> None:
    changes: dict[str, Any] = {"drive.speed_filter": "400 Hz"} if filtered else {}
    if sensor == "encoder T":  # its edges are on a straight way within a step, of which it takes the last two
        changes["drive.rates.integration_steps"] = 8
    plain, learned = (traced(tmp_path, SENSORS[sensor], table, **changes) for table in (False, True))
    assert order_of(plain, "theta_sensor_error") == pytest.approx(math.radians(0.4), rel=0.02)
    for signal in ("theta_sensor_error", "omega_measured", "omega_m", "i_q"):
        assert order_of(learned, signal) < 0.03 * order_of(plain, signal), signal


@pytest.mark.parametrize("kind", ["ideal", "hall"])
def test_a_sensor_without_such_an_error_is_not_corrected(kind: str, tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r"drive\.encoder_table.*: expected no such key, since position_sensor"
    ):
        traced(tmp_path, {"kind": kind}, True)
