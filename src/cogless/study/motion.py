"""Sample the motion of a scenario's reference: speed and acceleration over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cogless.study.reference import Reference
from cogless.study.scenario import Scenario
from cogless.units import TURN

Real = NDArray[np.float64]
SAMPLES_LEAST, SAMPLES_MOST = 4000, 200_000  # samples
A_SWING, A_PIECE = 40, 10  # samples per period of the fastest sine; per shortest piece or smoothing time
GOLDEN_SECTION = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Course:
    """Samples in order of time; each represents an interval of `step` s."""

    time: Real  # s
    omega: Real  # rad/s, mechanical
    alpha: Real  # rad/s^2
    step: float  # s


def course(scenario: Scenario) -> Course:
    """Sample a scenario's reference over its duration.

    The position of each sample within its step follows multiples of the golden ratio. With even steps, an
    oscillation at the sampling rate could be missed.
    """
    reference, end = scenario.reference, scenario.duration
    pieces = [b - a for (a, _), (b, _) in pairwise(reference.points or reference.moves)]
    pieces += [reference.smoothing] if reference.smoothing else []
    samples = end * max(A_SWING * _fastest(reference), A_PIECE / min([*pieces, end]))
    count = min(max(math.ceil(samples), SAMPLES_LEAST), SAMPLES_MOST)
    places = np.arange(count)
    time = (places + places * GOLDEN_SECTION % 1) * end / count
    omega, alpha = _unfiltered(reference, scenario.initial_speed, time)
    if reference.smoothing:
        omega, alpha = _smoothed(time, omega, reference.smoothing, scenario.initial_speed)
    return Course(time, omega, alpha, end / count)


def _fastest(reference: Reference) -> float:
    """Frequency of the fastest part of the reference, Hz."""
    modulated = reference.frequency + abs(reference.depth) * reference.modulation
    return max([modulated, *(sine.frequency for sine in reference.sines)])


def _unfiltered(reference: Reference, initial_speed: float, t: Real) -> tuple[Real, Real]:
    """Reference speed, rad/s, and acceleration, rad/s^2, at times t, s, before the smoothing filter."""
    r = reference
    if r.kind == "ramp":
        change = r.speed - initial_speed
        moving = r.ramp * t < abs(change)
        slope = math.copysign(r.ramp, change)
        return np.where(moving, initial_speed + slope * t, r.speed), np.where(moving, slope, 0.0)
    if r.points:
        times, speeds = np.array(r.points).T
        slopes = np.concatenate(([0.0], np.diff(speeds) / np.diff(times), [0.0]))
        return np.interp(t, times, speeds), slopes[np.searchsorted(times, t, side="right")]
    if r.moves:
        return _moves(r, t)
    omega, alpha = np.full(len(t), r.speed + r.offset), np.zeros(len(t))
    swing = TURN * r.modulation
    angle = TURN * r.frequency * t + r.depth * np.sin(swing * t)
    omega += r.amplitude * np.sin(angle)
    alpha += r.amplitude * np.cos(angle) * (TURN * r.frequency + r.depth * swing * np.cos(swing * t))
    for sine in r.sines:
        omega += sine.amplitude * np.sin(TURN * sine.frequency * t + sine.phase)
        alpha += sine.amplitude * TURN * sine.frequency * np.cos(TURN * sine.frequency * t + sine.phase)
    return omega, alpha


def _moves(reference: Reference, t: Real) -> tuple[Real, Real]:
    omega, alpha = np.zeros(len(t)), np.zeros(len(t))
    for (start, a), (end, b) in pairwise(reference.moves):
        s, rate = np.clip((t - start) / (end - start), 0.0, 1.0), 1 / (end - start)
        omega += (b - a) * rate * 30 * s**2 * (1 - s) ** 2
        alpha += (b - a) * rate**2 * 60 * s * (1 - s) * (1 - 2 * s)
    return omega, alpha


def _smoothed(t: Real, omega: Real, tau: float, initial_speed: float) -> tuple[Real, Real]:
    """Speed and acceleration after two first-order lags of time constant tau.

    Each lag is computed exactly for an input that is linear between samples.
    """
    first = _lagged(t, omega, tau, initial_speed)
    second = _lagged(t, first, tau, initial_speed)
    return second, (first - second) / tau


def _lagged(t: Real, x: Real, tau: float, start: float) -> Real:
    y, lagged, before = start, np.empty(len(t)), 0.0
    last = float(x[0])
    for k, (now, value) in enumerate(zip(t.tolist(), x.tolist(), strict=True)):
        h = (now - before) / tau
        decay = math.exp(-h)
        mean = -math.expm1(-h) / h if h > 0 else 1.0
        y = decay * y + (1 - mean) * value + (mean - decay) * last
        lagged[k], before, last = y, now, value
    return lagged
