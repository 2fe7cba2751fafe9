"""Commands for one study: `run`, `live`, `design`, `calibrate`. `list` shows what is shipped."""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cogless.cli.options import (
    CORES,
    JobsOption,
    LimitsOption,
    NoCodeOption,
    OnlyOption,
    OutputOption,
    SetOption,
    StudyArgument,
    command_line,
    load,
    name_code,
    output_option,
    results_folder,
    results_name,
    to_run,
)
from cogless.cli.printed import print_blocks, print_results, print_warnings_beside
from cogless.cli.terminal import has_desktop, new_bar, new_console, open_page, print_fitted, run_progress
from cogless.errors import EXIT_INTERRUPTED, StudyError
from cogless.interrupts import deferred
from cogless.lines import print_text, say, warn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cogless.ensemble.arena_file import Arena
    from cogless.results import AnyResults
    from cogless.study import AnyStudy

MAPS = "maps"  # folder of the learned maps, within the folder of the results
ACCELEROMETER = "accelerometer"  # folder of the accelerometer's logs, within the folder of the results
WRITING = "Interrupted: cogless is writing the results. Press Ctrl-C again to stop at once without results.\n"


def run(
    study: StudyArgument,
    output: OutputOption = None,
    only: OnlyOption = None,
    changes: SetOption = None,
    plots: Annotated[
        bool, typer.Option("--plots", help="Also write the pictures of the report as PNG files.")
    ] = False,
    no_traces: Annotated[
        bool, typer.Option("--no-traces", help="Do not write traces.nc, the recorded signals.")
    ] = False,
    with_page: Annotated[
        bool, typer.Option("--live", help="Also write live.html, the page of `cogless live`.")
    ] = False,
    limits: LimitsOption = None,
    jobs: JobsOption = CORES,
    no_code: NoCodeOption = False,
    every_metric: Annotated[bool, typer.Option("--all", help="Also print all metrics of each run.")] = False,
) -> None:
    """Simulate a study (every controller in every scenario) or an arena (every law on every plant).

    Prints a verdict on each scenario, and writes results.json, traces.nc and report.html.

    Ctrl-C and SIGTERM stop the command, which then keeps the finished runs.
    """
    from cogless.cli.next_commands import next_lines
    from cogless.design.kinds import DESIGNS
    from cogless.results.folder import locked_folder
    from cogless.run.own_law import no_exit
    from cogless.run.simulate import RunDefect, RunError, run_study, runs_of

    arena = _arena(study, changes)
    if arena is not None:
        name_code(arena.path, "law", arena.law, no_code, arena.user_file)
        _run_arena(arena, output or results_folder(arena.path), only, jobs, bool(limits))
        return
    loaded = to_run(study, changes, no_code)
    run_count = len(runs_of(loaded, only))
    folder = output or results_folder(loaded.source.path)
    if with_page:
        from cogless.live import check, render

        check(loaded)  # before the runs
    pairs = runs_of(loaded, only)
    for line in DESIGNS[loaded.kind].before_runs(loaded, pairs):
        warn(str(line))
    failures: list[StudyError] = []
    defect: RunDefect | None = None
    place = folder.absolute()  # a law may change the directory
    with ExitStack() as lock:
        lock.enter_context(locked_folder(place, _names(loaded, pairs, plots, not no_traces, with_page)))
        with run_progress(run_count) as progress, no_exit():
            try:
                results: AnyResults = run_study(loaded, only, progress, jobs, traces=place)
            except RunError as error:
                failures, results = [error], error.results
            except RunDefect as error:  # raised below, after the finished runs are written
                defect, results = error, error.results
        results = with_limits(_with_learning_off(results, place), limits, jobs, place)
        with deferred(WRITING) as requests:
            if results.runs:
                try:
                    command = command_line("run", study, changes, [])
                    page = render(loaded, command, limits=sentences(results)) if with_page else None
                    _write(results, place, plots, not no_traces, page, jobs)
                except StudyError as error:  # such as a full disk; the tables are still printed
                    failures.append(error)
                written = all(isinstance(failure, RunError) for failure in failures)
                _print(results, folder, with_page, written, every_metric)
                if written and not (defect or failures or results.interrupted):
                    for line in next_lines(results, study, changes):
                        print(line)
            lock.close()
            if defect is not None:
                raise defect
            if failures:
                raise StudyError("\n".join(map(str, failures)))
            if results.interrupted or requests.count:
                runs = ", ".join(f"{run.scenario}/{run.controller}" for run in results.runs)
                where = f" ({runs}), written to {folder}" if runs else ", nothing written"
                say(f"Interrupted: kept {len(results.runs)} of {run_count} runs{where}.")
                sys.exit(EXIT_INTERRUPTED)


def _names(
    study: AnyStudy, pairs: Sequence[tuple[str, str]], plots: bool, traces: bool, with_page: bool
) -> list[str]:
    """The files that a run may write."""
    from cogless.drives.accelerometer import accelerometer_logs
    from cogless.report import plot_names
    from cogless.results import results_json

    return [
        *("report.html", "results.json"),
        *(["traces.nc"] if traces else []),
        *(["live.html"] if with_page else []),
        *(plot_names(study) if plots else []),
        *(f"{MAPS}/{results_json.name(*pair)}" for pair in pairs),
        *(f"{ACCELEROMETER}/{name}" for pair in pairs for name in accelerometer_logs(study, *pair)),
    ]


def _print(results: AnyResults, folder: Path, with_page: bool, written: bool, every_metric: bool) -> None:
    """Print the results, and where the files are if they are `written`."""
    from cogless.drives.accelerometer import accelerometer_logs

    print_results(results, every_metric)
    print_warnings_beside(results)
    if written:
        print(f"Report: {folder / 'report.html'}")
        if any(accelerometer_logs(results.study, run.scenario, run.controller) for run in results.runs):
            print(f"Accelerometer: {folder / ACCELEROMETER}")
        if with_page:
            from cogless.live import left_out

            print(f"Page: {folder / 'live.html'}")
            for line in left_out(results.study):
                say(f"Left out of the page: {line}")


def _write(results: AnyResults, folder: Path, plots: bool, traces: bool, page: str | None, jobs: int) -> None:
    """Write the results as a new set of files, with `jobs` above 1 the traces while the report is made."""
    from cogless import report
    from cogless.drives.accelerometer import write_accelerometer_logs
    from cogless.results import results_json
    from cogless.results.folder import hashes, new_set
    from cogless.results.trace import write_netcdf
    from cogless.run.side_by_side import side_by_side

    study, stop = results.study, Event()

    def attributes() -> dict[str, Any]:
        return {"title": study.title, "seed": study.seed, "run": results_json.run_id(results)}

    with new_set(folder) as stage:
        write_traces = partial(write_netcdf, stage / "traces.nc", results.runs, attributes, study.file_rate)
        write_report = partial(report.write, results, stage / "report.html")
        # the traces first, as compressing them takes longest and leaves Python to the report
        files = [write_traces, write_report] if traces else [write_report]
        written = side_by_side(files, jobs, stop)
        if stop.is_set():
            raise KeyboardInterrupt
        for file in written:
            file.result()
        if page is not None:
            (stage / "live.html").write_text(page, encoding="utf-8")
        results_json.write_all(results, stage / MAPS)
        write_accelerometer_logs(results, stage / ACCELEROMETER)
        if plots:
            report.write_plots(results, stage)
        results_json.write(results, stage / "results.json", hashes(stage))


def _arena(study: str, changes: list[str] | None) -> Arena | None:
    """The arena of a file, or None if the file is a study."""
    from cogless.ensemble.arena_file import arena_of
    from cogless.study.reading import changes_from, find, is_arena, put, read

    path = find(study, "studies", "study")
    tables = read(path)
    if not is_arena(tables):
        return None
    for key, value in changes_from(changes or ()).items():
        put(tables, key, value)
    return arena_of(path, tables)


def _run_arena(arena: Arena, folder: Path, only: list[str] | None, jobs: int, find_limits: bool) -> None:
    from cogless.ensemble import arena_scores
    from cogless.ensemble.arena import chosen, run_arena
    from cogless.results.folder import locked_folder, new_set
    from cogless.run.own_law import no_exit

    plants = len(chosen(arena, only))
    place = folder.absolute()  # a law may change the directory
    with locked_folder(place, ["results.json"]):
        with new_bar() as bar, no_exit():
            task = bar.add_task("", total=plants)
            results = run_arena(
                arena,
                only,
                lambda name, done: bar.update(task, completed=done, description=name),
                jobs,
                find_limits=find_limits,
            )
        written = bool(results.runs or results.trials or not results.interrupted)
        with deferred(WRITING) as requests:
            if written:
                with new_set(place) as stage:
                    arena_scores.write(results, stage / "results.json")
                if headline := arena_scores.headline(results):
                    print_text(f"{headline}\n")
                print_fitted(arena_scores.table(results))
    for (plant, law), why in results.absent.items():
        say(f"Absent: {law} on {plant}: {why}")
    if written:
        print(f"Results: {folder / 'results.json'}")
    if results.interrupted or requests.count:
        finished = dict.fromkeys(run.plant for run in results.runs)
        where = f" ({', '.join(finished)}), written to {folder}" if finished else ", nothing written"
        say(f"Interrupted: kept {len(finished)} of {plants} plants{where}.")
        sys.exit(EXIT_INTERRUPTED)


def design(
    study: StudyArgument,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as JSON, in SI units.")] = False,
    whole: Annotated[bool, typer.Option("--long", help="Print all numbers as a table.")] = False,
) -> None:
    """Predict without a run whether each controller's learning settles and how fast. Show margins and gains.

    For a study of speed, prints the gains (given or from a tuning rule), the stability margins of the loop,
    and whether learning settles.

    For a study of trials, which repeat one motion, prints the gains (given or computed), and whether it is
    proven that the error falls from trial to trial.
    """
    from cogless.design.kinds import DESIGNS

    loaded = load(study, changes)
    design_of = DESIGNS[loaded.kind]
    if as_json:
        print(json.dumps(design_of.to_dict(loaded), indent=2, ensure_ascii=False))
    elif whole:
        print_fitted(design_of.table(loaded))
    else:
        print_blocks(design_of.blocks(loaded))


def calibrate(
    study: StudyArgument,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    no_code: NoCodeOption = False,
) -> None:
    """Fit parameters of a study so that its metrics reach target values.

    The table `calibration` of the study names the parameters and targets. Prints the fitted parameters as
    lines to paste into the study, and the target and the simulated value of each metric. Changes no file.

    Ctrl-C stops the fit and prints the best parameters so far.
    """
    from cogless.run.calibrate import calibrate as fit_study
    from cogless.run.calibrate import residual_rows
    from cogless.run.own_law import no_exit

    loaded = to_run(study, changes, no_code)
    with new_console(stderr=True).status("Fitting") as status, no_exit():
        fit = fit_study(
            loaded, lambda n, d: status.update(f"Fitting: {n} evaluations, {100 * d:.2f} % off"), jobs
        )
    from rich.table import Table

    outcome = "interrupted; deviation of the best fit so far:" if fit.interrupted else "deviation of the fit:"
    print(f"# {outcome} {100 * fit.deviation:.2f} % (rms of all targets)")
    for parameter in fit.parameters:
        print_text(f"{parameter.toml}  # was {parameter.before}", others="# ")
    table = Table(
        "run", "metric", "target", "fitted", "deviation", box=None, header_style="bold", pad_edge=False
    )
    for row in residual_rows(fit):
        table.add_row(*row)
    print()
    print_fitted(table)
    if fit.interrupted:
        raise KeyboardInterrupt
    if not fit.settled:
        raise StudyError(
            f"{loaded.source.path}: calibration: the fit did not settle: expected parameters that change "
            "the metrics"
        )


def with_limits(results: AnyResults, asked: bool | None, jobs: int, folder: Path | None) -> AnyResults:
    """The results, with an analysis of what limits each scenario's best run.

    `asked`: True for the option --limits, False for --no-limits, else None. `folder`: place for long traces.
    """
    from cogless import report

    if asked is False or results.interrupted or not report.has_limits(results.study):
        return results
    with new_bar() as bar:
        task = bar.add_task("", total=None)

        def tell(scenario: str) -> None:
            bar.update(task, description=f"{scenario}: what limits it")

        return report.with_limits(results, asked is True, jobs, folder, tell)


def _with_learning_off(results: AnyResults, folder: Path) -> AnyResults:
    """The results, with the result of each scenario's best law when its learning is off."""
    from cogless import report

    if results.interrupted:
        return results
    with new_bar() as bar:
        task = bar.add_task("", total=None)

        def tell(scenario: str) -> None:
            bar.update(task, description=f"{scenario}: with learning off")

        return report.with_learning_off(results, folder, tell)


def sentences(results: AnyResults) -> dict[str, str]:
    """{scenario: sentence on what limits its best run}, without scenarios that have no known main cause."""
    from cogless import report

    remarks = {scenario: report.limit(results, scenario) for scenario in results.scenarios}
    return {scenario: str(remark) for scenario, remark in remarks.items() if remark is not None}


def live(
    study: StudyArgument,
    output: Annotated[
        Path | None,
        output_option("File of the page.", "FILE", show_default="STUDY-live.html"),
    ] = None,
    own_motor: Annotated[
        bool,
        typer.Option(
            "--own-motor",
            help="Add fields to the page for the values of your own motor. The controllers use these values, "
            "too.",
        ),
    ] = False,
    limits: LimitsOption = None,
    jobs: JobsOption = CORES,
    changes: SetOption = None,
    closed: Annotated[bool, typer.Option("--no-open", help="Do not open the page in the browser.")] = False,
) -> None:
    """Write a page that runs a study in the browser, and open it. The page shows how gains change the ripple.

    The page is one HTML file, which contains the engine and the control laws. It needs no network and no
    installation.
    """
    from cogless.live import check, left_out, write

    loaded = load(study, changes)
    check(loaded)
    path = output or Path(f"{results_name(loaded.source.path)}-live.html")
    texts = {} if own_motor else _limits(loaded, limits, jobs)
    with new_console(stderr=True).status("Making the page"):
        write(loaded, path, command_line("run", study, changes, []), for_own_motor=own_motor, limits=texts)
    for line in left_out(loaded):
        say(f"Left out of the page: {line}")
    print(f"Page: {path}")
    if not closed and has_desktop():
        open_page(path)
    elif not closed:
        say("Open this page in a browser.")


def _limits(study: AnyStudy, asked: bool | None, jobs: int) -> dict[str, str]:
    """{scenario: sentence on what limits its best run}, from runs of the study.

    All pairs that the page can hold are run if `asked` is true, and only the quick ones if it is None.
    """
    from cogless.live.description import page_runs
    from cogless.report import has_limits, is_quick
    from cogless.run.simulate import RunError, run_study

    if asked is False or not has_limits(study):
        return {}
    pairs = [pair for pair in page_runs(study) if asked or is_quick(study, *pair)]
    if not pairs:
        return {}
    try:
        with run_progress(len(pairs)) as progress:
            results = run_study(study, ["/".join(pair) for pair in pairs], progress, jobs)
    except RunError:  # the page shows that run's failure
        return {}
    return sentences(with_limits(results, asked, jobs, None))


def list_() -> None:
    """List the shipped studies and motors, and the control laws."""
    from cogless.catalogue import show

    show()
