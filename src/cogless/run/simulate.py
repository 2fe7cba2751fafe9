"""Run a study on the native engine: one controller in one scenario, or all of them."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from fnmatch import fnmatchcase
from functools import partial
from importlib import import_module
from itertools import islice
from threading import Event
from typing import Any, overload

from cogless.errors import StudyError
from cogless.maps import learned_map
from cogless.results import AnyResults, Results, Run, TrialResults
from cogless.results.fault_response import faults_in, responses
from cogless.results.metrics import Conditions, Value, evaluate, result_name
from cogless.results.status import Status
from cogless.results.trace import Trace
from cogless.run.advance import ENGINES, Progress, Runner, Stopped, advance, failures, trace_of
from cogless.run.drive_config import Mode, engine_config
from cogless.run.own_law import make_law
from cogless.run.side_by_side import side_by_side
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.controller import AntiCogging, OwnLaw

StudyProgress = Callable[[str, str, float], None]


class RunError(StudyError):
    """A run that could not be finished: its controller returned NaN, say. The others are kept.

    `results`: the finished runs of the first study that has such a run. `all_results`: those of every study
    of a rollout, in its order; those that lack a run have `interrupted` set.
    """

    def __init__(self, message: str, results: AnyResults, all_results: Sequence[AnyResults]) -> None:
        super().__init__(message)
        self.results = results
        self.all_results = list(all_results)


def simulate(study: AnyStudy, scenario: str, controller: str, progress: Progress | None = None) -> Run:
    """Run one controller in one scenario and take its metrics.

    `progress` is called with the finished share, 0 to 1, about ten times a second. An anti-cogging table is
    learned first, in a commissioning run of its own. StudyError: an unknown name, a controller that fails.
    """
    _known(study, scenario, controller)
    run = _runner(study, [(scenario, controller)])
    return run(scenario, controller, progress or (lambda share: None), Event())


@overload
def run_study(
    study: Study, only: Sequence[str] | None = ..., progress: StudyProgress | None = ..., jobs: int = ...
) -> Results: ...
@overload
def run_study(
    study: AnyStudy, only: Sequence[str] | None = ..., progress: StudyProgress | None = ..., jobs: int = ...
) -> AnyResults: ...
def run_study(
    study: AnyStudy, only: Sequence[str] | None = None, progress: StudyProgress | None = None, jobs: int = 1
) -> AnyResults:
    """Run every controller in every scenario, or what `only` names: SCENARIO/CONTROLLER, with * and ?.

    Ctrl-C ends it early: the finished runs are returned, with `interrupted` set. RunError: some run could
    not be finished; the others are.
    """
    (results,) = _rollout([study], only, progress, jobs, keep_traces=True)
    return results


def rollout(
    studies: Sequence[AnyStudy],
    only: Sequence[str] | None = None,
    jobs: int | None = None,
    *,
    keep_traces: bool = True,
) -> list[AnyResults]:
    """Run many studies, such as variations of one, side by side on threads; results in their order.

    `jobs`: runs at a time, default one a core. Without `keep_traces` each run's trace is let go, empty, once
    its metrics are taken, so that thousands fit into memory. Ctrl-C as in run_study. RunError: some run
    could not be finished; all the others are, and in its `all_results`.
    """
    return _rollout(studies, only, None, jobs or os.cpu_count() or 1, keep_traces)


def _rollout(
    studies: Sequence[AnyStudy],
    only: Sequence[str] | None,
    progress: StudyProgress | None,
    jobs: int,
    keep_traces: bool,
) -> list[AnyResults]:
    stop = Event()

    def one(runner: Runner, scenario: str, controller: str) -> Run:
        def report(share: float) -> None:
            if progress is not None:
                progress(scenario, controller, share)

        run = runner(scenario, controller, report, stop)
        if keep_traces:
            return run
        return dataclasses.replace(run, trace=dataclasses.replace(run.trace, data=run.trace.data[:0].copy()))

    pairs = [runs_of(study, only) for study in studies]
    runners = [_runner(study, of_study) for study, of_study in zip(studies, pairs, strict=True)]
    tasks = [
        partial(one, runner, *pair)
        for runner, of_study in zip(runners, pairs, strict=True)
        for pair in of_study
    ]
    futures = iter(side_by_side(tasks, jobs, stop))
    return _collected(studies, [list(islice(futures, len(of_study))) for of_study in pairs], stop.is_set())


def _runner(study: AnyStudy, runs: Sequence[tuple[str, str]]) -> Runner:
    """A function that runs a controller of this study in a scenario; does first what all these runs need."""
    if isinstance(study, TrialStudy):
        from cogless.run.trials import runner

        return runner(study, runs)
    _try_laws(study, runs)
    return partial(_simulate, study)


def _try_laws(study: Study, runs: Sequence[tuple[str, str]]) -> None:
    """Make each user's controller once, so that a missing file or class is found before the first run."""
    engine = import_module(ENGINES[study.drive.precision])
    for controller, scenario in {controller: scenario for scenario, controller in reversed(runs)}.items():
        if isinstance(study.controller[controller], OwnLaw):
            _drive(engine, study, scenario, controller, "run")


def runs_of(study: AnyStudy, only: Sequence[str] | None = None) -> list[tuple[str, str]]:
    """(scenario, controller) of each run that is asked for, in the study's order."""
    runs = [(scenario, name) for scenario in study.scenario for name in study.controllers_in(scenario)]
    if not only:
        return runs
    for pattern in only:
        if not any(fnmatchcase("/".join(run), pattern) for run in runs):
            known = ", ".join("/".join(run) for run in runs)
            raise StudyError(
                f'{study.source.path}: --only: "{pattern}": expected SCENARIO/CONTROLLER of {known}'
            )
    return [run for run in runs if any(fnmatchcase("/".join(run), pattern) for pattern in only)]


def measure(study: Study, scenario: str, trace: Trace) -> dict[str, Value]:
    """The scenario's metrics on a trace, SI, by name in results.json; without those whose signal it lacks."""
    conditions = Conditions.of(study, scenario)
    return {
        result_name(metric): evaluate(metric, trace, conditions)
        for metric in study.metrics_in(scenario)
        if metric.signal is None or metric.signal in trace
    }


def _simulate(study: Study, scenario: str, controller: str, progress: Progress, stop: Event) -> Run:
    with failures(study, scenario, controller):
        return _run(study, scenario, controller, progress, stop)


def _run(study: Study, scenario: str, controller: str, progress: Progress, stop: Event) -> Run:
    study_here = for_scenario(study, scenario)
    rates = study_here.drive.rates
    decimation = round(rates.current_loop / study_here.trace_rate)
    engine, drive, ticks, table, _ = drive_of(study, scenario, controller, stop)
    state = drive.start()
    if len(table):
        drive.load_memory(state, table)
    recorder = engine.Recorder(drive, decimation, ticks // decimation + 1)
    with failures(study, scenario, controller, lambda: f" at {state.tick / rates.current_loop:.6g} s"):
        advance(drive, state, recorder, ticks, progress, stop)
    trace = trace_of(drive, recorder)
    try:
        metrics = measure(study, scenario, trace)
    except StudyError as error:
        where = f"{study.source.path}: controller.{controller}: scenario {scenario}"
        raise StudyError(f"{where}: {error}") from error
    quality = dict(drive.quality(state))
    law = study_here.controller[controller]
    limit = study_here.drive.current_loop.current_limit
    broken = responses(faults_in(study, scenario), trace, limit, law.learns)
    if not law.learns:
        quality = {key: quality[key] for key in ("known", "residual")}
    stored = drive.stored(state)
    memory = learned_map.memory_of(study_here, law, stored)
    kept = learned_map.of_run(study, stored)
    return Run(scenario, controller, trace, memory, metrics, quality=quality, faults=broken, map=kept)


def drive_of(
    study: Study, scenario: str, controller: str, stop: Event
) -> tuple[Any, Any, int, Any, dict[str, Any]]:
    """The engine's module, the drive, its ticks, the table that it starts with, A, or none: [], and the
    engine's description.

    An anti-cogging table is learned here, in a commissioning run of its own.
    """
    engine = import_module(ENGINES[study.drive.precision])
    study_here = for_scenario(study, scenario)
    ticks = round(study_here.scenario[scenario].duration * study_here.drive.rates.current_loop)
    table: Any = []
    if isinstance(study_here.controller[controller], AntiCogging):
        table = _commission(engine, study, scenario, controller, stop)
    drive, config = _drive(engine, study, scenario, controller, "run")
    return engine, drive, ticks, table, config


def _drive(
    engine: Any, study: Study, scenario: str, controller: str, mode: Mode
) -> tuple[Any, dict[str, Any]]:
    law = make_law(study, controller)
    try:
        config = engine_config(study, scenario, controller, mode)
        return engine.Drive(config, law), config
    except (ValueError, RuntimeError) as error:
        raise StudyError(
            f"{study.source.path}: controller.{controller}: scenario {scenario}: {error}"
        ) from error


def _commission(engine: Any, study: Study, scenario: str, controller: str, stop: Event) -> Any:
    """The table that a slow run in both directions learns, A; StudyError if it takes three times its time."""
    law = study.controller[controller]
    assert isinstance(law, AntiCogging)
    study_here = for_scenario(study, scenario)
    drive, _ = _drive(engine, study, scenario, controller, "learn")
    state = drive.start()
    expected = law.calibration.duration
    rates = study_here.drive.rates
    divider = round(rates.current_loop / rates.speed_loop)
    piece = divider * math.ceil(rates.speed_loop)  # 1 s

    def when() -> str:
        return f", commissioning run, at {state.tick / rates.current_loop:.6g} s"

    while state.tick < 3 * expected * rates.current_loop:
        recorder = engine.Recorder(drive, divider)
        with failures(study, scenario, controller, when):
            advance(drive, state, recorder, piece, lambda share: None, stop)
        if not int(trace_of(drive, recorder)["status"][-1]) & Status.BUSY:
            return drive.law_memory(state).tolist()
    line = f"{study.source.path}: controller.{controller}.calibration: scenario {scenario}"
    raise StudyError(f"{line}: not done after {3 * expected:.3g} s: expected kp and ki that hold its speed")


def _collected(
    studies: Sequence[AnyStudy], futures: Sequence[Sequence[Future[Run]]], stopped: bool
) -> list[AnyResults]:
    results: list[AnyResults] = []
    failures: list[StudyError] = []
    failed: list[AnyResults] = []
    for study, of_study in zip(studies, futures, strict=True):
        finished, before = [], len(failures)
        for future in of_study:
            if not future.done():  # Ctrl-C
                continue
            error = future.exception()
            if error is None:
                finished.append(future.result())
            elif isinstance(error, StudyError):
                failures.append(error)
            elif not isinstance(error, Stopped):
                raise error
        fails = len(failures) > before
        interrupted = stopped or fails
        if isinstance(study, TrialStudy):
            results.append(TrialResults(study, finished, interrupted))
        else:
            results.append(Results(study, finished, interrupted))
        failed += results[-1:] if fails else []
    if failures:
        more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
        raise RunError(f"{failures[0]}{more}", failed[0], results)
    return results


def _known(study: AnyStudy, scenario: str, controller: str) -> None:
    for table, name, known in (
        ("scenario", scenario, study.scenario),
        ("controller", controller, study.controller),
    ):
        if name not in known:
            raise StudyError(f'{study.source.path}: {table}: "{name}": expected one of {", ".join(known)}')
