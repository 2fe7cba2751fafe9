"""The bench's motor in cogless's simulator, under the laws of drives' firmware."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from drives.drive_bench import RATE, RUNS, TURN, Plant

from cogless.drives import firmware_laws
from cogless.drives.adapter import ramped
from cogless.results import Results
from cogless.run.simulate import run_study
from cogless.study.base import Source
from cogless.study.reading import checked

Tables = Mapping[str, Any]
PI_LOOP = {"kp": "2.83 V/A", "ki": "5027 V/A/s", "current_limit": "8 A"}
SLOW = f"{0.5 * TURN} rad/s"
STEADY = {"slow": {"duration": "4 s", "reference": SLOW, "initial_speed": SLOW}}


def law(name: str, **params: object) -> dict[str, object]:
    """A class of firmware_laws, as a controller."""
    return {"law": "python", "object": f"{firmware_laws.__file__}:{name}", "params": params}


def motions(points_by_name: Mapping[str, list[tuple[float, float]]] = RUNS) -> dict[str, dict[str, object]]:
    """Scenarios of these speeds, rad/s over s, from rest and back to it, as a plan's script plays them."""
    scenarios: dict[str, dict[str, object]] = {}
    for name, points in points_by_name.items():
        rest_to_rest = ramped(points)
        speeds = [[f"{t} s", f"{v} rad/s"] for t, v in rest_to_rest]
        scenarios[name] = {"duration": f"{rest_to_rest[-1][0]} s", "reference": {"profile": speeds}}
    return scenarios


def results(
    scenarios: Tables,
    laws: Tables,
    speed_rate: str = "30 kHz",
    bits: int = 14,
    plant: Plant | None = None,
    **more: object,
) -> Results:
    """Results of the motor, as the firmware turns it. `more`: of the study's keys."""
    plant = plant or Plant()
    cogging = [{"order": n, "torque": f"{a} N*m", "phase": f"{p} rad"} for n, a, p in plant.cogging]
    motor = {"pole_pairs": 7, "R_s": "0.8 ohm", "L_d": "0.45 mH", "L_q": "0.45 mH"}
    friction = {"coulomb_friction": f"{plant.coulomb} N*m", "viscous_friction": f"{plant.viscous} N*m*s/rad"}
    current_rate = "40 kHz" if speed_rate == "8 kHz" else "30 kHz"
    tables = {
        "title": "An oracle",
        "motor": {**motor, "K_t": f"{plant.K_t} N*m/A", "cogging": cogging},
        "mechanics": {"inertia": f"{plant.inertia} kg*m^2", **friction},
        "drive": {
            "rates": {"current_loop": current_rate, "speed_loop": speed_rate},
            "current_loop": PI_LOOP,
            "inverter": {"bus_voltage": "24 V"},
            "position_sensor": {"kind": "absolute", "bits": bits},
        },
        "trace": {"rate": f"{RATE} Hz"},
        "scenario": scenarios,
        "controller": laws,
        **more,
    }
    return run_study(checked(Source(Path("oracle.toml"), tables)))


def played(
    scenarios: Tables, laws: Tables, speed_rate: str = "30 kHz", bits: int = 14, plant: Plant | None = None
) -> list[Any]:
    """Runs of `results`."""
    return list(results(scenarios, laws, speed_rate, bits, plant).runs)


def ripples(laws: Tables, speed_rate: str = "30 kHz", bits: int = 14) -> dict[str, float]:
    """Ripple at half a turn a second, rad/s rms, by controller."""
    return {
        run.controller: float(np.std(run.trace["omega_m"][2 * RATE :]))
        for run in played(STEADY, laws, speed_rate, bits)
    }
