"""Which signals a study's runs have, and why one is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cogless.c_laws import C_LAWS
from cogless.signals import exists
from cogless.study.space_controller import SpaceLearning

if TYPE_CHECKING:
    from cogless.study.laws import AnyController
    from cogless.study.study import Study

OF_A_LAW = "expected a signal that a controller of this study has"
# What a signal may need of a drive (signals.def), and what to say where that is missing.
NEEDED = {
    "electrical": "expected another, since the current loop is ideal",
    "three_phases": "expected another, since the motor has two phases",
    "energy": "expected another, or trace.energy = true",
    "path": OF_A_LAW,
}


def terms(law: AnyController) -> set[str]:
    """The parts of its output that a law records."""
    found = {term.signal for term in C_LAWS[law.law].terms} if law.law in C_LAWS else set()
    if not isinstance(law, SpaceLearning):
        return found
    unused = {*("term_beta", "term_h")[law.channels - 1 :], *(() if law.memory == "delay" else ("P_t",))}
    return found - unused


def kinds(study: Study) -> set[str]:
    """What a study's drive has of what signals need."""
    has = {
        "electrical": not study.drive.ideal,
        "three_phases": study.motor.star().phases == 3,
        "energy": study.trace.energy,
        "path": any(isinstance(law, SpaceLearning) for law in study.controller.values()),
    }
    return {kind for kind, there in has.items() if there}


def missing(study: Study, signal: str) -> str | None:
    """What was expected in place of a signal that no run of the study has; None where one has it."""
    if any(signal == term.signal for law in C_LAWS.values() for term in law.terms):
        return None if any(signal in terms(law) for law in study.controller.values()) else OF_A_LAW
    found = kinds(study)
    if exists(signal, found):
        return None
    lacks = (kind for kind in NEEDED if kind not in found and not exists(signal, NEEDED.keys() - {kind}))
    return NEEDED[next(lacks)]
