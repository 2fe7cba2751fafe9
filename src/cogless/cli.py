"""The command line: parses, calls, prints."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from cogless.errors import StudyError

if TYPE_CHECKING:
    from rich.text import Text

    from cogless.report import Line
    from cogless.results import AnyResults
    from cogless.simulate import StudyProgress
    from cogless.study import AnyStudy

# The designs' matrices are small: BLAS threads would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

WIDE = 240  # columns where the output is no terminal, so that files and pipes get whole lines
WRONG, INTERRUPTED = 2, 130

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Simulate a permanent-magnet motor drive and compare the controllers that remove its torque ripple.",
)

StudyArgument = Annotated[
    str, typer.Argument(metavar="STUDY", help="A study file, or the name of a shipped study.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value, such as controller.pi.kp=0.02. A number takes the unit that stands there.",
    ),
]
JobsOption = Annotated[
    int, typer.Option("--jobs", "-j", min=1, help="Runs at a time.", show_default="one a core", metavar="N")
]
CORES = os.cpu_count() or 1


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit 2, Ctrl-C is exit 130."""
    try:
        code = app(prog_name="cogless", standalone_mode=False)
    except StudyError as error:
        _say(str(error))
        sys.exit(WRONG)
    except (KeyboardInterrupt, typer.Abort):
        _say("Interrupted.")
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):  # not of typer's own kind
            raise
        line = str(error.format_message()).rstrip(".")
        if line:
            _say(f"{line}. See cogless --help.")
        sys.exit(WRONG)
    if code == INTERRUPTED:  # what typer makes of Ctrl-C in a command
        _say("Interrupted.")
    sys.exit(code if isinstance(code, int) else 0)


def _version(wanted: bool) -> None:
    if wanted:
        from cogless.results import versions

        print(f"cogless {versions()['cogless']}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    study: StudyArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Where results go.", show_default="results/STUDY"),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only", metavar="SCENARIO/CONTROLLER", help="Only this run; * and ? match. Repeatable."
        ),
    ] = None,
    changes: SetOption = None,
    plots: Annotated[bool, typer.Option("--plots", help="Also write PNG pictures.")] = False,
    jobs: JobsOption = CORES,
) -> None:
    """Simulate a study: every controller in every scenario.

    Prints a table of controllers against metrics and writes results.json, traces.nc and report.html.

    Ctrl-C keeps the runs that are finished.
    """
    from cogless.files import writable
    from cogless.simulate import RunError, run_study, runs_of

    loaded = _load(study, changes)
    wanted = len(runs_of(loaded, only))
    folder = output or Path("results") / loaded.name
    failure: RunError | None = None
    with writable(folder):
        with _run_progress(wanted) as progress:
            try:
                results: AnyResults = run_study(loaded, only, progress, jobs)
            except RunError as error:
                failure, results = error, error.results
        if results.runs:
            _write(results, folder, plots)
    if results.runs:
        _print_tables(results)
        _print_warnings(results)
        print(f"Report: {folder / 'report.html'}")
    if failure is not None:
        raise failure
    if results.interrupted:
        kept = ", ".join(f"{run.scenario}/{run.controller}" for run in results.runs)
        where = f" ({kept}), written to {folder}" if kept else ", nothing written"
        _say(f"Interrupted: kept {len(results.runs)} of {wanted} runs{where}.")
        sys.exit(INTERRUPTED)


@app.command()
def design(
    study: StudyArgument,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, in SI units.")] = False,
) -> None:
    """Show every controller's gains and what is known of them before any run.

    Of a speed study: gains, given or by a tuning rule, the margins of its loop, whether learning settles.

    Of a study of trials: gains, given or by LMIs, and the certificate that they work.
    """
    from cogless.study import TrialStudy

    loaded = _load(study, changes)
    if isinstance(loaded, TrialStudy):
        from cogless.design.trial_summary import summary, table, to_dict

        designs = summary(loaded)
        found, shown = partial(to_dict, loaded, designs), partial(table, loaded, designs)
    else:
        from cogless.design.summary import to_dict as speed_dict
        from cogless.design.table import design_table

        found, shown = partial(speed_dict, loaded), partial(design_table, loaded)
    if as_json:
        print(json.dumps(found(), indent=2, ensure_ascii=False))
    else:
        _console().print(shown())


@app.command("list")
def list_() -> None:
    """List the shipped studies and motors, and the control laws."""
    from cogless.study.catalogue import catalogue

    console = _console()
    for heading, entries in catalogue().items():
        console.print(f"[bold]{heading}[/bold]")
        width = max((len(name) for name in entries), default=0)
        for name, about in entries.items():
            console.print(f"  {name:<{width}}  {about}", markup=False, highlight=False)


@app.command()
def calibrate(study: StudyArgument, changes: SetOption = None, jobs: JobsOption = CORES) -> None:
    """Fit parameters of a study to target values of its metrics, as its calibration table says.

    Prints the fitted values as lines for the study, and each target beside what came out. Changes no file.

    Ctrl-C prints the best fit so far.
    """
    from cogless.calibrate import calibrate as fit_study
    from cogless.calibrate import residual_rows
    from cogless.study import TrialStudy

    loaded = _load(study, changes)
    if isinstance(loaded, TrialStudy):
        raise StudyError(f"{loaded.source.path}: calibration: expected a study of speed, not of trials")
    with _console(stderr=True).status("Fitting") as status:
        fit = fit_study(
            loaded, lambda n, d: status.update(f"Fitting: {n} evaluations, {100 * d:.2f} % off"), jobs
        )
    from rich.table import Table

    table = Table(
        "run", "metric", "wanted", "got", "deviation", box=None, header_style="bold", pad_edge=False
    )
    for row in residual_rows(fit):
        table.add_row(*row)
    console = _console()
    console.print(table)
    outcome = "interrupted, the best fit so far is off by" if fit.interrupted else "fitted to"
    print(f"\n# {outcome} {100 * fit.deviation:.2f} % (rms of the deviations)")
    for parameter in fit.parameters:
        print(f"{parameter.toml}  # was {parameter.before}")
    if fit.interrupted:
        raise KeyboardInterrupt
    if not fit.settled:
        raise StudyError(
            f"{loaded.source.path}: calibration: not settled: expected parameters that move the targets"
        )


def _load(study: str, changes: list[str] | None) -> AnyStudy:
    from cogless.study.reading import changes_from, load

    return load(study, changes_from(changes or ()))


def _write(results: AnyResults, folder: Path, plots: bool) -> None:
    from cogless import report, trace
    from cogless import results as results_room

    results_room.write(results, folder / "results.json")
    about = {"title": results.study.title, "seed": results.study.seed}
    trace.write_netcdf(folder / "traces.nc", results.runs, about)
    report.write(results, folder / "report.html")
    if plots:
        report.write_plots(results, folder)


def _print_tables(results: AnyResults) -> None:
    from rich.table import Table
    from rich.text import Text

    from cogless import report
    from cogless.report.comparison import misses

    study, console = results.study, _console()
    for scenario in results.scenarios:
        controllers = [run.controller for run in results.runs if run.scenario == scenario]
        table = Table(title=scenario, title_justify="left", title_style="bold", box=None, pad_edge=False)
        table.add_column("")
        for name in controllers:
            table.add_column(study.label(name), justify="right")
        lines = report.lines(results, scenario)
        for line in lines:
            cells = [_cell(line, name, study.baseline) for name in controllers]
            table.add_row(Text(f"{line.title} [{line.unit}]" if line.unit else line.title), *cells)
        console.print(table)
        for name, speed in misses(lines).items():
            console.print(
                f"! {study.label(name)} did not hold the speed: {speed}", highlight=False, markup=False
            )
        console.print()
    console.print(
        f"* best; (x) times the value of {study.label(study.baseline)}", highlight=False, markup=False
    )


def _print_warnings(results: AnyResults) -> None:
    """Controllers of a speed study whose learning is known to grow."""
    from cogless.design.space_learning import warning
    from cogless.results import Results

    if isinstance(results, Results):
        for name in dict.fromkeys(run.controller for run in results.runs):
            found = warning(results.study, name)
            if found is not None:
                _say(f"Warning: controller.{name}: {found}.")


def _cell(line: Line, controller: str, baseline: str) -> Text:
    """A number, its ratio to the baseline, and a mark: * is the best, ! did not hold the speed."""
    from rich.text import Text

    from cogless.report.packing import number

    text, ratio = line.number(controller) or "-", line.ratio(controller, baseline)
    if ratio is not None and controller != baseline:
        text += f" ({number(ratio)}x)"
    mark = "*" if controller in line.best else "!" if controller in line.missed else " "
    return Text(f"{text} {mark}", style="bold" if mark == "*" else "")


@contextmanager
def _run_progress(runs: int) -> Iterator[StudyProgress]:
    """Progress on a terminal's stderr; nothing elsewhere."""
    console = _console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=runs)
        shares: dict[tuple[str, str], float] = {}

        def report(scenario: str, controller: str, share: float) -> None:
            shares[scenario, controller] = share
            bar.update(task, completed=sum(list(shares.values())), description=f"{scenario}/{controller}")

        yield report


def _console(**options: Any) -> Console:
    console = Console(**options)
    return console if console.is_terminal else Console(width=WIDE, **options)


def _say(line: str) -> None:
    print(line, file=sys.stderr)
