"""Run a study on the native engine: one controller in one scenario, or all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from itertools import islice
from pathlib import Path
from threading import Event
from typing import overload

from cogless.design.from_study import Designs, design_study
from cogless.errors import StudyError
from cogless.maps import learned_map
from cogless.results import AnyResults, Results, Run, TrialResults
from cogless.results.fault_response import faults_in, responses
from cogless.results.metrics import Conditions, Value, evaluate, result_name
from cogless.results.trace import Trace
from cogless.results.trace_files import TraceRoom
from cogless.run.advance import Progress, Stopped, advance, failures, trace_of
from cogless.run.plan import Plan, plan
from cogless.run.side_by_side import side_by_side
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.controller import OwnLaw

StudyProgress = Callable[[str, str, float], None]


class RunError(StudyError):
    """A run that failed, for example because its controller returned NaN. The other runs are kept.

    `results`: finished runs of the first study with a failed run. `all_results`: finished runs of every study
    of a rollout, in its order; studies that lack a run have `interrupted` set.
    """

    def __init__(self, message: str, results: AnyResults, all_results: Sequence[AnyResults]) -> None:
        super().__init__(message)
        self.results = results
        self.all_results = list(all_results)


def simulate(study: AnyStudy, scenario: str, controller: str, progress: Progress | None = None) -> Run:
    """Run one controller in one scenario and compute its metrics.

    `progress` is called with the finished share, 0 to 1, about ten times a second. An anti-cogging table is
    learned first, in a separate commissioning run. StudyError: an unknown name, a controller that fails.
    """
    _known(study, scenario, controller)
    designs = _prepare(study, [(scenario, controller)])
    return _run(study, designs, scenario, controller, progress or (lambda share: None), Event())


@overload
def run_study(
    study: Study,
    only: Sequence[str] | None = ...,
    progress: StudyProgress | None = ...,
    jobs: int = ...,
    traces: Path | None = ...,
) -> Results: ...
@overload
def run_study(
    study: AnyStudy,
    only: Sequence[str] | None = ...,
    progress: StudyProgress | None = ...,
    jobs: int = ...,
    traces: Path | None = ...,
) -> AnyResults: ...
def run_study(
    study: AnyStudy,
    only: Sequence[str] | None = None,
    progress: StudyProgress | None = None,
    jobs: int = 1,
    traces: Path | None = None,
) -> AnyResults:
    """Run every controller in every scenario, or only the runs that match `only`.

    `only`: patterns SCENARIO/CONTROLLER, with * and ?. `traces`: a folder with room for traces that are too
    long for memory: they are in files without names there. Ctrl-C ends it early: finished runs are returned,
    with `interrupted` set. RunError: a run failed; all others are finished.
    """
    room = TraceRoom(traces) if traces is not None else None
    (results,) = _rollout([study], only, progress, jobs, keep_traces=True, room=room)
    return results


def rollout(
    studies: Sequence[AnyStudy],
    only: Sequence[str] | None = None,
    jobs: int | None = None,
    *,
    keep_traces: bool = True,
) -> list[AnyResults]:
    """Run many studies, such as variations of one, in parallel threads; return results in their order.

    `jobs`: number of runs at a time, default one per core. Without `keep_traces`, each run's trace is emptied
    once its metrics are computed, so that thousands of runs fit into memory. Ctrl-C as in run_study.
    RunError: a run failed; all others are finished, and in its `all_results`.
    """
    return _rollout(studies, only, None, jobs or os.cpu_count() or 1, keep_traces)


def _rollout(
    studies: Sequence[AnyStudy],
    only: Sequence[str] | None,
    progress: StudyProgress | None,
    jobs: int,
    keep_traces: bool,
    room: TraceRoom | None = None,
) -> list[AnyResults]:
    stop = Event()

    def one(study: AnyStudy, designs: Designs, scenario: str, controller: str) -> Run:
        def report(share: float) -> None:
            if progress is not None:
                progress(scenario, controller, share)

        run = _run(study, designs, scenario, controller, report, stop, room)
        if keep_traces:
            return run
        return replace(run, trace=replace(run.trace, data=run.trace.data[:0].copy()))

    pairs = [runs_of(study, only) for study in studies]
    prepared = [_prepare(study, of_study) for study, of_study in zip(studies, pairs, strict=True)]
    tasks = [
        partial(one, study, designs, *pair)
        for study, designs, of_study in zip(studies, prepared, pairs, strict=True)
        for pair in of_study
    ]
    futures = iter(side_by_side(tasks, jobs, stop))
    return _collected(studies, [list(islice(futures, len(of_study))) for of_study in pairs], stop.is_set())


def _prepare(study: AnyStudy, runs: Sequence[tuple[str, str]]) -> Designs:
    """Compute the designs for these runs of trials, and load each user's controller once.

    So a missing file or class is found before the first run.
    """
    for controller, scenario in {controller: scenario for scenario, controller in reversed(runs)}.items():
        if isinstance(study.controller[controller], OwnLaw):
            plan(study, scenario, controller)
    return design_study(study, runs) if isinstance(study, TrialStudy) else {}


def runs_of(study: AnyStudy, only: Sequence[str] | None = None) -> list[tuple[str, str]]:
    """Pairs (scenario, controller) of the runs that match `only`, or of all runs, in the study's order."""
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


def measure(study: AnyStudy, scenario: str, trace: Trace) -> dict[str, Value]:
    """Compute a scenario's metrics from a trace: SI values by their name in results.json.

    Metrics whose signal the trace lacks are left out.
    """
    conditions = Conditions.of(study, scenario)
    return {
        result_name(metric): evaluate(metric, trace, conditions)
        for metric in study.metrics_in(scenario)
        if metric.signal is None or metric.signal in trace
    }


def _run(
    study: AnyStudy,
    designs: Designs,
    scenario: str,
    controller: str,
    progress: Progress,
    stop: Event,
    room: TraceRoom | None = None,
) -> Run:
    with failures(study, scenario, controller):
        planned = plan(study, scenario, controller, stop, designs.get((scenario, controller)))
        return _carried_out(planned, progress, stop, room)


def _carried_out(planned: Plan, progress: Progress, stop: Event, room: TraceRoom | None) -> Run:
    study, scenario, controller = planned.study, planned.scenario, planned.controller
    drive, state = planned.drive, planned.start()
    count = -(-planned.ticks // planned.decimation)
    file = room.file(drive.signals, count) if room is not None else None
    recorder = planned.engine.Recorder(drive, planned.decimation, 0 if file else count)

    def after_a_piece(share: float) -> None:
        if file is not None:
            file.append(recorder.take())
        progress(share)

    with failures(study, scenario, controller, lambda: planned.when(state.tick)):
        advance(drive, state, recorder, planned.ticks, after_a_piece, stop)
    trace = trace_of(drive, recorder) if file is None else file.trace()
    rows, motion = trace, 0
    if isinstance(study, TrialStudy):
        # metrics use one row per sample of the trial, without the rows in between
        rows = replace(trace, data=trace.data[:: planned.divider // planned.decimation])
        # the map is stored with the last phase's reference, for which it was learned
        motion = learned_map.motion_identity(
            study.reference(scenario, study.scenario[scenario].phases[-1][1])
        )
    try:
        metrics = measure(study, scenario, rows)
    except StudyError as error:
        where = f"{study.source.path}: controller.{controller}: scenario {scenario}"
        raise StudyError(f"{where}: {error}") from error
    law, learned = study.controller[controller], drive.stored(state)
    memory = learned_map.memory_of(study, scenario, controller, learned)
    stored = learned_map.of_run(study, learned, motion)
    if isinstance(study, TrialStudy):
        return Run(scenario, controller, trace, memory, metrics, planned.design, map=stored)
    limit = for_scenario(study, scenario).drive.current_loop.current_limit
    quality = dict(drive.quality(state))
    if not law.learns:
        quality = {key: quality[key] for key in ("known", "residual")}
    broken = responses(faults_in(study, scenario), trace, limit, law.learns)
    return Run(scenario, controller, trace, memory, metrics, quality=quality, faults=broken, map=stored)


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
