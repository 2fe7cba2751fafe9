"""The variables of an FMU: names, kinds, units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from cogless.signals import RECORDED

Kind = Literal["real", "integer", "boolean"]
Causality = Literal["independent", "parameter", "input", "output"]

# Signals that are whole numbers.
INTEGERS = ("status", "trial")

TERM = "part of the law's output"


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU. `start`: initial value in SI, unused for outputs."""

    name: str
    kind: Kind
    causality: Causality
    about: str
    unit: str = ""
    start: float = 0.0


# Measurements and references: inputs of the controller's FMU, outputs of the drive's. Constant in C -> name.
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


TIME = Variable("time", "real", "independent", "time since the start of the simulation", "s")


def real(causality: Causality, name: str, unit: str, about: str, start: float = 0.0) -> Variable:
    return Variable(name, "real", causality, about, unit, start)


def signal(name: str, unit: str) -> Variable:
    """A recorded signal as an output."""
    kind: Kind = "integer" if name in INTEGERS else "real"
    about = RECORDED[name].about if name in RECORDED else TERM
    return Variable(name, kind, "output", about, unit)


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
    """References that a controller is given once per current-loop period."""
    return [
        real(causality, "reference.theta_ref", "rad", "mechanical angle reference; laws of position read it"),
        real(causality, "reference.omega_ref", "rad/s", "mechanical speed reference"),
        real(causality, "reference.alpha_ref", "rad/s^2", "its derivative; laws that learn in angle read it"),
        real(causality, "reference.i_d_ref", "A", "d-axis current reference"),
        Variable("reference.learn", "boolean", causality, "false freezes what is learned", start=1.0),
    ]


def duties(causality: Causality, phases: int) -> list[Variable]:
    return [real(causality, f"duty_{phase}", "1", "duty cycle, 0 to 1", 0.5) for phase in "abc"[:phases]]


def place_of(variables: Sequence[Variable], name: str) -> int:
    """Value reference of a variable; if there is no such variable 0, which is that of the time."""
    return next((n for n, variable in enumerate(variables) if variable.name == name), 0)


def first(variables: Iterable[Variable], causality: Causality) -> int:
    """Value reference of the first variable with this causality."""
    return next(n for n, variable in enumerate(variables) if variable.causality == causality)
