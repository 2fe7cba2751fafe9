"""Compute metrics from a trace, over declared windows. Values are SI; None is a step that never settles.

Each kind of metric is a function in the registry METRIC_FUNCTIONS; `evaluate` finds the window and calls it.
In a study of trials, a metric has one number per trial, or one per phase, from one change to the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.results.trace import Array, Trace
from cogless.study.metric import (
    CARRIAGE_ORDERS,
    ROWS_OF_PULSES_LEAST,
    SIGNAL_DIMENSIONS,
    Conditions,
    Metric,
    turns_held,
    whole_revolutions,
)
from cogless.study.metric import result_name as result_name
from cogless.units import ANGLE, ANGULAR_SPEED, TURN

Value = float | None | list[float]

# Signals with a target. Any other signal should return to its mean from before the event.
ERROR_SIGNALS = ("omega_error", "omega_error_measured")  # target: zero
REFERENCES = {"omega_m": "omega_ref", "omega_measured": "omega_ref", "i_d": "i_d_ref", "i_q": "i_q_ref"}
REFERENCE_SPREAD_MOST = 1e-9  # share of the speed, by which rounding may vary a constant reference
SETTLED_SHARE = 1 / 2  # share of a phase's trials, at its end, that final-rms uses


class TooFewTurnsError(ValueError):
    """An angle that makes no whole revolution, or isn't finite."""


@dataclass(frozen=True)
class MetricInput:
    """Input to a metric's function: metric, whole trace, conditions, and rows in the metric's window."""

    metric: Metric
    trace: Trace
    conditions: Conditions
    rows: slice

    @property
    def signal(self) -> str:
        if self.metric.signal is None:
            raise self.error("expected a signal")
        return self.metric.signal

    @property
    def x(self) -> Array:
        """The signal in the metric's window; in trials a matrix with one row per trial."""
        whole = slice(None)
        if self.conditions.trials is not None:
            return self.part(self.signal, whole).reshape(self.conditions.trials, -1)
        if self.metric.smooth is None:
            return self.part(self.signal, self.rows)
        return self._smooth(self.part(self.signal, whole), self.metric.smooth)

    def part(self, signal: str, rows: slice) -> Array:
        """Some rows of a signal; angles and speeds in the metric's frame, electrical or mechanical."""
        x = self.trace.part(signal, rows)
        turned = SIGNAL_DIMENSIONS.get(signal) in (ANGLE, ANGULAR_SPEED) and self.metric.kind != "order"
        return self.conditions.pole_pairs * x if turned and self.metric.frame == "electrical" else x

    def _smooth(self, x: Array, span: float) -> Array:
        """Centred moving average over `span` s, for the rows in the metric's window.

        Rows after the window are not used.
        """
        half = round(span / self.trace.period / 2) if self.trace.period else 0
        total = np.concatenate(([0.0], np.cumsum(x)))
        row = np.arange(self.rows.start, self.rows.stop)
        first, last = np.maximum(row - half, 0), np.minimum(row + half + 1, self.rows.stop)
        return np.asarray((total[last] - total[first]) / (last - first))

    @property
    def phases(self) -> list[slice]:
        """Slices with the trials of each phase."""
        starts = (*self.conditions.starts, (self.conditions.trials or 0) + 1)
        return [slice(a - 1, b - 1) for a, b in pairwise(starts)]

    @property
    def event(self) -> float:
        """Time of the metric's event, s."""
        if self.metric.event is None:
            raise self.error("expected an event")
        return self.metric.event

    def error(self, problem: str) -> StudyError:
        return StudyError(f"metric {self.metric.name}: {problem}")


def evaluate(metric: Metric, trace: Trace, conditions: Conditions) -> Value:
    """Value of a metric on a trace, SI; None for a step that never settles.

    For kind "order" the value is a list, with NaN if the rotor turned too little. In trials it is a list.

    StudyError: the trace lacks the signal, the window is empty, or the rows are too sparse for chattering.
    """
    first, last = window_of(metric, trace, conditions.events)
    metric_input = MetricInput(metric, trace, conditions, trace.window(first, last))
    if metric.signal is not None and metric.signal not in trace:
        raise metric_input.error(f"signal {metric.signal}: expected one of {', '.join(trace.names)}")
    if metric_input.rows.start == metric_input.rows.stop:
        raise metric_input.error(f"window {first:g} s to {last:g} s holds no row of the trace")
    with np.errstate(over="ignore"):  # a square that overflows becomes infinite
        value = METRIC_FUNCTIONS[metric.kind](metric_input)
    return value if value is None or isinstance(value, list) else np.asarray(value).tolist()


def window_of(metric: Metric, trace: Trace, events: Sequence[float]) -> tuple[float, float]:
    """The metric's window, s: as declared, else from its event to the next event, else the whole trace."""
    end = float(trace.time[-1]) if len(trace) else 0.0
    # The row at the next event already shows its effect, so the window ends one row before.
    return metric.window_within(end, events, trace.period, before_event=trace.period)


def peak_to_peak(m: MetricInput) -> Array:
    """Largest minus smallest value, in the signal's unit."""
    return np.asarray(np.ptp(m.x, axis=-1))


def rms(m: MetricInput) -> Array:
    """Root of the mean square, mean included, in the signal's unit."""
    return np.asarray(np.sqrt(np.mean(np.square(m.x), axis=-1)))


def ripple_rms(m: MetricInput) -> Array:
    """Root of the mean square about the mean, in the signal's unit."""
    return np.asarray(np.std(m.x, axis=-1))


def three_sigma(m: MetricInput) -> Array:
    """Three times the root of the mean square about the mean, in the signal's unit."""
    return 3 * ripple_rms(m)


def switching_ripple(m: MetricInput) -> float:
    """Root of the mean square about the moving mean over a period of the PWM, in the signal's unit.

    The moving mean at a row is over the period around this row; rows at both its ends count by half. So
    what is slower than the pulses is left out. A row without a whole period around it doesn't count.
    """
    x, row = m.x, m.trace.period
    count = round(m.conditions.pwm_period / row) if row else 0
    if count < ROWS_OF_PULSES_LEAST:
        raise m.error(f"expected {ROWS_OF_PULSES_LEAST} or more rows of the trace in a period of the PWM")
    half = count // 2
    weights = np.ones(2 * half + 1)
    if count % 2 == 0:
        weights[[0, -1]] = 0.5
    if len(x) < len(weights):
        raise m.error("window is shorter than a period of the PWM")
    smooth = np.convolve(x, weights / count, "valid")
    return float(np.sqrt(np.mean(np.square(x[half : len(x) - half] - smooth))))


def ripple_ratio(m: MetricInput) -> float:
    """(max - min) / |max + min|, no unit: half the peak-to-peak value over the middle; NaN if that is 0."""
    high, low = float(np.max(m.x)), float(np.min(m.x))
    return (high - low) / abs(high + low) if high + low else math.nan


def mean(m: MetricInput) -> Array:
    """Mean over time, in the signal's unit."""
    return np.asarray(np.mean(m.x, axis=-1))


def maximum(m: MetricInput) -> Array:
    """Largest magnitude, in the signal's unit."""
    return np.asarray(np.max(np.abs(m.x), axis=-1))


def order(m: MetricInput) -> list[float]:
    """Amplitude (peak) of each order of an electrical or mechanical revolution, in the signal's unit.

    It is computed over the angle, so a varying speed doesn't smear it. If the rotor reverses, only the
    longest way in one direction is used. NaN if the rotor turned too little, for example because it stalls.
    """
    orders = list(m.metric.order or ())
    theta, electrical = m.trace.part("theta_m", m.rows), m.metric.frame == "electrical"
    try:
        return order_amplitudes(theta, m.x, orders, m.conditions.pole_pairs, electrical)
    except TooFewTurnsError:
        return [math.nan] * len(orders)


def dip(m: MetricInput) -> float:
    """Largest deviation after the event from the mean before it, in the signal's unit."""
    return float(np.max(np.abs(m.x - _mean_before(m))))


def settling(m: MetricInput) -> float | None:
    """Time from the event until the signal stays within the band, s; None when it never does.

    The band lies around the signal's reference, or, without one, around its mean before the event. A signal
    that is outside the band in the last twentieth of the window hasn't settled: it keeps crossing the band.
    """
    time = m.trace.time[m.rows]
    outside = _outside(m, lambda: _mean_before(m))
    if len(outside) == 0:
        return 0.0
    if outside[-1] >= 0.95 * (len(time) - 1):
        return None
    return max(0.0, float(time[outside[-1]]) - m.event)


def overshoot(m: MetricInput) -> float:
    """Distance by which the signal exceeds its final value, in the signal's unit; 0 if it doesn't.

    The final value is the mean over the last quarter of the window. The direction is that from the mean
    before the event to the final value. But a signal whose target stays is thrown off and comes back: then it
    is the direction from the largest deviation to the final value, and what comes before doesn't count.
    """
    x, start = m.x, _mean_before(m)
    end = float(np.mean(x[-max(1, len(x) // 4) :]))
    if _target_stays(m):
        furthest = int(np.argmax(np.abs(x - start)))
        x, start = x[furthest:], float(x[furthest])
    beyond = float(np.max(math.copysign(1.0, end - start) * (x - end)))
    return beyond if math.isnan(beyond) else max(0.0, beyond)


def exceeds(m: MetricInput) -> float | None:
    """Time at which the signal first leaves the band around its reference, s; None when it never does.

    A signal without a reference is compared with its mean over the first tenth of the window.
    """
    outside = _outside(m, lambda: float(np.mean(m.x[: max(1, len(m.x) // 10)])))
    return float(m.trace.time[m.rows][outside[0]]) if len(outside) else None


def time_to_learn(m: MetricInput) -> float | None:
    """Time from the window's start after which the signal's RMS stays within the band, s; None when never.

    The RMS is that of each piece of the window, `smooth` long; a shorter piece at the end doesn't count.
    """
    if m.metric.smooth is None or m.metric.band is None:
        raise m.error("expected a band, and smooth")
    x = m.part(m.signal, m.rows)
    if not m.trace.period:
        raise m.error("window is shorter than smooth")
    piece_rows = max(1, round(m.metric.smooth / m.trace.period))
    pieces = x[: len(x) // piece_rows * piece_rows].reshape(-1, piece_rows)
    if not len(pieces):
        raise m.error("window is shorter than smooth")
    outside = np.flatnonzero(~(np.sqrt(np.mean(pieces**2, axis=1)) <= m.metric.band))
    if len(outside) and outside[-1] == len(pieces) - 1:
        return None
    return float(outside[-1] + 1) * piece_rows * m.trace.period if len(outside) else 0.0


def copper_loss(m: MetricInput) -> float:
    """Mean copper loss R_s (i_d^2 + i_q^2), times 3/2 for three phases or 1 for two, W."""
    i_d, i_q = m.trace.part("i_d", m.rows), m.trace.part("i_q", m.rows)
    return m.conditions.power_factor * m.conditions.R_s * float(np.mean(i_d * i_d + i_q * i_q))


def chattering(m: MetricInput) -> float:
    """Mean |step| of the current reference i_q_ref from one speed-loop sample to the next, A."""
    time, period = m.trace.time[m.rows], m.conditions.speed_period
    if m.trace.period > period * (1 + 1e-6):
        raise m.error(
            f"needs a row for every speed-loop sample: expected trace.rate of {1 / period:g} Hz or more"
        )
    slack = 1e-6 * m.trace.period
    samples = np.arange(math.ceil((time[0] - slack) / period), math.floor((time[-1] + slack) / period) + 1)
    i_q_ref = m.trace.part("i_q_ref", m.rows)[np.searchsorted(time, samples * period - slack)]
    if len(i_q_ref) < 2:
        raise m.error("window holds fewer than two speed-loop samples")
    return float(np.mean(np.abs(np.diff(i_q_ref))))


def carriage_ripple(m: MetricInput) -> float:
    """Rms of the electrical orders in CARRIAGE_ORDERS of a carriage's position, about its mean motion, m.

    The mean motion is the least-squares straight line over the window. Orders are counted along this line.
    NaN if the motor turned too little. StudyError: the reference changes its speed in the window.
    """
    reference = m.part("omega_ref", m.rows)
    if np.ptp(reference) > REFERENCE_SPREAD_MOST * np.max(np.abs(reference)):
        raise m.error("expected a window in which the reference keeps its speed")
    time, angle = m.trace.time[m.rows], m.trace.part(m.signal, m.rows)
    time, angle = time - np.mean(time), angle - np.mean(angle)
    line = time * (np.dot(time, angle) / (np.dot(time, time) or 1.0))
    poles = m.conditions.pole_pairs
    try:
        amplitudes = order_amplitudes(line, angle - line, CARRIAGE_ORDERS, poles, electrical=True)
    except TooFewTurnsError:
        return math.nan
    return m.conditions.carriage_radius * math.sqrt(sum(a * a for a in amplitudes) / 2)


def first_rms(m: MetricInput) -> list[float]:
    """RMS of the first trial of each phase, in the signal's unit."""
    values = rms(m)
    return [float(values[phase.start]) for phase in m.phases]


def final_rms(m: MetricInput) -> list[float]:
    """RMS over the second half of each phase's trials, in the signal's unit."""
    of_phases, values = [], rms(m)
    for phase in m.phases:
        last = values[phase][-max(1, round(SETTLED_SHARE * (phase.stop - phase.start))) :]
        of_phases.append(float(np.sqrt(np.mean(np.square(last)))))
    return of_phases


def trials_to_floor(m: MetricInput) -> list[float]:
    """Trials of each phase until the RMS is at the floor or below; infinite if it never is.

    A value of 1 means that the phase's first trial is there already. Noise may lift a later trial above the
    floor again.
    """
    if m.metric.floor is None:
        raise m.error("expected a floor")
    counts, values = [], rms(m)
    for phase in m.phases:
        below = np.flatnonzero(values[phase] <= m.metric.floor)
        counts.append(float(below[0] + 1) if len(below) else math.inf)
    return counts


METRIC_FUNCTIONS: dict[str, Callable[[MetricInput], Value | Array]] = {
    "peak-to-peak": peak_to_peak,
    "rms": rms,
    "ripple-rms": ripple_rms,
    "three-sigma": three_sigma,
    "switching-ripple": switching_ripple,
    "ripple-ratio": ripple_ratio,
    "mean": mean,
    "maximum": maximum,
    "order": order,
    "dip": dip,
    "settling": settling,
    "overshoot": overshoot,
    "exceeds": exceeds,
    "time-to-learn": time_to_learn,
    "copper-loss": copper_loss,
    "chattering": chattering,
    "first-rms": first_rms,
    "final-rms": final_rms,
    "trials-to-floor": trials_to_floor,
    "carriage-ripple": carriage_ripple,
}


def onward(theta: Array, x: Array) -> tuple[Array, Array]:
    """Angle and x over the longest way in one direction: from one extreme of the angle to the other.

    If an angle was passed several times on this way, only its last passage is kept. Else a signal that
    depends on the direction, such as the speed itself, would be a mix of both directions. If the rotor never
    reverses, all rows are returned. TooFewTurnsError: no rows, or an angle that isn't finite.
    """
    if not len(theta) or not np.all(np.isfinite(theta)):
        raise TooFewTurnsError("expected one angle or more, all finite")
    first, last = sorted((int(np.argmin(theta)), int(np.argmax(theta))))
    way = slice(first, last + 1)
    travelled = np.abs(theta[way] - theta[first])
    stays = travelled <= np.minimum.accumulate(travelled[::-1])[::-1]
    return theta[way][stays], x[way][stays]


def order_amplitudes(
    theta_m: Array, x: Array, orders: Sequence[float], pole_pairs: int, electrical: bool
) -> list[float]:
    """Amplitudes of x at orders of a revolution, in x's unit.

    They are Fourier integrals over the angle, by the trapezoidal rule, over the last whole revolutions of the
    way that `onward` gives. If there is a whole mechanical revolution, mechanical revolutions are used: they
    contain whole periods of every order of the motor, so no order leaks into another. Else electrical orders
    use electrical revolutions. An order that isn't an integer needs enough revolutions for whole periods.
    `theta_m`: unwrapped mechanical angle, rad, in either direction.

    TooFewTurnsError: less than one such revolution, or an angle that isn't finite.
    """
    theta_m, x = onward(theta_m, x)
    frame = theta_m * pole_pairs if electrical else theta_m
    whole = whole_revolutions(orders)
    periods = [math.lcm(whole, pole_pairs), whole] if electrical else [whole]
    turns = abs(float(frame[-1] - frame[0])) / TURN
    for period in periods:
        count = math.floor(turns_held(turns, turns / max(1, len(frame) - 1)) / period)
        if count:
            break
    else:
        name = "electrical" if electrical else "mechanical"
        raise TooFewTurnsError(f"window holds {turns:.3g} {name} revolutions, expected {periods[-1]} or more")
    angle, x = _last_part(frame, x, min(turns, count * period) * TURN)
    step = np.diff(angle)
    span = float(angle[-1] - angle[0])
    # Remove the mean: it would leak into the orders if the span isn't exactly whole revolutions.
    x = x - float(np.dot(step, x[1:] + x[:-1])) / (2 * span)
    amplitudes = []
    for n in orders:
        rotated = x * np.exp(-1j * float(n) * angle)
        integral = np.dot(step, rotated[1:] + rotated[:-1]) / 2
        amplitudes.append(2 * abs(complex(integral)) / abs(span))
    return amplitudes


def _last_part(angle: Array, x: Array, span: float) -> tuple[Array, Array]:
    """The last `span` rad of x over angle; its first point is interpolated."""
    direction = 1.0 if angle[-1] >= angle[0] else -1.0
    travelled = direction * (angle - angle[0])
    start = max(0.0, float(travelled[-1]) - span)
    first = min(int(np.searchsorted(travelled, start, side="right")) - 1, len(angle) - 2)
    share = (start - travelled[first]) / (travelled[first + 1] - travelled[first] or 1.0)
    x_start = x[first] + share * (x[first + 1] - x[first])
    return (
        np.concatenate(([angle[0] + direction * start], angle[first + 1 :])),
        np.concatenate(([x_start], x[first + 1 :])),
    )


def _outside(m: MetricInput, otherwise: Callable[[], float]) -> NDArray[np.intp]:
    """Indices of the rows outside the band around the signal's reference; a row with NaN is outside.

    For a signal without a reference the band is around otherwise().
    """
    if m.metric.band is None:
        raise m.error("expected a band")
    target: Array | float
    if m.signal in ERROR_SIGNALS:
        target = 0.0
    elif m.signal in REFERENCES and REFERENCES[m.signal] in m.trace:
        target = m.part(REFERENCES[m.signal], m.rows)
    else:
        target = otherwise()
    return np.flatnonzero(~(np.abs(m.x - target) <= m.metric.band))


def _target_stays(m: MetricInput) -> bool:
    """Whether the signal has a target that stays the same from the row before the window on."""
    if m.signal not in REFERENCES or REFERENCES[m.signal] not in m.trace:
        return m.signal in ERROR_SIGNALS
    rows = slice(max(m.rows.start - 1, 0), m.rows.stop)
    return float(np.ptp(m.part(REFERENCES[m.signal], rows))) == 0


def _mean_before(m: MetricInput) -> float:
    """Mean of the signal over the last revolution before the event.

    If a revolution takes longer, it is the mean over the second half of the time since the previous event, or
    since the start. NaN if the angle at the event isn't finite.
    """
    event, trace = m.event, m.trace
    previous = max((t for t in m.conditions.events if t < event - trace.period / 2), default=0.0)
    rows = trace.window((previous + event) / 2, event - trace.period)
    if rows.start == rows.stop:
        return float(m.part(m.signal, m.rows)[0])
    theta = trace.part("theta_m", rows)
    if not np.isfinite(theta[-1]):
        return math.nan
    turned = np.abs(theta - theta[-1])
    return float(np.mean(m.part(m.signal, rows)[turned <= TURN]))
