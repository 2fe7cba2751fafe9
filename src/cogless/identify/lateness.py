"""How late i_q is logged after the angle, from the described controller that made it.

The law answers each step of the angle, and holds its current between its own samples. So how i_q follows the
angle tells where in the law's period it was logged, which no torque balance can tell. A filter from angle to
i_q is fitted to the log, and to the simulated log with its currents so many rows later: where they agree is
the delay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from cogless.identify.files import Array
from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.results.trace import Trace

TAPS = 5  # rows in which i_q follows the angle
LATEST = 5  # rows of a log by which i_q is late, at most
FEWEST = 300  # rows
MISFIT = 0.1  # of what the filter explains: from here on the law is not the described one


def lateness(logs: Sequence[Log], traces: Mapping[str, Trace], bandwidth: float) -> tuple[Value | None, str]:
    """The delay of i_q, s, by the logs that follow the described law; None, and why: no log does.

    `bandwidth`: of the current loop, rad/s.
    """
    found: list[tuple[float, float]] = []
    unlike: list[tuple[float, str]] = []
    for log in logs:
        if "i_q" not in log or log.name not in traces or len(log) < FEWEST:
            continue
        delay, variance, misfit = _of(log, traces[log.name])
        if misfit > MISFIT:
            unlike.append((misfit, log.name))
        elif np.isfinite(variance):
            found.append((delay, variance))
    if not found:
        return None, "".join(_said(*most) for most in sorted(unlike)[:1])
    delays, variances = np.array(found).T
    between_logs = _between(delays, variances)
    weights = 1 / (variances + between_logs)
    mean = float(np.average(delays, weights=weights))
    few = student.ppf(0.975, len(delays) - 1) if between_logs else 2.0
    chosen = float(few / np.sqrt(np.sum(weights)))
    # between two rows the current moves by an exponential, not a line
    between = max(trace.period for trace in traces.values()) ** 2 * bandwidth / 8
    return Value(mean, chosen + between), ""


def _between(values: Array, variances: Array) -> float:
    """Variance between logs beyond their own, s^2 (DerSimonian and Laird): an unknown dead time, say."""
    weights = 1 / variances
    mean = float(np.average(values, weights=weights))
    excess = float(np.sum(weights * (values - mean) ** 2)) - (len(values) - 1)
    scale = float(np.sum(weights) - np.sum(weights**2) / np.sum(weights))
    return max(0.0, excess / scale) if scale > 0 else 0.0


def _said(misfit: float, log: str) -> str:
    return (
        f"{log}: i_q does not follow the angle as under the described controller "
        f"({100 * misfit:.0f} % differs), so the delay is only told within half a period of the law; check "
        "its gains, and the drive's rates, filter and bandwidth in the file of columns."
    )


def _of(log: Log, trace: Trace) -> tuple[float, float, float]:
    """The delay of one log, s, its variance, and the share of what its filter explains that no delay does.

    Between the trace's rows the filter is taken as linear in the delay.
    """
    step = max(1, round(log.dt / trace.period))
    real = [_moves(log["theta"][rows], log["i_q"][rows], log.dt) for rows in log.stretches]
    x, y = (np.concatenate(parts) for parts in zip(*real, strict=True))
    squares = x.T @ x
    taps, *_ = np.linalg.lstsq(x, y, rcond=1e-9)
    noise = float(np.mean((y - x @ taps) ** 2))
    theta, current = np.unwrap(trace["theta_measured"])[::step], trace["i_q"]
    late = range(LATEST * step + 1)
    sides = []
    for rows in late:
        moved = np.concatenate((current[:1].repeat(rows), current[: len(current) - rows]))[::step]
        columns, changes = _moves(theta, moved, log.dt)
        sides.append(columns.T @ changes)
    filters, *_ = np.linalg.lstsq(columns.T @ columns, np.transpose(sides), rcond=1e-12)
    # both filters have noise; both in the metric of the log's information
    best = (np.inf, 0.0, np.inf)
    for rows, (a, b) in zip(late, pairwise(filters.T), strict=False):
        along, off = b - a, taps - a
        bend = float(along @ squares @ along)
        part = float(np.clip(along @ squares @ off / bend, 0.0, 1.0)) if bend > 0 else 0.0
        left = off - part * along
        best = min(best, (float(left @ squares @ left), (rows + part) * trace.period, bend))
    squared, delay, bend = best
    misfit = squared / max(float(taps @ squares @ taps), 1e-300)
    # what a wrong dead time or noise leaves counts as noise of the taps
    spread = max(noise, squared / len(taps))
    if bend <= 0:
        return delay, np.inf, misfit
    # a current that has settled looks alike for a while: all delays that are as likely are in the error
    away = taps[:, None] - filters
    likely = np.sum(away * (squares @ away), axis=0) < squared + 4 * 2 * spread
    reach = np.abs(trace.period * np.arange(len(likely)) - delay)[likely]
    variance = max(2 * spread / bend * trace.period**2, float(np.max(reach, initial=0.0)) ** 2 / 4)
    return delay, variance, misfit


def _moves(theta: Array, current: Array, dt: float) -> tuple[Array, Array]:
    """Changes of the speed in the rows before each, and that speed; and the change of the current."""
    omega = np.diff(theta) / dt
    changes = np.diff(omega)
    rows = np.arange(TAPS - 1, len(changes))
    columns = [changes[rows - tap] for tap in range(TAPS)]
    return np.column_stack((*columns, omega[rows - 1])), np.diff(current)[1:][rows]
