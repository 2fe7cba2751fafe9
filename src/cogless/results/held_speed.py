"""Whether a run held its speed: one rule for reports, first studies and, in metrics.js, live pages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cogless.results.runs import Results, Run
from cogless.results.trace import Array
from cogless.results.windows import in_torque_mode, rows_of
from cogless.study.metric import Metric

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

    @property
    def error(self) -> float:
        """The error / the reference: of the mean, or of its rms; infinite for a speed that isn't finite."""
        if self.kind == "infinite" or not self.target:
            return math.inf
        return abs(self.value - self.target if self.kind == "mean" else self.value) / abs(self.target)


def miss(reference: Array, speed: Array) -> Miss | None:
    """How a speed, rad/s, missed its reference; None if it was held.

    A speed counts as missed only if it is off over all the rows and over their second half. So a start-up at
    the beginning doesn't count, nor does a slow ripple.
    """
    half = slice(len(speed) // 2, None)
    with np.errstate(all="ignore"):
        return _off(reference, speed) if _off(reference[half], speed[half]) else None


def speed_miss(run: Run, rows: slice) -> Miss | None:
    """How the speed missed its reference in these rows; None if it was held."""
    return miss(run.trace.part("omega_ref", rows), run.trace.part("omega_m", rows))


def missed_in(results: Results, metric: Metric, run: Run) -> Miss | None:
    """How the speed missed its reference where a metric is taken.

    None: it was held, or an outer loop sets the current there, so no speed is to be held.
    """
    rows = rows_of(results, metric, run)
    return None if in_torque_mode(results.study, run, rows) else speed_miss(run, rows)


def unevenness(reference: Array, speed: Array) -> float | None:
    """The error's rms / the mean magnitude of a reference of one sign, for a speed with the right mean.

    None: the ratio is below UNEVEN_RATIO, or a mean is off. A speed is held up to JERKS_RATIO. The ratio is
    that of all rows, as in `miss`; but where only the second half is held, it is that of this half.
    """
    half = slice(len(speed) // 2, None)
    ratio, later = _unevenness(reference, speed), _unevenness(reference[half], speed[half])
    if min(ratio, later) < UNEVEN_RATIO:
        return None
    return later if later <= JERKS_RATIO < ratio else ratio


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
