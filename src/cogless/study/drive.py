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
    excluded,
    invalid,
)
from cogless.units import TURN


class Monitor(Table):
    """Bounds of plausible measurements. Zero: not checked. The defaults are derived from the drive."""

    omega_max: AngularSpeedMagnitude | None = None  # rad/s
    """Largest plausible magnitude of the rotor's speed; a faster measured speed [counts as
    missing](/laws/monitor.md#what-the-monitor-watches). Default: 1.5 times the no-load speed, and
    more with `field_weakening`; but at least the no-load speed plus the resolution of the measured speed. The
    no-load speed follows from the bus voltage and the `psi_f` that the controller assumes. With an ideal
    current loop: no check."""
    angle_step: AngleMagnitude | None = None  # rad
    """Resolution of the measured angle. In a current-loop period the angle may change by `omega_max` times
    this period plus `angle_step`; a larger change is a [jump](/laws/monitor.md#jumps). Default: one step of
    the position sensor; 1.5 steps with Hall sensors."""
    speed_window: Time | None = None  # s
    """Time over which the position sensor measures the speed. For this time after a jump of the angle the
    measured speed is not plausible. Default: with an ideal sensor 0; with the `speed_method` `average` the
    sensor's key `window`; with the `speed_method` `observer` ten time constants of the observer; otherwise
    two periods of the law. A `speed_filter` adds ten of its time constants."""
    stuck_angle: AngleMagnitude | None = None  # rad
    """The measured angle counts as [stuck](/laws/monitor.md#a-stuck-angle) only if it is constant while the
    reference speed would turn the rotor by more than `stuck_angle`. Default: 0.5 rad plus two steps of the
    position sensor, but at least four of its steps."""
    stuck_time: Time | None = None  # s
    """The measured angle counts as stuck only if [full current](/laws/monitor.md#a-stuck-angle) for the time
    `stuck_time` has not changed it. Default: the time in which a tenth of the largest torque turns the
    inertia by one step of the position sensor, but at least 100 ms."""
    current_max: CurrentMagnitude | None = None  # A
    """Largest plausible length of the measured current vector. Default: twice `current_limit`, but at least
    `current_limit` plus six standard deviations of the current sensors' noise."""
    current_sum: CurrentMagnitude | None = None  # A
    """Largest plausible magnitude of $i_a + i_b + i_c$. Default with three current sensors: half of
    `current_limit`, but at least six standard deviations of this sum's noise. Default with two current
    sensors: no check."""
    bridge: Time | None = None  # s
    """Longest time for which missing angles are extrapolated. If they are missing for longer, the [output
    becomes safe](/laws/monitor.md#what-the-monitor-watches). Default: 5 ms."""
    hold: Time | None = None  # s
    """Time for which the [output remains safe](/laws/monitor.md#what-the-monitor-watches) after the last
    implausible measurement. Default: 10 ms."""


class Quality(Table):
    """Settings of the residual ripple: its window, and which speed errors are outliers, excluded from
    learning."""

    span: Span | None = None  # rad
    """Length of a window, as an angle by which the rotor turns. In each window [the ripple that
    remains](/laws/monitor.md#how-good-learning-is) is measured. Default: one revolution."""
    longest: Duration = 60.0  # s
    """Longest duration of a window of `span`. At low speed a window ends after this time."""
    outlier: NumberGain = 0.0
    """The law does not learn from a speed error above `outlier` times the rms error of the last window of
    `span`. 0: the law learns from every error. Otherwise choose 1 or more."""
    floor: AngularSpeedMagnitude = 0.0  # rad/s
    """The law learns from every speed error below `floor`, even from an outlier."""

    @model_validator(mode="after")
    def _outlier(self) -> Self:
        if 0 < self.outlier < 1:
            raise invalid("expected a factor of 1 or more, or 0 to learn from every error", "outlier")
        return self


ENCODER_TABLE_ORDERS = whole_number("CGL_ENCODER_TABLE_ORDERS")
SETTLED_TIMES = 10.0  # time constants after which the observer of encoder_table.c has settled
CURRENT_MARGIN = 2.0  # largest plausible current / current limit
SUM_SHARE = 0.5  # largest plausible sum of the phases' currents / current limit
FALSE_TRIP_DEVIATIONS = 6  # standard deviations; normal noise exceeds them once in 5e8 samples: 7 h at 20 kHz
PAST_MAX = 100_000  # longest delay in current-loop periods
TRACE_ROWS_MOST = 20_000_000  # rows of one run: 4 GB with some 25 signals of 8 bytes each
PERIODS_MAX = 5e8  # largest number of periods that the controller counts
OUTER_LOOPS = ("speed_loop", "position_loop")
Make = Literal["generic", "moteus", "odrive", "vesc", "simplefoc", "stepper"]


class Belief(Table):
    """Motor parameters that the controller assumes, per winding as in [motor]; default: the true values."""

    R_s: Resistance | None = None  # ohm
    """Resistance of one winding that the controller assumes. Default: the motor's true value."""
    L_d: Inductance | None = None  # H
    """Inductance of one winding in the d axis that the controller assumes. Default: the motor's true
    value."""
    L_q: Inductance | None = None  # H
    """Inductance of one winding in the q axis that the controller assumes. Default: the motor's true
    value."""
    psi_f: FluxLinkage | None = None  # Wb
    """Flux linkage of the magnet with one winding that the controller assumes. Default: the motor's true
    value."""

    def resolved(self, motor: StarMotor) -> StarBelief:
        """The assumed parameters, converted to the star equivalent. Parameters left out have their true
        values."""

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

    current_loop: Frequency  # Hz
    """Rate at which currents are sampled, the current loop runs and the duty cycles change: a whole number of
    Hz."""
    speed_loop: Frequency | None = None
    """Rate at which a law of speed runs: a whole number of Hz that divides `current_loop`."""
    position_loop: Frequency | None = None
    """Rate of the samples of a trial, at which the law runs: a whole number of Hz that divides
    `current_loop`. [A study of trials](/guide/trial-studies.md) has this key instead of `speed_loop`."""
    integration_steps: Annotated[int, Field(ge=1, le=10_000)] = 1  # RK4 steps per current-loop period
    """Number of integration steps with which cogless simulates motor and mechanics in each current-loop
    period."""

    @model_validator(mode="after")
    def _divide(self) -> Self:
        outer_loops = [name for name in OUTER_LOOPS if getattr(self, name) is not None]
        if len(outer_loops) > 1:
            raise excluded(outer_loops[1], outer_loops[0])
        if not outer_loops:
            raise invalid("expected either speed_loop or, in trials, position_loop")
        for name in ("current_loop", *outer_loops):
            if getattr(self, name) % 1:
                raise invalid('expected a whole number of Hz, such as "1 kHz"', name)
        if self.current_loop % self.outer_loop:
            expected = f"expected a rate that divides current_loop, {self.current_loop:g} Hz"
            raise invalid(expected, outer_loops[0])
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
    """Proportional gain of the current controllers of both axes. Give `kp` and `ki`, or only `bandwidth`."""
    ki: CurrentIntegralGain | None = None  # V/A/s
    """Integral gain of the current controllers of both axes. Give `kp` and `ki`, or only `bandwidth`."""
    bandwidth: Frequency | None = None  # Hz
    r"""Bandwidth $f$ of the current loop, from which the gains follow: `kp` = $2\pi f L$, `ki` = $2\pi f
    R_s$. $L$ (inductance of the axis) and $R_s$ (resistance) are the values that the controller assumes. With
    these gains the zero of the current controller cancels the winding's pole."""
    decoupling: bool = True
    """True: the controller adds the [voltages that depend on the speed](/laws/current-loop.md#equations) to
    its output, as a feedforward."""
    current_limit: CurrentLimit  # A
    """Largest length of the vector of current references $(i_d, i_q)$."""

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        check_sizes(self)
        return self

    @model_validator(mode="after")
    def _gains_or_bandwidth(self) -> Self:
        gains = [key for key in ("kp", "ki") if getattr(self, key) is not None]
        if gains and self.bandwidth is not None:
            raise excluded("bandwidth", gains[0], instead=f"delete {' and '.join(gains)}")
        if len(gains) == 1 or not (gains or self.bandwidth):
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
    """`ideal`: the current always equals its reference, and the drive has no `inverter`. If you leave this
    key out, the current loop is simulated."""
    current_limit: CurrentLimit  # A
    """Largest length of the vector of current references $(i_d, i_q)$."""
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


class CurrentReference(Table):
    """How the torque that a law asks for becomes currents of both axes.

    With this table a law's output, its limit and the $i_q$ that it is told are equivalent q-axis currents:
    torque over $1.5 p$ times the magnets' flux.
    """

    rule: Literal["mtpa", "zero-d"] = "mtpa"
    """How the drive chooses $i_d$ below the voltage limit. `"mtpa"`: the shortest current vector that makes
    the torque. `"zero-d"`: $i_d$ is zero."""
    field_weakening: bool = False
    """True: at high speed the drive chooses $i_d$ so that the voltage stays within its limit. If no $i_d$ is
    sufficient, the drive reduces the torque. False: $i_d$ follows only from `rule`."""
    voltage_share: Annotated[float, Field(gt=0, le=1)] = 0.95
    """Voltage limit of `field_weakening`, as a share of the inverter's largest voltage. The rest is left for
    the current controllers."""


REACH_SHARE = 1 - 1e-5  # factor on the largest equivalent current: not above the C library's rounded value


class Inverter(Table):
    """The inverter: voltage averaged over each current-loop period, or switched with exact edges."""

    kind: Literal["averaged", "switched"] = "averaged"
    """`averaged`: the simulated voltage is the mean of each current-loop period. `switched`: each pulse is
    simulated with its exact edges."""
    pwm: Literal["centre", "edge", "two-updates"] = "centre"
    """Place of the pulses. `centre`: in the middle of each current-loop period. `edge`: from the beginning of
    each current-loop period. `two-updates`: in the middle of a PWM period of two current-loop periods, with
    new duty cycles in each half."""
    bus_voltage: Voltage  # V
    """Voltage of the bus, which is constant."""
    dead_time: Time = 0.0  # s
    """Time for which both transistors of a leg are off whenever the leg switches."""
    minimum_pulse: Time = 0.0  # s
    """[Shortest time](/theory/inverter.md#minimum-pulse) for which a transistor may be on in half a PWM
    period (with `pwm = "edge"`: in a whole PWM period). A transistor that would be on for a shorter time
    stays off, and the other transistor of its leg stays on. Default: no limit."""
    device_drop: VoltageMagnitude = 0.0  # V
    """Voltage drop of the conducting transistor or diode of a leg."""
    computation_delay: Literal[0, 1] = 1  # current-loop samples
    """Delay from the sampling of the currents until the resulting duty cycles act, in current-loop
    periods."""

    @property
    def switches(self) -> bool:
        """Whether there are pulses."""
        return self.kind == "switched"

    @property
    def edge_share(self) -> float:
        """Share of the current-loop periods in which a leg loses a dead time at an edge."""
        return 0.5 if self.pwm == "two-updates" else 1.0


class DeadTimeCompensation(Table):
    """Correction of the duty cycles by the signs of the phase currents' references."""

    time: Time | None = None  # s
    """Dead time of the inverter that the compensation assumes. Default: the inverter's `dead_time`."""
    drop: VoltageMagnitude | None = None  # V
    """Voltage drop of a conducting transistor or diode that the compensation assumes. Default: the inverter's
    `device_drop`."""
    band: CurrentLimit  # A
    """Phase current below which the correction is reduced in proportion to the current. Choose several times
    the noise of the current sensors."""


class EncoderTable(Table):
    """Correction of the position sensor's own error, learned while the motor turns fast."""

    orders: Annotated[tuple[int, ...], Field(strict=False)]  # mechanical
    """Orders of the sensor's angle error that are corrected, in waves per mechanical revolution. An eccentric
    encoder has an error of order 1, and also one of order 2."""
    omega_min: AngularSpeedMagnitude  # rad/s
    """Speed of the motor above which the correction is learned."""
    time_constant: Duration = 0.5  # s
    """Time constant with which the correction is learned."""
    limit: Span = math.radians(2)  # rad
    """Largest magnitude of the learned cosine and sine coefficient of each order, as an angle."""

    @model_validator(mode="after")
    def _rising(self) -> Self:
        rising = all(a < b for a, b in pairwise((0, *self.orders, ORDER_MAX + 1)))
        if not rising or not 1 <= len(self.orders) <= ENCODER_TABLE_ORDERS:
            raise invalid(
                f"expected 1 to {ENCODER_TABLE_ORDERS} rising orders between 1 and {ORDER_MAX}", "orders"
            )
        if self.limit * self.orders[-1] > 1:
            raise invalid(
                f"expected at most {1 / self.orders[-1]:.3g} rad (1 rad divided by the highest order)",
                "limit",
            )
        if not self.omega_min:
            raise invalid("expected a speed above zero", "omega_min")
        return self

    @property
    def bandwidth(self) -> float:
        """Bandwidth of the observer that predicts the angle, rad/s: a quarter of the lowest order's frequency
        at omega_min."""
        return self.omega_min * self.orders[0] / 4

    @property
    def settling(self) -> float:
        """Time above omega_min after which the observer has settled and learning begins, s."""
        return SETTLED_TIMES / self.bandwidth


class CurrentSensors(Table):
    """Phase current sensors with an error per phase, and their analog-to-digital converter."""

    offset: tuple[Current, Current, Current] = Field(default=(0.0, 0.0, 0.0), strict=False)  # A
    """Offsets of the current sensors of the phases a, b and c."""
    gain_error: tuple[float, float, float] = Field(default=(0.0, 0.0, 0.0), strict=False)
    """Relative gain errors of the current sensors of the phases a, b and c. At the phase current $i$ a sensor
    measures (1 + `gain_error`) $i$ + `offset`."""
    noise: CurrentMagnitude = 0.0  # A rms
    """Standard deviation of the white noise of each current sensor."""
    bits: Annotated[int, Field(ge=0, le=32)] = 0
    """Number of bits of the analog-to-digital converter. 0: the measured currents have no steps and no
    largest value."""
    range: CurrentLimit = 10.0  # A
    """Largest current that the analog-to-digital converter measures: its range is from -`range` to
    +`range`."""
    sensors: Literal[2, 3] = 3
    """Number of current sensors. With 2 sensors the controller computes $i_c = -i_a - i_b$."""

    @property
    def variance(self) -> float:
        """Variance of a measured current, A^2. A converter's step q adds white noise of variance q^2 / 12."""
        step = 2 * self.range / 2**self.bits if self.bits else 0.0
        return self.noise**2 + step**2 / 12


class Bus(Table):
    """A bus between the drive and its law, which runs elsewhere, as on a PC."""

    delay_measured: Time = 0.0  # s
    """Age of the measured angle and speed when the law receives them."""
    delay_command: Time = 0.0  # s
    """Time from the computation of a current reference in the law until this reference acts in the drive."""
    jitter: Time = 0.0  # s
    """Largest random time by which `delay_measured` and `delay_command` become longer. For each measured
    value and each command a new time is drawn; all times from zero to `jitter` are equally likely."""
    quantum: CurrentMagnitude = 0.0  # A
    """Step to which the bus rounds the current reference. 0: no rounding."""

    @property
    def mean_delay(self) -> float:
        """Mean delay of both ways together, s."""
        return self.delay_measured + self.delay_command + self.jitter


class Drive(Table):
    """Power electronics, sensors, current loop and monitor."""

    make: Make | None = None
    """Drive by its name in `cogless new --drive`. `cogless run` then advises the speed method `MT` only if
    this drive can time edges, and suggests commands for it. The simulation does not depend on it. Default:
    unknown."""
    precision: Literal["single", "double"] = "single"
    """Number type of the control laws: `"single"` (float in C) or `"double"`. The motor and the mechanics are
    always simulated in double precision."""
    belief: Belief = Belief()
    """Motor parameters that the controller assumes. Default: the motor's true values."""
    rates: Rates = Field(examples=['{ current_loop = "10 kHz", speed_loop = "1 kHz" }'])
    """Rates of the current loop and of the law, and integration steps of the simulation."""
    current_loop: AnyCurrentLoop = Field(examples=['{ bandwidth = "1 kHz", current_limit = "4 A" }'])
    """Gains and current limit of the current loop."""
    current_reference: CurrentReference | None = None
    """How the drive computes the references of $i_d$ and $i_q$ from the law's output, which then stands for a
    torque ([equations](/laws/current-loop.md#most-torque-per-current-and-field-weakening)). Default: the
    reference of $i_d$ is zero, and the law's output is the reference of $i_q$."""
    inverter: Inverter | None = None
    """Inverter, which converts duty cycles to voltages. Required, unless the current loop is ideal."""
    dead_time_compensation: DeadTimeCompensation | None = None  # likewise
    """Correction of the duty cycles by the voltage that the inverter loses in its dead time. Default: no
    correction."""
    position_sensor: PositionSensor = IdealSensor()
    """Sensor of the angle and the speed. Default: an ideal sensor."""
    encoder_table: EncoderTable | None = None
    """Correction of the position sensor's own angle error, which is learned while the motor turns. Default:
    no correction."""
    speed_filter: Frequency | None = None  # Hz
    """Corner frequency of a first-order low-pass that filters the measured speed at the current loop's rate.
    Default: no filter."""
    bus: Bus | None = None
    """Bus to a law that runs outside the drive. Default: the law runs in the drive."""
    current_sensors: CurrentSensors = CurrentSensors()
    """Offsets, gain errors, noise and converter of the current sensors. Default: ideal sensors."""
    monitor: Monitor = Monitor()
    """Bounds of plausible measurements ([what the monitor does](/laws/monitor.md))."""
    quality: Quality = Quality()
    """Windows in which [the ripple that remains](/laws/monitor.md#how-good-learning-is) despite learning is
    measured. Also: from how large a speed error a law does not learn."""
    guard: bool = True
    """True: [the guard](/laws/guard.md) stops learning that leaves more ripple than the feedback alone."""

    @model_validator(mode="after")
    def _bridge(self) -> Self:
        for key in ("inverter", "current_reference", "dead_time_compensation"):
            if self.ideal and getattr(self, key) is not None:
                kind, real = ("current_loop", "kind"), "delete current_loop.kind for a real current loop"
                raise excluded(key, kind, 'current_loop.kind = "ideal"', real)
        if not self.ideal and self.inverter is None:
            raise invalid("expected a table with bus_voltage, ...", "inverter", value="missing")
        if self.bus is not None and self.current_reference is not None:
            raise excluded(
                "current_reference", "bus", "with bus the law runs outside the drive", "delete bus"
            )
        if self.dead_time_compensation is None:
            return self
        check_sizes(self.dead_time_compensation, "dead_time_compensation")
        return self

    @model_validator(mode="after")
    def _pulses(self) -> Self:
        """Refuse a minimum pulse so long that even duty cycles of one half have shorter pulses."""
        inverter = self.inverter
        if inverter is None or not inverter.minimum_pulse:
            return self
        share, word = (0.25, "a quarter") if inverter.pwm == "centre" else (0.5, "half")
        longest = share / self.rates.current_loop
        if inverter.minimum_pulse + inverter.dead_time >= longest:
            expected = (
                f"expected minimum_pulse + dead_time below {longest:.3g} s, {word} of a current-loop period"
            )
            raise invalid(expected, "inverter", "minimum_pulse")
        return self

    @model_validator(mode="after")
    def _correctable(self) -> Self:
        """Refuse to correct a sensor that has no error by orders of its own revolution."""
        if self.encoder_table is not None and not isinstance(self.position_sensor, Counted):
            kind = ("position_sensor", "kind")
            since = f'position_sensor.kind = "{self.position_sensor.kind}" has no error over a revolution'
            raise excluded(
                "encoder_table", kind, since, 'set position_sensor.kind = "encoder" with its lines'
            )
        return self

    @model_validator(mode="after")
    def _observable(self) -> Self:
        """Refuse an observer or a speed filter that is too fast for the sampling rate of the current loop."""
        sensor, fastest = self.position_sensor, self.rates.current_loop / math.pi
        expected = f"expected at most {fastest:.4g} Hz, a third of rates.current_loop"
        if isinstance(sensor, Counted) and (sensor.observer_bandwidth or 0.0) > fastest:
            raise invalid(expected, "position_sensor", "observer_bandwidth")
        if (self.speed_filter or 0.0) > fastest:
            raise invalid(expected, "speed_filter")
        return self

    @model_validator(mode="after")
    def _remembered(self) -> Self:
        """Refuse delays that are longer than the engine's memory of past values."""
        longest = PAST_MAX / self.rates.current_loop
        sensor, bus = self.position_sensor, self.bus
        delays = {"position_sensor.latency": sensor.latency} if isinstance(sensor, Counted) else {}
        if bus is not None:
            keys = ("delay_measured", "delay_command", "jitter")
            delays |= {f"bus.{key}": getattr(bus, key) for key in keys}
        for key, delay in delays.items():
            if delay > longest:
                expected = f"expected at most {longest:g} s, {PAST_MAX} periods of the current loop"
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
    def pwm_period(self) -> float:
        """Period of the inverter's pulses, s; 0 where nothing switches."""
        if self.inverter is None or not self.inverter.switches:
            return 0.0
        return (2 if self.inverter.pwm == "two-updates" else 1) / self.rates.current_loop

    def largest_torque_current(self, motor: StarMotor) -> float:
        """The largest output of a law, A: the equivalent q-axis current of the most torque at current_limit.

        This is current_limit itself without MTPA (`current_reference`) or without a salient rotor.
        """
        limit, belief = self.current_loop.current_limit, self.belief.resolved(motor)
        reference = self.current_reference
        if reference is None or reference.rule != "mtpa" or belief.L_q == belief.L_d:
            return limit
        saliency = (belief.L_q - belief.L_d) / belief.psi_f * limit
        d = -2 * saliency / (1 + math.sqrt(1 + 8 * saliency**2))
        return limit * max(1.0, REACH_SHARE * math.sqrt(1 - d**2) * (1 - saliency * d))

    def current_noise(self, phases: int) -> dict[str, float]:
        """Six standard deviations of the current sensors' noise, A, for each bound of the monitor.

        The bound of the current vector takes its noisiest direction. With two sensors, the computed third
        phase has the noise of both.
        """
        of_three = 2.0 if self.current_sensors.sensors == 2 else 2 / 3
        variances = {"current_max": of_three if phases == 3 else 1.0, "current_sum": 3.0}
        return {
            key: FALSE_TRIP_DEVIATIONS * math.sqrt(share * self.current_sensors.variance)
            for key, share in variances.items()
        }

    def plausible_currents(self, phases: int) -> dict[str, float]:
        """The monitor's bounds of the measured currents, A, by its keys; 0: not watched."""
        derived = {"current_max": 0.0, "current_sum": 0.0}
        if self.inverter is not None and not self.ideal:
            limit, noise = self.current_loop.current_limit, self.current_noise(phases)
            derived["current_max"] = max(CURRENT_MARGIN * limit, limit + noise["current_max"])
            if phases == 3 and self.current_sensors.sensors == 3:
                derived["current_sum"] = max(SUM_SHARE * limit, noise["current_sum"])
        own = {key: getattr(self.monitor, key) for key in derived}
        return {key: derived[key] if value is None else value for key, value in own.items()}

    def weakening(self, psi_f: float, L_d: float) -> float:
        """Factor by which field weakening raises the speed without load; infinite if $i_d$ can take all the
        flux."""
        if self.current_reference is None or not self.current_reference.field_weakening:
            return 1.0
        rest = psi_f - L_d * self.current_loop.current_limit
        return psi_f / rest if rest > 0 else math.inf

    @property
    def ideal(self) -> bool:
        """Whether the current loop is ideal."""
        return isinstance(self.current_loop, IdealCurrentLoop)
