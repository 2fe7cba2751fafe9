"""Signals of a study's runs, and why one is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cogless.c_laws import C_LAWS
from cogless.study.space_controller import SpaceLearning

if TYPE_CHECKING:
    from cogless.study.laws import AnyController
    from cogless.study.study import Study

OF_THE_CURRENT_LOOP = {"i_d", "i_d_ref", "i_a", "i_b", "i_c", "i_amplitude", "u_d", "u_q"}
OF_A_PATH = {"theta_ref", "theta_error", "theta_error_measured", "alpha_ref"}


def terms(law: AnyController) -> set[str]:
    """Signals that a law records of its own."""
    found = {term.signal for term in C_LAWS[law.law].terms} if law.law in C_LAWS else set()
    if not isinstance(law, SpaceLearning):
        return found
    unused = {*("term_beta", "term_h")[law.channels - 1 :], *(() if law.memory == "delay" else ("P_t",))}
    return (found - unused) | OF_A_PATH


def missing(study: Study, signal: str) -> str | None:
    """The message for a signal that no run of the study has; None where one has it."""
    if signal in OF_THE_CURRENT_LOOP and study.drive.ideal:
        return "expected another, since the current loop is ideal"
    if signal == "i_c" and study.motor.star().phases == 2:
        return "expected another, since the motor has two phases"
    if signal.startswith("energy_"):
        return None if study.trace.energy else "expected another, or trace.energy = true"
    own = signal.startswith("term_") or signal == "P_t" or signal in OF_A_PATH
    if own and not any(signal in terms(law) for law in study.controller.values()):
        return "expected a signal that a controller of this study has"
    return None
