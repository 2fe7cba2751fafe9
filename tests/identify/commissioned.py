"""Logs of motors with a known truth: the planned sequence as the engine plays it."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from cogless.identify import plan
from cogless.results.trace import Trace
from cogless.run.simulate import rollout
from cogless.study import load

PI = {"pi": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}}
METRIC = {"name": "speed_ripple", "kind": "ripple-rms", "signal": "omega_m"}
HEADINGS = {
    "theta_measured": "theta",
    "omega_measured": "omega",
    "i_q": "i_q",
    "i_q_ref": "i_q_ref",
    "i_d": "i_d",
}

MOTORS: dict[str, dict[str, Any]] = {
    "gimbal": {
        "motor": {
            "pole_pairs": 7,
            "R_s": "5 ohm",
            "L_d": "2 mH",
            "L_q": "2 mH",
            "K_t": "0.08 N*m/A",
            "cogging": [
                {"order": 42, "torque": "6 mN*m", "phase": "30 deg"},
                {"order": 12, "torque": "2 mN*m", "phase": "-70 deg"},
                {"order": 84, "torque": "0.8 mN*m", "phase": "120 deg"},
            ],
            "flux_harmonics": [{"order": 6, "d": "0.15 mWb", "d_phase": "20 deg"}],
        },
        "mechanics": {
            "inertia": "8e-5 kg*m^2",
            "coulomb_friction": "4 mN*m",
            "viscous_friction": "1e-4 N*m*s/rad",
        },
        "drive": {
            "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"bandwidth": "500 Hz", "current_limit": "3 A"},
            "inverter": {"bus_voltage": "24 V"},
            "position_sensor": {"kind": "encoder", "lines": 4096, "speed_method": "M"},
        },
    },
    "servo": {
        "motor": {
            "pole_pairs": 4,
            "R_s": "0.8 ohm",
            "L_d": "2 mH",
            "L_q": "2 mH",
            "K_t": "0.3 N*m/A",
            "cogging": [
                {"order": 24, "torque": "20 mN*m", "phase": "10 deg"},
                {"order": 72, "torque": "4 mN*m", "phase": "80 deg"},
            ],
            "flux_harmonics": [{"order": 6, "d": "1 mWb", "d_phase": "50 deg"}],
        },
        "mechanics": {
            "inertia": "5e-4 kg*m^2",
            "coulomb_friction": "30 mN*m",
            "viscous_friction": "1e-3 N*m*s/rad",
        },
        "drive": {
            "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"bandwidth": "500 Hz", "current_limit": "10 A"},
            "inverter": {"bus_voltage": "48 V"},
            "position_sensor": {
                "kind": "encoder",
                "lines": 2500,
                "speed_method": "M",
                "eccentricity": "0.1 deg",
            },
        },
    },
    "drone": {
        "motor": {
            "pole_pairs": 12,
            "R_s": "0.53 ohm",
            "L_d": "210 uH",
            "L_q": "210 uH",
            "kv": "300 rpm/V",
            "cogging": [
                {"order": 72, "current": "0.18 A", "phase": "40 deg"},
                {"order": 18, "current": "0.04 A", "phase": "-170 deg"},
                {"order": 12, "current": "0.03 A", "phase": "170 deg"},
            ],
            "flux_harmonics": [{"order": 6, "d": "0.02 mWb"}],
        },
        "mechanics": {
            "inertia": "6e-6 kg*m^2",
            "coulomb_friction": "1.46 mN*m",
            "viscous_friction": "1e-5 N*m*s/rad",
        },
        "drive": {
            "rates": {"current_loop": "20 kHz", "speed_loop": "5 kHz"},
            "current_loop": {"bandwidth": "1 kHz", "current_limit": "4 A"},
            "inverter": {"bus_voltage": "24 V"},
            "position_sensor": {"kind": "encoder", "lines": 1024, "speed_method": "MT", "timer": "90 MHz"},
        },
    },
}


def study_tables(name: str) -> dict[str, Any]:
    """The tables of a study of one of these motors."""
    scenario = {"one": {"duration": "1 s", "reference": "1 rev/s", "initial_speed": "1 rev/s"}}
    return {"title": name, **MOTORS[name], "scenario": scenario, "controller": PI, "metric": [METRIC]}


def study_text(name: str) -> str:
    """A study of one of these motors."""
    return plan.to_toml(study_tables(name))


@cache
def commissioned(name: str, late: int = 0) -> tuple[str, dict[str, dict[str, np.ndarray]]]:
    """The file of columns, and the signals of each planned log, with currents that are `late` rows late."""
    folder = Path(mkdtemp())
    (folder / "motor.toml").write_text(study_text(name))
    plan.write(load(folder / "motor.toml"), folder)
    (results,) = rollout([load(folder / "study.toml")], jobs=2)
    poles = MOTORS[name]["motor"]["pole_pairs"]
    logs = {
        run.scenario: {
            "t": run.trace.time[late:].copy(),
            **{
                heading: _logged(run.trace, signal, poles)[
                    : len(run.trace) - late if heading[0] == "i" else None
                ][0 if heading[0] == "i" else late :].copy()
                for signal, heading in HEADINGS.items()
            },
        }
        for run in results.runs
    }
    text = (folder / "id.toml").read_text()
    for signal, heading in {"time": "t", **HEADINGS}.items():
        text = text.replace(f'= "{signal}"', f'= "{heading}"')
    for log in logs:
        text = text.replace(f'file = "{log}"', f'file = "{log}.npz"')
    return text, logs


def _logged(trace: Trace, signal: str, poles: int) -> np.ndarray:
    """A signal as the drive has it: currents are in the frame of the measured angle."""
    if signal not in ("i_d", "i_q"):
        return trace[signal]
    turned = np.exp(-1j * poles * (trace["theta_measured"] - trace["theta_m"]))
    currents = (trace["i_d"] + 1j * trace["i_q"]) * turned
    return currents.real if signal == "i_d" else currents.imag


def write(folder: Path, text: str, logs: dict[str, dict[str, np.ndarray]]) -> list[Path]:
    """The file of columns as id.toml, and each log as an NPZ; returns the logs' paths.

    Only columns that some log has are written, each with the files of the logs that have it.
    """
    tables = tomllib.loads(text)
    columns = {}
    for signal, column in tables["columns"].items():
        column = column if isinstance(column, dict) else {"name": column}
        files = [f"{name}.npz" for name, signals in logs.items() if column["name"] in signals]
        if files:
            columns[signal] = {**column, "files": files}
    (folder / "id.toml").write_text(plan.to_toml({**tables, "columns": columns}))
    for name, signals in logs.items():
        np.savez(folder / f"{name}.npz", **signals)
    return [folder / f"{name}.npz" for name in logs]
