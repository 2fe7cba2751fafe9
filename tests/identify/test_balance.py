"""The rows of the balance, against logs whose angle and current are written down in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cogless.identify.balance import LADDER, Model, Rows, Sensor, rows_of
from cogless.identify.config import LogRule
from cogless.identify.log import Log

J, B, C, OFFSET, LOAD, FALL = 1e-3, 2e-3, 0.2, 0.03, 0.5, 0.15
POLES, DELAY, DT, FALL_SPEED = 4, 0.7e-3, 1e-3, 6.0
COGGING = {6: (0.1, -0.05), 11: (0.02, 0.03)}
RIPPLE, ENCODER, FRICTION = {24: (0.02, 0.01)}, {1: (2e-3, -1e-3), 2: (5e-4, 5e-4)}, {1: (0.05, -0.02)}
SENSOR = Sensor(0.0, POLES)


def series(waves: dict[int, tuple[float, float]], theta: np.ndarray, derivative: int = 0) -> np.ndarray:
    total = np.zeros_like(theta)
    for n, (c, s) in waves.items():
        total += ((complex(c, -s) * (1j * n) ** derivative) * np.exp(1j * n * theta)).real
    return total


def moving(rate: float = 3.0) -> tuple[Log, dict]:
    """A log whose speed swings about a mean, and the true coefficients of its columns."""
    t = DT * np.arange(6000)

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        w = 2 * math.pi * 0.7
        return (rate * t - 2 / w * np.cos(w * t), rate + 2 * np.sin(w * t), 2 * w * np.cos(w * t))

    theta, omega, alpha = motion(t - DELAY)  # the current is of the angle so long before
    i_d = 0.3 * np.sin(5 * t)
    torque = J * alpha + B * omega + (C + series(FRICTION, theta)) * np.sign(omega) + OFFSET + LOAD
    torque += FALL * np.sign(omega) * np.exp(-((omega / FALL_SPEED) ** 2)) - series(COGGING, theta)
    turned = sum(n / POLES * series({n: (s, -c)}, theta) for n, (c, s) in RIPPLE.items())
    i_q = (torque - i_d * turned) / (1 + series(RIPPLE, theta))
    true, _, _ = motion(t)
    signals = {"theta": true + series(ENCODER, true), "i_q": i_q, "i_d": i_d}
    log = Log("a", LogRule(file="*", kind="load"), DT, signals, (slice(0, 6000),))
    values = {("j",): J, ("b",): B, ("c",): C, ("offset",): OFFSET, ("load", "a"): LOAD, ("stribeck",): FALL}
    for kind, waves in (("cogging", COGGING), ("ripple", RIPPLE), ("friction", FRICTION)):
        values |= {(kind, n, p): x for n, pair in waves.items() for p, x in zip("cs", pair, strict=True)}
    return log, values


MODEL = Model(
    cogging=tuple(COGGING),
    ripple=tuple(RIPPLE),
    friction=tuple(FRICTION),
    encoder=tuple(ENCODER),
    stribeck=FALL_SPEED,
    columns=frozenset({"j", "b", "c", "offset"}),
    delay=DELAY,
    error=ENCODER,
    waves=COGGING,
    j=J,
)


def residual(model: Model, values: dict, log: Log) -> float:
    (rows,) = rows_of(log, model, SENSOR)
    left = rows.y - rows.columns @ np.array([values.get(name, 0.0) for name in rows.names])
    return float(np.sqrt(np.mean(left**2)))


def test_the_true_coefficients_explain_a_late_current_with_every_column() -> None:
    log, values = moving()
    whole = residual(MODEL, values, log)
    assert whole < 2e-4
    for name in (
        ("j",),
        ("b",),
        ("c",),
        ("stribeck",),
        ("cogging", 11, "c"),
        ("ripple", 24, "s"),
        ("friction", 1, "s"),
    ):
        assert residual(MODEL, {**values, name: 0.0}, log) > 3 * whole
    assert residual(replace(MODEL, delay=0.0), values, log) > 10 * whole


def test_an_error_of_the_angle_that_is_not_taken_out_shows_in_its_columns_times_the_inertia(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The ripple's slope is not in them: the error is taken out until nothing is left of it."""
    monkeypatch.setitem(RIPPLE, 24, (0.0, 0.0))
    log, values = moving()
    errors = {
        ("encoder", n, p): J * x for n, pair in ENCODER.items() for p, x in zip("cs", pair, strict=True)
    }
    without = replace(MODEL, error={})
    assert residual(without, {**values, **errors}, log) < 0.15 * residual(without, values, log)


def test_the_mean_of_a_current_times_a_wave_is_right_where_its_phase_is_not_seen() -> None:
    """Order 24 at 20 rev/s: three waves in a row or so. Its columns are not cut."""
    log, values = moving(rate=40 * math.pi)
    (rows,) = rows_of(log, MODEL, SENSOR)
    place = rows.names.index(("ripple", 24, "c"))
    assert np.std(rows.columns[:, place]) > 0
    assert residual(MODEL, values, log) < 2e-3


@pytest.mark.parametrize("turned", [0.0, 0.01, 0.02, 0.03])
def test_a_wave_that_is_not_seen_from_a_speed_on_leaves_no_end(turned: float) -> None:
    """Order 84 over a ramp to 90 rad/s: from 14 rad/s on its phase is not known, and the kernel hides it."""
    t = DT * np.arange(400)
    theta = turned + t + 110 * t**2
    log = Log("a", LogRule(file="*"), DT, {"theta": theta, "i_q": 0 * theta}, (slice(0, 400),))
    model = Model(cogging=(84,), widths={"a": 3.9e-3})
    (rows,) = rows_of(log, model, Sensor(0.0, 7, 1e-3))
    waves = rows.columns[:, [rows.names.index(("cogging", 84, part)) for part in "cs"]]
    assert np.max(np.abs(waves[rows.omega < 10])) > 0.02
    assert np.max(np.abs(waves[(rows.omega > 12) & (rows.omega < 60)])) < 4e-3


def test_the_delay_s_column_is_the_current_s_derivative() -> None:
    log, values = moving()
    late = replace(MODEL, columns=MODEL.columns | {"delay"}, delay=DELAY - 1e-4)
    assert residual(late, {**values, ("delay",): 1e-4}, log) < 0.3 * residual(late, values, log)


def of_speed(omega: np.ndarray, step: float = 0.0) -> Rows:
    theta = np.cumsum(omega) * DT
    theta = np.floor(theta / step) * step if step else theta
    log = Log("a", LogRule(file="*"), DT, {"theta": theta, "i_q": 0 * theta}, (slice(0, len(theta)),))
    (rows,) = rows_of(log, Model(), Sensor(step, POLES))
    return rows


def test_rows_in_which_a_rotor_creeps_or_turns_around_are_left_out() -> None:
    """Below a twentieth of the median speed friction is not that of sliding."""
    omega = np.concatenate([np.full(2000, 2.0), np.linspace(2.0, -2.0, 400), np.full(2000, -2.0)])
    rows = of_speed(omega)
    assert np.min(np.abs(rows.omega)) > 0.1 and {-1.0, 1.0} == set(np.sign(rows.omega))
    creeping = of_speed(np.where(np.arange(4000) < 1000, 0.09, 2.0))
    assert np.all(creeping.at > 970)


def test_the_noise_of_an_angle_in_steps_is_that_of_its_second_derivative() -> None:
    """The variance that is taken off the equations is that which rounding adds to alpha, within 2.5."""
    step, random = 2 * math.pi / 4096, np.random.default_rng(3)
    omega = 15 + 8 * np.sin(np.arange(60_000) * 1e-3) + np.cumsum(random.standard_normal(60_000)) * 1e-3
    rough, smooth = of_speed(omega, step), of_speed(omega)
    count = min(len(rough.y), len(smooth.y))
    added = np.var(rough.columns[:count, 0] - smooth.columns[:count, 0])
    told = np.mean(rough.noise["j",][:count])
    assert added / 2.5 < told < 2.5 * added


def test_an_instrument_is_the_acceleration_through_a_wider_kernel() -> None:
    log, _ = moving()
    (rows,) = rows_of(log, replace(MODEL, error={}), SENSOR)
    assert rows.instruments.shape == (len(LADDER), len(rows.y))
    alpha, slow = rows.columns[:, rows.names.index(("j",))], rows.instruments[-1]
    assert 0 < np.std(slow) < np.std(alpha)


def test_a_column_of_a_trial_speed_is_that_of_a_model_with_this_speed() -> None:
    log, _ = moving()
    (one,) = rows_of(log, MODEL, SENSOR)
    (trials,) = rows_of(log, replace(MODEL, stribeck=0.0, stribeck_trials=(1.0, FALL_SPEED)), SENSOR)
    only = trials.without([("stribeck", 0)])
    assert [name for name in only.names if name[0] != "stribeck"] == [
        n for n in one.names if n[0] != "stribeck"
    ]
    assert np.array_equal(only.columns, one.columns)
