"""Run a study on the native engine: one controller in one scenario, or all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from threading import Event
from typing import overload

from cogless.design.kinds import DESIGNS
from cogless.design.trials.from_study import Designs
from cogless.design.trials.from_study import Pair as Pair
from cogless.errors import StudyError
from cogless.results import AnyResults, Results, Run
from cogless.results.runs import RESULTS
from cogless.results.trace import TraceRoom
from cogless.run.carry_out import carried_out, carried_out_together
from cogless.run.run_plan import Plan, RunProgress, Stopped, learning_off_plan, memory_enough, plan
from cogless.run.side_by_side import side_by_side
from cogless.study import AnyStudy, Study
from cogless.study.table import perhaps

StudyProgress = Callable[[str, str, float], None]
Finished = Callable[[AnyStudy, Run], None]


class RunError(StudyError):
    """A run that failed, for example because its controller returned NaN. The other runs are kept.

    `results`: finished runs of the first study with a failed run. `all_results`: finished runs of every study
    of a rollout, in the order of the studies; a study that lacks a run has `interrupted` set. `all_errors`:
    for every study of a rollout, why runs failed, by scenario and controller.
    """

    def __init__(
        self,
        message: str,
        results: AnyResults,
        all_results: Sequence[AnyResults],
        all_errors: Sequence[Mapping[Pair, StudyError]],
    ) -> None:
        super().__init__(message)
        self.results = results
        self.all_results = list(all_results)
        self.all_errors = list(all_errors)


class RunDefect(Exception):  # noqa: N818, the name says whose error it is
    """A defect of cogless ended a run. The defect's own exception is the cause. The other runs are kept.

    `results`: finished runs of the first study with such a run.
    """

    def __init__(self, message: str, results: AnyResults) -> None:
        super().__init__(message)
        self.results = results


def simulate(study: AnyStudy, scenario: str, controller: str, progress: RunProgress | None = None) -> Run:
    """Run one controller in one scenario and compute its metrics.

    `progress` is called with the finished share, 0 to 1, about ten times a second. An anti-cogging table is
    learned first, in a separate commissioning run. StudyError: an unknown name, a controller that fails.
    """
    _check_names(study, scenario, controller)
    designs = _prepare(study, [(scenario, controller)])
    return _run(study, designs, scenario, controller, progress or (lambda share: None), Event(), TraceRoom())


def learning_off(study: Study, scenario: str, controller: str, traces: Path | None = None) -> Run | None:
    """Make a run with the study's gains in which the law never learns; None if `learning_off_plan` is None.

    `traces`: as in run_study. Ctrl-C raises KeyboardInterrupt. StudyError: the run failed.
    """
    planned, stop = learning_off_plan(study, scenario, controller), Event()
    if planned is None:
        return None
    room = TraceRoom(traces)

    def carry_out() -> Run:
        with memory_enough(study, scenario, controller):
            return carried_out(planned, lambda share: None, stop, room)

    (future,) = side_by_side([carry_out], 1, stop)
    if stop.is_set():
        raise KeyboardInterrupt
    return future.result()


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

    `only`: patterns SCENARIO/CONTROLLER, with * and ?. `jobs`: number of runs at a time. `traces`: a folder
    with room for traces that are too long for memory; they are stored there in temporary files. Ctrl-C ends
    the study early: the results have the finished runs, and `interrupted` is set. In a study of trials, a
    controller that can't be designed doesn't run; the results say why.
    StudyError: no controller can be designed. RunError: a run failed; all other runs are finished.
    """
    room = TraceRoom(traces)
    asked_pairs = runs_of(study, only)
    designs = _prepare(study, asked_pairs)
    pairs = [pair for pair in asked_pairs if pair not in designs.refused]
    if not pairs:
        raise next(iter(designs.refused.values()))
    (results,) = _rollout([(study, designs, pairs)], {}, progress, jobs, True, room)
    return results


def rollout(
    studies: Sequence[AnyStudy],
    only: Sequence[str] | None = None,
    jobs: int | None = None,
    *,
    keep_traces: bool = True,
    traces: Path | None = None,
    signals: Collection[str] | None = None,
    finished: Finished | None = None,
) -> list[AnyResults]:
    """Run many studies, such as variations of one, in parallel threads; return results in their order.

    Runs of similar drives are computed together, as many as the processor has vector lanes for; `Run.lanes`
    is their number. Each run has the same results, bit for bit, as if it were computed alone. Trials, and
    runs with a switched inverter, a law in Python or a load from a table, are computed alone.

    `jobs`: number of runs at a time, default one per core. Without `keep_traces`, each run's trace is emptied
    once its metrics are computed, so that thousands of runs fit into memory. `signals`: only these and the
    time are recorded, and metrics of other signals are left out. `finished`: called with each finished run,
    whose trace is still whole, from several threads. `traces` and Ctrl-C: as in run_study. RunError: a run
    failed, or could not be prepared; its `all_results` has all other runs, finished.
    """
    room = TraceRoom(traces, signals)
    refused: dict[tuple[int, Pair], StudyError] = {}
    prepared = []
    for number, study in enumerate(studies):
        pairs = runs_of(study, only)
        designs, errors = _prepared(study, pairs)
        prepared.append((study, designs, pairs))
        refused |= {(number, pair): error for pair, error in errors.items()}
    return _rollout(prepared, refused, None, jobs or os.cpu_count() or 1, keep_traces, room, finished)


def _rollout(
    studies: Sequence[tuple[AnyStudy, Designs, Sequence[Pair]]],
    refused: Mapping[tuple[int, Pair], StudyError],
    progress: StudyProgress | None,
    jobs: int,
    keep_traces: bool,
    room: TraceRoom,
    finished: Finished | None = None,
) -> list[AnyResults]:
    """Make the given runs of each study with its designs; return each study's results.

    `refused`: why a run can't be prepared, by the study's place in `studies` and the run's names.
    """
    stop = Event()
    all_runs = [
        [_Pending(study, designs, *pair, outcome=refused.get((number, pair))) for pair in pairs]
        for number, (study, designs, pairs) in enumerate(studies)
    ]
    runs = [run for of_study in all_runs for run in of_study if run.outcome is None]

    def alone(run: _Pending) -> list[Run | StudyError]:
        def report(share: float) -> None:
            if progress is not None:
                progress(run.scenario, run.controller, share)

        return [_run(run.study, run.designs, run.scenario, run.controller, report, stop, room)]

    def group(members: Sequence[_Pending]) -> list[Run | StudyError]:
        outcomes = alone(members[0]) if len(members) == 1 else _together(members, stop, room)
        for member, run in zip(members, outcomes, strict=True):
            if finished is not None and isinstance(run, Run):
                finished(member.study, run)
        return outcomes if keep_traces else [_without_trace(run) for run in outcomes]

    groups = _groups(runs, jobs) if len(studies) > 1 else [[run] for run in runs]
    outcomes = side_by_side([partial(group, members) for members in groups], jobs, stop)
    for members, future in zip(groups, outcomes, strict=True):
        _hand_over(future, members)
    return _collected([(study, designs) for study, designs, _ in studies], all_runs, stop.is_set())


class _Pending:
    """A run to make. `outcome`: the finished run or its error; None as long as the run isn't done."""

    def __init__(
        self,
        study: AnyStudy,
        designs: Designs,
        scenario: str,
        controller: str,
        outcome: Run | BaseException | None = None,
    ) -> None:
        self.study, self.designs, self.scenario, self.controller = study, designs, scenario, controller
        self.outcome = outcome


def _groups(runs: Sequence[_Pending], jobs: int) -> list[list[_Pending]]:
    """Group runs of equal duration, the longest first.

    A group has at most one run per lane of the engine, and at most a job's share of all runs. Runs of one
    scenario and controller are neighbours, since they are the likeliest to be alike.
    """
    (_, lanes), *_ = import_module("cogless._simulator_f32").lane_kernels()
    most = max(1, min(lanes, -(-len(runs) // jobs)))
    pairs: dict[tuple[str, str], list[_Pending]] = {}
    for run in runs:
        pairs.setdefault((run.scenario, run.controller), []).append(run)
    lasting: dict[float, list[_Pending]] = {}
    for run in chain.from_iterable(pairs.values()):
        lasting.setdefault(run.study.scenario[run.scenario].duration, []).append(run)
    groups = []
    for _, members in sorted(lasting.items(), reverse=True):
        size = -(-len(members) // -(-len(members) // most))
        groups += [members[n : n + size] for n in range(0, len(members), size)]
    return groups


def _together(members: Sequence[_Pending], stop: Event, room: TraceRoom) -> list[Run | StudyError]:
    planned: list[Plan | StudyError] = []
    for run in members:
        try:
            planned.append(_planned(run.study, run.designs, run.scenario, run.controller, stop))
        except StudyError as error:
            planned.append(error)
    plans = [plan for plan in planned if isinstance(plan, Plan)]
    outcomes = iter(carried_out_together(plans, stop, room) if plans else [])
    return [next(outcomes) if isinstance(plan, Plan) else plan for plan in planned]


def _hand_over(group: Future[list[Run | StudyError]], members: Sequence[_Pending]) -> None:
    """Set each run's outcome from its group's; after Ctrl-C, the group may not be done and sets nothing."""
    if not group.done():
        return
    failure = group.exception()
    outcomes = group.result() if failure is None else [failure] * len(members)
    for run, outcome in zip(members, outcomes, strict=True):
        run.outcome = outcome


def _without_trace(run: Run | StudyError) -> Run | StudyError:
    if isinstance(run, StudyError):
        return run
    return replace(run, trace=replace(run.trace, data=run.trace.data[:0].copy()))


def _prepare(study: AnyStudy, runs: Sequence[tuple[str, str]]) -> Designs:
    """Compute the designs of these runs, and load each user's controller and each starting map once.

    So a missing file or class is found before the first run. Only runs of trials have designs.
    """
    for controller, scenario in {controller: scenario for scenario, controller in reversed(runs)}.items():
        law = study.controller[controller]
        if law.code is not None or law.begins_with is not None:
            plan(study, scenario, controller)
    return DESIGNS[study.kind].prepared(study, runs)


def _prepared(study: AnyStudy, runs: Sequence[Pair]) -> tuple[Designs, dict[Pair, StudyError]]:
    """The designs as `_prepare` makes them, and the error of each run that can't be prepared."""
    try:
        designs = _prepare(study, runs)
        return designs, designs.refused
    except StudyError:
        designs = Designs()
        errors: dict[Pair, StudyError] = {}
        for pair in runs:
            try:
                own = _prepare(study, [pair])
                designs.update(own)
                errors |= own.refused
            except StudyError as error:
                errors[pair] = error
        return designs, errors


def runs_of(study: AnyStudy, only: Sequence[str] | None = None) -> list[tuple[str, str]]:
    """Pairs (scenario, controller) of the runs that match `only`, or of all runs, in the study's order."""
    runs = [(scenario, name) for scenario in study.scenario for name in study.controllers_in(scenario)]
    if not only:
        return runs

    def matched(pattern: str) -> list[tuple[str, str]]:
        return [run for run in runs if fnmatchcase("/".join(run), pattern)]

    for pattern in only:
        if not matched(pattern):
            near = [option for option in (f"{pattern}/*", f"*/{pattern}") if matched(option)]
            names = list(map("/".join, runs))
            of = f', perhaps "{near[0]}"' if near else f" of {', '.join(names)}{perhaps(pattern, names)}"
            raise StudyError(f'{study.source.path}: --only: "{pattern}": expected SCENARIO/CONTROLLER{of}')
    return [run for run in runs if any(fnmatchcase("/".join(run), pattern) for pattern in only)]


def _planned(study: AnyStudy, designs: Designs, scenario: str, controller: str, stop: Event) -> Plan:
    return plan(study, scenario, controller, stop, designs.get((scenario, controller)))


def _run(
    study: AnyStudy,
    designs: Designs,
    scenario: str,
    controller: str,
    progress: RunProgress,
    stop: Event,
    room: TraceRoom,
) -> Run:
    planned = _planned(study, designs, scenario, controller, stop)
    with memory_enough(study, scenario, controller):
        return carried_out(planned, progress, stop, room)


def _collected(
    studies: Sequence[tuple[AnyStudy, Designs]], runs: Sequence[Sequence[_Pending]], stopped: bool
) -> list[AnyResults]:
    results: list[AnyResults] = []
    errors: list[dict[Pair, StudyError]] = []
    defects: list[tuple[AnyResults, _Pending]] = []
    for (study, designs), of_study in zip(studies, runs, strict=True):
        finished = [run.outcome for run in of_study if isinstance(run.outcome, Run)]
        errors.append(
            {(r.scenario, r.controller): r.outcome for r in of_study if isinstance(r.outcome, StudyError)}
        )
        broken = [run for run in of_study if _is_defect(run.outcome)]
        interrupted = stopped or bool(errors[-1] or broken)
        results.append(RESULTS[study.kind](study, finished, interrupted, not_designed=designs.refused))
        defects += [(results[-1], run) for run in broken]
    for finished_ones, run in defects:
        assert isinstance(run.outcome, BaseException)
        raise RunDefect(f"{run.scenario}/{run.controller}", finished_ones) from run.outcome
    failures = [error for of_study in errors for error in of_study.values()]
    if failures:
        others = len(failures) - 1
        more = f" (and {others} more run{'s' * (others > 1)} failed)" if others else ""
        first = next(of_study for of_study, failed in zip(results, errors, strict=True) if failed)
        raise RunError(f"{failures[0]}{more}", first, results, errors)
    return results


def _is_defect(outcome: Run | BaseException | None) -> bool:
    """Whether a run ended by an error of cogless itself, neither by a user's mistake nor by Ctrl-C."""
    return isinstance(outcome, BaseException) and not isinstance(outcome, StudyError | Stopped)


def _check_names(study: AnyStudy, scenario: str, controller: str) -> None:
    for table, name, options in (
        ("scenario", scenario, study.scenario),
        ("controller", controller, study.controller),
    ):
        if name not in options:
            expected = f"expected one of {', '.join(options)}{perhaps(name, options)}"
            raise StudyError(f'{study.source.path}: {table}: "{name}": {expected}')
