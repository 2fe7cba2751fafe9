"""Whether a drive is one rigid body: its inertia is estimated in bands of frequency.

Torque over acceleration of a motor of inertia J_1, whose flexible shaft turns a load of inertia J_2, is
J_1 + J_2 / (1 - (f / f_a)^2), f_a: the frequency at which the load swings while the motor is held. Errors of
the angle change the inertia of a band, too. So it is estimated twice, with the band's acceleration and with
the band's current as instrument. Their ratio is cos(phase)^2 times the coherence of current and acceleration:
1 for masses and springs. Errors of the angle take coherence, and the law's answer to them takes phase.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from cogless.identify.balance import LADDER, Model, smooth
from cogless.identify.cogging_orders import FALSE_ALARM
from cogless.identify.jackknife import ALONE, Equations, Inertia, variance_of
from cogless.identify.kernel import REACH_WIDTHS, Kernel
from cogless.results.trace import Array
from cogless.units import TURN

RIGID_SHARE = 0.05  # relative change of the inertia up to which a drive counts as rigid
HIDDEN_SHARE = 0.2  # relative fall of the inertia that errors of the angle, or a shaft, must have caused
LOOP_NOISE_GAIN = 2.0  # largest sensitivity of a well-damped loop to noise of the angle


@dataclass(frozen=True)
class Ratio:
    """A band's inertia over the estimate's, with the error that noise exceeds in FALSE_ALARM of all logs.

    `scatter`: part of the error that is no error of the delay.
    """

    value: float
    error: float
    scatter: float

    @property
    def least(self) -> float:
        return self.value - self.error

    @property
    def most(self) -> float:
        return self.value + self.error


@dataclass(frozen=True)
class Band:
    """Inertia at a frequency, Hz, with the acceleration and with the current as instrument."""

    frequency: float
    by_acceleration: Ratio
    by_current: Ratio

    @property
    def elastic(self) -> Ratio | None:
        """The estimate that no error of angle or current explains, if there is one."""
        scatter = self.by_acceleration.scatter + self.by_current.scatter
        if self.by_current.value - self.by_acceleration.value > scatter:
            return None
        if self.by_acceleration.least > 1 + RIGID_SHARE:
            return self.by_acceleration
        return self.by_current if self.by_current.most < 1 - RIGID_SHARE else None

    @property
    def hidden(self) -> bool:
        """The angle shows a smaller inertia, and the current does not show the estimate's."""
        return max(self.by_acceleration.most, self.by_current.least) < 1 - HIDDEN_SHARE


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
    equations_of: Callable[[Model], Equations], model: Model, *, instrument: int, delay_error: float
) -> list[Band]:
    """The inertia in each band, the fastest first.

    `equations_of`: gives the equations of a model. `instrument`: index of the instrument of the estimate's
    inertia. `delay_error`: error of the delay, s. A wrong delay changes the inertia, most in the fast bands.
    The errors include this effect, and the one of the angle's known noise.
    """
    noise = _noise_products(equations_of(model), model, instrument)
    delays = (model.delay, model.delay - delay_error, model.delay + delay_error)
    models = [replace(model, delay=delay) for delay in delays]
    by_acceleration = [_inertias(equations_of(x), instrument) for x in models]
    by_current = [_inertias(equations_of(replace(x, instrument_of="current")), instrument) for x in models]
    references = [inertias[-1] for inertias in by_acceleration]
    return [
        Band(
            _centre(shares),
            _ratio([inertias[k] for inertias in by_acceleration], references, float(shares @ noise)),
            _ratio([inertias[k] for inertias in by_current], references),
        )
        for k, shares in enumerate(BAND_SHARES)
    ]


def _inertias(equations: Equations, instrument: int) -> list[Inertia]:
    """The inertia of each band, and the estimate's, which is the last one."""
    return [equations.inertia(shares, instrument) for shares in (*BAND_SHARES, ALONE[instrument])]


def _ratio(inertias: Sequence[Inertia], references: Sequence[Inertia], noise: float = 0.0) -> Ratio:
    """The inertia of a band over the estimate's.

    Both are given with the estimated delay, and with both ends of its interval. `noise`: product of
    acceleration and the band's instrument by the angle's noise.
    """
    values = [one.value / reference.value for one, reference in zip(inertias, references, strict=True)]
    moved = (inertias[0].moved - values[0] * references[0].moved) / references[0].value
    variance, freedom = variance_of(moved[:, None])
    scatter = float(student.isf(FALSE_ALARM / 2 / len(BAND_SHARES), freedom[0]) * np.sqrt(variance[0]))
    by_delay = max(abs(value - values[0]) for value in values)
    by_noise = LOOP_NOISE_GAIN * abs(noise) / max(abs(inertias[0].product), 1e-300)
    return Ratio(values[0], float(np.hypot(scatter, by_delay)) + by_noise, scatter + by_noise)


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
    """A sentence if some band surely differs from the estimate, or else if some band is hidden."""
    for band in reversed(bands):
        if ratio := band.elastic:
            filtered = "" if ratio.value > 1 else ", or the logged current is filtered"
            return [
                f"The drive is not one rigid body{filtered}: at about {band.frequency:.2g} Hz the inertia is "
                f"{ratio.value:.2g} +- {ratio.error:.1g} times the inertia of lower frequencies. A flexible "
                "shaft, coupling or belt does this. The simulation is wrong near this frequency and above. "
                "Cogging at such frequencies may be wrong by more than its error."
            ]
    for band in reversed(bands):
        if band.hidden:
            return [
                f"From about {band.frequency:.2g} Hz on, these logs do not show whether the drive is one "
                "rigid body: errors of the angle may hide the motion there, the logged current may be "
                "filtered, or a shaft, coupling or belt may be flexible."
            ]
    return []
