"""A motor under a drive's own law, in plain floats, apart from the project's engine. Units are SI.

The rotor's angle is `phi`. Cogging, friction and inertia are the truth that an identification has to find.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

TURN = 2 * math.pi
RATE = 5000  # Hz of the law; the rotor is integrated twice as fast
LAG_SHARE = math.exp(-0.5 / RATE * TURN * 1000)  # share of a current's error after half a step, at 1 kHz

Law = Callable[[float, float, float], float]  # time, angle and speed of the rotor: current, A


@dataclass(frozen=True)
class Plant:
    """A gimbal motor: 14 poles, 12 slots."""

    K_t: float = 0.0306  # N m/A
    inertia: float = 2e-5  # kg m^2
    coulomb: float = 3e-3  # N m
    viscous: float = 2e-5  # N m s/rad
    cogging: tuple[tuple[int, float, float], ...] = ((12, 5e-3, 0.4), (84, 4e-3, 1.1), (24, 1.5e-3, -2.0))

    def torque(self, phi: float) -> float:
        return sum(size * math.sin(n * phi + phase) for n, size, phase in self.cogging)

    def holding(self, phi: np.ndarray) -> np.ndarray:
        """The current that holds the rotor at these angles, A."""
        return -sum(size / self.K_t * np.sin(n * phi + phase) for n, size, phase in self.cogging)


class Rotor:
    """The motor's state, in steps of the law."""

    def __init__(self, plant: Plant, phi: float = 0.7, speed: float = 0.0) -> None:
        self.plant, self.phi, self.omega, self.current = plant, phi, speed, 0.0

    def step(self, reference: float) -> None:
        """Advance the motor by a step of the law with this current reference, A."""
        h, plant = 0.5 / RATE, self.plant
        phi, omega, current = self.phi, self.omega, self.current
        for _ in range(2):
            current = reference + (current - reference) * LAG_SHARE
            middle = phi + 0.5 * h * omega
            friction = plant.coulomb * math.tanh(omega / 0.02) + plant.viscous * omega
            omega += h * (plant.K_t * current + plant.torque(middle) - friction) / plant.inertia
            phi = middle + 0.5 * h * omega
        self.phi, self.omega, self.current = phi, omega, current


def play(plant: Plant, law: Law, duration: float, speed: float = 0.0) -> dict[str, np.ndarray]:
    """Time, rotor angle, speed and current at each step of the law."""
    steps, rotor = round(duration * RATE), Rotor(plant, speed=speed)
    log = np.empty((steps, 4))
    for k in range(steps):
        log[k] = k / RATE, rotor.phi, rotor.omega, rotor.current
        rotor.step(law(k / RATE, rotor.phi, rotor.omega))
    return dict(zip(("t", "phi", "omega", "i"), log.T, strict=True))


def profile(points: Sequence[tuple[float, float]]) -> Callable[[float], tuple[float, float]]:
    """A function of time that returns reference angle and speed, rad and rad/s. `points`: times, s, and
    speeds, with straight lines between them."""
    t, v = np.array(points).T
    times = np.arange(round(t[-1] * RATE) + 1) / RATE
    speeds = np.interp(times, t, v)
    angles = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 / RATE)])
    pairs = list(zip(angles.tolist(), speeds.tolist(), strict=True))
    return lambda now: pairs[min(round(now * RATE), len(pairs) - 1)]


def both_ways(turns_per_second: float, time: float) -> list[tuple[float, float]]:
    v = TURN * turns_per_second
    return [(0, v), (time, v), (time + 0.4, -v), (2 * time + 0.4, -v)]


RUNS = {
    "slow": both_ways(0.5, 4.2),
    "fast": both_ways(2.0, 3.0),
    "accel": [(0, 3), (0.5, 40), (1.5, -40), (2.5, 40), (3.5, -40), (4.5, 40), (5, 3)],
}


def ripple(run: dict[str, np.ndarray]) -> float:
    """Speed ripple of the last two thirds of a run, rad/s rms."""
    omega = run["omega"][len(run["omega"]) // 3 :]
    return float(np.std(omega))


class Tracker:
    """A tracking observer of an encoder, as drives have one: its angle and speed are smooth."""

    def __init__(self, counts: int, bandwidth: float) -> None:
        self.counts, self.bandwidth = counts, TURN * bandwidth
        self.angle: float | None = None
        self.speed = 0.0

    def step(self, angle: float, speed: float) -> tuple[float, float]:
        seen = math.floor(angle / TURN * self.counts) / self.counts * TURN
        if self.angle is None:
            self.angle, self.speed = seen, speed
        self.angle += self.speed / RATE
        error = seen - self.angle
        self.angle += 2 * self.bandwidth / RATE * error
        self.speed += self.bandwidth**2 / RATE * error
        return self.angle, self.speed
