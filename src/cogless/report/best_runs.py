"""Further runs that find what limits the best run of each scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from cogless.report.speed_verdict import judged
from cogless.results import Results
from cogless.results.limits import Limits
from cogless.run.limit_search import limits
from cogless.study import AnyStudy
from cogless.study.laws.own import OwnLaw

TICKS_MOST = 5_000_000  # of a run that is made a dozen times again without being asked for


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
            best = judged(results, scenario)
            if best is None or results.study.scenario[scenario].faults:
                continue
            run, metric, order = best
            if not (long or is_quick(results.study, scenario, run.controller)):
                continue
            if progress is not None:
                progress(scenario)
            limited = limits(results.study, run, metric, order, jobs, traces)
            if limited is not None:
                by_scenario[scenario] = limited
    except KeyboardInterrupt:
        pass
    return replace(results, limits=by_scenario)


def is_quick(study: AnyStudy, scenario: str, controller: str) -> bool:
    """Whether a run is short enough to be repeated a dozen times without a request of the user."""
    if isinstance(study.controller[controller], OwnLaw):
        return False
    return study.timing(scenario).ticks <= TICKS_MOST
