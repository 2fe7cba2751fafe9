"""A drive that may not be one rigid body: its inertia differs from frequency to frequency.

Torque over acceleration of a motor of inertia J_1, whose flexible shaft turns a load of inertia J_2, is
J_1 + J_2 / (1 - (f / f_a)^2), f_a: the frequency at which the load swings while the motor is held. So the
inertia is estimated in bands of frequency, and compared with the estimate's inertia. Errors of the angle that
are larger than the motion in a band make its inertia too small, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from cogless.identify.balance import LADDER, Model, smooth
from cogless.identify.cogging_orders import FALSE_ALARM
from cogless.identify.jackknife import ALONE, Equations, variance_of
from cogless.identify.kernel import REACH_WIDTHS, Kernel
from cogless.results.trace import Array
from cogless.units import TURN

RIGID_SHARE = 0.2  # relative change of the inertia up to which a drive counts as rigid: below 2 dB of gain
LOOP_NOISE_GAIN = 2.0  # largest sensitivity of a well-damped loop to noise of the angle


@dataclass(frozen=True)
class Band:
    """Inertia at a frequency, Hz, over the estimate's, with an error that noise exceeds in few searches.

    The chance that noise exceeds the error in any band is FALSE_ALARM.
    """

    frequency: float
    inertia: float
    error: float


def _shares() -> list[Array]:
    """Shares of the instruments for each band, the fastest band first.

    A band combines three neighbours of LADDER. Its response rises with the fourth power of the frequency.
    """
    squares, bands = np.square(LADDER), []
    for first in range(len(LADDER) - 2):
        narrow, wide = np.diff(squares[first : first + 3])
        shares = np.zeros(len(LADDER))
        shares[first : first + 3] = wide, -(narrow + wide), narrow
        bands.append(shares / wide)
    return bands


BAND_SHARES = _shares()


def _centre(shares: Array) -> float:
    """Frequency of a band's largest response, Hz."""
    frequencies = np.geomspace(0.1, 1, 400) / (min(LADDER) * np.pi)
    responses = np.exp(-0.5 * np.square(TURN * np.outer(frequencies, LADDER))) @ shares
    return float(frequencies[np.argmax(responses)])


def inertia_by_frequency(
    equations_of: Callable[[Model], Equations],
    equations: Equations,
    model: Model,
    *,
    instrument: int,
    delay_error: float,
) -> list[Band]:
    """The inertia in each band, the fastest first.

    `equations_of`: gives the equations of a model. `equations`: those of `model`. `instrument`: index of the
    instrument of the estimate's inertia. `delay_error`: error of the delay, s. A wrong delay and noise of the
    angle change the inertia, most in the fast bands. The errors include both effects.
    """
    ends = [equations_of(replace(model, delay=model.delay + sign * delay_error)) for sign in (-1, 1)]
    inertia, moved, _ = equations.inertia(ALONE[instrument], instrument)
    noise = _noise_products(equations, model, instrument)
    bands = []
    for shares in BAND_SHARES:
        value, moved_value, product = equations.inertia(shares, instrument)
        ratio = value / inertia
        variance, freedom = variance_of((moved_value - ratio * moved)[:, None] / inertia)
        quantile = student.isf(FALSE_ALARM / 2 / len(BAND_SHARES), freedom[0])
        ratios = [
            end.inertia(shares, instrument)[0] / end.inertia(ALONE[instrument], instrument)[0] for end in ends
        ]
        by_delay = max(abs(other - ratio) for other in ratios)
        by_noise = LOOP_NOISE_GAIN * abs(shares @ noise) / max(abs(product), 1e-300)
        error = float(np.hypot(quantile * np.sqrt(variance[0]), by_delay) + by_noise)
        bands.append(Band(_centre(shares), ratio, error))
    return bands


def _noise_products(equations: Equations, model: Model, instrument: int) -> Array:
    """Mean products of acceleration and each instrument by the angle's noise, summed as in the equations."""
    noises, products = equations.noises(instrument), np.zeros(len(LADDER))
    for rows in equations.rows:
        if ("j",) not in rows.noise:
            continue
        kernel = Kernel(model.width(rows.log), rows.log.dt, model.delay).acceleration
        lags = np.correlate(kernel, kernel, "full")
        middle, step = len(kernel) - 1, round(rows.spacing / rows.log.dt)
        lags = lags[middle % step :: step] / lags[middle]
        reach = round(REACH_WIDTHS * max(LADDER) / rows.spacing)
        filtered = [smooth(np.pad(lags, reach), width / rows.spacing) for width in LADDER]
        share = float(np.sum(rows.noise["j",])) / noises[rows.log.name] ** 2
        products += share * np.array([x[reach + middle // step] for x in filtered])
    return products


def sentences(bands: Sequence[Band]) -> list[str]:
    """A sentence if the inertia of some band surely differs from the estimate's by more than RIGID_SHARE."""
    sure = [band for band in bands if abs(band.inertia - 1) - band.error > RIGID_SHARE]
    if not sure:
        return []
    band = min(sure, key=lambda band: band.frequency)
    return [
        f"At about {band.frequency:.2g} Hz the logs show {band.inertia:.2g} +- {band.error:.1g} times the "
        "inertia of lower frequencies. Either the drive is not one rigid body, but has a flexible shaft, "
        "coupling or belt, or errors of the logged angle hide the motion there. If it is not one rigid body, "
        "the simulation is wrong near this frequency and above, and cogging at such frequencies may be wrong "
        "by more than its error."
    ]
