"""A motor of a few lines: its q axis, sample by sample, with current loop, observer, PI and a load."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cogless.design.closed_loop import Linear
from cogless.design.speed_loop import CurrentLoop, observer_step, speed_loop
from cogless.study import Study

STEPS = 20  # of explicit Euler in a period of the current loop


def speeds(
    study: Study,
    feedback: Linear,
    *,
    omega_ref: float,
    start: float,
    duration: float,
    load: Callable[[float, float], float] = lambda theta, omega: 0.0,
) -> NDArray[np.float64]:
    """Speeds, rad/s, in each period of the current loop, from `start` on; `load`: N m, of angle and speed."""
    loop, motor, drive = speed_loop(study), study.motor.star(), study.drive
    current, T = loop.current, 1 / drive.rates.current_loop
    assert isinstance(current, CurrentLoop)
    K_e, K_t, h = motor.pole_pairs * motor.psi_f, motor.K_t, T / STEPS
    (matrix, gains), ages = observer_step(loop.bandwidth, T), round(loop.delay / T)
    i = integral = waiting = integral_speed = i_ref = theta = 0.0
    omega, seen, angles = start, np.array([0.0, omega_ref * T, 0.0]), [0.0] * (ages + 1)
    reached = np.empty(round(duration / T))
    for n in range(len(reached)):
        angles = [theta, *angles[:-1]]
        seen = matrix @ seen + gains * angles[-1]
        measured = seen[1] / T
        if n % loop.steps == 0:
            integral_speed += feedback.k_i * loop.period * (omega_ref - measured)
            i_ref = integral_speed + feedback.k * (omega_ref - measured)
        u = current.kp * (i_ref - i) + integral
        integral += current.ki * T * (i_ref - i)
        if drive.current_loop.decoupling:
            u += K_e * measured
        acting, waiting = (waiting, u) if current.delay else (u, u)
        for _ in range(STEPS):
            i += h / current.L * (acting - current.R * i - K_e * omega)
            omega += h / study.mechanics.inertia * (K_t * i + load(theta, omega))
            theta += h * omega
        reached[n] = omega
    return reached


def growth(study: Study, feedback: Linear) -> float:
    """Rate, 1/s, at which a small disturbance of the speed loop grows."""
    duration = 1.5
    size = np.abs(speeds(study, feedback, omega_ref=0.0, start=1e-3, duration=duration))
    third = len(size) // 3
    return math.log(np.max(size[2 * third :]) / np.max(size[third : 2 * third])) / (duration / 3)
