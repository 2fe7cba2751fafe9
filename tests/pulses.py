"""A switched inverter that plays duty cycles at a constant speed, with many rows in each of its periods."""

from __future__ import annotations

from typing import Any

import numpy as np
from engine import Signals, config, drive_of
from numpy.typing import NDArray

from cogless import _simulator_f64
from cogless.c_layout import control_layout

PWM = ("centre", "edge", "two-updates")
BUS = 100.0
RATE = 10_000  # Hz, of the current loop
POLE_PAIRS = 4

Reals = NDArray[np.float64]


class Played:
    """A controller that plays the duty cycles of an electrical turn over and over."""

    def __init__(self, duties: Reals) -> None:
        self.tick, self.duties, self.layout = 0, duties, control_layout("double")

    def step(self, _measurement: bytes, _reference: bytes) -> bytes:
        duty = self.duties[self.tick % len(self.duties)].tolist()
        self.tick += 1
        zeros = self.layout.decode("cgl_drive_output", bytes(self.layout.size("cgl_drive_output")))
        return self.layout.pack("cgl_drive_output", {**zeros, "duty": duty})


def sinusoidal(ticks: int, depth: float, shift: float = 0.0) -> Reals:
    """Duty cycles of a sinusoid that is sampled in each tick of a turn, or `shift` ticks later."""
    angle = 2 * np.pi * ((np.arange(ticks)[:, None] + shift) / ticks - np.arange(3) / 3)
    return np.asarray(0.5 + 0.5 * depth * np.cos(angle))


def last_turn(
    duties: Reals, motor: dict[str, float], inverter: dict[str, Any], rows: int, turns: int
) -> Signals:
    """Signals of the last of `turns` electrical turns, `rows` in each period. Duty cycles act at once."""
    ticks = len(duties)
    speed = electrical_speed(ticks) / POLE_PAIRS
    change: dict[str, Any] = {
        "motor": motor,
        "mechanics": {"inertia": 1e9},
        "initial_speed": speed,
        "reference": {"speed": speed},
        "rows_per_period": rows,
        "drive": {
            "integration_steps": 4,
            "inverter": {"kind": "switched", "bus_voltage": BUS, "computation_delay": 0, **inverter},
        },
    }
    drive, played = drive_of(_simulator_f64, config(change)), Played(duties)
    state = drive.start()
    for _ in range(turns):
        recorder = _simulator_f64.Recorder(drive, 1, ticks * rows)
        drive.advance(state, recorder, ticks, played)
    last = recorder.take()
    return {name: last[:, n] for n, (name, _) in enumerate(drive.signals)}


def electrical_speed(ticks: int) -> float:
    """The electrical speed with a turn in so many ticks, rad/s."""
    return 2 * np.pi * RATE / ticks


def vector(a: Reals, b: Reals, c: Reals) -> NDArray[np.complex128]:
    turn = np.exp(2j * np.pi / 3)
    return np.asarray(2 / 3 * (a + turn * b + turn**2 * c))


def spectrum(x: NDArray[Any]) -> NDArray[np.complex128]:
    return np.asarray(np.fft.fft(x) / len(x))
