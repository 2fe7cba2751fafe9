"""Rows of the torque balance in the weak form: every term passes a Gaussian, derivatives fall on its kernel.

    i_q = j alpha + b omega + c sgn omega + load - cogging(theta) - i_q ripple(theta) - delay di_q/dt

All terms are in A, with j = J / K_t and so on. Nothing that is measured is differentiated. The noise that
steps of the angle make in alpha and omega is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cogless.identify.files import Array
from cogless.identify.log import Log

WIDTH = 6e-3  # s, of the kernel
REACH = 4  # of the kernel, in widths
SHORTEST = 3  # width of the kernel, in rows, at least
VISIBLE = 1 / 3  # of the sampling rate: a faster wave has no effect that a log could show
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
        if step == 1:  # five times as fast as by windows
            return np.correlate(x, kernel, "valid")
        return np.asarray(sliding_window_view(x, len(kernel))[::step] @ kernel)


def width_of(log: Log, width: float) -> float:
    """Width of the kernel for a log, s: the wanted one, or some of its rows."""
    return max(width, SHORTEST * log.dt)


def shifted(x: Array, rows: float) -> Array:
    """The signal so many rows later, by a cubic; at the ends it stays."""
    if not rows:
        return x
    n = np.arange(len(x)) + rows
    k = np.floor(n).astype(int)
    f = n - k
    a, b, c, d = (x[np.clip(k + m, 0, len(x) - 1)] for m in (-1, 0, 1, 2))
    return np.asarray(b + 0.5 * f * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a))))


def corrected(theta: Array, model: Model) -> Array:
    """The angle without the sensor's own error."""
    if not model.error:
        return theta
    return theta - _error(theta - _error(theta, model), model)  # the error is of the true angle


def _error(theta: Array, model: Model) -> Array:
    found = np.zeros_like(theta)
    for order, (cosine, sine) in model.error.items():
        found += cosine * np.cos(order * theta) + sine * np.sin(order * theta)
    return found


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
    dt, step_angle, pole_pairs = log.dt, sensor.step, sensor.pole_pairs
    step = max(1, round(width / dt))
    theta = corrected(log["theta"][rows], model)
    current = log["i_q"][rows] if "i_q" in log else np.zeros(len(theta))
    current = shifted(current, model.delay / dt)
    i_d = shifted(log["i_d"][rows], model.delay / dt) if "i_d" in log else 0.0
    slow = np.concatenate(
        ([0.0] * kernel.half, kernel.of(theta, kernel.first, 1), [0.0] * kernel.half)
    )  # the speed at every row
    sign = np.sign(slow)

    def mean(x: Array) -> Array:
        return kernel.of(x, kernel.value, step)

    def visible(order: int) -> NDArray[np.bool_]:
        return np.asarray(np.abs(order * slow) < 2 * np.pi * VISIBLE / dt)

    def cogging(order: int) -> list[Array]:
        seen, angle = visible(order), order * theta
        return [mean(np.where(seen, w(angle), 0.0)) for w in (np.cos, np.sin)]

    slope = np.zeros_like(theta)  # of the cogging over the angle, by J
    for n, (c, s) in model.waves.items():
        slope += np.where(visible(n), n / model.j * (s * np.cos(n * theta) - c * np.sin(n * theta)), 0.0)

    def encoder(order: int) -> list[Array]:
        waves = (w(order * theta) for w in (np.cos, np.sin))
        return [kernel.of(wave, kernel.second, step) - mean(slope * wave) for wave in waves]

    def ripple(order: int) -> list[Array]:
        """Torque of a wave of the magnet's flux, psi_d: by i_q, and by its slope with i_d, where known."""
        seen, angle = visible(order), order * theta
        cosine, sine = (np.where(seen, w(angle), 0.0) for w in (np.cos, np.sin))
        direct = order / pole_pairs * i_d
        return [mean(current * cosine - direct * sine), mean(current * sine + direct * cosine)]

    alpha, omega = kernel.of(theta, kernel.second, step), kernel.of(theta, kernel.first, step)
    rubbing = mean(sign)
    names: list[Name] = []
    columns: list[Array] = []

    def add(name: Name, column: Array) -> None:
        names.append(name)
        columns.append(column)

    for key, column in (("j", alpha), ("b", omega), ("c", rubbing), ("offset", np.ones(len(alpha)))):
        if key in model.columns:
            add((key,), column)
    if "delay" in model.columns and "i_q" in log:
        add(("delay",), -kernel.of(current, kernel.first, step))
    if log.kind == "load" and "torque" not in log:
        add(("load", log.name), np.ones(len(alpha)))
    for kind, orders, waves in (
        ("cogging", model.cogging, cogging),
        ("ripple", model.ripple, ripple),
        ("encoder", model.encoder, encoder),
    ):
        for order in orders:
            for part, column in zip("cs", waves(order), strict=True):
                add((kind, order, part), -column)
    y = mean(current)
    if "torque" in log:
        y = y - mean(log["torque"][rows])  # in A: prepared by the caller
    moved = np.abs(omega) * dt / step_angle if step_angle else np.zeros(len(omega))
    share = np.minimum(1.0, moved) * step_angle**2 / 12  # slower, the steps are a fast sawtooth
    noise = np.zeros((len(alpha), len(names)))
    for key, kernel_of in (("j", kernel.second), ("b", kernel.first)):
        if (key,) in names:
            noise[:, names.index((key,))] = share * np.sum(kernel_of**2)
    middle = rows.start + kernel.half + step * np.arange(len(alpha))
    edge = REACH * width  # within it the sign of the speed may be another
    free = (np.abs(rubbing) > 0.999) & (np.abs(omega) > _slowest(step_angle, edge))
    return Rows(
        log,
        tuple(names),
        np.column_stack(columns)[free],
        y[free],
        noise[free],
        mean(theta)[free],
        omega[free],
        middle[free].astype(np.float64),
    )


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
