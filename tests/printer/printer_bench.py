"""Logs of simulated printers in their firmware's formats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from printer.printer_plant import TURN, Axes, accelerations, constant_speed, sampled

from cogless.drives.klipper import log_name, log_text

FILE = """
[printer]
motor = "x"
step_angle = "1.8 deg"
pulley_teeth = 20
current = "0.8 A"
travel = "200 mm"
start_x = "20 mm"
start_y = "100 mm"
holding_torque = "0.59 N*m"
rated_current = "2 A"
"""
TRAVEL, TOP_SPEED = 0.2, 0.2
PROBE = {1: 0.02 * np.exp(0.5j), 2: 0.02 * np.exp(2.5j), 4: 0.02 * np.exp(-1.5j)}
SIGNS = {"forward": 1, "backward": -1}


def ramp_records(axes: Axes, count: int) -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    """Times and accelerations of ramps, both ways, without and with the probe, a column for each axis."""
    acceleration = TOP_SPEED**2 / TRAVEL
    duration = 2 * TOP_SPEED / acceleration
    keys = [(direction, kind) for direction in SIGNS for kind in ("plain", "probe")]
    sign = np.repeat([SIGNS[direction] for direction, _ in keys], count)
    probed = np.repeat([kind == "probe" for _, kind in keys], count)

    def way(t: float) -> np.ndarray:
        t = min(t, duration)
        half = t < duration / 2
        path = 0.5 * acceleration * t**2 if half else TRAVEL - 0.5 * acceleration * (duration - t) ** 2
        return sign * path + 0.0123

    lanes = np.tile(np.arange(count), len(keys))
    correction = {n: c * probed for n, c in PROBE.items()}
    t, values = accelerations(axes.take(lanes), way, correction, duration + 0.2)
    return {key: (t, values[:, k * count : (k + 1) * count]) for k, key in enumerate(keys)}


def write_klipper_logs(
    folder: Path,
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]],
    lane: int,
    rng: np.random.Generator,
    noise: float,
) -> list[Path]:
    """Logs of three runs of each kind; returns their paths. The log begins at some time before the move, with
    the clock at 1000 s; y and z are at rest."""
    paths = []
    for (direction, kind), (t, values) in records.items():
        for number in (1, 2, 3):
            rate = 3200 * rng.uniform(0.99, 1.01)
            times, x = sampled(
                t, values[:, lane], rng, rate, noise, start=-rng.uniform(0.4, 0.7), end=t[-1] + 0.3
            )
            path = folder / f"adxl345-{log_name('x', direction, kind, number)}.csv"
            still = np.zeros(len(x))
            path.write_text(log_text(times + 1000, np.column_stack([x, still, still + 9.80665])))
            paths.append(path)
    return paths


def prusa_lines(
    axes: Axes, lane: int, speeds: Sequence[float], rng: np.random.Generator, noise: float = 0.1
) -> list[str]:
    """What a printer prints: a mark, samples of the cruise from an unknown start, the measured rate."""
    turned = [{}, *({n: c * np.exp(1j * TURN * k / 3) for n, c in PROBE.items()} for k in range(3))]
    keys = [(d, v, c) for v in speeds for c in turned for d in SIGNS]
    lanes = axes.take(np.full(len(keys), lane))
    way = constant_speed(np.array([SIGNS[d] * v for d, v, _ in keys]))
    correction = {n: np.array([c.get(n, 0j) for _, _, c in keys]) for n in PROBE}
    t, values = accelerations(lanes, way, correction, 1.6)
    lines = []
    for k, (direction, speed, run) in enumerate(keys):
        marks = "".join(f" {n}:{abs(c):.6f}:{np.angle(c):.6f}" for n, c in run.items())
        lines.append(f"cogless-run x {direction} {1e3 * speed:.4f} mm/s{marks}")
        rate = 1344 * rng.uniform(0.99, 1.01)
        start = rng.uniform(0.45, 0.5)
        _, x = sampled(t, values[:, k], rng, rate, noise, start=start, end=1.58)
        lines += [f"{j}, {value:.4f}, 0.02, 9.81" for j, value in enumerate(x)]
        lines.append(f"sample freq: {rate * rng.uniform(0.999, 1.001):.2f}")
    return lines
