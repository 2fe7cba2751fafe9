"""Prepare a study's controller for export, on the engine, and record its inputs and outputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.run.run_plan import Plan, failures, plan
from cogless.study import AnyStudy
from cogless.study.table import perhaps

Reals = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Prepared(Plan):
    """The plan of a run whose controller exists in C."""

    @cached_property
    def memory(self) -> Reals:
        """Contents of the law's memory at the start."""
        memory: Reals = self.drive.law_memory(self.start())
        return memory

    @property
    def duration(self) -> float:
        """Duration of the run, s."""
        return self.ticks / self.rate

    @property
    def trials(self) -> bool:
        """Whether the run consists of trials."""
        return "trials" in self.description

    @property
    def has_drive(self) -> bool:
        """Whether the law's C code runs within the C code of a drive."""
        return not self.study.controller[self.controller].NO_DRIVE

    @property
    def has_bus(self) -> bool:
        """Whether a field bus is between law and drive."""
        return "bus" in self.description["drive"]

    @property
    def phases(self) -> int:
        """Number of the motor's phases."""
        motor = self.description["trials"]["phases"][0] if self.trials else self.description
        return int(motor["motor"]["phases"])

    @property
    def bus_voltage(self) -> float | None:
        """Bus voltage, V; None with an ideal current loop."""
        inverter = self.description["drive"].get("inverter")
        return None if inverter is None else float(inverter["bus_voltage"])


class Steps(Protocol):
    """Interface of an object that replaces a drive's controller; C structs are passed as bytes."""

    def step(self, measurement: bytes, reference: bytes) -> bytes: ...

    # Three methods replace `step` if a bus is between law and drive. `measure` returns whether the law is
    # due, and the drive's angle and speed. `law` takes the angle and speed that have reached the law; it
    # returns i_q_ref. `actuate` takes the i_q_ref that has reached the drive, if any; it returns the output.
    def measure(self, measurement: bytes, reference: bytes) -> tuple[bool, float, float]: ...
    def law(self, theta_m: float, omega_m: float) -> float: ...
    def actuate(self, i_q_ref: float | None) -> bytes: ...

    def begin(self, trajectory: bytes) -> None: ...
    def end(self) -> None: ...


@dataclass(eq=False)
class Recording:
    """Inputs and outputs of the controller in each tick, as bytes of the C structs.

    `memory`: contents of the law's memory at the end.
    `begun`: the tick at which each trial began, and the trial's trajectory. `ended`: ticks before which a
    trial ended.
    """

    measurements: list[bytes] = field(default_factory=list)
    references: list[bytes] = field(default_factory=list)
    outputs: list[bytes] = field(default_factory=list)
    begun: list[tuple[int, bytes]] = field(default_factory=list)
    ended: list[int] = field(default_factory=list)
    memory: Reals = field(default_factory=lambda: np.zeros(0, np.float32))


class Recorder:
    """The drive's own controller, whose inputs and outputs are recorded.

    If the law has no drive around it in C, the law's own outputs are recorded, not those of the drive in the
    simulation.
    """

    def __init__(self, prepared: Prepared) -> None:
        self._drive, self._state = prepared.drive, prepared.start()
        self._alone = not prepared.has_drive
        self._measured = b"", b""
        self.recording = Recording()

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        output: bytes = self._drive.step_controller(self._state, measurement, reference)
        return self._recorded(measurement, reference, output)

    def measure(self, measurement: bytes, reference: bytes) -> tuple[bool, float, float]:
        self._measured = measurement, reference
        answer: tuple[bool, float, float] = self._drive.measure_controller(
            self._state, measurement, reference
        )
        return answer

    def law(self, theta_m: float, omega_m: float) -> float:
        return float(self._drive.law_controller(self._state, theta_m, omega_m))

    def actuate(self, i_q_ref: float | None) -> bytes:
        return self._recorded(*self._measured, self._drive.actuate_controller(self._state, i_q_ref))

    def _recorded(self, measurement: bytes, reference: bytes, output: bytes) -> bytes:
        recording = self.recording
        recording.measurements.append(measurement)
        recording.references.append(reference)
        recording.outputs.append(self._drive.microstepping_output(self._state) if self._alone else output)
        return output

    def begin(self, trajectory: bytes) -> None:
        self.recording.begun.append((len(self.recording.outputs), trajectory))
        self._drive.begin_trial(self._state, trajectory)

    def end(self) -> None:
        self.recording.ended.append(len(self.recording.outputs))
        self._drive.end_trial(self._state)

    def finish(self) -> Recording:
        self.recording.memory = self._drive.law_memory(self._state)
        return self.recording


def prepare(study: AnyStudy, scenario: str, controller: str) -> Prepared:
    """Prepare a controller in a scenario; an anti-cogging table is learned first, in its commissioning run.

    StudyError: an unknown name, a controller without a C form, a run that can't start.
    """
    _check(study, scenario, controller)
    return Prepared(**vars(plan(study, scenario, controller)))


def prepare_whole(study: AnyStudy, scenario: str, controller: str) -> Prepared:
    """`prepare` for an export of law and drive as one; StudyError also if a bus is between law and drive."""
    prepared = prepare(study, scenario, controller)
    if prepared.has_bus:
        raise StudyError(
            f"{study.source.path}: drive.bus: behind a field bus the law runs apart from the drive: expected "
            "no drive.bus, since an export joins law and drive"
        )
    return prepared


def first_scenario(study: AnyStudy, controller: str, scenario: str | None = None) -> str:
    """`scenario`, or the first scenario in which the controller runs if `scenario` is None.

    StudyError: an unknown controller, or no such scenario with this controller.
    """
    path = study.source.path
    if controller not in study.controller:
        expected = f"expected one of {', '.join(study.controller)}{perhaps(controller, study.controller)}"
        raise StudyError(f'{path}: controller: "{controller}": {expected}')
    runs_in = study.scenarios_of(controller)
    if scenario is None:
        if not runs_in:
            raise StudyError(
                f"{path}: controller.{controller}: runs in no scenario: expected a scenario with this "
                "controller"
            )
        return runs_in[0]
    if scenario not in runs_in:
        expected = (
            f"expected a scenario with controller {controller}: "
            f"{', '.join(runs_in)}{perhaps(scenario, runs_in)}"
        )
        raise StudyError(f'{path}: scenario: "{scenario}": {expected}')
    return scenario


def record(prepared: Prepared, ticks: int) -> Recording:
    """Simulate `ticks` periods with the drive's own controller, and record its inputs and outputs.

    Raises StudyError if the controller fails.
    """
    recorder = Recorder(prepared)
    run(prepared, recorder, ticks)
    return recorder.finish()


def run(prepared: Prepared, controller: Steps, ticks: int) -> None:
    """Simulate `ticks` periods of the plant with `controller` in place of the drive's own controller.

    StudyError: the controller fails.
    """
    state = prepared.drive.start()
    rows = prepared.engine.Recorder(prepared.drive, max(ticks, 1))
    with failures(prepared.study, prepared.scenario, prepared.controller):
        prepared.drive.advance(state, rows, ticks, controller)


def _check(study: AnyStudy, scenario: str, controller: str) -> None:
    first_scenario(study, controller, scenario)
    law = study.controller[controller]
    where = f"{study.source.path}: controller.{controller}.law"
    if law.NO_C_FORM:
        raise StudyError(f'{where}: "{law.law}": {law.NO_C_FORM}: expected a law of the control library')
    if study.drive is None:
        raise StudyError(
            f"{study.source.path}: plant: a linear plant has no drive: expected a study with a drive; "
            "`cogless export --to c` writes the law alone"
        )
