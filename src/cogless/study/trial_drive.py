"""The drive of a study of trials: as in a speed study but for the outer loop; an ideal current loop too."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cogless.study.drive import (
    AnyCurrentLoop,
    Belief,
    CurrentSensors,
    IdealCurrentLoop,
    IdealSensor,
    Inverter,
    PositionSensor,
    require_inverter,
    require_watchable,
)
from cogless.study.monitor import Monitor, Quality
from cogless.study.table import Frequency, Table, invalid


class TrialRates(Table):
    """Rates of the loops. The position loop runs at every n-th current-loop period."""

    current_loop: Frequency  # Hz, whole
    position_loop: Frequency  # Hz, whole, divides current_loop
    integration_steps: Annotated[int, Field(ge=1, le=10_000)] = 1  # RK4 steps in a current-loop period

    @model_validator(mode="after")
    def _divide(self) -> Self:
        for name in ("current_loop", "position_loop"):
            if getattr(self, name) % 1:
                raise invalid('expected a whole number of Hz, such as "1 kHz"', name)
        if self.current_loop % self.position_loop:
            expected = f"expected a rate that divides current_loop, {self.current_loop:g} Hz"
            raise invalid(expected, "position_loop")
        return self

    @property
    def divider(self) -> int:
        """Current-loop periods in a position-loop period."""
        return round(self.current_loop / self.position_loop)


class TrialDrive(Table):
    """Power electronics, sensors and the inner loop."""

    precision: Literal["single", "double"] = "single"
    belief: Belief = Belief()
    rates: TrialRates
    current_loop: AnyCurrentLoop
    inverter: Inverter | None = None  # not with an ideal current loop
    position_sensor: PositionSensor = IdealSensor()
    current_sensors: CurrentSensors = CurrentSensors()
    monitor: Monitor = Monitor()
    quality: Quality = Quality()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        require_inverter(self.current_loop, self.inverter)
        rates = self.rates
        require_watchable(self.monitor, self.quality, self.precision, rates.current_loop, rates.position_loop)
        return self

    @property
    def ideal(self) -> bool:
        """Whether the current loop is."""
        return isinstance(self.current_loop, IdealCurrentLoop)
