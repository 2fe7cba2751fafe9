"""Waves of a rotor's motion over its angle, by joint least squares, and the orders that can be seen.

The speed is the angle's difference between two rows. A wave of order n of the angle appears in the speed as
the difference of exp(j n theta) between both rows. So nothing is lost between the rows. The steps of the
angle leave noise in the speed, which counts as measurement. Its spectrum follows from the fitted motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, median_filter
from scipy.signal import welch
from scipy.signal.windows import tukey
from scipy.stats import chi2
from scipy.stats import f as fisher
from scipy.stats import t as student

from cogless.identify.cogging_orders import FALSE_ALARM
from cogless.results.trace import Array
from cogless.units import TURN

MOTION_ORDER_HIGHEST = 1000  # highest order that is looked for
WAVES_MOST = 60  # orders of one part
ANGLE_CELLS = 8192  # cells of a turn in which the residual is summed, eight for each wave of order 1000
# most new orders of a round, and their least power over the strongest order's, which leaks less than this
NEW_MOST, NEW_SHARE = 4, 0.25
FLOOR_ORDERS = 41  # neighbouring orders whose median is the floor of one
NEAR_ORDERS = 5  # orders over which a power by the angle's steps counts, since its order is not exact
STEPS_RATIO = 4.0  # least power of an order over the power that the angle's steps have there
STEP_WAVES, SAWTOOTH_MARGIN = 10, 1.2  # waves of a sawtooth, and a margin on their size for noise
MOTION_BLOCKS = 24  # parts of the rows, each left out for the errors
RIDGE_SHARE = 1e-9  # share of the diagonal of scaled normal equations that is added to it
TAPER_SHARE = 0.25  # share of the rows, at both ends, that count less: a log may begin with a transient
SLOW_SHARE, SLOW_MOST = 0.8, 20  # columns of slow changes of the speed: count for each turn, largest count
PIECE_ROWS = 1 << 15  # rows whose waves are in memory together
SMOOTH_ROWS = (5, 20)  # widths of filters that show the motion between the steps of the angle
SEGMENT_ROWS, SEGMENTS_LEAST = 1024, 4  # most rows of a spectrum's segments, and least count of segments
SEEN_SHARE = 0.01  # share of the ripple's square at which an order should be seen; else it is hidden


@dataclass(frozen=True, eq=False)
class Waves:
    """Waves of a motion at a steady speed, by order n.

    `amplitude`: A of the angle, rad, theta = ... + Re(A exp(j n theta)). `error`: of A, at 95 %, rad.
    `vibration`: motion of no order, without the steps and noise of the angle, rms, rad/s. `half_rate`: the
    order at half the rate of the rows. `hidden`: orders below `half_rate` at which a wave with a hundredth of
    the ripple's square would not stand out.
    """

    speed: float  # rad/s
    amplitude: dict[int, complex]
    error: dict[int, float]
    vibration: float
    half_rate: float
    hidden: frozenset[int]

    @property
    def orders(self) -> tuple[int, ...]:
        """Orders that stand out, the largest wave of the speed first."""
        return tuple(sorted(self.amplitude, key=lambda n: -abs(self.of_speed(n))))

    def of_speed(self, order: int) -> complex:
        """Complex wave of an order in the speed, rad/s."""
        return 1j * order * self.speed * self.amplitude[order]

    @property
    def ripple(self) -> float:
        """Ripple of the motion, with vibration and without noise of the angle, rms, rad/s."""
        waves = sum(abs(self.of_speed(n)) ** 2 / 2 for n in self.amplitude)
        return math.sqrt(waves + self.vibration**2)


def folded(order: float, rows: float) -> float:
    """The order that a log with `rows` rows a turn shows in place of an order; at most rows / 2."""
    return abs(order - rows * round(order / rows))


def slow_columns(count: int, turns: float) -> Array:
    """Columns for changes of the speed over more than a turn."""
    x = (np.arange(count) + 0.5) / count
    most = min(SLOW_MOST, int(SLOW_SHARE * abs(turns)))
    return np.cos(np.pi * np.outer(x, np.arange(most + 1)))


def waves_of_signal(x: Array, theta: Array, orders: Sequence[int]) -> dict[int, complex]:
    """Complex waves X of these orders in a signal, x = Re(X exp(j n theta)), fitted with slow changes."""
    slow = slow_columns(len(x), (theta[-1] - theta[0]) / TURN)
    size = 2 * len(orders) + slow.shape[1]
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    for first in range(0, len(x), PIECE_ROWS):
        rows = slice(first, first + PIECE_ROWS)
        phases = np.exp(1j * np.outer(theta[rows], orders))
        columns = np.hstack([phases.real, -phases.imag, slow[rows]])
        matrix += columns.T @ columns
        vector += columns.T @ x[rows]
    values = _solved(matrix, vector)
    return {n: complex(values[k], values[len(orders) + k]) for k, n in enumerate(orders)}


class _Motion:
    """The speed between rows, and the normal equations of its waves for each block of rows."""

    def __init__(self, theta: Array, dt: float, measured: Array) -> None:
        self.theta, self.dt, self.measured = theta, dt, measured
        self.y = np.diff(theta) / dt
        self.weight = tukey(len(self.y), TAPER_SHARE)
        self.middle = 0.5 * (theta[1:] + theta[:-1])
        self.slow = slow_columns(len(self.y), (theta[-1] - theta[0]) / TURN)
        rows = len(self.y)
        blocks = max(MOTION_BLOCKS, rows // PIECE_ROWS) if rows >= 5 * MOTION_BLOCKS else rows // 5
        edges = np.linspace(0, rows, blocks + 1).astype(int)
        self.blocks = [slice(int(a), int(b)) for a, b in pairwise(edges)]

    def columns(self, rows: slice, orders: Sequence[int]) -> Array:
        waves = np.exp(1j * np.outer(self.theta[rows.start : rows.stop + 1], orders))
        between = np.diff(waves, axis=0) / self.dt
        return np.hstack([between.real, -between.imag, self.slow[rows]])

    def equations(self, orders: Sequence[int]) -> tuple[Array, Array]:
        """Normal matrices and vectors of these orders, one for each block."""
        matrices, vectors = [], []
        for rows in self.blocks:
            columns = self.columns(rows, orders)
            weighed = columns.T * self.weight[rows]
            matrices.append(weighed @ columns)
            vectors.append(weighed @ self.y[rows])
        return np.array(matrices), np.array(vectors)

    def residual(self, orders: Sequence[int], values: Array) -> Array:
        return np.concatenate([self.y[rows] - self.columns(rows, orders) @ values for rows in self.blocks])

    def power(self, x: Array, orders: NDArray[np.intp]) -> Array:
        """Power of each order n in x: |sum of weight x exp(-j n theta)|^2."""
        cell = (np.floor(self.middle / TURN * ANGLE_CELLS) % ANGLE_CELLS).astype(int)
        wave = np.fft.fft(np.bincount(cell, self.weight * x, ANGLE_CELLS))
        return np.asarray(np.abs(wave[orders]) ** 2)


def _solved(matrix: Array, vector: Array) -> Array:
    """Solutions of normal equations, one or a stack of them. A ridge keeps undetermined values small."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))
    scaled = matrix / (scale[..., :, None] * scale[..., None, :]) + RIDGE_SHARE * np.eye(matrix.shape[-1])
    return np.asarray(np.linalg.solve(scaled, (vector / scale)[..., None])[..., 0] / scale)


def standing_waves(
    theta: Array, dt: float, step: float, own: Sequence[int] = (), measured: Array | None = None
) -> Waves:
    """The waves that stand out of an angle's motion, at a false-alarm rate of 1 % for the whole search.

    `measured`: the measured angle, which is `theta` with the sensor's error. `step`: of the measured angle,
    rad. `own`: orders of the motor. The search includes such an order above half the rows' rate,
    unless the rows confuse the order with another one.
    """
    turns = abs(theta[-1] - theta[0]) / TURN
    speed = (theta[-1] - theta[0]) / (dt * (len(theta) - 1))
    a_turn = TURN / (abs(speed) * dt)  # rows
    top = int(min(MOTION_ORDER_HIGHEST, math.ceil(a_turn / 2) - 1))
    beyond = list(_apart_when_folded([n for n in own if top < n], a_turn, turns))
    candidates = np.array([*range(1, top + 1), *beyond], dtype=np.intp)
    if top < 3:
        still = float(np.std(np.diff(theta) / dt))
        return Waves(speed, {}, {}, vibration=still, half_rate=a_turn / 2, hidden=frozenset())
    motion = _Motion(theta, dt, theta if measured is None else measured)
    search = _Search(motion, candidates, top, step)
    orders = search.significant(search.grown([]))[0]
    sure = [n for n, wave in search.significant(orders)[1].items() if abs(wave) > step / np.pi]
    if len(sure) < len(orders):  # Orders as small as a step are sought again, now that larger ones are known.
        orders = search.grown(sure)
    orders, amplitude, error = search.significant(orders)
    rest = search.rest(orders)
    vibration = _vibration(rest, search.steps(rest), dt)
    waves = Waves(speed, amplitude, error, vibration=vibration, half_rate=a_turn / 2, hidden=frozenset())
    least = search.least(rest)[:top] * 2 / search.motion.weight.sum() ** 2  # square mean of a wave, (rad/s)^2
    hidden = np.flatnonzero(least > SEEN_SHARE * waves.ripple**2) + 1
    return replace(waves, hidden=frozenset(hidden.tolist()))


class _Search:
    """A search for the orders of a motion. The strongest orders join the fit first."""

    def __init__(self, motion: _Motion, candidates: NDArray[np.intp], top: int, step: float) -> None:
        self.motion, self.candidates, self.top, self.step = motion, candidates, top, step
        turned = motion.theta[-1] - motion.theta[0]
        rows, turns = abs(TURN * len(motion.y) / turned), abs(turned) / TURN
        speed = turned / (motion.dt * len(motion.y))
        self.sawtooth = _sawtooth(candidates, rows, turns, step) * (motion.weight.sum() * speed / 2) ** 2

    def rest(self, orders: Sequence[int]) -> Array:
        """The speed less the fitted waves of these orders, rad/s."""
        matrices, vectors = self.motion.equations(orders)
        return self.motion.residual(orders, _solved(matrices.sum(axis=0), vectors.sum(axis=0)))

    def steps(self, rest: Array, width: int = SMOOTH_ROWS[0]) -> Array:
        """The speed, rad/s, that the steps of the angle add to the smooth motion between them.

        A measured angle is taken as the middle of its step.
        """
        if not self.step:
            return np.zeros_like(rest)
        rest_angle = self.motion.dt * np.concatenate(([0.0], np.cumsum(rest)))
        smooth = self.motion.measured - rest_angle + gaussian_filter1d(rest_angle, width, mode="nearest")
        away = smooth - self.motion.measured[0]
        return np.asarray(np.diff(np.round(away / self.step) * self.step - away) / self.motion.dt)

    def least(self, rest: Array) -> Array:
        """The power above which an order stands out of this rest's noise, at 1 % for the whole search."""
        power = self.motion.power(rest, self.candidates)
        floor = np.full(len(power), np.median(power[: self.top]))
        floor[: self.top] = median_filter(power[: self.top], min(FLOOR_ORDERS, self.top), mode="mirror")
        level = -math.log(FALSE_ALARM / len(power))
        return np.asarray(np.maximum(level * floor / math.log(2), self.sawtooth))

    def grown(self, orders: Sequence[int]) -> list[int]:
        """These orders, and all other orders that stand out of the noise and of the steps of the angle."""
        orders = list(orders)
        while True:
            rest = self.rest(orders)
            steps = [self.steps(rest, width) for width in SMOOTH_ROWS]
            power = self.motion.power(rest, self.candidates)
            without = [self.motion.power(rest - step_speed, self.candidates) for step_speed in steps]
            near = np.max([self.motion.power(step_speed, self.candidates) for step_speed in steps], axis=0)
            least = np.maximum(self.least(rest), STEPS_RATIO * maximum_filter1d(near, NEAR_ORDERS))
            clear = np.min([power, *without], axis=0) > least
            strongest = [k for k in np.argsort(-power) if clear[k] and self.candidates[k] not in orders]
            new = [int(self.candidates[k]) for k in strongest if power[k] > NEW_SHARE * power[strongest[0]]]
            if not new or len(orders) + NEW_MOST > WAVES_MOST:
                return orders
            orders += new[:NEW_MOST]

    def significant(self, orders: Sequence[int]) -> tuple[list[int], dict[int, complex], dict[int, float]]:
        """The orders that stand out of their errors, with waves, rad, and errors at 95 %.

        The errors are a jackknife over blocks of the rows. A Wald test judges the two values of each order.
        Their covariance has one degree of freedom less than there are blocks.
        """
        orders = sorted(orders)
        while True:
            matrices, vectors = self.motion.equations(orders)
            matrix, vector, count = matrices.sum(axis=0), vectors.sum(axis=0), len(self.motion.blocks)
            values = _solved(matrix, vector)
            parts = _solved(matrix - matrices, vector - vectors)
            away = parts - parts.mean(axis=0)
            limit = float(fisher.isf(FALSE_ALARM / len(self.candidates), 2, count - 2))
            amplitude, error, ratio = {}, {}, {}
            for k, n in enumerate(orders):
                pair = [k, len(orders) + k]
                covariance = (count - 1) / count * away[:, pair].T @ away[:, pair]
                wald = float(values[pair] @ np.linalg.pinv(covariance) @ values[pair])
                amplitude[n] = complex(*values[pair])
                error[n] = float(student.ppf(0.975, count - 1) * math.sqrt(np.trace(covariance) / 2))
                ratio[n] = wald / 2 * (count - 2) / (count - 1) / limit
            weakest = min(ratio.values(), default=2.0)
            if weakest > 1:
                return orders, amplitude, error
            orders = [n for n in orders if ratio[n] > min(1.0, 4 * weakest)]


def _apart_when_folded(orders: Sequence[int], rows: float, turns: float) -> Iterator[int]:
    """The orders that a log with `rows` rows a turn shows apart from each other and from whole orders."""
    folds = [folded(n, rows) for n in orders]
    for k, n in enumerate(orders):
        others = [fold for other, fold in enumerate(folds) if other != k]
        apart = min((abs(folds[k] - fold) for fold in (round(folds[k]), *others)), default=1.0)
        if apart * turns > 1 and n <= MOTION_ORDER_HIGHEST:
            yield n


def _sawtooth(orders: NDArray[np.intp], rows: float, turns: float, step: float) -> Array:
    """Square of n times the largest wave, rad, that steps of the angle make at each order n.

    The error of a steady rotor's angle is a sawtooth. Its waves have the orders k 2 pi / step, and sizes
    step / (pi k). A log with `rows` rows a turn shows these waves as other orders.
    """
    waves = np.zeros(len(orders))
    for k in range(1, STEP_WAVES + 1) if step else ():
        near = np.abs(orders - folded(k * TURN / step, rows)) < 1 + 1 / turns
        waves[near] = np.maximum(waves[near], SAWTOOTH_MARGIN * step / (np.pi * k))
    return (orders * waves) ** 2


def _vibration(rest: Array, steps: Array, dt: float) -> float:
    """The part of the speed's rest that stands out of the angle's noise, rms, rad/s.

    The noise is the larger of two: that of the angle's steps, and white noise of the angle as strong as the
    upper half of the spectrum.
    """
    length = min(SEGMENT_ROWS, len(rest) // SEGMENTS_LEAST)
    if length < 16:
        return float(np.std(rest))
    frequency, density = welch(rest, 1 / dt, nperseg=length)
    density, gain = density[1:], (2 * np.sin(np.pi * frequency[1:] * dt) / dt) ** 2
    white = float(np.median((density / gain)[len(gain) // 2 :]))
    noise = np.maximum(welch(steps, 1 / dt, nperseg=length)[1][1:], white * gain)
    freedom = 2 * len(rest) / length  # degrees of freedom of windows without overlap; overlap adds some
    loud = density > noise * chi2.isf(FALSE_ALARM / len(density), freedom) / freedom
    return math.sqrt(float(np.sum((density - noise)[loud])) * frequency[1])
