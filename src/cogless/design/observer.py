"""Response of the speed observer, control/src/cogless/angle_observer.c, at the current loop's rate."""

from __future__ import annotations

import math

import numpy as np

from cogless.design.margins import Complex, Real


def observer_step(bandwidth: float, period: float) -> tuple[Real, Real]:
    """M and l of x' = M x + l theta_m', a step of the observer of x = (theta, T omega, T^2 alpha).

    `bandwidth`: of the three poles, rad/s. `period`: of the observer, T in s.
    """
    p = math.exp(-bandwidth * period)
    gains = np.array([1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p), (1 - p) ** 3])
    predict = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
    return predict - np.outer(gains, predict[0]), gains


def observed(w: Real, bandwidth: float, period: float) -> Complex:
    """Response from the sampled angle to the observed speed, 1/s, at w in rad/s."""
    step, gains = observer_step(bandwidth, period)
    z = np.exp(1j * np.asarray(w) * period)
    x = np.linalg.solve(
        np.eye(3) - step / z[..., None, None], np.broadcast_to(gains[:, None], (*z.shape, 3, 1))
    )
    return np.asarray(x[..., 1, 0] / period)


def counting_window(bandwidth: float, period: float) -> float:
    """Length, s, of a counting window whose speed is as noisy as the observer's, from the same steps."""
    circle = np.linspace(0, math.pi / period, 4097)
    return math.sqrt(
        2 / float(np.trapezoid(np.abs(observed(circle, bandwidth, period)) ** 2, circle) / circle[-1])
    )
