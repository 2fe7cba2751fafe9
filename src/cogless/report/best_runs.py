"""Further runs of the best law of each scenario: with learning off, and to find what limits it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from cogless.errors import StudyError
from cogless.report.comparison import runs_in
from cogless.report.speed_verdict import Judged, judged, learner, unheld, value_in, verdict
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
    results = replace(results, limits={})
    try:
        for scenario in results.scenarios:
            if results.study.scenario[scenario].faults:
                continue
            if progress is not None:
                progress(scenario)
            search = _Search(results=results, long=long, jobs=jobs, traces=traces)
            limited = settings = search.holding(scenario)
            if settings is None or not settings.cures:
                limited = search.limits(scenario) or settings
            if limited is not None and settings is not None:
                limited = replace(limited, in_vain=settings.in_vain)
            if limited is not None:
                results = replace(results, limits={**results.limits, scenario: limited})
    except KeyboardInterrupt:
        pass
    return results


@dataclass(frozen=True, kw_only=True)
class _Search:
    """Tries of changes in one scenario after the other. `results`: with the limits of earlier scenarios.

    `long`: include runs that take long or execute a user's code. `jobs`, `traces`: as of `limits`.
    """

    results: Results
    long: bool
    jobs: int | None
    traces: Path | None

    def holding(self, scenario: str) -> Limits | None:
        """The settings with which a law holds a speed that none holds; None: none was tried."""
        lost = unheld(self.results, scenario)
        if lost is None or not self._may_repeat(lost.run):
            return None
        study, order = self.results.study, lost.line.order
        limited = holding(study, lost.run, lost.metric, order, self.jobs, self.traces)
        return limited and self._without_harm(limited, lost.run)

    def limits(self, scenario: str) -> Limits | None:
        """What limits a scenario's best run."""
        best = judged(self.results, scenario)
        if best is None or not self._may_repeat(best.run):
            return None
        study, metric = self.results.study, best.metric
        limited = limits(study, best.run, metric, best.line.order, self.jobs, self.traces)
        limited = limited and self._without_harm(limited, best.run)
        rival = learner(self.results, best)
        if limited is None or rival is None:
            return limited
        holds = rival.controller not in best.line.missed
        return beside_learner(study, limited, rival, metric, holds, self.jobs, self.traces)

    def _may_repeat(self, run: Run) -> bool:
        return self.long or is_quick(self.results.study, run.scenario, run.controller)

    def _without_harm(self, limited: Limits, run: Run) -> Limits:
        return without_harm(self.results.study, limited, [*self._elsewhere(run)], self.jobs, self.traces)

    def _elsewhere(self, run: Run) -> Iterator[Elsewhere]:
        """Runs of each other scenario, to try changes: of the best controller there, and of the same one.

        Scenarios with faults are left out, and ones in which no controller holds the speed.
        """
        for scenario in self.results.scenarios:
            best = judged(self.results, scenario)
            if scenario == run.scenario or best is None or self.results.study.scenario[scenario].faults:
                continue
            missed, limited = best.line.missed, self.results.limits.get(scenario)
            runs = [other for other in runs_in(self.results, scenario) if other.controller == run.controller]
            for other in {trial.controller: trial for trial in (best.run, *runs)}.values():
                if other.controller not in missed and self._may_repeat(other):
                    is_own = limited is not None and limited.controller == other.controller
                    yield Elsewhere(other, best.metric, best.line.order, limited if is_own else None)


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
    """The controller that the most verdicts of scenarios name as the best; None if no verdict names one."""
    verdicts = [verdict(results, runs_in(results, scenario)) for scenario in results.scenarios]
    winners = [named.best for named in verdicts if named is not None and named.best]
    return max(winners, key=winners.count, default=None)


def is_quick(study: AnyStudy, scenario: str, controller: str) -> bool:
    """Whether a run is short enough to be repeated a dozen times without a request of the user."""
    if study.controller[controller].code is not None:
        return False
    return study.timing(scenario).ticks <= TICKS_MOST
