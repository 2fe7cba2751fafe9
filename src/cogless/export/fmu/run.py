"""A controller in a scenario, as both of its FMUs need it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cogless.design.from_study import design_study
from cogless.export.prepared import Prepared, first_scenario, prepare
from cogless.run import drive_config as engine
from cogless.run import trial_config as trial_engine
from cogless.study import AnyStudy, TrialStudy


@dataclass(frozen=True, eq=False)
class FmuRun:
    """A controller in a scenario; `description`: the engine's description of the run."""

    prepared: Prepared
    description: dict[str, Any]

    @property
    def study(self) -> Any:
        return self.prepared.study

    @property
    def scenario(self) -> str:
        return self.prepared.scenario

    @property
    def controller(self) -> str:
        return self.prepared.controller

    @property
    def rate(self) -> int:
        """Rate of the current loop, 1/s."""
        return self.prepared.rate

    @property
    def duration(self) -> float:
        """Duration of the scenario, s."""
        return self.prepared.ticks / self.rate

    @property
    def trials(self) -> bool:
        return "trials" in self.description

    @property
    def phases(self) -> int:
        """Number of the motor's phases."""
        motor = self.description["trials"]["phases"][0] if self.trials else self.description
        return int(motor["motor"]["phases"])

    @property
    def bus_voltage(self) -> float | None:
        """Bus voltage, V; None with an ideal current loop."""
        drive = self.description["drive"]
        return None if drive["ideal_current"] else float(drive["inverter"]["bus_voltage"])


def run_of(study: AnyStudy, controller: str, scenario: str | None) -> FmuRun:
    """The run of a controller. StudyError: no such name, a law without a C form, a plant that is no drive."""
    chosen = first_scenario(study, controller, scenario)
    prepared = prepare(study, chosen, controller)
    if isinstance(study, TrialStudy):
        design = design_study(study, [(chosen, controller)])[chosen, controller]
        return FmuRun(prepared, trial_engine.engine_config(study, chosen, controller, design))
    return FmuRun(prepared, engine.engine_config(study, chosen, controller))
