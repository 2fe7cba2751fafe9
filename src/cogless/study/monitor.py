"""Settings of the monitor that checks a drive's measurements, and of the measure of learning quality."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from cogless.study.table import (
    AngleMagnitude,
    AngularSpeedMagnitude,
    CurrentMagnitude,
    Duration,
    NumberGain,
    Span,
    Table,
    Time,
    invalid,
)


class Monitor(Table):
    """Bounds of plausible measurements. Zero: not checked. The defaults are derived from the drive."""

    omega_max: AngularSpeedMagnitude | None = None  # rad/s, mechanical
    angle_step: AngleMagnitude | None = None  # rad, mechanical
    speed_window: Time | None = None  # s
    stuck_angle: AngleMagnitude | None = None  # rad, mechanical
    stuck_time: Time | None = None  # s
    current_max: CurrentMagnitude | None = None  # A
    current_sum: CurrentMagnitude | None = None  # A
    bridge: Time | None = None  # s
    hold: Time | None = None  # s


class Quality(Table):
    """Settings of the residual ripple: its window, and which speed errors are outliers, excluded from
    learning."""

    span: Span | None = None  # rad, mechanical, turned per window; default: a revolution
    longest: Duration = 60.0  # s
    outlier: NumberGain = 0.0  # bound, in multiples of the usual error; 0: none
    floor: AngularSpeedMagnitude = 0.0  # rad/s

    @model_validator(mode="after")
    def _outlier(self) -> Self:
        if 0 < self.outlier < 1:
            raise invalid("expected 1 or more, or 0 for none", "outlier")
        return self
