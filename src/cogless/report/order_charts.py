"""Charts by order: spectra of whole runs, and amplitudes piece by piece.

A spectrum has the speed's amplitude by electrical or mechanical order, computed over the angle.

The pieces of a run follow one another; their amplitudes are drawn over time, or over speed if the speed
sweeps. A piece is a whole number of the reference's mechanical revolutions, so that all controllers share
the pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cogless.report.charts import Bars, OverRun, Series, Spectrum, Waterfall
from cogless.report.comparison import pretty, speed_unit
from cogless.report.markup import number, place
from cogless.report.panels import learned_terms, varies_in
from cogless.report.speed_tracking import TRACKING_ROWS
from cogless.results import Results, Run
from cogless.results.metrics import onward
from cogless.results.trace import Array, Trace
from cogless.results.windows import late
from cogless.study.metric import turns_held
from cogless.units import ANGULAR_SPEED, TURN, factor

SHOWN_ORDERS = 24  # mechanical orders with bars, the strongest
SPEED_ERROR_MOST = 0.05  # share of the reference: with a smaller error the drive is up to speed
REVERSAL_SHARE = 0.01  # share of the rotor's travel: turning back by less is ignored

SPECTRA_NOTE = (
    "Amplitude of each order, integrated over angle in the last whole revolutions of the run. The baseline's "
    "bars are the ripple without learning. The short line above a bar is that controller's amplitude in its "
    "first revolution."
)


def spectra(results: Results, runs: Sequence[Run]) -> list[Spectrum]:
    """Charts of the speed by electrical and mechanical order, late in the run and where each law began."""
    pole_pairs, unit = results.study.motor.pole_pairs, speed_unit(results)
    scale = factor(unit, ANGULAR_SPEED)
    highest = min(_highest(results, run) for run in runs)
    all_spectra = [(place(results, run), *_before_and_after(results, run, highest)) for run in runs]
    with_end = [(where, early, after) for where, early, after in all_spectra if after is not None]
    if not with_end:
        return []
    peaks = np.fmax.reduce([after for _, _, after in with_end])  # NaN only if all are NaN
    electrical = np.arange(1, min(12, (len(peaks) - 1) // pole_pairs) + 1)
    strongest = np.argsort(np.nan_to_num(peaks))[::-1][:SHOWN_ORDERS]
    mechanical = np.sort(strongest[peaks[strongest] > 1e-3 * np.nanmax(peaks)])
    frames = [("electrical", electrical, pole_pairs, "")]
    if pole_pairs > 1:
        frames.append(("mechanical", mechanical, 1, ", the strongest"))
    drawn = "speed error" if any(_signal(run) == "omega_error" for run in runs) else "speed"
    return [
        Spectrum(
            title=f"{drawn.capitalize()} by {frame} order{which}",
            x=f"order of the {frame} revolution",
            quantity=f"{drawn} amplitude",
            unit=pretty(unit),
            orders=orders.tolist(),
            series=[
                Bars(
                    controller=where,
                    values=after[orders * step] / scale,
                    early=None if early is None else early[orders * step] / scale,
                )
                for where, early, after in with_end
            ],
        )
        for frame, orders, step, which in frames
        if len(orders)
    ]


def _signal(run: Run) -> str:
    """The speed signal, or the error if the reference varies late in the run and would hide the ripple."""
    return "omega_error" if varies_in(run.trace, "omega_ref", len(run.trace) // 2) else "omega_m"


def turned_back(results: Results, runs: Sequence[Run]) -> str:
    """A note on spectra that cover only part of the travel, because the rotor turns back; "" if none does."""
    ways, when = [], ""
    for run in runs:
        theta = run.trace.part("theta_m", late(results, run))
        if len(theta) > 1 and not left_out(results, run):
            when = _when(results, run)
            if _way(theta) - _turns(theta) > REVERSAL_SHARE * _way(theta):
                ways.append(f"{results.study.label(run.controller)} {_way_in_words(theta)}")
    if not ways:
        return ""
    longest = f"Only the longest travel in one direction counts: {'; '.join(ways)}"
    return f"The rotor turns back {when}. {longest}."


def left_out(results: Results, run: Run) -> str:
    """A sentence why a controller has no spectrum; "" if it has one."""
    rows, pole_pairs = late(results, run), results.study.motor.pole_pairs
    theta, x = run.trace.part("theta_m", rows), run.trace.part(_signal(run), rows)
    if len(theta) < 2 or order_spectrum(theta, x, pole_pairs, pole_pairs) is not None:
        return ""
    why = f"it turns less than an electrical revolution in one direction, {_way_in_words(theta)}"
    if not np.all(np.isfinite(theta) & np.isfinite(x)):
        why = "not all of its numbers are finite"
    return f"{results.study.label(run.controller)} has no bars: {_when(results, run)} {why}."


def _when(results: Results, run: Run) -> str:
    """The times between which a run's spectrum is taken, in words."""
    return "between {:.4g} and {:.4g} s".format(*run.trace.time[late(results, run)][[0, -1]])


def _way_in_words(theta: Array) -> str:
    return f"{number(_turns(theta))} of {number(_way(theta))} revolutions"


def _way(theta: Array) -> float:
    """Revolutions turned, both directions added up."""
    return float(np.sum(np.abs(np.diff(theta)))) / TURN


def _turns(theta: Array) -> float:
    """Revolutions of the longest travel in one direction; 0 if an angle isn't finite."""
    return float(np.ptp(theta)) / TURN if len(theta) and np.all(np.isfinite(theta)) else 0.0


def _highest(results: Results, run: Run) -> int:
    """The highest mechanical order to compute: 24 electrical orders, or as many as the rows resolve."""
    theta = run.trace.part("theta_m", late(results, run))
    turned = _turns(theta)
    most = 24 * results.study.motor.pole_pairs
    return min(most, int(len(onward(theta, theta)[0]) / turned / 2.5)) if turned > 1e-9 else most


def _before_and_after(results: Results, run: Run, highest: int) -> tuple[Array | None, Array | None]:
    """Order amplitudes over the first revolution of a controller that learns, and late in the run."""
    rows, pole_pairs = late(results, run), results.study.motor.pole_pairs
    if rows.stop - rows.start < 2:
        return None, None
    trace, signal = run.trace, _signal(run)

    def spectrum(part: slice) -> Array | None:
        return order_spectrum(trace.part("theta_m", part), trace.part(signal, part), highest, pole_pairs)

    after = spectrum(rows)
    if after is None or not learned_terms(results, run):
        return None, after
    # The controller's first revolution begins when the speed first comes near the reference.
    begin = _first(
        trace,
        0,
        lambda part: (
            np.abs(trace.part("omega_error", part))
            <= SPEED_ERROR_MOST * np.abs(trace.part("omega_ref", part))
        ),
    )
    if begin is None:
        return None, after
    start = trace.part("theta_m", slice(begin, begin + 1))
    end = _first(trace, begin, lambda part: np.abs(trace.part("theta_m", part) - start) >= TURN)
    if end is None or end >= rows.start:
        return None, after
    return spectrum(slice(begin, end + 1)), after


def _first(trace: Trace, begin: int, holds: Callable[[slice], NDArray[np.bool_]]) -> int | None:
    """The first row from `begin` on where `holds` is true; None if there is none."""
    for rows in trace.blocks(slice(begin, None)):
        matches = np.flatnonzero(holds(rows))
        if len(matches):
            return int(rows.start + matches[0])
    return None


def order_spectrum(theta_m: Array, x: Array, highest: int, pole_pairs: int) -> Array | None:
    """Amplitudes of the mechanical orders 0 to `highest`, in x's unit; order 0 is set to zero.

    They are computed on an even grid of angle, over the last whole mechanical revolutions of the longest
    travel in one direction. Every pole_pairs-th order is an electrical one. With less than a mechanical
    revolution, the last whole electrical revolutions are used: then only electrical orders have values, and
    the others are NaN. None if there is less than an electrical revolution, or if numbers aren't finite.
    """
    if len(x) < 2 or not np.all(np.isfinite(theta_m) & np.isfinite(x)):
        return None
    theta_m, x = onward(theta_m, x)
    travelled = np.abs(theta_m - theta_m[0])
    turned, rows = float(travelled[-1]) / TURN, max(1, len(x) - 1)
    if (turns := math.floor(turns_held(turned, turned / rows))) >= 1:
        span, stride = turns * TURN, 1
    elif (turns := math.floor(turns_held(turned * pole_pairs, turned * pole_pairs / rows))) >= 1:
        span, stride = turns * TURN / pole_pairs, pole_pairs
    else:
        return None
    cycles = round(span * stride / TURN)
    per_cycle = max(2 * highest // stride + 2, len(x) // cycles)
    grid = travelled[-1] - span + np.arange(cycles * per_cycle) * (span / (cycles * per_cycle))
    bins = 2 * np.abs(np.fft.rfft(np.interp(grid, travelled, x))) / len(grid)
    amplitudes = np.full(highest + 1, np.nan)
    amplitudes[::stride] = bins[::cycles][: highest // stride + 1]
    amplitudes[0] = 0.0
    return amplitudes


PIECES_MOST = 48  # pieces of a run
PIECES_LEAST = 8  # pieces of a run, for charts piece by piece
SWEEP_RATIO = 1.5  # fastest / slowest piece, from which on the speed sweeps
ORDERS_FOLLOWED = 4  # orders with a chart, the strongest
CHART_ORDER_MOST = 120  # highest mechanical order of a piece
# a piece is longer by this share of a revolution, as the rotor may lag behind its reference
PIECE_SLACK = 0.05

WATERFALL_NOTE = (
    "Amplitude of each order of the mechanical revolution at each speed. A fuller colour is a larger "
    "amplitude; the colours cover two decades. What depends on the angle makes an upright line. A resonance "
    "runs across the chart, because its order falls as the speed rises."
)
TRACKING_NOTE = (
    "The strongest orders of the speed error. Each point is from a piece of whole revolutions. The points "
    "are drawn over the speed if the speed sweeps, else over time, which shows how fast each frequency is "
    "learned."
)


@dataclass(frozen=True)
class Tracked:
    """Order amplitudes of a scenario's runs, in its unit of speed: a row per piece, a column per order."""

    times: Array  # s, at the end of each piece
    speeds: Array  # rad/s, mean magnitude
    amplitudes: dict[int, Array]  # the key is the controller's index

    @property
    def sweeps(self) -> bool:
        return bool(np.max(self.speeds) >= SWEEP_RATIO * np.min(self.speeds))

    @cached_property
    def followed(self) -> list[int]:
        """The orders to follow, ascending.

        They are ranked by the median amplitude over the pieces, for the controller in which that is largest.
        """
        typical = np.max([_median(amplitudes) for amplitudes in self.amplitudes.values()], axis=0)
        strongest = np.argsort(typical)[::-1][:ORDERS_FOLLOWED]
        return sorted(int(n) + 1 for n in strongest if typical[n] > 0)


def tracked(results: Results, runs: Sequence[Run]) -> Tracked | None:
    """The runs' order amplitudes; None if the reference turns too little or nothing can be computed."""
    trace, poles = runs[0].trace, results.study.motor.pole_pairs
    turned = _revolutions(trace)
    whole = int(turned[-1] + 1e-6)
    piece_turns = max(1, -(-whole // PIECES_MOST))
    if whole // piece_turns < PIECES_LEAST:
        return None
    ends = [int(np.searchsorted(turned, k * piece_turns)) for k in range(whole // piece_turns + 1)]
    del turned  # it is as long as the run
    pieces = [slice(a, b) for a, b in pairwise(ends)]
    scale = factor(speed_unit(results), ANGULAR_SPEED)
    by_place = {}
    for run in runs:
        rows = [_amplitudes(run.trace, piece, piece_turns, poles) / scale for piece in pieces]
        if np.any(np.isfinite(rows)):
            by_place[place(results, run)] = np.array(rows)
    times = trace.time[[min(piece.stop, len(trace) - 1) for piece in pieces]]
    speeds = np.array([np.mean(_speed(trace, piece)) for piece in pieces])
    return Tracked(times, speeds, by_place) if by_place else None


def _revolutions(trace: Trace) -> Array:
    """Revolutions of the reference until each row. Of a long trace this is the only array of its length."""
    turned, before = np.empty(len(trace)), 0.0
    for at in range(0, len(trace), TRACKING_ROWS):
        speed = _speed(trace, slice(at, at + TRACKING_ROWS))
        speed[0] += before
        before = np.cumsum(speed, out=turned[at : at + TRACKING_ROWS])[-1]
    turned *= trace.period
    turned /= TURN
    return turned


def _speed(trace: Trace, rows: slice) -> Array:
    """Magnitude of the reference, rad/s; 0 where it is not finite."""
    speed = np.nan_to_num(trace.part("omega_ref", rows))
    return np.abs(speed, out=speed)


def _amplitudes(trace: Trace, piece: slice, turns: int, pole_pairs: int) -> Array:
    """Amplitudes, rad/s, of the speed error's orders to CHART_ORDER_MOST; NaN if rows don't resolve them."""
    longer = slice(piece.start, piece.stop + math.ceil(PIECE_SLACK * (piece.stop - piece.start) / turns))
    amplitudes = np.full(CHART_ORDER_MOST, np.nan)
    theta, error = trace.part("theta_m", longer), trace.part("omega_error", longer)
    highest = min(CHART_ORDER_MOST, int((piece.stop - piece.start) / turns / 2.5))
    spectrum = order_spectrum(theta, error, highest, pole_pairs) if highest > 0 else None
    if spectrum is not None:
        amplitudes[:highest] = spectrum[1:]
    return amplitudes


def _median(amplitudes: Array) -> Array:
    """Median over the pieces that resolve an order; 0 where none does."""
    median = np.zeros(amplitudes.shape[1])
    some = np.any(np.isfinite(amplitudes), axis=0)
    median[some] = np.nanmedian(amplitudes[:, some], axis=0)
    return median


def waterfall(results: Results, orders: Tracked | None) -> list[Waterfall]:
    """Charts of amplitude by order and speed, one per controller; empty if the speed doesn't sweep."""
    if orders is None or not orders.sweeps:
        return []
    by_speed = np.argsort(orders.speeds)
    highest_shown = max(
        int(np.max(np.flatnonzero(_median(x) > 0), initial=0)) + 1 for x in orders.amplitudes.values()
    )
    top = max(float(np.nanmax(x)) for x in orders.amplitudes.values())
    unit = speed_unit(results)
    return [
        Waterfall(
            title="Orders over speed",
            x="order of the mechanical revolution",
            quantity="speed",
            unit=pretty(unit),
            controller=controller,
            top=top,
            speeds=orders.speeds[by_speed] / factor(unit, ANGULAR_SPEED),
            orders=highest_shown,
            values=x[by_speed, :highest_shown].ravel(),
        )
        for controller, x in orders.amplitudes.items()
    ]


def tracking(results: Results, runs: Sequence[Run], orders: Tracked | None) -> list[OverRun]:
    """A chart of each strong order over speed if that sweeps; else over time, if a law learns."""
    if orders is None or not (orders.sweeps or any(learned_terms(results, run) for run in runs)):
        return []
    unit = pretty(speed_unit(results))
    along = np.argsort(orders.speeds) if orders.sweeps else np.arange(len(orders.times))
    x = orders.speeds[along] / factor(speed_unit(results), ANGULAR_SPEED) if orders.sweeps else orders.times
    return [
        OverRun(
            title=f"Order {order} of the mechanical revolution",
            x=f"speed ({unit})" if orders.sweeps else "time (s)",
            quantity="amplitude",
            unit=unit,
            along=x,
            series=[
                Series(controller=controller, values=values[along, order - 1])
                for controller, values in orders.amplitudes.items()
            ],
        )
        for order in orders.followed
    ]
