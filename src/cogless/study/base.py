"""Base of both kinds of study: title, seed, assumptions, scenarios, controllers, metrics, source."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from cogless.study.calibration import Calibration
from cogless.study.controller import Base
from cogless.study.metric import Metric
from cogless.study.table import Frequency, Line, Many, StudyKeys, Table
from cogless.study.vary import Tune, Vary

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class Assumption(Table):
    """Something that the study's author had to assume, and the reason."""

    about: str
    reason: str


@dataclass(frozen=True)
class Source:
    """Source of a study: path of its file, its tables as read (values as texts with units), datasheet path.

    `directory`: the file's, absolute, since a law may change the one that the command runs in.
    """

    path: Path
    tables: dict[str, Any]
    datasheet: Path | None = None
    own_motor_keys: frozenset[str] = frozenset()  # keys of [motor] set in the study, not by the datasheet
    directory: Path | None = None

    @property
    def folder(self) -> Path:
        """The folder that the files of the study are named from."""
        return self.directory or self.path.parent


class TraceSettings(Table):
    """Settings of the trace, the signals recorded in a run."""

    # Hz, must divide the current-loop rate; default: that rate, or in trials one row per sample
    rate: Frequency | None = None
    file_rate: Frequency = 1000.0  # Hz, rows of traces.nc at most; in trials all rows are there
    energy: bool = False  # also integrate and record the energies


class StudyBase(Table):
    """Tables that speed studies and studies of trials have in common."""

    title: Line
    seed: Annotated[int, Field(ge=0, lt=2**64)] = 0
    description: str = ""
    assumption: Many[Assumption] = ()
    trace: TraceSettings = TraceSettings()
    scenario: Mapping[str, Any]
    controller: Mapping[str, Base]
    metric: Many[Metric] = ()
    calibration: Calibration | None = None
    vary: Annotated[Vary, StudyKeys()] | None = None
    tune: Tune | None = None
    _source: Source = PrivateAttr()
    _made: dict[Hashable, Any] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _consistent(self, info: ValidationInfo) -> Self:
        """Run the checks that concern several tables; the module `reading` passes them in the context."""
        for check in info.context["checks"] if info.context else ():
            check(self)
        return self

    @property
    def source(self) -> Source:
        """The file and the tables that this study was read from."""
        assert self.__pydantic_private__ is not None  # by its name it takes ten times as long
        source: Source = self.__pydantic_private__["_source"]
        return source

    def once(self, make: Callable[[Self, K], T], of: K) -> T:
        """Return make(self, of). It is computed at the first call and kept, since it takes long."""
        key = (make, of)
        if key not in self._made:
            self._made[key] = make(self, of)
        made: T = self._made[key]
        return made

    @property
    def name(self) -> str:
        """The file's name without suffix."""
        return self._source.path.stem

    @property
    def baseline(self) -> str:
        """Name of the baseline controller: ratios in tables are relative to its values."""
        marked = [name for name, controller in self.controller.items() if controller.baseline]
        return marked[0] if marked else next(iter(self.controller))

    def label(self, controller: str) -> str:
        """Name of a controller as shown in tables and report."""
        return self.controller[controller].label or controller

    def controllers_in(self, scenario: str) -> tuple[str, ...]:
        """Names of the controllers that run in a scenario."""
        chosen = self.scenario[scenario].controllers
        return tuple(self.controller) if chosen is None else tuple(chosen)

    def scenarios_of(self, controller: str) -> list[str]:
        """Names of the scenarios that a controller runs in."""
        return [name for name in self.scenario if controller in self.controllers_in(name)]

    def metrics_in(self, scenario: str) -> tuple[Metric, ...]:
        """The metrics that are evaluated in a scenario."""
        return tuple(m for m in self.metric if m.applies_in(scenario, self.scenario[scenario]))

    def values_of(self, metric: Metric, scenario: str) -> int:
        """Number of values of a metric: one, or for kind "order" one per order."""
        return len(metric.order or ()) if metric.kind == "order" else 1
