"""Signals as the report draws them, error panels for varying references, and which laws learn in angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.control_library import C_LAWS
from cogless.results import Results, Run
from cogless.results.trace import Array, Trace
from cogless.study.base import spoken_unit
from cogless.study.laws.law import Base
from cogless.study.metric import SIGNAL_DIMENSIONS
from cogless.units import ANGLE, ANGULAR_SPEED, CURRENT, TURN, factor

# The signals of all laws that are learned parts of the current reference.
LEARNED_SIGNALS = tuple(
    dict.fromkeys(term.signal for law in C_LAWS.values() for term in law.terms if term.learned)
)
ALL_LEARNED = "learned terms"  # no signal has this name; trials have a signal "learned"


@dataclass(frozen=True)
class Panel:
    """A signal drawn in `unit`, `ratio` times the recorded one; ALL_LEARNED sums the learned terms."""

    title: str
    signal: str
    quantity: str
    unit: str
    ratio: int = 1

    @property
    def scale(self) -> float:
        """The number by which the signal's SI values are divided to get displayed values."""
        return factor(self.unit, SIGNAL_DIMENSIONS.get(self.signal, CURRENT)) / self.ratio

    def displayed(self, trace: Trace) -> Array:
        return np.asarray(trace[self.signal] / self.scale)


def in_angle(results: Results, run: Run) -> Base | None:
    """The law of a run, if it learns in angle and its learning is on; otherwise None."""
    law = results.study.controller[run.controller]
    return law if law.learns_functions and law.learns else None


def learned_terms(results: Results, run: Run) -> list[str]:
    """The signals of a run that are learned terms of its current reference."""
    learned = results.study.controller[run.controller].learned
    return [name for name in LEARNED_SIGNALS if learned and name in run.trace]


def travelled(results: Results, run: Run) -> str:
    """The signal over which a run's law learns, an angle: the rotor's, or its reference's."""
    return "theta_m" if results.study.controller[run.controller].by_rotor else "theta_ref"


def varies(reference: Array) -> bool:
    """Whether a reference isn't constant."""
    return len(reference) == 0 or bool(np.ptp(reference) > 1e-6 * max(1e-9, np.max(np.abs(reference))))


def varies_in(trace: Trace, signal: str, first: int = 0) -> bool:
    """Whether a signal isn't constant from a row on."""
    parts = (trace.part(signal, rows) for rows in trace.blocks(slice(first, None)))
    return varies(np.array([end for x in parts for end in (np.min(x), np.max(x))]))


def errors(results: Results, runs: Sequence[Run]) -> list[Panel]:
    """Panels of the speed error and, if a law controls the angle, of the angle error.

    There are none if the reference speed is constant and no law learns in angle. The errors are electrical or
    mechanical, as in the scenario's metrics.
    """
    study = results.study
    laws = [study.controller[run.controller] for run in runs]
    if not any(law.learns_functions for law in laws) and not varies_in(runs[0].trace, "omega_ref"):
        return []
    electrical = any(
        m.frame == "electrical" and m.signal in ("omega_error", "theta_error", "omega_m")
        for m in study.metrics_in(runs[0].scenario)
        if m.kind != "order"
    )
    ratio = study.motor.pole_pairs if electrical else 1
    frame = ", electrical" if ratio > 1 else ""
    panels = [("Speed error", "omega_error", ANGULAR_SPEED)]
    if any(law.holds_position for law in laws):
        panels.append(("Angle error", "theta_error", ANGLE))
    return [
        Panel(title + frame, signal, title.lower(), spoken_unit(study, dimension), ratio)
        for title, signal, dimension in panels
    ]


def periods(results: Results, run: Run) -> Array | None:
    """The number of learning periods travelled at each row; None without learning in angle."""
    law = in_angle(results, run)
    revolutions = None if law is None else law.revolutions(results.study.motor.pole_pairs)
    if revolutions is None or len(run.trace) < 2:
        return None
    theta = run.trace[travelled(results, run)]
    if not np.all(np.isfinite(theta)):
        return None
    return np.asarray(np.abs(theta - theta[0]) / (TURN * float(revolutions)))
