"""Rows of the balance of torques, in A, that one log gives.

    i_q = j alpha + b omega + c sgn omega + offset + load - cogging(theta) - i_q ripple(theta)
          + encoder's error + friction waves + Stribeck + sticking,   all at the current's time less the delay

The current is never interpolated. The angle is smooth, so the angle is taken at the current's time. So the
mean of i_q times a wave is right even where the wave is faster than the rows. One Gaussian filters all terms.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from cogless.identify.kernel import REACH_WIDTHS, Kernel, shifted, white_noise
from cogless.identify.log import Log
from cogless.results.trace import Array

LADDER = (0.006, 0.009, 0.013, 0.02, 0.03, 0.045, 0.07, 0.1)  # s, widths of the acceleration's instruments
WIDE_INSTRUMENT = 5  # index in LADDER of the instrument that is used until another is chosen
ROW_SPACING = 0.8  # distance of the filtered rows, in widths of the kernel
# largest phase of a visible wave, rad: from row to row, and in a period of the law
SEEN_PHASE, HELD_PHASE = 2.4, 1.2
# rad from row to row: up to this phase a log gets columns of its own for a wave whose phase is not known
ALIASED_PHASE = 2.8
KERNEL_WIDTH = 6e-3  # s, the kernel's width until the noises are known
CREEP_SHARE = 0.05  # share of a log's median speed
STILL_DEVIATIONS = 3  # standard deviations of the angle's change: a rotor that moves by less may stand
LOG_BLOCKS = 12  # blocks of a log; a jackknife leaves out one at a time
STANDING_ROWS_LEAST = 1  # rows of a standing rotor that must remain when any one block is left out
WAVE_RATE_SHARE = 1 / 3  # share of the rate of rows: a faster wave is not seen
BLUR_PHASE = 3.0  # rad in a width of the kernel: the kernel leaves a hundredth of a wave of this phase
# smallest width of a kernel, rows: a wave of SEEN_PHASE a row has BLUR_PHASE a width, its alias is below .2 %
WIDTH_ROWS = BLUR_PHASE / SEEN_PHASE
MEAN_WIDTH_ROWS = 2.5  # smallest width for mean currents, rows; they show a faster wave too small
Name = tuple[str | int, ...]
Filter = Callable[..., Array]
Pairs = Mapping[int, tuple[float, float]]


@dataclass(frozen=True)
class Model:
    """The terms of the balance. Orders are mechanical.

    `delay`: time by which i_q is logged after the angle, s. `error`: (cos, sin) of the sensor's error by
    order, rad, which is subtracted from the angle. `waves`, `j`: cogging, (cos, sin) by order, A, and inertia
    of the fit before. The columns of the sensor's error need them, since the error shifts the cogging.
    `friction`: orders in which friction varies. `stribeck`: speed over which friction falls, rad/s, 0 for
    none; the factor `stribeck_ratio` is the speed's uncertainty. `stribeck_trials`: such speeds to compare,
    each with a column of its own. `widths`: width of each log's kernel, s. `instrument_of`: what is filtered
    to give the instruments of the acceleration.
    `untold`: columns whose coefficient is the sum of two effects that these logs cannot separate.
    """

    cogging: tuple[int, ...] = ()
    ripple: tuple[int, ...] = ()
    encoder: tuple[int, ...] = ()
    friction: tuple[int, ...] = ()
    stribeck: float = 0.0
    stribeck_ratio: float = 1.0
    stribeck_trials: tuple[float, ...] = ()
    columns: frozenset[str] = frozenset({"j", "b", "c"})
    delay: float = 0.0
    error: Pairs = field(default_factory=dict)
    waves: Pairs = field(default_factory=dict)
    j: float = 0.0
    widths: Mapping[str, float] = field(default_factory=dict)
    instrument_of: Literal["acceleration", "current"] = "acceleration"
    untold: frozenset[tuple[str, int]] = frozenset()  # kind, and order or 0

    def width(self, log: Log) -> float:
        """Width of a log's kernel, s."""
        return max(self.widths.get(log.name, KERNEL_WIDTH), narrowest_width(log))


@dataclass(frozen=True)
class Sensor:
    """Step of the measured angle, rad (0: none), pole pairs, and the time for which the law holds i_q, s."""

    step: float
    pole_pairs: int
    hold_period: float = 0.0

    def top(self, log: Log) -> float:
        """Angular frequency of the fastest wave whose phase can be known from a log, rad/s."""
        by_rows = SEEN_PHASE / log.dt if log.dt else np.inf
        return min(by_rows, HELD_PHASE / self.hold_period if self.hold_period else np.inf)


@dataclass(frozen=True, eq=False)
class Rows:
    """Filtered rows of one log: y = columns @ coefficients + residual.

    `noise`: variance of a column by the angle's noise, for each row, of the columns computed from the angle.
    `at`: the log's row in the middle of each filtered row; `theta` and `omega` are taken there.
    `instruments`: acceleration, or current, by wider kernels, a row for each width of LADDER. `spacing`: time
    between filtered rows, s.
    """

    log: Log
    names: tuple[Name, ...]
    columns: Array
    y: Array
    noise: Mapping[Name, Array]
    theta: Array
    omega: Array
    at: Array
    instruments: Array = field(default_factory=lambda: np.zeros((len(LADDER), 0)))
    spacing: float = 0.0  # s

    def without(self, removed: Collection[Name]) -> Rows:
        """These rows without the columns whose names begin with one of `removed`."""
        stay = [k for k, name in enumerate(self.names) if name[:2] not in removed]
        return replace(
            self, names=tuple(self.names[k] for k in stay), columns=self.columns.take(stay, axis=1)
        )


def narrowest_width(log: Log) -> float:
    """Smallest width of a log's kernel that the log's row spacing allows, s."""
    return (MEAN_WIDTH_ROWS if log.mean_current else WIDTH_ROWS) * log.dt


def all_names(rows: Sequence[Rows]) -> tuple[Name, ...]:
    """Names of all columns, in the order in which they first occur."""
    return tuple(dict.fromkeys(name for stretch in rows for name in stretch.names))


def corrected(theta: Array, model: Model) -> Array:
    """The angle without the sensor's own error."""
    if not model.error:
        return theta
    return theta - _error(theta - _error(theta, model), model)  # the error is of the true angle


def _error(theta: Array, model: Model) -> Array:
    total = np.zeros_like(theta)
    for order, wave in _waves(theta, model.error):
        cosine, sine = model.error[order]
        total += cosine * wave.real + sine * wave.imag
    return total


def _waves(theta: Array, orders: Iterable[int]) -> Iterator[tuple[int, NDArray[np.complex128]]]:
    """Yield each order n with e^(j n theta), by products instead of sines. Each yield reuses the array."""
    powers = [np.empty(len(theta), np.complex128)]  # 1, 2, 4, ... of e^(j theta)
    np.cos(theta, out=powers[0].real)
    np.sin(theta, out=powers[0].imag)
    wave, at = np.ones_like(powers[0]), 0
    for n in sorted(orders):
        for bit in range((n - at).bit_length()):
            if bit == len(powers):
                powers.append(powers[-1] ** 2)
            if (n - at) >> bit & 1:
                wave *= powers[bit]
        at = n
        yield n, wave


def rows_of(log: Log, model: Model, sensor: Sensor) -> list[Rows]:
    """Rows of each stretch of a log that is long enough."""
    if log.kind == "hold" and not log.dt:
        return [_hold_rows(log, model)]
    kernel = Kernel(model.width(log), log.dt, model.delay)
    moving = (_moving(log, rows, model, kernel, sensor) for rows in log.stretches if _long(rows, kernel))
    return [rows for rows in moving if len(rows.y)]


def _long(rows: slice, kernel: Kernel) -> bool:
    count: int = rows.stop - rows.start
    return count > 4 * kernel.half


def _moving(log: Log, stretch: slice, model: Model, kernel: Kernel, sensor: Sensor) -> Rows:
    width, dt = model.width(log), log.dt
    step = max(1, round(ROW_SPACING * width / dt))
    theta = corrected(log["theta"][stretch], model)
    zero = np.zeros_like(theta)
    coasts = "i_q" not in log or log.kind == "coast-down"
    current = zero if coasts else log["i_q"][stretch]
    direct = log["i_d"][stretch] if "i_d" in log and not coasts else zero
    turned = shifted(theta, -model.delay / dt)  # The angle is taken at the current's time.
    slow = np.convolve(np.gradient(turned, dt), kernel.value, "same")
    way = np.sign(slow)

    def filtered(x: Array, weights: Array = kernel.value) -> Array:
        return kernel.filter(x, weights, step)

    alpha, omega = filtered(theta, kernel.acceleration), filtered(theta, kernel.speed)
    count, rubbing = len(alpha), filtered(way)
    columns: dict[Name, Array] = {}
    single = {"j": alpha, "b": omega, "c": rubbing, "offset": np.full(count, 0.0 if coasts else 1.0)}
    columns |= {(key,): x for key, x in single.items() if key in model.columns}
    if "delay" in model.columns and not coasts:
        columns["delay",] = -filtered(current, kernel.slope)
    if log.kind == "load" and "torque" not in log:
        columns["load", log.name] = np.ones(count)
    falls: dict[Name, float] = {("stribeck",): model.stribeck} if model.stribeck else {}
    falls |= {("stribeck", n): speed for n, speed in enumerate(model.stribeck_trials)}
    columns |= {name: filtered(way * np.exp(-((slow / speed) ** 2))) for name, speed in falls.items()}
    columns |= _by_angle(log, model, sensor, turned, slow, (current, direct), filtered, kernel)
    y = filtered(current)
    if "torque" in log:
        y = y - filtered(log["torque"][stretch])
    moved = np.abs(omega) * dt / sensor.step if sensor.step else np.ones(count)
    noise = angle_noise(log, stretch, sensor.step)
    share = np.minimum(1.0, moved) * noise  # slower, the steps are a sawtooth
    derived = {("j",): kernel.acceleration, ("b",): kernel.speed}
    # near a reversal the friction is not sliding friction, so these rows are left out
    creeping = max(CREEP_SHARE * float(np.median(np.abs(slow))), 1e-9)
    slowest = max(_slowest(sensor.step, REACH_WIDTHS * width), creeping)
    free = (np.abs(rubbing) > 0.999) & (np.abs(omega) > slowest)
    if "c" in model.columns:  # while a rotor stands, its friction is less than Coulomb's
        resolved = max(sensor.step, STILL_DEVIATIONS * float(np.sqrt(2 * noise)))
        sticking = filtered(way * _standing(turned, resolved, creeping * dt, width / dt))
        rows = [float(np.sum(part**2)) for part in np.array_split(sticking[free], LOG_BLOCKS)]
        if sum(rows) - max(rows) > STANDING_ROWS_LEAST:
            columns["sticking", log.name] = sticking
    at = (kernel.half + step * np.arange(count)).astype(np.float64)
    middle = turned[kernel.half : kernel.half + step * count : step]
    instruments = _instruments(alpha if model.instrument_of == "acceleration" else y, step * dt)
    matrix = np.column_stack(list(columns.values()))
    return Rows(
        log=log,
        names=tuple(columns),
        columns=matrix[free],
        y=y[free],
        noise={key: share[free] * np.sum(weights**2) for key, weights in derived.items() if key in columns},
        theta=middle[free],
        omega=omega[free],
        at=stretch.start + at[free],
        instruments=instruments[:, free],
        spacing=step * dt,
    )


def _standing(theta: Array, resolved: float, creeping: float, width: float) -> NDArray[np.bool_]:
    """Whether the rotor stands, for each row. `width`: of the kernel, in rows.

    A rotor that creeps by `creeping`, rad a row, needs some rows to move by `resolved`, rad. A rotor stands
    if it moves by `resolved` or less in as many rows. A stand shorter than the kernel's width does not count.
    """
    stands = np.zeros(len(theta), np.bool_)
    rows = int(np.ceil(np.clip(resolved / creeping, 1.0, len(theta) - 1.0)))
    if rows > REACH_WIDTHS * width:
        return stands
    still = np.abs(theta[rows:] - theta[:-rows]) <= resolved
    for row in range(rows + 1):
        stands[row : len(still) + row] |= still
    edges = np.flatnonzero(np.diff(stands, prepend=False, append=False))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        stands[begin:end] = end - begin >= width
    return stands


def _by_angle(
    log: Log,
    model: Model,
    sensor: Sensor,
    turned: Array,
    slow: Array,
    currents: tuple[Array, Array],
    filtered: Filter,
    kernel: Kernel,
) -> dict[Name, Array]:
    """The columns that are waves of the angle."""
    current, direct = currents
    speed, way, top = np.abs(slow), np.sign(slow), sensor.top(log)
    fastest = float(np.max(speed))
    columns: dict[Name, Array] = {}
    slope = np.zeros_like(turned)  # slope of the cogging over the angle, divided by j
    errors: dict[int, tuple[Array, Array]] = {}
    orders = {*model.cogging, *model.ripple, *model.encoder, *model.friction, *model.waves}
    for n, wave in _waves(turned, orders):
        cosine, sine = wave.real, wave.imag
        if n in model.encoder:
            errors[n] = cosine.copy(), sine.copy()
        seen = n * speed < top if n * fastest >= top else None
        if n in model.waves and model.j > 0:
            c, s = model.waves[n]
            visible = n * speed * log.dt < SEEN_PHASE if n * fastest * log.dt >= SEEN_PHASE else 1.0
            slope += n / model.j * visible * (s * cosine - c * sine)
        if n in model.cogging:
            share = np.ones(1) if seen is None else _faded(seen, model.width(log) / log.dt)
            for part, x in zip("cs", (cosine, sine), strict=True):
                columns["cogging", n, part] = -filtered(x * share)
            if seen is not None and np.mean(~seen) > 0.5 < np.mean(n * speed * log.dt < ALIASED_PHASE):
                for part, x in zip("cs", (cosine, sine), strict=True):
                    columns["own", n, part, log.name] = -filtered(x * (1 - share))
        if n in model.ripple:  # The wave of the magnet's flux psi_d acts on i_q, the wave's slope on i_d.
            along = n / sensor.pole_pairs * direct
            columns["ripple", n, "c"] = -filtered(current * cosine - along * sine)
            columns["ripple", n, "s"] = -filtered(current * sine + along * cosine)
        if n in model.friction:
            for part, x in zip("cs", (cosine, sine), strict=True):
                columns["friction", n, part] = filtered(way * x)
    for n, waves in errors.items():
        for part, x in zip("cs", waves, strict=True):
            columns["encoder", n, part] = filtered(slope * x) - filtered(x, kernel.curvature)
    return columns


def _faded(seen: NDArray[np.bool_], width: float) -> Array:
    """The share of a wave that is modelled: 1 where the wave is seen, fading to 0 over `width` rows.

    Were the wave cut off at once, the kernel would hide the wave but show the cut, as a part of half a turn.
    The cut is at the same place in all ramps over the same angles, and would change the inertia of the fit.
    """
    return np.asarray(gaussian_filter1d(seen.astype(np.float64), width, mode="nearest"))


def angle_noise(log: Log, stretch: slice, step: float) -> float:
    """Variance of the angle's noise, rad^2: the measured one, kept within step^2 / 24 and step^2 / 6."""
    measured = white_noise(log["theta"][stretch])
    return min(max(measured, step**2 / 24), step**2 / 6) if step else measured


def _slowest(step_angle: float, window: float) -> float:
    """Speed from which on a rotor surely turns, rad/s: two steps of the sensor within the window, s."""
    return 2 * step_angle / window


def _instruments(x: Array, spacing: float) -> Array:
    """The signal through each kernel of LADDER, a row each; these have no fast changes."""
    return np.array([smooth(x, width / spacing) for width in LADDER]) / _weights(len(x), spacing)


def smooth(x: Array, width: float) -> Array:
    """The signal filtered by an instrument's Gaussian; `width` in rows."""
    return np.asarray(gaussian_filter1d(x, width, mode="constant", truncate=3))


@lru_cache(maxsize=32)
def _weights(count: int, spacing: float) -> Array:
    """Sum of each instrument's weights at each row, a row for each; below 1 near the ends of a log."""
    return np.array([smooth(np.ones(count), width / spacing) for width in LADDER])


def _hold_rows(log: Log, model: Model) -> Rows:
    """Rows of a hold map, where the rotor came from one direction or the other."""
    theta, current = corrected(log["theta"], model), log["i_q"]
    columns: dict[Name, Array] = {("c_hold",): log["direction"]}
    if "offset" in model.columns:
        columns["offset",] = np.ones(len(theta))
    for kind, orders in (("cogging", model.cogging), ("ripple", model.ripple)):
        for order in orders:
            for part, wave in (("c", np.cos), ("s", np.sin)):
                columns[kind, order, part] = -wave(order * theta) * (current if kind == "ripple" else 1.0)
    return Rows(
        log=log,
        names=tuple(columns),
        columns=np.column_stack(list(columns.values())),
        y=current,
        noise={},
        theta=theta,
        omega=np.zeros(len(theta)),
        at=np.arange(len(theta), dtype=np.float64),
        instruments=np.zeros((len(LADDER), len(theta))),
    )
