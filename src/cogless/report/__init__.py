"""The report of a study: one offline HTML file, and still pictures."""

from collections.abc import Callable, Mapping
from pathlib import Path

from cogless.files import replacing
from cogless.report import page, pictures
from cogless.report.best_runs import best_controller, is_quick
from cogless.report.comparison import Line, compare, runs_in
from cogless.report.limit_sentences import remark
from cogless.report.page import Outcome, Sections
from cogless.report.speed import SPEED_SECTIONS
from cogless.report.speed_tracking import seen_to_stop
from cogless.report.trials import TRIALS
from cogless.report.verdicts import LearningHelps, ScenarioVerdict
from cogless.results import AnyResults
from cogless.study import AnyStudy
from cogless.study.base import Kind
from cogless.study.reading import Remark

__all__ = [
    "Line",
    "Outcome",
    "ScenarioVerdict",
    "best_controller",
    "compare",
    "has_limits",
    "is_quick",
    "judged_line",
    "learning_off",
    "limit",
    "lines",
    "outcome",
    "plot_names",
    "render",
    "seen_to_stop",
    "verdict",
    "verdicts",
    "with_learning_off",
    "with_limits",
    "write",
    "write_plots",
]


SECTIONS: Mapping[Kind, Sections] = {"speed": SPEED_SECTIONS, "trials": TRIALS}


def _sections(results: AnyResults) -> Sections:
    """The report's sections for the kind of study that the results come from."""
    return SECTIONS[results.study.kind]


def lines(results: AnyResults, scenario: str) -> list[Line]:
    """Comparison of a scenario's controllers, for any kind of study: one line per metric or order."""
    return _sections(results).lines(results, scenario)


def verdicts(results: AnyResults) -> list[ScenarioVerdict]:
    """The verdict on each scenario that can be judged."""
    return page.verdicts(results, _sections(results))


def verdict(results: AnyResults, scenario: str) -> ScenarioVerdict | None:
    """The verdict on a scenario; None if it can't be judged."""
    return _sections(results).verdict(results, runs_in(results, scenario))


def outcome(results: AnyResults, scenario: str) -> Outcome | None:
    """How each controller ended in a scenario of trials; None if there is no error to judge by."""
    return _sections(results).outcome(results, runs_in(results, scenario))


def judged_line(results: AnyResults, scenario: str) -> Line | None:
    """The metric by which a scenario's controllers are judged; None in a study of trials, or if none is."""
    return _sections(results).judged_line(results, runs_in(results, scenario))


def limit(results: AnyResults, scenario: str) -> Remark | None:
    """What limits a scenario's best run; None if no further runs were made, or no cause stands out."""
    if scenario not in results.limits:
        return None
    return remark(results.study, results.limits[scenario])


def learning_off(results: AnyResults, scenario: str) -> LearningHelps | None:
    """A scenario's best law compared with itself with learning off; None if no run shows this."""
    return _sections(results).learning_off(results, runs_in(results, scenario))


def has_limits(study: AnyStudy) -> bool:
    """Whether `with_limits` can find something in results of this study."""
    return SECTIONS[study.kind].with_limits is not None


def with_limits(
    results: AnyResults,
    long: bool = False,
    jobs: int | None = None,
    traces: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> AnyResults:
    """The results, to which `limits` is added: what limits the best run of each scenario.

    This takes about a dozen further runs per scenario. Nothing is added in a study of trials, or for a
    scenario with faults. `long`: make the further runs also if a run is long or executes a user's code.
    `jobs`, `traces`: as in `cogless.run.limit_search`. `progress`: called with each scenario. Ctrl-C ends the
    search early.
    """
    search = _sections(results).with_limits
    return results if search is None else search(results, long, jobs, traces, progress)


def with_learning_off(
    results: AnyResults, traces: Path | None = None, progress: Callable[[str], None] | None = None
) -> AnyResults:
    """The results with what each scenario's best law leaves with its learning off, if the law learns.

    A scenario takes one further run, or none if it has faults. A user's code is not executed again. In a
    study of trials every run already has a trace of its feedback alone. `traces`: as in
    `cogless.run.simulate.run_study`. `progress`: called with each scenario. Ctrl-C ends these runs early.
    """
    further = _sections(results).with_learning_off
    return results if further is None else further(results, traces, progress)


def render(results: AnyResults) -> str:
    """The report as one self-contained HTML text."""
    return page.render(results, _sections(results))


def write(results: AnyResults, path: Path) -> None:
    """Write the report; if this fails, no incomplete file is left."""
    with replacing(path) as temporary:
        temporary.write_text(render(results), encoding="utf-8")


def plot_names(study: AnyStudy) -> list[str]:
    """The names of all still pictures that a study may have."""
    kinds = SECTIONS[study.kind].pictures
    return [pictures.name(scenario, kind) for scenario in study.scenario for kind in kinds]


def write_plots(results: AnyResults, directory: Path) -> list[Path]:
    """Write the still pictures as PNG files and return their paths."""
    sections = _sections(results)
    drawn = page.charts(page.drawable(results), sections)
    return pictures.write_plots(results, drawn, sections.pictures, directory)
