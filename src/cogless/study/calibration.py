"""Tables for `cogless calibrate`: parameters of a study to fit, and target values of its metrics."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, field_validator

from cogless.study.metric import Metric
from cogless.study.table import Many, Quantity, Table, invalid


class FitParameter(Table):
    """A parameter to fit: a dotted key of the study, or of one scenario's overrides.

    Initial value and bounds are texts with a unit, or numbers in the unit that the study uses at this key.
    """

    key: str
    scenario: str | None = None
    initial: str | float | None = None  # default: the study's value
    lower: str | float | None = None
    upper: str | float | None = None


class Target(Table):
    """The value that a metric should have in a run; a list for kind "order" and in studies of trials."""

    scenario: str
    controller: str
    metric: str
    value: Any
    weight: Annotated[float, Field(gt=0)] = 1.0

    def values(self, metric: Metric, count: int) -> tuple[float, ...]:
        """The target values in SI; raises an error if there aren't `count` of them or one is invalid."""
        wanted = self.value if isinstance(self.value, list) else [self.value]
        if len(wanted) != count:
            raise invalid(f"expected {count} values", "value")
        quantity = Quantity(metric.dimension, bare=not metric.dimension.unit)
        return tuple(quantity.read(value) for value in wanted)


class Calibration(Table):
    """A fit of parameters by least squares of the relative deviations from the targets."""

    parameters: Many[FitParameter]
    targets: Many[Target]

    @field_validator("parameters", "targets")
    @classmethod
    def _some(cls, value: tuple[Any, ...]) -> tuple[Any, ...]:
        if not value:
            raise invalid("expected one or more")
        return value
