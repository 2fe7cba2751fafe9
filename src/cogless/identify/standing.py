"""Whether a rotor turns: what a sensor's steps and noise leave of its motion.

Friction of a rotor that stands is anything below its breakaway value, so it tells nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cogless.identify.kernel import white_noise
from cogless.results.trace import Array

CREEP_SHARE = 0.05  # share of a log's median speed
SURE_DEVIATIONS = 3.0  # of the noise, by which the angle of a rotor that stands changes at most
SURE_COUNTS = 2  # of the sensor in a window, from which on a rotor surely turns


def angle_noise(theta: Array, step: float) -> float:
    """Variance of an angle's noise, rad^2: as it is measured, within what steps, rad, explain."""
    measured = white_noise(theta)
    return min(max(measured, step**2 / 24), step**2 / 6) if step else measured


def resolved_angle(step: float, noise: float) -> float:
    """How far two angles of a rotor that stands may differ, rad: by a step, or by noise of this variance."""
    return max(step, SURE_DEVIATIONS * float(np.sqrt(2 * noise)))


def slowest_speed(step: float, window: float) -> float:
    """Speed from which on a rotor surely turns, rad/s: some counts within so many seconds."""
    return SURE_COUNTS * step / window


def creep_speed(speeds: Array) -> float:
    """Speed below which a rotor does not slide as in the rest of a log of these speeds, rad/s."""
    return CREEP_SHARE * float(np.median(np.abs(speeds)))


def standing(theta: Array, dt: float, creep: float, resolved: float, rows_most: int) -> NDArray[np.bool_]:
    """Whether the rotor stands, or turns slower than a creep speed, rad/s, by row.

    `theta`: rad, in rows `dt` apart, s. `resolved`: rad that two angles of a rotor that stands may differ by.
    So it takes the rows in which a creeping rotor moves as far. More than `rows_most` show nothing.
    """
    stands = np.zeros(len(theta), np.bool_)
    if creep * dt * rows_most <= resolved:
        return stands
    rows = max(1, int(np.ceil(resolved / (creep * dt))))
    still = np.abs(theta[rows:] - theta[:-rows]) <= resolved
    for row in range(rows + 1):
        stands[row : len(still) + row] |= still
    return stands
