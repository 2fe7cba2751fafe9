"""A drive's plant as its law sees it: through a position sensor that is late, and a speed that is an average.

The law's state at sample p is not x(p). Its angle is that of the time p T - latency, and its speed comes from
two angles, or from an observer or a low-pass filter behind them. Each of these is a linear function of the
plant's state at a time between two samples. There the input is held, so exact sampling gives the value from
the state and the input of the sample before, and a shift register brings it to the law:

    z_1(p+1) = c [A(phi) x(p) + B(phi) u(p)],  z_2(p+1) = z_1(p), ..     phi = j T - delay in [0, T)

docs/theory/trial-design.md#the-sensor says which results include this delay. quantisation.py has the steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.design.trials.model import Model, Real, exponential
from cogless.design.trials.response import Complex, Disturbed

DELAY_ROUNDING = 1e-9  # share of a sample that counts as no delay


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """What a law of trials gets of a drive's angle and speed."""

    latency: float = 0.0  # s, age of the angle
    window: float = 0.0  # s, over which the speed is the mean; 0: it is the true one, or an observer's
    bandwidth: float = 0.0  # rad/s, of the observer that gives the speed; 0: none
    speed_filter: float = 0.0  # rad/s, of the low-pass behind the speed; 0: none
    step: float = 0.0  # rad, of the angle
    certified: bool = True  # False: of the sensor the design takes only what the steps leave at the floor
    timed: bool = False  # edges of the angle are timed, so that its steps leave hardly an error of the speed

    @property
    def at_once(self) -> bool:
        """Whether the law's state is the plant's, up to the steps."""
        return not (self.certified and (self.latency or self.window or self.bandwidth or self.speed_filter))

    @property
    def smoothing(self) -> tuple[Real, Real, Real, Real]:
        """Continuous filter between angle and speed: A, b, its output, and its state at a steady turn.

        The state for an angle of zero is the last array times the speed. Without observer and low-pass the
        filter has no state.
        """
        if not self.bandwidth and not self.speed_filter:
            return np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0)
        if not self.bandwidth:  # a low-pass of the angle: its difference over the window is that of the speed
            w = self.speed_filter
            return np.array([[-w]]), np.array([w]), np.array([1.0]), np.array([-1 / w])
        w = self.bandwidth  # angle_observer.c: three poles at w
        gains = np.array([3 * w, 3 * w**2, w**3])
        A = np.diag([1.0, 1.0], 1) - np.outer(gains, [1.0, 0.0, 0.0])
        turn = np.array([0.0, 1.0, 0.0])
        if not self.speed_filter:
            return A, gains, turn, turn
        w = self.speed_filter
        A = np.block([[A, np.zeros((3, 1))], [w * turn, np.array([[-w]])]])
        return A, np.append(gains, 0.0), np.array([0.0, 0, 0, 1]), np.array([0.0, 1, 0, 1])

    def errors(self, w: Real, period: float) -> list[Complex]:
        """Errors of angle and speed per error of one angle, at w in rad per sample, (2, len(w)) each.

        The first entry is for the error of this sample's angle. With a window, the second is for the error of
        the angle at the window's begin, which is another error.
        """
        s = 1j * w / period
        A, b, c, _ = self.smoothing
        smooth: Complex = np.ones(len(w), dtype=complex)
        if len(A):
            inverse = np.linalg.inv(s[:, None, None] * np.eye(len(A)) - A)
            smooth = np.asarray((inverse @ b.astype(complex)) @ c, dtype=complex)
        angle, none = np.ones_like(smooth), np.zeros_like(smooth)
        if self.timed:
            return [np.array([angle, none])]
        if self.window:
            return [np.array([angle, smooth / self.window]), np.array([none, smooth / self.window])]
        return [np.array([angle, smooth if self.bandwidth else none])]

    def powers(self, path: Disturbed, w: Real, period: float) -> Real:
        """|T|^2 from white noise of the angle to output, lesson and input, at w in rad per sample; (3, w)."""
        responses = [path.through(errors, w) for errors in self.errors(w, period)]
        return np.asarray(np.sum(np.abs(responses) ** 2, axis=0))


def sensed(plant: Model, C: Real, period: float, sensor: Sensor) -> Model:
    """The exactly sampled plant with the states that the sensor adds.

    Its first state in C x is the angle, and the change of C x is the speed.
    """
    if sensor.at_once:
        return plant
    n = plant.order
    A_f, b_f, c_f, turn = sensor.smoothing
    m = len(A_f)
    # the plant and the filter in continuous time, and the input: it is held
    rates = np.zeros((n + m + 1, n + m + 1))
    assert plant.continuous is not None
    A_c, B_c = plant.continuous.A, plant.continuous.B
    rates[:n, :n], rates[:n, -1] = A_c, B_c[:, 0]
    rates[n : n + m, :n], rates[n : n + m, n : n + m] = np.outer(b_f, C), A_f
    angle, smooth = np.append(C, np.zeros(m + 1)), np.concatenate([np.zeros(n), c_f, [0.0]])
    speed = np.append(C @ A_c, np.zeros(m + 1))
    # the state at a time s before the start, if the axis came at its present speed
    steady = np.zeros((n + m, n))
    steady[:n] = np.eye(n)
    if m:
        steady[n:] = np.outer(turn, C @ A_c)
        follows = np.array([1.0]) if not sensor.bandwidth else np.eye(1, m)[0]
        steady[n:] += np.outer(follows, C)
    back = steady @ np.linalg.pinv(C[None, :])[:, 0]  # the steady values if only the angle changes, by 1

    register: list[tuple[Real, float]] = []

    def late(row: Real, delay: float) -> int:
        """Register a row whose value is needed `delay` s later, and return its index in the register."""
        register.append((row, delay))
        return len(register) - 1

    source = smooth if m else angle
    if m and not sensor.window and not sensor.bandwidth:
        source = sensor.speed_filter * (angle - smooth)
    elif not m and not sensor.window:
        source = speed
    first, second = late(angle, sensor.latency), late(source, sensor.latency)
    third = late(source, sensor.latency + sensor.window) if sensor.window else None

    counts = [max(0, math.ceil(delay / period - DELAY_ROUNDING)) for _, delay in register]
    size = n + m + sum(counts)
    A, B = np.zeros((size, size)), np.zeros((size, 1))
    whole = exponential(rates * period)
    A[: n + m, : n + m], B[: n + m, 0] = whole[:-1, :-1], whole[:-1, -1]
    values = np.zeros((len(register), size))
    lift = np.zeros((size, n))
    lift[: n + m] = steady
    at = n + m
    for k, ((row, delay), count) in enumerate(zip(register, counts, strict=True)):
        if not count:
            values[k, : n + m] = row[:-1]
            continue
        within = exponential(rates * max(0.0, count * period - delay))
        A[at, : n + m], B[at, 0] = (row @ within)[:-1], float((row @ within)[-1])
        for j in range(1, count):
            A[at + j, at + j - 1] = 1.0
        for j in range(count):
            ago = delay - (count - 1 - j) * period
            lift[at + j] = row[:-1] @ steady - ago * (row[:-1] @ back) * (C @ A_c)
        values[k, at + count - 1] = 1.0
        at += count
    omega = values[second] if third is None else (values[second] - values[third]) / sensor.window
    seen = np.linalg.inv(np.vstack([C, C @ A_c])) @ np.vstack([values[first], omega])
    return Model(A, B, seen=seen, lift=lift, base=plant)
