"""The drive: rates, current loop, inverter, sensors, and the motor parameters that the controller assumes.

Settings of the monitor that checks a drive's measurements, and of the measure of learning quality.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from cogless.control_library import whole_number
from cogless.study.motor import StarMotor
from cogless.study.position_sensor import ORDER_MAX, Counted, IdealSensor, PositionSensor
from cogless.study.table import (
    AngleMagnitude,
    AngularSpeedMagnitude,
    Current,
    CurrentGain,
    CurrentIntegralGain,
    CurrentLimit,
    CurrentMagnitude,
    Duration,
    FluxLinkage,
    Frequency,
    Inductance,
    NumberGain,
    Resistance,
    Span,
    Table,
    Time,
    Voltage,
    VoltageMagnitude,
    check_precision,
    check_sizes,
    invalid,
)
from cogless.units import TURN


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


ENCODER_TABLE_ORDERS = whole_number("CGL_ENCODER_TABLE_ORDERS")
SETTLED_TIMES = 10.0  # time constants after which its observer has settled: encoder_table.c
PAST_MAX = 100_000  # longest delay in current-loop periods
PERIODS_MAX = 5e8  # largest number of periods that the controller counts
OUTER_LOOPS = ("speed_loop", "position_loop")


class Belief(Table):
    """Motor parameters that the controller assumes, per winding as in [motor]; default: the true values."""

    R_s: Resistance | None = None  # ohm
    L_d: Inductance | None = None  # H
    L_q: Inductance | None = None  # H
    psi_f: FluxLinkage | None = None  # Wb

    def resolved(self, motor: StarMotor) -> StarBelief:
        """The assumed parameters converted to the star equivalent; those that are left out are the true
        ones."""

        def believed(value: float | None, factor: float, truth: float) -> float:
            return truth if value is None else factor * value

        return StarBelief(
            R_s=believed(self.R_s, motor.impedance_factor, motor.R_s),
            L_d=believed(self.L_d, motor.impedance_factor, motor.L_d),
            L_q=believed(self.L_q, motor.impedance_factor, motor.L_q),
            psi_f=believed(self.psi_f, motor.flux_factor, motor.psi_f),
        )


@dataclass(frozen=True)
class StarBelief:
    """Parameters of the motor's star equivalent that the controller assumes, all SI."""

    R_s: float  # ohm
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Wb


class Rates(Table):
    """Rates of the loops. The outer loop runs at every n-th current-loop period."""

    current_loop: Frequency  # Hz, whole
    # outer loop (speed, or position in trials): a whole number of Hz that divides current_loop
    speed_loop: Frequency | None = None
    position_loop: Frequency | None = None
    integration_steps: Annotated[int, Field(ge=1, le=10_000)] = 1  # RK4 steps per current-loop period

    @model_validator(mode="after")
    def _divide(self) -> Self:
        given = [name for name in OUTER_LOOPS if getattr(self, name) is not None]
        if len(given) != 1:
            raise invalid("expected either speed_loop or, in trials, position_loop")
        for name in ("current_loop", *given):
            if getattr(self, name) % 1:
                raise invalid('expected a whole number of Hz, such as "1 kHz"', name)
        if self.current_loop % self.outer_loop:
            expected = f"expected a rate that divides current_loop, {self.current_loop:g} Hz"
            raise invalid(expected, given[0])
        return self

    @property
    def outer_loop(self) -> float:
        """Rate of the outer loop, in which the control law runs, Hz."""
        return self.speed_loop or self.position_loop or math.nan

    @property
    def divider(self) -> int:
        """Number of current-loop periods per outer-loop period."""
        return round(self.current_loop / self.outer_loop)


class CurrentLoop(Table):
    """The current controllers of the d and q axis, given by kp and ki, or by a bandwidth."""

    IN_PLACE: ClassVar[dict[str, str]] = dict.fromkeys(
        ("max_current", "current_max", "i_max"), "current_limit"
    )

    kp: CurrentGain | None = None  # V/A
    ki: CurrentIntegralGain | None = None  # V/A/s
    bandwidth: Frequency | None = None  # Hz: kp = w L, ki = w R_s with the assumed L, R_s; w = 2 pi bandwidth
    decoupling: bool = True
    current_limit: CurrentLimit  # A, limit of the reference vector's length

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        check_sizes(self)
        return self

    @model_validator(mode="after")
    def _gains_or_bandwidth(self) -> Self:
        gains = (self.kp is not None, self.ki is not None)
        if gains not in ((True, True), (False, False)) or all(gains) == (self.bandwidth is not None):
            raise invalid('expected either kp and ki or bandwidth, such as "800 Hz"')
        return self

    def gains(self, belief: StarBelief) -> dict[str, float]:
        """Gains of both axes: kp_d, kp_q in V/A; ki_d, ki_q in V/A/s."""
        if self.bandwidth is None:
            kp, ki = self.kp or 0.0, self.ki or 0.0
            return {"kp_d": kp, "ki_d": ki, "kp_q": kp, "ki_q": ki}
        w = TURN * self.bandwidth
        ki = w * belief.R_s
        return {"kp_d": w * belief.L_d, "ki_d": ki, "kp_q": w * belief.L_q, "ki_q": ki}


class IdealCurrentLoop(Table):
    """An ideal current loop: the current equals its reference at once."""

    kind: Literal["ideal"]
    current_limit: CurrentLimit  # A
    decoupling: ClassVar[bool] = False

    def gains(self, belief: StarBelief) -> dict[str, float]:
        """Zero gains, since an ideal loop has no current controllers."""
        return dict.fromkeys(("kp_d", "ki_d", "kp_q", "ki_q"), 0.0)

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        check_sizes(self)
        return self


def _kind(data: Any) -> str:
    kind = data.get("kind") if isinstance(data, dict) else getattr(data, "kind", None)
    return "pi" if kind is None else "ideal"


AnyCurrentLoop = Annotated[
    Annotated[CurrentLoop, Tag("pi")] | Annotated[IdealCurrentLoop, Tag("ideal")], Discriminator(_kind)
]


class Inverter(Table):
    """The inverter: voltage averaged over each current-loop period, or switched with centre-aligned edges."""

    kind: Literal["averaged", "switched"] = "averaged"
    bus_voltage: Voltage  # V
    dead_time: Time = 0.0  # s
    device_drop: VoltageMagnitude = 0.0  # V, across the transistor or diode that conducts
    computation_delay: Literal[0, 1] = 1  # current-loop samples


class DeadTimeCompensation(Table):
    """Correction of the duty cycles by the signs of the phase currents' references."""

    time: Time | None = None  # s, as the controller believes it; default: the inverter's
    drop: VoltageMagnitude | None = None  # V, likewise
    band: CurrentLimit  # A: below it a phase gets a part of the correction


class EncoderTable(Table):
    """Correction of the position sensor's own error, learned while the motor turns fast."""

    orders: Annotated[tuple[int, ...], Field(strict=False)]  # mechanical
    omega_min: AngularSpeedMagnitude  # rad/s: learns above it
    time_constant: Duration = 0.5  # s, of learning
    limit: Span = math.radians(2)  # rad, of each coefficient

    @model_validator(mode="after")
    def _rising(self) -> Self:
        rising = all(a < b for a, b in pairwise((0, *self.orders, ORDER_MAX + 1)))
        if not rising or not 1 <= len(self.orders) <= ENCODER_TABLE_ORDERS:
            raise invalid(
                f"expected 1 to {ENCODER_TABLE_ORDERS} orders that rise, from 1 to {ORDER_MAX}", "orders"
            )
        if self.limit * self.orders[-1] > 1:
            raise invalid(f"expected at most {1 / self.orders[-1]:.3g} rad", "limit")
        if not self.omega_min:
            raise invalid("expected a speed above zero", "omega_min")
        return self

    @property
    def bandwidth(self) -> float:
        """Bandwidth of the observer that predicts the angle, rad/s: far below the lowest order."""
        return self.omega_min * self.orders[0] / 4

    @property
    def settling(self) -> float:
        """Time above omega_min after which the observer has settled and learning begins, s."""
        return SETTLED_TIMES / self.bandwidth


class CurrentSensors(Table):
    """Phase current sensors with an error per phase, and their analog-to-digital converter."""

    offset: tuple[Current, Current, Current] = Field(default=(0.0, 0.0, 0.0), strict=False)  # A
    gain_error: tuple[float, float, float] = Field(default=(0.0, 0.0, 0.0), strict=False)
    noise: CurrentMagnitude = 0.0  # A rms
    bits: Annotated[int, Field(ge=0, le=32)] = 0  # 0: no converter
    range: CurrentLimit = 10.0  # A: the converter spans +-range
    sensors: Literal[2, 3] = 3  # 2: i_c = -i_a - i_b


class Bus(Table):
    """A bus between the drive and its law, which runs elsewhere, as on a PC."""

    delay_measured: Time = 0.0  # s, age of angle and speed when the law gets them
    delay_command: Time = 0.0  # s, from the law's step until its current reference acts
    jitter: Time = 0.0  # s, the most by which either may take longer
    quantum: CurrentMagnitude = 0.0  # A, of the current reference

    @property
    def mean_delay(self) -> float:
        """Mean delay of both ways together, s."""
        return self.delay_measured + self.delay_command + self.jitter


class Drive(Table):
    """Power electronics, sensors, current loop and monitor."""

    precision: Literal["single", "double"] = "single"
    belief: Belief = Belief()
    rates: Rates = Field(examples=['{ current_loop = "10 kHz", speed_loop = "1 kHz" }'])
    current_loop: AnyCurrentLoop = Field(examples=['{ bandwidth = "1 kHz", current_limit = "4 A" }'])
    inverter: Inverter | None = None  # not with an ideal current loop
    dead_time_compensation: DeadTimeCompensation | None = None  # likewise
    position_sensor: PositionSensor = IdealSensor()
    encoder_table: EncoderTable | None = None
    speed_filter: Frequency | None = None  # Hz, low-pass of first order behind the measured speed
    bus: Bus | None = None
    current_sensors: CurrentSensors = CurrentSensors()
    monitor: Monitor = Monitor()
    quality: Quality = Quality()
    guard: bool = True  # learning that leaves more ripple than the feedback alone is stopped

    @model_validator(mode="after")
    def _bridge(self) -> Self:
        if self.ideal and self.inverter is not None:
            raise invalid("expected none, since the current loop is ideal", "inverter")
        if not self.ideal and self.inverter is None:
            raise invalid("expected a table of bus_voltage, ...", "inverter", value="missing")
        if self.dead_time_compensation is None:
            return self
        if self.ideal:
            raise invalid("expected none, since the current loop is ideal", "dead_time_compensation")
        check_sizes(self.dead_time_compensation, "dead_time_compensation")
        return self

    @model_validator(mode="after")
    def _correctable(self) -> Self:
        """Refuse to correct a sensor that has no error by orders of its own revolution."""
        if self.encoder_table is not None and not isinstance(self.position_sensor, Counted):
            expected = "expected none, unless the position sensor is an encoder, absolute or a resolver"
            raise invalid(expected, "encoder_table")
        return self

    @model_validator(mode="after")
    def _observable(self) -> Self:
        """Refuse an observer that is faster than the current loop's sampling lets it be."""
        sensor, fastest = self.position_sensor, self.rates.current_loop / math.pi
        expected = f"expected at most {fastest:.4g} Hz, a third of current_loop"
        if isinstance(sensor, Counted) and (sensor.observer_bandwidth or 0.0) > fastest:
            raise invalid(expected, "position_sensor", "observer_bandwidth")
        if (self.speed_filter or 0.0) > fastest:
            raise invalid(expected, "speed_filter")
        return self

    @model_validator(mode="after")
    def _remembered(self) -> Self:
        """Refuse delays that are longer than a drive's memory of them."""
        longest, rate = PAST_MAX / self.rates.current_loop, self.rates.current_loop
        sensor, bus = self.position_sensor, self.bus
        found = {"position_sensor.latency": sensor.latency} if isinstance(sensor, Counted) else {}
        if bus is not None:
            keys = ("delay_measured", "delay_command", "jitter")
            found |= {f"bus.{key}": getattr(bus, key) for key in keys}
        for key, delay in found.items():
            if delay > longest:
                expected = f"expected at most {longest:g} s, {PAST_MAX} periods of {rate:g} Hz"
                raise invalid(expected, *key.split("."))
        return self

    @model_validator(mode="after")
    def _watchable(self) -> Self:
        """Refuse monitor and quality settings that the controller's numbers or counters of periods can't
        hold."""
        rate, law_rate = self.rates.current_loop, self.rates.outer_loop
        for name in ("speed_window", "bridge", "hold"):
            time = getattr(self.monitor, name)
            if time is not None and time * rate > PERIODS_MAX:
                raise invalid(f"expected {PERIODS_MAX / rate:g} s or less", "monitor", name)
        if not 1 <= self.quality.longest * law_rate <= PERIODS_MAX:
            expected = f"expected {1 / law_rate:g} s to {PERIODS_MAX / law_rate:g} s"
            raise invalid(expected, "quality", "longest")
        check_precision(self.monitor, self.precision, "monitor")
        check_precision(self.quality, self.precision, "quality")
        return self

    @property
    def advance(self) -> float:
        """Current-loop periods from sampling to the middle of the period in which the voltage acts."""
        return 1.5 if self.inverter is not None and self.inverter.computation_delay else 0.5

    @property
    def ideal(self) -> bool:
        """Whether the current loop is ideal."""
        return isinstance(self.current_loop, IdealCurrentLoop)
