"""Carry out planned runs on the engine: one run alone, or several runs that are alike, in step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from threading import Event
from typing import Any

from cogless.errors import StudyError
from cogless.maps import learned_map
from cogless.results import Run
from cogless.results.fault_response import faults_in, responses
from cogless.results.metrics import Value, evaluate, result_name
from cogless.results.trace import Trace, TraceRoom
from cogless.run.run_plan import Plan, RunProgress, advance, failures, feedback_plan, memory_enough, trace_of
from cogless.study import AnyStudy, Study, TrialStudy
from cogless.study.base import Kind


def measure(study: AnyStudy, scenario: str, trace: Trace) -> dict[str, Value]:
    """Compute a scenario's metrics from a trace: SI values by their name in results.json.

    Metrics of signals that the trace lacks are left out.
    """
    conditions = study.conditions(scenario)
    return {
        result_name(metric): evaluate(metric, trace, conditions)
        for metric in study.metrics_in(scenario)
        if metric.signal is None or metric.signal in trace
    }


class _Record:
    """What is recorded of a run that goes on, in memory or in a file."""

    def __init__(self, planned: Plan, room: TraceRoom) -> None:
        drive, rows = planned.drive, planned.trace_rows
        columns = room.columns(drive.signals)
        self._signals = [drive.signals[k] for k in columns] or drive.signals
        self._file = room.file(self._signals, rows)
        self.recorder = planned.engine.Recorder(drive, planned.decimation, 0 if self._file else rows, columns)

    def after_a_piece(self) -> None:
        if self._file is not None:
            self._file.append(self.recorder.take())

    def trace(self) -> Trace:
        """The trace of the finished run."""
        return self._file.trace() if self._file is not None else trace_of(self._signals, self.recorder)


def carried_out(planned: Plan, progress: RunProgress, stop: Event, room: TraceRoom) -> Run:
    """Carry out one plan alone, and compute the run's metrics. StudyError: the run failed."""
    drive, state = planned.drive, planned.start()
    record = _Record(planned, room)

    def after_a_piece(share: float) -> None:
        record.after_a_piece()
        progress(share)

    def run(ticks: int) -> None:
        with failures(*planned.names, lambda: planned.when(state.tick)):
            drive.advance(state, record.recorder, ticks)

    advance(run, planned.ticks, after_a_piece, stop)
    return _finished(planned, state, record.trace(), 1)


class _Lane:
    """A run that the engine computes in step with others. `error`: why the run failed, or ""."""

    def __init__(self, planned: Plan, room: TraceRoom) -> None:
        self.planned, self.state, self.error = planned, planned.start(), ""
        self.record = _Record(planned, room)

    def outcome(self, lanes: int) -> Run | StudyError:
        """The finished run, or why it failed."""
        planned, state = self.planned, self.state
        try:
            with failures(*planned.names, lambda: planned.when(state.tick)):
                if self.error:
                    raise RuntimeError(self.error)
            with memory_enough(*planned.names):
                return _finished(planned, state, self.record.trace(), lanes)
        except StudyError as error:
            return error


def carried_out_together(plans: Sequence[Plan], stop: Event, room: TraceRoom) -> list[Run | StudyError]:
    """Carry out plans of one engine. Plans that are alike run in step, at most one per lane of the engine.

    Each run has bit for bit the numbers of a run alone. Returns each plan's run, or why the run failed.
    """
    first = plans[0]
    width = first.engine.lane_kernels()[0][1]
    batch = [plan for plan in plans if _goes_with(plan, first)][:width] or [first]
    outcomes = {id(plan): outcome for plan, outcome in zip(batch, _outcomes(batch, stop, room), strict=True)}
    others = [plan for plan in plans if id(plan) not in outcomes]
    if others:
        rest = carried_out_together(others, stop, room)
        outcomes |= {id(plan): outcome for plan, outcome in zip(others, rest, strict=True)}
    return [outcomes[id(plan)] for plan in plans]


def _goes_with(plan: Plan, other: Plan) -> bool:
    return (
        plan.engine is other.engine
        and plan.ticks == other.ticks
        and plan.in_step
        and bool(plan.drive.alike(other.drive))
    )


def _outcomes(plans: Sequence[Plan], stop: Event, room: TraceRoom) -> list[Run | StudyError]:
    if len(plans) == 1:
        try:
            return [carried_out(plans[0], lambda share: None, stop, room)]
        except StudyError as error:
            return [error]
    engine = plans[0].engine
    lanes = [_Lane(plan, room) for plan in plans]

    def step(ticks: int) -> None:
        running = [lane for lane in lanes if not lane.error]
        if running:
            errors = engine.advance_lanes(
                [lane.planned.drive for lane in running],
                [lane.state for lane in running],
                [lane.record.recorder for lane in running],
                ticks,
            )
            for lane, error in zip(running, errors, strict=True):
                lane.error = error

    def after_a_piece(share: float) -> None:
        for lane in lanes:
            if not lane.error:
                lane.record.after_a_piece()

    advance(step, plans[0].ticks, after_a_piece, stop)
    return [lane.outcome(len(lanes)) for lane in lanes]


def _feedback_trace(study: TrialStudy, planned: Plan) -> Trace | None:
    """The trace of `feedback_plan`, by the same controller without learning; None without such a plan."""
    alone = feedback_plan(study, planned)
    if alone is None:
        return None
    state = alone.start()
    recorder = alone.engine.Recorder(alone.drive, alone.decimation, alone.trace_rows)
    with failures(*alone.names, lambda: " without learning"):
        alone.drive.advance(state, recorder, alone.ticks)
    return trace_of(alone.drive.signals, recorder)


def _finished(planned: Plan, state: Any, trace: Trace, lanes: int) -> Run:
    return RUNS[planned.study.kind](planned.study, planned, state, trace, lanes)


def _speed_run(study: Study, planned: Plan, state: Any, trace: Trace, lanes: int) -> Run:
    scenario, controller = planned.scenario, planned.controller
    metrics, learned = _metrics(planned, trace), _learned(planned, state)
    limit = study.in_scenario(scenario).drive.current_loop.current_limit
    quality, learns = dict(planned.drive.quality(state)), study.controller[controller].learns
    if not learns:
        quality = {key: quality[key] for key in ("known", "residual")}
    return Run(
        scenario,
        controller,
        trace,
        learned_map.memory_of(study, scenario, controller, learned),
        metrics,
        quality=quality,
        faults=responses(faults_in(study, scenario), trace, limit, learns),
        map=learned_map.of_run(study, learned),
        lanes=lanes,
    )


def _trial_run(study: TrialStudy, planned: Plan, state: Any, trace: Trace, lanes: int) -> Run:
    scenario, controller = planned.scenario, planned.controller
    # metrics use one row per sample of the trial; the trace may have more
    rows = replace(trace, data=trace.data[:: planned.divider // planned.decimation])
    # the map is stored with the last phase's reference, since it was learned for this motion
    motion = learned_map.motion_identity(study.reference(scenario, study.scenario[scenario].phases[-1][1]))
    metrics = _metrics(planned, rows)
    # a user's law isn't asked for its map: this would be over an angle, not over samples
    own = study.controller[controller].code is not None
    learned = None if own else _learned(planned, state)
    return Run(
        scenario=scenario,
        controller=controller,
        trace=trace,
        memory=learned_map.memory_of(study, scenario, controller, learned),
        metrics=metrics,
        design=planned.design,
        map=learned_map.of_run(study, learned, motion),
        feedback=_feedback_trace(study, planned),
    )


RUNS: Mapping[Kind, Callable[[Any, Plan, Any, Trace, int], Run]] = {"speed": _speed_run, "trials": _trial_run}


def _metrics(planned: Plan, rows: Trace) -> dict[str, Value]:
    study, scenario, controller = planned.names
    try:
        return measure(study, scenario, rows)
    except StudyError as error:
        where = f"{study.source.path}: controller.{controller}: scenario {scenario}"
        raise StudyError(f"{where}: {error}") from error


def _learned(planned: Plan, state: Any) -> Any:
    with failures(*planned.names, lambda: planned.when(state.tick)):
        return planned.drive.stored(state)
