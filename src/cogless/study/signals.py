"""Find out which signals the runs of a study have, and why a signal is missing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING

from cogless import units
from cogless.control_library import C_LAWS
from cogless.signals import dimensions, exists
from cogless.study.controller import OwnLaw
from cogless.study.metric import OF_LINEAR_PLANTS
from cogless.study.motor import Motor
from cogless.study.space_controller import SpaceLearning
from cogless.study.table import nearest
from cogless.study.trial_controller import TrialLaw
from cogless.study.trial_study import TrialStudy
from cogless.units import Dimension

if TYPE_CHECKING:
    from cogless.study.controller import Base
    from cogless.study.study import Study

OF_A_LAW = "expected a signal that a controller of this study has"
# Properties of a drive that a signal may need (signals.def), and the error text if the drive lacks one.
NEEDED = {
    "electrical": "expected another, since the current loop is ideal",
    "three_phases": "expected another, since the motor has two phases",
    "thermal": "expected another, or a table motor.temperature",
    "energy": "expected another, or trace.energy = true",
    "load_side": "expected another, or a table mechanics.load_side",
    "path": "expected another, or a controller such as harmonic with position = true",
    "trial_law": OF_A_LAW,
}


def terms(law: Base) -> frozenset[str]:
    """Names of the recorded parts of a law's output."""
    if isinstance(law, OwnLaw):
        return frozenset({"term_learned"} if law.learning else ())  # if it tells, which only a run shows
    found = _terms("trial" if isinstance(law, TrialLaw) else getattr(law, "law", ""))
    if not isinstance(law, SpaceLearning):
        return found
    unused = {*("term_beta", "term_h")[law.channels - 1 :], *(() if law.memory == "delay" else ("P_t",))}
    return found - unused


@cache
def _terms(name: str) -> frozenset[str]:
    return frozenset(term.signal for term in C_LAWS[name].terms) if name in C_LAWS else frozenset()


def kinds(study: Study | TrialStudy) -> set[str]:
    """Properties that a study's drive has, out of the keys of NEEDED and "trials"."""
    motor, trials = study.motor, isinstance(study, TrialStudy)
    has = {
        "electrical": study.drive is not None and not study.drive.ideal,
        "three_phases": motor is not None and motor.phases == 3,
        "thermal": isinstance(motor, Motor) and motor.temperature is not None,
        "energy": study.trace.energy,
        "load_side": study.mechanics is not None and study.mechanics.load_side is not None,
        "path": any(
            isinstance(law, SpaceLearning) or law.holds_position for law in study.controller.values()
        ),
        "trials": trials,
        "trial_law": any(isinstance(law, TrialLaw) for law in study.controller.values()),
    }
    return {kind for kind, there in has.items() if there}


def linear(states: int) -> dict[str, Dimension]:
    """All signals of a linear plant in trials; they have no unit."""
    own = (term.signal for term in C_LAWS["trial"].terms)
    names = (*OF_LINEAR_PLANTS, *own, "learned", "status")
    return dict.fromkeys((*names, *(f"x_{i + 1}" for i in range(states))), units.NONE)


def missing(study: Study | TrialStudy, signals: Iterable[str]) -> Iterator[str | None]:
    """Error text for each signal that no run of the study has; None if a run has it."""
    if isinstance(study, TrialStudy) and study.plant is not None:
        known = linear(study.states)
        yield from (None if name in known else f"expected a signal: {', '.join(known)}" for name in signals)
        return
    has = kinds(study)
    own = set[str]().union(*map(terms, study.controller.values()))
    for name in signals:
        yield None if name in own else _missing(name, frozenset(has))


@cache
def _missing(signal: str, found: frozenset[str]) -> str | None:
    possible = NEEDED.keys() | (found & {"trials"})
    known = dimensions(possible, [name for name in C_LAWS if (name == "trial") == ("trials" in found)])
    if signal not in known:
        near = nearest(signal, list(known))
        return f'expected a signal, perhaps "{near}"' if near else f"expected a signal: {', '.join(known)}"
    if exists(signal, found):
        return None
    if any(signal == term.signal for law in C_LAWS.values() for term in law.terms):
        return OF_A_LAW
    lacks = (kind for kind in NEEDED if kind not in found and not exists(signal, possible - {kind}))
    return NEEDED[next(lacks)]
