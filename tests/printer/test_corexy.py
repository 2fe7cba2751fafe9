"""What docs/theory/plant.md says of CoreXY: x and y are axes of their own, each with half of its mass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from printer.printer_bench import FILE, PROBE
from printer.printer_plant import SLIDING_SPEED, derivative, phase_shift, random_axes, sampled, static_orders
from scipy.integrate import solve_ivp

from cogless.printer.axis import read_axis
from cogless.printer.moves import ramp
from cogless.printer.ramps import identify_ramps
from cogless.printer.records import Run

Slope = Callable[[float, np.ndarray], np.ndarray]
Orders = Mapping[int, np.ndarray]

MASS = 0.5  # kg, along x
TIMES = np.linspace(0, 0.4, 801)  # s
SMOOTH = (0.0, 0.0)  # N, of rails
LATE = TIMES > 0.2  # s, when the start has died away
MOTORS = replace(  # with errors of their own, on like belts
    random_axes(2, 1), belt=np.full(2, 5e4), damping=np.full(2, 10.0), rail=np.zeros(2)
)


@cache
def single(lane: int, speed: float, mass: float, rail: float) -> np.ndarray:
    """The ripple of a belt with half of a mass and of a rail's friction, m: the way less the command."""
    axes = replace(MOTORS, mass=np.full(2, mass / 2), rail=np.full(2, rail / 2)).take(np.array([lane]))
    scale = axes.teeth / axes.radius

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        return derivative(axes, state[:, None], np.array([scale * speed * t]))[:, 0]

    start = np.array([0.0, speed / axes.radius, 0.0, speed])
    return solved(slope, start, TIMES)[2] - speed * TIMES


def coupled(
    ways: Callable[[float], np.ndarray],
    masses: tuple[float, float],
    rails: tuple[float, float],
    orders: Orders,
) -> Slope:
    """The rates of two rotors, x and y by Lagrange's equations, each a row, a column a run.

    `ways`: of both belts, as commanded, m. `orders`: of the correction in the first driver, in each run.
    """
    axes = MOTORS.take(np.array([[0], [1]]))
    scale, mass, rail = axes.teeth / axes.radius, np.array(masses)[:, None], np.array(rails)[:, None]

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        theta, omega, place, velocity = state.reshape(4, 2, -1)
        x, y = place
        belts = np.array([x + y, x - y])
        rates = np.array([velocity[0] + velocity[1], velocity[0] - velocity[1]])
        pull = axes.belt * (axes.radius * theta - belts) + axes.damping * (axes.radius * omega - rates)
        angles = scale * ways(t)[:, None] + np.zeros_like(theta)
        angles[0] += phase_shift(orders, angles[0])
        rotors = derivative(axes, np.stack([theta, omega, belts, rates]), angles)[1]
        push = np.array([pull[0] + pull[1], pull[0] - pull[1]]) - rail * np.tanh(velocity / SLIDING_SPEED)
        return np.concatenate([omega, rotors, velocity, push / mass]).reshape(state.shape)

    return slope


def both(speeds: tuple[float, float], masses: tuple[float, float], rails: tuple[float, float]) -> np.ndarray:
    """Ripple of x and y between two motors at constant speeds of their belts, m."""
    belts = np.array(speeds)
    slope = coupled(lambda t: belts * t, masses, rails, {})
    velocity = 0.5 * np.array([belts[0] + belts[1], belts[0] - belts[1]])
    start = np.concatenate([[0.0, 0.0], belts / MOTORS.radius, [0.0, 0.0], velocity])
    return solved(slope, start, TIMES)[4:6] - velocity[:, None] * TIMES


def solved(slope: Slope, start: np.ndarray, times: np.ndarray) -> np.ndarray:
    result = solve_ivp(
        slope, (0, times[-1]), start, t_eval=times, rtol=1e-7, atol=1e-11, method="DOP853", max_step=1e-3
    )
    return np.asarray(result.y)


def halves(
    speeds: tuple[float, float], masses: tuple[float, float], rails: tuple[float, float]
) -> np.ndarray:
    """Ripple of x and y, m, from runs of a motor: half the sum for x's mass, half the difference for y's."""
    a, b = (
        [single(lane, speed, mass, rail) for mass, rail in zip(masses, rails, strict=True)]
        for lane, speed in enumerate(speeds)
    )
    return np.array([a[0] + b[0], a[1] - b[1]]) / 2


def rms(ripple: np.ndarray) -> np.ndarray:
    return np.std(ripple[..., LATE], axis=-1)


@pytest.mark.parametrize("speeds", [(0.06, 0.0), (0.06, 0.06)])
def test_each_motor_moves_half_of_a_mass_that_is_the_same_along_x_and_y(speeds: tuple[float, float]) -> None:
    """One motor alone along a diagonal, and both along x: ripple along x and across it."""
    ripple = both(speeds, (MASS, MASS), SMOOTH)
    assert ripple == pytest.approx(halves(speeds, (MASS, MASS), SMOOTH), abs=1e-3 * np.ptp(ripple))
    assert np.all(rms(ripple) > 1e-6)  # Both motors' errors differ, so a wall along x has ripple across it.


# Ripple across a move along x, um rms, by y's mass over x's and by the speed in m/s.
ACROSS = {
    (1.0, 0.04): 1.6,
    (1.0, 0.06): 1.6,
    (1.5, 0.04): 3.6,
    (1.5, 0.06): 0.56,
    (2.0, 0.04): 2.9,
    (2.0, 0.06): 0.34,
}


@pytest.mark.parametrize("speed", [0.04, 0.06])
@pytest.mark.parametrize("ratio", [1.5, 2.0])
def test_x_and_y_of_other_masses_are_axes_of_their_own(ratio: float, speed: float) -> None:
    """A move along x: both motors turn alike, whatever the masses are."""
    speeds, masses = (speed, speed), (MASS, ratio * MASS)
    ripple, forecast = both(speeds, masses, SMOOTH), halves(speeds, masses, SMOOTH)
    assert np.all(rms(ripple - forecast) < 0.02 * rms(ripple))
    wrong = halves(speeds, (MASS, MASS), SMOOTH)
    assert 1e6 * rms(ripple)[1] == pytest.approx(ACROSS[ratio, speed], rel=0.03)
    assert 1e6 * rms(wrong)[1] == pytest.approx(ACROSS[1.0, speed], rel=0.03)


def test_a_rail_s_friction_is_half_of_each_motor_s_and_holds_the_other_axis() -> None:
    """A move along x, where y's rail sticks: x is as without that, and the ripple across is gone."""
    speeds, masses = (0.06, 0.06), (MASS, 2 * MASS)
    for rails in ((2.0, 0.0), (0.0, 2.0)):
        ripple, forecast = (
            both(speeds, masses, rails),
            halves(speeds, masses, (rails[0], 0.0)),
        )
        assert rms(ripple - forecast)[0] < 0.02 * rms(ripple)[0]
        assert (rms(ripple)[1] < 0.3 * rms(forecast)[1]) == (rails[1] > 0)
    slides, free = (halves(speeds, masses, (rail, 0.0))[0] for rail in (2.0, 0.0))
    assert rms(slides - free) > 0.02 * rms(free)  # Friction turns order 4, so it must be in the run.


def test_a_motor_that_stands_is_a_spring_of_its_own() -> None:
    """One motor alone: the other's detent makes its spring another, which moves x by some percent."""
    speeds, masses = (0.06, 0.0), (MASS, 2 * MASS)
    ripple, forecast = (
        both(speeds, masses, SMOOTH),
        halves(speeds, masses, SMOOTH),
    )
    assert rms(ripple)[0] == pytest.approx(rms(forecast)[0], rel=0.06)
    assert rms(ripple)[1] == pytest.approx(rms(forecast)[1], rel=0.25)


def test_a_correction_is_identified_whatever_the_masses_are(tmp_path: Path) -> None:
    """One motor's ramps along a diagonal: the carriage's answer, with two masses in it, cancels."""
    (tmp_path / "printer.toml").write_text(FILE + 'kinematics = "corexy"\n')
    axis = read_axis(tmp_path / "printer.toml")
    move, rng, step = ramp(axis), np.random.default_rng(1), 2e-4

    def ways(t: float) -> np.ndarray:
        return np.array([np.sqrt(2) * float(move.position_at(np.array(min(t, move.duration)))), 0.0])

    slope = coupled(ways, (MASS, 2 * MASS), SMOOTH, {n: np.array([0, c]) for n, c in PROBE.items()})
    state, rows = np.zeros((8, 2)), []
    times = step * np.arange(round((move.duration + 0.3) / step))
    for t in times:  # by classic Runge and Kutta, both runs side by side
        k1 = slope(t, state)
        k2 = slope(t + step / 2, state + step / 2 * k1)
        k3 = slope(t + step / 2, state + step / 2 * k2)
        k4 = slope(t + step, state + step * k3)
        rows.append((k1[6] + k1[7]) / np.sqrt(2))
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    plain, probed = (
        Run(kind, "forward", *sampled(times, np.array(rows)[:, k], rng, 3200, 0.1, start=-0.5), correction)
        for k, (kind, correction) in enumerate({"plain": {}, "probe": PROBE}.items())
    )
    coefficients = identify_ramps(axis, [(plain, probed)]).coefficients
    exact = static_orders(MOTORS, 0, 1, {}, 0.1)
    assert all(abs(coefficients[n].value + exact[n]) < 0.004 for n in exact)
