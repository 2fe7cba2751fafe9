"""Ripple and jitter late in a run, true beside measured, whether or not the study has metrics for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite

import numpy as np

from cogless.report.comparison import Line, compare, in_torque_mode, pretty, speed_unit, unjudged
from cogless.report.markup import note
from cogless.report.speed_tracking import late
from cogless.report.tables import line_table
from cogless.results import Results, Run
from cogless.results.metrics import Conditions, evaluate
from cogless.study.metric import SIGNALS, Metric
from cogless.study.spoken import spoken_unit
from cogless.units import ANGLE, factor

STILL = 1e-9  # rad/s, of the reference: below it the drive holds its position

NOTE = (
    "Over the last part of the run, from {:.4g} to {:.4g} s. Jitter is about the mean. Torque ripple is "
    "(max \u2212 min) / (max + min). What is measured is what the law sees, what is true what the load sees."
)


def table(results: Results, runs: Sequence[Run]) -> str:
    """The table as HTML; "" if no run has rows."""
    drawn = [run for run in runs if len(run.trace) > 1 and late(results, run).stop > late(results, run).start]
    lines = list(_lines(results, drawn)) if drawn else []
    if not lines:
        return ""
    span = drawn[0].trace.time[late(results, drawn[0])][[0, -1]]
    return note(NOTE.format(*span)) + line_table(results, drawn, lines)


def _lines(results: Results, runs: Sequence[Run]) -> Iterator[Line]:
    study, scenario = results.study, runs[0].scenario
    # who did not hold the speed, or learned nothing, isn't the best here either
    known = compare(results, scenario)
    missed = {c: how for line in known for c, how in line.missed.items()}
    idle = {c: why for line in known for c, why in line.unlearned.items()}
    conditions = Conditions.of(study, scenario)
    for name, signal, kind, unit in _rows(results, runs):
        scale = factor(unit, SIGNALS[signal]) if unit else 1.0
        values: dict[str, float | None] = {}
        for run in runs:
            begin, end = run.trace.time[late(results, run)][[0, -1]]
            metric = Metric.model_construct(name=name, kind=kind, signal=signal, window=(begin, end))
            found = evaluate(metric, run.trace, conditions)
            values[run.controller] = found / scale if isinstance(found, float) and isfinite(found) else None
        line = Line(name, kind, signal, None, "mechanical", "lower", pretty(unit), values, missed, idle)
        rows = late(results, run)
        yield replace(line, unjudged=unjudged(metric, run, rows, in_torque_mode(study, run, rows)))


def _rows(results: Results, runs: Sequence[Run]) -> Iterator[tuple[str, str, str, str]]:
    """Name, signal, kind and unit of each row; a signal that some run lacks has no row."""
    trace, part = runs[0].trace, late(results, runs[0])
    still = not np.any(np.abs(trace.part("omega_ref", part)) > STILL)
    speed, angle = speed_unit(results), spoken_unit(results.study, ANGLE)
    rows = [
        ("speed ripple, rms", "omega_error", "ripple-rms", speed),
        ("speed ripple as measured, rms", "omega_error_measured", "ripple-rms", speed),
    ]
    if not still:
        rows.append(("torque ripple, (max \u2212 min) / (max + min)", "tau_motor", "ripple-ratio", ""))
    if still or any(results.study.controller[run.controller].holds_position for run in runs):
        signal = "theta_m" if still else "theta_error"
        measured = "theta_measured" if still else "theta_error_measured"
        for word, kind in (("rms", "ripple-rms"), ("3 sigma", "three-sigma")):
            rows += [
                (f"position jitter, {word}", signal, kind, angle),
                (f"position jitter as measured, {word}", measured, kind, angle),
            ]
    return (row for row in rows if all(row[1] in run.trace for run in runs))
