"""What a run records: the carriage's acceleration over time, and the correction that was in the driver.

A correction adds phi(u) = sum Im(c[n] exp(j n u)) to the electrical angle u of the command.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError

Numbers = NDArray[np.float64]
ComplexNumbers = NDArray[np.complex128]
Orders = Mapping[int, complex]
Direction = Literal["forward", "backward"]
DIRECTIONS: tuple[Direction, Direction] = ("forward", "backward")

FITTED_ORDERS = (1, 2, 3, 4, 5, 6, 8)
CORRECTED_ORDERS = (1, 2, 4)
PROBE_SIZE = 0.02  # rad
PROBE_PHASES = {1: 0.5, 2: 2.5, 4: -1.5}  # rad
SATURATED_LEAST = 18.0  # m/s^2; the smallest range of an accelerometer is 2 g; a tenth less
CONDITION_LEAST = 1e-9  # smallest square of a singular value / the largest
ANGLE_POINTS = 256  # points in an electrical turn
SATURATED_RUN = 3  # samples in a row at the largest value


@dataclass(frozen=True, eq=False)
class Run:
    """A run: times, s, the acceleration along the carriage's way, m/s^2, and the correction in the driver."""

    name: str
    direction: Direction
    times: Numbers
    acceleration: Numbers
    correction: Orders

    @property
    def sign(self) -> int:
        """Sign of the electrical angle's speed: 1 forward, -1 backward."""
        return 1 if self.direction == "forward" else -1

    @property
    def rate(self) -> float:
        """Samples a second."""
        return (len(self.times) - 1) / float(self.times[-1] - self.times[0])


def probe(orders: tuple[int, ...] = CORRECTED_ORDERS) -> dict[int, complex]:
    """The correction that is added to learn how the carriage answers; all orders at once."""
    return {n: complex(PROBE_SIZE * np.exp(1j * PROBE_PHASES[n])) for n in orders}


def phase_shift(orders: Orders, u: NDArray[Any]) -> NDArray[Any]:
    """sum Im(c exp(j n u)) at these angles, rad."""
    return np.asarray(sum((np.imag(c * np.exp(1j * n * u)) for n, c in orders.items()), np.zeros(len(u))))


def shifted_orders(psi: Orders, correction: Orders) -> dict[int, complex]:
    """What a correction adds to each order of the rotor's angle, for a motor with the errors psi.

    The errors are those at the driver's angle u + phi, so the rotor is at u + phi(u) + psi(u + phi(u)).
    """
    u = math.tau / ANGLE_POINTS * np.arange(ANGLE_POINTS)
    phi = phase_shift(correction, u)
    spectrum = np.fft.fft(phi + phase_shift(psi, u + phi) - phase_shift(psi, u)) * 2j / ANGLE_POINTS
    return {n: complex(spectrum[n]) for n in correction}


def coupling(psi: Orders, correction: Orders) -> dict[int, float]:
    """By order, rad: the largest error that products of two orders may cause.

    psi of order m is at the rotor's angle, which swings by order k. This gives m psi[m] swing[k] / 2 at the
    orders m +- k. At a resonance the swing is not the commanded one, so the whole product counts as an error.
    """
    swing = {k: abs(psi[k]) + abs(correction.get(k, 0j)) for k in psi}
    sums = {n: 0.0 for n in psi}
    for m in psi:
        for k in psi:
            for n in {m + k, abs(m - k)} & sums.keys():
                sums[n] += 0.5 * m * abs(psi[m]) * swing[k]
    return sums


def check_saturation(name: str, acceleration: Numbers) -> None:
    """StudyError: an accelerometer's value stays at the end of its range."""
    for end in (float(np.max(acceleration)), float(np.min(acceleration))):
        if abs(end) < SATURATED_LEAST:
            continue
        stays = np.convolve(acceleration == end, np.ones(SATURATED_RUN), "valid")
        if np.any(stays == SATURATED_RUN):
            raise StudyError(
                f"{name}: the acceleration stays at {end:.4g} m/s^2, the end of its range: expected a larger "
                "range of the accelerometer, or a lower speed"
            )


@dataclass(frozen=True, eq=False)
class LinesFit:
    """Coefficients A by order, m/s^2, variances of their real or imaginary parts, and what the fit leaves."""

    values: ComplexNumbers
    variances: Numbers
    rest: Numbers


def lines_fit(acceleration: Numbers, turns: Numbers, orders: tuple[int, ...], ringing: Numbers) -> LinesFit:
    """Fit sum Im(A exp(j n u)) by least squares. `turns`: u in turns. A straight line
    and the columns of `ringing` are fitted together with the orders.
    """
    u = math.tau * turns
    count = len(u)
    columns = [np.ones(count), np.linspace(-1.0, 1.0, count)]
    for n in orders:
        columns += [np.sin(n * u), np.cos(n * u)]
    matrix = np.column_stack([*columns, ringing])
    inverse = np.linalg.pinv(matrix.T @ matrix, rcond=CONDITION_LEAST, hermitian=True)
    solution = inverse @ (matrix.T @ acceleration)
    rest = acceleration - matrix @ solution
    variance = float(rest @ rest) / max(count - matrix.shape[1], 1)
    spreads = np.diag(inverse)[2 : 2 + 2 * len(orders)] * variance
    pairs = solution[2 : 2 + 2 * len(orders)]
    return LinesFit(pairs[::2] + 1j * pairs[1::2], 0.5 * (spreads[::2] + spreads[1::2]), rest)
