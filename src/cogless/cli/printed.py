"""Print results, the answer first, and the design's warnings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from cogless.cli.terminal import new_console, print_fitted
from cogless.lines import print_text, warn

if TYPE_CHECKING:
    from rich.text import Text

    from cogless.design.blocks import Blocks
    from cogless.report import Line, Outcome
    from cogless.report.verdicts import LearningHelps
    from cogless.results import AnyResults
    from cogless.study import AnyStudy
    from cogless.study.reading import Remark

BLOCK_INDENT = "  "
LABEL_COLUMNS = 30  # least columns for the labels of a table of metrics, if a label is that long


def print_results(results: AnyResults, every_metric: bool = False) -> None:
    """Print for each scenario the verdict, each controller's value, what limits the best run, and the cost.

    `every_metric`: print the table of all metrics, too.
    """
    from cogless import report
    from cogless.report.comparison import remarks

    study, marked, numbers = results.study, set[str](), 0
    for scenario in results.scenarios:
        controllers = [run.controller for run in results.runs if run.scenario == scenario]
        lines = report.lines(results, scenario)
        verdict, ends = report.verdict(results, scenario), report.outcome(results, scenario)
        numbers += len(lines)
        new_console().print(scenario, style="bold", highlight=False, markup=False)
        if verdict is not None:
            print_text(verdict.headline)
        elif not lines and ends is None:
            print_text("No metric.")
        if ends is not None:
            _print_outcome(study, ends)
        elif len(controllers) > 1 and (line := report.judged_line(results, scenario)) is not None:
            _print_line(study, line, controllers, report.learning_off(results, scenario))
        if every_metric and lines:
            _print_metrics(study, lines, controllers)
            marked |= {*controllers}
        limit = report.limit(results, scenario)
        headline = verdict.headline if verdict is not None else ""
        reasons = [(remark, remark.partition(": ")[2]) for remark in remarks(study, scenario, lines)]
        sentences = [f"! {remark}" for remark, why in reasons if not why or why not in headline]
        if verdict is not None:
            sentences += [f"! {doubt}" for doubt in verdict.doubts]
        sentences += [str(limit or ""), verdict.cost if verdict is not None else ""]
        if any(sentences):
            print()
        for sentence in filter(None, sentences):
            print_text(sentence)
        print()
    for text in results.without_design():
        print_text(f"! {text}\n")
    if len(marked) > 1:  # with one controller there are no marks to explain
        ratio = f"; (x) times the value of {study.label(study.baseline)}" if study.baseline in marked else ""
        print_text(f"* best{ratio}")
    if not study.metric:
        print(f"{a_metric(study)}\n")
    elif numbers and not every_metric:
        what = "The metric" if numbers == 1 else "All metrics"
        print_text(f"{what}: in the report, or here with --all.")


def _print_line(study: AnyStudy, line: Line, controllers: Iterable[str], off: LearningHelps | None) -> None:
    """Print a metric: each controller's value, and how this value compares with the baseline's.

    `off`: result of the best law with learning off, printed in a row of its own.
    """
    from rich.table import Table
    from rich.text import Text

    from cogless.report.verdicts import change_words

    window = f", {line.window}" if line.window else ""
    table = Table(box=None, pad_edge=False)
    table.add_column(Text(f"{line.title}{window}"))
    table.add_column(Text(line.unit), justify="right", no_wrap=True)
    table.add_column("")
    for name in controllers:
        ratio = line.ratio(name, study.baseline)
        remark = "baseline" if name == study.baseline else "" if ratio is None else change_words(ratio)
        remark = "did not hold the speed" if name in line.missed else remark
        remark = "learned nothing" if name in line.unlearned else remark
        remark = "; ".join(filter(None, [remark, line.uneven_words(name)]))
        style = "bold" if name in line.best else ""
        if off is not None and off.controller == name:
            plain = replace(line, values={**line.values, name: off.value})
            ratio = plain.ratio(name, study.baseline)
            value, against = plain.number(name), "" if ratio is None else change_words(ratio)
            if off.value is None:
                value, against = "-", "did not hold the speed"
            table.add_row(Text(f"{study.label(name)}, learning off"), Text(value), Text(against))
        table.add_row(Text(study.label(name), style), Text(line.number(name) or "-", style), Text(remark))
    print()
    print_fitted(table)


def _print_metrics(study: AnyStudy, lines: Iterable[Line], controllers: Iterable[str]) -> None:
    """Print the table of all metrics."""
    from rich.table import Table
    from rich.text import Text

    names = list(controllers)
    table = Table(box=None, pad_edge=False)
    table.add_column("", min_width=LABEL_COLUMNS)
    for name in names:
        table.add_column(Text(study.label(name)), justify="right", no_wrap=True)
    for line in lines:
        cells = [_cell(line, name, study.baseline) for name in names]
        table.add_row(Text(f"{line.title} [{line.unit}]" if line.unit else line.title), *cells)
    print()
    print_fitted(table)


def _print_outcome(study: AnyStudy, ends: Outcome) -> None:
    """Print how each controller ended, a row for each."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for heading in ends.columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, cells in ends.rows:
        table.add_row(Text(study.label(name)), *cells)
    print()
    print_fitted(table)
    print_text(ends.note)


def print_blocks(blocks: Blocks) -> None:
    """Print a design: its title, one block for each controller, then the notes."""
    console = new_console()
    console.print(blocks.title, style="bold", highlight=False, markup=False)
    for block in blocks.blocks:
        print()
        console.print(block.heading, style="bold", highlight=False, markup=False)
        width = max(len(word) for word, _ in block.rows)
        for word, text in block.rows:
            print_text(f"{word:<{width}}  {text}", BLOCK_INDENT, " " * (len(BLOCK_INDENT) + width + 2))
    if blocks.notes:
        print()
    for note in blocks.notes:
        print_text(note)


def a_metric(study: AnyStudy) -> Remark:
    """The advice to add a metric, for a study without one. The metric suits any study of its kind."""
    from cogless.study.reading import Remark

    metric = study.example_metric
    example = "".join(f'\n{key} = "{word}"' for key, word in metric.items())
    text = f"To compare the controllers, add a metric to {study.source.path}, such as:"
    return Remark(f"{text}\n\n[[metric]]{example}", ({"metric": [metric]},))


def print_warnings(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> None:
    """Print the design's warnings about the controllers of these runs (scenario, name), each line once."""
    for _, remark in _warnings(study, runs):
        warn(str(remark))


def _warnings(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> Iterator[tuple[str, Remark]]:
    """Yield (controller, warning of the design) for these runs (scenario, controller), each line once."""
    from cogless.design.kinds import DESIGNS

    of_each, lines = {name: scenario for scenario, name in runs}, set[str]()
    for name, at in of_each.items():
        for remark in DESIGNS[study.kind].warnings(study, at, name):
            if str(remark) not in lines:
                lines.add(str(remark))
                yield name, remark


def print_uncertified(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> None:
    """Print the design's warnings with results, unless the report has a certificate of each controller."""
    from cogless.design.kinds import DESIGNS

    if not DESIGNS[study.kind].certified:
        print_warnings(study, runs)


def print_warnings_beside(results: AnyResults) -> None:
    """As `print_uncertified`, but a warning that the rotor may stop says whether it stopped in the run."""
    from cogless import report
    from cogless.design.kinds import DESIGNS

    if DESIGNS[results.study.kind].certified:
        return
    runs = {(run.scenario, run.controller): run for run in results.runs}
    for name, remark in _warnings(results.study, runs):
        run = runs.get((remark.stop.scenario, name)) if remark.stop is not None else None
        warn(str(remark) if run is None else report.seen_to_stop(results, run, remark))


def _cell(line: Line, controller: str, baseline: str) -> Text:
    """A table cell: value, ratio to the baseline, and a mark (* is best, ! failed to hold the speed)."""
    from rich.text import Text

    from cogless.report.markup import number

    text, ratio = line.number(controller) or "-", line.ratio(controller, baseline)
    if ratio is not None and controller != baseline:
        text += f" ({number(ratio)}x)"
    mark = "*" if controller in line.best else "!" if controller in line.missed else " "
    return Text(f"{text} {mark}", style="bold" if mark == "*" else "")
