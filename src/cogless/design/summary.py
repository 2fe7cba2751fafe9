"""What `cogless design` tells of each controller: its gains and the margins of its linear feedback."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, get_args

from cogless.design.learning import Worst, learning
from cogless.design.pi import PiDesign, gains, margins, speed_loop
from cogless.study import Study
from cogless.study.controller import AnyController, Feedback, RobustIlc
from cogless.study.table import Quantity


@dataclasses.dataclass(frozen=True)
class Gain:
    """A number of a controller, SI, and its unit."""

    value: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Design:
    """One controller: law, rule and gains, the margins of its linear feedback, how its learning settles."""

    law: str
    rule: str | None
    gains: dict[str, Gain]
    margins: PiDesign | None
    learning: Worst | None


def summary(study: Study) -> dict[str, Design]:
    """Every controller of a study by name."""
    return {name: _design(study, name) for name in study.controller}


def to_dict(study: Study) -> dict[str, Any]:
    """The same as plain types, SI, for JSON; a margin that the loop doesn't have is null."""
    controllers = {}
    for name, design in summary(study).items():
        controllers[name] = {
            "law": design.law,
            "rule": design.rule,
            "gains": {key: {"value": gain.value, "unit": gain.unit} for key, gain in design.gains.items()},
            "margins": design.margins
            and {
                "crossover_rad_s": _plain(design.margins.crossover),
                "phase_margin_rad": _plain(design.margins.phase_margin),
                "gain_margin": _plain(design.margins.gain_margin),
            },
            "learning": design.learning
            and {"factor_per_period": design.learning.factor, "frequency_Hz": design.learning.frequency},
        }
    return {
        "study": study.title,
        "speed_loop": dataclasses.asdict(speed_loop(study)),
        "controllers": controllers,
    }


def _design(study: Study, name: str) -> Design:
    controller = study.controller[name]
    rule: str | None = None
    pi: tuple[float, float] | None = None
    numbers = _numbers(controller)
    if isinstance(controller, Feedback):
        rule = controller.tuning.rule if controller.tuning else None
        pi = gains(study, name)
        numbers = {"kp": Gain(pi[0], "A*s/rad"), "ki": Gain(pi[1], "A/rad"), **numbers}
    elif isinstance(controller, RobustIlc):
        # (c e + eta S) / b with S = e + c integral(e): the part that is a PI.
        pi = (controller.c + controller.eta) / controller.b, controller.c * controller.eta / controller.b
    loop = margins(speed_loop(study), *pi) if pi else None
    return Design(controller.law, rule, numbers, loop, learning(study, name))


def _numbers(controller: AnyController) -> dict[str, Gain]:
    found = {}
    fields = type(controller).model_fields
    own = type(controller).__annotations__  # what the law alone has comes first
    for key, field in sorted(fields.items(), key=lambda item: item[0] not in own):
        value = getattr(controller, key)
        if isinstance(value, int | float) and not isinstance(value, bool) and key not in ("kp", "ki"):
            found[key] = Gain(value, _unit([*field.metadata, *get_args(field.annotation)]))
    return found


def _unit(annotations: list[Any]) -> str:
    for entry in annotations:
        if isinstance(entry, Quantity):
            return entry.dimension.unit
        inner = _unit(list(get_args(entry)))
        if inner:
            return inner
    return ""


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
