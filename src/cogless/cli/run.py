"""`run`: every controller in every scenario, or every law on every plant of an arena."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
)
from cogless.cli.study import command_line, name_code, to_run
from cogless.cli.tables import print_tables, print_warnings
from cogless.cli.terminal import new_bar, new_console, run_progress
from cogless.errors import INTERRUPTED, StudyError, say
from cogless.interrupts import deferred

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cogless.results import AnyResults
    from cogless.study import AnyStudy
    from cogless.study.arena import Arena

MAPS = "maps"  # the folder of learned maps, within that of the results
WRITING = "Interrupted: the results are being written. Press Ctrl-C again to end at once without them.\n"


def run(
    study: StudyArgument,
    output: OutputOption = None,
    only: OnlyOption = None,
    changes: SetOption = None,
    plots: Annotated[bool, typer.Option("--plots", help="Also write PNG pictures.")] = False,
    no_traces: Annotated[bool, typer.Option("--no-traces", help="Write no traces.nc.")] = False,
    with_page: Annotated[
        bool, typer.Option("--live", help="Also write live.html, the page of `cogless live`.")
    ] = False,
    limits: LimitsOption = None,
    jobs: JobsOption = CORES,
    no_code: NoCodeOption = False,
) -> None:
    """Simulate a study: every controller in every scenario. Of an arena: every law on every plant.

    Prints a table of controllers against metrics and writes results.json, traces.nc and report.html.

    Ctrl-C and SIGTERM keep the runs that are finished.
    """
    from cogless.cli.limits import sentences, with_limits
    from cogless.design.warnings import beyond_drive, coarse_table, too_short
    from cogless.results import Results
    from cogless.results.folder import held
    from cogless.run.own_law import no_exit
    from cogless.run.simulate import RunDefect, RunError, run_study, runs_of

    arena = _arena(study, changes)
    if arena is not None:
        name_code(arena.path, "law", arena.law, no_code, arena.found)
        _run_arena(arena, output or Path("results") / arena.name, only, jobs, bool(limits))
        return
    loaded = to_run(study, changes, no_code)
    wanted = len(runs_of(loaded, only))
    folder = output or Path("results") / loaded.name
    if with_page:
        from cogless.live import check, render

        check(loaded)  # before the runs
    pairs = runs_of(loaded, only)
    far = beyond_drive(loaded, (scenario for scenario, _ in pairs))
    for line in (*coarse_table(loaded), *far, *too_short(loaded, pairs)):
        say(f"Warning: {line}.")
    failures: list[StudyError] = []
    defect: RunDefect | None = None
    place = folder.absolute()  # a law may change the directory
    with held(place, _names(loaded, pairs, plots, not no_traces, with_page)):
        with run_progress(wanted) as progress, no_exit():
            try:
                results: AnyResults = run_study(loaded, only, progress, jobs, traces=place)
            except RunError as error:
                failures, results = [error], error.results
            except RunDefect as error:  # what is finished is written before it is told
                defect, results = error, error.results
        if isinstance(results, Results):
            results = with_limits(results, limits, jobs, place)
        with deferred(WRITING) as requests:
            if results.runs:
                try:
                    command = command_line("run", study, changes, [])
                    page = render(loaded, command, limits=sentences(results)) if with_page else None
                    _write(results, place, plots, not no_traces, page)
                except StudyError as error:  # such as a full disk; the tables are still printed
                    failures.append(error)
                _print(results, folder, with_page, all(isinstance(failure, RunError) for failure in failures))
    if defect is not None:
        raise defect
    if failures:
        raise StudyError("\n".join(map(str, failures)))
    if results.interrupted or requests.count:
        runs = ", ".join(f"{run.scenario}/{run.controller}" for run in results.runs)
        where = f" ({runs}), written to {folder}" if runs else ", nothing written"
        say(f"Interrupted: kept {len(results.runs)} of {wanted} runs{where}.")
        sys.exit(INTERRUPTED)


def _names(
    study: AnyStudy, pairs: Sequence[tuple[str, str]], plots: bool, traces: bool, with_page: bool
) -> list[str]:
    """The files that a run may write."""
    from cogless.report import plot_names
    from cogless.results import map_files

    return [
        *("report.html", "results.json"),
        *(["traces.nc"] if traces else []),
        *(["live.html"] if with_page else []),
        *(plot_names(study) if plots else []),
        *(f"{MAPS}/{map_files.name(*pair)}" for pair in pairs),
    ]


def _print(results: AnyResults, folder: Path, with_page: bool, written: bool) -> None:
    """Print the tables, and where the files are if they are `written`."""
    from cogless.study import TrialStudy

    print_tables(results)
    if not isinstance(results.study, TrialStudy):  # of trials the report has certificates
        print_warnings(results.study, [(run.scenario, run.controller) for run in results.runs])
    if written:
        print(f"Report: {folder / 'report.html'}")
        if with_page:
            from cogless.live import left_out

            print(f"Page: {folder / 'live.html'}")
            for line in left_out(results.study):
                say(f"Left out of the page: {line}")


def _write(results: AnyResults, folder: Path, plots: bool, traces: bool, page: str | None) -> None:
    from cogless import report
    from cogless.results import map_files, results_json
    from cogless.results.folder import hashes, new_set
    from cogless.results.trace import write_netcdf
    from cogless.study import TrialStudy

    study, run = results.study, results_json.run_id(results)
    with new_set(folder) as stage:
        if traces:
            about = {"title": study.title, "seed": study.seed, "run": run}
            rate = math.inf if isinstance(study, TrialStudy) else study.trace.file_rate
            write_netcdf(stage / "traces.nc", results.runs, about, rate)
        report.write(results, stage / "report.html")
        if page is not None:
            (stage / "live.html").write_text(page, encoding="utf-8")
        map_files.write_all(results, stage / MAPS)
        if plots:
            report.write_plots(results, stage)
        results_json.write(results, stage / "results.json", hashes(stage))


def _arena(study: str, changes: list[str] | None) -> Arena | None:
    """The arena of a file, or None if it has a study."""
    from cogless.study.arena import arena_of, is_arena
    from cogless.study.reading import changes_from, find, put, read

    path = find(study, "studies", "study")
    tables = read(path)
    if not is_arena(tables):
        return None
    for key, value in changes_from(changes or ()).items():
        put(tables, key, value)
    return arena_of(path, tables)


def _run_arena(arena: Arena, folder: Path, only: list[str] | None, jobs: int, find_limits: bool) -> None:
    from cogless.ensemble import arena_files
    from cogless.ensemble.arena import chosen, run_arena
    from cogless.results.folder import held, new_set
    from cogless.run.own_law import no_exit

    plants = len(chosen(arena, only))
    place = folder.absolute()  # a law may change the directory
    with held(place, ["results.json"]):
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
                    arena_files.write(results, stage / "results.json")
                new_console().print(arena_files.table(results))
    for (plant, law), why in results.absent.items():
        say(f"Absent: {law} on {plant}: {why}")
    if written:
        print(f"Results: {folder / 'results.json'}")
    if results.interrupted or requests.count:
        finished = dict.fromkeys(run.plant for run in results.runs)
        where = f" ({', '.join(finished)}), written to {folder}" if finished else ", nothing written"
        say(f"Interrupted: kept {len(finished)} of {plants} plants{where}.")
        sys.exit(INTERRUPTED)
