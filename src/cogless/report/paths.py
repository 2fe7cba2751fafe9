"""Helpers for references that vary: which error the report shows, and who learns in angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.c_laws import C_LAWS
from cogless.report.packing import Array
from cogless.results import Results, Run
from cogless.results.trace import Trace
from cogless.study import Study
from cogless.study.metric import SIGNALS
from cogless.study.space_controller import SpaceLearning, SpacePosition
from cogless.study.spoken import spoken_unit
from cogless.units import ANGLE, ANGULAR_SPEED, factor

# The learned parts of each law's current reference.
IN_ANGLE = ("term_alpha", "term_beta", "term_h")
LEARNED = tuple(dict.fromkeys(term.signal for law in C_LAWS.values() for term in law.terms if term.learned))


@dataclass(frozen=True)
class Error:
    """An error that the page draws in `unit`: `ratio` times the mechanical one, `title` names its frame."""

    signal: str
    ratio: int
    title: str
    unit: str

    @property
    def scale(self) -> float:
        """The divisor from the signal's SI values to the displayed ones."""
        return factor(self.unit, SIGNALS[self.signal]) / self.ratio

    def of(self, trace: Trace) -> Array:
        return np.asarray(trace[self.signal] / self.scale)


def learns(study: Study, controller: str) -> bool:
    """Whether what a controller asks for is learned in part."""
    return study.controller[controller].learned


def in_angle(study: Study, controller: str) -> SpaceLearning | None:
    """The law of a controller that learns in angle and may; None for another."""
    law = study.controller[controller]
    return law if isinstance(law, SpaceLearning) and law.learns else None


def learned_terms(results: Results, run: Run) -> list[str]:
    """The terms of a run that were learned."""
    return [n for n in LEARNED if n in run.trace] if learns(results.study, run.controller) else []


def travelled(study: Study, run: Run) -> Array:
    """The angle that a run's law counts, rad: the rotor's, or its reference's."""
    law = study.controller[run.controller]
    rotor = not isinstance(law, SpacePosition) or law.index == "rotor"
    return run.trace["theta_m" if rotor else "theta_ref"]


def varies(reference: Array) -> bool:
    """Whether a reference doesn't stay constant."""
    return len(reference) == 0 or bool(np.ptp(reference) > 1e-6 * max(1e-9, np.max(np.abs(reference))))


def errors(results: Results, runs: Sequence[Run]) -> list[Error]:
    """Speed error, and angle error where a law holds the angle; none where a constant speed is asked for."""
    study = results.study
    laws = [study.controller[run.controller] for run in runs]
    if not any(isinstance(law, SpaceLearning) for law in laws) and not varies(runs[0].trace["omega_ref"]):
        return []
    ratio = _ratio(results, runs[0].scenario)
    frame = ", electrical" if ratio > 1 else ""
    speed, angle = (spoken_unit(study, dimension) for dimension in (ANGULAR_SPEED, ANGLE))
    found = [Error("omega_error", ratio, f"Speed error{frame}", speed)]
    if any(isinstance(law, SpacePosition) for law in laws):
        found.append(Error("theta_error", ratio, f"Angle error{frame}", angle))
    return found


def _ratio(results: Results, scenario: str) -> int:
    """Factor of mechanical errors: into the frame that the scenario's metrics take them in."""
    taken = [m for m in results.study.metrics_in(scenario) if m.kind != "order"]
    electrical = any(
        m.frame == "electrical" and m.signal in ("omega_error", "theta_error", "omega_m") for m in taken
    )
    return results.study.motor.pole_pairs if electrical else 1


def periods(results: Results, run: Run) -> tuple[Array, float] | None:
    """Periods travelled at each row, and one period, mechanical rad; None without learning in angle."""
    law = in_angle(results.study, run.controller)
    if law is None or len(run.trace) < 2:
        return None
    period = 2 * math.pi * float(law.period.revolutions(results.study.motor.pole_pairs))
    theta = travelled(results.study, run)
    if not np.all(np.isfinite(theta)):
        return None
    return np.abs(theta - theta[0]) / period, period
