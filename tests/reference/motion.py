"""Inputs for the tests: a rotor that turns, stops, reverses and jumps, and a law's inputs along its way."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Motion:
    omega_ref: np.ndarray  # rad/s, mechanical
    omega_m: np.ndarray
    theta_m: np.ndarray  # rad, within a revolution
    learn: np.ndarray


def motion(rng: np.random.Generator, steps: int, ts: float, faults: float = 0.0) -> Motion:
    """Segments of constant speed, a fifth of them standing; measured with noise. `faults`: share of inputs
    that are NaN, infinite or absurd, of angles that jump, and of steps at which learning is forbidden."""
    omega = np.zeros(steps)
    start = 0
    while start < steps:
        length = int(rng.integers(20, 400))
        omega[start : start + length] = rng.choice([0.0, *rng.uniform(-40, 40, 2), *rng.uniform(5, 40, 2)])
        start += length
    theta = rng.uniform(0, 6) + np.cumsum(omega) * ts
    theta += np.cumsum(rng.random(steps) < faults) * 2.0  # jumps
    theta = theta % (2 * np.pi)
    measured = omega + np.sin(3 * theta) + rng.normal(0, 0.1, steps)

    def spoilt(x: np.ndarray) -> np.ndarray:
        hit = rng.random(steps) < faults
        return np.where(hit, rng.choice([np.nan, np.inf, -np.inf, 1e30], steps), x)

    learn = rng.random(steps) >= 4 * faults
    return Motion(spoilt(omega), spoilt(measured), spoilt(theta), learn)


def rounded(x: np.ndarray, real: type) -> np.ndarray:
    """x rounded to the library's number type, as doubles."""
    return np.asarray(x).astype(real).astype(float)
