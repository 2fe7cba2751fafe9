"""A metric: which number is taken from which signal, over which time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import Annotated, Any, Literal, Protocol, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from cogless import units
from cogless.c_laws import C_LAWS
from cogless.signals import dimensions
from cogless.study.scenario import Scenario
from cogless.study.table import Duration, Many, Quantity, Table, Time, invalid
from cogless.units import Dimension

# Energies, with trace.energy: what went in since the start, where it went, the store, the balance's residual.
# Every signal that a run of some drive may have, recorded or derived from recorded ones.
SIGNALS = dimensions(
    ("electrical", "three_phases", "path", "energy"), [name for name in C_LAWS if name != "trial"]
)

OWN_DIMENSIONS = {
    "copper-loss": units.POWER,
    "chattering": units.CURRENT,
    "settling": units.TIME,
    "exceeds": units.TIME,
}
AT_AN_EVENT = ("dip", "settling", "overshoot")
WITH_A_BAND = ("settling", "exceeds")


class Metric(Table):
    """One declared metric. Times in s, band in the signal's SI unit."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
    kind: Literal[
        "peak-to-peak",
        "rms",
        "ripple-rms",
        "mean",
        "maximum",
        "order",
        "dip",
        "settling",
        "overshoot",
        "exceeds",
        "copper-loss",
        "chattering",
    ]
    signal: str | None = None  # not for copper-loss and chattering; omega_m at an event
    # s; default: from the event to the next one, else all
    window: tuple[Time, Time] | None = Field(default=None, strict=False)
    last: Duration | None = None  # s: in place of a window, so much of the end of each scenario
    scenarios: Many[str] | None = None  # default: all, or those that have the event
    order: Many[Annotated[float, Field(gt=0)]] | None = None
    # the revolution that the order is a multiple of; for other kinds, the frame of angles and speeds
    frame: Literal["electrical", "mechanical"] = "mechanical"
    event: Time | None = None  # s
    band: float | None = None  # half width, SI
    smooth: Duration | None = None  # s: averaged over this time first, so that ripple doesn't count
    unit: str | None = None  # in tables and report; default: SI
    better: Literal["lower", "higher", "none"] = "lower"

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if data.get("kind") in AT_AN_EVENT:
            data = {"signal": "omega_m", **data}
        if isinstance(data.get("order"), int | float):
            data = {**data, "order": [data["order"]]}
        return data

    @field_validator("signal")
    @classmethod
    def _known_signal(cls, signal: str | None) -> str | None:
        if signal is not None and signal not in SIGNALS:
            raise invalid(f"expected a signal: {', '.join(SIGNALS)}")
        return signal

    @field_validator("band", mode="before")
    @classmethod
    def _band(cls, band: Any, info: ValidationInfo) -> Any:
        signal = info.data.get("signal")
        return Quantity(SIGNALS[signal], ">", bare=not SIGNALS[signal].unit).read(band) if signal else None

    @field_validator("unit")
    @classmethod
    def _unit(cls, unit: str | None, info: ValidationInfo) -> str | None:
        kind, signal = info.data.get("kind"), info.data.get("signal")
        if unit is not None and (kind in OWN_DIMENSIONS or signal is not None):
            dimension = _dimension(str(kind), signal)
            try:
                units.factor(unit, dimension)
            except units.UnitError:
                shown = dimension.example or dimension.unit
                such = f', such as "{shown}"' if shown else ", none"
                raise invalid(f"expected a unit of {dimension.name}{such}") from None
        return unit

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needs = {
            "signal": self.kind not in ("copper-loss", "chattering"),
            "order": self.kind == "order",
            "event": self.kind in AT_AN_EVENT,
            "band": self.kind in WITH_A_BAND,
        }
        for key, needed in needs.items():
            if needed and getattr(self, key) in (None, ()):
                raise invalid(f'expected one, since kind is "{self.kind}"', key, value="missing")
            if not needed and key != "event" and getattr(self, key) is not None:
                raise invalid(f'expected none, since kind is "{self.kind}"', key)
        if self.smooth is not None and self.kind not in AT_AN_EVENT:
            raise invalid(f'expected none, since kind is "{self.kind}"', "smooth")
        if self.last is not None and (self.window, self.event) != (None, None):
            raise invalid("expected one of window, last and event", "last")
        if self.window is not None and self.window[1] <= self.window[0]:
            raise invalid("expected a window that ends after it begins", "window")
        return self

    def span(self, end: float) -> tuple[float, float] | None:
        """The declared window in a run that ends at `end`, s; None where none is declared."""
        return self.window if self.last is None else (max(0.0, end - self.last), end)

    @property
    def meaning(self) -> tuple[Any, ...]:
        """Properties that metrics of one name, in different scenarios, have in common."""
        return self.kind, self.signal, self.order, self.frame

    @property
    def dimension(self) -> Dimension:
        """Dimension of the metric's value."""
        return _dimension(self.kind, self.signal)

    def applies_in(self, name: str, scenario: Scenario) -> bool:
        """Whether the metric is taken in a scenario: where it says so, else wherever its event is."""
        if self.scenarios is not None:
            return name in self.scenarios
        return self.event is None or scenario.has_event(self.event)


class Named(Protocol):
    """The parts of a metric that its name in results.json is made of."""

    @property
    def name(self) -> str: ...
    @property
    def dimension(self) -> Dimension: ...


def result_name(metric: Named) -> str:
    """Name in results.json: the metric's name, ended by its SI unit ("speed_ripple_rad_s", "torque_N_m")."""
    suffix = "_" + metric.dimension.unit.replace("*", "_").replace("/", "_").replace("^", "")
    return metric.name if suffix == "_" or metric.name.endswith(suffix) else metric.name + suffix


def whole_revolutions(orders: Iterable[float]) -> int:
    """The fewest revolutions over which every order is whole."""
    return math.lcm(*(Fraction(n).limit_denominator(1000).denominator for n in orders))


def _dimension(kind: str, signal: str | None) -> Dimension:
    return OWN_DIMENSIONS.get(kind) or SIGNALS[signal or ""]
