"""Checks of a study's metrics. Each raises an error that names the wrong key.

`missing` finds out whether the runs of a study have a signal, and why they lack it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from itertools import product
from typing import TYPE_CHECKING

from cogless.control_library import C_LAWS
from cogless.signals import dimensions, exists
from cogless.study.metric import (
    EACH_PHASE,
    EACH_TRIAL,
    ROWS_OF_PULSES_LEAST,
    Metric,
    result_name,
    turns_held,
    whole_revolutions,
)
from cogless.study.motor import Motor
from cogless.study.table import invalid, nearest, one_of
from cogless.units import TURN

if TYPE_CHECKING:
    from cogless.study.scenario import Scenario
    from cogless.study.speed_study import Study
    from cogless.study.trial_study import TrialStudy

OF_A_LAW = "expected a signal that a controller of this study has"
# Properties of a drive that a signal may need (signals.def), and the error text if the drive lacks one.
NEEDED = {
    "electrical": "expected another signal, since the current loop is ideal",
    "three_phases": "expected another signal, since the motor has two phases",
    "thermal": "expected another signal, or the table motor.temperature",
    "energy": "expected another signal, or trace.energy = true",
    "load_side": "expected another signal, or the table mechanics.load_side",
    "within_periods": "expected another signal, or a trace.rate above drive.rates.current_loop",
    "path": "expected another signal, or a controller such as harmonic with position = true",
    "trial_law": OF_A_LAW,
}


def kinds(study: Study | TrialStudy) -> set[str]:
    """Properties that a study's drive has, out of the keys of NEEDED and "trials"."""
    motor = study.motor
    has = {
        "electrical": study.drive is not None and not study.drive.ideal,
        "three_phases": motor is not None and motor.phases == 3,
        "thermal": isinstance(motor, Motor) and motor.temperature is not None,
        "energy": study.trace.energy,
        "load_side": study.mechanics is not None and study.mechanics.load_side is not None,
        "within_periods": study.rows_per_period > 1,
        "path": any(law.uses_path for law in study.controller.values()),
        "trial_law": any(law.of_trials for law in study.controller.values()),
    }
    return {kind for kind, exists in has.items() if exists} | study.signal_kinds


def missing(study: Study | TrialStudy, signals: Iterable[str]) -> Iterator[str | None]:
    """Error text for each signal that no run of the study has; None if a run has it."""
    own_signals = study.own_signals
    if own_signals is not None:
        yield from (
            None if name in own_signals else f"expected a signal: {', '.join(own_signals)}"
            for name in signals
        )
        return
    has = frozenset(kinds(study))
    for name in signals:
        why = _missing(name, has)
        yield why if why and not any(name in law.terms for law in study.controller.values()) else None


@cache
def _missing(signal: str, kinds_present: frozenset[str]) -> str | None:
    possible = NEEDED.keys() | (kinds_present & {"trials"})
    possible_signals = dimensions(
        possible, [name for name in C_LAWS if (name == "trial") == ("trials" in kinds_present)]
    )
    if signal not in possible_signals:
        near = nearest(signal, list(possible_signals))
        return (
            f'expected a signal, perhaps "{near}"'
            if near
            else f"expected a signal: {', '.join(possible_signals)}"
        )
    if exists(signal, kinds_present):
        return None
    if any(signal == term.signal for law in C_LAWS.values() for term in law.terms):
        return OF_A_LAW
    lacks = (kind for kind in NEEDED if kind not in kinds_present and not exists(signal, possible - {kind}))
    return NEEDED[next(lacks)]


FEWEST_ROWS = 10  # least rows in a metric's window
OVER_TIME = ("window", "last", "event", "smooth", "order")  # keys that metrics of trials don't have


def metrics(study: Study | TrialStudy) -> None:
    """Check that metrics have unique names in each scenario, and scenarios that exist."""
    names = [result_name(metric) for metric in study.metric]
    for index, metric in enumerate(study.metric):
        namesakes = [study.metric[n] for n in range(index) if names[n] == names[index]]
        for scenario, other in product(study.scenario, namesakes):
            if all(m.applies_in(scenario, study.scenario[scenario]) for m in (metric, other)):
                has = "has" if metric.name == other.name else f"has in results.json: {names[index]}"
                expected = f'expected a name that no other metric of scenario "{scenario}" {has}'
                raise invalid(expected, "metric", index, "name")
        for other in namesakes:
            if metric.meaning != other.meaning:
                expected = (
                    "expected the same kind, signal, order and frame as in the other metric of this name"
                )
                raise invalid(expected, "metric", index, "name")
        if metric.scenarios == ():
            raise invalid(one_of(study.scenario), "metric", index, "scenarios")
        for scenario in metric.scenarios or ():
            if scenario not in study.scenario:
                raise invalid(one_of(study.scenario), "metric", index, "scenarios", value=scenario)


def known_signals(study: Study | TrialStudy) -> None:
    """Check that a run has each metric's signal, and that a metric of the carriage has a belt."""
    has_belt = study.mechanics is not None and study.mechanics.belt is not None
    for index, metric in enumerate(study.metric):
        if metric.kind == "carriage-ripple" and not has_belt:
            raise invalid("expected another kind, or the table mechanics.belt", "metric", index, "kind")
    named = {index: metric.signal for index, metric in enumerate(study.metric) if metric.signal}
    for index, absent in zip(named, missing(study, named.values()), strict=True):
        if absent is not None:
            raise invalid(absent, "metric", index, "signal")


def windows(study: Study) -> None:
    """Check the metrics of a speed study: their kind, enough rows in their windows, and events that exist."""
    for index, metric in enumerate(study.metric):
        if metric.kind in EACH_PHASE:
            raise invalid("expected another kind, since there are no trials", "metric", index, "kind")
        if metric.kind == "copper-loss" and study.drive.ideal:
            raise invalid("expected another kind, since the current loop is ideal", "metric", index, "kind")
        if metric.kind == "chattering" and study.trace_rate < study.drive.rates.outer_loop * (1 - 1e-9):
            expected = (
                f"expected another kind, or a trace.rate of {study.drive.rates.outer_loop:g} Hz or more"
            )
            raise invalid(expected, "metric", index, "kind")
        if metric.kind == "switching-ripple":
            _between_samples(study, index)
        _in_time(study, index, metric)


def _between_samples(study: Study, index: int) -> None:
    """Refuse `switching-ripple` if the inverter makes no pulses, or the trace has too few rows for them."""
    if not study.drive.pwm_period:
        why = "the current loop is ideal" if study.drive.ideal else "the inverter is averaged"
        raise invalid(f"expected another kind, since {why}", "metric", index, "kind")
    least = ROWS_OF_PULSES_LEAST / study.drive.pwm_period
    if study.trace_rate < least * (1 - 1e-9):
        expected = f"expected another kind, or a trace.rate of {least:g} Hz or more"
        raise invalid(
            f"{expected}, so that a PWM period has {ROWS_OF_PULSES_LEAST} rows", "metric", index, "kind"
        )


def _in_time(study: Study, index: int, metric: Metric) -> None:
    event, scenarios = metric.event, study.scenario.values()
    if event is not None and metric.scenarios is None and not any(s.has_event(event) for s in scenarios):
        raise invalid("expected the time of an event in a scenario", "metric", index, "event")
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
            raise invalid(f'expected the time of an event in scenario "{name}"', "metric", index, "event")
        key, span = _span(study, metric, scenario)
        rate, rows = study.trace_rate, "rows of the trace"
        if metric.kind == "chattering":
            rate, rows = study.drive.rates.outer_loop, "samples of the speed loop"
        if metric.kind == "switching-ripple":
            rate, rows = 1 / study.drive.pwm_period, "periods of the PWM"
        if span * rate < FEWEST_ROWS * (1 - 1e-9):
            expected = f"expected a window of {FEWEST_ROWS} or more {rows}"
            raise invalid(expected, "metric", index, key)


def _span(study: Study, metric: Metric, scenario: Scenario) -> tuple[str, float]:
    """The key that decides a metric's window in a scenario, and the window's length, s."""
    keys = {"last": metric.last, "window": metric.window, "event": metric.event}
    key = next((key for key, value in keys.items() if value is not None), "window")
    events = (event.time for event in scenario.events)
    begin, end = metric.window_within(scenario.duration, events, 1 / study.trace_rate)
    return key, end - begin


def orders(study: Study) -> None:
    """Check the orders of metrics at the top speed.

    Each order's frequency must be below half the trace's rate, and the window must hold a whole period of
    each.
    """
    half = study.trace_rate / 2
    for index, metric in enumerate(study.metric):
        counted = metric.fourier_orders
        for name, scenario in study.scenario.items():
            if not counted or not metric.applies_in(name, scenario):
                continue
            poles = study.motor.pole_pairs if metric.by_electrical_turn else 1
            turns = poles * scenario.top_speed / TURN
            key, span = _span(study, metric, scenario)
            fewest = whole_revolutions(counted)
            if turns_held(turns * span, turns / study.trace_rate) < fewest:
                frame = "electrical" if metric.by_electrical_turn else "mechanical"
                expected = f"expected a window of {fewest} or more {frame} revolutions at the top speed"
                span_words = f'of scenario "{name}", not of {turns * span:.3g}'
                raise invalid(f"{expected} {span_words}", "metric", index, key)
            if max(counted) * turns < half:
                continue
            if metric.order is None:
                expected = f"expected another kind, or a trace.rate above {2 * max(counted) * turns:.4g} Hz"
                raise invalid(f'{expected} for scenario "{name}"', "metric", index, "kind")
            limit = (
                f'expected orders below {half / turns:.4g}: at the top speed of scenario "{name}" only these'
            )
            rate = f"half the trace's rate of {2 * half:g} Hz"
            raise invalid(f"{limit} are below {rate}", "metric", index, "order")


def of_trials(study: TrialStudy) -> None:
    """Check that each metric of a study of trials gives one number per trial or phase, and has no time
    window."""
    for index, metric in enumerate(study.metric):
        if metric.kind not in EACH_TRIAL + EACH_PHASE:
            kind_names = ", ".join(EACH_TRIAL + EACH_PHASE)
            raise invalid(f"expected a kind for studies of trials: {kind_names}", "metric", index, "kind")
        for key in OVER_TIME:
            if getattr(metric, key) is not None:
                raise invalid(
                    f"expected no such key in a study of trials: delete {key}", "metric", index, key
                )
