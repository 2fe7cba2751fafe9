"""Charts as data: makers return them, `to_page` turns them into the page's JSON, pictures.py draws them.

In the JSON a field has its own name, or the one in its metadata `key`. A field at its default is left out.
Arrays become numbers, or packed 16-bit integers where they may be long.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from cogless.report.markup import pack, plain
from cogless.results.trace import Array

PACKED = {"of_array": pack}


def to_page(value: Any, of_array: Any = plain) -> Any:
    """A chart, or whatever holds charts, as plain values for JSON."""
    if is_dataclass(value):
        taken = ((f, getattr(value, f.name)) for f in fields(value))
        return {
            f.metadata.get("key", f.name): to_page(x, f.metadata.get("of_array", plain))
            for f, x in taken
            if x is not f.default
        }
    if isinstance(value, np.ndarray):
        return of_array(value)
    if isinstance(value, Mapping):
        return {name: to_page(x, of_array) for name, x in value.items()}
    if isinstance(value, list | tuple):
        return [to_page(x, of_array) for x in value]
    return value


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """The values of a controller or a reference.

    `controller`: the controller's place on the page; None for a reference. `fade`: the share of its colour.
    """

    controller: int | None = None
    label: str | None = None
    fade: float | None = None
    dash: bool = False
    values: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Bars(Series):
    """Bars; `early`: the values with which the controller began."""

    early: Array | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Band(Series):
    low: Array
    high: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve(Series):
    """A series of many values. `text`: its value as text; `details`: values on the group's finer grids."""

    values: Array = field(metadata=PACKED)
    text: str | None = None
    details: Sequence[Array] | None = field(default=None, metadata=PACKED)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrialCurves:
    """A controller's values in chosen trials, by their numbers."""

    controller: int
    trials: Mapping[str, Array] = field(metadata=PACKED)


@dataclass(frozen=True)
class Span:
    """A time span, s, that is marked."""

    begin: float = field(metadata={"key": "from"})
    end: float = field(metadata={"key": "to"})
    label: str


@dataclass(frozen=True)
class Zoom:
    """A button that shows a part of the plots. `first`: whether this part is shown at first."""

    name: str
    begin: float = field(metadata={"key": "from"})
    end: float = field(metadata={"key": "to"})
    first: bool = False


@dataclass(frozen=True)
class Grid:
    start: float
    step: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Chart:
    """Lines, or bars, of a quantity in its unit over x. A chart without `x` is in a group with a common x."""

    title: str
    x: str | None = None
    quantity: str
    unit: str
    series: Sequence[Any]

    @property
    def y(self) -> str:
        return f"{self.quantity} ({self.unit})" if self.unit else self.quantity


@dataclass(frozen=True, eq=False, kw_only=True)
class OverGrid(Chart):
    """Curves at a constant step. `x_unit`: the unit of `start` and `step`.

    `cycles`: how often a curve goes up and down; `holds`: when learning was held back.
    """

    start: float
    step: float
    x_unit: str | None = field(default=None, metadata={"key": "about"})
    cycles: int | None = None
    holds: Sequence[Span] | None = field(default=None, metadata={"key": "held"})


@dataclass(frozen=True, eq=False, kw_only=True)
class Spectrum(Chart):
    orders: Sequence[int]


@dataclass(frozen=True, eq=False, kw_only=True)
class OverAngle(Chart):
    angle: Sequence[float]  # deg


@dataclass(frozen=True)
class Grown:
    """A frequency, Hz, that grew in a run."""

    controller: int
    at: float


@dataclass(frozen=True, eq=False, kw_only=True)
class OverFrequency(Chart):
    frequency: Array  # Hz
    marks: Sequence[Grown] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class OverRun(Chart):
    """Values piece by piece, along the time or the speed."""

    along: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class OverVariants(Chart):
    """Values of a sweep's variants, and their limit in the unit."""

    xs: Array
    limit: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class OverTrials(Chart):
    """A value of each trial, as a decimal logarithm; `note`: which trials have none."""

    note: str
    floor: float | None = None
    floor_name: str | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class TrialPanel(Chart):
    """Curves of chosen trials, with the reference of each phase."""

    references: Sequence[Array] = field(metadata=PACKED)


@dataclass(frozen=True, eq=False)
class Waterfall:
    """Amplitudes of a controller by speed and order, row by row; `quantity` is that of the speeds."""

    title: str
    x: str
    quantity: str
    unit: str
    controller: int
    top: float
    speeds: Array
    orders: int
    values: Array = field(metadata=PACKED)


@dataclass(frozen=True, eq=False)
class Polar:
    title: str
    unit: str
    series: Sequence[Band]


@dataclass(frozen=True)
class LaneRun:
    """A run's times, s, at which a state began, ended, began again, and so on."""

    controller: int
    spans: Sequence[float]


@dataclass(frozen=True)
class Lane:
    """When a state was active, run by run."""

    name: str
    runs: Sequence[LaneRun]


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Panels on a grid in time, with parts on finer grids."""

    panels: Sequence[Chart]
    x: str = ""
    start: float = math.nan
    step: float = math.nan
    details: Sequence[Grid] = ()


@dataclass(frozen=True)
class ChosenTrials:
    name: str
    trials: Sequence[int]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrialWaveforms:
    """Panels on a grid in the time of a trial; `phases`: the chosen trials of each phase."""

    panels: Sequence[TrialPanel]
    phases: Sequence[ChosenTrials]
    note: str
    x: str = ""
    start: float = math.nan
    step: float = math.nan


@dataclass(frozen=True)
class Changed:
    """What changes at a trial."""

    trial: int
    name: str


@dataclass(frozen=True, eq=False)
class Trials:
    charts: Sequence[OverTrials]
    trials: int
    marks: Sequence[Changed]
    zooms: Sequence[Zoom]


@dataclass(frozen=True, eq=False, kw_only=True)
class SpeedCharts:
    """All charts of a scenario of speed."""

    answer: Sequence[OverGrid]
    waveforms: Waveforms
    zooms: Sequence[Zoom]
    marks: Sequence[Span]
    strip: Sequence[Lane]
    spectra: Sequence[Spectrum]
    maps: Sequence[OverAngle]
    polar: Sequence[Polar]
    angle: Sequence[OverAngle]
    criterion: Sequence[OverFrequency]
    bode: Sequence[OverFrequency]
    events: Sequence[Waveforms]
    waterfall: Sequence[Waterfall]
    tracking: Sequence[OverRun]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrialCharts:
    """All charts of a scenario of trials."""

    answer: Sequence[OverGrid]
    over_trials: Trials
    waveforms: TrialWaveforms
    certificate: Sequence[OverFrequency]


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepCharts:
    """All charts of a scenario of a sweep."""

    spreads: Sequence[OverVariants]
    scatter: Sequence[OverVariants]
