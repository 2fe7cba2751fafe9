"""The controller as an FMU, with the same C code as in `cogless export --to c`.

The whole drive as an FMU: plant, inverter, sensors and mechanics, with the study's controller inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cogless.c_literals import array
from cogless.export import sources
from cogless.export.c.export_c import subject_of
from cogless.export.c.subject import Subject, stem
from cogless.export.c.texts import controller_texts
from cogless.export.fmu.variables import (
    CONTROLLER_INPUTS,
    TIME_VARIABLE,
    Unit,
    Variable,
    asset,
    description_cpp,
    duties,
    in_precision,
    measurements,
    places,
    real,
    references,
    signal,
    texts,
)
from cogless.export.prepared import Prepared, Reals
from cogless.files import control_sources

# Prefixes of other names in the FMU's code, with which the controller's name must not begin.
TAKEN = ("fmu", "fmi", "controller", "motion")
# Members of the C struct cgl_drive_output, in its order.
OUTPUTS = ("duty_a", "duty_b", "duty_c", "i_d", "i_q", "u_d", "u_q", "i_d_ref", "i_q_ref", "status")
# C expression for the memory that the law's state points to.
MEMORY = "controller->memory"
# C expressions for other pointers in the state of a law of trials.
TRIAL_POINTERS = {
    "error": f"{MEMORY} + TRIAL_SAMPLES",
    "y_ref": "tick == 0 ? NULL : motion_of(tick - 1)",
}


def controller_unit(run: Prepared) -> Unit:
    """Contents of the controller's FMU, including what the controller had learned before the run."""
    subject = subject_of(run)
    if subject.name.lower().startswith(TAKEN):
        subject = replace(subject, name=f"my_{subject.name}")
    variables = _controller_variables(run)
    library = control_sources() / "cogless"
    closure = sources.closure(subject.parts)
    files = texts((library / name for name in closure), "cogless/")
    files = in_precision(files, run.engine.real_bits) | controller_texts(subject)
    files["controller_model.c"] = asset("controller_model.c")
    files["controller_variables.h"] = _variables_h(run, subject, variables)
    return Unit(
        name=f"{run.controller}-controller",
        description=f"{run.study.title}: the controller {run.controller}",
        language="C",
        rate=round(run.rate),
        stop_time=run.duration,
        variables=variables,
        sources=files,
    )


def _controller_variables(run: Prepared) -> list[Variable]:
    variables = [TIME_VARIABLE, *measurements("input", run.phases, run.bus_voltage), *references("input")]
    if run.bus_voltage is not None:
        variables += duties("output", run.phases)
        variables += [
            real("output", "i_d", "A", "measured d-axis current"),
            real("output", "i_q", "A", "measured q-axis current"),
            signal("u_d", "V"),
            signal("u_q", "V"),
            signal("i_d_ref", "A"),
        ]
    return [*variables, signal("i_q_ref", "A"), signal("status", "")]


def _variables_h(run: Prepared, subject: Subject, variables: Sequence[Variable]) -> str:
    """Text of the header controller_variables.h, which adapts controller_model.c to this controller."""
    name = subject.name
    outputs = {f"OUT_{output.upper()}": output for output in OUTPUTS}
    pointers = {subject.law.cells: MEMORY} if subject.law.cells else {}
    pointers |= TRIAL_POINTERS if subject.law.name == "trial" else {}
    links = "".join(f"    controller->law.{member} = {target};\n" for member, target in pointers.items())
    return f"""/* The controller of this FMU; generated. */
#include <string.h>

#include "{stem(name)}.h"

#define CONTROLLER {name}_controller
#define CONTROLLER_INIT {name}_init
#define CONTROLLER_STEP {name}_step

/* Value references; 0 where there is no such variable. */
{places(variables, CONTROLLER_INPUTS | outputs)}
/* Outputs in the order of cgl_drive_output. */
static const uint32_t output_place[] = {{{", ".join(outputs)}}};

{_trials(run, subject)}{_taught(run, subject)}
/* Sets the pointers into the controller anew. `tick`: that comes next. */
static void controller_relink(CONTROLLER *controller, uint64_t tick)
{{
    (void)controller;
    (void)tick;
{links}}}
"""


def _taught(run: Prepared, subject: Subject) -> str:
    """C function that loads into the law's memory what the law had learned before the run."""
    memory = run.memory
    if not memory.any():
        body = table = ""
    else:
        table = f"static const cgl_real taught[] = {{\n{array(memory, subject.precision)}\n}};\n\n"
        body = "    memcpy(controller->memory, taught, sizeof taught);\n"
    return (
        f"{table}static void controller_teach(CONTROLLER *controller)\n{{\n    (void)controller;\n{body}}}\n"
    )


def _trials(run: Prepared, subject: Subject) -> str:
    """C functions that begin and end trials; they do nothing in a run without trials."""
    before = after = motions = ""
    if subject.law.name == "trial":
        motions = _motions(run.description["trials"], subject)
        due, name = "    if (tick % TRIAL_TICKS == 0)", subject.name
        before = f"{due} {name}_begin_trial(controller, motion_of(tick));\n"
        after = f"{due} (void){name}_end_trial(controller);\n"
    unused = "    (void)controller;\n    (void)tick;\n"
    head = "static void controller_{}_step(CONTROLLER *controller, uint64_t tick)\n{{\n"
    return (
        f"{motions}/* `tick`: number of the step that is about to run. */\n"
        f"{head.format('before')}{before or unused}}}\n\n"
        f"/* `tick`: number of the step after the one that has run. */\n"
        f"{head.format('after')}{after or unused}}}\n\n"
    )


def _motions(trials: dict[str, Any], subject: Subject) -> str:
    """C code with the reference of each phase, and a function that returns the reference at a tick."""
    text, choice = "", ""
    for n, phase in enumerate(trials["phases"]):
        motion: Reals = np.asarray(phase["reference"], np.float64)
        text += f"static const cgl_real motion_{n}[] = {{\n{array(motion, subject.precision)}\n}};\n"
        if phase["from"] > 0:
            choice = f"    if (trial >= {phase['from']}U) return motion_{n};\n{choice}"
    samples = trials["samples"]
    return f"""enum {{ TRIAL_SAMPLES = {samples}, TRIAL_TICKS = {samples * subject.divider} }};

{text}
static const cgl_real *motion_of(uint64_t tick)
{{
    const uint64_t trial = tick / TRIAL_TICKS;
    (void)trial;
{choice}    return motion_0;
}}

"""


# Sources of the engine that an FMU doesn't need: only Python or a page uses them.
PYTHON = (
    "bindings.cpp",
    "drive_lanes.hpp",
    "python_value.hpp",
    "linear_trials.cpp",
    "lane_loops.cpp",
    "lane_plants.cpp",
    "lane_step.cpp",
    "lane_step.hpp",
    "linear_filter.hpp",
    "web.cpp",
    "packed_value.hpp",
)

EXTERNAL_CONTROL = "external_control"
EXTERNAL_REFERENCE = "external_reference"
# Constants for value references in drive_model.cpp -> names of the variables.
REFERENCE_CONSTANTS = {
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
    """Contents of the FMU of a run's whole drive."""
    signals = run.drive.signals
    variables = _drive_variables(run, signals)
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
        description=f"{run.study.title}: the drive with {run.controller} in {run.scenario}",
        language="C++",
        rate=round(run.rate),
        stop_time=run.duration,
        variables=variables,
        sources=sources,
    )


def _drive_variables(run: Prepared, signals: list[tuple[str, str]]) -> list[Variable]:
    names = {name for name, _ in signals}
    phases, bus_voltage = run.phases, run.bus_voltage
    variables = [TIME_VARIABLE]
    what = "input.i_q_ref acts" if bus_voltage is None else "the duty inputs act"
    description = f"if true, {what} at once, in place of the study's controller"
    variables += [Variable(EXTERNAL_CONTROL, "boolean", "parameter", description)]
    if not run.trials:
        description = "if true, inputs such as input.omega_ref give the reference, not the scenario"
        variables += [Variable(EXTERNAL_REFERENCE, "boolean", "parameter", description)]
    variables += [real("input", "tau_load_added", "N*m", "load torque that is added to that of the scenario")]
    if bus_voltage is None:
        description = f"q-axis current reference; it acts only if {EXTERNAL_CONTROL} is true"
        variables += [real("input", "input.i_q_ref", "A", description)]
    else:
        description = (
            "if true, all switches are off and the duty inputs have no effect; connect bit 1024 of the "
            "status of a controller"
        )
        variables += [Variable("bridge_open", "boolean", "input", description), *duties("input", phases)]
    if not run.trials:
        acts = f"it acts only if {EXTERNAL_REFERENCE} is true"
        reference_signals = [
            ("omega_ref", "rad/s", "speed"),
            ("theta_ref", "rad", "angle"),
            ("alpha_ref", "rad/s^2", "acceleration"),
        ]
        variables += [
            real("input", f"input.{name}", unit, f"mechanical {quantity} reference; {acts}")
            for name, unit, quantity in reference_signals
            if name in names
        ]
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
        "cogless::Value description();\n\n"
        "// The encoder table that the drive learned before; empty without one.\n"
        "std::vector<double> taught();\n\n"
        "// Value references; 0 where there is no such variable.\n"
        f"{places(variables, REFERENCE_CONSTANTS | {'FMU_FIRST_SIGNAL': first_signal})}\n"
        f"constexpr std::int64_t FMU_LAST_TICK = {last};  // when the trials are over; 0 without trials\n"
    )
