"""The stored map of what a run's law has learned; the identities that cogless gives motors and motions."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from fractions import Fraction
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cogless.maps.stored_map import ORDER, StoredMap
from cogless.study import AnyStudy, TrialStudy, for_scenario
from cogless.study.motor import StarMotor

POINTS = 8  # in a wave of the highest order

Reals = NDArray[np.float64]


def motor_identity(motor: StarMotor) -> int:
    """32 bits that tell motors of studies apart: a CRC-32 over all their numbers (control/SPEC.md)."""
    data = struct.pack("<II4d", motor.pole_pairs, motor.phases, motor.R_s, motor.L_d, motor.L_q, motor.psi_f)
    for flux in motor.flux_harmonics:
        data += struct.pack("<I4d", flux.order, flux.d, flux.q, flux.d_phase, flux.q_phase)
    for cogging in motor.cogging:
        data += struct.pack("<I2d", cogging.order, cogging.torque or 0.0, cogging.phase)
    return crc32(data)


def motion_identity(reference: ArrayLike) -> int:
    """32 bits that tell a trial's references apart: a CRC-32 over its samples as float32."""
    return crc32(np.asarray(reference, dtype="<f4").tobytes())


def study_identity(study: AnyStudy) -> int:
    """The identity of a study's motor as it stands there, without overrides; 0 without a motor."""
    return 0 if study.motor is None else motor_identity(study.motor.star())


def memory_of(
    study: AnyStudy, scenario: str, controller: str, stored: Mapping[str, Any] | None
) -> dict[str, Any]:
    """What a law has learned, as `Run.memory`: of a trial, or as currents over their angle; empty without.

    A map of a whole revolution is over the mechanical angle, even of a law that counts the electrical one.
    """
    if stored is None:
        return {}
    values = np.asarray(stored["values"])
    if isinstance(study, TrialStudy):
        return {"learned": values[0]}
    if ORDER in stored["units"]:
        return _over_angle(*values)
    law, poles = study.controller[controller], for_scenario(study, scenario).motor.pole_pairs
    period = Fraction(stored["turns"], stored["parts"])  # revolutions
    ratio = 1 if period == 1 else law.ratio(poles)
    unit = float(np.float32(law.unit)) if study.drive.precision == "single" else law.unit  # as the law has it
    cells = values.shape[1]
    angle = 2 * np.pi * float(ratio * period) / cells * np.arange(cells)
    names = ("current", "beta", "h")[: len(values)]
    frame = "mechanical" if ratio == 1 else "electrical"
    return {"frame": frame, "angle": angle, **dict(zip(names, 1 / unit * values, strict=True))}


def _over_angle(a: Reals, b: Reals, orders: Reals) -> dict[str, Any]:
    """The current of orders with these amplitudes over a mechanical revolution, as `memory_of`."""
    cells = POINTS * round(float(np.max(orders)))
    angle = 2 * np.pi / cells * np.arange(cells)
    waves = (x * np.cos(h * angle) + y * np.sin(h * angle) for x, y, h in zip(a, b, orders, strict=True))
    return {"frame": "mechanical", "angle": angle, "current": sum(waves)}


def of_run(study: AnyStudy, stored: Mapping[str, Any] | None, motion: int = 0) -> StoredMap | None:
    """The map that a run has learned, as firmware stores it, within its limits and with its owner.

    None where nothing is learned, or it is not tied to an angle. `motion`: identity of a trial's reference.
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
