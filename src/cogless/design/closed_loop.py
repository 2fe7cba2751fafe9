"""Poles of a sampled position or speed loop: whether it is stable, and if not, what grows and how fast.

The plant of pi.py in steps of the law, x' = A x + B i_ref, with what its sensor and integral keep, under

    i_ref = -(k + k_i T z / (z - 1) + sum R) omega_t - k_v ratio theta,
    omega_t = ratio (omega + k_theta theta)

Where margins.py tells how far a stable loop is from instability, this says of an unstable one at which
frequency it oscillates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.design.margins import Complex, Real
from cogless.design.pi import OMEGA, REFERENCE, THETA, SpeedLoop

ALMOST = 1 - 1e-12  # of a pole on the unit circle, at which a response is finite
ROUNDING = 1e-6  # of the poles that integrators have at one, two of them where nothing is fed back


@dataclass(frozen=True)
class Linear:
    """Linear feedback of a law, in its frame; law (4) is k alone, in a frame of ratio 1."""

    ratio: int
    k: float  # A*s/rad, on omega_t
    k_theta: float = 0.0  # 1/s
    k_i: float = 0.0  # A/rad
    k_v: float = 0.0  # A/rad


@dataclass(frozen=True)
class Resonator:
    """R: what learns one order's coefficients, at a constant speed (docs/laws/pi-afc.md)."""

    gain: float  # A/rad
    w: float  # rad/s, of the order
    lead: float  # s

    def response(self, w: Real, T: float) -> Complex:
        """R at w in rad/s, sampled with T: an integrator that turns with the order, very large there."""
        forth, back = (1 / (1 - ALMOST * np.exp(1j * (each - w) * T)) for each in (self.w, -self.w))
        phase = np.exp(1j * self.w * self.lead)
        return np.asarray(self.gain * T / 2 * (phase * forth + np.conj(phase) * back))


@dataclass(frozen=True)
class Oscillation:
    """An oscillation that grows in an unstable loop."""

    frequency: float  # Hz; 0: without oscillating
    rate: float  # 1/s, of its exponential


def oscillation(loop: SpeedLoop, feedback: Linear) -> Oscillation | None:
    """The fastest growing oscillation; None where the loop is stable."""
    found = poles(loop, feedback)
    fastest = found[np.argmax(np.abs(found))]
    if abs(fastest) <= 1 + ROUNDING:
        return None
    T = loop.period
    return Oscillation(abs(float(np.angle(fastest))) / (2 * math.pi * T), math.log(abs(fastest)) / T)


def poles(loop: SpeedLoop, feedback: Linear, resonators: Sequence[Resonator] = ()) -> Complex:
    """Poles in z of the law's samples, those of integrators that nothing feeds back included."""
    whole, states = loop.step_of(loop.steps), REFERENCE
    samples = -(-loop.window // loop.steps)  # that the sensor looks back on
    first = states + 1 + samples
    size = first + 2 * len(resonators)  # x, the integral, angles of before, coefficients in a frame at rest

    def unit(n: int) -> Real:
        return np.asarray(np.eye(size)[n])

    omega = unit(OMEGA)
    if samples:
        omega = (unit(THETA) - unit(first - 1)) / (loop.window * loop.current.period)
    omega_t = feedback.ratio * (omega + feedback.k_theta * unit(THETA))
    integral = unit(states) + feedback.k_i * loop.period * omega_t
    wanted = -feedback.k * omega_t - integral - feedback.k_v * feedback.ratio * unit(THETA)

    step = np.zeros((size, size))
    for n, each in enumerate(resonators):
        turn, phase, at = each.w * loop.period, each.w * each.lead, first + 2 * n
        p, q = unit(at), unit(at + 1)
        found = each.gain * loop.period * omega_t
        step[at] = math.cos(turn) * p - math.sin(turn) * q + math.cos(phase) * found
        step[at + 1] = math.sin(turn) * p + math.cos(turn) * q + math.sin(phase) * found
        wanted = wanted - step[at]
    step[:states, :states] = whole[:states, :states]
    step[:states] += np.outer(whole[:states, REFERENCE], wanted)
    step[states] = integral
    if samples:
        then = loop.step_of(samples * loop.steps - loop.window)[THETA]
        step[states + 1, :states] = then[:states]
        step[states + 1] += then[REFERENCE] * wanted
        step[states + 2 : first, states + 1 : first - 1] = np.eye(samples - 1)
    return np.asarray(np.linalg.eigvals(step))
