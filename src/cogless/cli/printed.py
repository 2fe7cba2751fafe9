"""Results as tables on the terminal, and the design's warnings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from cogless.cli.terminal import new_console
from cogless.errors import say

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from cogless.report import Line, Outcome
    from cogless.results import AnyResults
    from cogless.study import AnyStudy
    from cogless.study.remark import Remark


def print_tables(results: AnyResults) -> None:
    from rich.table import Table
    from rich.text import Text

    from cogless import report
    from cogless.report.comparison import remarks

    study, console, shown = results.study, new_console(), set[str]()
    for scenario in results.scenarios:
        controllers = [run.controller for run in results.runs if run.scenario == scenario]
        lines = report.lines(results, scenario)
        table = Table(
            title=Text(scenario), title_justify="left", title_style="bold", box=None, pad_edge=False
        )
        table.add_column("")
        for name in controllers:
            table.add_column(Text(study.label(name)), justify="right")
        for line in lines:
            cells = [_cell(line, name, study.baseline) for name in controllers]
            table.add_row(Text(f"{line.title} [{line.unit}]" if line.unit else line.title), *cells)
        shown |= {*controllers} if lines else set()
        ends = report.outcome(results, scenario)
        console.print(table if lines else Text(scenario if ends else f"{scenario}: no metric"))
        for remark in remarks(study, lines):
            console.print(f"! {remark}", highlight=False, markup=False)
        broken = report.broken(results, scenario)
        if broken is not None:
            console.print(broken, highlight=False, markup=False)
        if ends is not None:
            _print_outcome(console, study, *ends)
        limit = report.limit(results, scenario)
        if limit is not None:
            console.print(str(limit), highlight=False, markup=False)
        console.print()
    for text in results.without_design():
        console.print(f"! {text}\n", highlight=False, markup=False)
    if len(shown) > 1:  # with one controller there are no marks to explain
        ratio = f"; (x) times the value of {study.label(study.baseline)}" if study.baseline in shown else ""
        console.print(f"* best{ratio}", highlight=False, markup=False)
    if not study.metric:
        console.print(f"{a_metric(study)}\n", highlight=False, markup=False, soft_wrap=True)


def _print_outcome(console: Console, study: AnyStudy, headline: str, ends: Outcome) -> None:
    """Print how each controller ended, a row for each, and the verdict's first sentences."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("", overflow="fold")
    for heading in ends.columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, cells in ends.rows:
        table.add_row(Text(study.label(name)), *cells)
    console.print()
    console.print(table)
    for line in (ends.note, headline):
        console.print(line, highlight=False, markup=False)


def a_metric(study: AnyStudy) -> Remark:
    """The advice to add a metric, for a study without one. The metric suits any study of its kind."""
    from cogless.study.remark import Remark

    metric = study.example_metric
    example = "".join(f'\n{key} = "{word}"' for key, word in metric.items())
    text = f"Metrics are what compares controllers, such as this one in {study.source.path}:"
    return Remark(f"{text}\n\n[[metric]]{example}", ({"metric": [metric]},))


def print_warnings(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> None:
    """Print the design's warnings about the controllers of these runs (scenario, name), each line once."""
    from cogless.design.kinds import DESIGNS

    warnings = DESIGNS[study.kind].warnings
    of_each = {name: scenario for scenario, name in runs}
    found = (remark for name, at in of_each.items() for remark in warnings(study, at, name))
    for line in dict.fromkeys(map(str, found)):
        say(f"Warning: {line}.")


def print_uncertified(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> None:
    """Print the design's warnings beside results, unless the report has a certificate of each controller."""
    from cogless.design.kinds import DESIGNS

    if not DESIGNS[study.kind].certified:
        print_warnings(study, runs)


def _cell(line: Line, controller: str, baseline: str) -> Text:
    """A table cell: value, ratio to the baseline, and a mark (* is best, ! failed to hold the speed)."""
    from rich.text import Text

    from cogless.report.markup import number

    text, ratio = line.number(controller) or "-", line.ratio(controller, baseline)
    if ratio is not None and controller != baseline:
        text += f" ({number(ratio)}x)"
    mark = "*" if controller in line.best else "!" if controller in line.missed else " "
    return Text(f"{text} {mark}", style="bold" if mark == "*" else "")
