"""K_t and R from the voltage: u_q = R i_q + K_e omega, and a dead time's voltage against the current."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from cogless.identify.config import Identification
from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.identify.steady import steady
from cogless.study.datasheet_words import mixed_up

FEWEST = 4  # steady parts, for three unknowns
RMS = math.sqrt(2)  # peak over rms
WARMER = (RMS - 1) / 3.93e-3  # K, by which copper has so much more resistance
RESOLVED = 0.1  # relative error of R, at most, that tells sqrt(2) from 1
SPREAD = 2.0  # ratio of the fastest to the slowest, at least


def told(known: Identification, logs: Sequence[Log]) -> tuple[Value, Value] | None:
    """K_t, N*m/A, by the back-EMF of the steady parts of these logs, and R, ohm; None: they don't tell it.

    Errors at 95 % have what the parts leave unexplained, and 1 % at least for the inverter's gain.
    """
    whole = [log for log in logs if log.dt and {"u_q", "i_q", "theta"} <= log.signals.keys()]
    parts = [part for log in whole for part in steady(log)]
    speeds = np.array([part.speed for part in parts])
    if len(parts) < FEWEST or np.max(np.abs(speeds)) < SPREAD * np.min(np.abs(speeds)):
        return None
    currents = np.array([part.current for part in parts])
    voltages = np.array([np.mean(part.log["u_q"][part.rows]) for part in parts])
    # cogging may turn the current's sign within a part
    signs = np.array([np.mean(np.sign(part.log["i_q"][part.rows])) for part in parts])
    columns = np.column_stack((speeds, currents, signs))
    scale = np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns / scale, tol=1e-2) < 3:
        return None
    found, *_ = np.linalg.lstsq(columns, voltages, rcond=None)
    left = float(np.sum((voltages - columns @ found) ** 2)) / (len(parts) - 3)
    covariance = left * np.linalg.inv(columns.T @ columns)
    errors = student.ppf(0.975, len(parts) - 3) * np.sqrt(np.diag(covariance))
    k_e, r = (
        Value(float(value), float(np.hypot(error, 0.01 * value)))
        for value, error in zip(found[:2], errors[:2], strict=True)
    )
    star = known.motor.star()
    return k_e.times(star.K_t / (star.pole_pairs * star.psi_f)), r


class Agreement(str):
    """A remark that finds nothing wrong."""


def check(known: Identification, logs: Sequence[Log]) -> list[str]:
    """What the voltage says of the K_t that is taken as known, and of the current's unit by R."""
    found = told(known, logs)
    return [] if found is None else [_of_k_t(known, found[0]), *_of_r(known, found[1])]


def _of_k_t(known: Identification, told: Value) -> str:
    given = known.motor.star().K_t
    says = f"The voltage says K_t = {told.value:.4g} +- {told.error:.2g} N*m/A"
    if abs(told.value - given) <= told.error:
        return Agreement(f"{says}, as the file of columns has it ({given:.4g}).")
    times = max(given / told.value, told.value / given)
    mixed = mixed_up(times, told.error / told.value) if told.value > 0 else ""
    return (
        f"{says}; the file of columns has {given:.4g}{mixed}: all torques are in proportion to it; correct "
        "motor.K_t (per rms ampere it is K_t_rms) or kv."
    )


def _of_r(known: Identification, told: Value) -> list[str]:
    """A current in rms amperes is 1/sqrt(2) of the one that the voltage drives through R."""
    given = known.motor.star().R_s
    if told.error > RESOLVED * told.value or abs(told.value - RMS * given) > told.error:
        return []
    return [
        f"The voltage says R = {told.value:.3g} +- {told.error:.2g} ohm, sqrt(2) times that of the file of "
        f"columns ({given:.3g}): i_q looks like rms amperes, unless the winding is {WARMER:.0f} K warmer; "
        "multiply it by sqrt(2), and with it all torques."
    ]
