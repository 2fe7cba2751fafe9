"""Filtered rows of a log: fast ways to them give what the definitions do."""

from __future__ import annotations

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
