"""A small drive for tests of the engine, as the plain dict that it takes, and a way to run it."""

from __future__ import annotations

from dataclasses import fields
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless import _simulator_f64
from cogless.c_layout import Layout, control_layout
from cogless.control_library import C_LAWS
from cogless.run.own_law import KnownDrive

Signals = dict[str, NDArray[np.float64]]

BASE: dict[str, Any] = {
    "motor": {
        "pole_pairs": 4,
        "R_s": 0.8,
        "L_d": 2.0e-3,
        "L_q": 3.0e-3,
        "psi_f": 0.05,
        "flux_harmonics": [],
        "cogging": [],
    },
    "mechanics": {
        "inertia": 5.0e-4,
        "viscous_friction": 0.0,
        "coulomb_friction": 0.0,
        "breakaway_friction": 0.0,
    },
    "load": {"torque": 0.0, "lag": 0.0, "harmonics": [], "angle_table": None, "time_table": None},
    "events": [],
    "reference": {"kind": "constant", "speed": 10.0},
    "initial_speed": 10.0,
    "initial_angle": 0.0,
    "seed": 0,
    "energy": False,
    "drive": {
        "current_rate": 10000,
        "speed_divider": 10,
        "integration_steps": 1,
        "kp_d": 2.0,
        "ki_d": 800.0,
        "kp_q": 3.0,
        "ki_q": 800.0,
        "decoupling": True,
        "current_limit": 20.0,
        "belief": {"R_s": 0.8, "L_d": 2.0e-3, "L_q": 3.0e-3, "psi_f": 0.05},
        "inverter": {
            "kind": "averaged",
            "bus_voltage": 100.0,
            "dead_time": 0.0,
            "minimum_pulse": 0.0,
            "device_drop": 0.0,
            "computation_delay": 1,
            "pwm": "centre",
        },
        "position_sensor": {"kind": "ideal"},
        "current_sensors": {
            "offset": [0.0, 0.0, 0.0],
            "gain_error": [0.0, 0.0, 0.0],
            "noise": 0.0,
            "bits": 0,
            "range": 0.0,
            "sensors": 3,
        },
    },
    "controller": {"law": "pi", "config": {"kp": 0.1, "ki": 1.0}},
}

PI_ILC: dict[str, Any] = {
    "law": "pi-ilc",
    "config": {
        "pi": {"kp": 0.1, "ki": 1.0},
        "gain": 0.03,
        "memory": {"cells": 128, "parts": 4, "q_half_width": 2, "forgetting": 0.99, "limit": [5.0]},
    },
}

# flux harmonics and cogging, for a motor with everything
RIPPLE = {
    "flux_harmonics": [
        {"order": 6, "d": 2e-3, "q": 1e-3, "d_phase": 0.3, "q_phase": -0.2},
        {"order": 12, "d": 5e-4, "q": 3e-4, "d_phase": 0.0, "q_phase": 0.1},
    ],
    "cogging": [{"order": 24, "torque": 0.03, "phase": 0.4}, {"order": 9, "torque": 0.01, "phase": 0.0}],
}


def merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    """`base` with the tables of `change` merged in; a table with another `law` replaces that of `base`."""
    result = dict(base)
    for key, value in change.items():
        old = result.get(key)
        same = isinstance(old, dict) and isinstance(value, dict)
        replaces = same and any(k in value and value[k] != old.get(k) for k in ("law",))
        result[key] = merged(old, value) if same and not replaces else value
    return result


def config(change: dict[str, Any] | None = None) -> dict[str, Any]:
    return merged(BASE, change or {})


def packed(layout: Layout, struct: str, values: dict[str, Any], limit: float) -> bytes:
    """A C configuration's bytes. Members that are not given are zero, or one for a memory's channels, turns
    and parts. A `limit` of zero becomes the current limit."""

    def usual(table: dict[str, Any]) -> dict[str, Any]:
        ones = {key: 1 for key in ("channels", "turns", "parts") if key in table}
        inner = {key: usual(value) for key, value in table.items() if isinstance(value, dict)}
        return {**table, **ones, **inner}

    def filled(table: dict[str, Any]) -> dict[str, Any]:
        own = {"limit": limit} if table.get("limit") == 0 else {}
        inner = {key: filled(value) for key, value in table.items() if isinstance(value, dict)}
        return {**table, **own, **inner}

    zeros = layout.decode(struct, bytes(layout.size(struct)))
    return layout.pack(struct, filled(merged(usual(zeros), values)))


def described(settings: dict[str, Any], module: ModuleType = _simulator_f64) -> dict[str, Any]:
    """The description that the engine takes, with the configurations of drive and law packed for C."""
    layout = control_layout("double" if module.real_bits == 64 else "single")
    drive, controller = settings["drive"], settings["controller"]
    limit = drive["current_limit"]
    first = [*settings["trials"]["phases"], TRIAL_PHASE][0] if "trials" in settings else settings
    motor = first["motor"]
    phases, ideal = motor.get("phases", 3), drive.get("ideal_current", False)
    foc = {key: drive[key] for key in ("kp_d", "ki_d", "kp_q", "ki_q", "decoupling")} | {
        "advance": 1.5 if drive["inverter"]["computation_delay"] else 0.5,
        **{key: drive["belief"][key] for key in ("L_d", "L_q", "psi_f")},
    }
    control = {
        "pole_pairs": motor["pole_pairs"],
        "divider": drive["speed_divider"],
        "foreign": ideal,
        "feed_forward": False,
        "learn_saturated": "trials" in settings,
        "unguarded": drive.get("unguarded", "trials" in settings),
        "foc": {**foc, "current_limit": limit, "phases": phases},
        "monitor": {"phases": 0 if ideal else phases, **drive.get("monitor", {})},
        "quality": {"span": 2 * np.pi, "longest": 60.0, **drive.get("quality", {})},
    }
    drive = {**drive, "control": packed(layout, "cgl_drive_config", control, limit)}
    return {**settings, "drive": drive, "controller": law_of(controller, layout, limit)}


def law_of(controller: dict[str, Any], layout: Layout, limit: float) -> dict[str, Any]:
    if controller["law"] not in C_LAWS:
        told = dict.fromkeys((field.name for field in fields(KnownDrive)), 1)
        return {"drive": told, **controller}  # a library gets this drive; Python's laws ignore it
    struct = C_LAWS[controller["law"]].config
    return {**controller, "config": packed(layout, struct, controller["config"], limit)}


def unpacked(description: dict[str, Any], precision: str = "single") -> dict[str, Any]:
    """The drive and the controller of an engine's description, their configurations decoded."""
    layout, (drive, controller) = control_layout(precision), (description["drive"], description["controller"])
    control = layout.decode("cgl_drive_config", drive["control"])
    config = layout.decode(C_LAWS[controller["law"]].config, controller["config"])
    return {"drive": {**drive, "control": control}, "controller": {**controller, "config": config}}


def drive_of(module: ModuleType, settings: dict[str, Any], controller: object = None) -> Any:
    """The engine's drive of such settings."""
    return module.Drive(described(settings, module), controller)


# The law of mandra2019 with its feedback gains, A per rad, rad/s and rad; a test adds the rest.
TRIAL_LAW: dict[str, Any] = {
    "law": "trial",
    "config": {
        "states": 2,
        "k_1": [-99.4484, -0.9270],
        "k_2": 1.3916,
        "n": 99.4484,
        "c": [1.0, 0.0],
        "through_integrator": True,
        "k_3": 0.6942,
        "shift": 2,
        "feedforward": {"numerator": 0, "denominator": 1, "preview": 0, "num": [], "den": [1.0]},
        "q_filter": {"order": 0, "b": [], "a": []},
        "limit": 20.0,
        "learned_limit": 1.0,
    },
    "learning_matrix": None,
}
# A phase with the torque constant and the mechanics of mandra2019's motor.
TRIAL_PHASE: dict[str, Any] = {
    "from": 0,
    "motor": {**BASE["motor"], "psi_f": 0.37 / 6},
    "mechanics": {**BASE["mechanics"], "inertia": 8.25e-4, "viscous_friction": 1.4e-3},
    "load": BASE["load"],
    "load_steps": [],
    "initial_angle": 0.0,
    "initial_speed": 0.0,
}


def trial_config(
    count: int, phases: list[dict[str, Any]], law: dict[str, Any] | None = None, **drive: Any
) -> dict[str, Any]:
    """Settings of `count` trials of the base drive, with an ideal current loop at 8 kHz and a law at 400 Hz.
    `phases`: each phase's changes and reference. `law`: changes of the law's configuration."""
    rates = {"current_rate": 8000, "speed_divider": 20, "ideal_current": True}
    samples = len(phases[0]["reference"])
    return {
        "trials": {
            "samples": samples,
            "count": count,
            "phases": [merged(TRIAL_PHASE, phase) for phase in phases],
        },
        "seed": 0,
        "energy": False,
        "drive": merged(BASE["drive"], {**rates, **drive}),
        "controller": merged(TRIAL_LAW, {"config": {"samples": samples, **(law or {})}}),
    }


def signals(engine: Any, module: ModuleType, ticks: int, decimation: int = 1) -> Signals:
    """What an engine records from its start on, by name."""
    recorder = module.Recorder(engine, decimation)
    engine.advance(engine.start(), recorder, ticks)
    rows = recorder.take()
    return {name: rows[:, n].copy() for n, (name, _) in enumerate(engine.signals)}


def run(
    change: dict[str, Any] | None = None,
    seconds: float = 1.0,
    *,
    decimation: int = 1,
    module: ModuleType = _simulator_f64,
    controller: object = None,
) -> Signals:
    """Runs the base drive with changes, and returns its signals by name."""
    settings = config(change)
    ticks = round(seconds * settings["drive"]["current_rate"])
    return signals(drive_of(module, settings, controller), module, ticks, decimation)
