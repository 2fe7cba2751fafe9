"""The metrics of a study as columns of plain numbers: one for each order or phase."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cogless.results.metrics import Value, result_name
from cogless.study import AnyStudy, TrialStudy
from cogless.study.metric import EACH_PHASE, EACH_TRIAL, Metric

LAST = "last"  # part of a metric with a number per trial


@dataclass(frozen=True)
class Column:
    """A column of metrics. `part`: order, phase from 1, or LAST, of a metric that is a list."""

    metric: Metric
    place: int | None = None  # in the metric's list
    part: str = ""

    @property
    def name(self) -> str:
        """Name in the table: as in results.json, with the part after a dot."""
        return result_name(self.metric) + (f".{self.part}" if self.part else "")

    @property
    def spoken(self) -> str:
        """Name as the study has it, with the part after a dot."""
        return self.metric.name + (f".{self.part}" if self.part else "")

    def of(self, metrics: Mapping[str, Value]) -> float | None:
        """The number of a run; None: never, not to be had, or not taken in its scenario."""
        value = metrics.get(result_name(self.metric))
        if isinstance(value, list):
            place = -1 if self.place is None else self.place
            value = value[place] if place < len(value) else None
        return value if value is not None and math.isfinite(value) else None


def columns(study: AnyStudy) -> list[Column]:
    """The columns of a study's metrics, in its order."""
    found: dict[str, Column] = {}
    for metric in study.metric:
        for column in _parts(study, metric):
            found.setdefault(column.name, column)
    return list(found.values())


def _parts(study: AnyStudy, metric: Metric) -> list[Column]:
    if metric.kind == "order":
        return [Column(metric, place, f"{order:g}") for place, order in enumerate(metric.order or ())]
    if isinstance(study, TrialStudy) and metric.kind in EACH_PHASE:
        phases = max(len(scenario.starts) for scenario in study.scenario.values())
        return [Column(metric, place, f"{place + 1}") for place in range(phases)]
    if isinstance(study, TrialStudy) and metric.kind in EACH_TRIAL:
        return [Column(metric, None, LAST)]
    return [Column(metric)]
