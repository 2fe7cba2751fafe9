"""Causes that may limit a run, each with the change of the study that removes the cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cogless.control_library import Status
from cogless.results import Run
from cogless.study import Study, for_scenario
from cogless.study.drive import Belief
from cogless.study.mechanics import Mass
from cogless.study.metric import Metric
from cogless.study.position_sensor import Absolute, Counted, Encoder, Hall
from cogless.study.reading import Changes

LONGER_FACTOR = 4  # factor on the scenario's duration: a longer run shows what was not learned yet
LARGER_FACTOR = 4  # factor on the limits of current and voltage
RULE_INPUTS = ("delay", "belief")  # causes whose removal changes the gains that a tuning rule gives
REST_SHARE = 0.05  # share of the largest speed, below which the rotor is near standstill
FINE_LINES, FINE_BITS = 10_000_000, 31  # lines of the finest encoder, bits of the finest angle word
SENSOR, INVERTER, LOOP, CURRENTS = (
    f"drive.{table}" for table in ("position_sensor", "inverter", "current_loop", "current_sensors")
)
ROWS_KEY = "trace.rate"


@dataclass(frozen=True)
class Suspect:
    """A cause in a study.

    `without`: changes that remove the cause. `companions`: changes that both compared runs have, the run with
    the cause and the run without it. `controller_knows`: whether the controller knows that the cause is gone.
    """

    name: str
    without: Changes
    companions: Changes
    controller_knows: bool


def suspects(study: Study, run: Run, metric: Metric) -> list[Suspect]:
    """The causes in a run's scenario. `metric`: judges the run."""
    own_study = for_scenario(study, run.scenario)
    steps, error = _steps(own_study), _error(own_study)
    clean = {**steps, **error}
    changes_of = {
        "sensor-steps": (steps, {}),
        "sensor-error": (error, {}),
        "delay": (_delay(own_study), clean),
        "dead-time": (_dead_time(own_study), {}),
        "switching": (_switching(own_study), {}),
        "current-noise": (_current_noise(own_study), {}),
        "current-error": (_current_error(own_study), {}),
        "learning-time": (longer(study, run.scenario, run.controller, metric), {}),
        "disturbance": (_disturbance(study, run.scenario), {}),
        "friction": (_friction(own_study, run), {}),
        "limit": (_limit(own_study, run), {}),
        "belief": ({} if own_study.drive.belief == Belief() else {"drive.belief": {}}, {}),
    }
    return [
        Suspect(name, without, companions, name in RULE_INPUTS)
        for name, (without, companions) in changes_of.items()
        if without
    ]


def _steps(study: Study) -> Changes:
    """The change to the finest sensor of the study's kind and delay; from Hall sensors to an ideal sensor."""
    sensor = study.drive.position_sensor
    if isinstance(sensor, Hall):
        return {SENSOR: {"kind": "ideal"}}
    if isinstance(sensor, Encoder):
        return {f"{SENSOR}.lines": FINE_LINES}
    if isinstance(sensor, Absolute):
        return {f"{SENSOR}.bits": FINE_BITS, f"{SENSOR}.positions": None}
    return {f"{SENSOR}.bits": FINE_BITS} if isinstance(sensor, Counted) else {}


def _error(study: Study) -> Changes:
    sensor = study.drive.position_sensor
    if isinstance(sensor, Hall):
        return {f"{SENSOR}.placement": ["0 deg"] * 6} if any(sensor.placement) else {}
    if not isinstance(sensor, Counted) or not (sensor.orders or sensor.error_table):
        return {}
    return {f"{SENSOR}.eccentricity": "0 deg", f"{SENSOR}.error": [], f"{SENSOR}.error_table": None}


def _delay(study: Study) -> Changes:
    """The change to a drive whose sensor, speed filter, bus and computation have no delay."""
    drive, changes = study.drive, dict[str, Any]()
    if isinstance(drive.position_sensor, Hall | Counted):
        changes[SENSOR] = {"kind": "ideal", "side": drive.position_sensor.side}
        if drive.encoder_table is not None:
            changes["drive.encoder_table"] = None
    if drive.speed_filter is not None:
        changes["drive.speed_filter"] = None
    if drive.bus is not None:
        changes["drive.bus"] = None
    if drive.inverter is not None and drive.inverter.computation_delay:
        changes[f"{INVERTER}.computation_delay"] = 0
    return changes


def _dead_time(study: Study) -> Changes:
    inverter = study.drive.inverter
    if inverter is None or not (inverter.dead_time or inverter.device_drop):
        return {}
    changes = {f"{INVERTER}.dead_time": "0 s", f"{INVERTER}.device_drop": "0 V"}
    return (
        {**changes, "drive.dead_time_compensation": None} if study.drive.dead_time_compensation else changes
    )


def _switching(study: Study) -> Changes:
    inverter = study.drive.inverter
    if inverter is None or not inverter.switches:
        return {}
    changes = {f"{INVERTER}.kind": "averaged"}
    return {**changes, ROWS_KEY: None} if study.rows_per_period > 1 else changes


def _current_noise(study: Study) -> Changes:
    sensors = study.drive.current_sensors
    return {f"{CURRENTS}.noise": "0 A", f"{CURRENTS}.bits": 0} if sensors.noise or sensors.bits else {}


def _current_error(study: Study) -> Changes:
    sensors = study.drive.current_sensors
    if not any((*sensors.offset, *sensors.gain_error)):
        return {}
    return {f"{CURRENTS}.offset": ["0 A"] * 3, f"{CURRENTS}.gain_error": [0.0] * 3}


def longer(study: Study, scenario: str, controller: str, metric: Metric) -> Changes:
    """The changes to a longer run that is judged at its end.

    Empty if the law doesn't learn, or if the longer run can't be compared with the study's.
    """
    if not study.controller[controller].learns_while_running:
        return {}
    return later(study, scenario, metric, (LONGER_FACTOR - 1) * study.scenario[scenario].duration)


def later(study: Study, scenario: str, metric: Metric, more: float) -> Changes:
    """The changes to a run that lasts longer by `more`, s, and is judged at its end.

    Empty if the two runs can't be compared, for example with a reference that varies.
    """
    experiment = study.scenario[scenario]
    steady = experiment.reference.kind in ("constant", "ramp") and experiment.torque_mode is None
    if not steady or metric.event is not None:
        return {}
    changes: dict[str, Any] = {f"scenario.{scenario}.duration": f"{experiment.duration + more:.12g} s"}
    place = f"metric.{study.metric.index(metric)}"
    if metric.window is not None:
        changes[f"{place}.window"] = [f"{more + time:.12g} s" for time in metric.window]
    elif metric.last is None:
        changes[f"{place}.last"] = f"{experiment.duration:.12g} s"
    return changes


def _disturbance(study: Study, scenario: str) -> Changes:
    """The change that removes torques over angle or time, except friction."""
    own_study, changes = for_scenario(study, scenario), dict[str, Any]()
    tables = own_study.source.tables
    empty: Mapping[str, Any] = {
        "motor": {
            "cogging": [],
            "cogging_table": None,
            "flux_harmonics": [],
            "torque_ripple": [],
            "L_f": [],
            "detent_torque": "0 N*m",
            "L_m_backward": [],
        },
        "mechanics.load": {"harmonics": [], "angle_table": None, "time_table": None},
        "mechanics.load_side": {"gear_errors": []},
        f"scenario.{scenario}.load": {"harmonics": [], "angle_table": None, "time_table": None},
    }
    for table, keys in empty.items():
        inner: Any = tables
        for part in table.split("."):
            inner = inner.get(part) if isinstance(inner, dict) else None
        if isinstance(inner, dict):
            changes |= {f"{table}.{key}": value for key, value in keys.items() if inner.get(key)}
    return changes


def _friction(study: Study, run: Run) -> Changes:
    """The changes that remove sliding friction.

    Empty if friction is constant: it depends on neither angle nor speed, the rotor never rests, and there
    is no load side.
    """
    body = study.mechanics
    changes = body.stribeck_speed or body.friction_harmonics or body.friction_table or body.load_side
    if not changes and len(run.trace):
        speed = np.abs(run.trace.part("omega_m", slice(len(run.trace) // 4, None)))
        if speed.min() > REST_SHARE * speed.max():
            return {}
    without: dict[str, Any] = {}
    sides: list[tuple[str, Mass]] = [("mechanics", body)]
    if body.belt is not None:
        without["mechanics.belt.friction"] = "0 N"
    elif body.load_side is not None:
        sides.append(("mechanics.load_side", body.load_side))
    for place, mass in sides:
        if mass.breakaway:
            without |= {
                f"{place}.coulomb_friction": "0 N*m",
                f"{place}.breakaway_friction": None,
                f"{place}.stribeck_speed": "0 rad/s",
                f"{place}.friction_harmonics": [],
                f"{place}.friction_table": None,
            }
    return without


def _limit(study: Study, run: Run) -> Changes:
    """The changes to higher limits of current and voltage; empty if the run's second half reached none."""
    if "status" not in run.trace or not len(run.trace):
        return {}
    status = run.trace.part("status", slice(len(run.trace) // 2, None)).astype(int)
    if not (status & Status.SATURATED).any():
        return {}
    drive = study.drive
    changes = {f"{LOOP}.current_limit": f"{LARGER_FACTOR * drive.current_loop.current_limit!r} A"}
    if drive.inverter is not None:
        changes[f"{INVERTER}.bus_voltage"] = f"{LARGER_FACTOR * drive.inverter.bus_voltage!r} V"
    return changes
