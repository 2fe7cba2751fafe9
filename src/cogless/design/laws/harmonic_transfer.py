"""What the law `harmonic` sees of a ripple, over what it assumes to see: docs/laws/harmonic.md.

Gamma is a factor on the rate at which an order n learns: what the law sees of a ripple in T at that order,
over what it assumes to see. P is the response from current reference to measured speed and angle
(speed_loop.py), C the PI, M the law's model of the angle, V its model of the delay:

    F = C (P_omega + k_theta P_theta),    M = b T^2 (z + 1) / (2 (z - 1)^2) V,    z = exp(jwT), w = n omega
    Gamma = (P_theta + M F) / (1 + F) / (b T^2 (z + 1) / (2 (z - 1)^2) exp(-jw delay))

Gamma is 1 if plant and model agree. The order converges, for a small rate, exactly if Re Gamma > 0.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from cogless.design.closed_loop import Gains
from cogless.design.margins import Complex, Real
from cogless.design.speed_loop import BELIEF_FACTORS, SpeedLoop, pi_response
from cogless.study.laws.harmonic import HARMONIC_BANDS, ORDER_ANGLE_MOST, Learner

POLE = math.exp(-0.5)  # pole of the observer in z: its bandwidth is half a radian a sample
SLOW_ORDER_ANGLE = 0.5105  # rad/sample; up to this an order learns from z, above this from e
ORDER_ANGLE_LEAST = 1e-3  # rad a sample: the slowest order that is judged
PHASE_COSINE_LEAST = math.cos(math.radians(60))  # least cos arg Gamma: an order turned by more is held
TRANSFER_POINTS = 2000  # frequencies at which Gamma is judged


def _shares(d: float, z: Complex) -> Complex:
    """V: the law's model of what a delay of d samples makes of its current."""
    if d > 1.5:
        pole = d / (1 + d)
        return np.asarray((1 - pole) / (1 - pole / z))
    m = int(d)
    return np.asarray(z ** -float(m) * (1 - (d - m) + (d - m) / z))


def gamma(loop: SpeedLoop, learner: Learner, pi: Gains, w: Real, late: int = 0) -> Complex:
    """Gamma at the frequencies w, rad/s, with a plant that is `late` samples later than `loop` says."""
    T = loop.period
    z = np.exp(1j * w * T)
    P_omega, P_theta = (np.asarray(P) * z**-late for P in loop.plant(w))
    k_theta, kp, ki = pi
    fed_back = pi_response(w, T, kp, ki) * (P_omega + k_theta * P_theta)
    model = learner.b * T**2 * (z + 1) / (2 * (z - 1) ** 2)
    seen = (P_theta + model * _shares(learner.delay / T, z) * fed_back) / (1 + fed_back)
    return np.asarray(seen / (model * np.exp(-1j * w * learner.delay)))


def plants(loop: SpeedLoop) -> list[SpeedLoop]:
    """The plants with which an order must converge: b, or a soft shaft's motor inertia, may be off."""
    loops = [dataclasses.replace(loop, b=factor * loop.b) for factor in BELIEF_FACTORS]
    if loop.shaft is not None:
        J, J_load = loop.shaft.inertia, loop.shaft.load_inertia
        for factor in BELIEF_FACTORS:
            shaft = dataclasses.replace(loop.shaft, inertia=factor * J)
            b = loop.b * (J + J_load) / (factor * J + J_load)
            loops.append(dataclasses.replace(loop, shaft=shaft, b=b))
    return loops


def at_speed(loop: SpeedLoop, sector: float, edges: int, omega: float) -> SpeedLoop:
    """The loop at a speed, rad/s. `sector`: angle between edges of Hall sensors, rad; 0: there are none."""
    return dataclasses.replace(loop, edge=sector / abs(omega), edges=edges) if sector else loop


def held_bands(
    loop: SpeedLoop, learner: Learner, pi: Gains, sector: float, edges: int, speeds: tuple[float, float]
) -> tuple[float, ...]:
    """Bands of frequency, from and to in rad a sample, in which an order may not converge.

    What Hall sensors show between their edges depends on the order. So each order is then judged at the
    frequencies that it has at `speeds`, slowest and fastest, rad/s.
    """
    T = loop.period
    om = np.geomspace(ORDER_ANGLE_LEAST, ORDER_ANGLE_MOST, TRANSFER_POINTS)
    if loop.near is not None:
        om = np.union1d(om, [x for x in loop.near * T if ORDER_ANGLE_LEAST < x < ORDER_ANGLE_MOST])
    bad = np.zeros(len(om), dtype=bool)
    if not sector:
        for plant in plants(loop):
            bad |= turned(gamma(plant, learner, pi, om / T))
    else:
        for n in learner.base * np.arange(1, learner.orders + 1):
            reached = (om >= n * speeds[0] * T / 1.05) & (om <= n * speeds[1] * T * 1.05)
            for plant in plants(loop):
                for k in np.flatnonzero(reached):
                    w = om[k : k + 1] / T
                    seen = at_speed(plant, sector, edges, float(w[0]) / float(n))
                    bad[k] |= bool(turned(gamma(seen, learner, pi, w))[0])
    return _few(_bands(om, bad))


def turned(transfer: Complex) -> np.ndarray:
    """Whether Gamma is turned so far, or is so small, that its order is held."""
    return np.asarray(transfer.real <= PHASE_COSINE_LEAST * np.abs(transfer))


def _bands(om: Real, bad: np.ndarray) -> list[tuple[float, float]]:
    """The bands of bad points, each from the last good point before to the first good point after."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(int)))
    bands = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        low = float(om[first - 1]) if first else 0.0
        bands.append((low, float(om[after]) if after < len(om) else math.pi))
    return bands


def _few(bands: list[tuple[float, float]]) -> tuple[float, ...]:
    """The ends of as many bands as the law can have; bands that are nearest to each other are merged."""
    while len(bands) > HARMONIC_BANDS:
        k = min(range(len(bands) - 1), key=lambda k: bands[k + 1][0] / bands[k][1])
        bands[k : k + 2] = [(bands[k][0], bands[k + 1][1])]
    return tuple(edge for band in bands for edge in band)


def is_held(learner: Learner, om: Real) -> np.ndarray:
    """Whether orders of these frequencies, rad a sample, are held."""
    in_band = np.zeros(np.shape(om), dtype=bool)
    for low, high in zip(learner.held[::2], learner.held[1::2], strict=True):
        in_band |= (om >= low) & (om <= high)
    return in_band


def rate_bound(
    T: float,
    learner: Learner,
    w: Real,
    plant: Callable[[Real], Complex] | None = None,
    near: Real | None = None,
) -> float:
    """The rate below which all orders, at frequencies w in rad/s, settle together, 1/s. `T`: period, s.

    The loop from the learned current to what the law adds to it is the rate times R. The bound is the rate at
    which this loop first is -1. `plant`: returns Gamma at frequencies in rad a sample; None: all is as the
    law assumes. `near`: further frequencies, rad/s, at which the loop is computed.
    """
    neighbours = np.add.outer(w * T, np.geomspace(1e-4, 0.5, 60) * w[0] * T)
    om = np.union1d(np.linspace(ORDER_ANGLE_LEAST, math.pi, 6000), np.ravel(neighbours)) * (1 + 1e-9)
    if near is not None:
        om = np.union1d(om, near * T)
    om = om[(om < math.pi) & (om > 0)]
    R = all_orders(learner, w * T, om, T)
    if plant is not None:
        d = learner.delay / T
        R = R * plant(om) * np.exp(-1j * om * d) / _shares(d, np.exp(1j * om))
    crossing = (R.real[:-1] < 0) & (R.real[1:] < 0) & (R.imag[:-1] * R.imag[1:] < 0)
    part = R.imag[:-1] / (R.imag[:-1] - R.imag[1:] + 1e-300)
    at = (R.real[:-1] + part * (R.real[1:] - R.real[:-1]))[crossing]
    return float(-1 / np.min(at)) if len(at) else math.inf


def all_orders(learner: Learner, orders: Real, om: Real, T: float) -> Complex:
    """R, the loop of all orders / the rate, at om rad a sample; resonators at `orders`, rad a sample."""
    d, z = learner.delay / T, np.exp(1j * om)
    sum_of = np.zeros(len(om), dtype=complex)
    for one in orders:
        Z = np.exp(1j * one)
        inverse = np.exp(1j * one * d) / seen(Z, one)
        resonator = inverse / (1 - Z / z) + np.conj(inverse) / (1 - np.conj(Z) / z)
        sum_of += T / 2 * resonator * seen(z, one) * _shares(d, z)
    return sum_of


def seen(z: Complex, order: float) -> Complex:
    """Response from a held current to what an order learns from, over b T^2: e, or the mean of two z."""
    of_e = np.asarray((z + 1) * (z - 1) / (2 * (z - POLE) ** 3))
    mean = (1 + 1 / z) / 2
    return of_e if order > SLOW_ORDER_ANGLE else np.asarray((1 - POLE) ** 3 * z / (z - 1) * of_e * mean)
