"""What a law's keys mean in a study: its feedback, its gains by rule, its learning, what to warn of.

The rules of a law are a class, `PiIlcRules` for the model `PiIlc`, in the file of `design/laws` that is named
after the model's file. `rules_of` finds the class by this name; a law without such a class has the rules of
the model that it is derived from. No other code names a file of `design/laws` to find out which law a
controller has.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Generic, TypeVar, cast

from cogless.design.changes import unit_text
from cogless.design.closed_loop import Linear, oscillation, position_margins
from cogless.design.margins import Margins
from cogless.design.speed_loop import gains, speed_loop
from cogless.study import Study
from cogless.study.laws.law import Base, Feedback, LawLoop, Memory
from cogless.study.messages import dotted
from cogless.study.reading import Changes, Remark

MODEL_ROOM, RULE_ROOM = "cogless.study.laws", "cogless.design.laws"
FeedbackNumbers = list[tuple[float, ...]]
Values = dict[str, Any]  # values of a law's keys, SI
L = TypeVar("L", bound=Base)


@dataclass(frozen=True)
class Gain:
    """A number of a controller in SI units, and its unit. `note` is set if the study has another number."""

    value: float
    unit: str
    note: str = ""


@dataclass(frozen=True)
class LawRules(Generic[L]):
    """The rules of a controller's law in a study. These are the answers of a law that is only feedback."""

    study: Study
    name: str  # the controller's

    @property
    def law(self) -> L:
        """The controller's keys."""
        return cast("L", self.study.controller[self.name])

    def fill(self, study_here: Study) -> Values:
        """Values of keys that the table leaves to a tuning rule or to the drive.

        `study_here`: the study with the overrides of a run's scenario.
        """
        return {}

    def c_config(self, law: L, loop: LawLoop) -> dict[str, Any]:
        """Members of the law's struct in C. `law`: with the values of `fill`."""
        return law.c_config(loop)

    def feedback(self, omega_m: float) -> Linear | None:
        """The law's linear feedback before it learns, at a mechanical speed in rad/s; None: no model."""
        linear = self.law.linear
        return None if linear is None else Linear(ratio=1, k=linear[0], k_i=linear[1])

    def margins(self) -> Margins | None:
        """Margins at the slowest or the fastest reference, whichever are smaller; None without a model."""
        scenarios = [self.study.scenario[key] for key in self.study.scenarios_of(self.name)]
        speeds = {speed for s in scenarios for speed in (s.slowest, s.top_reference)} or {0.0}
        feedbacks = dict.fromkeys(self.feedback(speed) for speed in speeds)
        candidates = [
            position_margins(speed_loop(self.study), feedback) for feedback in feedbacks if feedback
        ]

        def least(m: Margins) -> float:
            return m.phase_margin if m.stable and math.isfinite(m.phase_margin) else -1.0

        return min(candidates, key=least, default=None)

    def gains(self) -> dict[str, Gain]:
        """The feedback's gains, where a rule may give them; keys of the table are listed without this."""
        return {}

    def numbers_used(self) -> dict[str, Gain]:
        """Numbers that the law uses in place of those of its table, or besides them."""
        return {}

    @property
    def pi(self) -> tuple[float, float] | None:
        """kp [A*s/rad] and ki [A/rad] of the law's PI if that controls only the speed; None: no such PI."""
        return None

    def slower(self, factor: float) -> Changes | None:
        """The change to a feedback `factor` times slower, equally damped; None: there are no such gains."""
        return None

    def auto(self) -> Values:
        """The numbers of the law's keys by the rule auto. StudyError: learning settles with none."""
        return {}

    def refused(self) -> str | None:
        """The rule's error message if the rule gives no numbers for the study; None if it gives some."""
        return None

    @property
    def memory(self) -> Memory | None:
        """The law's memory over a period of the angle; None: the law has none, or learns nothing."""
        return None

    @property
    def loop(self) -> type[Any] | None:
        """The class of learning_loop.LearningLoop that models the law's learning; None: no learning."""
        return None

    def fastest(self) -> float | None:
        """The highest mechanical speed, rad/s, at which the law learns; None: no learning over a period."""
        return None

    def never(self, scenario: str) -> str | None:
        """The reason why the law learns nothing even at the scenario's top speed; None if it learns."""
        top = self.study.scenario[scenario].top_speed
        if self.loop is None or not top:
            return None
        reason: str | None = self.loop(self.study, self.name, top, scenario=scenario).frozen
        return reason

    def unfit(self) -> str | None:
        """Why motor or load don't repeat with the learning period in a scenario; None if they do."""
        return None

    def theorem(self) -> Any:
        """The conditions of the law's proof, a space_bounds.Theorem; None if the law has no proof."""
        return None

    def certificate(self) -> Any:
        """What the law's rule certifies of learning, a laws.harmonic.Certificate; None: nothing."""
        return None

    def shortfall(self) -> Remark | None:
        """Warning of cogging that the law can't learn; None if the law learns all of it, or nothing."""
        return None

    def notes(self) -> Iterator[Remark]:
        """Warnings of what the law costs or leaves."""
        yield from ()

    def by_hand(self, own: Values) -> Changes:
        """The change to gains by hand. It removes the tuning rule, except auto, which allows such gains."""
        key, law = dotted(("controller", self.name)), self.law
        if law.rule is None or law.is_auto:
            return {f"{key}.{gain}": value for gain, value in own.items()}
        table = self.study.source.tables["controller"][self.name]
        return {key: {**{gain: value for gain, value in table.items() if gain != "tuning"}, **own}}


F = TypeVar("F", bound=Feedback)


class FeedbackRules(LawRules[F], Generic[F]):
    """The rules of a law whose feedback is a PI."""

    @property
    def pi(self) -> tuple[float, float] | None:
        return gains(self.study, self.name)

    def fill(self, study_here: Study) -> Values:
        kp, ki = gains(self.study, self.name)
        return {**super().fill(study_here), "kp": kp, "ki": ki}

    def feedback(self, omega_m: float) -> Linear | None:
        kp, ki = gains(self.study, self.name)
        return Linear(ratio=1, k=kp, k_i=ki)

    def gains(self) -> dict[str, Gain]:
        kp, ki = gains(self.study, self.name)
        return {"kp": Gain(kp, "A*s/rad"), "ki": Gain(ki, "A/rad")}

    def slower(self, factor: float) -> Changes | None:
        kp, ki = gains(self.study, self.name)
        return self.by_hand(pi_texts(kp / factor, ki / factor**2))


def pi_texts(kp: float, ki: float) -> dict[str, str]:
    """The keys of a PI's gains, A*s/rad and A/rad, in the study's notation."""
    return {"kp": unit_text(kp, "A*s/rad"), "ki": unit_text(ki, "A/rad")}


def rules_of(study: Study, name: str) -> LawRules[Any]:
    """The rules of a controller's law."""
    return rules_class(type(study.controller[name]))(study, name)


@cache
def rules_class(model: type) -> type[LawRules[Any]]:
    """The class of the rules for a model of a law, or for the first of its bases that has one."""
    for base in model.__mro__:
        room, _, file = base.__module__.rpartition(".")
        module = {f"{MODEL_ROOM}.law": __name__}.get(base.__module__, f"{RULE_ROOM}.{file}")
        if room == MODEL_ROOM and find_spec(module) is not None:
            rules: type[LawRules[Any]] | None = getattr(import_module(module), f"{base.__name__}Rules", None)
            if rules is not None:
                return rules
    return LawRules


def feedback_of(study: Study, name: str, omega_m: float = 0.0) -> Linear | None:
    """A controller's linear feedback before it learns, at a speed in rad/s; None for a user's own law."""
    return rules_of(study, name).feedback(omega_m)


def feedback_numbers(study: Study, name: str) -> FeedbackNumbers | None:
    """A controller's feedback at rest and at its top speed, to six digits; None for a user's own law."""
    top = max((study.scenario[key].top_reference for key in study.scenarios_of(name)), default=0.0)
    laws = [feedback_of(study, name, omega) for omega in (0.0, top)]
    return [tuple(float(f"{x:.6g}") for x in astuple(law)) for law in laws if law is not None] or None


def unstable_feedback(study: Study, name: str) -> str | None:
    """Message on the first scenario with unstable feedback, and the frequency; None if all are stable."""
    keys = study.scenarios_of(name)
    for key in keys:
        speeds = {study.scenario[key].slowest, study.scenario[key].top_reference}
        for feedback in (feedback_of(study, name, omega_m) for omega_m in sorted(speeds)):
            unstable = feedback and oscillation(speed_loop(study, key), feedback)
            if unstable:
                where = f" in scenario {key}" if len(keys) > 1 else ""
                return f"feedback unstable, at {unstable.frequency:.0f} Hz{where}"
    return None
