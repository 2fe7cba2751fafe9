"""Further runs of the best law of each scenario: with learning off, and to find what limits it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from cogless.errors import StudyError
from cogless.report.comparison import runs_in
from cogless.report.speed_verdict import Judged, judged, learner, unheld, value_in
from cogless.results import Results, Run
from cogless.results.limits import Limits
from cogless.results.metrics import result_name
from cogless.results.runs import LearningOff
from cogless.run.limit_search import Elsewhere, beside_learner, holding, limits, without_harm
from cogless.run.simulate import learning_off
from cogless.study import AnyStudy

TICKS_MOST = 5_000_000  # ticks of the longest run that is repeated a dozen times without being asked for


def with_limits(
    results: Results,
    long: bool = False,
    jobs: int | None = None,
    traces: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> Results:
    """As `cogless.report.with_limits`."""
    by_scenario: dict[str, Limits] = {}
    try:
        for scenario in results.scenarios:
            if results.study.scenario[scenario].faults:
                continue
            if progress is not None:
                progress(scenario)
            limited = settings = _holding(results, scenario, by_scenario, long, jobs, traces)
            if settings is None or not settings.cures:
                limited = _limits(results, scenario, by_scenario, long, jobs, traces) or settings
            if limited is not None and settings is not None:
                limited = replace(limited, in_vain=settings.in_vain)
            if limited is not None:
                by_scenario[scenario] = limited
    except KeyboardInterrupt:
        pass
    return replace(results, limits=by_scenario)


def _holding(
    results: Results,
    scenario: str,
    by_scenario: Mapping[str, Limits],
    long: bool,
    jobs: int | None,
    traces: Path | None,
) -> Limits | None:
    """The settings with which a law holds the speed of a scenario in which none does; None: none tried."""
    lost = unheld(results, scenario)
    if lost is None or not (long or is_quick(results.study, scenario, lost.run.controller)):
        return None
    limited = holding(results.study, lost.run, lost.metric, lost.line.order, jobs, traces)
    if limited is None or not limited.cures:
        return limited
    others = [*_elsewhere(results, lost.run, by_scenario, long)]
    return without_harm(results.study, limited, others, jobs, traces)


def _limits(
    results: Results,
    scenario: str,
    by_scenario: Mapping[str, Limits],
    long: bool,
    jobs: int | None,
    traces: Path | None,
) -> Limits | None:
    """What limits a scenario's best run."""
    best = judged(results, scenario)
    if best is None or not (long or is_quick(results.study, scenario, best.run.controller)):
        return None
    run, metric = best.run, best.metric
    limited = limits(results.study, run, metric, best.line.order, jobs, traces)
    if limited is None:
        return None
    others = [*_elsewhere(results, run, by_scenario, long)]
    limited = without_harm(results.study, limited, others, jobs, traces)
    rival = learner(results, best)
    if rival is None:
        return limited
    holds = rival.controller not in best.line.missed
    return beside_learner(results.study, limited, rival, metric, holds, jobs, traces)


def _elsewhere(
    results: Results, run: Run, by_scenario: Mapping[str, Limits], long: bool
) -> Iterator[Elsewhere]:
    """Runs of each other scenario, to try changes: of the best controller there, and of the same one.

    `by_scenario`: the limits of earlier scenarios. Scenarios with faults are left out, and ones in which no
    controller holds the speed. `long`: include runs that take long or execute a user's code.
    """
    for scenario in results.scenarios:
        best = judged(results, scenario)
        if scenario == run.scenario or best is None or results.study.scenario[scenario].faults:
            continue
        missed, tried = best.line.missed, by_scenario.get(scenario)
        runs = [other for other in runs_in(results, scenario) if other.controller == run.controller]
        for other in {trial.controller: trial for trial in (best.run, *runs)}.values():
            if other.controller not in missed and (
                long or is_quick(results.study, scenario, other.controller)
            ):
                own = tried if tried is not None and tried.controller == other.controller else None
                yield Elsewhere(other, best.metric, best.line.order, own)


def with_learning_off(
    results: Results, traces: Path | None = None, progress: Callable[[str], None] | None = None
) -> Results:
    """As `cogless.report.with_learning_off`."""
    by_scenario: dict[str, LearningOff] = {}
    try:
        for scenario in results.scenarios:
            best = judged(results, scenario)
            if best is None or results.study.scenario[scenario].faults:
                continue
            if results.study.controller[best.run.controller].code is not None:
                continue
            if progress is not None:
                progress(scenario)
            off = _learning_off(results, best, traces)
            if off is not None:
                by_scenario[scenario] = off
    except KeyboardInterrupt:
        pass
    return replace(results, learning_off=by_scenario)


def _learning_off(results: Results, best: Judged, traces: Path | None) -> LearningOff | None:
    run, metric, line = best.run, best.metric, best.line
    value = None
    try:
        off = learning_off(results.study, run.scenario, run.controller, traces)
        if off is None:
            return None
        value = value_in(replace(results, runs=[off]), off, metric, line)
    except StudyError:  # raised if the feedback alone diverges
        pass
    return LearningOff(
        scenario=run.scenario,
        controller=run.controller,
        metric=result_name(metric),
        order=line.order,
        value=value,
    )


def best_controller(results: Results) -> str | None:
    """The controller that holds the speed and is the best in most scenarios.

    None: none holds a speed, or there is only one controller.
    """
    if len({run.controller for run in results.runs}) < 2:
        return None
    winners = [
        best.run.controller
        for scenario in results.scenarios
        if (best := judged(results, scenario)) is not None and best.run.controller not in best.line.missed
    ]
    return max(winners, key=winners.count, default=None)


def is_quick(study: AnyStudy, scenario: str, controller: str) -> bool:
    """Whether a run is short enough to be repeated a dozen times without a request of the user."""
    if study.controller[controller].code is not None:
        return False
    return study.timing(scenario).ticks <= TICKS_MOST
