"""A study, as tables, of the motor that an estimate describes; the logs become its scenarios."""

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

SHORTEST = 1.0  # s at a steady speed that have a ripple
SETTLED = 0.75  # of a steady speed, its last part: before, the controller settles
TURNED = 1.1 * 2 * np.pi  # rad in the last part, for its orders
PI = {"pi": {"law": "pi", "baseline": True, "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}}


def motor(made: Estimate) -> dict[str, Any]:
    """The motor's table: what was known, and cogging and ripple as they were found."""
    known = {key: value for key, value in made.known.tables["motor"].items() if key != "datasheet"}
    psi_f = made.known.motor.star().psi_f / made.known.motor.star().flux_factor
    poles = made.known.motor.pole_pairs
    found: dict[str, Any] = {
        "cogging": [
            {
                "order": wave.order,
                "torque": f"{1e3 * made.K_t * wave.size.value:.5g} mN*m",
                "phase": f"{np.degrees(wave.phase.value):.5g} deg",
            }
            for wave in made.cogging
        ],
        "flux_harmonics": [
            {
                "order": wave.order // poles,
                "d": f"{1e6 * psi_f * wave.size.value:.5g} uWb",
                "d_phase": f"{np.degrees(wave.phase.value) - 90:.5g} deg",
            }
            for wave in made.ripple
        ],
    }
    return {**known, **{key: value for key, value in found.items() if value}}


def mechanics(made: Estimate) -> dict[str, Any]:
    """Inertia and friction; a friction that can't be told is left out. KeyError: no inertia."""
    found = {"inertia": f"{made.values['j'].times(made.K_t).value:.6g} kg*m^2"}
    for key, name, unit in (("c", "coulomb_friction", "N*m"), ("b", "viscous_friction", "N*m*s/rad")):
        torque = made.values.get(key, Value(0.0, 0.0)).times(made.K_t).value
        if torque > 0:
            found[name] = f"{torque:.6g} {unit}"
    return found


def sensed(made: Estimate) -> tuple[Wave, ...]:
    """What was found of the encoder's error, where the drive's sensor can have one in a study."""
    return made.encoder if isinstance(made.known.drive.position_sensor, Counted) else ()


def drive(made: Estimate) -> dict[str, Any]:
    """The drive's table; what was found of its sensor's error takes the place of what the file said."""
    table, known = dict(made.known.tables["drive"]), made.known.drive.position_sensor
    found = {wave.order: wave for wave in sensed(made)}
    if found and isinstance(known, Counted):
        told = table["position_sensor"]
        sensor = {key: value for key, value in told.items() if key != "error"}
        parts = [part for part in told.get("error", ()) if part["order"] not in found]
        for order, wave in found.items():
            more = wave.size.value * np.exp(1j * wave.phase.value) - known.wave_of_table(order)
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


def scenario(made: Estimate, log: Log) -> dict[str, Any]:
    """The scenario of a log whose reference is known: it begins where the log does."""
    table = next(
        t for t, rule in zip(made.known.tables["log"], made.known.log, strict=True) if rule == log.rule
    )
    rows = log.stretches[0]
    theta = log["theta"][rows]
    few = max(2, round(0.005 / log.dt))
    speed = (theta[few] - theta[0]) / (few * log.dt)
    found: dict[str, Any] = {
        "duration": f"{log.dt * (rows.stop - rows.start):.6g} s",
        "reference": table["reference"],
        "initial_angle": f"{theta[0] % TURN:.6g} rad",
        "initial_speed": f"{speed:.6g} rad/s",
    }
    if log.name in made.loads:
        found["load"] = f"{made.K_t * made.loads[log.name].value:.6g} N*m"
    if log.rule.controller is not None:
        found["controllers"] = [log.rule.controller]
    return found


def replayable(made: Estimate) -> list[Log]:
    """The logs whose reference and controller are known, so that the engine can play them."""
    return [
        log
        for log in made.logs
        if log.dt and log.rule.reference is not None and made.known.controller and log.kind != "table-on"
    ]


def metrics(scenarios: Mapping[str, Mapping[str, Any]], orders: Sequence[int] = ()) -> list[dict[str, Any]]:
    """Ripple and these orders of the speed, where scenarios end at a steady one; none where no scenario does.

    Over a reversal or an acceleration a ripple means nothing.
    """
    steady = {name: steady_for(one["reference"], one["duration"]) for name, one in scenarios.items()}
    steady = {name: time for name, time in steady.items() if time >= SHORTEST}
    if not steady:
        return []
    last = SETTLED * min(steady.values())
    common = {"signal": "omega_m", "unit": "rad/s", "scenarios": list(steady), "last": f"{last:.3g} s"}
    found: list[dict[str, Any]] = [{"name": "speed_ripple", "kind": "ripple-rms", **common}]
    tops = {name: Reference.model_validate(scenarios[name]["reference"]).speeds() for name in steady}
    turning = [name for name, speeds in tops.items() if max(map(abs, speeds)) * last > TURNED]
    if orders and turning:
        waves = {"name": "speed_order", "kind": "order", "order": sorted(orders), "frame": "mechanical"}
        found.append({**waves, **common, "scenarios": turning})
    return found


def steady_for(reference: Any, duration: str) -> float:
    """Time for which a reference, as in a study, holds the speed that it ends with, s; 0: it ends at rest."""
    found, end = Reference.model_validate(reference), units.parse(duration, units.TIME)
    points = found.points or ((0.0, found.speed),)
    last = points[-1][1]
    if found.kind not in ("constant", "profile", "file") or not last:
        return 0.0
    begin = 0.0
    for (_, before), (time, _) in pairwise(points):
        if before != last:
            begin = time
    return max(0.0, end - begin)


def study(made: Estimate) -> dict[str, Any]:
    """The whole study. KeyError: no inertia."""
    star = Motor.model_validate(motor(made)).star()
    masses = Mechanics.model_validate(mechanics(made))
    replayed = {scenario_name(log): scenario(made, log) for log in replayable(made)}
    moving = [log for log in made.logs if log.dt]
    speed = max((float(np.median(np.abs(np.diff(log["theta"])))) / log.dt for log in moving), default=6.28)
    references = [log.rule.reference for log in replayable(made)]
    starts = (units.parse(one["initial_speed"], units.ANGULAR_SPEED) for one in replayed.values())
    spoken = (v for one in references if one is not None for v in one.speeds())
    top = max([speed, *map(abs, (*starts, *spoken))])
    steady = {"duration": "10 s", "reference": f"{speed:.4g} rad/s", "initial_speed": f"{speed:.4g} rad/s"}
    scenarios = replayed or {"steady": steady}
    return {
        "title": made.known.title,
        "motor": motor(made),
        "mechanics": mechanics(made),
        "drive": with_steps(drive(made), made.known.drive, star, masses, 1.2 * top),
        "scenario": scenarios,
        "controller": made.known.tables.get("controller") or PI,
        "metric": metrics(scenarios, [wave.order for wave in made.cogging]),
    }
