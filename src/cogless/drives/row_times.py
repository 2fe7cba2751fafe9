"""Times of rows that a PC stamped, and two channels of one drive laid over each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.results.trace import Array

BUNCH_ROWS = 10  # rows that may arrive together
RATE_SPREAD = (
    0.01  # share by which the slope over all rows may differ from the period: beyond it, rows are lost
)
CHANNEL_LAG = 2e-3  # s, lag between the stamps of two channels that is possible if the log does not show it


def sent_times(stamps: Array) -> Array:
    """Times at which a drive sent rows, each a whole number of milliseconds after the one before.

    A PC stamps a row when it arrives: late by milliseconds, never early, some rows together. So each row's
    time is bounded by the earliest stamp of this row and all later ones. Rows are lost where that bound
    moves up by whole periods. The drive's clock is the line below all stamps that is nearest to them.
    """
    count = len(stamps)
    if count <= 2 * BUNCH_ROWS:
        return stamps
    rows = np.arange(count)
    apart = float(np.median(stamps[BUNCH_ROWS:] - stamps[:-BUNCH_ROWS])) / BUNCH_ROWS
    period = 1e-3 * max(1, round(1e3 * apart))
    late = stamps - period * rows
    bound = np.minimum.accumulate(late[::-1])[::-1]
    bound[-BUNCH_ROWS:] = bound[-BUNCH_ROWS - 1]  # Too few stamps follow the last rows to tell a loss.
    index = rows + np.round((bound - bound[0]) / period)
    slope, start = _line_below(index, stamps)
    if abs(slope / period - 1) > RATE_SPREAD:
        return stamps
    return np.asarray(start + slope * index)


def _line_below(x: Array, y: Array) -> tuple[float, float]:
    """Slope and start of the line below all points that has the least sum of distances to them."""
    hull: list[int] = []
    for k in range(len(x)):
        while len(hull) > 1:
            i, j = hull[-2:]
            if (y[j] - y[i]) * (x[k] - x[i]) < (y[k] - y[i]) * (x[j] - x[i]):
                break
            hull.pop()
        hull.append(k)
    middle = float(np.mean(x))
    after = next(n for n, k in enumerate(hull) if x[k] >= middle)
    i, j = hull[after - 1], hull[after]
    slope = float((y[j] - y[i]) / (x[j] - x[i]))
    return slope, float(y[i] - slope * x[i])


@dataclass(frozen=True)
class Overlay:
    """How two channels' angles differ: direction * other = angle + offset. `error`: at 95 %, rad."""

    direction: int
    offset: float
    error: float
    spread: float  # rad rms, of single rows


def overlay(t: Array, angle: Array, t_other: Array, other: Array) -> Overlay | None:
    """Lay `other`, an angle within a turn, over `angle`: direction * other = angle + offset.

    None: the angles do not fit. Each has its own stamps. A lag between the channels moves the angle
    in proportion to the speed, so both the offset and the lag are fitted; at one speed they look alike, and
    the lag's usual size is in the error.
    """
    inside = (t_other >= t[0]) & (t_other <= t[-1])
    t_other, other = t_other[inside], other[inside]
    if len(t_other) < BUNCH_ROWS:
        return None
    at_other = np.interp(t_other, t, angle)
    speed = np.interp(t_other, t, np.gradient(angle, t))
    fits = {sign: np.exp(1j * (sign * other - at_other)) for sign in (1, -1)}
    direction = max(fits, key=lambda sign: abs(np.mean(fits[sign])))
    turned = fits[direction]
    middle = np.angle(np.mean(turned))
    apart = np.angle(turned * np.exp(-1j * middle))
    if abs(np.mean(turned)) < 0.5:
        return None
    rough = float(np.median(apart))
    varies = np.std(speed) > 0.2 * np.mean(np.abs(speed))
    columns = np.column_stack([np.ones_like(speed), speed]) if varies else np.ones((len(speed), 1))
    weight = (np.abs(apart - rough) < 5 * np.median(np.abs(apart - rough)) + 1e-6)[:, None]
    fit, *_ = np.linalg.lstsq(weight * columns, weight[:, 0] * apart, rcond=None)
    rest = (apart - columns @ fit)[weight[:, 0]]
    spread = float(np.std(rest))
    # Neighbouring rows share their lag, so BUNCH_ROWS of them count as one.
    covariance = np.linalg.inv(columns.T @ columns) * spread**2 * BUNCH_ROWS
    error = 2 * math.sqrt(covariance[0, 0])
    if not varies:
        error = math.hypot(error, CHANNEL_LAG * float(np.mean(np.abs(speed))))
    offset = float(middle + fit[0])
    return Overlay(direction, math.remainder(offset, math.tau), error, spread)
