"""A controller in a scenario, as both of its FMUs need it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cogless.export.prepared import Prepared, first_scenario, prepare
from cogless.study import AnyStudy


@dataclass(frozen=True, eq=False)
class FmuRun:
    """A controller in a scenario."""

    prepared: Prepared

    @property
    def description(self) -> dict[str, Any]:
        """The engine's description of the run."""
        return self.prepared.description

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
        inverter = self.description["drive"].get("inverter")
        return None if inverter is None else float(inverter["bus_voltage"])


def run_of(study: AnyStudy, controller: str, scenario: str | None) -> FmuRun:
    """The run of a controller. StudyError: no such name, a law without a C form, a plant that is no drive."""
    return FmuRun(prepare(study, first_scenario(study, controller, scenario), controller))
