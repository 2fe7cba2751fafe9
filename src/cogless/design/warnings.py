"""What a user should know of a controller before it runs, is exported, or comes onto a processor."""

from __future__ import annotations

from cogless.design import space_verdict
from cogless.design.learning import SETTLED
from cogless.design.map_size import map_warning
from cogless.design.summary import CurrentLoopDesign, current_loop_summary, design, learning_words
from cogless.study import AnyStudy, Study, TrialStudy
from cogless.study.space_controller import SpaceLearning


def warnings(study: AnyStudy, scenario: str, name: str) -> list[str]:
    """Of a controller and the current loop below it: a line each, which begins with the key."""
    if isinstance(study, TrialStudy):
        from cogless.design.from_study import design_study
        from cogless.design.trial_summary import warnings as trial_warnings

        found = trial_warnings(design_study(study, [(scenario, name)])[scenario, name])
        return [f"controller.{name}: {line}" for line in found]
    return [
        *loop_warnings(current_loop_summary(study)),
        *(f"controller.{name}: {line}" for line in _feedback_and_learning(study, name)),
        *map_warnings(study, name),
    ]


def map_warnings(study: Study, name: str) -> list[str]:
    """A map that is too small for what it shall learn."""
    found = map_warning(study, name)
    return [] if found is None else [f"controller.{name}: {found}"]


def loop_warnings(loops: dict[str, CurrentLoopDesign]) -> list[str]:
    """A current loop that is unstable or weak."""
    found = []
    for name, loop in told_apart(loops).items():
        if not loop.margins.stable:
            found.append(f"drive.current_loop: the {name} is unstable, and every speed loop around it")
        elif loop.weakness:
            found.append(f"drive.current_loop: the {name} is weak, it {loop.weakness} of phase margin")
    return found


def told_apart(loops: dict[str, CurrentLoopDesign]) -> dict[str, CurrentLoopDesign]:
    """The current loop by its name: one where both axes are alike."""
    if not loops:
        return {}
    if loops["d"].margins == loops["q"].margins and loops["d"].gains == loops["q"].gains:
        return {"current loop": loops["q"]}
    return {f"current loop, {axis}": loop for axis, loop in loops.items()}


def _feedback_and_learning(study: Study, name: str) -> list[str]:
    law = study.controller[name]
    if isinstance(law, SpaceLearning) and law.learning:
        return space_verdict.warnings(study, name)
    found = design(study, name)
    grows = found.learning is not None and found.learning.factor > SETTLED
    if grows or found.unstable:
        return [learning_words(found)]
    return ["feedback unstable"] if found.margins is not None and not found.margins.stable else []
