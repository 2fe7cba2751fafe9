"""The result of an identification: values and waves with their errors, and sentences on what is left out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cogless.identify.balance import WIDE_INSTRUMENT, Model, Rows
from cogless.identify.config import Identification
from cogless.identify.jackknife import Fit
from cogless.identify.log import Log
from cogless.units import DEGREE


@dataclass(frozen=True)
class Value:
    """A number and its error at 95 %, SI."""

    value: float
    error: float

    def times(self, factor: float) -> Value:
        return Value(self.value * factor, self.error * abs(factor))


@dataclass(frozen=True)
class Wave:
    """size sin(order theta + phase), with errors at 95 %, SI."""

    order: int
    size: Value
    phase: Value


@dataclass(frozen=True, eq=False)
class Estimate:
    """The values and waves that logs give. Torques are divided by K_t, in A; `ripple` is a share of K_t.

    `friction`: waves of Coulomb friction over the angle. `of_unknown_cause`: waves that are cogging or an
    offset of the current, which logs show alike. `values` lacks values that are not known; `left_out` has
    sentences on these. `offsets`: offsets of the phase currents that were removed from i_q, A; None: no log
    shows them.
    """

    identification: Identification
    logs: tuple[Log, ...]
    values: dict[str, Value]
    cogging: tuple[Wave, ...]
    ripple: tuple[Wave, ...]
    encoder: tuple[Wave, ...]
    loads: dict[str, Value]
    remarks: tuple[str, ...]
    left_out: tuple[str, ...]
    model: Model = field(repr=False, default=Model())
    rows: tuple[Rows, ...] = field(repr=False, default=())
    fit: Fit | None = field(repr=False, default=None)
    instrument: int = field(repr=False, default=WIDE_INSTRUMENT)
    offsets: tuple[float, float, float] | None = None
    friction: tuple[Wave, ...] = ()
    of_unknown_cause: tuple[Wave, ...] = ()

    @property
    def K_t(self) -> float:
        """Torque constant that is taken as known, N*m/A."""
        return self.identification.motor.star().K_t

    @property
    def kinds(self) -> tuple[tuple[str, str, float, str], ...]:
        """Each kind of wave: title, name of the field with its waves, factor to the shown unit, and unit."""
        return (
            ("cogging", "cogging", 1e3 * self.K_t, "mN*m"),
            ("K_t ripple", "ripple", 100.0, "%"),
            ("friction over the angle", "friction", 1e3 * self.K_t, "mN*m"),
            ("encoder's error", "encoder", 1 / DEGREE, "deg"),
        )

    def waves(self, field_name: str) -> tuple[Wave, ...]:
        """The waves of one of the kinds."""
        waves: tuple[Wave, ...] = getattr(self, field_name)
        return waves


def wave_of(order: int, cosine: Value, sine: Value) -> Wave:
    """The wave of a cosine and a sine part."""
    size = float(np.hypot(cosine.value, sine.value))
    along = np.hypot(cosine.value * cosine.error, sine.value * sine.error) / max(size, 1e-300)
    across = np.hypot(sine.value * cosine.error, cosine.value * sine.error) / max(size, 1e-300)
    phase = float(np.arctan2(cosine.value, sine.value))
    return Wave(order, Value(size, float(along)), Value(phase, float(across) / max(size, 1e-300)))
