"""A speed study: a drive, the controllers to compare, the scenarios that they run in, the metrics."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, PrivateAttr

from cogless.study.base import StudyBase, Timing
from cogless.study.drive import OUTER_LOOPS, Drive, StarBelief
from cogless.study.laws import Controller
from cogless.study.mechanics import Belt, Mechanics
from cogless.study.metric import Conditions, Metric
from cogless.study.motor import AnyMotor
from cogless.study.scenario import Scenario
from cogless.units import Dimension


class Study(StudyBase):
    """A validated study, all SI. Made by `cogless.study.load`."""

    kind: ClassVar[Literal["speed"]] = "speed"
    outer_loop: ClassVar[str] = OUTER_LOOPS[0]
    overridable: ClassVar[tuple[str, ...]] = ("motor", "mechanics", "drive")

    motor: AnyMotor
    """Data of the motor."""
    mechanics: Mechanics
    """Inertia, friction and load torque."""
    drive: Drive
    """Inverter, sensors, rates and current loop of the drive."""
    scenario: Annotated[dict[str, Scenario], Field(min_length=1)]
    """Scenarios (simulated experiments) by name, `[scenario.NAME]`."""
    controller: Annotated[dict[str, Controller], Field(min_length=1)]
    """Controllers by name, `[controller.NAME]`."""
    _scenarios: dict[str, Study] = PrivateAttr(default={})  # scenario -> study with its overrides applied

    @property
    def belief(self) -> StarBelief:
        """Motor parameters that the controller assumes, for the star equivalent."""
        return self.drive.belief.resolved(self.motor.star())

    @property
    def K_t(self) -> float:
        """Torque constant that the controller assumes, N*m/A."""
        motor = self.motor.star()
        return motor.power_factor * motor.pole_pairs * self.belief.psi_f

    @property
    def trace_rate(self) -> float:
        """Recorded rows per second, Hz."""
        return self.trace.rate or self.drive.rates.current_loop

    @property
    def rows_per_period(self) -> int:
        return max(1, round(self.trace_rate / self.drive.rates.current_loop))

    def in_scenario(self, scenario: str) -> Study:
        """The study with this scenario's overrides applied; the study itself if there are none."""
        return self._scenarios.get(scenario, self)

    @property
    def precision(self) -> str:
        return self.drive.precision

    @property
    def file_rate(self) -> float:
        return self.trace.file_rate

    @property
    def own_signals(self) -> dict[str, Dimension] | None:
        return None

    @property
    def example_metric(self) -> dict[str, str]:
        return {"name": "ripple", "kind": "ripple-rms", "signal": "omega_m"}

    def timing(self, scenario: str) -> Timing:
        in_scenario = self.in_scenario(scenario)
        rates = in_scenario.drive.rates
        return Timing(
            ticks=round(in_scenario.scenario[scenario].duration * rates.current_loop),
            rate=round(rates.current_loop),
            divider=rates.divider,
            decimation=max(1, round(rates.current_loop / in_scenario.trace_rate)),
            rows_per_period=in_scenario.rows_per_period,
        )

    def when(self, scenario: str, tick: int) -> str:
        return f" at {tick / self.timing(scenario).rate:.6g} s"

    def conditions(self, scenario: str) -> Conditions:
        in_scenario = self.in_scenario(scenario)
        motor, belt = in_scenario.motor.star(), self.belt(scenario)
        return Conditions(
            pole_pairs=motor.pole_pairs,
            R_s=motor.R_s,
            power_factor=motor.power_factor,
            speed_period=1 / in_scenario.drive.rates.outer_loop,
            pwm_period=in_scenario.drive.pwm_period,
            carriage_radius=math.nan if belt is None else belt.radius,
            events=tuple(event.time for event in in_scenario.scenario[scenario].events),
        )

    def belt(self, scenario: str) -> Belt | None:
        return self.in_scenario(scenario).mechanics.belt

    def values_of(self, metric: Metric, scenario: str) -> int:
        return len(self.columns_of(metric))

    def columns_of(self, metric: Metric) -> list[tuple[int | None, str]]:
        if metric.kind != "order":
            return [(None, "")]
        return [(place, f"{order:g}") for place, order in enumerate(metric.order or ())]

    def scenario_facts(self, scenarios: Iterable[str]) -> dict[str, Any]:
        return {}
