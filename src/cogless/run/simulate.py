"""Run a study on the native engine: one controller in one scenario, or all of them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from itertools import islice
from threading import Event
from typing import Any, overload

import numpy as np

from cogless.design.from_study import Designs, design_study
from cogless.errors import StudyError
from cogless.maps import learned_map
from cogless.results import AnyResults, Results, Run, TrialResults
from cogless.results.fault_response import faults_in, responses
from cogless.results.metrics import Conditions, Value, evaluate, result_name
from cogless.results.trace import Trace
from cogless.run.advance import Progress, Stopped, advance, failures, trace_of
from cogless.run.plan import Plan, plan
from cogless.run.side_by_side import side_by_side
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.controller import OwnLaw

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
    designs = _prepare(study, [(scenario, controller)])
    return _run(study, designs, scenario, controller, progress or (lambda share: None), Event())


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

    def one(study: AnyStudy, designs: Designs, scenario: str, controller: str) -> Run:
        def report(share: float) -> None:
            if progress is not None:
                progress(scenario, controller, share)

        run = _run(study, designs, scenario, controller, report, stop)
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
    """Do first what all these runs need: the designs of trials, and each user's controller once.

    So a missing file or class is found before the first run.
    """
    for controller, scenario in {controller: scenario for scenario, controller in reversed(runs)}.items():
        if isinstance(study.controller[controller], OwnLaw):
            plan(study, scenario, controller)
    return design_study(study, runs) if isinstance(study, TrialStudy) else {}


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


def measure(study: AnyStudy, scenario: str, trace: Trace) -> dict[str, Value]:
    """The scenario's metrics on a trace, SI, by name in results.json; without those whose signal it lacks."""
    conditions = Conditions.of(study, scenario)
    return {
        result_name(metric): evaluate(metric, trace, conditions)
        for metric in study.metrics_in(scenario)
        if metric.signal is None or metric.signal in trace
    }


def _run(
    study: AnyStudy, designs: Designs, scenario: str, controller: str, progress: Progress, stop: Event
) -> Run:
    with failures(study, scenario, controller):
        planned = plan(study, scenario, controller, stop, designs.get((scenario, controller)))
        return _made(planned, progress, stop)


def _made(planned: Plan, progress: Progress, stop: Event) -> Run:
    study, scenario, controller = planned.study, planned.scenario, planned.controller
    drive, state = planned.drive, planned.start()
    recorder = planned.engine.Recorder(drive, planned.decimation, planned.ticks // planned.decimation + 1)
    with failures(study, scenario, controller, lambda: planned.when(state.tick)):
        advance(drive, state, recorder, planned.ticks, progress, stop)
    trace = trace_of(drive, recorder)
    rows, motion = trace, 0
    if isinstance(study, TrialStudy):
        # metrics are taken on the samples of the trial, whatever rows there are between
        rows = replace(trace, data=trace.data[:: planned.divider // planned.decimation])
        # the reference that it was learned for is that of the last phase
        motion = learned_map.motion_identity(
            study.reference(scenario, study.scenario[scenario].phases[-1][1])
        )
    try:
        metrics = measure(study, scenario, rows)
    except StudyError as error:
        where = f"{study.source.path}: controller.{controller}: scenario {scenario}"
        raise StudyError(f"{where}: {error}") from error
    learned, stored = _memory(drive, state), learned_map.of_run(study, drive.stored(state), motion)
    if isinstance(study, TrialStudy):
        return Run(scenario, controller, trace, learned, metrics, planned.design, map=stored)
    law, limit = study.controller[controller], for_scenario(study, scenario).drive.current_loop.current_limit
    quality = dict(drive.quality(state))
    if not law.learns:
        quality = {key: quality[key] for key in ("known", "residual")}
    broken = responses(faults_in(study, scenario), trace, limit, law.learns)
    return Run(scenario, controller, trace, learned, metrics, quality=quality, faults=broken, map=stored)


def _memory(drive: Any, state: Any) -> dict[str, Any]:
    """The learned maps over their angle, rad of its frame, or what is learned of a trial; empty without.

    A space-learning law has its "period" too, rad of that angle, and "beta" and "h" as far as it learns them.
    """
    memory = dict(drive.memory(state))
    if "learned" in memory:
        memory["learned"] = np.asarray(memory["learned"])
    elif memory:
        cells = len(memory["current"])
        memory["angle"] = memory.get("period", 2 * math.pi) / cells * np.arange(cells)
        for name in ("current", "beta", "h"):
            if name in memory:
                memory[name] = np.asarray(memory[name])
    return memory


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
