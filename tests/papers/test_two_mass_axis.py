"""The study of the two-mass axis: what its sensor's side decides, by the gear's kinematics."""

import math

import numpy as np
import pytest

from cogless import load
from cogless.results.trace import Trace
from cogless.run.simulate import simulate
from cogless.study import Study

RATIO, ERROR, SPEED = 5, 0.3e-3, 2 * math.pi  # of the gear; rad; rad/s of the motor
LAST = slice(-8000, None)  # 4 s


def order_2(trace: Trace, signal: str) -> float:
    """Amplitude of the second order of the motor's revolution."""
    speed, theta = trace.part(signal, LAST), trace.part("theta_m", LAST)
    waves = np.stack([np.ones_like(theta), np.cos(2 * theta), np.sin(2 * theta)], axis=1)
    return float(np.hypot(*np.linalg.lstsq(waves, speed, rcond=None)[0][1:]))


@pytest.mark.parametrize("side", ["motor", "load"])
def test_what_is_learned_is_the_speed_of_the_side_that_is_measured(side: str) -> None:
    study = load("two-mass-axis")
    assert isinstance(study, Study)
    trace = simulate(study, f"{side}-sensor", "pi-ilc").trace
    feedback = simulate(study, f"{side}-sensor", "pi").trace
    shaken = 2 * SPEED * ERROR  # rad/s, at the gear's output, while the motor turns evenly
    other, factor = ("omega_load", 1) if side == "motor" else ("omega_m", RATIO)
    own = "omega_m" if side == "motor" else "omega_load"
    assert order_2(trace, own) < 0.002 * order_2(feedback, own)
    assert order_2(trace, other) == pytest.approx(factor * shaken, rel=0.01)
    assert order_2(trace, "omega_load") < order_2(feedback, "omega_load")
