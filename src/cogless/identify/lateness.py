"""Find how late i_q is logged after the angle, from the described controller that made the current.

The law answers each step of the angle, and holds its current between its own samples. So the way in which i_q
follows the angle shows where in the law's period i_q was logged; no torque balance shows this. A filter from
angle to i_q is fitted to the log, and to the simulated log with delayed currents. The delays at which both
filters agree, over all logs, are the likely ones. A dead time that is not described also changes how the
current follows; a simulation with more dead time shows in which way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.results.trace import Array, Trace

ANGLE_ROWS = 5  # rows in which i_q follows the angle
LATE_ROWS_MOST = 5  # largest delay of i_q that is tried, rows of a log
LATENESS_ROWS_LEAST = 300  # least rows of a log
MISFIT_MOST = 0.1  # share of what the filter explains: with more misfit the law is not the described one
GAIN_ERROR = 0.01  # relative error of the filter's gain, by the law's inertia and the current sensors
DELAYS_A_ROW = 20  # delays that are tried between two rows of the trace
LIKELY_EXCESS = 4.0  # excess of the objective over its least, in variances: 95 % of one value
NO_FILTERS: Mapping[str, Array] = MappingProxyType({})
NO_VALUE = Value(0.0, 0.0)


@dataclass(frozen=True)
class Lateness:
    """The delay of i_q, s, and the drive's dead time as a part of the simulated one; or a remark why not."""

    delay: Value | None
    part: Value = NO_VALUE
    remark: str = ""


@dataclass(frozen=True, eq=False)
class Profile:
    """How well each delay, s, explains a log.

    `away`: squared distance of the log's filter from the simulated one, in variances, for each delay.
    `part`: the part of the added dead time that explains most of the distance. `information`: 1 / variance of
    the part. `misfit`: the share of what the log's filter explains that no delay explains.
    """

    delays: Array
    away: Array
    part: Array
    information: Array
    misfit: float


def lateness(
    logs: Sequence[Log],
    traces: Mapping[str, Trace],
    bandwidth: float,
    period: float,
    with_dead_time: Mapping[str, Array] = NO_FILTERS,
    by_balance: Value | None = None,
) -> Lateness:
    """The delay of i_q by the logs that follow the described law; None and a remark if no log does.

    The delay is the middle of all likely delays, and their range gives its error. `bandwidth`: of the current
    loop, rad/s. `period`: of the law, s; rows between the law's samples are not used. `with_dead_time`:
    filters of a drive with more dead time; with them the dead time is fitted, too. `by_balance`: the delay by
    the balance of torques, s, which counts as one more log unless the law contradicts it.
    """
    profiles: list[Profile] = []
    unlike: list[tuple[float, str]] = []
    for log in logs:
        if "i_q" not in log or log.name not in traces or len(log) < LATENESS_ROWS_LEAST:
            continue
        every = _every(log, period)
        profile = _profile(log, every, traces[log.name], with_dead_time.get(log.name))
        if profile.misfit > MISFIT_MOST:
            unlike.append((profile.misfit, log.name))
        elif np.ptp(profile.away) > 0:
            profiles.append(profile)
    if not profiles:
        return Lateness(None, remark="".join(_misfit_remark(*most) for most in sorted(unlike)[:1]))
    delays = min((profile.delays for profile in profiles), key=lambda delays: float(delays[1]))
    away = np.array([np.interp(delays, profile.delays, profile.away) for profile in profiles])
    together = np.sum(away, axis=0)
    least = float(np.min(together))
    # how much the logs contradict each other
    apart = (least - float(np.sum(np.min(away, axis=1)))) / max(1, len(away) - 1)
    unlikely = LIKELY_EXCESS * max(1.0, apart)
    if by_balance is not None:
        with_balance = together + LIKELY_EXCESS * ((delays - by_balance.value) / by_balance.error) ** 2
        if float(np.min(with_balance)) <= least + unlikely:
            together = with_balance
    likely = delays[together <= float(np.min(together)) + unlikely]
    # Between two rows of a trace the current moves exponentially, not linearly; this bounds the error.
    between = max(trace.period for trace in traces.values()) ** 2 * bandwidth / 8
    first, last = float(likely[0]), float(likely[-1])
    delay = Value((first + last) / 2, (last - first + float(delays[1])) / 2 + between)
    return Lateness(delay, _part(profiles, delay))


def _part(profiles: Sequence[Profile], delay: Value) -> Value:
    """The drive's part of the added dead time by all logs; the error is larger if the logs disagree."""

    def parts_at(late: float) -> tuple[Array, Array]:
        pairs = [
            (np.interp(late, p.delays, p.part), np.interp(late, p.delays, p.information)) for p in profiles
        ]
        parts, information = np.transpose(pairs)
        return parts, information

    def mean(late: float) -> float:
        parts, information = parts_at(late)
        return float(parts @ information) / max(float(np.sum(information)), 1e-300)

    parts, information = parts_at(delay.value)
    if not np.any(information):
        return NO_VALUE
    middle = mean(delay.value)
    apart = float((parts - middle) ** 2 @ information) / max(1, len(parts) - 1)
    own = 2 * np.sqrt(max(1.0, apart) / np.sum(information))
    by_delay = (mean(delay.value + delay.error) - mean(delay.value - delay.error)) / 2
    return Value(middle, float(np.hypot(own, by_delay)))


def _misfit_remark(misfit: float, log: str) -> str:
    return (
        f"{log}: i_q does not follow the angle as the described controller would make it "
        f"({100 * misfit:.0f} % differs): its gains, or the drive's rates, filter or bandwidth, are not as "
        "described. So the delay is known only to half a period of the law."
    )


def _profile(log: Log, every: int, trace: Trace, with_dead_time: Array | None) -> Profile:
    """The profile of a log; what neither delay nor dead time explains counts as noise."""
    step = max(1, round(every * log.dt / trace.period))
    thinned = [slice(rows.start, rows.stop, every) for rows in log.stretches]
    x = np.concatenate([_motion(log["theta"][rows], every * log.dt) for rows in thinned])
    y = np.concatenate([_changes(log["i_q"][rows]) for rows in thinned])
    taps, *_ = np.linalg.lstsq(x, y, rcond=1e-9)
    noise = float(np.mean((y - x @ taps) ** 2))
    filters = _filters(trace, step)
    # distances of filters are weighed by the log's information on each tap
    metric = np.linalg.qr(x, mode="r")
    off = metric @ (taps[:, None] - filters)
    explained = max(float(np.sum((metric @ taps) ** 2)), 1e-300)
    misfit = float(np.min(np.sum(off**2, axis=0))) / explained
    along = metric @ filters
    lengths = np.maximum(np.sqrt(np.sum(along**2, axis=0)), 1e-300)
    shrunk = 1 - 1 / np.sqrt(1 + (GAIN_ERROR * lengths) ** 2 / max(2 * noise, 1e-300))

    def weighed(x: Array) -> Array:
        """The vectors with a smaller part along the filter, since the filter's gain is not known exactly."""
        return np.asarray(x - shrunk * along / lengths**2 * np.sum(along * x, axis=0))

    off, free = weighed(off), len(taps) - 1
    part = squares = np.zeros(off.shape[1])
    if with_dead_time is not None:
        moved = weighed(metric @ (with_dead_time - filters))
        squares = np.sum(moved**2, axis=0)
        part = np.divide(np.sum(moved * off, axis=0), squares, out=np.zeros_like(squares), where=squares > 0)
        off, free = off - part * moved, free - 1
    rest = np.sum(off**2, axis=0)
    spread = max(2 * noise, float(np.min(rest)) / free, 1e-300)  # Both filters have noise.
    delays = np.asarray(trace.period / DELAYS_A_ROW * np.arange(len(rest)), dtype=np.float64)
    return Profile(delays, rest / spread, part, squares / spread, misfit)


def trace_filters(log: Log, trace: Trace, period: float) -> Array:
    """The filters of a simulated log's rows, one for each sample of the law. `period`: of the law, s."""
    return _filters(trace, max(1, round(_every(log, period) * log.dt / trace.period)))


def _every(log: Log, period: float) -> int:
    """Rows of a log for each period of the law, s, or 1."""
    return max(1, round(period / log.dt))


def _filters(trace: Trace, step: int) -> Array:
    """The filters of a trace's every step-th row: a row for each tap, a column for each of the delays."""
    columns = _motion(np.unwrap(trace["theta_measured"])[::step], step * trace.period)
    late = np.arange(LATE_ROWS_MOST * step + 1)
    current = np.concatenate((trace["i_q"][:1].repeat(late[-1]), trace["i_q"]))
    of_delays = np.lib.stride_tricks.sliding_window_view(current, len(late))[::step, ::-1]
    sides = columns.T @ _changes(of_delays)
    filters, *_ = np.linalg.lstsq(columns.T @ columns, sides, rcond=1e-12)
    fine = np.arange((len(late) - 1) * DELAYS_A_ROW + 1) / DELAYS_A_ROW
    return np.array([np.interp(fine, late, tap) for tap in filters])


def _motion(theta: Array, dt: float) -> Array:
    """Columns for each row: the last ANGLE_ROWS changes of the speed, and the speed a row before."""
    omega = np.diff(theta) / dt
    changes = np.diff(omega)
    rows = np.arange(ANGLE_ROWS - 1, len(changes))
    columns = [changes[rows - tap] for tap in range(ANGLE_ROWS)]
    return np.column_stack((*columns, omega[rows - 1]))


def _changes(current: Array) -> Array:
    """The change of the current in each row of `_motion`, or of currents, each in a column."""
    return np.diff(current[ANGLE_ROWS:], axis=0)
