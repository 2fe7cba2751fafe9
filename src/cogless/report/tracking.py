"""Amplitudes of orders, one piece of a run after the other: over time, or over speed where that sweeps.

A piece is a whole number of the reference's mechanical revolutions, so that all controllers share the pieces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from cogless.report.comparison import pretty, speed_unit
from cogless.report.packing import Array, pack, plain
from cogless.report.palette import place
from cogless.report.paths import learned_terms
from cogless.report.spectra import order_spectrum
from cogless.report.status_lanes import BLOCK
from cogless.results import Results, Run
from cogless.results.trace import Trace
from cogless.units import ANGULAR_SPEED, factor

PIECES = 48
FEWEST = 8  # pieces
SWEEP = 1.5  # fastest / slowest piece, from which on the speed sweeps
FOLLOWED = 4  # orders
HIGHEST = 120
SLACK = 0.05  # of a revolution, that a piece is longer: the rotor may lag behind its reference

WATERFALL_NOTE = (
    "Amplitude of each order of the mechanical revolution at each speed: the fuller the colour, the larger, "
    "over two decades. What the angle excites stands upright; a resonance runs across, because its "
    "order falls as the speed rises."
)
NOTE = (
    "The strongest orders of the speed error, one piece of whole revolutions after the other: over the "
    "speed where that sweeps, else over time, which shows how fast each frequency is learned."
)


@dataclass(frozen=True)
class Tracked:
    """Order amplitudes of a scenario's runs, in its unit of speed: a row per piece, a column per order."""

    times: Array  # s, at the end of each piece
    speeds: Array  # rad/s, mean magnitude
    amplitudes: dict[int, Array]  # by place of the controller

    @property
    def sweeps(self) -> bool:
        return bool(np.max(self.speeds) >= SWEEP * np.min(self.speeds))

    @cached_property
    def followed(self) -> list[int]:
        """The orders to follow: the strongest in the median piece of any controller, in ascending order."""
        typical = np.max([_median(found) for found in self.amplitudes.values()], axis=0)
        strongest = np.argsort(typical)[::-1][:FOLLOWED]
        return sorted(int(n) + 1 for n in strongest if typical[n] > 0)


def tracked(results: Results, runs: Sequence[Run]) -> Tracked | None:
    """The runs' order amplitudes; None if the reference turns too little or nothing can be computed."""
    trace, poles = runs[0].trace, results.study.motor.pole_pairs
    turned = _turned(trace)
    whole = int(turned[-1] + 1e-6)
    each = max(1, -(-whole // PIECES))
    if whole // each < FEWEST:
        return None
    ends = [int(np.searchsorted(turned, k * each)) for k in range(whole // each + 1)]
    del turned  # as long as the run
    pieces = [slice(a, b) for a, b in pairwise(ends)]
    scale = factor(speed_unit(results), ANGULAR_SPEED)
    found = {}
    for run in runs:
        rows = [_amplitudes(run.trace, piece, each, poles) / scale for piece in pieces]
        if np.any(np.isfinite(rows)):
            found[place(results, run)] = np.array(rows)
    times = trace.time[[min(piece.stop, len(trace) - 1) for piece in pieces]]
    speeds = np.array([np.mean(_speed(trace, piece)) for piece in pieces])
    return Tracked(times, speeds, found) if found else None


def _turned(trace: Trace) -> Array:
    """Revolutions of the reference until each row. Of a long trace this is the only array of its length."""
    turned, before = np.empty(len(trace)), 0.0
    for at in range(0, len(trace), BLOCK):
        speed = _speed(trace, slice(at, at + BLOCK))
        speed[0] += before
        before = np.cumsum(speed, out=turned[at : at + BLOCK])[-1]
    turned *= trace.period
    turned /= 2 * math.pi
    return turned


def _speed(trace: Trace, rows: slice) -> Array:
    """Magnitude of the reference, rad/s; 0 where it is not finite."""
    speed = np.nan_to_num(trace.part("omega_ref", rows))
    return np.abs(speed, out=speed)


def _amplitudes(trace: Trace, piece: slice, turns: int, pole_pairs: int) -> Array:
    """Amplitudes, rad/s, of the speed error's orders 1 to HIGHEST; NaN where the rows don't resolve them."""
    longer = slice(piece.start, piece.stop + math.ceil(SLACK * (piece.stop - piece.start) / turns))
    amplitudes = np.full(HIGHEST, np.nan)
    theta, error = trace.part("theta_m", longer), trace.part("omega_error", longer)
    highest = min(HIGHEST, int((piece.stop - piece.start) / turns / 2.5))
    found = order_spectrum(theta, error, highest, pole_pairs) if highest > 0 else None
    if found is not None:
        amplitudes[:highest] = found[1:]
    return amplitudes


def _median(amplitudes: Array) -> Array:
    """Median over the pieces that resolve an order; 0 where none does."""
    found = np.zeros(amplitudes.shape[1])
    some = np.any(np.isfinite(amplitudes), axis=0)
    found[some] = np.nanmedian(amplitudes[:, some], axis=0)
    return found


def waterfall(results: Results, found: Tracked | None) -> list[dict[str, Any]]:
    """Charts of amplitude by order and speed, one per controller; empty if the speed doesn't sweep."""
    if found is None or not found.sweeps:
        return []
    by_speed = np.argsort(found.speeds)
    shown = max(int(np.max(np.flatnonzero(_median(x) > 0), initial=0)) + 1 for x in found.amplitudes.values())
    top = max(float(np.nanmax(x)) for x in found.amplitudes.values())
    unit = speed_unit(results)
    return [
        {
            "title": "Orders over speed",
            "x": "order of the mechanical revolution",
            "quantity": "speed",
            "unit": pretty(unit),
            "controller": controller,
            "top": top,
            "speeds": plain(found.speeds[by_speed] / factor(unit, ANGULAR_SPEED)),
            "orders": shown,
            "values": pack(x[by_speed, :shown].ravel()),
        }
        for controller, x in found.amplitudes.items()
    ]


def tracking(results: Results, runs: Sequence[Run], found: Tracked | None) -> list[dict[str, Any]]:
    """A chart of each strong order over speed if that sweeps; else over time, if a law learns."""
    if found is None or not (found.sweeps or any(learned_terms(results, run) for run in runs)):
        return []
    unit = pretty(speed_unit(results))
    along = np.argsort(found.speeds) if found.sweeps else np.arange(len(found.times))
    x = found.speeds[along] / factor(speed_unit(results), ANGULAR_SPEED) if found.sweeps else found.times
    return [
        {
            "title": f"Order {order} of the mechanical revolution",
            "x": f"speed ({unit})" if found.sweeps else "time (s)",
            "quantity": "amplitude",
            "unit": unit,
            "along": plain(x),
            "series": [
                {"controller": controller, "values": plain(values[along, order - 1])}
                for controller, values in found.amplitudes.items()
            ],
        }
        for order in found.followed
    ]
