"""A whole study: a drive, the controllers on it, the scenarios they go through, the metrics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from cogless.study import checks
from cogless.study.calibration import Calibration
from cogless.study.controller import Controller
from cogless.study.drive import Drive, StarBelief
from cogless.study.mechanics import Mechanics
from cogless.study.metric import Metric
from cogless.study.motor import Motor
from cogless.study.scenario import Scenario
from cogless.study.table import Frequency, Many, Table


class Assumption(Table):
    """Something that the study's author had to suppose."""

    about: str
    reason: str


class TraceSettings(Table):
    """What is recorded."""

    rate: Frequency | None = None  # Hz, divides the current-loop rate, the default
    energy: bool = False  # integrate and record the energies too


@dataclass(frozen=True)
class Source:
    """Where a study came from: its file, its datasheet's, and its tables as read (texts with units)."""

    path: Path
    tables: dict[str, Any]
    datasheet: Path | None = None
    own_motor_keys: frozenset[str] = frozenset()  # keys of [motor] that the study itself sets


class Study(Table):
    """A validated study, all SI. Made by `cogless.study.load`."""

    title: str
    seed: Annotated[int, Field(ge=0, lt=2**64)] = 0
    description: str = ""
    assumption: Many[Assumption] = ()
    trace: TraceSettings = TraceSettings()
    motor: Motor
    mechanics: Mechanics
    drive: Drive
    scenario: Annotated[dict[str, Scenario], Field(min_length=1)]
    controller: Annotated[dict[str, Controller], Field(min_length=1)]
    metric: Many[Metric] = ()
    calibration: Calibration | None = None
    _source: Source = PrivateAttr()

    @model_validator(mode="after")
    def _consistent(self, info: ValidationInfo) -> Self:
        one_scenario = bool(info.context)
        for check in checks.ALL if one_scenario else (*checks.ALL, *checks.WHOLE):
            check(self)
        return self

    @property
    def source(self) -> Source:
        """The file and the tables that this study was read from."""
        return self._source

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self._source.path.stem

    @property
    def belief(self) -> StarBelief:
        """What the controller thinks of the motor."""
        return self.drive.belief.resolved(self.motor.star())

    @property
    def trace_rate(self) -> float:
        """Recorded rows per second, Hz."""
        return self.trace.rate or self.drive.rates.current_loop

    @property
    def baseline(self) -> str:
        """Name of the controller that ratios are against."""
        marked = [name for name, controller in self.controller.items() if controller.baseline]
        return marked[0] if marked else next(iter(self.controller))

    def label(self, controller: str) -> str:
        """A controller's name in tables and report."""
        return self.controller[controller].label or controller

    def controllers_in(self, scenario: str) -> tuple[str, ...]:
        """Names of the controllers that run in a scenario."""
        return checks.controllers_in(self, scenario)

    def metrics_in(self, scenario: str) -> tuple[Metric, ...]:
        """The metrics that apply to a scenario."""
        here = self.scenario[scenario]
        return tuple(metric for metric in self.metric if checks.applies(metric, scenario, here))
