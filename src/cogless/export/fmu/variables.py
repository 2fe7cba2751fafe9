"""The variables of an FMU: names, kinds, units.

Generated sources of an FMU: its variables in C, and the description of its run in C++.

Contents of one FMU, whether of the controller or of the drive.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cogless.signals import RECORDED

Kind = Literal["real", "integer", "boolean"]
Causality = Literal["independent", "parameter", "input", "output"]

# Signals that are whole numbers.
INTEGERS = ("status", "trial")

TERM_CAUSALITY = "part of the law's output"


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU. `start`: initial value in SI, unused for outputs."""

    name: str
    kind: Kind
    causality: Causality
    description: str
    unit: str = ""
    start: float = 0.0


# Constant in C -> name of a measurement or reference, an input of the controller's FMU and an output of the
# drive's FMU.
CONTROLLER_INPUTS = {
    "FMU_I_A": "measured.i_a",
    "FMU_I_B": "measured.i_b",
    "FMU_I_C": "measured.i_c",
    "FMU_THETA_M": "measured.theta_m",
    "FMU_OMEGA_M": "measured.omega_m",
    "FMU_U_DC": "measured.u_dc",
    "FMU_THETA_REF": "reference.theta_ref",
    "FMU_OMEGA_REF": "reference.omega_ref",
    "FMU_ALPHA_REF": "reference.alpha_ref",
    "FMU_I_D_REF": "reference.i_d_ref",
    "FMU_LEARN": "reference.learn",
}


TIME_VARIABLE = Variable("time", "real", "independent", "time since the start of the simulation", "s")


def real(causality: Causality, name: str, unit: str, description: str, start: float = 0.0) -> Variable:
    return Variable(
        name=name, kind="real", causality=causality, description=description, unit=unit, start=start
    )


def signal(name: str, unit: str) -> Variable:
    """The output variable of a recorded signal."""
    kind: Kind = "integer" if name in INTEGERS else "real"
    description = RECORDED[name].meaning if name in RECORDED else TERM_CAUSALITY
    return Variable(name, kind, "output", description, unit)


def measurements(causality: Causality, phases: int, bus_voltage: float | None) -> list[Variable]:
    """Measurements of one current-loop period.

    `bus_voltage` None: the current loop is ideal, so currents and bus voltage aren't measured.
    """
    all_of_them = [
        real(causality, "measured.theta_m", "rad", "measured mechanical angle"),
        real(causality, "measured.omega_m", "rad/s", "measured mechanical speed"),
    ]
    if bus_voltage is None:
        return all_of_them
    currents = [
        real(causality, f"measured.i_{phase}", "A", "measured phase current") for phase in "abc"[:phases]
    ]
    voltage = real(causality, "measured.u_dc", "V", "measured bus voltage", bus_voltage)
    return [*currents, *all_of_them, voltage]


def references(causality: Causality) -> list[Variable]:
    """References of one current-loop period."""
    return [
        real(causality, "reference.theta_ref", "rad", "mechanical angle reference, read by laws of position"),
        real(causality, "reference.omega_ref", "rad/s", "mechanical speed reference"),
        real(
            causality,
            "reference.alpha_ref",
            "rad/s^2",
            "derivative of the speed reference, read by laws that learn over the angle",
        ),
        real(causality, "reference.i_d_ref", "A", "d-axis current reference"),
        Variable("reference.learn", "boolean", causality, "if false, learning is frozen", start=1.0),
    ]


def duties(causality: Causality, phases: int) -> list[Variable]:
    return [real(causality, f"duty_{phase}", "1", "duty cycle, 0 to 1", 0.5) for phase in "abc"[:phases]]


def place_of(variables: Sequence[Variable], name: str) -> int:
    """Value reference of a variable; 0, the reference of the time, if there is no such variable."""
    return next((n for n, variable in enumerate(variables) if variable.name == name), 0)


def first(variables: Iterable[Variable], causality: Causality) -> int:
    """Value reference of the first variable with this causality."""
    return next(n for n, variable in enumerate(variables) if variable.causality == causality)


TYPE_MACROS = {"real": "FMU_REAL", "integer": "FMU_INTEGER", "boolean": "FMU_BOOLEAN"}
CAUSALITIES = {
    "independent": "FMU_TIME",
    "parameter": "FMU_PARAMETER",
    "input": "FMU_INPUT",
    "output": "FMU_OUTPUT",
}


def variables_c(variables: Sequence[Variable], token: str, rate: int) -> str:
    """C source with the table of variables that fmu.h declares."""
    rows = "".join(
        f'    {{"{v.name}", {TYPE_MACROS[v.kind]}, {CAUSALITIES[v.causality]}, {number(v.start)}}},\n'
        for v in variables
    )
    return (
        '#include "fmu.h"\n\n'
        f'const char fmu_token[] = "{token}";\n'
        f"const uint32_t fmu_rate = {rate};\n"
        f"const uint32_t fmu_variable_count = {len(variables)};\n"
        f"const fmu_variable fmu_variables[] = {{\n{rows}}};\n"
    )


def places(variables: Sequence[Variable], names: dict[str, str]) -> str:
    """C enumeration of value references. `names`: constant -> variable; 0 if there is no such variable."""
    lines = [f"    {constant} = {place_of(variables, name)}" for constant, name in names.items()]
    lines += [f"    FMU_FIRST_INPUT = {first(variables, 'input')}"]
    lines += [f"    FMU_FIRST_OUTPUT = {first(variables, 'output')}"]
    return "enum {\n" + ",\n".join(lines) + "\n};\n"


def description_cpp(description: dict[str, Any], taught: Sequence[float]) -> str:
    """C++ source with the engine's description of a run and the initial contents of the law's memory."""
    return (
        '#include "drive_variables.hpp"\n\n'
        "using cogless::Value;\n\n"
        f"Value description() {{\n    return {value(description)};\n}}\n\n"
        f"std::vector<double> taught() {{\n    return {numbers(taught)};\n}}\n"
    )


def value(of: Any, depth: int = 1) -> str:
    """C++ expression of a cogless::Value for a plain value, list, table or matrix."""
    if of is None:
        return "Value()"
    if isinstance(of, bool):
        return f"Value({'true' if of else 'false'})"
    if isinstance(of, int):
        return f"Value({of}{'' if abs(of) < 2**31 else 'LL' if abs(of) < 2**63 else 'ULL'})"
    if isinstance(of, float):
        return f"Value({number(of)})"
    if isinstance(of, bytes):  # always three octal digits, so that the next character isn't read as one
        return f'Value(std::string("{"".join(f"{chr(92)}{byte:03o}" for byte in of)}", {len(of)}))'
    if isinstance(of, str):
        return f"Value({json.dumps(of)})"
    if isinstance(of, np.ndarray) and of.ndim == 2:
        return f"Value(Value::Matrix{{{of.shape[0]}, {of.shape[1]}, {numbers(of.ravel())}}})"
    pad = "    " * (depth + 1)
    if isinstance(of, dict):
        rows = "".join(f"{pad}{{{json.dumps(key)}, {value(of[key], depth + 1)}}},\n" for key in of)
        return f"Value(Value::Table{{\n{rows}{pad[4:]}}})"
    items = list(of)
    if items and all(isinstance(item, float) for item in items):
        return f"Value(Value::Numbers{numbers(items)})"
    rows = "".join(f"{pad}{value(item, depth + 1)},\n" for item in items)
    return f"Value(Value::List{{\n{rows}{pad[4:]}}})" if items else "Value(Value::List{})"


def numbers(of: Sequence[float] | np.ndarray[Any, Any]) -> str:
    return "{" + ", ".join(number(float(x)) for x in of) + "}"


def number(x: float) -> str:
    """A double as C and C++ read it back, without rounding; ValueError if it isn't finite."""
    if not math.isfinite(x):
        raise ValueError(f"{x}: expected a finite number")
    return repr(float(x))


DOUBLE = "#define COGLESS_DOUBLE /* this study's controller computes in double */\n"


@dataclass(frozen=True)
class Unit:
    """A model as an FMU: its variables and its own sources. `rate` in 1/s, `stop_time` in s."""

    name: str
    description: str
    language: Literal["C", "C++"]
    rate: int
    stop_time: float
    variables: Sequence[Variable]
    sources: Mapping[str, str]  # name below sources/ -> text

    @property
    def identifier(self) -> str:
        """The name as a C identifier."""
        return re.sub(r"\W", "_", self.name if self.name[:1].isalpha() else f"unit_{self.name}")


def asset(name: str) -> str:
    """Text of a C or C++ file from the folder assets/fmu of cogless."""
    return (Path(__file__).parents[1] / "assets" / "fmu" / name).read_text(encoding="utf-8")


def texts(files: Iterable[Path], under: str = "") -> dict[str, str]:
    """{name in the FMU's folder sources/: text} of these files. `under`: prefix of the names."""
    return {under + path.name: path.read_text(encoding="utf-8") for path in sorted(files)}


def in_precision(sources: dict[str, str], bits: int) -> dict[str, str]:
    """The control library's sources for numbers of 32 or 64 bits.

    For 64 bits, real.h itself defines the macro COGLESS_DOUBLE, so that no compiler option is needed.
    """
    if bits == 32:
        return sources
    return sources | {"cogless/real.h": DOUBLE + sources["cogless/real.h"]}
