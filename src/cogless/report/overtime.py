"""Plots over time: the waveforms of a scenario, their zooms, the response to each event."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.report.comparison import pretty
from cogless.report.packing import pack, thin
from cogless.report.palette import place
from cogless.results import Results, Run
from cogless.study.metric import SIGNALS
from cogless.units import factor

POINTS = 700_000  # of all waveforms of a page, at 2.7 bytes each
MOST, FEWEST = 20_000, 1_500  # of one waveform
EVENT_POINTS = 1_200
EVENT_SPAN = (-0.1, 1.5)  # s about an event
NEAR = 0.05  # of the reference: the drive is up to speed

# The learnt part of each law's current reference.
LEARNT = ("term_ilc", "term_f_hat", "term_table")


def waveforms(results: Results, runs: Sequence[Run], speed_unit: str) -> dict[str, Any]:
    points = max(FEWEST, min(MOST, POINTS // (5 * len(results.runs))))
    panels = [
        ("Speed, reference dashed", "omega_m", "speed", speed_unit),
        ("Current reference", "i_q_ref", "i_q_ref", "A"),
        ("Torque of the motor, cogging included", "tau_motor", "torque", "N*m"),
        ("Learnt part of the current reference", "learnt", "current", "A"),
    ]
    return _times(runs, panels, points, results)


def zooms(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Buttons above the waveforms: the whole run, after the start-up, the last revolution, each event."""
    time, theta = runs[0].trace.time, runs[0].trace["theta_m"]
    start, end = float(time[0]), float(time[-1])
    changes = [e.time for e in results.study.scenario[runs[0].scenario].events if e.time < end]
    found = [{"name": "whole run", "from": start, "to": end}]
    started = _started(runs, min([end, *changes]))
    if started > start:
        found.append({"name": "after start-up", "from": started, "to": end})
    inside = np.abs(theta - theta[-1]) <= 2 * math.pi
    if not inside[0]:
        since = float(time[len(time) - int(np.argmin(inside[::-1]))])
        found.append({"name": "last revolution", "from": since, "to": end})
    return found + [
        {"name": f"event at {change:g} s", "from": max(start, change - 0.1), "to": min(end, change + 1.0)}
        for change in changes
    ]


def _started(runs: Sequence[Run], until: float) -> float:
    """When the speed errors of all runs have come down to what they are later, before `until`, s."""
    errors = [np.abs(run.trace["omega_error"][run.trace.window(0.0, until)]) for run in runs]
    calm = 1.2 * max(float(np.max(error[len(error) // 2 :], initial=0.0)) for error in errors)
    last = max(int(np.max(np.flatnonzero(error > calm), initial=0)) for error in errors)
    return float(runs[0].trace.time[last])


def events(results: Results, runs: Sequence[Run], speed_unit: str) -> list[dict[str, Any]]:
    """Speed and current reference about each event."""
    changes = results.study.scenario[runs[0].scenario].events
    last = float(runs[0].trace.time[-1])
    ends = [min(last, change.time) for change in changes[1:]] + [last]
    charts = []
    for event, end in zip(changes, ends, strict=False):
        name = f"load to {event.load:.3g} N·m at {event.time:g} s"
        panels = [
            (f"Speed, {name}", "omega_m", "speed", speed_unit),
            (f"Current reference, {name}", "i_q_ref", "i_q_ref", "A"),
        ]
        before, after = EVENT_SPAN
        span = (max(0.0, event.time + before), min(event.time + after, end))
        if span[1] - event.time > 10 * runs[0].trace.period:
            charts.append(_times(runs, panels, EVENT_POINTS, results, span, event.time))
    return charts


def near_reference(run: Run) -> NDArray[np.bool_]:
    """Rows with the speed within 5 % of its reference."""
    near: NDArray[np.bool_] = np.abs(run.trace["omega_error"]) <= NEAR * np.abs(run.trace["omega_ref"])
    return near


def _times(
    runs: Sequence[Run],
    panels: Sequence[tuple[str, str, str, str]],
    points: int,
    results: Results,
    span: tuple[float, float] | None = None,
    origin: float = 0.0,
) -> dict[str, Any]:
    """Panels over time: (title, signal, quantity, unit); within `span`, s; time counted from `origin`, s."""
    first = runs[0].trace
    step = first.period
    drawn = []
    for title, signal, quantity, unit in panels:
        series: list[dict[str, Any]] = []
        spread: list[float] = []
        for run in runs:
            rows = slice(None) if span is None else run.trace.window(*span)
            names = [name for name in LEARNT if name in run.trace] if signal == "learnt" else [signal]
            if not names:
                continue
            scale = factor(unit, SIGNALS[names[0]])
            if signal == "omega_m" and not series:
                reference, _ = thin(run.trace["omega_ref"][rows] / scale, points)
                series.append({"values": pack(reference), "dash": True})
                spread.append(math.inf)
            total = np.sum([run.trace[name][rows] for name in names], axis=0)
            thinned, taken = thin(total / scale, points)
            series.append({"controller": place(results, run), "values": pack(thinned)})
            spread.append(float(np.std(thinned[len(thinned) // 2 :])))
            step = taken * first.period
        if series:
            # The widest is drawn first, so that it doesn't hide the others.
            series = [series[i] for i in np.argsort(spread)[::-1]]
            drawn.append({"title": title, "quantity": quantity, "unit": pretty(unit), "series": series})
    rows = slice(None) if span is None else first.window(*span)
    # A thinned value stands for the middle of its rows.
    start = float(first.time[rows][0]) - origin + (step - first.period) / 2
    x = "time (s)" if span is None else "time since the event (s)"
    return {"panels": drawn, "start": start, "step": step, "x": x}
