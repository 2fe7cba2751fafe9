"""The engine: reproducible, resumable, parallel; float beside double; multirate timing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import PI_ILC, RIPPLE, config, drive_of, merged, run

from cogless import _simulator_f32, _simulator_f64

BUSY: dict[str, Any] = {
    "motor": RIPPLE,
    "seed": 3,
    "load": {"torque": 0.1, "lag": 0.01},
    "events": [{"time": 0.2, "load": 0.3}],
    "mechanics": {"coulomb_friction": 0.01, "breakaway_friction": 0.02},
    "drive": {
        "position_sensor": {
            "kind": "encoder",
            "counts": 4000.0,
            "speed_method": "MT",
            "timer": 1e8,
            "error": [{"order": 1, "amplitude": 1e-3, "phase": 0.0}],
        },
        "current_sensors": {"noise": 0.01, "bits": 12, "range": 20.0},
    },
    "controller": PI_ILC,
}


def rows(drive: Any, state: Any, ticks: int) -> np.ndarray:
    recorder = _simulator_f64.Recorder(drive, 1)
    drive.advance(state, recorder, ticks)
    return recorder.take()


def test_a_run_repeats_bit_for_bit() -> None:
    first, second = run(BUSY, 0.5), run(BUSY, 0.5)
    assert all(np.array_equal(first[name], second[name]) for name in first)


LATE: dict[str, Any] = {
    "position_sensor": {"kind": "absolute", "counts": 2.0**14, "speed_method": "M", "latency": 2.5e-4},
    "speed_filter": 900.0,
    "bus": {"delay_measured": 1e-3, "delay_command": 5e-4, "jitter": 1e-3, "quantum": 0.01},
}


@pytest.mark.parametrize("late", [{}, LATE])
def test_a_run_in_pieces_is_the_same_run(late: dict[str, Any]) -> None:
    drive = drive_of(_simulator_f64, config({**BUSY, "drive": {**BUSY["drive"], **late}}))
    whole = rows(drive, drive.start(), 4000)
    state = drive.start()
    pieces = [rows(drive, state, n) for n in (1, 999, 7, 2993)]
    assert np.array_equal(whole, np.vstack(pieces))


def test_a_copied_state_goes_on_alike_and_alone() -> None:
    drive = drive_of(_simulator_f64, config(BUSY))
    state = drive.start()
    rows(drive, state, 1500)
    copy = state.copy()
    first = rows(drive, state, 2000)
    assert copy.tick == 1500
    assert np.array_equal(first, rows(drive, copy, 2000))


def test_float_stays_close_to_double() -> None:
    # without quantisation, where a rounding error could flip a count
    change = {**BUSY, "drive": {"position_sensor": {"kind": "ideal"}}}
    single, double = (run(change, 1.0, module=m) for m in (_simulator_f32, _simulator_f64))
    assert _simulator_f32.real_bits == 32
    assert _simulator_f64.real_bits == 64
    assert single["omega_m"] == pytest.approx(double["omega_m"], abs=1e-3 * np.ptp(double["omega_m"]))
    assert not np.array_equal(single["i_q_ref"], double["i_q_ref"])


def test_the_speed_loop_runs_at_its_own_rate() -> None:
    x = run({"initial_speed": 0.0}, 0.1)
    changes = np.flatnonzero(np.diff(x["i_q_ref"])) + 1
    assert changes.size > 50
    assert np.all(changes % 10 == 0)


def test_decimation_keeps_every_nth_row() -> None:
    all_rows, some = run(BUSY, 0.2), run(BUSY, 0.2, decimation=7)
    assert np.array_equal(some["omega_m"], all_rows["omega_m"][::7])


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        ({"kind": "constant", "speed": 4.0}, lambda t: np.full_like(t, 4.0)),
        ({"kind": "ramp", "speed": -2.0, "ramp": 30.0}, lambda t: np.maximum(10.0 - 30.0 * t, -2.0)),
        (
            {"kind": "profile", "times": [0.1, 0.3], "speeds": [0.0, 8.0]},
            lambda t: np.interp(t, [0.1, 0.3], [0.0, 8.0]),
        ),
        (
            {"kind": "sine", "offset": 3.0, "amplitude": 2.0, "frequency": 5.0},
            lambda t: 3.0 + 2.0 * np.sin(10.0 * np.pi * t),
        ),
    ],
)
def test_references(reference: dict[str, Any], expected: Any) -> None:
    x = run({"reference": reference}, 0.5)
    assert x["omega_ref"][::10] == pytest.approx(expected(x["time"][::10]), abs=1e-9)


@pytest.mark.parametrize("law", ["pi-ilc", "robust-ilc"])
def test_learning_by_angle_removes_cogging_that_the_feedback_leaves(law: str) -> None:
    gains: dict[str, Any] = {
        "pi-ilc": {"pi": {"kp": 0.3, "ki": 3.0}, "gain": 0.1, "memory": {"limit": [5.0]}},
        "robust-ilc": {
            "b": 0.3 / 5e-4,
            "c": 10.0,
            "eta": 180.0,
            "q": 0.3,
            "beta_2": 200.0,
            "memory": {"limit": [0.3 / 5e-4 * 20.0]},
        },
    }[law]
    memory = {"cells": 256, "parts": 4, "q_half_width": 1, "forgetting": 1.0}
    change: dict[str, Any] = {
        "motor": {"cogging": [{"order": 24, "torque": 0.05, "phase": 0.0}]},
        "reference": {"speed": 3.0},
        "initial_speed": 3.0,
        "drive": {"unguarded": True},
    }
    x = run({**change, "controller": {"law": law, "config": merged({"memory": memory}, gains)}}, 12.0)
    ripple = [np.ptp(x["omega_m"][(x["time"] > t) & (x["time"] < t + 0.5)]) for t in (0.02, 11.4)]
    assert ripple[1] < 0.1 * ripple[0]


def test_anti_cogging_commissioning_finds_the_table() -> None:
    law: dict[str, Any] = {
        "law": "anti-cogging",
        "calibrate": True,
        "config": {
            "pi": {"kp": 0.3, "ki": 6.0},
            "cells": 240,
            "speed": 1.0,
            "revolutions": 1,
            "position_gain": 20.0,
        },
    }
    change = {
        "motor": {"cogging": [{"order": 24, "torque": 0.05, "phase": 0.3}]},
        "mechanics": {"coulomb_friction": 0.02, "breakaway_friction": 0.02},
        "load": {"torque": 0.04},
        "initial_speed": 0.0,
        "controller": law,
    }
    drive = drive_of(_simulator_f64, config(change))
    state = drive.start()
    recorder = _simulator_f64.Recorder(drive, 10)
    drive.advance(state, recorder, 160000)
    status = recorder.take()[:, [name for name, _ in drive.signals].index("status")].astype(int)
    assert status[0] & 8
    assert not status[-1] & 8
    table = np.array(drive.stored(state)["values"][0])
    angle = 2.0 * np.pi * np.arange(240) / 240
    expected = -0.05 / 0.3 * np.sin(24 * angle + 0.3)  # K_t = 1.5 * 4 * 0.05
    assert table == pytest.approx(expected, abs=0.15 * 0.05 / 0.3)
