"""The report of a study: one offline HTML file, and still pictures."""

from pathlib import Path

from cogless.report import faults, page, trials
from cogless.report.comparison import Line, compare, speed_unit
from cogless.report.verdict import ScenarioVerdict, verdicts
from cogless.results import AnyResults, Results, TrialResults

__all__ = [
    "Line",
    "ScenarioVerdict",
    "broken",
    "compare",
    "lines",
    "render",
    "verdicts",
    "write",
    "write_plots",
]


def lines(results: AnyResults, scenario: str) -> list[Line]:
    """Controllers against metrics, one line a number, whichever kind of study it is."""
    if isinstance(results, TrialResults):
        return trials.phase_lines(results, scenario)
    assert isinstance(results, Results)
    return compare(results, scenario)


def broken(results: AnyResults, scenario: str) -> str | None:
    """Words for what broke in a scenario and what came of it, a sentence or two; None where nothing did."""
    if not isinstance(results, Results):
        return None
    found = faults.account(results, scenario, speed_unit(results))
    return found.headline if found is not None else None


def render(results: AnyResults) -> str:
    """The report as one HTML text that needs nothing else."""
    if isinstance(results, TrialResults):
        return trials.render(results)
    assert isinstance(results, Results)
    return page.render(results)


def write(results: AnyResults, path: Path) -> None:
    """Write the report, whole or not at all."""
    if isinstance(results, TrialResults):
        trials.write(results, path)
    else:
        assert isinstance(results, Results)
        page.write(results, path)


def write_plots(results: AnyResults, directory: Path) -> list[Path]:
    """Write the still pictures and return their paths."""
    if isinstance(results, TrialResults):
        return trials.write_plots(results, directory)
    from cogless.report import plots

    assert isinstance(results, Results)
    return plots.write_plots(results, directory)
