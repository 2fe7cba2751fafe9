"""The report of a study: one offline HTML file, and still pictures."""

from pathlib import Path

from cogless.files import replacing
from cogless.report import charts, page
from cogless.report.best_runs import is_quick, with_limits
from cogless.report.comparison import Line, compare, runs_in
from cogless.report.limit_sentences import remark
from cogless.report.page import Outcome, Sections
from cogless.report.speed import SPEED
from cogless.report.trials import TRIALS
from cogless.report.verdicts import ScenarioVerdict
from cogless.results import AnyResults, Results, TrialResults
from cogless.study import AnyStudy, TrialStudy
from cogless.study.remark import Remark

__all__ = [
    "Line",
    "Outcome",
    "ScenarioVerdict",
    "compare",
    "is_quick",
    "judged_line",
    "limit",
    "lines",
    "outcome",
    "plot_names",
    "render",
    "verdict",
    "verdicts",
    "with_limits",
    "write",
    "write_plots",
]


def _sections(results: AnyResults) -> Sections:
    """The report's sections for the kind of study that the results come from."""
    return TRIALS if isinstance(results, TrialResults) else SPEED


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
    """What limits a scenario's best run; None if no runs looked for it, or no cause stands out."""
    if not isinstance(results, Results) or scenario not in results.limits:
        return None
    return remark(results.study, results.limits[scenario])


def render(results: AnyResults) -> str:
    """The report as one self-contained HTML text."""
    return page.render(results, _sections(results))


def write(results: AnyResults, path: Path) -> None:
    """Write the report; if this fails, no incomplete file is left."""
    with replacing(path) as temporary:
        temporary.write_text(render(results), encoding="utf-8")


def plot_names(study: AnyStudy) -> list[str]:
    """The names of all still pictures that a study may have."""
    kinds = (TRIALS if isinstance(study, TrialStudy) else SPEED).pictures
    return [charts.name(scenario, kind) for scenario in study.scenario for kind in kinds]


def write_plots(results: AnyResults, directory: Path) -> list[Path]:
    """Write the still pictures as PNG files and return their paths."""
    sections = _sections(results)
    drawn = page.data(page.drawable(results), sections)
    return charts.write_plots(results, drawn, sections.pictures, directory)
