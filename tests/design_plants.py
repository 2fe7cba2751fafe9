"""Uncertain plants and plain NumPy simulations for the tests of design/."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from reference.trial import zero_phase
from scipy.linalg import toeplitz

from cogless.design.trials.gains import TrialDesign, TrialSettings
from cogless.design.trials.model import Model, Real
from cogless.design.trials.polytope import UncertainPlant, from_parameters

MANDRA_RANGES = {"inertia": (5.9e-4, 10.6e-4), "friction": (1.3e-3, 1.5e-3), "torque_constant": (0.35, 0.39)}
Q = np.diag([1.8e4, 0.1, 4.0])
R = 0.9
START = np.array([0.01, 0.0, 0.0])


def motor(p: Mapping[str, float]) -> tuple[list[list[float]], list[list[float]]]:
    """A and B of mandra2019 (37); the states are angle and speed."""
    J, B, k = p["inertia"], p["friction"], p["torque_constant"]
    return [[0, 1], [0, -B / J]], [[0], [k / J]]


def mandra(discretisation: str = "euler") -> UncertainPlant:
    """The uncertain motor of mandra2019, Section 6.1."""
    return from_parameters(motor, MANDRA_RANGES, [1, 0], 2.5e-3, discretisation)


def mandra_settings(**changes: object) -> TrialSettings:
    """Settings of mandra2019, Sections 6.1 and 6.2; the feedforward (41) inverts Euler's model."""
    section = {"Q": Q, "R": R, "gamma": START, "f": START, "g": 0.1, "inverted": "euler"}
    return TrialSettings(**{"samples": 1000, **section, **changes})


def speed(p: Mapping[str, float]) -> tuple[list[list[float]], list[list[float]]]:
    """A and B of a drive whose output is its speed: relative degree 1."""
    return [[-p["friction"] / p["inertia"]]], [[p["torque_constant"] / p["inertia"]]]


def two_masses(p: Mapping[str, float]) -> tuple[list[list[float]], list[list[float]]]:
    """A and B of two masses with a shaft between them: load angle and speed, motor angle and speed; torque at
    the motor."""
    J_M, J_L, k, c, b = 5e-4, p["load_inertia"], p["stiffness"], 0.02, 1e-3
    A = [
        [0, 1, 0, 0],
        [-k / J_L, -(c + b) / J_L, k / J_L, c / J_L],
        [0, 0, 0, 1],
        [k / J_M, c / J_M, -k / J_M, -(c + b) / J_M],
    ]
    return A, [[0], [0], [0], [0.37 / J_M]]


def drive_train(discretisation: str = "exact") -> UncertainPlant:
    """Load of 7 to 9 kg cm^2 on a shaft of 90 to 110 N m/rad, a resonance near 90 Hz, at 1 kHz."""
    ranges = {"load_inertia": (7e-4, 9e-4), "stiffness": (90.0, 110.0)}
    return from_parameters(two_masses, ranges, [1, 0, 0, 0], 1e-3, discretisation)


def simulate(design: TrialDesign, model: Model, y_ref: Real, trials: int, load: float = 0.0) -> Real:
    """Errors (trials, samples) of the law at the head of design/trials/gains.py, without limits.

    They start from y_ref[0] at rest.
    """
    samples, n = len(y_ref), model.order
    v, errors = np.zeros(samples), np.zeros((trials, samples))
    B = model.B[:, 0]
    # for state and psi together: next value = closed @ present value + what enters
    closed = np.zeros((n + 1, n + 1))
    closed[:n, :n], closed[:n, n] = model.A + np.outer(B, design.K_1), B * design.K_2
    closed[n, :n], closed[n, n] = -np.asarray(design.C), 1.0

    def outputs(u: Real, psi: Real) -> Real:
        """Outputs for what enters: u at the plant's input, psi at the integral."""
        enters = np.outer(u, np.append(B, 0.0))
        enters[:, n] = psi
        x, states = np.zeros(n + 1), np.zeros((samples, n + 1))
        for p in range(samples):
            states[p] = x
            x = closed @ x + enters[p]
        return np.asarray(states[:, :n] @ design.C)

    unlearned = y_ref - outputs(_feedforward(design, y_ref) - load, y_ref)
    impulse = np.eye(samples)[0]
    learned = toeplitz(outputs(design.N * impulse, design.through_integrator * impulse), np.zeros(samples))
    for k in range(trials):
        errors[k] = unlearned - learned @ v
        v = learn(design, v, errors[k])
    return errors


def learn(design: TrialDesign, v: Real, error: Real) -> Real:
    """v after a trial with this error."""
    e = error.copy()
    e[: design.shift] = 0.0
    if design.learning_matrix is not None:
        return np.asarray(v + design.learning_matrix @ e)

    def smooth(x: Real) -> Real:
        q = design.q_filter
        return x if q is None else zero_phase(q.b, q.a, x, q.odd)

    def ahead(x: Real) -> Real:
        return np.append(x[design.shift :], np.full(design.shift, x[-1]))

    if design.filtered == "error":
        return np.asarray(v + design.K_3 * ahead(smooth(e)))
    return smooth(v + design.K_3 * ahead(e))


def _feedforward(design: TrialDesign, y_ref: Real) -> Real:
    """The feedforward (41) of y_ref, which is zero before its first sample and stays at its last value."""
    f = np.zeros(len(y_ref))
    if design.feedforward is None:
        return f
    num, den, preview = design.feedforward.num, design.feedforward.den, design.feedforward.preview

    def ref(q: int) -> float:
        return float(y_ref[min(q, len(y_ref) - 1)]) if q >= 0 else 0.0

    for p in range(len(y_ref)):
        f[p] = sum(c * ref(p + preview - i) for i, c in enumerate(num))
        f[p] -= sum(c * f[p - i] for i, c in enumerate(den) if 0 < i <= p)
    return f


def smooth_step(samples: int, height: float = 1.0) -> Real:
    """A motion from rest to rest within the first half, three times differentiable."""
    s = np.clip(np.arange(samples) / (samples / 2), 0, 1)
    return np.asarray(height * (35 * s**4 - 84 * s**5 + 70 * s**6 - 20 * s**7))


def rms(errors: Real) -> Real:
    """RMS of each trial's errors."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=-1)))


class Unseen:
    """A stand-in for a bundle of loops, where nothing reads their responses."""

    grid = np.zeros(1)

    def __init__(self, *of: Any) -> None:
        pass

    def __call__(self, w: Any) -> None:
        pass
