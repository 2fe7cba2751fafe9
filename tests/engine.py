"""A small drive for tests of the engine, as the plain dict that it takes, and a way to run it."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless import _simulator_f64

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
        "inverter": {"kind": "averaged", "bus_voltage": 100.0, "dead_time": 0.0, "computation_delay": 1},
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
    "controller": {"law": "pi", "kp": 0.1, "ki": 1.0},
}

# flux harmonics and cogging, for a motor with everything
RIPPLE = {
    "flux_harmonics": [
        {"order": 6, "d": 2e-3, "q": 1e-3, "d_phase": 0.3, "q_phase": -0.2},
        {"order": 12, "d": 5e-4, "q": 3e-4, "d_phase": 0.0, "q_phase": 0.1},
    ],
    "cogging": [
        {"order": 24, "torque": 0.03, "phase": 0.4},
        {"order": 9, "torque": 0.01, "phase": 0.0},
    ],
}


def merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    """`base` with the tables of `change` merged in; a table that names another `kind` or `law` replaces."""
    result = dict(base)
    for key, value in change.items():
        old = result.get(key)
        same = isinstance(old, dict) and isinstance(value, dict)
        replaces = same and any(k in value and value[k] != old.get(k) for k in ("law",))
        result[key] = merged(old, value) if same and not replaces else value
    return result


def config(change: dict[str, Any] | None = None) -> dict[str, Any]:
    return merged(BASE, change or {})


# mandra2019's feedback gains, A per rad, rad/s, rad; what else it has, a test adds
TRIAL_LAW: dict[str, Any] = {
    "law": "trial",
    "K_1": [-99.4484, -0.9270],
    "K_2": 1.3916,
    "N": 99.4484,
    "C": [1.0, 0.0],
    "through_integrator": True,
    "K_3": 0.6942,
    "shift": 2,
    "feedforward": {"num": [], "den": [1.0], "preview": 0},
    "q_filter": {"b": [], "a": []},
    "learning_matrix": None,
    "limit": 20.0,
    "learned_limit": 1.0,
}
# its motor's torque constant, and its mechanics
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
    count: int, phases: list[dict[str, Any]], controller: dict[str, Any] | None = None, **drive: Any
) -> dict[str, Any]:
    """So many trials of the base drive, with an ideal current loop at 8 kHz and a law at 400 Hz. Each phase:
    its changes, with its reference."""
    rates = {"current_rate": 8000, "speed_divider": 20, "ideal_current": True}
    return {
        "trials": {
            "samples": len(phases[0]["reference"]),
            "count": count,
            "phases": [merged(TRIAL_PHASE, phase) for phase in phases],
        },
        "seed": 0,
        "energy": False,
        "drive": merged(BASE["drive"], {**rates, **drive}),
        "controller": merged(TRIAL_LAW, controller or {}),
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
    return signals(module.Drive(settings, controller), module, ticks, decimation)
