"""A printer's axis apart from the project: a hybrid step motor, a belt and a carriage, in plain NumPy.

The rotor is driven by coils with offset, gain and quadrature errors, by detent torque and by a third harmonic
of the flux. The carriage hangs on a belt. Many axes are integrated side by side by the classic Runge-Kutta
method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

TURN = 2 * np.pi
STEP = 1e-4  # s
SLIDING_SPEED = 1e-3  # m/s, below which Coulomb friction is smooth


@dataclass(frozen=True)
class Axes:
    """Parameters, each an array over the axes that are integrated side by side. SI."""

    offset_a: np.ndarray  # A
    offset_b: np.ndarray
    gain: np.ndarray  # mismatch of coil a
    quadrature: np.ndarray  # share of coil a's current in coil b
    detent: np.ndarray  # N m
    detent_phase: np.ndarray
    third: np.ndarray  # share of the back-EMF
    belt: np.ndarray  # stiffness, N/m
    damping: np.ndarray  # N s/m
    mass: np.ndarray  # kg
    rail: np.ndarray  # N
    rotor_friction: np.ndarray  # N m
    viscous: np.ndarray  # N m s/rad
    current: np.ndarray  # A peak
    K_t: float = 0.59 / (np.sqrt(2) * 2.0)
    inertia: float = 8.2e-6
    teeth: int = 50
    radius: float = 0.04 / TURN

    @property
    def holding(self) -> np.ndarray:
        return self.K_t * self.current

    def take(self, lanes: np.ndarray) -> Axes:
        arrays = {k: v[lanes] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **arrays)


def random_axes(count: int, seed: int) -> Axes:
    """Axes with the tolerances of motors and drivers, and belts of 0.5 to 1.8 times a stiffness."""
    rng = np.random.default_rng(seed)
    mass = rng.uniform(0.35, 0.6, count)
    belt = 1.1e5 * rng.uniform(0.5, 1.8, count)
    return Axes(
        offset_a=rng.normal(0, 0.01, count),
        offset_b=rng.normal(0, 0.01, count),
        gain=rng.normal(0, 0.025, count),
        quadrature=rng.normal(0, 0.02, count),
        detent=rng.uniform(2e-3, 9e-3, count),
        detent_phase=rng.uniform(-np.pi, np.pi, count),
        third=np.zeros(count),
        belt=belt,
        damping=2 * rng.uniform(0.02, 0.06, count) * np.sqrt(belt * mass),
        mass=mass,
        rail=rng.uniform(1.0, 3.0, count),
        rotor_friction=rng.uniform(3e-3, 8e-3, count),
        viscous=rng.uniform(1e-4, 4e-4, count),
        current=np.full(count, 0.8 * np.sqrt(2)),
    )


def study_axes(count: int) -> Axes:
    """`count` axes, each that of the study `printer`."""
    stiffness = 0.5 * (TURN * 75) ** 2
    values = {
        "offset_a": 10e-3 / 1.025,
        "offset_b": -8e-3,
        "gain": 1 / 1.025 - 1,
        "quadrature": 0.0,
        "detent": 6e-3,
        "detent_phase": 0.0,
        "third": 0.0,
        "belt": stiffness,
        "damping": 2 * 0.04 * np.sqrt(stiffness * 0.5),
        "mass": 0.5,
        "rail": 2.0,
        "rotor_friction": 5e-3,
        "viscous": 2e-4,
        "current": 0.8 * np.sqrt(2),
    }
    return Axes(**{name: np.full(count, value) for name, value in values.items()})


def closed_form(axes: Axes, direction: int, speed: float = 0.0) -> dict[int, np.ndarray]:
    """psi by order: the rotor's electrical angle is u + sum Im(psi exp(j n u)) - delta."""
    friction = axes.rail * axes.radius + axes.rotor_friction + axes.viscous * speed / axes.radius
    delta = friction / axes.holding
    turned = np.exp(-1j * direction * delta)
    return {
        1: (-axes.offset_a + 1j * axes.offset_b) / axes.current * turned,
        2: (-axes.gain / 2 + 0.5j * axes.quadrature) * turned**2,
        4: -axes.detent / axes.holding * np.exp(1j * axes.detent_phase) * turned**4 - axes.third * turned**3,
    }


def phase_shift(c: dict[int, np.ndarray], u: np.ndarray) -> np.ndarray:
    return sum((np.imag(value * np.exp(1j * n * u)) for n, value in c.items()), np.zeros_like(u))


def derivative(axes: Axes, state: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Derivatives of the rotor's angle and speed and of the carriage's position and speed. `u`: the driver's
    electrical angle."""
    theta, omega, x, v = state
    te = axes.teeth * theta
    a = axes.current * (1 + axes.gain) * np.cos(u) + axes.offset_a
    b = axes.current * (np.sin(u) + axes.quadrature * np.cos(u)) + axes.offset_b
    torque = axes.K_t * (
        -a * (np.sin(te) + axes.third * np.sin(3 * te)) + b * (np.cos(te) - axes.third * np.cos(3 * te))
    )
    torque = torque - axes.detent * np.sin(4 * te + axes.detent_phase)
    pull = axes.belt * (axes.radius * theta - x) + axes.damping * (axes.radius * omega - v)
    slide = np.tanh(axes.radius * omega / SLIDING_SPEED)
    torque = torque - axes.rotor_friction * slide - axes.viscous * omega - axes.radius * pull
    carriage = (pull - axes.rail * np.tanh(v / SLIDING_SPEED)) / axes.mass
    return np.stack([omega, torque / axes.inertia, v, carriage])


def accelerations(
    axes: Axes,
    way: Callable[[float], np.ndarray],
    correction: dict[int, np.ndarray],
    duration: float,
    every: int = 2,
) -> tuple[np.ndarray, np.ndarray]:
    """Times and the carriages' accelerations, a row for each time. `way`: commanded position of each axis, m.

    The command's electrical angle is that of the motor's teeth; a correction is added to it in the driver.
    """
    scale = axes.teeth / axes.radius

    def driven(t: float) -> np.ndarray:
        u = scale * way(t)
        return u + phase_shift(correction, u)

    x = way(0.0)
    state = np.stack([x / axes.radius, 0 * x, x, 0 * x])
    rows, times = [], []
    h = STEP
    u0 = driven(0.0)
    for k in range(round(duration / h)):
        u1, u2 = driven((k + 0.5) * h), driven((k + 1) * h)
        k1 = derivative(axes, state, u0)
        if k % every == 0:
            rows.append(k1[3])
            times.append(k * h)
        k2 = derivative(axes, state + 0.5 * h * k1, u1)
        k3 = derivative(axes, state + 0.5 * h * k2, u1)
        k4 = derivative(axes, state + h * k3, u2)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        u0 = u2
    return np.array(times), np.array(rows)


def sampled(
    t: np.ndarray,
    acceleration: np.ndarray,
    rng: np.random.Generator,
    rate: float,
    noise: float = 0.1,
    step: float = 0.0392,
    start: float = 0.0,
    end: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """An accelerometer's samples with its own clock, noise and steps; at rest before and after the move."""
    times = np.arange(start + rng.uniform(0, 1 / rate), t[-1] if end is None else end, 1 / rate)
    values = np.interp(times, t, acceleration, left=0.0, right=0.0) + rng.normal(0, noise, len(times))
    return times, step * np.round(values / step)


def static_orders(
    axes: Axes, lane: int, direction: int, correction: dict[int, complex], speed: float = 0.0
) -> dict[int, complex]:
    """Orders of the rotor's electrical angle less u where torques balance, by Newton's rule."""
    u = TURN / 256 * np.arange(256)
    w = u + phase_shift({n: np.full(256, c) for n, c in correction.items()}, u)
    lanes = axes.take(np.full(256, lane))
    pull = lanes.rail * lanes.radius + lanes.rotor_friction + lanes.viscous * speed / lanes.radius
    a = lanes.current * (1 + lanes.gain) * np.cos(w) + lanes.offset_a
    b = lanes.current * (np.sin(w) + lanes.quadrature * np.cos(w)) + lanes.offset_b

    def rest(te: np.ndarray) -> np.ndarray:
        coils = -a * (np.sin(te) + lanes.third * np.sin(3 * te)) + b * (
            np.cos(te) - lanes.third * np.cos(3 * te)
        )
        return (
            lanes.K_t * coils - lanes.detent * np.sin(4 * te + lanes.detent_phase) - direction * pull
        ) / lanes.holding

    te = w.copy()
    for _ in range(40):
        te = te - rest(te) * 1e-6 / (rest(te + 1e-6) - rest(te))
    spectrum = np.fft.fft(te - u) * 2j / 256
    return {n: complex(spectrum[n]) for n in (1, 2, 4)}


def constant_speed(speeds: np.ndarray, ramp_time: float = 0.15) -> Callable[[float], np.ndarray]:
    """Commanded positions over time, m: they speed up evenly to these speeds; a negative speed goes back."""

    def way(t: float) -> np.ndarray:
        return speeds * (0.5 * t * t / ramp_time if t < ramp_time else t - 0.5 * ramp_time) + 0.0123

    return way


def ripple_rms(
    axes: Axes,
    speeds: np.ndarray,
    correction: dict[int, np.ndarray],
    settle: float = 0.6,
    length: float = 0.4,
) -> np.ndarray:
    """Rms of the carriage's displacement by the electrical orders 1 to 6 and 8 at these signed speeds, m."""
    t, acceleration = accelerations(axes, constant_speed(speeds), correction, settle + length)
    chosen = t > settle
    squares = np.zeros(len(speeds))
    for lane, speed in enumerate(speeds):
        omega = axes.teeth / axes.radius * speed
        waves = [f(n * omega * t[chosen]) for n in (1, 2, 3, 4, 5, 6, 8) for f in (np.sin, np.cos)]
        matrix = np.column_stack([np.ones(np.count_nonzero(chosen)), *waves])
        fit, *_ = np.linalg.lstsq(matrix, acceleration[chosen, lane], rcond=None)
        sizes = np.hypot(fit[1::2], fit[2::2]) / (np.array([1, 2, 3, 4, 5, 6, 8]) * omega) ** 2
        squares[lane] = np.sum(sizes**2) / 2
    return np.sqrt(squares)


def order_sizes(axes: Axes, speeds: np.ndarray, correction: dict[int, np.ndarray]) -> np.ndarray:
    """Amplitudes of the first axis's displacement at constant speeds, m: a row for each speed, a column for
    each order 1 to 8."""
    lanes = axes.take(np.zeros(len(speeds), int))
    t, acceleration = accelerations(lanes, constant_speed(speeds), correction, 1.0)
    late, omega, orders = t > 0.7, axes.teeth / axes.radius * speeds, np.arange(1, 9)
    sizes = []
    for lane, w in enumerate(omega):
        waves = [f(m * w * t[late]) for m in orders for f in (np.sin, np.cos)]
        matrix = np.column_stack([np.ones(np.count_nonzero(late)), *waves])
        fit, *_ = np.linalg.lstsq(matrix, acceleration[late, lane], rcond=None)
        sizes.append(np.hypot(fit[1::2], fit[2::2]) / (orders * w) ** 2)
    return np.array(sizes)
