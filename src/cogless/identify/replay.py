"""Simulate the logs with the drive's own controller, to find how late the currents are logged.

From the balance, the delay of a current that the law holds is known only to half a period of the law. The
described law on the simulated motor makes the delay known better. The simulated logs also show biases of the
values by the control loop, since the true values are known there. A bias that is larger than its error is
subtracted. If the law does not answer as described, all values stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cogless.errors import StudyError
from cogless.identify import described
from cogless.identify.advice import Advice, recording
from cogless.identify.balance import Name
from cogless.identify.estimate import Progress, at_delay
from cogless.identify.lateness import NO_VALUE, Lateness, lateness, trace_filters
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Value
from cogless.identify.voltage import Agreement
from cogless.results.trace import Array, Trace
from cogless.run.simulate import rollout
from cogless.study import Study
from cogless.study.base import Source
from cogless.study.drive import Drive
from cogless.study.reading import checked, speed_study

REPLAY_ROUNDS = 2
NO_LATENESS = Lateness(None)
LOGS_TOGETHER = 4  # logs whose simulations run in step; on two cores more take more memory and no less time
REPLAY_ROWS_MOST = 10  # most rows of a trace for each row of its log: the delay may lie between log rows
TRACE_SIGNALS = ("time", "theta_measured", "theta_m", "omega_measured", "i_q", "i_d")
MORE_DEAD_TIME = 0.002  # periods of the current loop: it shows, and is so small that its effect is linear
LONGEST_DEAD_TIME = 0.1  # periods of the current loop: no drive has a longer one
UNCORRECTED = "Without a simulation the delay is known only to half a period of the law."
RATE_DIFFERENCE = 0.01  # relative difference of a log's rate from one that divides the current loop's


def played(
    estimate: Estimate, progress: Callable[[float], None], dead_time: float, more: float
) -> tuple[dict[str, Trace], dict[str, Array]]:
    """The trace of each log that can be simulated, by the log's name, and its filters with more dead time.

    A trace has the log's rows and some between them. `dead_time`: dead time of the inverter beyond the
    described one, s. `more`: dead time beyond that for a second simulation, s; 0: there is none. StudyError:
    the study isn't valid, or a run failed.
    """
    tables, drive = described.study(estimate), estimate.identification.drive
    times = [dead_time, dead_time + more] if more else [dead_time]
    drives = [_with_dead_time(tables["drive"], drive, time) if time else tables["drive"] for time in times]
    rates = [(log, _rate(estimate, log)) for log in described.replayable(estimate)]
    logs = [(log, rate) for log, rate in rates if rate is not None]
    traces: dict[str, Trace] = {}
    filters: dict[str, Array] = {}
    for n in range(0, len(logs), LOGS_TOGETHER):
        progress(n / len(logs))
        together = logs[n : n + LOGS_TOGETHER]
        studies = [
            _study_of(estimate, log, {**tables, "drive": table, "trace": {"rate": f"{rate!r} Hz"}})
            for log, rate in together
            for table in drives
        ]
        finished = rollout(studies, signals=TRACE_SIGNALS)[::-1]
        for log, _ in together:
            traces[log.name] = finished.pop().runs[0].trace
            if more:  # whole traces would fill twice the memory
                trace = finished.pop().runs[0].trace
                filters[log.name] = trace_filters(log, trace, 1 / drive.rates.outer_loop)
                del trace
    return traces, filters


def _study_of(estimate: Estimate, log: Log, tables: Mapping[str, Any]) -> Study:
    """The study of one log in these tables: its scenario, with its controller."""
    name = described.scenario_name(log)
    controller = log.rule.controller or next(iter(tables["controller"]))
    scenario = {**tables["scenario"][name], "controllers": [controller]}
    one = {**tables, "scenario": {name: scenario}, "metric": []}
    return speed_study(checked(Source(Path(estimate.identification.path), one)))


def _with_dead_time(table: dict[str, Any], drive: Drive, more: float) -> dict[str, Any]:
    """The drive's table with `more` dead time, s, for which the controller does not compensate."""
    assert drive.inverter is not None
    changed_table = {
        **table,
        "inverter": {**table["inverter"], "dead_time": f"{drive.inverter.dead_time + more:.6g} s"},
    }
    if drive.dead_time_compensation is not None and drive.dead_time_compensation.time is None:
        believed = {"time": f"{drive.inverter.dead_time:.6g} s"}
        changed_table["dead_time_compensation"] = {**table["dead_time_compensation"], **believed}
    return changed_table


def _more(drive: Drive) -> float:
    """The dead time that a simulation adds, s."""
    return MORE_DEAD_TIME / drive.rates.current_loop


def _likely(dead_time: Value, drive: Drive) -> float:
    """The dead time to simulate with, s, beyond the described one: `dead_time`, or 0 if no drive can have it.

    It is simulated, since its effect on a current that changes sign is not in proportion to it.
    """
    if drive.inverter is None or abs(dead_time.value) <= 2 * dead_time.error:
        return 0.0
    whole = drive.inverter.dead_time + dead_time.value
    return dead_time.value if 0 <= whole < LONGEST_DEAD_TIME / drive.rates.current_loop else 0.0


def _said_of_dead_time(more: Value, drive: Drive) -> str:
    """A sentence on the dead time, s, that the law's answers show beyond the described one; "" if none."""
    if drive.inverter is None or not more.value > 2 * more.error > 0:
        return ""
    lost = more.value * drive.rates.current_loop * drive.inverter.bus_voltage
    return (
        "The currents follow their references as if the bridge had "
        f"{1e9 * more.value:.0f} +- {1e9 * more.error:.0f} ns more dead time than is described. "
        f"This takes {lost:.2g} V from the voltage that drives the current. "
        "The results allow for it. "
        "The cause may also be the voltage drop of transistors and diodes, or a wrong R_s, L_q or bandwidth "
        "of the current loop."
    )


def _rate(estimate: Estimate, log: Log) -> float | None:
    """The rate of a trace's rows, Hz, a multiple of the log's that divides the current loop's, or None."""
    loop = estimate.identification.drive.rates.current_loop
    every = max(1, round(loop * log.dt))
    if abs(loop / every * log.dt - 1) >= RATE_DIFFERENCE:
        return None
    return loop / every * max(n for n in range(1, REPLAY_ROWS_MOST + 1) if every % n == 0)


def _bandwidth(estimate: Estimate) -> float:
    """Bandwidth of the drive's current loop, rad/s."""
    star, drive = estimate.identification.motor.star(), estimate.identification.drive
    return float(drive.current_loop.gains(drive.belief.resolved(star))["kp_q"] / star.L_q)


def _offset(estimate: Estimate) -> float:
    """The offset that is added to the logged angle, rad."""
    return (
        0.5 * estimate.identification.step
        if estimate.identification.angle_offset is None
        else estimate.identification.angle_offset
    )


def simulated_log(estimate: Estimate, log: Log, trace: Trace, late: float = 0.0) -> Log:
    """A trace as the drive would have logged it: currents by the measured angle, delayed by `late`, s."""
    step = max(1, round(log.dt / trace.period))
    time = trace.period * np.arange(len(trace))
    turned = estimate.identification.motor.pole_pairs * (
        np.unwrap(trace["theta_measured"]) - trace["theta_m"]
    )
    seen = (trace["i_d"] + 1j * trace["i_q"]) * np.exp(-1j * turned)
    currents = {"i_q": seen.imag, "i_d": seen.real}
    signals = {
        "theta": np.unwrap(trace["theta_measured"])[::step] + _offset(estimate),
        "omega": trace["omega_measured"][::step].copy(),  # A view would keep the whole trace in memory.
    }
    for name, current in currents.items():
        if name == "i_q" or name in log:
            signals[name] = np.interp(time[::step] - late, time, current)
    return Log(log.name, log.rule, step * trace.period, signals, (slice(0, len(signals["theta"])),))


def refined(estimate: Estimate, progress: Progress) -> tuple[Estimate, dict[str, Trace]]:
    """The estimate with the delay by the described law, and the simulated traces.

    The values stay as they are if a log of a controlled motor can't be simulated, or if no log is as under
    this law.
    """
    controlled = {log.name for log in estimate.logs if log.dt and log.kind != "coast-down"}
    first = estimate
    if "j" not in estimate.values or estimate.fit is None or not controlled:
        return estimate, {}
    traces: dict[str, Trace] = {}
    drive, dead_time, late = estimate.identification.drive, NO_VALUE, NO_LATENESS
    for n in range(REPLAY_ROUNDS):
        own, more = _likely(dead_time, drive), 0.0 if drive.inverter is None else _more(drive)
        traces = {}  # This frees the memory of the round before.
        try:
            stage = partial(progress, f"simulation {n + 1} of {REPLAY_ROUNDS}")
            traces, with_dead_time = played(estimate, stage, own, more)
        except StudyError as error:
            return _with_remark(first, f"The logs could not be simulated ({error}). {UNCORRECTED}"), {}
        if not controlled <= traces.keys():
            without = ", ".join(sorted(controlled - traces.keys()))
            sentence = (
                f"Not simulated: {without}. {UNCORRECTED} To be simulated, a log needs "
                f"{estimate.identification.replay_rule}. The rate of the current loop must be a multiple of "
                "that of the log's rows, and no cogging table may have been on."
            )
            if not traces:
                return _with_remark(first, Agreement(sentence)), traces
            others = [log.name for log in estimate.logs if log.name in traces or log.kind == "coast-down"]
            cure = Advice(
                f"{sentence} Add what is missing, or leave the log out.", recording(logs=tuple(others))
            )
            return _with_remark(first, cure), traces
        moving = [log for log in estimate.logs if log.dt]
        late = lateness(
            moving,
            traces,
            _bandwidth(estimate),
            1 / drive.rates.outer_loop,
            with_dead_time,
            first.values.get("delay"),
        )
        if late.delay is None:
            break
        simulated = [
            simulated_log(estimate, log, traces[log.name], late.delay.value) if log.name in traces else log
            for log in first.logs
        ]
        estimate = at_delay(first, late.delay, simulated, _truth(estimate))
        part = late.part.times(_more(drive))
        dead_time = replace(part, value=own + part.value)
    remark = late.remark or _said_of_dead_time(dead_time, drive)
    return (_with_remark(estimate, remark) if remark else estimate), traces


def _with_remark(estimate: Estimate, remark: str) -> Estimate:
    return replace(estimate, remarks=(*estimate.remarks, remark))


def _truth(estimate: Estimate) -> dict[Name, float]:
    """The true coefficients of the simulation, which logs without delay, and has an offset of i_q as a load.

    Coefficients of orders that the simulated motor lacks are 0, and so are errors that its sensor can't have.
    """
    truth: dict[Name, float] = {(key,): 0.0 for key in ("b", "c", "delay", "offset")}
    truth |= {(key,): estimate.values[key].value for key in ("j", "b", "c") if key in estimate.values}
    truth["offset",] = described.load_or_offset(estimate)
    truth["stribeck",] = described.more_at_rest(estimate)
    truth |= {("load", name): value.value for name, value in estimate.loads.items()}
    searched = (
        ("cogging", estimate.model.cogging),
        ("ripple", estimate.model.ripple),
        ("friction", estimate.model.friction),
        ("encoder", estimate.model.encoder),
    )
    for kind, orders in searched:
        truth |= {(kind, order, part): 0.0 for order in orders for part in "cs"}
    sensed = described.sensed(estimate)
    simulated_waves = (
        ("cogging", (*estimate.cogging, *estimate.of_unknown_cause)),
        ("ripple", estimate.ripple),
        ("friction", described.rubbing(estimate)),
        ("encoder", sensed),
    )
    for kind, waves in simulated_waves:
        for wave in waves:
            truth[kind, wave.order, "c"] = wave.size.value * float(np.sin(wave.phase.value))
            truth[kind, wave.order, "s"] = wave.size.value * float(np.cos(wave.phase.value))
    return truth
