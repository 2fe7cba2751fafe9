"""The commands: parse arguments, call the library, print results."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cogless.errors import INTERRUPTED, StudyError, say

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn
    from rich.text import Text

    from cogless.ensemble.executors import Workers
    from cogless.ensemble.sweep import Shard
    from cogless.report import Line
    from cogless.results import AnyResults
    from cogless.run.simulate import StudyProgress
    from cogless.study import AnyStudy
    from cogless.study.arena import Arena

# The matrices of the designs are so small that several BLAS threads would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

WIDE = 240  # columns if the output is no terminal, so that lines in files and pipes aren't wrapped
DIFFERENT = 1

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
ControllerOption = Annotated[
    str, typer.Option("--controller", metavar="NAME", help="A controller of the study.", show_default=False)
]
ScenarioOption = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        metavar="NAME",
        help="Where it runs.",
        show_default="the first scenario that has the controller",
    ),
]
OnlyOption = Annotated[
    list[str] | None,
    typer.Option("--only", metavar="SCENARIO/CONTROLLER", help="Only this run; * and ? match. Repeatable."),
]
OutputOption = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="DIR", help="Where results go.", show_default="results/STUDY"),
]
DaskOption = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="Run on a Dask cluster, such as tcp://node1:8786."),
]
NoCodeOption = Annotated[
    bool,
    typer.Option("--no-code", help="Refuse a study that brings its own code, in Python or a library."),
]
CORES = os.cpu_count() or 1


def _version(wanted: bool) -> None:
    if wanted:
        from cogless.versions import versions

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
    output: OutputOption = None,
    only: OnlyOption = None,
    changes: SetOption = None,
    plots: Annotated[bool, typer.Option("--plots", help="Also write PNG pictures.")] = False,
    no_traces: Annotated[bool, typer.Option("--no-traces", help="Write no traces.nc.")] = False,
    with_page: Annotated[
        bool, typer.Option("--live", help="Also write live.html, the page of `cogless live`.")
    ] = False,
    jobs: JobsOption = CORES,
    no_code: NoCodeOption = False,
) -> None:
    """Simulate a study: every controller in every scenario. Of an arena: every law on every plant.

    Prints a table of controllers against metrics and writes results.json, traces.nc and report.html.

    Ctrl-C keeps the runs that are finished.
    """
    from cogless.design.warnings import too_short
    from cogless.results.folder import held
    from cogless.run.simulate import RunError, run_study, runs_of
    from cogless.study import TrialStudy

    arena = _arena(study, changes)
    if arena is not None:
        _name_code(arena.path, "law", arena.law, no_code, arena.found)
        _run_arena(arena, output or Path("results") / arena.name, only, jobs)
        return
    loaded = _to_run(study, changes, no_code)
    wanted = len(runs_of(loaded, only))
    folder = output or Path("results") / loaded.name
    page = None
    if with_page:
        from cogless.live import render

        page = render(loaded, _command("run", study, changes, []))  # before the runs, which it may refuse
    for line in too_short(loaded, runs_of(loaded, only)):
        say(f"Warning: {line}.")
    failures: list[StudyError] = []
    with held(folder):
        with _run_progress(wanted) as progress:
            try:
                results: AnyResults = run_study(loaded, only, progress, jobs, traces=folder)
            except RunError as error:
                failures, results = [error], error.results
        if results.runs:
            try:
                _write(results, folder, plots, not no_traces, page)
            except StudyError as error:  # such as a full disk; the tables are still printed
                failures.append(error)
    if results.runs:
        _print_tables(results)
        if not isinstance(loaded, TrialStudy):  # trial studies have certificates in the report
            _print_warnings(loaded, [(run.scenario, run.controller) for run in results.runs])
        if not any(not isinstance(failure, RunError) for failure in failures):
            print(f"Report: {folder / 'report.html'}")
            if page is not None:
                print(f"Page: {folder / 'live.html'}")
    if failures:
        raise StudyError("\n".join(map(str, failures)))
    if results.interrupted:
        kept = ", ".join(f"{run.scenario}/{run.controller}" for run in results.runs)
        where = f" ({kept}), written to {folder}" if kept else ", nothing written"
        say(f"Interrupted: kept {len(results.runs)} of {wanted} runs{where}.")
        sys.exit(INTERRUPTED)


@app.command()
def live(
    study: StudyArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The page.", show_default="STUDY-live.html"),
    ] = None,
    changes: SetOption = None,
) -> None:
    """Write a page that runs a study of speed in the browser: turn a gain, and see the ripple follow.

    One HTML file with the engine and the control laws inside. It needs no network and no installation.
    """
    from cogless.live import write

    loaded = _load(study, changes)
    path = output or Path(f"{loaded.name}-live.html")
    with _console(stderr=True).status("Making the page"):
        write(loaded, path, _command("run", study, changes, []))
    print(f"Page: {path}")


@app.command()
def sweep(
    study: StudyArgument,
    count: Annotated[int, typer.Option("-n", min=1, metavar="N", help="Variants to draw.")] = 1000,
    output: OutputOption = None,
    only: OnlyOption = None,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    dask: DaskOption = None,
    shard: Annotated[
        str | None,
        typer.Option("--shard", metavar="I/N", help="Only this part, such as 3/20, of a job array."),
    ] = None,
    merge: Annotated[bool, typer.Option("--merge", help="Put finished shards in DIR together.")] = False,
    no_code: NoCodeOption = False,
) -> None:
    """Run a study as many variants of itself, drawn as its vary table says: what spreads, and why.

    Writes sweep.parquet, a row for each run, and report.html. The same command goes on with a sweep that was
    ended, and with a larger -n adds to it.
    """
    from cogless.ensemble import sweep as sweeping
    from cogless.ensemble import table
    from cogless.files import writable
    from cogless.report import sweep as report
    from cogless.results.folder import held, new_set

    table.require()
    part = _shard(shard)
    loaded = _to_run(study, changes, no_code)
    folder = output or Path("results") / loaded.name
    planned = sweeping.plan(loaded, count, only)
    with writable(folder):
        if merge:
            found: table.Sweep | None = sweeping.merge(planned, folder)
        else:
            wanted = planned.variants(part)
            with _workers(jobs, dask) as workers, _variant_progress(wanted) as progress:
                found = sweeping.run(planned, folder, workers, part, progress)
        if found is None:
            print(f"Shard: {folder / part.file}")
            return
        with held(folder), new_set(folder) as stage:
            table.write(found, stage / "sweep.parquet")
            told = report.write(found, stage / "report.html", partial(_repeat, study, changes))
    for line in told:
        print(line)
    print(f"Table: {folder / 'sweep.parquet'}")
    print(f"Report: {folder / 'report.html'}")


@app.command()
def tune(
    study: StudyArgument,
    output: OutputOption = None,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    dask: DaskOption = None,
    no_code: NoCodeOption = False,
) -> None:
    """Choose gains as a study's tune table says, and show on fresh variants what they are worth.

    Writes STUDY-tuned.toml, the same file with the better values, and report.html, before beside after. The
    same command goes on with a tuning that was ended.
    """
    from cogless.ensemble import search, table, tuned_file
    from cogless.ensemble import tune as tuning
    from cogless.files import writable
    from cogless.report import sweep as report
    from cogless.results.folder import held, new_set
    from cogless.study import TrialStudy
    from cogless.study.reading import changes_from

    table.require()
    search.require()
    loaded = _to_run(study, changes, no_code)
    tuning.subjects(loaded)  # a mistake is told before anything runs
    folder = output or Path("results") / loaded.name
    path = folder / f"{loaded.name}-tuned.toml"
    with writable(folder):
        with _workers(jobs, dask) as workers, _tune_progress() as progress:
            tuned = tuning.tune(loaded, folder, workers, progress)
        chosen = {key: value for one in tuned for key, value in one.chosen.items()}
        about = _command("tune", study, changes, [])
        text = tuned_file.text(loaded, {**changes_from(changes or ()), **chosen}, folder, f"By: {about}")
        both = tuning.side_by_side(loaded, tuned)
        with held(folder), new_set(folder) as stage:
            (stage / path.name).write_text(text, encoding="utf-8")
            table.write(both, stage / "sweep.parquet")
            told = report.write(both, stage / "report.html", lambda settings, pair: "")
    for line in [line for one in tuned for line in tuning.lines(one)] + told:
        print(line)
    print(f"Study: {path}")
    print(f"Report: {folder / 'report.html'}")
    if not isinstance(loaded, TrialStudy):  # short runs don't show all, such as learning that grows slowly
        _print_warnings(_load(str(path), None), [pair for one in tuned for pair in one.subject.pairs])


@app.command()
def design(
    study: StudyArgument,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, in SI units.")] = False,
) -> None:
    """Show every controller's gains, and what follows from them before any run.

    For a study of speed: gains, given or by a tuning rule, the margins of the loop, whether learning settles.

    For a study of trials: gains, given or by LMIs, and the certificate that they work.
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


@app.command()
def export(
    study: StudyArgument,
    controller: ControllerOption,
    to: Annotated[str, typer.Option("--to", metavar="c|fmu", help="What to write.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="DIR", help="For c a new or empty folder, or an earlier export."
        ),
    ],
    scenario: ScenarioOption = None,
    changes: SetOption = None,
) -> None:
    """Write a controller for firmware (c), or for other simulators (fmu).

    c: its constants, the code, a self-test, an example. The folder appears whole or not at all. What the
    self-test repeats is the beginning of the scenario.

    fmu: the controller, and the drive in the scenario as its plant, each for FMI 2.0 and 3.0 (co-simulation),
    built by your C and C++ compilers (CC and CXX).
    """
    if to == "fmu":
        from cogless.export.fmu import write_fmus
        from cogless.export.prepared import first_scenario

        loaded = _load(study, changes)
        with _console(stderr=True).status("Compiling"):
            written = write_fmus(loaded, controller, scenario, output)
        for path in written:
            print(f"FMU: {path}")
        _print_warnings(loaded, [(first_scenario(loaded, controller, scenario), controller)])
        return
    if to != "c":
        raise StudyError(f'--to: "{to}": expected c or fmu')
    from cogless.export.c.command import export_c

    options = ["--controller", controller, "--to", to, *(["--scenario", scenario] if scenario else [])]
    options += ["-o", str(output)]
    command = _command("export", study, changes, options)
    loaded = _load(study, changes)
    subject = export_c(loaded, controller, output, scenario, command)
    print(f"Export: {output / 'README.md'}")
    _print_warnings(loaded, [(subject.scenario, controller)])


@app.command()
def pil(
    study: StudyArgument,
    controller: ControllerOption,
    scenario: ScenarioOption = None,
    ticks: Annotated[
        int,
        typer.Option(
            "--ticks", min=1, metavar="N", help="Current-loop periods, at most those of the scenario."
        ),
    ] = 100_000,
    compiler: Annotated[
        str | None,
        typer.Option("--compiler", metavar="gcc|zig", help="Which one.", show_default="gcc if it is there"),
    ] = None,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Run the exported controller on an emulated Cortex-M4F, closed with the simulated plant.

    Compares every output of every period, and what was learned, with the simulation, bit for bit; counts
    instructions, stack, flash and RAM. Exit code 1 where anything differs.
    """
    from cogless.export.prepared import first_scenario
    from cogless.pil import toolchain
    from cogless.pil.compare import compare
    from cogless.pil.processor import require
    from cogless.pil.table import lines

    if compiler not in (None, "gcc", "zig"):
        raise StudyError(f'--compiler: "{compiler}": expected gcc or zig')
    loaded, tools = _load(study, changes), toolchain.find(compiler)
    require()
    where = first_scenario(loaded, controller, scenario)
    with _share_progress(f"{where}/{controller}") as progress:
        found = compare(loaded, controller, where, ticks, tools, progress)
    if as_json:
        print(json.dumps(dataclasses.asdict(found), indent=2, ensure_ascii=False))
    else:
        for line in lines(found):
            print(line)
    _print_warnings(loaded, [(where, controller)])
    if found.difference is not None:
        sys.exit(DIFFERENT)


@app.command()
def identify(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="LOG...", help="Logs: CSV (gz), NPZ, Parquet, MAT, MDF4, traces.nc."),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option("--config", metavar="FILE", help="TOML: columns, what is known, kinds of logs."),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Where results go.")] = Path(
        "results/identified"
    ),
    plan: Annotated[
        str | None,
        typer.Option(
            "--plan", metavar="STUDY", help="Write the sequence of logs to record for this study's motor."
        ),
    ] = None,
) -> None:
    """Find a motor's inertia, friction, cogging and K_t ripple in its drive's logs.

    Writes motor.toml, study.toml ready to run, an anti-cogging table, and report.html. What the logs cannot
    tell is left out, with a sentence on what to record.
    """
    from cogless.results.folder import held, new_set

    if plan is not None:
        from cogless.identify import plan as planning
        from cogless.identify import rehearsal

        study = _load(plan, None)
        with held(output), new_set(output) as stage:
            planning.write(study, stage)
            with _console(stderr=True).status("Rehearsing") as status:
                expected = rehearsal.expected(stage, lambda what, share: status.update(f"Rehearsing: {what}"))
        print("To be expected, from simulated logs of this motor:")
        for line in expected:
            print(line)
        print(f"Study: {output / 'study.toml'}")
        print(f"Columns: {output / 'id.toml'}")
        return
    if not logs or config is None:
        raise StudyError("identify: expected logs and --config FILE, or --plan STUDY")
    from cogless.identify import command, write
    from cogless.report import identified as report

    with held(output):
        with _console(stderr=True).status("Identifying") as status:
            found = command.identified(
                logs, config, lambda what, share: status.update(f"Identifying: {what}")
            )
        with new_set(output) as stage:
            write.write_all(found.estimate, stage)
            report.write_report(found, stage / "report.html")
    for line in command.lines(found.estimate):
        print(line)
    for line in (*found.estimate.left_out, *found.estimate.remarks):
        print(f"! {line}")
    if "j" in found.estimate.values:
        print(f"Study: {output / 'study.toml'}")
    print(f"Report: {output / 'report.html'}")


@app.command()
def diagnose(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help="Logs: CSV (gz), NPZ, Parquet, MAT, MDF4, traces.nc."),
    ],
    config: Annotated[
        Path, typer.Option("--config", metavar="FILE", help="TOML: columns, what is known, kinds of logs.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Write diagnosis.json and report.html there."),
    ] = None,
) -> None:
    """Say where the ripple in a drive's logs comes from.

    Shares of each order to cogging, K_t ripple, dead time, currents' offset and gain, the encoder and
    mechanics, at each log's speed and load, with how sure that is.
    """
    from cogless.identify import diagnosis

    with _console(stderr=True).status("Diagnosing") as status:
        made = diagnosis.diagnosed(logs, config, lambda what, share: status.update(f"Diagnosing: {what}"))
    for line in diagnosis.lines(made):
        print(line)
    for line in made.said:
        print(f"! {line}")
    if output is not None:
        from cogless.report import diagnosed as report
        from cogless.results.folder import held, new_set

        with held(output), new_set(output) as stage:
            (stage / "diagnosis.json").write_text(
                json.dumps(diagnosis.to_dict(made), indent=2, ensure_ascii=False) + "\n", "utf-8"
            )
            report.write_report(made, stage / "report.html")
        print(f"Report: {output / 'report.html'}")


@app.command("list")
def list_() -> None:
    """List the shipped studies and motors, and the control laws."""
    from cogless.catalogue import show

    show()


@app.command()
def calibrate(
    study: StudyArgument,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    no_code: NoCodeOption = False,
) -> None:
    """Fit parameters of a study to target values of its metrics, as its calibration table says.

    Prints the fitted values as lines for the study, and each target beside what came out. Changes no file.

    Ctrl-C prints the best fit so far.
    """
    from cogless.run.calibrate import calibrate as fit_study
    from cogless.run.calibrate import residual_rows

    loaded = _to_run(study, changes, no_code)
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


def _command(name: str, study: str, changes: list[str] | None, options: list[str]) -> str:
    """The whole command line, quoted for a shell."""
    sets = [word for change in changes or () for word in ("--set", change)]
    return shlex.join(["cogless", name, study, *options, *sets])


@app.command("map")
def map_(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A stored map, or a dump of flash with some in it.")
    ],
    csv: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="Write the newest map's entries, a row each; - prints."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the newest map, alone.")
    ] = None,
    motor: Annotated[
        str | None,
        typer.Option("--motor", metavar="ID", help="What is written is for this motor, such as 0x1F2E3D4C."),
    ] = None,
) -> None:
    """Show learned maps as firmware stores them: whose they are, what is in them, or why they are not valid.

    The newest map is the one that firmware would load. Exit 2 if none is valid.
    """
    from cogless.maps import stored_map
    from cogless.maps.map_table import identity, lines, to_csv

    if motor is not None and output is None:
        raise StudyError("--motor: expected --output too")
    found = stored_map.read(file)
    newest = stored_map.newest(found)
    if newest is None:
        raise StudyError(f"{file}: " + "; ".join(f"at byte {place.offset}: {place.map}" for place in found))
    stored, to_screen = newest.map, str(csv) == "-"
    if csv is not None and not to_screen:
        stored_map.write(csv, to_csv(stored).encode())
    if output is not None:
        wanted = stored.motor if motor is None else identity(motor)
        stored_map.write(output, bytes(dataclasses.replace(stored, motor=wanted)))
    print(to_csv(stored) if to_screen else "\n".join(lines(found, newest)), end="" if to_screen else "\n")


@contextmanager
def _workers(jobs: int, dask: str | None) -> Iterator[Workers]:
    """Processes of this machine, or the workers of a Dask cluster."""
    from cogless.ensemble import executors

    if dask is None:
        with executors.processes(jobs) as workers:
            yield workers
    else:
        with executors.dask(dask) as workers:
            yield workers


def _shard(text: str | None) -> Shard:
    """The part that --shard names; without it the whole."""
    from cogless.ensemble.sweep import Shard

    index, _, of = (text or "1/1").partition("/")
    if not (index.isdigit() and of.isdigit() and 1 <= int(index) <= int(of)):
        raise StudyError(f'--shard: "{text}": expected I/N, such as 3/20, with I from 1 to N')
    return Shard(int(index) - 1, int(of))


def _repeat(study: str, changes: list[str] | None, own: list[str], pair: tuple[str, str]) -> str:
    """The command that repeats a run of a sweep."""
    return _command("run", study, [*(changes or ()), *own], ["--only", "/".join(pair)])


def _load(study: str, changes: list[str] | None) -> AnyStudy:
    from cogless.design.auto import load
    from cogless.study.reading import changes_from

    return load(study, changes_from(changes or ()))


def _to_run(study: str, changes: list[str] | None, no_code: bool) -> AnyStudy:
    """The study, whose own code is named before any of it runs."""
    loaded = _load(study, changes)
    path = loaded.source.path
    _name_code(path, "controller", loaded.controller, no_code, lambda code: str(path.parent / code))
    return loaded


def _name_code(
    path: Path, table: str, laws: Mapping[str, Any], no_code: bool, found: Callable[[str], str]
) -> None:
    """Say which files' code these laws run, or refuse it. `found`: where a file that a law names is."""
    from cogless.study.controller import LibraryLaw, PythonLaw

    for name, law in laws.items():
        if isinstance(law, PythonLaw | LibraryLaw):
            if no_code:
                where = f'{path}: {table}.{name}.law: "{law.law}"'
                raise StudyError(f"{where}: expected no code of the file's own, with --no-code")
            print(f"Code: {table}.{name} runs {found(law.code)}.")


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


def _run_arena(arena: Arena, folder: Path, only: list[str] | None, jobs: int) -> None:
    from cogless.ensemble import arena_files
    from cogless.ensemble.arena import chosen, run_arena
    from cogless.results.folder import held, new_set

    plants = len(chosen(arena, only))
    with held(folder):
        with _bar() as bar:
            task = bar.add_task("", total=plants)
            results = run_arena(
                arena, only, lambda name, done: bar.update(task, completed=done, description=name), jobs
            )
        with new_set(folder) as stage:
            arena_files.write(results, stage / "results.json")
    _console().print(arena_files.table(results))
    for (plant, law), why in results.absent.items():
        say(f"Absent: {law} on {plant}: {why}")
    print(f"Results: {folder / 'results.json'}")


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
        map_files.write_all(results, stage / "maps")
        if plots:
            report.write_plots(results, stage)
        results_json.write(results, stage / "results.json", hashes(stage))


def _print_tables(results: AnyResults) -> None:
    from rich.table import Table
    from rich.text import Text

    from cogless import report
    from cogless.report.comparison import remarks

    study, console = results.study, _console()
    for scenario in results.scenarios:
        controllers = [run.controller for run in results.runs if run.scenario == scenario]
        table = Table(
            title=Text(scenario), title_justify="left", title_style="bold", box=None, pad_edge=False
        )
        table.add_column("")
        for name in controllers:
            table.add_column(Text(study.label(name)), justify="right")
        lines = report.lines(results, scenario)
        for line in lines:
            cells = [_cell(line, name, study.baseline) for name in controllers]
            table.add_row(Text(f"{line.title} [{line.unit}]" if line.unit else line.title), *cells)
        console.print(table)
        for remark in remarks(study, lines):
            console.print(f"! {remark}", highlight=False, markup=False)
        broken = report.broken(results, scenario)
        if broken is not None:
            console.print(broken, highlight=False, markup=False)
        console.print()
    shown = {run.controller for run in results.runs}
    if len(shown) > 1:  # with one controller there are no marks to explain
        ratio = f"; (x) times the value of {study.label(study.baseline)}" if study.baseline in shown else ""
        console.print(f"* best{ratio}", highlight=False, markup=False)


def _print_warnings(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> None:
    """Print the design's warnings about the controllers of these runs (scenario, name), each line once."""
    from cogless.design.warnings import warnings

    of_each = {name: scenario for scenario, name in runs}
    for line in dict.fromkeys(line for name, at in of_each.items() for line in warnings(study, at, name)):
        say(f"Warning: {line}.")


def _cell(line: Line, controller: str, baseline: str) -> Text:
    """A table cell: value, ratio to the baseline, and a mark (* is best, ! failed to hold the speed)."""
    from rich.text import Text

    from cogless.report.packing import number

    text, ratio = line.number(controller) or "-", line.ratio(controller, baseline)
    if ratio is not None and controller != baseline:
        text += f" ({number(ratio)}x)"
    mark = "*" if controller in line.best else "!" if controller in line.missed else " "
    return Text(f"{text} {mark}", style="bold" if mark == "*" else "")


@contextmanager
def _run_progress(runs: int) -> Iterator[StudyProgress]:
    """Show the progress of all runs on stderr if it is a terminal; yield the function that reports it."""
    with _bar() as bar:
        task = bar.add_task("", total=runs)
        shares: dict[tuple[str, str], float] = {}

        def report(scenario: str, controller: str, share: float) -> None:
            shares[scenario, controller] = share
            bar.update(task, completed=sum(list(shares.values())), description=f"{scenario}/{controller}")

        yield report


@contextmanager
def _variant_progress(variants: int) -> Iterator[Callable[[int], None]]:
    """Show finished variants and the time left on stderr if it is a terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    with _bar(BarColumn(), MofNCompleteColumn(), TextColumn("variants, left"), TimeRemainingColumn()) as bar:
        task = bar.add_task("", total=variants)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def _tune_progress() -> Iterator[Callable[[str, int, int, float], None]]:
    """Show what is tuned, how far it is, and the best value so far on stderr if it is a terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    about = TextColumn("{task.description}")
    with _bar(about, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        tasks: dict[str, Any] = {}

        def report(name: str, tried: int, budget: int, best: float) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task("", total=budget)
            bar.update(tasks[name], completed=tried, description=f"{name}: {100 * best:.3g} % of the start")

        yield report


@contextmanager
def _share_progress(what: str) -> Iterator[Callable[[float], None]]:
    """Show the progress of one task on stderr if it is a terminal; yield the function that takes its
    share."""
    with _bar() as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _bar(*columns: ProgressColumn) -> Progress:
    """A progress bar on stderr, hidden if that is no terminal; columns: by default text, bar and time."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = _console(stderr=True)
    columns = columns or (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _console(**options: Any) -> Console:
    from rich.console import Console

    console = Console(**options)
    return console if console.is_terminal else Console(width=WIDE, **options)
