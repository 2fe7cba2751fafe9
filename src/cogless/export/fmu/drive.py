"""The whole drive as an FMU: plant, inverter, sensors and mechanics, with the study's controller inside."""

from __future__ import annotations

from cogless.export.fmu.cpp import description_cpp, places
from cogless.export.fmu.unit import Unit, asset, in_precision, texts
from cogless.export.fmu.variables import (
    CONTROLLER_INPUTS,
    TIME,
    Variable,
    duties,
    measurements,
    real,
    references,
    signal,
)
from cogless.export.prepared import Prepared
from cogless.files import control_sources

# Sources of the engine that only Python or a page needs.
PYTHON = (
    "bindings.cpp",
    "python_value.hpp",
    "linear_trials.cpp",
    "lane_plants.cpp",
    "lane_step.cpp",
    "lane_step.hpp",
    "linear_filter.hpp",
    "web.cpp",
    "packed_value.hpp",
)

EXTERNAL_CONTROL = "external_control"
EXTERNAL_REFERENCE = "external_reference"
# Constants in drive_model.cpp for value references, with the names of their variables.
PLACES = {
    "FMU_EXTERNAL_CONTROL": EXTERNAL_CONTROL,
    "FMU_EXTERNAL_REFERENCE": EXTERNAL_REFERENCE,
    "FMU_LOAD_ADDED": "tau_load_added",
    "FMU_THETA_REF_INPUT": "input.theta_ref",
    "FMU_OMEGA_REF_INPUT": "input.omega_ref",
    "FMU_ALPHA_REF_INPUT": "input.alpha_ref",
    "FMU_I_Q_REF_INPUT": "input.i_q_ref",
    "FMU_BRIDGE_OPEN": "bridge_open",
    "FMU_DUTY_A": "duty_a",
    "FMU_DUTY_B": "duty_b",
    "FMU_DUTY_C": "duty_c",
} | CONTROLLER_INPUTS


def drive_unit(run: Prepared) -> Unit:
    """The drive of a run as the contents of an FMU."""
    signals = run.drive.signals
    variables = _variables(run, signals)
    simulator = control_sources().parents[1] / "simulator"
    sources = texts((control_sources() / "cogless").iterdir(), "cogless/")
    sources |= texts(path for path in simulator.iterdir() if path.name not in PYTHON)
    sources = in_precision(sources, run.engine.real_bits)
    sources["drive_model.cpp"] = asset("drive_model.cpp")
    sources["drive_variables.hpp"] = _places(variables, run.ticks if run.trials else 0)
    memory = run.memory
    sources["description.cpp"] = description_cpp(run.description, memory.tolist() if memory.any() else [])
    return Unit(
        name=f"{run.controller}-drive",
        about=f"{run.study.title}: the drive with {run.controller} in {run.scenario}",
        language="C++",
        rate=round(run.rate),
        stop_time=run.duration,
        variables=variables,
        sources=sources,
    )


def _variables(run: Prepared, signals: list[tuple[str, str]]) -> list[Variable]:
    names = {name for name, _ in signals}
    phases, bus_voltage = run.phases, run.bus_voltage
    variables = [TIME]
    what = "input.i_q_ref" if bus_voltage is None else "the duty inputs"
    about = f"true: {what} act at once, in place of the study's controller"
    variables += [Variable(EXTERNAL_CONTROL, "boolean", "parameter", about)]
    if not run.trials:
        about = "true: the reference is that of the inputs, not the scenario's"
        variables += [Variable(EXTERNAL_REFERENCE, "boolean", "parameter", about)]
    variables += [real("input", "tau_load_added", "N*m", "load torque besides that of the scenario")]
    if bus_voltage is None:
        about = f"q-axis current; counts where {EXTERNAL_CONTROL} is true"
        variables += [real("input", "input.i_q_ref", "A", about)]
    else:
        about = "true: all switches are off and the duties do not count; bit 1024 of a controller's status"
        variables += [Variable("bridge_open", "boolean", "input", about), *duties("input", phases)]
    if not run.trials:
        about = f"counts where {EXTERNAL_REFERENCE} is true"
        wanted = [("omega_ref", "rad/s"), ("theta_ref", "rad"), ("alpha_ref", "rad/s^2")]
        variables += [real("input", f"input.{name}", unit, about) for name, unit in wanted if name in names]
    variables += [signal(name, unit) for name, unit in signals if name != "time"]
    return [*variables, *measurements("output", phases, bus_voltage), *references("output")]


def _places(variables: list[Variable], last: int) -> str:
    """Text of the header with the value references of the variables that drive_model.cpp uses.

    `last`: tick at which the last trial ends, 0 without trials.
    """
    first_signal = next(v.name for v in variables if v.causality == "output")
    return (
        "// Declarations of this FMU; generated.\n#pragma once\n\n#include <cstdint>\n#include <vector>\n\n"
        '#include "value.hpp"\n\n'
        "cogless::Value description();\nstd::vector<double> taught();\n\n"
        "// Value references; 0 where there is no such variable.\n"
        f"{places(variables, PLACES | {'FMU_FIRST_SIGNAL': first_signal})}\n"
        f"constexpr std::int64_t FMU_LAST_TICK = {last};  // when the trials are over; 0 without trials\n"
    )
