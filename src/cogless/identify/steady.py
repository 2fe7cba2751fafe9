"""Find parts of logs at a steady speed, and the waves of speed and current over the rotor's angle there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from cogless.identify.kernel import shifted
from cogless.identify.log import Log
from cogless.identify.waves import Waves, standing_waves, waves_of_signal
from cogless.results.trace import Array
from cogless.units import TURN

SPEED_DEVIATION = 0.1  # relative deviation of a steady speed, at most
SMOOTHING_TIME = 0.2  # s
TURNS_LEAST = 1.0
OVERLAP_LEAST = 0.5  # least turns that the rotor passes twice at the same speed
REVERSAL_ANGLE = np.pi / 2  # rad: a rotor that turns back by more reverses
ROWS_LEAST = 20


@dataclass(frozen=True, eq=False)
class Steady:
    """A part of a log that turns in one direction at one speed.

    `rows`: indices in the log. `theta`: angle without the sensor's known error, rad. `error`: this error E by
    order n, rad: the sensor shows Re(E exp(j n theta)) more than the rotor's angle. `speed`: mean, signed,
    rad/s. `load`: mean i_q, A, positive where it drives; NaN without current. `step`: step of the measured
    angle, rad. `own_orders`: orders of the motor; some may be too high for the rows to show.
    """

    log: Log
    rows: NDArray[np.intp]
    theta: Array
    speed: float
    load: float
    step: float = 0.0
    own_orders: tuple[int, ...] = ()
    error: Mapping[int, complex] = field(default_factory=dict)

    @property
    def current(self) -> float:
        """Mean i_q, A."""
        return math.copysign(1, self.speed) * self.load

    @cached_property
    def waves(self) -> Waves:
        """Waves of the rotor's motion, by the corrected angle."""
        measured = self.theta + sum(
            (wave * np.exp(1j * n * self.theta)).real for n, wave in self.error.items()
        )
        return standing_waves(self.theta, self.log.dt, self.step, self.own_orders, measured)

    @property
    def orders(self) -> tuple[int, ...]:
        """Orders that are in the motion or in the sensor's error."""
        return (*self.waves.orders, *(n for n in self.error if n not in self.waves.amplitude))

    def motion(self, order: int) -> complex:
        """Complex wave of an order in the rotor's speed, rad/s; 0 for an order that doesn't stand out."""
        return self.waves.of_speed(order) if order in self.waves.amplitude else 0j

    def misread(self, order: int) -> complex:
        """Complex wave that the sensor's error adds to the measured speed, rad/s. It is no motion."""
        return 1j * order * self.speed * self.error.get(order, 0j)

    @property
    def ripple(self) -> float:
        """Ripple of motion and sensor's error together, rms, rad/s."""
        return math.hypot(self.waves.ripple, *(abs(self.misread(n)) / math.sqrt(2) for n in self.error))

    @property
    def rows_a_turn(self) -> float:
        return TURN / (abs(self.speed) * self.log.dt)

    @property
    def turns(self) -> float:
        return float(abs(self.theta[-1] - self.theta[0])) / TURN

    @property
    def logged_ripple(self) -> float:
        """Ripple of the logged speed, rms, rad/s; NaN if no speed is logged."""
        return float(np.std(self.log["omega"][self.rows])) if "omega" in self.log else math.nan

    def current_wave(self, order: int, late: float) -> complex:
        """Complex wave of an order in i_q, A, with i_q shifted by `late` rows."""
        if late not in self._currents:
            current = shifted(self.log["i_q"], late)[self.rows]
            self._currents[late] = waves_of_signal(current, self.theta, self.orders)
        return self._currents[late][order]

    @cached_property
    def _currents(self) -> dict[float, dict[int, complex]]:
        return {}

    def visible(self, order: int) -> bool:
        """Whether the log has more than two rows for each wave of this order."""
        return order < self.waves.half_rate


def with_angle(log: Log) -> Log:
    """The log with an angle: where none was recorded, the integral of the speed, from 0."""
    if "theta" in log or "omega" not in log:
        return log
    return replace(log, signals={**log.signals, "theta": np.cumsum(log["omega"]) * log.dt})


def steady(
    log: Log,
    step: float = 0.0,
    own_orders: Sequence[int] = (),
    error: Mapping[int, complex] = MappingProxyType({}),
) -> Iterator[Steady]:
    """Steady parts of a log, one for each direction and stretch.

    `step`: step of the measured angle, rad. `error`: the sensor's error; the log's angle is already corrected
    for it. Sensor error and cogging change the speed within a turn. So a speed also counts as steady if the
    rotor passes each angle a turn later at the same speed.
    """
    for stretch in log.stretches:
        theta = log["theta"][stretch]
        if len(theta) < ROWS_LEAST:
            continue
        smooth = uniform_filter1d(
            np.gradient(theta, log.dt), max(1, round(SMOOTHING_TIME / log.dt)), mode="nearest"
        )
        for sign in (1, -1):
            runs = [_slow_changes(smooth, sign)]
            runs += [
                way.start + _alike_a_turn_later(sign * theta[way], sign * smooth[way])
                for way in _one_way(theta)
                if sign * (theta[way.stop - 1] - theta[way.start]) > 0
            ]
            rows = max(runs, key=len)
            part = _part(log, stretch.start + rows)
            if part is not None:
                yield replace(part, step=step, own_orders=tuple(own_orders), error=error)


def _slow_changes(smooth: Array, sign: int) -> NDArray[np.intp]:
    """The longest run of rows whose smoothed speed is near the median of this direction."""
    turning = sign * smooth > 0
    if not turning.any():
        return np.zeros(0, dtype=np.intp)
    middle = float(np.median(smooth[turning]))
    return _longest(np.abs(smooth - middle) < SPEED_DEVIATION * abs(middle))


def _one_way(theta: Array) -> Iterator[slice]:
    """Slices of rows between reversals of the rotor."""
    begin, sign = 0, 1 if theta[-1] >= theta[0] else -1
    while begin < len(theta) - 1:
        angle = sign * theta[begin:]
        back = np.flatnonzero(np.maximum.accumulate(angle) - angle > REVERSAL_ANGLE)
        end = begin + (int(np.argmax(angle[: back[0]])) if len(back) else len(angle) - 1)
        if end > begin:
            yield slice(begin, end + 1)
        elif not len(back):
            return
        begin, sign = end, -sign


def _alike_a_turn_later(angle: Array, smooth: Array) -> NDArray[np.intp]:
    """The longest run of rows in which the speed at each angle equals the speed a turn before or later.

    `angle` grows; `smooth` is its smoothed speed.
    """
    rising = np.maximum.accumulate(angle)
    pairs = int(np.searchsorted(rising, rising[-1] - TURN, "right"))
    if pairs < 2:
        return np.zeros(0, dtype=np.intp)
    later = np.searchsorted(rising, rising[:pairs] + TURN).clip(max=len(angle) - 1)
    way = np.concatenate(([0.0], np.cumsum(smooth)))
    mean = (way[later] - way[:pairs]) / np.maximum(later - np.arange(pairs), 1)  # over the turn
    run = _longest(np.abs(smooth[later] - smooth[:pairs]) < SPEED_DEVIATION * np.abs(mean))
    if len(run) < 2 or rising[run[-1]] - rising[run[0]] < TURN * OVERLAP_LEAST:
        return np.zeros(0, dtype=np.intp)
    return np.arange(run[0], later[run[-1]] + 1)


def _longest(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Indices of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    if not len(edges):
        return np.zeros(0, dtype=np.intp)
    starts, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - starts))
    return np.arange(starts[best], ends[best])


def _part(log: Log, rows: NDArray[np.intp]) -> Steady | None:
    if len(rows) < ROWS_LEAST:
        return None
    theta = log["theta"][rows]
    turned = theta[-1] - theta[0]
    if abs(turned) < TURN * TURNS_LEAST:
        return None
    speed = turned / (log.dt * (len(rows) - 1))
    load = math.copysign(1, speed) * float(np.mean(log["i_q"][rows])) if "i_q" in log else math.nan
    return Steady(log, rows, theta, speed, load)
