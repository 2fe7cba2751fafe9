"""Plan of a run: one controller in one scenario, as the engine takes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib import import_module
from threading import Event
from typing import Any

from cogless.design.from_study import design_study
from cogless.design.trial import TrialDesign
from cogless.errors import StudyError
from cogless.results.status import Status
from cogless.run.advance import ENGINES, advance, failures, trace_of
from cogless.run.drive_config import Mode, engine_config
from cogless.run.own_law import make_law
from cogless.run.trial_config import engine_config as trial_config
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.controller import AntiCogging
from cogless.study.trial_controller import TrialLaw


@dataclass(frozen=True, eq=False)
class Plan:
    """A run before it begins.

    `engine`: its module. `description`: the run in its words. `table`: what the law's memory starts with, A,
    or empty. `design`: of a law of trials.
    """

    study: AnyStudy
    scenario: str
    controller: str
    engine: Any
    description: dict[str, Any]
    ticks: int
    rate: float  # ticks a second: of the current loop, or of a linear plant's samples
    divider: int  # ticks in a sample of the law
    decimation: int  # ticks in a row of the trace
    drive: Any = None  # or the engine's linear plant
    design: TrialDesign | None = None
    table: Any = ()

    def start(self) -> Any:
        """The state at time zero, with what was learned before."""
        state = self.drive.start()
        if len(self.table):
            self.drive.load_memory(state, self.table)
        return state

    def when(self, tick: int) -> str:
        """The time of a tick, in a message."""
        if isinstance(self.study, TrialStudy):
            return f" in trial {tick // (self.divider * self.study.samples(self.scenario)) + 1}"
        return f" at {tick / self.rate:.6g} s"


def plan(
    study: AnyStudy,
    scenario: str,
    controller: str,
    stop: Event | None = None,
    design: TrialDesign | None = None,
) -> Plan:
    """Plan a run. An anti-cogging table is learned here, in a commissioning run of its own. StudyError.

    `design`: of a law of trials, where it is made already.
    """
    if isinstance(study, TrialStudy):
        if design is None and isinstance(study.controller[controller], TrialLaw):
            design = design_study(study, [(scenario, controller)])[scenario, controller]
        return _trials(study, scenario, controller, design)
    made = _speed(study, scenario, controller, "run")
    if not isinstance(study.controller[controller], AntiCogging):
        return made
    return replace(made, table=_commissioned(study, scenario, controller, stop or Event()))


def _speed(study: Study, scenario: str, controller: str, mode: Mode) -> Plan:
    study_here = for_scenario(study, scenario)
    rates = study_here.drive.rates
    return _made(
        Plan(
            study,
            scenario,
            controller,
            import_module(ENGINES[study.drive.precision]),
            engine_config(study, scenario, controller, mode),
            ticks=round(study_here.scenario[scenario].duration * rates.current_loop),
            rate=round(rates.current_loop),
            divider=rates.divider,
            decimation=round(rates.current_loop / study_here.trace_rate),
        )
    )


def _trials(study: TrialStudy, scenario: str, controller: str, design: TrialDesign | None) -> Plan:
    precision, divider, rate = "double", 1, 1 / study.period
    if study.drive is not None:
        precision, divider = study.drive.precision, study.drive.rates.divider
        rate = round(study.drive.rates.current_loop)
    rows = divider if study.trace.rate is None else round(divider / (study.trace.rate * study.period))
    return _made(
        Plan(
            study,
            scenario,
            controller,
            import_module(ENGINES[precision]),
            trial_config(study, scenario, controller, design),
            ticks=study.samples(scenario) * study.scenario[scenario].trials * divider,
            rate=rate,
            divider=divider,
            decimation=rows,
            design=design,
        )
    )


def _made(planned: Plan) -> Plan:
    """The plan with its engine's drive, or linear plant."""
    study, name, engine = planned.study, planned.controller, planned.engine
    law = make_law(study, name)
    try:
        if isinstance(study, TrialStudy) and study.plant is not None:
            return replace(planned, drive=engine.LinearTrials(planned.description))
        return replace(planned, drive=engine.Drive(planned.description, law))
    except (ValueError, RuntimeError) as error:
        where = f"{study.source.path}: controller.{name}: scenario {planned.scenario}"
        raise StudyError(f"{where}: {error}") from error


def _commissioned(study: Study, scenario: str, controller: str, stop: Event) -> Any:
    """The table that a slow run in both directions learns, A; StudyError if it takes three times its time."""
    law = study.controller[controller]
    assert isinstance(law, AntiCogging)
    made = _speed(study, scenario, controller, "learn")
    drive, state, expected = made.drive, made.drive.start(), law.calibration.duration
    piece = made.divider * math.ceil(made.rate / made.divider)  # 1 s
    while state.tick < 3 * expected * made.rate:
        recorder = made.engine.Recorder(drive, made.divider)
        with failures(study, scenario, controller, lambda: f", commissioning run,{made.when(state.tick)}"):
            advance(drive, state, recorder, piece, lambda share: None, stop)
        if not int(trace_of(drive, recorder)["status"][-1]) & Status.BUSY:
            return drive.memory(state)["current"]
    line = f"{study.source.path}: controller.{controller}.calibration: scenario {scenario}"
    raise StudyError(f"{line}: not done after {3 * expected:.3g} s: expected kp and ki that hold its speed")
