"""A load behind a soft shaft, as the design sees it: linear, and from the motor's side."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.design.margins import Real
from cogless.study import Study

LEAST_DAMPING = 1e-6  # damping ratio that a soft shaft has at least in the design
AROUND = np.geomspace(0.01, 1e3, 300)  # distances from a resonance, in its width


@dataclass(frozen=True)
class SoftShaft:
    """A soft shaft between motor and load, seen from the motor; a gap in it counts as closed."""

    inertia: float  # kg*m^2, of the motor's side
    load_inertia: float  # kg*m^2
    stiffness: float  # N*m/rad
    damping: float  # N*m*s/rad
    on_load: bool = False  # the position sensor is on the load's side

    @property
    def antiresonance(self) -> float:
        """Undamped frequency at which the load holds the motor, rad/s."""
        return math.sqrt(self.stiffness / self.load_inertia)

    @property
    def resonance(self) -> float:
        """Undamped frequency of both masses, rad/s."""
        return math.sqrt(self.stiffness * (1 / self.inertia + 1 / self.load_inertia))

    @property
    def damping_in_design(self) -> float:
        """The damping, N m s/rad, but at least so much that no pole is on the unit circle."""
        parallel = 1 / (1 / self.inertia + 1 / self.load_inertia)
        return max(self.damping, 2 * LEAST_DAMPING * math.sqrt(self.stiffness * parallel))

    def near(self, period: float) -> Real:
        """Frequencies around resonance and antiresonance, rad/s, below half the sampling rate."""
        found = []
        for w, inertia in (
            (self.antiresonance, self.load_inertia),
            (self.resonance, 1 / (1 / self.inertia + 1 / self.load_inertia)),
        ):
            width = self.damping_in_design / (2 * inertia)
            folded = abs((w + math.pi / period) % (2 * math.pi / period) - math.pi / period)
            found.append(folded + width * np.concatenate([-AROUND, [0.0], AROUND]))
        return np.concatenate(found)

    def rates(self, b: float) -> Real:
        """Rates of change of i, omega, theta, load's speed and angle, from these and the voltage.

        `b`: acceleration per current of both masses together, rad/s^2/A.
        """
        d, k = self.damping_in_design, self.stiffness
        torque = np.array([0, -d, -k, d, k, 0.0])
        found = np.zeros((6, 6))
        found[1], found[3] = torque / self.inertia, -torque / self.load_inertia
        found[1, 0] = b * (self.inertia + self.load_inertia) / self.inertia
        found[2, 1] = found[4, 3] = 1.0
        return found


def soft_shaft(study: Study) -> SoftShaft | None:
    """The shaft to a study's load side, with the load seen from the motor; None if there is none."""
    side, inertia = study.mechanics.load_side, study.mechanics.inertia
    if side is None:
        return None
    seen = 1 / side.ratio**2
    on_load = study.drive.position_sensor.side == "load"
    return SoftShaft(inertia, side.inertia * seen, side.stiffness * seen, side.damping * seen, on_load)
