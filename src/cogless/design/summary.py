"""Results of `cogless design` for each controller: its gains and the margins of its linear feedback."""

from __future__ import annotations

import dataclasses
from typing import Any

from cogless import units
from cogless.design.law_rules import Gain, rules_of
from cogless.design.laws.harmonic import Certificate
from cogless.design.laws.space_bounds import Theorem
from cogless.design.margins import Margins, finite
from cogless.design.speed_loop import current_loops, weakness
from cogless.design.verdict import Verdict, verdict
from cogless.study import Study
from cogless.study.laws.law import Base


@dataclasses.dataclass(frozen=True)
class Design:
    """One controller: law, tuning rule and gains, its feedback's margins, and whether learning settles."""

    law: str
    rule: str | None
    gains: dict[str, Gain]
    margins: Margins | None  # with the plant that the controller assumes
    learning: Verdict | None  # whether its learning settles; None if it doesn't learn
    theorem: Theorem | None = None  # for a law that learns in angle: the conditions of its proof
    fastest: float | None = None  # rad/s, up to which it learns; None if it doesn't learn
    certificate: Certificate | None = None  # of a law whose rule gives one

    def in_words(self) -> str:
        """As `clauses`, in one line."""
        return "; ".join(self.clauses)

    @property
    def clauses(self) -> list[str]:
        """Whether learning settles, and up to which speed it learns; empty without learning."""
        if self.certificate is not None:
            return self.certificate.clauses
        if self.learning is None:
            return []
        if self.fastest is None:
            return self.learning.clauses
        speed = units.format(self.fastest, self.learning.unit, units.ANGULAR_SPEED, digits=6)
        return [*self.learning.clauses, f"learns up to {speed}"]


@dataclasses.dataclass(frozen=True)
class CurrentLoopDesign:
    """The current loop of an axis: gains, margins, and why these aren't good enough, if so."""

    gains: dict[str, Gain]
    margins: Margins
    weakness: str | None


def summary(study: Study) -> dict[str, Design]:
    """The design of every controller of a study, by name."""
    return {name: design(study, name) for name in study.controller}


def current_loop_summary(study: Study) -> dict[str, CurrentLoopDesign]:
    """The current-loop design of each axis."""
    designs = {}
    for axis, loop in current_loops(study).items():
        margins = loop.margins()
        numbers = {"kp": Gain(loop.kp, "V/A"), "ki": Gain(loop.ki, "V/A/s")}
        designs[axis] = CurrentLoopDesign(numbers, margins, weakness(margins))
    return designs


def design_dict(design: Design) -> dict[str, Any]:
    """The design of one controller as plain types, for JSON."""
    return {
        "law": design.law,
        "rule": design.rule,
        "gains": _gains(design.gains),
        "margins": design.margins and _margins(design.margins),
        "learning": design.learning and _learning(design.learning),
        "theorem": design.theorem and _theorem(design.theorem),
        "fastest_rad_s": design.fastest,
        "certificate": design.certificate and dataclasses.asdict(design.certificate),
    }


def current_loop_dict(study: Study) -> dict[str, Any]:
    """The current-loop design of each axis as plain types, for JSON."""
    return {
        axis: {"gains": _gains(loop.gains), "margins": _margins(loop.margins), "weakness": loop.weakness}
        for axis, loop in current_loop_summary(study).items()
    }


def _gains(gains: dict[str, Gain]) -> dict[str, Any]:
    return {
        key: {"value": gain.value, "unit": gain.unit} | ({"note": gain.note} if gain.note else {})
        for key, gain in gains.items()
    }


def _margins(margins: Margins) -> dict[str, Any]:
    return {
        "stable": margins.stable,
        "crossover_rad_s": finite(margins.crossover),
        "phase_margin_rad": finite(margins.phase_margin),
        "gain_margin": finite(margins.gain_margin),
        "phase_crossover_rad_s": finite(margins.phase_crossover),
    }


def _learning(verdict: Verdict) -> dict[str, Any]:
    worst, repair = verdict.worst, verdict.repair
    return {
        "verdict": verdict.in_words(),
        "factor_per_period": worst and worst.factor,
        "frequency_Hz": worst and worst.frequency,
        "settling_lead_s": repair and repair.lead,
        "settling_q_half_width": repair and repair.q_half_width,
        "settling_forgetting": repair and repair.forgetting,
        "frozen": list(verdict.frozen),
        "loop_unstable": verdict.unstable is not None,  # with the gain that learning adds within a sample
    }


def _theorem(theorem: Theorem) -> dict[str, Any]:
    return {
        "bounds": theorem.bounds and dataclasses.asdict(theorem.bounds),
        "has": theorem.has,
        "asks": {condition.name: finite(condition.asks) for condition in theorem.conditions},
        "ratio": {condition.name: finite(condition.ratio(theorem.has)) for condition in theorem.conditions},
        "holds": theorem.holds,
        "verdict": theorem.verdict(),
    }


def design(study: Study, name: str) -> Design:
    """The design of one controller of a study."""
    controller, rules = study.controller[name], rules_of(study, name)
    own = rules.gains()
    numbers = own | {key: gain for key, gain in _numbers(controller).items() if key not in own}
    learning, proof, certified = verdict(study, name), rules.theorem(), rules.certificate()
    if proof is not None and learning is not None and learning.kind not in ("settles", "rests"):
        # the proof is for continuous time only
        sampled = f"the sampled law: {learning.short()}"
        proof = dataclasses.replace(proof, obstacles=(*proof.obstacles, sampled))
    return Design(
        law=controller.law,
        rule=controller.rule.rule if controller.rule else None,
        gains=numbers | rules.numbers_used(),
        margins=rules.margins(),
        learning=learning,
        theorem=proof,
        fastest=certified.fastest if certified is not None else rules.fastest(),
        certificate=certified,
    )


def weakest_margins(study: Study, name: str) -> Margins | None:
    """Margins at the slowest or the fastest reference, whichever are smaller; v depends on the speed."""
    return rules_of(study, name).margins()


def _numbers(controller: Base) -> dict[str, Gain]:
    numbers = {}
    fields = type(controller).model_fields
    own = type(controller).__annotations__  # the law's own fields come before inherited ones
    for key in sorted(fields, key=lambda key: key not in own):
        value = getattr(controller, key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and key not in ("kp", "ki", *controller.idle_keys):
            numbers[key] = Gain(value, controller.unit_of(key))
    return numbers
