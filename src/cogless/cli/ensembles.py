"""`sweep` and `tune`: run a study in many variants."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from cogless.cli.options import (
    CORES,
    DaskOption,
    JobsOption,
    NoCodeOption,
    OnlyOption,
    OutputOption,
    SetOption,
    StudyArgument,
    command_line,
    load,
    results_folder,
    to_run,
)
from cogless.cli.printed import print_uncertified
from cogless.cli.terminal import tune_progress, variant_progress
from cogless.errors import StudyError
from cogless.lines import print_text

if TYPE_CHECKING:
    from cogless.ensemble.sweep import Shard
    from cogless.ensemble.workers import Workers


def sweep(
    study: StudyArgument,
    count: Annotated[int, typer.Option("-n", min=1, metavar="N", help="Number of random variants.")] = 1000,
    output: OutputOption = None,
    only: OnlyOption = None,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    dask: DaskOption = None,
    shard: Annotated[
        str | None,
        typer.Option(
            "--shard",
            metavar="I/N",
            help="Run only part I of N parts of the variants, such as 3/20 in a job array.",
        ),
    ] = None,
    merge: Annotated[
        bool,
        typer.Option(
            "--merge", help="Combine the results of all --shard parts, which are in the output directory."
        ),
    ] = False,
    no_code: NoCodeOption = False,
) -> None:
    """Run random variants of a study. Show how much each metric varies, and which varied values cause this.

    The table `vary` of the study names the values that vary.

    Writes sweep.parquet, with a row for each run, and report.html. If you repeat the command, it
    continues where it stopped. A larger -n adds variants.
    """
    from cogless.ensemble import sweep as sweeping
    from cogless.ensemble import sweep_table
    from cogless.files import writable
    from cogless.report import sweep_report as report
    from cogless.results.folder import check_names, locked_folder, new_set

    sweep_table.require("sweep")
    part = _shard(shard)
    loaded = to_run(study, changes, no_code)
    folder = output or results_folder(loaded.source.path)
    planned = sweeping.plan(loaded, count, only)
    with writable(folder):
        check_names(folder, ["sweep.parquet", "report.html", part.file])
        if merge:
            finished: sweep_table.Sweep | None = sweeping.merge(planned, folder)
        else:
            variant_count = planned.variants(part)
            with _workers(jobs, dask) as workers, variant_progress(variant_count) as progress:
                finished = sweeping.run(planned, folder, workers, part, progress)
        if finished is None:
            print(f"Shard: {folder / part.file}")
            return
        with locked_folder(folder), new_set(folder) as stage:
            sweep_table.write(finished, stage / "sweep.parquet")
            remarks = report.write(finished, stage / "report.html", partial(_repeat, study, changes))
    for line in remarks:
        print_text(line)
    print(f"Table: {folder / 'sweep.parquet'}")
    print(f"Report: {folder / 'report.html'}")


def tune(
    study: StudyArgument,
    output: OutputOption = None,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    dask: DaskOption = None,
    no_code: NoCodeOption = False,
) -> None:
    """Search the gains with which a metric is best, and check these gains on new variants of the study.

    The table `tune` of the study names the gains and the metric. Writes STUDY-tuned.toml, a copy of the study
    with the better gains, and report.html, which compares them with the gains before. If you repeat the
    command, it continues where it stopped.
    """
    from cogless.ensemble import search, sweep_table
    from cogless.ensemble import tune as tuning
    from cogless.files import writable
    from cogless.report import sweep_report as report
    from cogless.results.folder import check_names, locked_folder, new_set
    from cogless.study.reading import changes_from

    sweep_table.require("tune")
    search.require()
    loaded = to_run(study, changes, no_code)
    journals = map(tuning.journal_name, tuning.subjects(loaded))  # checks [tune] before any run
    folder = output or results_folder(loaded.source.path)
    path = folder / f"{loaded.name}-tuned.toml"
    with writable(folder):
        check_names(folder, [path.name, "sweep.parquet", "report.html", *journals])
        with _workers(jobs, dask) as workers, tune_progress() as progress:
            tuned = tuning.tune(loaded, folder, workers, progress)
        chosen = {key: value for one in tuned for key, value in one.chosen.items()}
        command = command_line("tune", study, changes, [])
        text = search.study_file_text(
            loaded, {**changes_from(changes or ()), **chosen}, folder, f"By: {command}"
        )
        comparison = tuning.side_by_side(loaded, tuned)
        with locked_folder(folder), new_set(folder) as stage:
            (stage / path.name).write_text(text, encoding="utf-8")
            sweep_table.write(comparison, stage / "sweep.parquet")
            remarks = report.write(comparison, stage / "report.html", lambda settings, pair: "")
    for line in [line for one in tuned for line in tuning.outcome_lines(one)] + remarks:
        print_text(line)
    print(f"Study: {path}")
    print(f"Report: {folder / 'report.html'}")
    # Warnings, since short runs don't show everything, such as learning that grows slowly.
    print_uncertified(load(str(path), None), [pair for one in tuned for pair in one.subject.pairs])


@contextmanager
def _workers(jobs: int, dask: str | None) -> Iterator[Workers]:
    """Yield the processes of this machine, or the workers of the Dask cluster at the address `dask`."""
    from cogless.ensemble import workers as executing

    if dask is None:
        with executing.processes(jobs) as workers:
            yield workers
    else:
        with executing.dask(dask) as workers:
            yield workers


def _shard(text: str | None) -> Shard:
    """The part of the sweep that --shard names; the whole sweep without this option."""
    from cogless.ensemble.sweep import SHARD_NUMBER, Shard

    index, _, of = (text or "1/1").partition("/")
    if not (SHARD_NUMBER.fullmatch(index) and SHARD_NUMBER.fullmatch(of) and int(index) <= int(of)):
        raise StudyError(f'--shard: "{text}": expected I/N, such as 3/20, with I from 1 to N')
    return Shard(int(index) - 1, int(of))


def _repeat(study: str, changes: list[str] | None, own: list[str], pair: tuple[str, str]) -> str:
    """The command that repeats a run of a sweep."""
    return command_line("run", study, [*(changes or ()), *own], ["--only", "/".join(pair)])
