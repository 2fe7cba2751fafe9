"""A metric: which number is computed from which signal, over which time or trials."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, Literal, Protocol, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from cogless import units
from cogless.control_library import C_LAWS
from cogless.signals import RECORDED, dimensions
from cogless.study.table import Duration, Many, Quantity, Table, Time, excluded, invalid
from cogless.units import Dimension

OF_LINEAR_PLANTS = ("y_ref", "y", "y_error", "u", "load")  # signals that linear plants have and drives lack
# Dimension of every signal that a run may have, recorded or derived; a linear plant's have no unit.
SIGNAL_DIMENSIONS = {
    **dict.fromkeys(OF_LINEAR_PLANTS, units.NONE),
    **dimensions(
        ("electrical", "three_phases", "within_periods", "path", "thermal", "energy", "load_side"), C_LAWS
    ),
    **dimensions(("electrical", "three_phases", "thermal", "energy", "load_side", "trials", "trial_law"), ()),
}

OWN_DIMENSIONS = {
    "ripple-ratio": units.NONE,
    "trials-to-floor": units.NONE,
    "copper-loss": units.POWER,
    "chattering": units.CURRENT,
    "settling": units.TIME,
    "exceeds": units.TIME,
    "time-to-learn": units.TIME,
    "carriage-ripple": units.LENGTH,
}
TURN_SHORTFALL_MOST = 1e-3  # revolutions by which a window of whole revolutions may be short
STATE = re.compile(r"x_\d+")
AT_AN_EVENT = ("dip", "settling", "overshoot")
OF_A_CARRIAGE = ("theta_load", "theta_m")  # angles that, times the pulley's radius, are a carriage's way
CARRIAGE_ORDERS = tuple(range(1, 9))  # electrical orders that carriage-ripple counts
ROWS_OF_PULSES_LEAST = 16  # rows per PWM period for switching-ripple: fewer miss most of the short pulses
WITH_A_BAND = ("settling", "exceeds", "time-to-learn")
EACH_TRIAL = ("rms", "ripple-rms", "mean", "maximum", "peak-to-peak")  # kinds with a value for each trial
LAST_TRIAL = "last"  # name of the last trial's value, which a table of many runs has of these kinds
EACH_PHASE = ("first-rms", "final-rms", "trials-to-floor")  # kinds with a value for each phase; trials only


class Metric(Table):
    """A metric that a study declares. Times in s, band and floor in the signal's SI unit.

    In a study of trials, rms, ripple-rms, mean, maximum and peak-to-peak have one number per trial;
    first-rms, final-rms and trials-to-floor have one number per phase. A phase begins with the first trial
    and with each change.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
    """Name of the metric in tables. In `results.json` the SI unit is appended to this name."""
    kind: Literal[
        "peak-to-peak",
        "rms",
        "ripple-rms",
        "three-sigma",
        "switching-ripple",
        "ripple-ratio",
        "mean",
        "maximum",
        "order",
        "dip",
        "settling",
        "overshoot",
        "exceeds",
        "time-to-learn",
        "copper-loss",
        "chattering",
        "first-rms",
        "final-rms",
        "trials-to-floor",
        "carriage-ripple",
    ]
    """What is computed from the signal: [the kinds of metrics](/guide/metrics.md)."""
    signal: str | None = None
    """Signal from which the metric is computed. Default: `omega_m` for `dip`, `settling` and `overshoot`;
    `theta_load` for `carriage-ripple`. `copper-loss` and `chattering` have no signal."""
    window: tuple[Time, Time] | None = Field(default=None, strict=False)  # s
    """Start and end of the time over which the metric is computed. Default: from the event in the key `event`
    to the next event; without `event`, the whole run."""
    last: Duration | None = None  # s
    """Duration of the window at the end of each scenario over which the metric is computed. It replaces
    `window` and `event`."""
    scenarios: Many[str] | None = None
    """Scenarios in which the metric is computed. Default: all scenarios; with the key `event`, all scenarios
    that have an event at this time."""
    order: Many[Annotated[float, Field(gt=0)]] | None = None
    """Orders of a revolution whose amplitudes a metric of kind `order` computes."""
    frame: Literal["electrical", "mechanical"] = "mechanical"
    """For a metric of kind `order`: whether it counts waves per mechanical or per electrical revolution. For
    other kinds: whether angles and speeds are mechanical or electrical, that is, [times the pole
    pairs](/guide/metrics.md#frame)."""
    event: Time | None = None  # s
    """Time of an event, such as a load step, at which the window begins. `dip`, `settling` and `overshoot`
    measure the effect of this event."""
    band: float | None = None  # SI
    """For `settling` and `exceeds`: half of the width of the band, in the signal's unit. For `time-to-learn`:
    the largest allowed rms of the signal."""
    floor: float | None = None  # SI
    """For `trials-to-floor`: the rms that a trial must reach, in the signal's unit."""
    smooth: Duration | None = None  # s
    """For `dip`, `settling` and `overshoot`: time over which a moving average first smooths the signal, so
    that ripple does not count. For `time-to-learn`: duration of the intervals in each of which the rms must
    be at most `band`."""
    unit: str | None = None  # SI
    """Unit of the metric in tables and report; `results.json` always has SI units. Default: the [unit that
    the study uses](/guide/metrics.md#units) for speeds and angles, otherwise SI."""
    better: Literal["lower", "higher", "none"] = "lower"
    """Which values of the metric are better, so that tables mark the best one: `lower` or `higher` values, or
    `none`. Default: `lower`. For the kind `exceeds` the default is `higher`, since the signal should leave
    the band as late as possible."""
    limit: float | None = None  # SI
    """Largest acceptable value of the metric, or the smallest one if higher values are better. `cogless
    sweep` shows the share of variants within this limit."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if data.get("kind") in AT_AN_EVENT:
            data = {"signal": "omega_m", **data}
        if data.get("kind") == "carriage-ripple":
            data = {"signal": OF_A_CARRIAGE[0], **data}
        if isinstance(data.get("order"), int | float):
            data = {**data, "order": [data["order"]]}
        return data

    @field_validator("band", "floor", mode="before")
    @classmethod
    def _in_signals_unit(cls, value: Any, info: ValidationInfo) -> Any:
        dimension = _dimension("", info.data.get("signal"))
        if value is None:
            return None
        if dimension is None:
            return 1.0  # any number: a check of the study refuses the signal
        return Quantity(dimension, ">", bare=not dimension.unit).read(value)

    @field_validator("limit", mode="before")
    @classmethod
    def _in_own_unit(cls, value: Any, info: ValidationInfo) -> Any:
        dimension = _dimension(str(info.data.get("kind")), info.data.get("signal"))
        if value is None or dimension is None:
            return value
        if info.data.get("better") == "none":
            raise invalid(
                'expected no such key, since better = "none": delete limit, or set better = "lower" or '
                '"higher"'
            )
        return Quantity(dimension, bare=not dimension.unit).read(value)

    @field_validator("unit")
    @classmethod
    def _unit(cls, unit: str | None, info: ValidationInfo) -> str | None:
        dimension = _dimension(str(info.data.get("kind")), info.data.get("signal"))
        if unit is not None and dimension is not None:
            try:
                units.factor(unit, dimension)
            except units.UnitError:
                sample = dimension.example or dimension.unit
                such = f', such as "{sample}"' if sample else ", none"
                raise invalid(f"expected a unit of {dimension.name}{such}") from None
        return unit

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needs = {
            "signal": self.kind not in ("copper-loss", "chattering"),
            "order": self.kind == "order",
            "event": self.kind in AT_AN_EVENT,
            "band": self.kind in WITH_A_BAND,
            "floor": self.kind == "trials-to-floor",
            "smooth": self.kind == "time-to-learn",
        }
        for key, needed in needs.items():
            if needed and getattr(self, key) in (None, ()):
                raise invalid(f'expected this key, since kind is "{self.kind}"', key, value="missing")
            optional = key == "event" or (key == "smooth" and self.kind in AT_AN_EVENT)
            if not needed and not optional and getattr(self, key) is not None:
                raise excluded(key, "kind", f'kind = "{self.kind}"', f"set a kind that takes {key}")
        if self.kind == "carriage-ripple" and self.signal not in OF_A_CARRIAGE:
            raise invalid(f"expected {' or '.join(OF_A_CARRIAGE)}", "signal")
        if self.last is not None and (self.window, self.event) != (None, None):
            raise invalid("expected only one of window, last and event", "last")
        if self.window is not None and self.window[1] <= self.window[0]:
            raise invalid("expected an end after the beginning", "window")
        return self

    def span(self, end: float) -> tuple[float, float] | None:
        """The declared window in a run that ends at `end`, s; None if none is declared."""
        return self.window if self.last is None else (max(0.0, end - self.last), end)

    def next_event(self, events: Iterable[float], row: float) -> float | None:
        """Time of the first of these events after the metric's own, s; None without either.

        `row`: time between rows, s. An event within half a row of the metric's event is that event.
        """
        event = self.event
        return None if event is None else min((t for t in events if t > event + row / 2), default=None)

    def window_within(
        self, end: float, events: Iterable[float], row: float, before_event: float = 0.0
    ) -> tuple[float, float]:
        """The window in a run that ends at `end`, s: as declared, else from the metric's event to the next of
        these events, else the whole run.

        `row`: time between rows. `before_event`: time by which the window ends before the next event.
        """
        declared = self.span(end)
        if declared is not None:
            return declared
        after = self.next_event(events, row)
        return self.event or 0.0, end if after is None else after - before_event

    @property
    def between_samples(self) -> bool:
        """Whether the metric needs trace rows between the samples of a switched drive's currents."""
        recorded = RECORDED.get(self.signal or "")
        return self.kind == "switching-ripple" or (recorded is not None and "within_periods" in recorded.when)

    @property
    def fourier_orders(self) -> tuple[float, ...]:
        """Orders of a revolution whose amplitudes the metric computes; empty if it computes none."""
        return CARRIAGE_ORDERS if self.kind == "carriage-ripple" else self.order or ()

    @property
    def by_electrical_turn(self) -> bool:
        """Whether `fourier_orders` are those of an electrical revolution."""
        return self.kind == "carriage-ripple" or self.frame == "electrical"

    @property
    def better_direction(self) -> str:
        """The key `better`, but by default "higher" for `exceeds`: leaving a band late is better."""
        later = self.kind == "exceeds" and "better" not in self.model_fields_set
        return "higher" if later else self.better

    @property
    def meaning(self) -> tuple[Any, ...]:
        """Properties that metrics of the same name in different scenarios must have in common."""
        return self.kind, self.signal, self.order, self.frame

    @property
    def dimension(self) -> Dimension:
        """Dimension of the metric's value."""
        return _dimension(self.kind, self.signal) or units.NONE

    def applies_in(self, name: str, scenario: WithEvents) -> bool:
        """Whether the metric is evaluated in a scenario: one that it names, or by default one that has its
        event."""
        if self.scenarios is not None:
            return name in self.scenarios
        return self.event is None or scenario.has_event(self.event)


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Data of a run that metrics need besides its trace."""

    pole_pairs: int = 1
    R_s: float = math.nan  # ohm, of the star equivalent
    power_factor: float = math.nan  # 3/2 for three phases, 1 for two
    speed_period: float = math.nan  # s, of the speed loop
    pwm_period: float = 0.0  # s, of the inverter's pulses; 0: nothing switches
    carriage_radius: float = math.nan  # m/rad, way of a belt's carriage per angle of the motor
    events: tuple[float, ...] = ()  # s, times of the scenario's events
    trials: int | None = None
    starts: tuple[int, ...] = ()  # the phases' first trials, counted from 1


class WithEvents(Protocol):
    """The part of a scenario that decides which metrics are evaluated in it."""

    def has_event(self, time: float) -> bool: ...


class Named(Protocol):
    """The parts of a metric that make up its name in results.json."""

    @property
    def name(self) -> str: ...
    @property
    def dimension(self) -> Dimension: ...


def result_name(metric: Named) -> str:
    """Name in results.json: the metric's name followed by its SI unit ("speed_ripple_rad_s",
    "torque_N_m")."""
    suffix = "_" + metric.dimension.unit.replace("*", "_").replace("/", "_").replace("^", "")
    return metric.name if suffix == "_" or metric.name.endswith(suffix) else metric.name + suffix


def turns_held(turns: float, row: float) -> float:
    """The revolutions of a window, `turns`, plus the allowed shortfall from whole revolutions.

    The shortfall is two rows, or TURN_SHORTFALL_MOST for a speed that is slightly low. `row`: revolutions
    from row to row.
    """
    return turns + max(2 * row, TURN_SHORTFALL_MOST)


def whole_revolutions(orders: Iterable[float]) -> int:
    """The smallest number of revolutions that contains whole periods of every order."""
    return math.lcm(*(Fraction(n).limit_denominator(1000).denominator for n in orders))


def _dimension(kind: str, signal: str | None) -> Dimension | None:
    """Dimension of a metric; None for a signal that no run has, which a check of the study refuses.

    Any state x_1, x_2, ... is accepted, since a linear plant may have it.
    """
    if kind in OWN_DIMENSIONS:
        return OWN_DIMENSIONS[kind]
    state = signal is not None and STATE.fullmatch(signal)
    return units.NONE if state else SIGNAL_DIMENSIONS.get(signal or "")
