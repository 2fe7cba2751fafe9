"""Find K_t and R from u_q = R i_q + K_e omega + p omega L_d i_d plus the voltage that the bridge loses.

Two unknowns enter the errors. First, the bridge loses less voltage at small currents, since the ripple
reverses them within a period; up to which current is unknown. Second, the logged voltage may be the motor's
or a command. A command acts later, when the rotor has turned further.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from cogless.identify.advice import Advice, AdvisedError, recording
from cogless.identify.config import Identification
from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.identify.steady import Steady, steady
from cogless.results.trace import Array
from cogless.study.datasheet import mixed_up
from cogless.units import TURN

STEADY_PARTS_LEAST = 4  # steady parts, for three unknowns
PEAK_OVER_RMS = math.sqrt(2)
TEMPERATURE_RISE = (PEAK_OVER_RMS - 1) / 3.93e-3  # K: this warms copper to sqrt(2) times the resistance
R_ERROR_MOST = 0.1  # largest relative error of R at which a factor of sqrt(2) is clear
SPEED_SPREAD_LEAST = 2.0  # ratio of the fastest speed to the slowest, at least
SOFT_SHARES = (0.1, 0.3)  # currents below which the bridge may lose less, over the largest mean current
VOLTAGE_GAIN = 0.01  # relative error of an inverter's voltage
UNDRIVEN = ("coast-down", "bridge-off")  # kinds of log without a voltage of the bridge
MEAN_ROWS, PARTS_MOST, PARTS_LEAST = 20, 500, 40  # least rows of a mean; most and least means of a log
UNLIKE_R = 3.0  # measured R over the datasheet's: warm copper, leads and the bridge's losses give less
K_T_DIFFERENCE = 0.1  # largest relative difference of K_t by warm magnets and the gain of the voltage


def constants_from_voltage(identification: Identification, logs: Sequence[Log]) -> tuple[Value, Value] | None:
    """K_t, N*m/A, by the back-EMF in the steady parts of these logs, and R, ohm; None: not known from these.

    The errors at 95 % have three parts: the residual of the fit, 1 % for the inverter's gain, and the change
    of the values with the unknowns of bridge and voltage.
    """
    whole = [log for log in logs if log.dt and {"u_q", "i_q", "theta"} <= log.signals.keys()]
    parts = [part for log in whole for part in steady(log)]
    speeds = np.array([part.speed for part in parts])
    sizes = np.abs(speeds)
    if len(parts) < STEADY_PARTS_LEAST or np.max(sizes) < SPEED_SPREAD_LEAST * np.min(sizes):
        return None
    currents = np.array([part.current for part in parts])
    voltages = np.array([np.mean(part.log["u_q"][part.rows]) for part in parts])
    star = identification.motor.star()
    direct = np.array([np.mean(part.log["i_d"][part.rows]) if "i_d" in part.log else 0.0 for part in parts])
    electrical = star.pole_pairs * speeds
    voltages -= electrical * star.L_d * direct
    fitted = _fitted(speeds, currents, voltages, _lost(parts, 0.0))
    if fitted is None:
        return None
    values, errors = fitted
    drive = identification.drive
    periods = 0.5 + (drive.inverter.computation_delay if drive.inverter is not None else 1)
    turned = electrical * periods / drive.rates.current_loop
    advanced = (voltages + electrical * star.L_q * currents * np.sin(turned)) / np.cos(turned)
    others = [_fitted(speeds, currents, advanced, _lost(parts, 0.0))] if np.all(np.abs(turned) < 1) else []
    largest = float(np.max(np.abs(currents)))
    others += [_fitted(speeds, currents, voltages, _lost(parts, share * largest)) for share in SOFT_SHARES]
    moved = [np.zeros(3), *(other[0] - values for other in others if other is not None)]
    wider = np.sqrt(errors**2 + (VOLTAGE_GAIN * values) ** 2 + np.max(np.abs(moved), axis=0) ** 2)
    k_e, r = (Value(float(value), float(error)) for value, error in zip(values[:2], wider[:2], strict=True))
    return k_e.times(star.K_t / (star.pole_pairs * star.psi_f)), r


def _lost(parts: Sequence[Steady], band: float) -> Array:
    """The mean sign of each part's current. Within +-`band`, A, current / band takes the sign's place."""
    currents = [part.log["i_q"][part.rows] for part in parts]
    return np.array([np.mean(np.clip(i / band, -1, 1) if band else np.sign(i)) for i in currents])


def _fitted(speeds: Array, currents: Array, voltages: Array, lost: Array) -> tuple[Array, Array] | None:
    """K_e, R and the lost voltage with their errors at 95 %; None: these parts can't separate them."""
    columns = np.column_stack((speeds, currents, lost))
    scale = np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns / scale, tol=1e-2) < 3:
        return None
    values, *_ = np.linalg.lstsq(columns, voltages, rcond=None)
    free = len(speeds) - 3
    square = float(np.sum((voltages - columns @ values) ** 2)) / free
    covariance = square * np.linalg.inv(columns.T @ columns)
    return np.asarray(values), np.asarray(student.ppf(0.975, free) * np.sqrt(np.diag(covariance)))


def require_units(identification: Identification, logs: Sequence[Log]) -> None:
    """Refuse an angle with its speed, or a current, in a unit that the voltage contradicts.

    K_e and R are fitted to means over parts of each log. Factors between units are far larger than the effect
    of ripple, bridge losses, warm magnets and a warm winding. A K_e that is off by a factor between two
    definitions of K_t is not refused.
    """
    for log in logs:
        measured = _of_parts(identification, log)
        if measured is None:
            continue
        (k_e, r), (k_e_error, r_error) = measured
        star = identification.motor.star()
        motions = [
            (1 / star.pole_pairs, "electrical", 1 / star.pole_pairs, ""),
            (TURN, "in revolutions", 1.0, "rev"),
            (TURN / 360, "in degrees", 1.0, "deg"),
        ]
        times = k_e / (star.pole_pairs * star.psi_f)
        apart = max(times, 1 / times) if times > 0 else 1.0
        differs = apart > 1 + K_T_DIFFERENCE and k_e_error < K_T_DIFFERENCE * abs(k_e)
        if differs and not mixed_up(apart, K_T_DIFFERENCE):
            for factor, says, scale, unit in motions:
                if abs(times / factor - 1) < K_T_DIFFERENCE:
                    raise AdvisedError(_of_motion(identification, log, times, says, scale, unit))
        times = r / star.R_s
        if r_error < K_T_DIFFERENCE * abs(r):
            for factor, says, scale in ((1e3, "small", 1e3), (1e-3, "large", 1e-3)):
                if 1 / UNLIKE_R < times / factor < UNLIKE_R:
                    raise AdvisedError(_of_current(identification, log, times, says, scale))


def _of_motion(
    identification: Identification, log: Log, times: float, says: str, scale: float, unit: str
) -> Advice:
    signals = [signal for signal in ("theta", "omega") if signal in log and signal in identification.columns]
    cure: dict[str, str | float] = {}
    for signal in signals:
        column = identification.columns[signal]
        if unit:
            cure[f"columns.{signal}.unit"] = unit + ("/s" if signal == "omega" else "")
        else:
            cure[f"columns.{signal}.scale"] = float(f"{column.scale * scale:.10g}")
    return Advice(
        f"{log.name}: from the logged voltage, K_t is {times:.3g} times that in "
        f"{identification.described_in}: "
        f"{' and '.join(identification.columns[signal].name for signal in signals)} look {says}: expected "
        f"{' and '.join(_as_toml(key, value) for key, value in cure.items())}",
        cure,
    )


def _of_current(identification: Identification, log: Log, times: float, says: str, scale: float) -> Advice:
    cure = {
        f"columns.{signal}.scale": float(f"{identification.columns[signal].scale * scale:.10g}")
        for signal in ("i_q", "i_q_ref", "i_d")
        if signal in log and signal in identification.columns
    }
    return Advice(
        f"{log.name}: from the logged voltage, R is {times:.3g} times that in {identification.described_in}: "
        f"{identification.columns['i_q'].name} is 1000 times too {says}: expected "
        f"{' and '.join(_as_toml(key, value) for key, value in cure.items())}",
        cure,
    )


def _as_toml(key: str, value: str | float) -> str:
    return f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:g}"


def _of_parts(identification: Identification, log: Log) -> tuple[Array, Array] | None:
    """K_e and R by means over parts of a log, and their errors at 95 %; None: not known from this log."""
    if not log.dt or not {"u_q", "i_q", "theta"} <= log.signals.keys() or log.kind in UNDRIVEN:
        return None
    rows = max(MEAN_ROWS, len(log) // PARTS_MOST)
    means = {
        name: np.concatenate([_means(log[name][stretch], rows) for stretch in log.stretches])
        for name in ("u_q", "i_q", "i_d")
        if name in log
    }
    speeds = np.concatenate(
        [_means(np.gradient(log["theta"][stretch], log.dt), rows) for stretch in log.stretches]
    )
    if len(speeds) < PARTS_LEAST:
        return None
    star = identification.motor.star()
    voltages = means["u_q"] - star.pole_pairs * speeds * star.L_d * means.get("i_d", 0.0)
    fitted = _fitted(speeds, means["i_q"], voltages, np.sign(means["i_q"]))
    return None if fitted is None else (fitted[0][:2], fitted[1][:2])


def _means(values: Array, rows: int) -> Array:
    count = len(values) // rows
    return np.asarray(values[: count * rows].reshape(count, rows).mean(axis=1))


class Agreement(str):
    """A remark that finds nothing wrong."""


def check(identification: Identification, logs: Sequence[Log]) -> list[str]:
    """Sentences on the described K_t, compared with the voltage, and on the current's unit, by R."""
    constants = constants_from_voltage(identification, logs)
    if constants is None:
        return []
    k_t, resistance = constants
    return [_of_k_t(identification, k_t), *_of_r(identification, resistance)]


def _of_k_t(identification: Identification, measured: Value) -> str:
    described = identification.motor.star().K_t
    says = f"From the logged voltage, K_t is {measured.value:.4g} +- {measured.error:.2g} N*m/A"
    if abs(measured.value - described) <= measured.error:
        return Agreement(f"{says}, as {identification.described_in} has it ({described:.4g}).")
    says += f"; {identification.described_in} has {described:.4g}"
    if abs(measured.value - described) <= K_T_DIFFERENCE * described + measured.error:
        return (
            f"{says}. Magnets that are 50 K warmer, or a wrong gain of the voltage's measurement, would also "
            "make this difference, so it is open which value is right; all torques are in proportion to K_t."
        )
    if measured.value <= 2 * measured.error:
        return f"{says}: the signs of u_q, of i_q and of the angle do not fit each other."
    times = max(described / measured.value, measured.value / described)
    mixed = mixed_up(times, measured.error / measured.value)
    return Advice(
        f"{says}{mixed}: all torques are in proportion to K_t; correct motor.K_t, or K_t_rms if it is per "
        "rms ampere, or kv.",
        {"motor.K_t": f"{measured.value:.6g} N*m/A"},
    )


def _of_r(identification: Identification, measured: Value) -> list[str]:
    """Advice if R is sqrt(2) times the described one: then i_q may be in rms amperes."""
    described = identification.motor.star().R_s
    away = abs(measured.value - PEAK_OVER_RMS * described)
    if measured.error > R_ERROR_MOST * measured.value or away > measured.error:
        return []
    return [
        Advice(
            f"From the logged voltage, R is {measured.value:.3g} +- {measured.error:.2g} ohm, sqrt(2) times "
            f"that in {identification.described_in} ({described:.3g}). Either i_q is in rms amperes, and all "
            f"torques are sqrt(2) times too small, or the winding is {TEMPERATURE_RISE:.0f} K warmer; record "
            "i_a and i_b to decide this.",
            recording(signal="i_a"),
        )
    ]
