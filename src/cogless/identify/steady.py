"""Parts of logs at a steady speed, and the waves of speed and current over the rotor's angle in them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from cogless.identify.files import Array
from cogless.identify.log import Log
from cogless.identify.orders import FALSE_ALARM, HIGHEST

ALIKE = 0.1  # of the speed: what is within it of the median is steady
SMOOTHED = 0.2  # s
FEWEST_TURNS = 1.0
NEIGHBOURS = 41  # orders whose median is the floor of one
VISIBLE = 1 / 6  # of the sampling rate: faster waves are not seen


@dataclass(frozen=True, eq=False)
class Steady:
    """A part of a log that turns in one direction at one speed.

    `rows`: of the log. `theta`: rad. `speed`: mean, signed, rad/s. `load`: mean i_q, A, positive where it
    drives; NaN without current. `ripple`: of the speed as logged, rms, rad/s.
    """

    log: Log
    rows: NDArray[np.intp]
    theta: Array
    omega: Array
    speed: float
    load: float
    ripple: float

    @property
    def current(self) -> float:
        """Mean i_q, A."""
        return math.copysign(1, self.speed) * self.load

    def wave(self, x: Array, orders: Sequence[int]) -> NDArray[np.complex128]:
        """Complex amplitudes X of the orders in a signal of these rows: x = Re(X exp(j order theta))."""
        phases = np.exp(-1j * np.outer(orders, self.theta))
        window = np.hanning(len(x) + 2)[1:-1]
        return np.asarray(2 * (phases @ (window * (x - np.average(x, weights=window)))) / window.sum())

    def visible(self, order: int) -> bool:
        """Whether the log's rows are close enough for this order."""
        return order * abs(self.speed) / (2 * math.pi) < VISIBLE / self.log.dt

    def orders(self) -> list[int]:
        """Orders that stand out of the speed, by their size; none by chance at a rate of 1 %."""
        top = min(HIGHEST, int(VISIBLE / self.log.dt * 2 * math.pi / abs(self.speed)))
        if top < 3:
            return []
        power = np.abs(self.wave(self.omega, range(1, top + 1))) ** 2
        floor = median_filter(power, min(NEIGHBOURS, len(power)), mode="mirror") / math.log(2)
        clear = np.flatnonzero(power > -math.log(FALSE_ALARM / len(power)) * floor)
        peaks = [
            int(k) for k in clear if power[k] == power[max(0, k - 1) : k + 2].max()
        ]  # a window leaks into the neighbours
        return [k + 1 for k in sorted(peaks, key=lambda k: -power[k])]


def with_angle(log: Log) -> Log:
    """The log with an angle: where none was recorded, the integral of the speed, from 0."""
    if "theta" in log or "omega" not in log:
        return log
    return replace(log, signals={**log.signals, "theta": np.cumsum(log["omega"]) * log.dt})


def steady(log: Log) -> Iterator[Steady]:
    """Steady parts of a log, one for each direction and stretch."""
    for stretch in log.stretches:
        theta = log["theta"][stretch]
        if len(theta) < 10:
            continue
        slope = np.gradient(theta, log.dt)
        smooth = uniform_filter1d(slope, max(1, round(SMOOTHED / log.dt)), mode="nearest")
        for sign in (1, -1):
            turning = sign * smooth > 0
            if not turning.any():
                continue
            middle = float(np.median(smooth[turning]))
            rows = _longest(np.abs(smooth - middle) < ALIKE * abs(middle))
            made = _part(log, stretch.start + rows, log.signals.get("omega"))
            if made is not None:
                yield made


def _longest(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Indices of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    if not len(edges):
        return np.zeros(0, dtype=np.intp)
    starts, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - starts))
    return np.arange(starts[best], ends[best])


def _part(log: Log, rows: NDArray[np.intp], omega: Array | None) -> Steady | None:
    if len(rows) < 20:
        return None
    theta = log["theta"][rows]
    turned = theta[-1] - theta[0]
    if abs(turned) < 2 * math.pi * FEWEST_TURNS:
        return None
    speed = turned / (log.dt * (len(rows) - 1))
    seen = omega[rows] if omega is not None else np.gradient(theta, log.dt)
    load = math.copysign(1, speed) * float(np.mean(log["i_q"][rows])) if "i_q" in log else math.nan
    return Steady(log, rows, theta, seen, speed, load, float(np.std(seen)))
