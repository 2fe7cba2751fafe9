"""Filtered rows of a log: fast ways to them give what the definitions do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cogless.identify import weak_form
from cogless.identify.config import LogRule
from cogless.identify.log import Log
from cogless.identify.weak_form import Kernel, Model, Sensor, rows_of, shifted

DT = 1e-3
MODEL = Model(
    cogging=(7, 24, 90),
    ripple=(24,),
    encoder=(1, 2),
    columns=frozenset({"j", "b", "c", "offset", "delay"}),
    delay=0.3e-3,
    error={1: (1e-3, -2e-3)},
    waves={7: (0.1, 0.2), 24: (0.3, -0.1)},
    j=1e-3,
)
SENSOR = Sensor(step=2e-4, pole_pairs=4)


@pytest.fixture
def log() -> Log:
    """Four seconds of a rotor that turns around, in two stretches."""
    t = DT * np.arange(4000)
    random = np.random.default_rng(3)
    signals = {
        "theta": 3 * t + 8 * np.sin(2 * t),
        "i_q": np.cos(5 * t) + 0.1 * random.standard_normal(len(t)),
        "i_d": 0.1 * random.standard_normal(len(t)),
    }
    return Log("log", LogRule(file="log"), DT, signals, (slice(0, 1500), slice(1500, 4000)))


def test_rows_of_a_log_in_pieces_are_those_of_the_whole(log, monkeypatch):
    whole = rows_of(log, MODEL, weak_form.WIDTH, SENSOR)
    monkeypatch.setattr(weak_form, "PIECE", 100)
    pieces = rows_of(log, MODEL, weak_form.WIDTH, SENSOR)
    assert [len(rows.y) for rows in pieces] == [len(rows.y) for rows in whole]
    for one, other in zip(pieces, whole, strict=True):
        assert one.names == other.names and np.array_equal(one.at, other.at)
        for name in ("columns", "y", "noise", "theta", "omega"):
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9, abs=1e-9), name


def test_columns_are_the_filtered_signals(log):
    (rows, _) = rows_of(log, MODEL, weak_form.WIDTH, SENSOR)
    kernel, at = Kernel(weak_form.WIDTH, DT), rows.at.astype(int)
    theta = weak_form.corrected(log["theta"], MODEL)
    current = shifted(log["i_q"][:1500], MODEL.delay / DT)
    i_d = shifted(log["i_d"][:1500], MODEL.delay / DT)

    def column(name):
        return rows.columns[:, rows.names.index(name)]

    def filtered(x, by=kernel.value):
        return np.array([x[k - kernel.half : k + kernel.half + 1] @ by for k in at])

    slope = sum(
        n / MODEL.j * (s * np.cos(n * theta) - c * np.sin(n * theta)) for n, (c, s) in MODEL.waves.items()
    )
    theta, slope = theta[:1500], slope[:1500]
    for name, expected in (
        (("j",), filtered(theta, kernel.second)),
        (("b",), filtered(theta, kernel.first)),
        (("delay",), -filtered(current, kernel.first)),
        (("cogging", 24, "s"), -filtered(np.sin(24 * theta))),
        (
            ("ripple", 24, "c"),
            -filtered(current * np.cos(24 * theta) - 6 * i_d * np.sin(24 * theta)),
        ),
        (
            ("encoder", 2, "c"),
            filtered(slope * np.cos(2 * theta)) - filtered(np.cos(2 * theta), kernel.second),
        ),
    ):
        assert column(name) == pytest.approx(expected, rel=1e-8, abs=1e-9), name
    assert rows.y == pytest.approx(filtered(current))


@pytest.mark.parametrize("rows", [0.4, -0.4, 3.7, -5.0])
def test_a_signal_is_shifted_by_parts_of_a_row(rows):
    n, end = np.arange(200.0), -1 if rows > 0 else 0
    x = np.sin(0.05 * n)
    made = shifted(x, rows)
    assert made[10:-10] == pytest.approx(np.sin(0.05 * (n + rows))[10:-10], abs=1e-5)
    assert made[end] == pytest.approx(x[end], abs=0.02)


def turning(speed: float, rows: int = 1000) -> Log:
    theta = speed * DT * np.arange(rows)
    return Log("log", LogRule(file="log"), DT, {"theta": theta, "i_q": 0 * theta}, (slice(0, rows),))


@pytest.mark.parametrize(("speed", "share"), [(0.05, 0.25), (0.2, 1.0), (-3.0, 1.0)])
def test_steps_of_the_angle_make_the_noise_of_inertia_and_friction(speed, share):
    """The noise is step^2 / 12 through the kernel at a step a row or more; at less it is less."""
    (rows,) = rows_of(turning(speed), replace(MODEL, error={}), weak_form.WIDTH, SENSOR)
    kernel, variance = Kernel(weak_form.WIDTH, DT), share * SENSOR.step**2 / 12
    noise = {name: rows.noise[:, n] for n, name in enumerate(rows.names)}
    assert noise.pop(("j",)) == pytest.approx(variance * np.sum(kernel.second**2))
    assert noise.pop(("b",)) == pytest.approx(variance * np.sum(kernel.first**2))
    assert not any(each.any() for each in noise.values())


def test_rows_are_a_kernel_s_width_apart_but_for_the_ends():
    """No row is within a kernel's reach of an end, where the speed is not known, nor its sign."""
    (rows,) = rows_of(turning(3.0), replace(MODEL, error={}), weak_form.WIDTH, SENSOR)
    assert np.array_equal(rows.at, np.arange(42, 1000 - 42, 6))
    assert [weak_form.width_of(replace(rows.log, dt=dt), 6e-3) for dt in (1e-3, 1e-2)] == [6e-3, 0.03]


def test_a_load_is_a_column_where_no_sensor_tells_it():
    """A torque that is measured is taken off the current. Without a current no delay can be told."""
    log = replace(turning(3.0), rule=LogRule(file="log", kind="load"))
    log.signals["i_q"] = np.full(1000, 0.5)
    model = Model(columns=frozenset({"c", "delay"}))
    (rows,) = rows_of(log, model, weak_form.WIDTH, SENSOR)
    assert rows.names == (("c",), ("delay",), ("load", "log"))
    assert rows.columns == pytest.approx(np.tile([1.0, 0.0, 1.0], (len(rows.y), 1)), abs=2e-3)
    assert rows.y == pytest.approx(0.5)
    log.signals["torque"] = np.full(1000, 0.2)
    (told,) = rows_of(log, model, weak_form.WIDTH, SENSOR)
    assert told.names == (("c",), ("delay",)) and told.y == pytest.approx(0.3)
    del log.signals["i_q"]
    (without,) = rows_of(log, model, weak_form.WIDTH, SENSOR)
    assert without.names == (("c",),) and without.y == pytest.approx(-0.2)


def test_a_wave_counts_where_the_rows_show_it():
    """Three rows a wave: order 90 at 20 rad/s, but not at 25."""
    t = DT * np.arange(2000)
    log = turning(0.0, 2000)
    log.signals["theta"] = 20 * t + 5 * np.maximum(0, t - 1)
    (rows,) = rows_of(log, Model(cogging=(90,), columns=frozenset()), 1e-3, SENSOR)
    seen = np.abs(rows.columns).max(axis=1)
    fast = (rows.at > 1050) & (rows.at < 1950)
    assert seen[rows.at < 950].min() > 1e-8 and seen[fast].max() == 0


def test_a_model_looks_for_inertia_and_friction_alone_unless_more_is_said():
    nothing = {"cogging": (), "ripple": (), "encoder": (), "delay": 0.0, "error": {}, "waves": {}, "j": 0.0}
    wanted = {**nothing, "columns": frozenset("jbc"), "width": 6e-3, "untold": frozenset()}
    assert vars(Model()) == wanted


@pytest.mark.parametrize(("counts", "turns"), [(4.1, True), (3.9, False)])
def test_a_rotor_surely_turns_from_four_counts_within_the_kernel_s_reach_on(counts, turns):
    speed = counts * SENSOR.step / (4 * weak_form.WIDTH)
    found = rows_of(turning(speed), replace(MODEL, error={}), weak_form.WIDTH, SENSOR)
    assert bool(found) == turns
    assert rows_of(turning(speed), replace(MODEL, error={}), weak_form.WIDTH, replace(SENSOR, step=0.0))


def test_rows_around_a_reversal_are_left_out(log):
    """Where the sign of the speed changes within the kernel, friction is not known."""
    for rows in rows_of(log, MODEL, weak_form.WIDTH, SENSOR):
        half = Kernel(weak_form.WIDTH, DT).half
        for at in rows.at.astype(int):
            speed = np.gradient(log["theta"][at - half : at + half + 1])[6:-6]
            assert np.ptp(np.sign(speed)) == 0
        kept = np.diff(rows.at)
        assert kept.max() > 2 * half - 12 > kept.min()  # there are reversals, and all else stays


def test_rows_of_a_hold_map_are_its_angles():
    """The rotor came from one direction or the other; K_t ripple acts by the current that holds it."""
    theta = np.linspace(0, 6, 50)
    current, direction = 0.3 * np.sin(6 * theta), np.where(np.arange(50) % 2, 1.0, -1.0)
    signals = {"theta": theta, "i_q": current, "direction": direction}
    held = Log("held", LogRule(file="held", kind="hold"), 0.0, signals, (slice(0, 50),))
    model = Model(cogging=(6,), ripple=(24,), columns=frozenset({"offset"}), error={1: (0.01, -0.02)})
    (rows,) = rows_of(held, model, weak_form.WIDTH, SENSOR)
    true = weak_form.corrected(theta, model)
    assert true == pytest.approx(theta - 0.01 * np.cos(true) + 0.02 * np.sin(true), abs=2e-5)
    names = (
        ("c_hold",),
        ("offset",),
        *((kind, n, part) for kind, n in (("cogging", 6), ("ripple", 24)) for part in "cs"),
    )
    assert rows.names == names
    wanted = [direction, np.ones(50), -np.cos(6 * true), -np.sin(6 * true),
              -current * np.cos(24 * true), -current * np.sin(24 * true)]  # fmt: skip
    assert rows.columns == pytest.approx(np.column_stack(wanted))
    assert np.array_equal(rows.y, current) and not rows.noise.any() and not rows.omega.any()
    assert np.array_equal(rows.theta, true) and np.array_equal(rows.at, np.arange(50))
    (alone,) = rows_of(held, replace(model, columns=frozenset()), weak_form.WIDTH, SENSOR)
    assert alone.names == tuple(name for name in names if name != ("offset",))
