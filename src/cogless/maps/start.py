"""Turn a map that was learned before, by any law, into the entries that another law starts from."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.maps.stored_map import COSINE, CURRENT, ORDER, SINE, MapError, StoredMap

Reals = NDArray[np.float64]
AS_CURRENT = {(CURRENT,), (COSINE, SINE, ORDER)}  # units of maps that are a current over the angle


def entries(stored: StoredMap, law: Mapping[str, Any], unit: float) -> Reals:
    """The entries of the law's memory, (channels, cells), that mean what the stored map means.

    Another number of cells is made from the map's orders up to what both resolve. `law`: the law's own map as
    the engine describes it: its values, units, limits, turns, parts and ratio. `unit`: the law's entry for a
    current of 1 A.

    MapError: the map says nothing about this law, or asks for more than its limit; its text says what was
    expected.
    """
    units, own = tuple(law["units"]), Fraction(law["turns"], law["parts"])
    if not stored.turns:
        raise MapError("a trial's signal: expected a map over the angle")
    period = Fraction(stored.turns, stored.parts)
    count = own / period
    if count.denominator != 1:
        raise MapError(f"a map over {_shown(period)}: expected one that fits into the law's {_shown(own)}")
    cells = law["values"].shape[1]
    if ORDER in units:
        alike = stored.units == units and count == 1 and np.array_equal(stored.values[2], law["values"][2])
    else:
        alike = stored.units == units and (len(units) == 1 or stored.ratio == law["ratio"])
    if alike:
        found = np.array([resampled(np.tile(channel, int(count)), cells) for channel in stored.values])
    elif stored.units in AS_CURRENT:
        found = of_current(np.tile(_current(stored), int(count)), law, unit)
    else:
        kind = " and ".join(stored.unit(c)[0] for c in range(stored.channels))
        raise MapError(f"a map of {kind}: expected one of this law's kind, or of a current alone")
    return within(found, law)


def of_current(current: Reals, law: Mapping[str, Any], unit: float) -> Reals:
    """The entries of a law's memory for a current, A, at evenly spaced angles of the law's period."""
    found: Reals = np.zeros_like(law["values"])
    if ORDER in law["units"]:
        orders = law["values"][2]
        most = (len(current) - 1) // 2
        if orders.max() > most:
            known = f"{len(current)} entries, orders up to {most}"
            raise MapError(f"{known}: expected the law's {orders.max():g}")
        amplitudes = 2 / len(current) * np.fft.rfft(current)[orders.astype(int)]
        return np.array([amplitudes.real, -amplitudes.imag, orders])
    found[0] = unit * resampled(current, found.shape[1])
    return found


def resampled(values: NDArray[Any], cells: int) -> Reals:
    """A period's values at as many other places; what both can resolve of their orders stays as it is."""
    if len(values) == cells:
        return np.asarray(values, np.float64)
    orders = np.fft.rfft(values)[: (min(len(values), cells) + 1) // 2]
    return np.asarray(np.fft.irfft(orders, cells) * (cells / len(values)))


def within(found: Reals, law: Mapping[str, Any]) -> Reals:
    """The entries, if each is a number within the law's limit; what is above by rounding is cut."""
    for channel, limit in zip(found, law["limits"], strict=True):
        largest = float(np.max(np.abs(channel)))
        if not largest <= limit * (1 + 1e-6):
            raise MapError(f"an entry of {largest:.4g}: expected at most the law's limit, {limit:.4g}")
        np.clip(channel, -limit, limit, out=channel)
    return found


def _current(stored: StoredMap) -> Reals:
    """The map's current over its period, A; from orders, at as many angles as resolve them."""
    values = stored.values.astype(np.float64)
    if ORDER not in stored.units:
        return np.asarray(values[0])
    a, b, orders = values
    spectrum = np.zeros(2 * int(orders.max()) + 1, complex)
    spectrum[orders.astype(int)] = (a - 1j * b) / 2
    cells = 2 * (len(spectrum) - 1)
    return np.asarray(np.fft.irfft(spectrum, cells) * cells)


def _shown(period: Fraction) -> str:
    return "a revolution" if period == 1 else f"{period} of a revolution"
