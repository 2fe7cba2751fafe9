"""A whole study: a drive, the controllers on it, the scenarios they go through, the metrics."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PrivateAttr

from cogless.study.any_motor import AnyMotor
from cogless.study.base import StudyBase
from cogless.study.calibration import Calibration
from cogless.study.drive import Drive, StarBelief
from cogless.study.laws import Controller
from cogless.study.mechanics import Mechanics
from cogless.study.metric import Metric
from cogless.study.scenario import Scenario
from cogless.study.table import Frequency, Many, Table


class TraceSettings(Table):
    """Settings of what is recorded."""

    rate: Frequency | None = None  # Hz, divides the current-loop rate, the default
    energy: bool = False  # integrate and record the energies too


class Study(StudyBase):
    """A validated study, all SI. Made by `cogless.study.load`."""

    trace: TraceSettings = TraceSettings()
    motor: AnyMotor
    mechanics: Mechanics
    drive: Drive
    scenario: Annotated[dict[str, Scenario], Field(min_length=1)]
    controller: Annotated[dict[str, Controller], Field(min_length=1)]
    metric: Many[Metric] = ()
    calibration: Calibration | None = None
    _scenarios: dict[str, Study] = PrivateAttr(default={})  # as they are with their overrides

    @property
    def belief(self) -> StarBelief:
        """The motor as the controller believes it."""
        return self.drive.belief.resolved(self.motor.star())

    @property
    def trace_rate(self) -> float:
        """Recorded rows per second, Hz."""
        return self.trace.rate or self.drive.rates.current_loop

    def metrics_in(self, scenario: str) -> tuple[Metric, ...]:
        """The metrics that apply to a scenario."""
        experiment = self.scenario[scenario]
        return tuple(metric for metric in self.metric if metric.applies_in(scenario, experiment))
