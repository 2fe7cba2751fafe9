"""Make the tables of a study of an estimated motor. The logs become scenarios of the study."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cogless import units
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Value, Wave
from cogless.study import numerics
from cogless.study.drive import Drive
from cogless.study.mechanics import Mechanics
from cogless.study.motor import Motor, StarMotor
from cogless.study.position_sensor import Counted
from cogless.study.reference import Reference
from cogless.units import TURN

STEADY_TIME_LEAST = 1.0  # s at a steady speed, below which a scenario gets no metric of ripple
STEADY_SHARE = 0.75  # last share of the time at a steady speed, which metrics use; before, the law settles
TURNED_LEAST = 1.1 * TURN  # rad turned in the last part, below which a scenario gets no metric of orders
PI = {"pi": {"law": "pi", "baseline": True, "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}}


def motor(estimate: Estimate) -> dict[str, Any]:
    """The motor's table: the described values, and cogging and ripple as identified.

    A wave that is either cogging or a current's offset is cogging here: both give the same measured current
    and speed.
    """
    described, star = estimate.identification.tables["motor"], estimate.identification.motor.star()
    described_keys = {key: value for key, value in described.items() if key != "datasheet"}
    psi_f, poles = star.psi_f / star.flux_factor, estimate.identification.motor.pole_pairs
    identified_waves: dict[str, Any] = {
        "cogging": _torques(estimate, (*estimate.cogging, *estimate.of_unknown_cause)),
        "flux_harmonics": [
            {
                "order": wave.order // poles,
                "d": f"{1e6 * psi_f * wave.size.value:.5g} uWb",
                "d_phase": f"{np.degrees(wave.phase.value) - 90:.5g} deg",
            }
            for wave in estimate.ripple
        ],
    }
    return {**described_keys, **{key: value for key, value in identified_waves.items() if value}}


def mechanics(estimate: Estimate) -> dict[str, Any]:
    """The table of inertia, friction, and the current's offset as a load. KeyError: no inertia.

    A friction that was not identified is left out. Its waves are left out if they could drive the rotor.
    """
    table: dict[str, Any] = {"inertia": f"{estimate.values['j'].times(estimate.K_t).value:.6g} kg*m^2"}
    for key, name, unit in (("c", "coulomb_friction", "N*m"), ("b", "viscous_friction", "N*m*s/rad")):
        torque = estimate.values.get(key, Value(0.0, 0.0)).times(estimate.K_t).value
        if torque > 0:
            table[name] = f"{torque:.6g} {unit}"
    if more_at_rest(estimate):
        breakaway = _coulomb(estimate) + more_at_rest(estimate)
        table["breakaway_friction"] = f"{estimate.K_t * breakaway:.6g} N*m"
        table["stribeck_speed"] = f"{estimate.values['stribeck_speed'].value:.5g} rad/s"
    if rubbing(estimate):
        table["friction_harmonics"] = _torques(estimate, rubbing(estimate))
    if load_or_offset(estimate):
        table["load"] = f"{estimate.K_t * load_or_offset(estimate):.6g} N*m"
    return table


def _torques(estimate: Estimate, waves: Sequence[Wave]) -> list[dict[str, Any]]:
    """The tables of waves that are torques."""
    return [
        {
            "order": wave.order,
            "torque": f"{1e3 * estimate.K_t * wave.size.value:.5g} mN*m",
            "phase": f"{np.degrees(wave.phase.value):.5g} deg",
        }
        for wave in waves
    ]


def _coulomb(estimate: Estimate) -> float:
    return max(0.0, estimate.values.get("c", Value(0.0, 0.0)).value)


def more_at_rest(estimate: Estimate) -> float:
    """By how much friction is larger at rest than Coulomb's, A; 0 if the study has no Coulomb friction."""
    more = estimate.values.get("stribeck", Value(0.0, 0.0)).value
    return max(0.0, more) if _coulomb(estimate) else 0.0


def rubbing(estimate: Estimate) -> tuple[Wave, ...]:
    """The identified waves of the friction, or none if they could drive the rotor."""
    sizes = sum(wave.size.value for wave in estimate.friction)
    return estimate.friction if sizes < _coulomb(estimate) else ()


def load_or_offset(estimate: Estimate) -> float:
    """The offset of i_q, which may be a load, A; 0 if it is not larger than its error."""
    offset = estimate.values.get("offset", Value(0.0, 0.0))
    return offset.value if abs(offset.value) > offset.error else 0.0


def sensed(estimate: Estimate) -> tuple[Wave, ...]:
    """The identified waves of the encoder's error, or none if a study's sensor of this kind has no error."""
    return estimate.encoder if isinstance(estimate.identification.drive.position_sensor, Counted) else ()


def drive(estimate: Estimate) -> dict[str, Any]:
    """The drive's table. An identified wave of the sensor's error replaces the file's of this order."""
    table = dict(estimate.identification.tables["drive"])
    sensor_in_file = estimate.identification.drive.position_sensor
    waves = {wave.order: wave for wave in sensed(estimate)}
    if waves and isinstance(sensor_in_file, Counted):
        sensor_table = table["position_sensor"]
        sensor = {key: value for key, value in sensor_table.items() if key != "error"}
        parts = [part for part in sensor_table.get("error", ()) if part["order"] not in waves]
        for order, wave in waves.items():
            more = wave.size.value * np.exp(1j * wave.phase.value) - sensor_in_file.wave_of_table(order)
            amplitude, phase = (f"{np.degrees(x):.5g} deg" for x in (abs(more), np.angle(more)))
            if order == 1:
                sensor |= {"eccentricity": amplitude, "eccentricity_phase": phase}
            else:
                parts.append({"order": order, "amplitude": amplitude, "phase": phase})
        table["position_sensor"] = {**sensor, "error": parts} if parts else sensor
    return table


def with_steps(
    table: dict[str, Any], drive: Drive, motor: StarMotor, mechanics: Mechanics, top: float
) -> dict[str, Any]:
    """The drive's table with as many integration steps as speeds up to `top`, rad/s, need."""
    rates = drive.rates
    steps = max(rates.integration_steps, numerics.steps_needed(motor, mechanics, top, rates.current_loop))
    return {**table, "rates": {**table["rates"], "integration_steps": steps}}


def scenario_name(log: Log) -> str:
    """The log's name as the key of a scenario."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", log.name.split(".")[0]).strip("-") or "log"


def scenario(estimate: Estimate, log: Log) -> dict[str, Any]:
    """The scenario of a log whose reference is known. It begins at the log's first angle and speed."""
    rules = zip(estimate.identification.tables["log"], estimate.identification.log, strict=True)
    table = next(table for table, rule in rules if rule == log.rule)
    rows = log.stretches[0]
    theta = log["theta"][rows]
    few = max(2, round(0.005 / log.dt))
    speed = (theta[few] - theta[0]) / (few * log.dt)
    keys: dict[str, Any] = {
        "duration": f"{log.dt * (rows.stop - rows.start):.6g} s",
        "reference": table["reference"],
        "initial_angle": f"{theta[0] % TURN:.6g} rad",
        "initial_speed": f"{speed:.6g} rad/s",
    }
    if log.name in estimate.loads:
        load = load_or_offset(estimate) + estimate.loads[log.name].value
        keys["load"] = f"{estimate.K_t * load:.6g} N*m"
    if log.rule.controller is not None:
        keys["controllers"] = [log.rule.controller]
    return keys


def replayable(estimate: Estimate) -> list[Log]:
    """The logs whose reference and controller are known, so that the engine can play them."""
    return [
        log
        for log in estimate.logs
        if log.dt
        and log.rule.reference is not None
        and estimate.identification.controller
        and log.kind != "table-on"
    ]


def metrics(scenarios: Mapping[str, Mapping[str, Any]], orders: Sequence[int] = ()) -> list[dict[str, Any]]:
    """Metrics of the speed's ripple and of these orders, over the scenarios that end at a steady speed.

    Over a reversal or an acceleration a ripple means nothing. The list is empty if no scenario ends steadily.
    """
    steady = {name: steady_for(one["reference"], one["duration"]) for name, one in scenarios.items()}
    steady = {name: time for name, time in steady.items() if time >= STEADY_TIME_LEAST}
    if not steady:
        return []
    last = STEADY_SHARE * min(steady.values())
    common = {"signal": "omega_m", "unit": "rad/s", "scenarios": list(steady), "last": f"{last:.3g} s"}
    tables: list[dict[str, Any]] = [{"name": "speed_ripple", "kind": "ripple-rms", **common}]
    tops = {name: Reference.model_validate(scenarios[name]["reference"]).speeds() for name in steady}
    turning = [name for name, speeds in tops.items() if max(map(abs, speeds)) * last > TURNED_LEAST]
    if orders and turning:
        waves = {"name": "speed_order", "kind": "order", "order": sorted(orders), "frame": "mechanical"}
        tables.append({**waves, **common, "scenarios": turning})
    return tables


def steady_for(reference: Any, duration: str) -> float:
    """Time for which a study's reference holds its last speed, s; 0 if it does not end at a steady speed."""
    course, end = Reference.model_validate(reference), units.parse(duration, units.TIME)
    points = course.points or ((0.0, course.speed),)
    last = points[-1][1]
    if course.kind not in ("constant", "profile", "file") or not last:
        return 0.0
    begin = 0.0
    for (_, before), (time, _) in pairwise(points):
        if before != last:
            begin = time
    return max(0.0, end - begin)


def study(estimate: Estimate) -> dict[str, Any]:
    """The whole study. KeyError: no inertia."""
    star = Motor.model_validate(motor(estimate)).star()
    masses = Mechanics.model_validate(mechanics(estimate))
    replayed = {scenario_name(log): scenario(estimate, log) for log in replayable(estimate)}
    moving = [log for log in estimate.logs if log.dt]
    speed = max((float(np.median(np.abs(np.diff(log["theta"])))) / log.dt for log in moving), default=6.28)
    references = [log.rule.reference for log in replayable(estimate)]
    starts = (units.parse(one["initial_speed"], units.ANGULAR_SPEED) for one in replayed.values())
    spoken = (v for one in references if one is not None for v in one.speeds())
    top = max([speed, *map(abs, (*starts, *spoken))])
    steady = {"duration": "10 s", "reference": f"{speed:.4g} rad/s", "initial_speed": f"{speed:.4g} rad/s"}
    scenarios = replayed or {"steady": steady}
    return {
        "title": estimate.identification.title,
        "motor": motor(estimate),
        "mechanics": mechanics(estimate),
        "drive": with_steps(drive(estimate), estimate.identification.drive, star, masses, 1.2 * top),
        "scenario": scenarios,
        "controller": estimate.identification.tables.get("controller") or PI,
        "metric": metrics(scenarios, [wave.order for wave in estimate.cogging]),
    }
