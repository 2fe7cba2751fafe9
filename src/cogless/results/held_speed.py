"""Whether a run held its speed: one rule for reports, first studies and, in metrics.js, live pages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cogless.results.trace import Array

MEAN_ERROR_MOST = 0.05  # share of the reference's mean magnitude: beyond this the mean speed is off
# largest error rms / mean magnitude of a reference of one sign; a sine of this rms stops the rotor
JERKS_RATIO = math.sqrt(0.5)
UNEVEN_RATIO = 0.5  # the same ratio, from which on a speed is uneven; a sine slows it to 29 %
LOST_SPEED_RATIO = 0.5  # error rms / reference rms, at most, if the reference's mean is zero
REST_ERROR_MOST = 0.1  # rad/s, largest error rms if the reference is zero all the time
ROUNDED_SHARE = 1e-3  # share of a reference's mean magnitude: a smaller mean speed is reported as zero
ONE_WAY = 0.1  # share of a reference's mean magnitude: a smaller mean of the reference counts as zero


@dataclass(frozen=True)
class Miss:
    """How a speed missed its reference.

    `value`, `target`: the means of speed and reference, or the rms of error and reference, rad/s.
    `kind`: "mean", "error", or "infinite" for a speed that isn't finite.
    """

    kind: Literal["mean", "error", "infinite"]
    value: float
    target: float


def miss(reference: Array, speed: Array) -> Miss | None:
    """How a speed, rad/s, missed its reference; None if it was held.

    A speed counts as missed only if it is off over all the rows and over their second half. So a start-up at
    the beginning doesn't count, nor does a slow ripple.
    """
    half = slice(len(speed) // 2, None)
    with np.errstate(all="ignore"):
        return _off(reference, speed) if _off(reference[half], speed[half]) else None


def unevenness(reference: Array, speed: Array) -> float | None:
    """The error's rms / the mean magnitude of a reference of one sign, for a speed with the right mean.

    None: the ratio is below UNEVEN_RATIO, or a mean is off. A speed is held up to JERKS_RATIO.
    """
    half = slice(len(speed) // 2, None)
    ratio = min(_unevenness(reference, speed), _unevenness(reference[half], speed[half]))
    return ratio if ratio >= UNEVEN_RATIO else None


def _unevenness(reference: Array, speed: Array) -> float:
    off = _off(reference, speed)
    size = float(np.mean(np.abs(reference))) if len(reference) else 0.0
    if (off is not None and off.kind != "error") or abs(np.sum(reference)) <= ONE_WAY * size * len(reference):
        return 0.0
    return float(np.sqrt(np.mean(np.square(reference - speed)))) / size


def _off(reference: Array, speed: Array) -> Miss | None:
    if not len(speed):
        return None
    mean, value, size = (float(np.mean(x)) for x in (reference, speed, np.abs(reference)))
    if not np.all(np.isfinite(speed)):
        return Miss("infinite", value, mean)
    one_way = abs(mean) > ONE_WAY * size
    if one_way and abs(value - mean) > MEAN_ERROR_MOST * size:
        return Miss("mean", value if abs(value) > ROUNDED_SHARE * size else 0.0, mean)
    error, amplitude = (float(np.sqrt(np.mean(np.square(x)))) for x in (reference - speed, reference))
    most = JERKS_RATIO * size if one_way else LOST_SPEED_RATIO * amplitude
    return Miss("error", error, amplitude) if error > (most or REST_ERROR_MOST) else None
