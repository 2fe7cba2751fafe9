"""Whether a rotor turns: what a sensor's steps and noise leave of its motion.

Friction of a rotor that stands is anything below its breakaway value, so it tells nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cogless.identify.kernel import REACH_WIDTHS, white_noise
from cogless.results.trace import Array

CREEP_SHARE = 0.05  # share of a log's median speed
SURE_DEVIATIONS = 3.0  # of the noise, by which the angle of a rotor that stands changes at most
HALF_HEIGHT_WIDTHS = float(np.sqrt(8 * np.log(2)))  # of a Gaussian: between the places of half its height
SLIPS_LEAST = 3  # motions in one direction after which a rotor sticks
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


def standing(theta: Array, dt: float, creep: float, resolved: float, width: float) -> NDArray[np.bool_]:
    """Whether the rotor stands between slips, by row, as a kernel of a width, s, resolves it.

    `theta`: rad, in rows `dt` apart, s. It stands, or turns slower than `creep`, rad/s, where it moves by no
    more than `resolved`, rad, in the rows in which a creeping rotor moves as far, and in at least the rows
    within which the kernel is above half its height. A rotor that stands only where it starts or turns back
    does not stick: there friction changes its sign, which shows without this.
    """
    stands, seen = np.zeros(len(theta), np.bool_), np.zeros(len(theta), np.bool_)
    rows = max(1, int(np.ceil(resolved / max(creep * dt, 1e-300))))
    if rows * dt > REACH_WIDTHS * width:
        return stands
    still = np.abs(theta[rows:] - theta[:-rows]) <= resolved
    for row in range(rows + 1):
        seen[row : len(still) + row] |= still
    slips = 0
    edges = np.flatnonzero(np.diff(seen.astype(np.int8), prepend=0, append=0))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if (end - begin) * dt < HALF_HEIGHT_WIDTHS * width:
            continue
        stands[begin:end] = True
        if begin and end < len(theta):
            before, after = theta[begin - 1 + rows] - theta[begin - 1], theta[end] - theta[end - rows]
            slips += int(before * after > 0)
    return stands if slips >= SLIPS_LEAST else np.zeros_like(stands)
