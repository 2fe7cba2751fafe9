"""Generated sources of an FMU: its variables in C, and the description of its run in C++."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.export.fmu.variables import Variable, first, place_of

KINDS = {"real": "FMU_REAL", "integer": "FMU_INTEGER", "boolean": "FMU_BOOLEAN"}
CAUSALITIES = {
    "independent": "FMU_TIME",
    "parameter": "FMU_PARAMETER",
    "input": "FMU_INPUT",
    "output": "FMU_OUTPUT",
}


def variables_c(variables: Sequence[Variable], token: str, rate: int) -> str:
    """C source with the table of variables that fmu.h declares."""
    rows = "".join(
        f'    {{"{v.name}", {KINDS[v.kind]}, {CAUSALITIES[v.causality]}, {number(v.start)}}},\n'
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
