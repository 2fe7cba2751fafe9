"""What docs/guide/printers.md says of CoreXY: two motors with one carriage are two axes of half its mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from printer.printer_plant import Axes, derivative, random_axes
from scipy.integrate import solve_ivp

MASS, DURATION = 0.5, 0.25  # kg, s
ONE = random_axes(2, 1)
MOTORS = replace(  # with errors of their own, on like belts, and rails without Coulomb friction
    ONE, mass=np.full(2, MASS / 2), belt=np.full(2, 5e4), damping=np.full(2, 10.0), rail=np.zeros(2)
)


def single(axes: Axes, lane: int, speed: float, times: np.ndarray) -> np.ndarray:
    """The way of a belt whose motor turns alone, m."""
    scale, one = axes.teeth / axes.radius, axes.take(np.array([lane]))

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        return derivative(one, state[:, None], np.array([scale * speed * t]))[:, 0]

    start = np.array([0.0, speed / axes.radius, 0.0, speed])
    return solved(slope, start, times)[2]


def both(axes: Axes, speeds: np.ndarray, times: np.ndarray) -> np.ndarray:
    """x and y of a carriage of mass MASS between two motors, m, by Lagrange's equations in x and y."""
    scale = axes.teeth / axes.radius

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        theta, omega, place, velocity = state.reshape(4, 2)
        x, y = place
        belts = np.array([x + y, x - y])
        rates = np.array([velocity[0] + velocity[1], velocity[0] - velocity[1]])
        pull = axes.belt * (axes.radius * theta - belts) + axes.damping * (axes.radius * omega - rates)
        rotors = derivative(axes, np.stack([theta, omega, belts, rates]), scale * speeds * t)[1]
        push = np.array([pull[0] + pull[1], pull[0] - pull[1]]) / MASS
        return np.concatenate([omega, rotors, velocity, push])

    x, y = 0.5 * (speeds[0] + speeds[1]), 0.5 * (speeds[0] - speeds[1])
    start = np.concatenate([[0.0, 0.0], speeds / axes.radius, [0.0, 0.0], [x, y]])
    return solved(slope, start, times)[4:6]


def solved(slope: object, start: np.ndarray, times: np.ndarray) -> np.ndarray:
    result = solve_ivp(
        slope, (0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-12, method="DOP853", max_step=5e-4
    )
    return np.asarray(result.y)


@pytest.mark.parametrize("speeds", [(0.06, 0.0), (0.06, 0.06)])
def test_each_motor_moves_half_the_mass_of_its_own(speeds: tuple[float, float]) -> None:
    """One motor alone along a diagonal, and both along x: ripple along x and across it."""
    times = np.linspace(0, DURATION, 501)
    s_a, s_b = (single(MOTORS, lane, speed, times) for lane, speed in enumerate(speeds))
    x, y = both(MOTORS, np.array(speeds), times)
    ripple = np.ptp(s_a - speeds[0] * times)
    assert ripple > 2e-6
    assert x == pytest.approx((s_a + s_b) / 2, abs=1e-3 * ripple)
    assert y == pytest.approx((s_a - s_b) / 2, abs=1e-3 * ripple)
    if speeds[1]:
        assert np.ptp(y) > 0.1 * ripple  # Both motors' errors differ, so a wall along x has ripple across it.
    else:
        still = np.ptp(s_b)
        assert np.hypot(x, y) == pytest.approx(s_a / np.sqrt(2), abs=1e-3 * ripple + still)
