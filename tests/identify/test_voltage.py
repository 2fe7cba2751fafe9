"""K_t and R from the voltage of steady parts, in closed form, and what is said of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from identify.fits import of_motor, turning

from cogless.identify import voltage
from cogless.identify.advice import Advice
from cogless.identify.result import Value


def test_k_t_and_r_come_out_of_the_voltage_of_steady_parts() -> None:
    """u = R i + K_e w + 0.4 V of a dead time, by the current's sign, at four speeds and two currents."""
    logs = []
    for n, (speed, current) in enumerate(
        [(10.0, 0.5), (10.0, 2.0), (-20.0, -0.5), (30.0, 1.0), (-30.0, -2.0)]
    ):
        log = turning(speed, 20_000, i_q=np.full(20_000, current))
        u_q = 0.9 * log["i_q"] + 0.21 * speed + 0.4 * np.sign(current)
        logs.append(replace(log, name=str(n), signals={**log.signals, "u_q": np.broadcast_to(u_q, 20_000)}))
    known = of_motor().identification
    told = voltage.constants_from_voltage(known, logs)
    assert told is not None
    k_t, r = told
    assert k_t.value == pytest.approx(0.21 * 0.3 / (4 * 0.05)) and r.value == pytest.approx(0.9)
    assert 0.01 * k_t.value < k_t.error < 0.02 * k_t.value  # more than the inverter's gain
    assert 0.01 * r.value < r.error
    assert voltage.constants_from_voltage(known, logs[:3]) is None  # too few for three unknowns
    assert voltage.constants_from_voltage(known, logs[:4]) is not None
    assert voltage.constants_from_voltage(known, [logs[0]] * 2 + [logs[1]] * 2) is None  # at one speed


@pytest.mark.parametrize(("fast", "told"), [(20.1, True), (19.8, False)])
def test_speeds_that_tell_k_t_are_a_factor_of_two_apart(fast: float, told: bool) -> None:
    """However the motor turns, and however many times."""
    logs = []
    for n, (speed, current) in enumerate([(10.0, 0.5), (10.0, -2.0), (-fast, -0.5), (fast, 1.0)]):
        u_q = 0.9 * current + 0.21 * speed + 0.4 * np.sign(current)
        signals = {"i_q": np.full(20_000, current), "u_q": np.full(20_000, u_q)}
        logs.append(replace(turning(speed, 20_000, **signals), name=str(n)))
    assert (voltage.constants_from_voltage(of_motor().identification, logs) is not None) == told


def test_what_the_voltage_leaves_unexplained_is_in_the_errors() -> None:
    """By Student's t of two degrees of freedom, 4.303 at 95 %, as of five parts for three unknowns."""
    speeds, currents = np.array([10.0, 10.0, -20.0, 30.0, -30.0]), np.array([0.5, 2.0, -0.5, 1.0, -2.0])
    columns = np.column_stack((speeds, currents, np.sign(currents)))
    left = np.linalg.svd(columns)[0][:, 3]  # what no unknown explains
    logs = []
    for n, u_q in enumerate(columns @ [0.21, 0.9, 0.4] + left):
        log = turning(speeds[n], 20_000, i_q=np.full(20_000, currents[n]), u_q=np.full(20_000, u_q))
        logs.append(replace(log, name=str(n)))
    told = voltage.constants_from_voltage(of_motor().identification, logs)
    assert told is not None
    spread = 4.30265 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)) / 2)
    by_k_t = 0.3 / (4 * 0.05)
    assert told[0].error > by_k_t * math.hypot(spread[0], 0.0021)
    assert told[1].error > math.hypot(spread[1], 0.009)


def test_what_the_voltage_says_of_k_t_and_of_the_unit_of_the_current() -> None:
    """The servo's K_t is 0.3 N m/A; copper has sqrt(2) times its resistance 105 K warmer."""
    known = of_motor().identification
    known.motor = known.motor.model_copy(update={"R_s": 2.0})
    agreed = voltage._of_k_t(known, Value(0.309, 0.01))
    assert isinstance(agreed, voltage.Agreement)
    assert agreed == "From the logged voltage, K_t is 0.309 +- 0.01 N*m/A, as id.toml has it (0.3)."
    ends = ": all torques are in proportion to K_t; correct motor.K_t, or K_t_rms if it is per rms ampere, "
    ends += "or kv."
    for value, begins in ((0.315, "K_t is 0.315"), (0.285, "K_t is 0.285"), (0.339, "K_t is 0.339")):
        said = voltage._of_k_t(known, Value(value, 0.01))
        assert said == (
            f"From the logged voltage, {begins} +- 0.01 N*m/A; id.toml has 0.3. Magnets that are 50 K "
            "warmer, or a wrong gain of the voltage's measurement, would also make this difference, so it is "
            "open which value is right; all torques are in proportion to K_t."
        )
        assert not isinstance(said, voltage.Agreement | Advice)
    for value, begins in ((0.38, "K_t is 0.38"), (0.23, "K_t is 0.23")):
        said = voltage._of_k_t(known, Value(value, 0.01))
        assert said == f"From the logged voltage, {begins} +- 0.01 N*m/A; id.toml has 0.3{ends}"
        assert isinstance(said, Advice) and said.cures == ({"motor.K_t": f"{value} N*m/A"},)
    backwards = voltage._of_k_t(known, Value(-0.3, 0.01))
    assert backwards.endswith("has 0.3: the signs of u_q, of i_q and of the angle do not fit each other.")
    assert not isinstance(backwards, Advice)
    for value in (0.3 * math.sqrt(2), 0.3 / math.sqrt(2)):
        said = voltage._of_k_t(known, Value(value, 0.004))
        assert said.endswith(f"; the values differ by sqrt(2), the factor between rms and peak{ends}")
    assert voltage._of_r(known, Value(2.7, 0.13)) == [
        "From the logged voltage, R is 2.7 +- 0.13 ohm, sqrt(2) times that in id.toml (2). Either i_q is "
        "in rms amperes, and all torques are sqrt(2) times too small, or the winding is 105 K warmer; record "
        "i_a and i_b to decide this."
    ]
    assert voltage._of_r(known, Value(2.7, 0.12)) == []  # 2.83 is not within its error
    assert voltage._of_r(known, Value(2.83, 0.282)) and not voltage._of_r(known, Value(2.83, 0.284))
