"""Plan of a run: one controller in one scenario, prepared for the engine."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from threading import Event
from typing import Any

from cogless.c_layout import MisfitError
from cogless.design.from_study import design_study
from cogless.design.trial import TrialDesign
from cogless.errors import StudyError
from cogless.results.status import Status
from cogless.run.advance import ENGINES, advance, failures, trace_of
from cogless.run.drive_config import Mode, engine_config
from cogless.run.own_law import make_law
from cogless.run.starting import starting_map
from cogless.run.trial_config import engine_config as trial_config
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.controller import AntiCogging, Startable
from cogless.study.trial_controller import TrialLaw


@dataclass(frozen=True, eq=False)
class Plan:
    """A run that is ready to start.

    `engine`: the engine's Python module. `description`: the run as the engine reads it. `learned`: what
    the law's map has at the start, channels of entries, or None. `design`: gains of a law of trials, else
    None.
    """

    study: AnyStudy
    scenario: str
    controller: str
    engine: Any
    drive: Any  # or the engine's linear plant
    description: dict[str, Any]
    ticks: int
    rate: float  # ticks per second: current-loop periods, or samples of a linear plant
    divider: int  # ticks per sample of the law
    decimation: int  # ticks per row of the trace
    design: TrialDesign | None = None
    learned: Any = None

    def start(self) -> Any:
        """The state at time zero, with `learned` loaded into the law's memory."""
        with failures(*self.names):
            state = self.drive.start()
            if self.learned is not None:
                self.drive.load_map(state, self.learned)
        return state

    @property
    def rows(self) -> int:
        """Rows of the trace."""
        return -(-self.ticks // self.decimation)

    @property
    def names(self) -> tuple[AnyStudy, str, str]:
        """Study, scenario and controller."""
        return self.study, self.scenario, self.controller

    def when(self, tick: int) -> str:
        """The time of a tick, or its trial, as text for a message."""
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
    """Plan a run. An anti-cogging table is learned here, in a separate commissioning run.

    `design`: the design of a law of trials, if it is already made. StudyError: the run can't be prepared.
    """
    if isinstance(study, TrialStudy):
        if design is None and isinstance(study.controller[controller], TrialLaw):
            design = design_study(study, [(scenario, controller)])[scenario, controller]
        return _trials(study, scenario, controller, design)
    made, law = _speed(study, scenario, controller, "run"), study.controller[controller]
    if isinstance(law, Startable) and law.start is not None:
        return replace(made, learned=starting_map(study, controller, law, made.drive))
    if not isinstance(law, AntiCogging):
        return made
    return replace(made, learned=_commissioned(study, scenario, controller, stop or Event()))


def _described(
    study: AnyStudy, scenario: str, controller: str, description: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """The description of a run. StudyError: a value of the study that a C struct can't hold."""
    try:
        return description()
    except MisfitError as error:
        where = f"controller.{controller}: scenario {scenario}"
        raise StudyError(f"{study.source.path}: {where}: {error}") from error


def _speed(study: Study, scenario: str, controller: str, mode: Mode) -> Plan:
    study_here, engine = for_scenario(study, scenario), import_module(ENGINES[study.drive.precision])
    rates, law = study_here.drive.rates, make_law(study, controller)
    description = _described(
        study, scenario, controller, lambda: engine_config(study, scenario, controller, mode)
    )
    with failures(study, scenario, controller):
        drive = engine.Drive(description, law)
        drive.stored(drive.start())  # what a user's law tells may be no map: found before it runs
    return Plan(
        study,
        scenario,
        controller,
        engine,
        drive,
        description,
        ticks=round(study_here.scenario[scenario].duration * rates.current_loop),
        rate=round(rates.current_loop),
        divider=rates.divider,
        decimation=round(rates.current_loop / study_here.trace_rate),
    )


def feedback_plan(planned: Plan) -> Plan | None:
    """The same controller without learning, one trial in each phase; None if it doesn't learn by a design.

    Where trials differ at random it has all trials. Faults happen at times of the whole run, so with faults
    there is none either.
    """
    study, scenario, design = planned.study, planned.scenario, planned.design
    if not isinstance(study, TrialStudy) or design is None or study.scenario[scenario].faults:
        return None
    if not design.K_3 and design.learning_matrix is None:
        return None
    unlearned = replace(design, K_3=0.0, learning_matrix=None, q_filter=None)
    description = trial_config(study, scenario, planned.controller, unlearned)
    trials = description if study.plant is not None else description["trials"]
    if not study.differs_at_random(scenario):
        trials["count"] = len(trials["phases"])
        for trial, phase in enumerate(trials["phases"]):
            phase["from"] = trial
    with failures(study, scenario, planned.controller):
        make = planned.engine.LinearTrials if study.plant is not None else planned.engine.Drive
        drive = make(description) if study.plant is not None else make(description, None)
    ticks = study.samples(scenario) * trials["count"] * planned.divider
    return replace(planned, drive=drive, description=description, ticks=ticks, decimation=planned.divider)


def _trials(study: TrialStudy, scenario: str, controller: str, design: TrialDesign | None) -> Plan:
    precision, divider, rate = "double", 1, 1 / study.period
    if study.drive is not None:
        precision, divider = study.drive.precision, study.drive.rates.divider
        rate = round(study.drive.rates.current_loop)
    engine, law = import_module(ENGINES[precision]), make_law(study, controller)
    description = _described(
        study, scenario, controller, lambda: trial_config(study, scenario, controller, design)
    )
    linear = study.plant is not None
    with failures(study, scenario, controller):
        drive = engine.LinearTrials(description) if linear else engine.Drive(description, law)
    return Plan(
        study,
        scenario,
        controller,
        engine,
        drive,
        description,
        ticks=study.samples(scenario) * study.scenario[scenario].trials * divider,
        rate=rate,
        divider=divider,
        decimation=divider if study.trace.rate is None else round(rate / study.trace.rate),
        design=design,
    )


def _commissioned(study: Study, scenario: str, controller: str, stop: Event) -> Any:
    """Learn an anti-cogging table, A, in a slow run in both directions.

    StudyError: the run isn't done after three times the expected duration.
    """
    law = study.controller[controller]
    assert isinstance(law, AntiCogging) and law.calibration is not None
    made = _speed(study, scenario, controller, "learn")
    drive, state, expected = made.drive, made.drive.start(), law.calibration.duration

    def when() -> str:
        return f", commissioning run,{made.when(state.tick)}"

    piece = made.divider * math.ceil(made.rate / made.divider)  # 1 s
    while state.tick < 3 * expected * made.rate:
        recorder = made.engine.Recorder(drive, made.divider)

        def run(ticks: int, recorder: Any = recorder) -> None:
            with failures(study, scenario, controller, when):
                drive.advance(state, recorder, ticks)

        advance(run, piece, lambda share: None, stop)
        if not int(trace_of(drive, recorder)["status"][-1]) & Status.BUSY:
            return drive.stored(state)["values"]
    line = f"{study.source.path}: controller.{controller}.calibration: scenario {scenario}"
    raise StudyError(f"{line}: not done after {3 * expected:.3g} s: expected kp and ki that hold its speed")
