"""Plan of a run: one controller in one scenario, prepared for the engine.

A law may begin with a map that was learned before, or with a table of current or torque. This is loaded here.

Helpers of a run: the engine's modules, simulation in short pieces, failures as one-line errors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from threading import Event
from typing import Any

import numpy as np

from cogless.c_layout import MisfitError
from cogless.control_library import Status
from cogless.design.trials.from_study import design_study
from cogless.design.trials.gains import TrialDesign
from cogless.errors import StudyError
from cogless.maps import learned_map, stored_map
from cogless.maps.stored_map import CURRENT_CODE, MapError, StoredMap
from cogless.results.trace import Trace
from cogless.run.drive_config import Mode, engine_config
from cogless.run.own_law import describe, is_failure, law_file, make_law
from cogless.run.trial_config import engine_config as trial_config
from cogless.study import AnyStudy, Study, TrialStudy
from cogless.study.base import Kind
from cogless.study.laws.law import Base, Start


def starting_map(study: Study, controller: str, law: Base, drive: Any) -> learned_map.Real:
    """The entries of a law's map at the start of a run, (channels, cells).

    `drive`: the engine's drive with this law. StudyError: the file is no map, the map does not fit the law,
    or a user's law refuses the map.
    """
    start = law.begins_with
    assert start is not None
    key, name = ("table", start.table) if start.map is None else ("map", start.map)
    where = f'{study.source.path}: controller.{controller}.start.{key}: "{name}": '
    try:
        with _law_failures(study, controller, where):
            state = drive.start()
            own = drive.stored(state)
        if own is None:
            raise MapError(f"expected {law.NEEDS}")
        source = _of_table(study, start) if start.map is None else _newest(study, start.map)
        entries = learned_map.entries(source, own, law.unit)
        if law.code is not None:
            with _law_failures(study, controller, where):
                drive.load_map(state, entries)  # a user's law may refuse the map: found before the first run
        return entries
    except MapError as error:
        raise StudyError(f"{where}{error}") from None


@contextmanager
def _law_failures(study: Study, controller: str, where: str) -> Iterator[None]:
    """Turn any exception of a user's law into a StudyError that begins with `where`."""
    try:
        yield
    except BaseException as error:
        if study.controller[controller].code is None or not is_failure(error):
            raise
        raise StudyError(f"{where}{describe(error, law_file(study, controller))}") from error


def _newest(study: Study, name: str) -> StoredMap:
    path = study.source.folder / name
    if not path.is_file():
        raise MapError(f"expected a file at {path}")
    maps = stored_map.read(path)
    newest = stored_map.newest(maps)
    if newest is None:
        raise MapError(str(maps[0].map))
    return newest.map


def _of_table(study: Study, start: Start) -> StoredMap:
    """A table of current or torque as a map of current, A, over the revolution of the table."""
    table = start.over_angle
    cells, parts = len(table.angle), study.motor.pole_pairs if start.frame == "electrical" else 1
    amplitude, phase = np.transpose(table.harmonics((cells - 1) // 2))
    spectrum = amplitude / 2 * np.exp(1j * (phase - np.pi / 2))
    spectrum[0] *= 2
    current = np.fft.irfft(spectrum, cells) * cells
    if table.name == "torque":
        current /= study.K_t
    if start.sign == "cogging":
        current = -current
    return StoredMap(
        current.astype(np.float32), (CURRENT_CODE,), (float(np.max(np.abs(current))),), parts=parts
    )


REFUSALS = (ValueError, RuntimeError, MemoryError)  # the engine raises exactly these about a study
NEVER_LEARNS = 1e9  # s, a learning_start that never comes
PROGRESS_PERIOD = 0.1  # s of wall time between two reports of progress and checks for Ctrl-C

RunProgress = Callable[[float], None]


def compiled(study: AnyStudy) -> Any:
    """Return the simulator that is compiled with control laws of this study's precision.

    StudyError: cogless was built without this simulator, as by `make demo`, which builds single precision
    alone.
    """
    if study.precision == "single":
        return import_module("cogless._simulator_f32")
    try:
        return import_module("cogless._simulator_f64")
    except ModuleNotFoundError as error:
        cause = (
            "its control laws compute in double precision, and cogless was built without the "
            "double-precision engine"
        )
        raise StudyError(f"{study.source.path}: {cause}; `make build` adds it") from error


class Stopped(Exception):  # noqa: N818, it isn't an error
    """Ctrl-C was pressed."""


@contextmanager
def failures(
    study: AnyStudy, scenario: str, controller: str, when: Callable[[], str] = str
) -> Iterator[None]:
    """Turn the engine's refusal, or any exception of a user's law, into a StudyError of one line.

    Any other exception is a defect of cogless and passes through. So only calls of the engine belong in this
    context. `when`: returns the time in the run, or "".
    """
    try:
        yield
    except BaseException as error:
        of_user = study.controller[controller].code is not None and is_failure(error)
        if isinstance(error, StudyError) or not (of_user or type(error) in REFUSALS):
            raise
        where = f"controller.{controller}: scenario {scenario}{when()}"
        cause = describe(error, law_file(study, controller))
        raise StudyError(f"{study.source.path}: {where}: {cause}") from error


@contextmanager
def memory_enough(study: AnyStudy, scenario: str, controller: str) -> Iterator[None]:
    """Turn a MemoryError into a StudyError of one line: the run needs more memory than there is."""
    try:
        yield
    except MemoryError as error:
        where = f"controller.{controller}: scenario {scenario}"
        raise StudyError(f"{study.source.path}: {where}: {describe(error, None)}") from error


def advance(run: Callable[[int], None], ticks: int, progress: RunProgress, stop: Event) -> None:
    """Call `run` for all ticks, in pieces of about PROGRESS_PERIOD. Report progress after each piece.

    Raises Stopped before the next piece once `stop` is set.
    """
    done, piece = 0, 1000
    while done < ticks:
        if stop.is_set():
            raise Stopped
        begun = time.perf_counter()
        step = min(piece, ticks - done)
        run(step)
        done += step
        progress(done / ticks)
        spent = max(time.perf_counter() - begun, 1e-6)
        piece = max(1, min(4 * piece, int(step * PROGRESS_PERIOD / spent)))


def trace_of(signals: Sequence[tuple[str, str]], recorder: Any) -> Trace:
    """Take the rows of these signals (name, unit) recorded so far from the recorder, as a trace."""
    names, units = zip(*signals, strict=True)
    return Trace(names, units, recorder.take())


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """A run that is ready to start.

    `engine`: the engine's Python module. `description`: the run as the engine reads it. `learned`: entries of
    the law's map at the start, by channel; None: nothing is loaded. `design`: gains of a law of trials, else
    None.
    """

    study: AnyStudy
    scenario: str
    controller: str
    engine: Any
    drive: Any  # the engine's drive, or its linear plant
    description: dict[str, Any]
    ticks: int
    rate: float  # ticks per second: current-loop periods, or samples of a linear plant
    divider: int  # ticks per sample of the law
    decimation: int  # ticks per row of the trace
    rows_per_period: int = 1  # rows of the trace per tick, where there are several
    design: TrialDesign | None = None
    learned: Any = None
    in_step: bool = True  # whether the run may be computed in step with plans that are alike

    def start(self) -> Any:
        """The state at time zero, with `learned` loaded into the law's memory."""
        with failures(*self.names):
            state = self.drive.start()
            if self.learned is not None:
                self.drive.load_map(state, self.learned)
        return state

    @property
    def trace_rows(self) -> int:
        """Rows of the trace."""
        return -(-self.ticks // self.decimation) * self.rows_per_period

    @property
    def names(self) -> tuple[AnyStudy, str, str]:
        """Study, scenario and controller."""
        return self.study, self.scenario, self.controller

    def when(self, tick: int) -> str:
        """The time of a tick, or its trial, as text for a message."""
        return self.study.when(self.scenario, tick)


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
    return PLANS[study.kind](study, scenario, controller, stop, design)


def _plan_speed(
    study: Study, scenario: str, controller: str, stop: Event | None, design: TrialDesign | None
) -> Plan:
    plan, law = _speed(study, scenario, controller, "run"), study.controller[controller]
    if law.begins_with is not None:
        return replace(plan, learned=starting_map(study, controller, law, plan.drive))
    if law.commissioning is None:
        return plan
    return replace(plan, learned=_commissioned(study, scenario, controller, stop or Event()))


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
    engine, law = compiled(study), make_law(study, controller)
    description = _described(
        study, scenario, controller, lambda: engine_config(study, scenario, controller, mode)
    )
    with failures(study, scenario, controller):
        drive = engine.Drive(description, law)
        drive.stored(drive.start())  # a user's law may return no valid map: found before the run
    return Plan(
        study=study,
        scenario=scenario,
        controller=controller,
        engine=engine,
        drive=drive,
        description=description,
        **vars(study.timing(scenario)),
    )


def learning_off_plan(study: Study, scenario: str, controller: str) -> Plan | None:
    """Plan a run with the study's gains in which the law never learns.

    None: the law does not learn during a run, or begins with a map or table that was learned before.
    """
    law = study.controller[controller]
    if not law.learns or law.begins_with is not None or law.commissioning is not None:
        return None
    planned = _speed(study, scenario, controller, "run")
    table = planned.description["controller"]
    if "learning_start" not in table:
        return None
    description = {**planned.description, "controller": {**table, "learning_start": NEVER_LEARNS}}
    with failures(study, scenario, controller):
        drive = planned.engine.Drive(description, make_law(study, controller))
    return replace(planned, drive=drive, description=description)


def feedback_plan(study: TrialStudy, planned: Plan) -> Plan | None:
    """Plan a run of the same controller without learning, with one trial in each phase.

    Where trials differ at random, the plan has all trials. None: the controller doesn't learn by a
    design, or the scenario has faults, which happen at times of the whole run.
    """
    scenario, design = planned.scenario, planned.design
    if design is None or study.scenario[scenario].faults:
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


def _plan_trials(
    study: TrialStudy, scenario: str, controller: str, stop: Event | None, design: TrialDesign | None
) -> Plan:
    if design is None and study.controller[controller].of_trials:
        design = design_study(study, [(scenario, controller)])[scenario, controller]
    engine, law = compiled(study), make_law(study, controller)
    description = _described(
        study, scenario, controller, lambda: trial_config(study, scenario, controller, design)
    )
    linear = study.plant is not None
    with failures(study, scenario, controller):
        drive = engine.LinearTrials(description) if linear else engine.Drive(description, law)
    return Plan(
        study=study,
        scenario=scenario,
        controller=controller,
        engine=engine,
        drive=drive,
        description=description,
        **vars(study.timing(scenario)),
        design=design,
        in_step=False,
    )


PLANS: Mapping[Kind, Callable[..., Plan]] = {"speed": _plan_speed, "trials": _plan_trials}


def _commissioned(study: Study, scenario: str, controller: str, stop: Event) -> Any:
    """Learn an anti-cogging table, A, in a slow run in both directions.

    StudyError: the run isn't done after three times the expected duration.
    """
    commissioning = study.controller[controller].commissioning
    assert commissioning is not None
    plan = _speed(study, scenario, controller, "learn")
    drive, state, expected = plan.drive, plan.drive.start(), commissioning.duration

    def when() -> str:
        return f", commissioning run,{plan.when(state.tick)}"

    piece = plan.divider * math.ceil(plan.rate / plan.divider)  # 1 s
    while state.tick < 3 * expected * plan.rate:
        recorder = plan.engine.Recorder(drive, plan.divider)

        def run(ticks: int, recorder: Any = recorder) -> None:
            with failures(study, scenario, controller, when):
                drive.advance(state, recorder, ticks)

        advance(run, piece, lambda share: None, stop)
        if not int(trace_of(drive.signals, recorder)["status"][-1]) & Status.BUSY:
            return drive.stored(state)["values"]
    line = f"{study.source.path}: controller.{controller}.calibration: scenario {scenario}"
    raise StudyError(
        f"{line}: the calibration run is not done after {3 * expected:.3g} s: expected kp "
        "and ki that hold the run's speed"
    )
