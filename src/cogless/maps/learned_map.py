"""Make the stored map of what a run's law has learned, and the identities of motors and motions.

Turn a map that was learned before, by any law, into the entries that another law starts from.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from fractions import Fraction
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cogless.maps.stored_map import COSINE_CODE, CURRENT_CODE, ORDER_CODE, SINE_CODE, MapError, StoredMap
from cogless.study import AnyStudy
from cogless.study.motion import Real as Real
from cogless.study.motor import StarMotor
from cogless.units import TURN

WAVE_POINTS = 8  # cells for each wave of the highest order


def motor_identity(motor: StarMotor) -> int:
    """Identity of a motor, 32 bits: a CRC-32 over all of the motor's parameters (control/SPEC.md)."""
    data = struct.pack("<II4d", motor.pole_pairs, motor.phases, motor.R_s, motor.L_d, motor.L_q, motor.psi_f)
    for flux in motor.flux_harmonics:
        data += struct.pack("<I4d", flux.order, flux.d, flux.q, flux.d_phase, flux.q_phase)
    if motor.saturation is not None:
        for curve in motor.saturation.engine_config().values():
            data += struct.pack(f"<{2 * len(curve['flux'])}d", *curve["current"], *curve["flux"])
    for ripple in motor.torque_ripple:
        data += struct.pack("<I2d", ripple.order, ripple.share, ripple.phase)
    for cogging in motor.cogging:
        data += struct.pack("<I2d", cogging.order, cogging.torque, cogging.phase)
    return crc32(data)


def motion_identity(reference: ArrayLike) -> int:
    """Identity of a trial's reference, 32 bits: a CRC-32 over its samples as float32."""
    return crc32(np.asarray(reference, dtype="<f4").tobytes())


def study_identity(study: AnyStudy) -> int:
    """Identity of the study's motor without overrides; 0 if it has no motor."""
    return 0 if study.motor is None else motor_identity(study.motor.star())


def memory_of(
    study: AnyStudy, scenario: str, controller: str, stored: Mapping[str, Any] | None
) -> dict[str, Any]:
    """What a law has learned, in the form of `Run.memory`; empty if the law has learned nothing.

    A law of trials has learned a signal, other laws currents over an angle. A map over a whole mechanical
    revolution gets the mechanical angle, even if the law uses the electrical angle.
    """
    if stored is None:
        return {}
    values: Real = stored["values"]
    if ORDER_CODE in stored["units"]:
        return _over_angle(*values)
    if not stored["turns"]:
        return {"learned": values[0]}
    law, poles = study.controller[controller], study.conditions(scenario).pole_pairs
    period = Fraction(stored["turns"], stored["parts"])  # revolutions
    if law.code is not None:
        ratio = poles if period == Fraction(1, poles) else 1
    else:
        ratio = 1 if period == 1 else law.ratio(poles)
    unit = float(np.float32(law.unit)) if study.precision == "single" else law.unit
    cells = values.shape[1]
    angle = TURN * float(ratio * period) / cells * np.arange(cells)
    names = ("current", "beta", "h")[: len(values)]
    frame = "mechanical" if ratio == 1 else "electrical"
    return {"frame": frame, "angle": angle, **dict(zip(names, 1 / unit * values, strict=True))}


def _over_angle(a: Real, b: Real, orders: Real) -> dict[str, Any]:
    """Current over a mechanical revolution from the amplitudes of its orders, in the form of `Run.memory`.

    `a`, `b`: amplitudes of the cosines and of the sines, A.
    """
    cells = WAVE_POINTS * round(float(np.max(orders)))
    angle = TURN / cells * np.arange(cells)
    waves = (x * np.cos(h * angle) + y * np.sin(h * angle) for x, y, h in zip(a, b, orders, strict=True))
    return {"frame": "mechanical", "angle": angle, "current": sum(waves)}


def of_run(study: AnyStudy, stored: Mapping[str, Any] | None, motion: int = 0) -> StoredMap | None:
    """The map that a run has learned, as firmware stores it: within the limits, with the motor's identity.

    None if there is no map to store. `motion`: identity of a trial's reference.
    """
    if stored is None:
        return None
    limits, values = (np.asarray(stored[key], dtype=np.float32) for key in ("limits", "values"))
    period = Fraction(stored["turns"], stored["parts"] or 1)
    return StoredMap(
        np.clip(values, -limits[:, None], limits[:, None]),
        tuple(stored["units"]),
        tuple(limits.tolist()),
        law=stored["law"],
        turns=period.numerator,
        parts=period.denominator if period else 0,
        ratio=stored["ratio"],
        motor=study_identity(study),
        motion=motion,
    )


# units of the channels of maps that are a current over the angle
AS_CURRENT = {(CURRENT_CODE,), (COSINE_CODE, SINE_CODE, ORDER_CODE)}


def entries(stored: StoredMap, law: Mapping[str, Any], unit: float) -> Real:
    """The entries of the law's memory, (channels, cells), with the same meaning as the stored map.

    If the law has another number of cells, the entries keep the orders that both numbers of cells resolve.
    `law`: the law's own map as the engine describes it: values, units, limits, turns, parts and ratio.
    `unit`: the law's entry for a current of 1 A.

    MapError: the map does not suit this law, or exceeds the law's limit; the text says what was expected.
    """
    units, own = tuple(law["units"]), Fraction(law["turns"], law["parts"])
    if not stored.turns:
        raise MapError("a trial's signal: expected a map over the angle")
    period = Fraction(stored.turns, stored.parts)
    count = own / period
    if count.denominator != 1:
        raise MapError(
            f"a map over {_period_words(period)}: expected one over the law's period, {_period_words(own)}, "
            "or over a whole fraction of it"
        )
    cells = law["values"].shape[1]
    if ORDER_CODE in units:
        alike = stored.units == units and count == 1 and np.array_equal(stored.values[2], law["values"][2])
    else:
        alike = stored.units == units and (len(units) == 1 or stored.ratio == law["ratio"])
    if alike:
        own_entries = np.array([resampled(np.tile(channel, int(count)), cells) for channel in stored.values])
    elif stored.units in AS_CURRENT:
        own_entries = of_current(np.tile(_current(stored), int(count)), law, unit)
    else:
        kind = " and ".join(stored.unit(c)[0] for c in range(stored.channels))
        raise MapError(f"a map of {kind}: expected a map of this law's kind, or of a current only")
    return entries_within(own_entries, law)


def of_current(current: Real, law: Mapping[str, Any], unit: float) -> Real:
    """The entries of a law's memory for a current, A, at evenly spaced angles of the law's period."""
    own_entries: Real = np.zeros_like(law["values"])
    if ORDER_CODE in law["units"]:
        orders = law["values"][2]
        most = (len(current) - 1) // 2
        if orders.max() > most:
            size = f"a map of {len(current)} entries, which hold orders up to {most}"
            raise MapError(f"{size}: expected orders up to the law's {orders.max():g}")
        amplitudes = 2 / len(current) * np.fft.rfft(current)[orders.astype(int)]
        return np.array([amplitudes.real, -amplitudes.imag, orders])
    own_entries[0] = unit * resampled(current, own_entries.shape[1])
    return own_entries


def resampled(values: NDArray[Any], cells: int) -> Real:
    """A period's values resampled to `cells` values; orders that both numbers resolve stay as they are."""
    if len(values) == cells:
        return np.asarray(values, np.float64)
    orders = np.fft.rfft(values)[: (min(len(values), cells) + 1) // 2]
    return np.asarray(np.fft.irfft(orders, cells) * (cells / len(values)))


def entries_within(entries_now: Real, law: Mapping[str, Any]) -> Real:
    """The entries, clipped where rounding exceeds the law's limit. MapError: the excess is larger."""
    for channel, limit in zip(entries_now, law["limits"], strict=True):
        largest = float(np.max(np.abs(channel)))
        if not largest <= limit * (1 + 1e-6):
            raise MapError(f"an entry of {largest:.4g}: expected at most the law's limit, {limit:.4g}")
        np.clip(channel, -limit, limit, out=channel)
    return entries_now


def _current(stored: StoredMap) -> Real:
    """The map's current over the period, A. From orders, each wave of the highest order gets four entries."""
    values = stored.values.astype(np.float64)
    if ORDER_CODE not in stored.units:
        return np.asarray(values[0])
    a, b, orders = values
    spectrum = np.zeros(2 * int(orders.max()) + 1, complex)
    spectrum[orders.astype(int)] = (a - 1j * b) / 2
    cells = 2 * (len(spectrum) - 1)
    return np.asarray(np.fft.irfft(spectrum, cells) * cells)


def _period_words(period: Fraction) -> str:
    return "a revolution" if period == 1 else f"{period} of a revolution"
