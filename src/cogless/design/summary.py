"""Results of `cogless design` for each controller: its gains and the margins of its linear feedback."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, get_args

from cogless import units
from cogless.design.closed_loop import harmonic_gains, position_gains, position_margins
from cogless.design.law_rules import feedback_of
from cogless.design.laws.adrc import adrc_margins
from cogless.design.laws.harmonic import Certificate, certificate
from cogless.design.laws.space_bounds import Theorem, theorem
from cogless.design.learning_loop import fastest
from cogless.design.margins import Margins, finite
from cogless.design.speed_loop import current_loops, gains, speed_loop, weakness
from cogless.design.verdict import Verdict, verdict
from cogless.study import Study
from cogless.study.laws import AnyController
from cogless.study.laws.adrc import Adrc
from cogless.study.laws.harmonic import Harmonic
from cogless.study.laws.law import Feedback, Learning
from cogless.study.laws.space import SpaceLearning, SpacePosition
from cogless.study.table import Quantity
from cogless.units import TIME

# Units of what the rule of `harmonic` computes.
LEARNER = {
    "step": "rad",
    "b": "rad/s^2/A",
    "delay": "s",
    "base": "",
    "bends": "",
    "orders": "",
    "fast": "",
    "rate": "1/s",
    "rate_min": "1/s",
}


@dataclasses.dataclass(frozen=True)
class Gain:
    """A number of a controller in SI units, and its unit. `note` is set if the study has another number."""

    value: float
    unit: str
    note: str = ""


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

    def words(self) -> str:
        """Whether learning settles, and up to which speed it learns, in one line; empty without learning."""
        if self.certificate is not None:
            return self.certificate.words()
        if self.learning is None or self.fastest is None:
            return self.learning.words() if self.learning else ""
        speed = units.format(self.fastest, self.learning.unit, units.ANGULAR_SPEED, digits=6)
        return f"{self.learning.words()}; learns up to {speed}"


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


def to_dict(study: Study) -> dict[str, Any]:
    """The summary as plain types in SI units, for JSON; a margin that doesn't exist is null."""
    return {
        "study": study.title,
        "current_loop": current_loop_dict(study),
        "speed_loop": {"period": speed_loop(study).period, **dataclasses.asdict(speed_loop(study))},
        "controllers": {name: design_dict(design) for name, design in summary(study).items()},
    }


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


def _learning(found: Verdict) -> dict[str, Any]:
    worst, repair = found.worst, found.repair
    return {
        "verdict": found.words(),
        "factor_per_period": worst and worst.factor,
        "frequency_Hz": worst and worst.frequency,
        "settling_lead_s": repair and repair.lead,
        "settling_q_half_width": repair and repair.q_half_width,
        "settling_forgetting": repair and repair.forgetting,
        "frozen": list(found.frozen),
        "loop_unstable": found.unstable is not None,  # with the gain that learning adds within a sample
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
    controller = study.controller[name]
    own: dict[str, Gain] = {}
    if isinstance(controller, Harmonic):
        units = {"k_theta": "1/s", "kp": "A*s/rad", "ki": "A/rad"}
        own = {k: Gain(v, u) for (k, u), v in zip(units.items(), harmonic_gains(study, name), strict=True)}
        if not controller.position:
            del own["k_theta"]
    elif isinstance(controller, Feedback):
        kp, ki = gains(study, name)
        own = {"kp": Gain(kp, "A*s/rad"), "ki": Gain(ki, "A/rad")}
    elif isinstance(controller, SpacePosition):
        units = {"k_theta": "1/s", "k_omega": "A*s/rad", "k_i": "A/rad"}
        own = {k: Gain(v, u) for (k, u), v in zip(units.items(), position_gains(study, name), strict=True)}
    numbers = own | {key: gain for key, gain in _numbers(controller).items() if key not in own}
    if isinstance(controller, Learning):
        numbers["lead"] = _lead(study, controller)
    tuning = getattr(controller, "tuning", None)
    known, proof = verdict(study, name), theorem(study, name)
    if proof is not None and known is not None and known.kind not in ("settles", "rests"):
        # the proof is for continuous time only
        sampled = f"but sampled: {known.short()}"
        proof = dataclasses.replace(proof, obstacles=(*proof.obstacles, sampled))
    rule = tuning.rule if tuning else None
    certified = certificate(study, name) if isinstance(controller, Harmonic) else None
    if certified is not None:
        numbers |= {key: Gain(getattr(certified.learner, key), unit) for key, unit in LEARNER.items()}
    highest = certified.fastest if certified is not None else fastest(study, name)
    margins = weakest_margins(study, name)
    return Design(
        law=controller.law,
        rule=rule,
        gains=numbers,
        margins=margins,
        learning=known,
        theorem=proof,
        fastest=highest,
        certificate=certified,
    )


def weakest_margins(study: Study, name: str) -> Margins | None:
    """Margins at the slowest or the fastest reference, whichever are smaller; v of a position law differs."""
    law = study.controller[name]
    if isinstance(law, Adrc):
        return adrc_margins(speed_loop(study), law.b, law.omega_c, law.omega_o)
    scenarios = [study.scenario[key] for key in study.scenarios_of(name)]
    speeds = {speed for s in scenarios for speed in (s.slowest, s.top_reference)} or {0.0}
    feedbacks = dict.fromkeys(feedback_of(study, name, speed) for speed in speeds)
    found = [position_margins(speed_loop(study), feedback) for feedback in feedbacks if feedback]

    def least(m: Margins) -> float:
        return m.phase_margin if m.stable and math.isfinite(m.phase_margin) else -1.0

    return min(found, key=least, default=None)


def _lead(study: Study, controller: Learning) -> Gain:
    """The lead as the law uses it: rounded to whole samples of the speed loop."""
    rate = study.drive.rates.outer_loop
    samples = round(controller.lead * rate)
    used = samples / rate
    if math.isclose(used, controller.lead, rel_tol=1e-9):
        return Gain(controller.lead, TIME.unit)
    return Gain(used, TIME.unit, f"{samples} samples; {controller.lead:.4g} s asked for")


def _numbers(controller: AnyController) -> dict[str, Gain]:
    found = {}
    fields = type(controller).model_fields
    own = type(controller).__annotations__  # the law's own fields come before inherited ones
    idle = _idle(controller)
    for key, field in sorted(fields.items(), key=lambda item: item[0] not in own):
        value = getattr(controller, key)
        told = isinstance(value, int | float) and not isinstance(value, bool)
        if told and key not in ("kp", "ki", *idle):
            found[key] = Gain(value, _unit([*field.metadata, *get_args(field.annotation)]))
    return found


def _idle(controller: AnyController) -> set[str]:
    """Fields that have no effect with a law's other settings; empty unless the law learns in angle."""
    if not isinstance(controller, SpaceLearning):
        return set()
    if not controller.learning:
        return {*SpaceLearning.model_fields, "ramp"}
    return set() if (controller.memory, controller.delay_method) == ("delay", "ode") else {"k_pp"}


def _unit(annotations: list[Any]) -> str:
    for entry in annotations:
        if isinstance(entry, Quantity):
            return entry.dimension.unit
        inner = _unit(list(get_args(entry)))
        if inner:
            return inner
    return ""
