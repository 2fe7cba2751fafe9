"""Microstepping of a step motor: the coils' currents at a commanded angle with its correction, on a grid."""

import dataclasses
import math

import numpy as np

Waves = list[tuple[int, float, float]]  # order, magnitude and phase, rad


@dataclasses.dataclass
class Microstepping:
    teeth: int
    current: float
    microsteps: int
    forward: Waves
    backward: Waves
    command: float = 0.0  # rad, electrical
    is_backward: bool = False

    def step(self, theta_ref: float, omega_ref: float) -> np.ndarray:
        """Currents of the coils a and b, A; the command is not yet on the grid of microsteps."""
        if omega_ref:
            self.is_backward = omega_ref < 0
        u = self.teeth * theta_ref
        waves = self.backward if self.is_backward else self.forward
        self.command = u + sum(m * math.sin(n * u + p) for n, m, p in waves)
        grid = math.tau / (4 * self.microsteps)
        on_grid = grid * math.floor(self.command / grid + 0.5)
        return self.current * np.array([math.cos(on_grid), math.sin(on_grid)])
