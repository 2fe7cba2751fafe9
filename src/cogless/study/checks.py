"""Checks between the tables of a study. Each raises the error that names the key."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from itertools import product
from typing import TYPE_CHECKING

from pydantic_core import PydanticCustomError

from cogless.study import fault_checks, numerics, signals, space_checks
from cogless.study.controller import Learning
from cogless.study.metric import Metric, result_name, whole_revolutions
from cogless.study.scenario import Scenario
from cogless.study.table import invalid

if TYPE_CHECKING:
    from cogless.study.base import StudyBase
    from cogless.study.study import Study

FEWEST_ROWS = 10  # in a metric's window
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def names(study: StudyBase) -> None:
    """Names go into files and command lines."""
    for table, entries in (("scenario", study.scenario), ("controller", study.controller)):
        for name in entries:
            if not NAME.fullmatch(name):
                raise invalid("expected a name of letters, digits, _, - and .", table, name)


def references(study: StudyBase) -> None:
    """Scenarios name controllers that exist."""
    for name, scenario in study.scenario.items():
        for index, controller in enumerate(scenario.controllers or ()):
            if controller not in study.controller:
                raise invalid(one_of(study.controller), "scenario", name, "controllers", index)


def baseline(study: StudyBase) -> None:
    """One baseline at most."""
    marked = [name for name, controller in study.controller.items() if controller.baseline]
    if len(marked) > 1:
        raise invalid(f'expected one baseline, already "{marked[0]}"', "controller", marked[1], "baseline")


def trace_rate(study: Study) -> None:
    """Rows fall on current-loop ticks."""
    rate, ticks = study.trace.rate, study.drive.rates.current_loop
    if rate is not None and not math.isclose(ticks / rate, round(ticks / rate), rel_tol=1e-12):
        raise invalid(f"expected a rate that divides drive.rates.current_loop, {ticks:g} Hz", "trace", "rate")


def durations(study: Study) -> None:
    """Every scenario has rows enough for a metric."""
    for name, scenario in study.scenario.items():
        if scenario.duration * study.trace_rate < FEWEST_ROWS * (1 - 1e-9):
            least = f"{FEWEST_ROWS / study.trace_rate:g} s"
            expected = f"expected {least} or more, {FEWEST_ROWS} rows of the trace"
            raise invalid(expected, "scenario", name, "duration")


def energy(study: Study) -> None:
    """Energies are those of voltages."""
    if study.trace.energy and study.drive.ideal:
        raise invalid("expected false, since the current loop is ideal", "trace", "energy")


def metrics(study: Study) -> None:
    """Metrics have their own name in each scenario, and scenarios, windows, events, signals that exist."""
    for index, metric in enumerate(study.metric):
        for scenario, other in product(study.scenario, study.metric[:index]):
            both = (m.applies_in(scenario, study.scenario[scenario]) for m in (metric, other))
            if result_name(metric) == result_name(other) and all(both):
                has = "has" if metric.name == other.name else f"has in results.json: {result_name(metric)}"
                expected = f'expected a name that no other metric of scenario "{scenario}" {has}'
                raise invalid(expected, "metric", index, "name")
        absent = signals.missing(study, metric.signal) if metric.signal else None
        if absent is not None:
            raise invalid(absent, "metric", index, "signal")
        if metric.kind == "copper-loss" and study.drive.ideal:
            raise invalid("expected another, since the current loop is ideal", "metric", index, "kind")
        for other in study.metric[:index]:
            if result_name(metric) == result_name(other) and metric.meaning != other.meaning:
                expected = "expected the kind, signal, order and frame of the other metric of this name"
                raise invalid(expected, "metric", index, "name")
        if metric.kind == "chattering" and study.trace_rate < study.drive.rates.speed_loop * (1 - 1e-9):
            expected = f"expected another, or a trace.rate of {study.drive.rates.speed_loop:g} Hz or more"
            raise invalid(expected, "metric", index, "kind")
        for scenario in metric.scenarios or ():
            if scenario not in study.scenario:
                raise invalid(one_of(study.scenario), "metric", index, "scenarios", value=scenario)
        _in_time(study, index, metric)


def _in_time(study: Study, index: int, metric: Metric) -> None:
    event, known = metric.event, study.scenario.values()
    if event is not None and metric.scenarios is None and not any(s.has_event(event) for s in known):
        raise invalid("expected the time of an event of a scenario", "metric", index, "event")
    for name, scenario in study.scenario.items():
        if not metric.applies_in(name, scenario):
            continue
        if metric.window is not None and metric.window[1] > scenario.duration:
            expected = f'expected a window within the {scenario.duration:g} s of scenario "{name}"'
            raise invalid(expected, "metric", index, "window")
        if metric.last is not None and metric.last > scenario.duration:
            expected = f'expected at most the {scenario.duration:g} s of scenario "{name}"'
            raise invalid(expected, "metric", index, "last")
        if event is not None and not scenario.has_event(event):
            raise invalid(f'expected the time of an event of scenario "{name}"', "metric", index, "event")
        key, span = _span(metric, scenario)
        rate, rows = study.trace_rate, "rows of the trace"
        if metric.kind == "chattering":
            rate, rows = study.drive.rates.speed_loop, "samples of the speed loop"
        if span * rate < FEWEST_ROWS * (1 - 1e-9):
            expected = f"expected a window of {FEWEST_ROWS} or more {rows}"
            raise invalid(expected, "metric", index, key)


def _span(metric: Metric, scenario: Scenario) -> tuple[str, float]:
    """The key that decides a metric's window in a scenario, and the window's length, s."""
    declared = metric.span(scenario.duration)
    if declared is not None:
        return ("window" if metric.last is None else "last"), declared[1] - declared[0]
    if metric.event is None:
        return "window", scenario.duration
    later = [e.time for e in scenario.events if e.time > metric.event and not e.is_at(metric.event)]
    return "event", min(later, default=scenario.duration) - metric.event


def orders(study: Study) -> None:
    """Check that at top speed every order lies below half the trace's rate and is whole in the window."""
    half = study.trace_rate / 2
    for index, metric in enumerate(study.metric):
        for name, scenario in study.scenario.items():
            if not metric.order or not metric.applies_in(name, scenario):
                continue
            poles = study.motor.pole_pairs if metric.frame == "electrical" else 1
            turns = poles * scenario.top_speed / (2 * math.pi)
            key, span = _span(metric, scenario)
            fewest = whole_revolutions(metric.order)
            if turns * (span + 2 / study.trace_rate) < fewest:
                expected = f"expected {fewest} or more {metric.frame} revolutions at the top speed"
                made = f'of scenario "{name}", not {turns * span:.3g}'
                raise invalid(f"{expected} {made}", "metric", index, key)
            if max(metric.order) * turns >= half:
                limit = f"expected orders below {half / turns:.4g}, half the trace's {2 * half:g} Hz"
                raise invalid(f'{limit} at the top speed of scenario "{name}"', "metric", index, "order")


def leads(study: Study) -> None:
    """A learning law's lead lies within a quarter of its memory."""
    for name, controller in study.controller.items():
        if isinstance(controller, Learning):
            longest = controller.cells // 4 / study.drive.rates.speed_loop
            if controller.lead > longest * (1 + 1e-9):
                expected = f"expected at most {longest:.6g} s, a quarter of the memory's cells in samples"
                raise invalid(expected, "controller", name, "lead")


def calibration(study: Study) -> None:
    """Targets name runs and metrics that exist, and have values of the metric's kind."""
    if study.calibration is None:
        return
    for index, parameter in enumerate(study.calibration.parameters):
        if parameter.scenario is not None and parameter.scenario not in study.scenario:
            raise invalid(one_of(study.scenario), "calibration", "parameters", index, "scenario")
    for index, target in enumerate(study.calibration.targets):
        key = ("calibration", "targets", index)
        if target.scenario not in study.scenario:
            raise invalid(one_of(study.scenario), *key, "scenario")
        if target.controller not in study.controllers_in(target.scenario):
            raise invalid(one_of(study.controllers_in(target.scenario)), *key, "controller")
        scenario = study.scenario[target.scenario]
        taken = {m.name: m for m in study.metric if m.applies_in(target.scenario, scenario)}
        if target.metric not in taken:
            raise invalid(one_of(taken), *key, "metric")
        try:
            target.values(taken[target.metric])
        except PydanticCustomError as error:
            raise invalid(error.message(), *key, "value") from None


def one_of(names: Iterable[str]) -> str:
    known = ", ".join(f'"{name}"' for name in names)
    return f"expected one of {known}"


Check = Callable[["Study"], None]
ALL: tuple[Check, ...] = (
    names,
    references,
    baseline,
    trace_rate,
    durations,
    numerics.integration,
    numerics.dead_time,
    numerics.size,
    numerics.commissioning,
    energy,
    metrics,
    orders,
    leads,
    space_checks.space_laws,
    fault_checks.faults,
    calibration,
)
# Checks of the study as a whole, not of one scenario with its overrides.
WHOLE: tuple[Check, ...] = (numerics.periods,)
