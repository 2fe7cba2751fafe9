"""Stability and margins of a sampled loop from its open-loop frequency response L(jw), up to half its rate.

Stability is Nyquist's criterion by the argument principle: L is strictly proper with m poles at z = 1 and the
others inside the unit circle. While w goes from 0 to half the rate, each closed-loop pole inside the unit
circle turns 1 + L by half a turn, and each one outside by nothing. So arg(1 + L) starts at -m 90 deg and ends
at minus half a turn for each unstable pole.

The gain margin of a stable loop is the smallest factor above one on L that makes the loop unstable. It
follows from the crossing of the negative real axis between -1 and 0 that is next to -1. The phase margin is
the smallest angle, seen from -1, of all crossings of the unit circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.study.motion import Real as Real

Complex = NDArray[np.complex128]
FREQUENCY_POINTS = 4001  # frequencies at which L is computed


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop; NaN if L has no such crossing, or if the loop is unstable."""

    stable: bool
    crossover: float  # rad/s, at which the phase margin is taken
    phase_margin: float  # rad
    gain_margin: float  # a factor above one
    phase_crossover: float  # rad/s, frequency of the oscillation if L is multiplied by gain_margin


UNSTABLE = Margins(False, math.nan, math.nan, math.nan, math.nan)


def finite(value: float) -> float | None:
    """The number for JSON; None, so null, if it isn't finite."""
    return value if math.isfinite(value) else None


def margins_of(
    response: Callable[[Real], Complex], period: float, integrators: int, near: Real | None = None
) -> Margins:
    """Margins of L = response(w), w in rad/s, with sample `period` and `integrators` poles at z = 1.

    `near`: frequencies, rad/s, around narrow resonances.
    """
    w = np.geomspace(1e-4, 1, FREQUENCY_POINTS) * math.pi / period
    if near is not None:
        w = np.union1d(w, near[(near > w[0]) & (near < w[-1])])
    L = response(w)
    if not _stable(L, integrators):
        return UNSTABLE
    crossover, on_circle = _crossover(response, w, L)
    phase_crossover, on_axis = _phase_crossover(response, w, L)
    return Margins(True, crossover, abs(float(np.angle(-on_circle))), 1 / abs(on_axis), phase_crossover)


def _stable(L: Complex, integrators: int) -> bool:
    begin = -integrators * math.pi / 2
    turned = np.unwrap(np.concatenate(([begin], np.angle(1 + L))))
    return abs(float(turned[-1])) < math.pi / 2


def _crossover(response: Callable[[Real], Complex], w: Real, L: Complex) -> tuple[float, complex]:
    """The frequency of the crossing |L| = 1 that is nearest to -1, and L there."""
    outside = np.abs(L) >= 1
    crossings = np.flatnonzero(outside[:-1] != outside[1:])
    if not len(crossings):
        return math.nan, complex(math.nan)
    k = crossings[np.argmin(np.abs(np.angle(-L[crossings])))]
    at = root(lambda w: abs(_value_at(response, w)) - 1, w[k], w[k + 1])
    return at, _value_at(response, at)


def _phase_crossover(response: Callable[[Real], Complex], w: Real, L: Complex) -> tuple[float, complex]:
    """The frequency at which L is real, negative and next to -1 inside the unit circle, and L there."""
    a, b = L[:-2], L[1:-1]
    crossings = np.flatnonzero((np.sign(a.imag) != np.sign(b.imag)) & (a.real < 0) & (b.real < 0))
    share = a[crossings].imag / (a[crossings].imag - b[crossings].imag)
    real = a[crossings].real + share * (b[crossings].real - a[crossings].real)
    # L is also real at half the sampling rate, the last point
    real, crossings = np.append(real, L[-1].real), np.append(crossings, len(L) - 1)
    inside = (real > -1) & (real < 0)
    if not np.any(inside):
        return math.nan, complex(math.nan)
    k = crossings[inside][np.argmin(real[inside])]
    if k == len(L) - 1:
        return float(w[-1]), complex(L[-1])
    at = root(lambda w: _value_at(response, w).imag, w[k], w[k + 1])
    return at, _value_at(response, at)


def _value_at(response: Callable[[Real], Complex], w: float) -> complex:
    return complex(response(np.array([w]))[0])


def root(f: Callable[[float], float], a: float, b: float) -> float:
    """The zero of f between a and b, by bisection: importing scipy.optimize takes longer than a run does."""
    rising = f(b) > f(a)
    for _ in range(60):
        middle = (a + b) / 2
        if not a < middle < b:
            break
        if (f(middle) > 0) == rising:
            b = middle
        else:
            a = middle
    return float((a + b) / 2)
