"""K_t from the voltage: u_q = R i_q + K_e omega, and a dead time's voltage against the current."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from cogless.identify.config import Identification
from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.identify.steady import steady

FEWEST = 4  # steady parts, for three unknowns
SPREAD = 2.0  # ratio of the fastest to the slowest, at least


def torque_constant(known: Identification, logs: Sequence[Log]) -> Value | None:
    """K_t that the back-EMF of the steady parts of these logs has, N*m/A; None: they don't tell it.

    Its error at 95 % has what the parts leave unexplained, and 1 % at least for the inverter's gain.
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
    error = float(
        student.ppf(0.975, len(parts) - 3) * np.sqrt(left * np.linalg.inv(columns.T @ columns)[0, 0])
    )
    star = known.motor.star()
    per = star.K_t / (star.pole_pairs * star.psi_f)  # N*m/A for a V*s/rad of back-EMF
    return Value(per * float(found[0]), per * float(np.hypot(error, 0.01 * found[0])))


class Agreement(str):
    """A remark that finds nothing wrong."""


def check(known: Identification, logs: Sequence[Log]) -> list[str]:
    """What the voltage says of the K_t that is taken as known."""
    told = torque_constant(known, logs)
    if told is None:
        return []
    given = known.motor.star().K_t
    says = f"The voltage says K_t = {told.value:.4g} +- {told.error:.2g} N*m/A"
    if abs(told.value - given) <= told.error:
        return [Agreement(f"{says}, as the file of columns has it ({given:.4g}).")]
    return [
        f"{says}; the file of columns has {given:.4g}: all torques are in proportion to it; correct "
        "motor.K_t or kv."
    ]
