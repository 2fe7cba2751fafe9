"""What the design says of a study, by its kind: gains before runs, tables of `cogless design`, warnings.

DESIGNS is the one place in this room that knows both kinds. Its functions take a study of their own kind.
The functions for trials import late, since SciPy takes longer to import than a speed study's design needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cogless.design import answers, design_table, law_rules, speed_blocks, summary, verdict, warnings
from cogless.design.blocks import Blocks
from cogless.study import Study, TrialStudy
from cogless.study.base import Kind
from cogless.study.reading import Remark

if TYPE_CHECKING:
    from rich.console import Group

    from cogless.design.trials.from_study import Designs, Pair


@dataclass(frozen=True)
class KindOfDesign:
    """The functions for one kind of study. The default of a function returns nothing for the kind."""

    prepared: Callable[[Any, Sequence[Pair]], Designs]  # designs that the runs of these pairs need
    to_dict: Callable[[Any], dict[str, Any]]  # the JSON of `cogless design`
    table: Callable[[Any], Group]  # the text of `cogless design --long`
    blocks: Callable[[Any], Blocks]  # the text of `cogless design`
    # arguments: study, scenario, controller; returns the design's numbers, and the statements of its verdict
    figures: Callable[[Any, str, str], tuple[dict[str, Any], list[str]]]
    warnings: Callable[[Any, str, str], list[Remark]]  # arguments: study, scenario, controller
    before_runs: Callable[[Any, Sequence[Pair]], Iterable[object]] = lambda study, pairs: ()  # warnings
    # whether a report of runs has a certificate, so that `warnings` need not be printed beside it
    certified: bool = False
    forecast: Callable[[Any, str], verdict.Verdict | None] = lambda study, name: None
    feedback: Callable[[Any, str], law_rules.FeedbackNumbers | None] = lambda study, name: None
    # arguments: study, controller, scenario
    likely_harm: Callable[[Any, str, str], str | None] = lambda study, name, scenario: None


def _speed_figures(study: Study, scenario: str, controller: str) -> tuple[dict[str, Any], list[str]]:
    design = summary.design(study, controller)
    loop = {f"current_loop.{axis}": entry for axis, entry in summary.current_loop_dict(study).items()}
    return {**loop, **summary.design_dict(design)}, design.clauses


def _speed_warnings_before(study: Study, pairs: Sequence[Pair]) -> list[object]:
    scenarios = (scenario for scenario, _ in pairs)
    return [
        *warnings.cogging_notes(study),
        *warnings.beyond_drive(study, scenarios),
        *warnings.too_short(study, pairs),
    ]


def _no_designs(study: Study, pairs: Sequence[Pair]) -> Designs:
    from cogless.design.trials.from_study import Designs

    return Designs()


def _trial_designs(study: TrialStudy, pairs: Sequence[Pair]) -> Designs:
    from cogless.design.trials.from_study import design_study

    return design_study(study, pairs)


def _trial_dict(study: TrialStudy) -> dict[str, Any]:
    from cogless.design.trials import trial_summary

    return trial_summary.to_dict(study, trial_summary.summary(study))


def _trial_table(study: TrialStudy) -> Group:
    from cogless.design.trials import trial_summary

    return trial_summary.table(study, trial_summary.summary(study))


def _trial_blocks(study: TrialStudy) -> Blocks:
    from cogless.design.trials import trial_blocks, trial_summary

    return trial_blocks.trial_blocks(study, trial_summary.summary(study))


def _trial_figures(study: TrialStudy, scenario: str, controller: str) -> tuple[dict[str, Any], list[str]]:
    from cogless.design.trials import trial_summary

    design = _trial_designs(study, [(scenario, controller)])[scenario, controller]
    return trial_summary.design_dict(design), [trial_summary.verdict_line(design)]


def _trial_warnings(study: TrialStudy, scenario: str, name: str) -> list[Remark]:
    from cogless.design.trials import trial_summary

    lines = trial_summary.warnings(_trial_designs(study, [(scenario, name)])[scenario, name])
    return [Remark(f"controller.{name}: {line}") for line in lines]


DESIGNS: Mapping[Kind, KindOfDesign] = {
    "speed": KindOfDesign(
        prepared=_no_designs,
        to_dict=answers.to_dict,
        table=design_table.design_table,
        blocks=speed_blocks.speed_blocks,
        figures=_speed_figures,
        warnings=warnings.warnings,
        before_runs=_speed_warnings_before,
        forecast=verdict.judgement,
        feedback=law_rules.feedback_numbers,
        likely_harm=warnings.likely_harm,
    ),
    "trials": KindOfDesign(
        prepared=_trial_designs,
        to_dict=_trial_dict,
        table=_trial_table,
        blocks=_trial_blocks,
        figures=_trial_figures,
        warnings=_trial_warnings,
        certified=True,
    ),
}
