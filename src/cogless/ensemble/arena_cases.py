"""The cases of an arena's plant: what happens in each, and what is measured there.

Once the plant is as the laws are told, with a load's step and a fault. Three times it is not. An hour of some
plants, again as told, shows what drifts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from cogless.design.auto import known_orders
from cogless.study import Study
from cogless.study.arena import ArenaPlant
from cogless.study.reading import checked

TOLD, LATE, HEAVY, LIGHT, HOUR = "told", "late", "heavy", "light", "hour"
RIPPLE = "ripple_rad_s"  # its name in results
UNTOLD = (LATE, HEAVY, LIGHT)
INERTIA = {HEAVY: 1.5, LIGHT: 0.5}  # times that which the laws are told
DROPOUT = "50 ms"  # without an angle
LONG, LAST = 3600.0, 60.0  # s: the hour, and the end of it that is measured
ROWS = 20.0  # Hz, in an hour
TURN = 1.1  # turns that orders need, with a law that is too slow


def scenarios(base: Study, plant: ArenaPlant) -> dict[str, dict[str, Any]]:
    """Tables of the scenarios: one as the laws are told, with step and fault, and three as they aren't."""
    own = base.source.tables["scenario"][plant.scenario]
    taken = {key: own[key] for key in ("reference", "initial_speed", "load", "override") if key in own}
    if plant.reference is not None:
        taken["reference"] = plant.reference
    if isinstance(taken["reference"], str):
        taken["initial_speed"] = taken["reference"]
    override = taken.pop("override", {})
    load = base.scenario[plant.scenario].load or base.mechanics.load
    step = plant.begin + plant.learn
    off, fault = step + plant.hold, step + 2 * plant.hold
    events = [
        {"time": f"{step!r} s", "load": f"{load.torque + plant.load!r} N*m"},
        {"time": f"{off!r} s", "load": f"{load.torque!r} N*m"},
    ]
    told = {
        **taken,
        "override": override,
        "duration": f"{fault + plant.hold!r} s",
        "events": events,
        "faults": [{"kind": "angle-missing", "time": f"{fault!r} s", "duration": DROPOUT}],
    }
    short = {**taken, "duration": f"{step!r} s"}
    late = {"drive.bus.delay_command": f"{1 / base.drive.rates.outer_loop!r} s"}
    of_inertia = {
        case: {"mechanics.inertia": f"{share * base.mechanics.inertia!r} kg*m^2"}
        for case, share in INERTIA.items()
    }
    untold = {LATE: late, **of_inertia}
    return {TOLD: told} | {case: {**short, "override": override | untold[case]} for case in UNTOLD}


def metrics(study: Study, plant: ArenaPlant) -> list[dict[str, Any]]:
    """The arena's columns as metrics of a study."""

    def s(time: float) -> str:
        return f"{time!r} s"

    at = plant.begin + plant.learn
    end = at + 3 * plant.hold
    learned = [s(at - plant.window), s(at)]
    step = {"signal": "omega_error", "event": s(at), "smooth": s(plant.smooth)}
    recovered = [s(end - min(plant.window, plant.hold / 2)), s(end)]
    of_error = {"signal": "omega_error", "unit": "rpm"}
    only_told = {"scenarios": [TOLD]}
    slowest = study.scenario[TOLD].slowest
    turn = max(plant.window, TURN * math.tau / slowest) if slowest else math.inf
    orders = {
        "kind": "order",
        "order": known_orders(study, next(iter(study.controller))),
        "window": [s(at - turn), s(at)],
    }
    pieces = {"window": [s(plant.begin), s(at)], "smooth": s(plant.smooth)}
    return [
        {"name": "ripple", "kind": "rms", "window": learned, **of_error},
        *([{"name": "orders", **orders, **of_error, **only_told}] if turn <= plant.learn else []),
        {"name": "dip", "kind": "dip", **step, "unit": "rpm", **only_told},
        {"name": "settling", "kind": "settling", "band": f"{plant.band!r} rad/s", **step, **only_told},
        {
            "name": "time_to_learn",
            "kind": "time-to-learn",
            "signal": "omega_error",
            "band": f"{plant.target!r} rad/s",
            **pieces,
            **only_told,
        },
        {"name": "copper_loss", "kind": "copper-loss", "window": learned, **only_told},
        {"name": "chattering", "kind": "chattering", "window": learned, **only_told},
        {"name": "after_fault", "kind": "rms", "window": recovered, **of_error, **only_told},
    ]


def learning(study: Study, law: str) -> Study:
    """One law in the case TOLD until it has learned, without step and fault: the ripple that it leaves."""
    told = study.source.tables["scenario"][TOLD]
    end = told["events"][0]["time"]
    short = {key: value for key, value in told.items() if key not in ("events", "faults")}
    (ripple,) = (each for each in study.source.tables["metric"] if each["name"] == "ripple")
    tables = study.source.tables | {
        "scenario": {TOLD: {**short, "duration": end}},
        "controller": {law: study.source.tables["controller"][law]},
        "metric": [ripple],
    }
    found = checked(replace(study.source, tables=tables))
    assert isinstance(found, Study)
    return found


def hour(study: Study) -> Study:
    """An hour of the case TOLD without step and fault, and the ripple at its end."""
    told = study.source.tables["scenario"][TOLD]
    long = {key: value for key, value in told.items() if key not in ("events", "faults")}
    # an odd divider: rows that don't return to the same angles, so that few of them tell an rms
    rate = study.drive.rates.current_loop / (2 * round(study.drive.rates.current_loop / ROWS / 2) + 1)
    ripple = {"kind": "rms", "signal": "omega_error", "last": f"{LAST!r} s", "unit": "rpm"}
    tables = study.source.tables | {
        "trace": {"rate": f"{rate!r} Hz"},
        "scenario": {HOUR: {**long, "duration": f"{LONG!r} s"}},
        "metric": [{"name": "after_hour", **ripple}],
    }
    found = checked(replace(study.source, tables=tables))
    assert isinstance(found, Study)
    return found
