"""Rows of the torque balance in the weak form: every term passes a Gaussian, derivatives fall on its kernel.

    i_q = j alpha + b omega + c sgn omega + load - cogging(theta) - i_q ripple(theta) - delay di_q/dt

All terms are in A, with j = J / K_t and so on. Nothing that is measured is differentiated. The noise that
steps of the angle make in alpha and omega is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cogless.identify.files import Array
from cogless.identify.log import Log

WIDTH = 6e-3  # s, of the kernel
REACH = 4  # of the kernel, in widths
SHORTEST = 3  # width of the kernel, in rows, at least
VISIBLE = 1 / 3  # of the sampling rate: a faster wave has no effect that a log could show
PIECE = 1 << 14  # rows of a log that are filtered together: what they need stays in the processor's cache
Name = tuple[str | int, ...]


@dataclass(frozen=True)
class Model:
    """What is looked for. Orders are mechanical.

    `delay`, `error`: what is already taken out. `delay`: time by which i_q is logged after the angle, s.
    `error`: (cos, sin) of the sensor's error by order, rad. `waves`, `j`: cogging, (cos, sin) by order, A,
    and inertia that were found before: with them the sensor's error shows in the place of the cogging, too.
    `width`: of the kernel, s.
    `untold`: columns that hold two things that can't be told apart.
    """

    cogging: tuple[int, ...] = ()
    ripple: tuple[int, ...] = ()
    encoder: tuple[int, ...] = ()
    columns: frozenset[str] = frozenset({"j", "b", "c"})
    delay: float = 0.0
    error: dict[int, tuple[float, float]] = field(default_factory=dict)
    waves: dict[int, tuple[float, float]] = field(default_factory=dict)
    j: float = 0.0
    width: float = WIDTH
    untold: frozenset[tuple[str, int]] = frozenset()  # kind, and order or 0


@dataclass(frozen=True)
class Sensor:
    """Steps of the measured angle, rad (0: none), and the motor's pole pairs."""

    step: float
    pole_pairs: int


@dataclass(frozen=True, eq=False)
class Rows:
    """Filtered rows of one log: y = columns @ coefficients + residual.

    `noise`: variance that each column owes to the steps of the angle, by row. `at`: the row of the log in the
    middle of each. `theta`, `omega`: there.
    """

    log: Log
    names: tuple[Name, ...]
    columns: Array
    y: Array
    noise: Array
    theta: Array
    omega: Array
    at: Array


class Kernel:
    """A Gaussian of a width, s, and its derivatives, for rows dt apart."""

    def __init__(self, width: float, dt: float) -> None:
        self.half = int(np.ceil(REACH * width / dt))
        x = dt * np.arange(-self.half, self.half + 1)
        g = np.exp(-0.5 * (x / width) ** 2)
        self.value = g / g.sum()
        first = x * g
        self.first = first / np.sum(first * x)
        second = (x**2 - width**2) * g
        second = second - g * second.sum() / g.sum()
        self.second = 2 * second / np.sum(second * x**2)

    def of(self, x: Array, kernel: Array, step: int) -> Array:
        """The filtered signal at every step-th row that the kernel covers."""
        if step == 1:
            return np.correlate(x, kernel, "valid")
        # kernel and signal in parts of a step: a product of matrices, its diagonals added up
        parts, count = -(-len(kernel) // step), (len(x) - len(kernel)) // step + 1
        taps, rows = np.zeros(parts * step), np.zeros((count + parts - 1) * step)
        taps[: len(kernel)], rows[: len(x)] = kernel, x[: len(rows)]
        products = rows.reshape(-1, step) @ taps.reshape(parts, step).T
        return np.asarray(sum(products[part : part + count, part] for part in range(parts)))


def width_of(log: Log, width: float) -> float:
    """Width of the kernel for a log, s: the wanted one, or some of its rows."""
    return max(width, SHORTEST * log.dt)


def shifted(x: Array, rows: float) -> Array:
    """The signal so many rows later, by a cubic; at the ends it stays."""
    if not rows:
        return x
    k = int(np.floor(rows))
    f, ends = rows - k, abs(k) + 2
    padded = np.concatenate((x[:1].repeat(ends), x, x[-1:].repeat(ends)))
    a, b, c, d = (padded[ends + k + m : ends + k + m + len(x)] for m in (-1, 0, 1, 2))
    return np.asarray(b + 0.5 * f * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a))))


def corrected(theta: Array, model: Model) -> Array:
    """The angle without the sensor's own error."""
    if not model.error:
        return theta
    return theta - _error(theta - _error(theta, model), model)  # the error is of the true angle


def _error(theta: Array, model: Model) -> Array:
    found = np.zeros_like(theta)
    for order, wave in _waves(theta, model.error):
        cosine, sine = model.error[order]
        found += cosine * wave.real + sine * wave.imag
    return found


def _waves(theta: Array, orders: Iterable[int]) -> Iterator[tuple[int, NDArray[np.complex128]]]:
    """Yield each order n with e^(j n theta), which the next overwrites, by products instead of sines."""
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


def rows_of(log: Log, model: Model, width: float, sensor: Sensor) -> list[Rows]:
    """Rows of each stretch of a log that is long enough."""
    if log.kind == "hold" and not log.dt:
        return [_held(log, model)]
    width = width_of(log, width)
    kernel = Kernel(width, log.dt)
    found = []
    for rows in log.stretches:
        if rows.stop - rows.start > 4 * kernel.half:
            made = _moving(log, rows, model, kernel, width, sensor)
            if len(made.y):
                found.append(made)
    return found


def _moving(log: Log, rows: slice, model: Model, kernel: Kernel, width: float, sensor: Sensor) -> Rows:
    late = model.delay / log.dt
    signals = {"theta": log["theta"][rows]}
    signals |= {name: shifted(log[name][rows], late) for name in ("i_q", "i_d") if name in log}
    if "torque" in log:
        signals["torque"] = log["torque"][rows]  # in A: prepared by the caller
    step = max(1, round(width / log.dt))
    count, some = (rows.stop - rows.start - 2 * kernel.half - 1) // step + 1, max(1, PIECE // step)
    pieces = [
        _piece(log, signals, (first, min(first + some, count)), step, model, kernel, width, sensor)
        for first in range(0, count, some)
    ]
    columns, y, noise, theta, omega, at = (np.concatenate(of) for of in zip(*pieces, strict=True))
    return Rows(log, _names(log, model), columns, y, noise, theta, omega, rows.start + at)


def _names(log: Log, model: Model) -> tuple[Name, ...]:
    """Names of the columns of a log of a turning motor."""
    single: list[Name] = [(key,) for key in ("j", "b", "c", "offset") if key in model.columns]
    if "delay" in model.columns and "i_q" in log:
        single.append(("delay",))
    if log.kind == "load" and "torque" not in log:
        single.append(("load", log.name))
    kinds = (("cogging", model.cogging), ("ripple", model.ripple), ("encoder", model.encoder))
    return (*single, *((kind, order, part) for kind, orders in kinds for order in orders for part in "cs"))


def _piece(
    log: Log,
    signals: Mapping[str, Array],
    some: tuple[int, int],
    step: int,
    model: Model,
    kernel: Kernel,
    width: float,
    sensor: Sensor,
) -> tuple[Array, ...]:
    """Columns, y, noise, theta, omega and place in the stretch of some filtered rows, `step` rows apart."""
    dt, step_angle, half = log.dt, sensor.step, kernel.half
    first, last = step * some[0], step * (some[1] - 1) + 2 * half + 1  # what the kernel covers
    before, after = max(0, first - half), min(len(signals["theta"]), last + half)
    theta = corrected(signals["theta"][before:after], model)
    slow = np.zeros(last - first)  # the speed at every row, but at the stretch's ends
    slow[before + half - first : after - half - first] = kernel.of(theta, kernel.first, 1)
    theta = theta[first - before : last - before]
    current = signals["i_q"][first:last] if "i_q" in signals else np.zeros(len(theta))
    i_d = signals["i_d"][first:last] if "i_d" in signals else np.zeros(len(theta))
    speed, limit = np.abs(slow), 2 * np.pi * VISIBLE / dt
    fastest = float(np.max(speed))

    def mean(x: Array) -> Array:
        return kernel.of(x, kernel.value, step)

    alpha, omega = kernel.of(theta, kernel.second, step), kernel.of(theta, kernel.first, step)
    rubbing = mean(np.sign(slow))
    constant = np.ones(len(alpha))
    found: dict[Name, Array] = {("j",): alpha, ("b",): omega, ("c",): rubbing, ("offset",): constant}
    found["delay",] = -kernel.of(current, kernel.first, step)
    found["load", log.name] = constant
    slope = np.zeros_like(theta)  # of the cogging over the angle, by J
    errors: dict[int, tuple[Array, Array]] = {}
    for n, wave in _waves(theta, {*model.cogging, *model.ripple, *model.encoder, *model.waves}):
        if n in model.encoder:
            errors[n] = wave.real.copy(), wave.imag.copy()
        cosine, sine = wave.real, wave.imag
        if n * fastest >= limit:
            seen = n * speed < limit
            cosine, sine = cosine * seen, sine * seen
        if n in model.waves:
            c, s = model.waves[n]
            slope += n / model.j * (s * cosine - c * sine)
        if n in model.cogging:
            found["cogging", n, "c"], found["cogging", n, "s"] = -mean(cosine), -mean(sine)
        if n in model.ripple:  # torque of a wave of the magnet's flux, psi_d: by i_q, by its slope with i_d
            direct = n / sensor.pole_pairs * i_d
            found["ripple", n, "c"] = -mean(current * cosine - direct * sine)
            found["ripple", n, "s"] = -mean(current * sine + direct * cosine)
    for n, waves in errors.items():
        for part, wave_of in zip("cs", waves, strict=True):
            found["encoder", n, part] = mean(slope * wave_of) - kernel.of(wave_of, kernel.second, step)
    y = mean(current)
    if "torque" in signals:
        y = y - mean(signals["torque"][first:last])
    moved = np.abs(omega) * dt / step_angle if step_angle else np.zeros(len(omega))
    share = np.minimum(1.0, moved) * step_angle**2 / 12  # slower, the steps are a fast sawtooth
    names = _names(log, model)
    noise = np.zeros((len(alpha), len(names)))
    for key, kernel_of in (("j", kernel.second), ("b", kernel.first)):
        if (key,) in names:
            noise[:, names.index((key,))] = share * np.sum(kernel_of**2)
    middle = (half + step * np.arange(*some)).astype(np.float64)
    edge = REACH * width  # within it the sign of the speed may be another
    free = (np.abs(rubbing) > 0.999) & (np.abs(omega) > _slowest(step_angle, edge))
    columns = np.column_stack([found[name] for name in names])
    return tuple(of[free] for of in (columns, y, noise, mean(theta), omega, middle))


def _slowest(step_angle: float, window: float) -> float:
    """Speed from which on a rotor surely turns, rad/s: some counts within the kernel."""
    return 4 * step_angle / window


def _held(log: Log, model: Model) -> Rows:
    """Rows of a hold map, where the rotor came from one direction or the other."""
    theta = corrected(log["theta"], model)
    current = log["i_q"]
    names: list[Name] = [("c_hold",)]
    columns = [log["direction"]]
    if "offset" in model.columns:
        names.append(("offset",))
        columns.append(np.ones(len(theta)))
    for kind, orders in (("cogging", model.cogging), ("ripple", model.ripple)):
        for order in orders:
            for part, wave in (("c", np.cos), ("s", np.sin)):
                names.append((kind, order, part))
                columns.append(-wave(order * theta) * (current if kind == "ripple" else 1.0))
    zero = np.zeros((len(theta), len(names)))
    return Rows(
        log,
        tuple(names),
        np.column_stack(columns),
        current,
        zero,
        theta,
        np.zeros(len(theta)),
        np.arange(len(theta), dtype=np.float64),
    )


def all_names(rows: Sequence[Rows]) -> tuple[Name, ...]:
    """Names of all columns, in the order of their first place."""
    return tuple(dict.fromkeys(name for each in rows for name in each.names))
