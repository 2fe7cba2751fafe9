"""A whole study of trials: a drive or a linear plant, controllers that learn from trial to trial, metrics.

A scenario of trials repeats a motion; reference, load, plant and start may change between trials.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import inf, sqrt
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import Field, PrivateAttr, field_validator, model_validator

from cogless import units
from cogless.study.base import StudyBase, Timing
from cogless.study.drive import OUTER_LOOPS, Drive
from cogless.study.laws.trial import DesignSettings, TrialController, TrialLaw
from cogless.study.linear_plant import LinearPlant
from cogless.study.mechanics import Load, Mechanics
from cogless.study.metric import EACH_PHASE, EACH_TRIAL, LAST_TRIAL, Conditions, Metric
from cogless.study.motor import Motor
from cogless.study.scenario import Experiment
from cogless.study.table import (
    Angle,
    AngleMagnitude,
    AngularSpeed,
    AngularSpeedMagnitude,
    Many,
    Override,
    Quantity,
    Table,
    Time,
    dotted_keys,
    excluded,
    invalid,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MOST_TRIALS = 100_000
NORMAL_MOST = 5.0  # standard deviations; less than one draw in a million is beyond


class WithUnit(float):
    """A number that was written in the study with a unit."""


class EitherWay(Quantity):
    """A quantity: a text with a unit in studies of drives, a plain number in studies of linear plants."""

    def read(self, value: Any) -> float:
        """The SI value; a WithUnit if it was written with a unit."""
        number = super().read(value)
        return WithUnit(number) if isinstance(value, str) else number


Position = Annotated[float, EitherWay(units.ANGLE, bare=True)]
LoadTorque = Annotated[float, EitherWay(units.TORQUE, bare=True)]
LoadMagnitude = Annotated[float, EitherWay(units.TORQUE, ">=", bare=True)]


class PositionReference(Table):
    """Smooth moves from point to point: polynomials of fifth degree, at rest at both ends."""

    points: Many[tuple[Time, Position]]  # s
    """Points `[time, position]` of the reference, which is at rest at each point. Between two points the
    position is a polynomial of the fifth degree. A plain array of points is short for this table."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        points = data if isinstance(data, list) else data.get("points") if isinstance(data, dict) else None
        if isinstance(points, list):
            return {"points": tuple(tuple(p) if isinstance(p, list) else p for p in points)}
        return data

    @model_validator(mode="after")
    def _later(self) -> Self:
        times = [time for time, _ in self.points]
        if not times or any(b <= a for a, b in pairwise(times)):
            raise invalid("expected one or more points, each later than the previous one", "points")
        return self

    def values_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """The reference at these times (s), in rad or in the unit of y."""
        import numpy as np

        value = np.full(time.shape, self.points[0][1])
        for (begin, from_), (end, to) in pairwise(self.points):
            s = np.clip((time - begin) / (end - begin), 0.0, 1.0)
            value += (to - from_) * s**3 * (10 - 15 * s + 6 * s**2)
        return value


class Deviations(Table):
    """How far start and load of a trial are from those of its phase."""

    initial_angle: AngleMagnitude | None = None  # rad
    """Deviation of a drive's initial angle: in a table `normal` its standard deviation, in a table `uniform`
    its largest magnitude."""
    initial_speed: AngularSpeedMagnitude | None = None  # rad/s
    """Deviation of a drive's initial speed: in a table `normal` its standard deviation, in a table `uniform`
    its largest magnitude."""
    initial_state: Many[Annotated[float, Field(ge=0, le=1e12)]] | None = None
    """Deviations of a linear plant's initial state, one number for each state: in a table `normal` their
    standard deviations, in a table `uniform` their largest magnitudes."""
    load: LoadMagnitude | None = None
    """Deviation of the load, which is constant in a trial and is added to the `load_steps`: in a table
    `normal` its standard deviation, in a table `uniform` its largest magnitude."""


class EachTrial(Table):
    """Deviations that are drawn anew in each trial, around zero."""

    normal: Deviations = Deviations()
    """Normally distributed deviations of each trial, given by their standard deviations."""
    uniform: Deviations = Deviations()
    """Evenly distributed deviations of each trial, given by their largest magnitudes."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        for key in self.uniform.model_fields_set & self.normal.model_fields_set:
            raise excluded(
                ("uniform", key), ("normal", key), f"normal.{key} is given", f"delete normal.{key}"
            )
        return self

    def form_of(self, key: str) -> tuple[str, Any]:
        """Form and size of a key's deviation: "normal" or "uniform", and the size or None."""
        size = getattr(self.uniform, key)
        return ("normal", getattr(self.normal, key)) if size is None else ("uniform", size)

    def deviations(self, key: str) -> tuple[float, ...]:
        """Standard deviation of a key's deviation; for initial_state one per state; () for no deviation."""
        form, size = self.form_of(key)
        sizes = () if size is None else size if isinstance(size, tuple) else (size,)
        return tuple(one / (1 if form == "normal" else sqrt(3)) for one in sizes)

    def most(self, key: str) -> float:
        """The largest deviation of an angle or speed that is to be expected."""
        form, size = self.form_of(key)
        return (size or 0.0) * (NORMAL_MOST if form == "normal" else 1.0)

    @property
    def empty(self) -> bool:
        """Whether all trials are alike."""
        return not any(any(self.deviations(key)) for key in Deviations.model_fields)


class TrialConditions(Table):
    """Conditions of a trial. In a change, a key that is left out keeps its earlier value."""

    reference: PositionReference | None = None
    """Motion that each trial repeats. In `changes`: a new motion; if you leave it out, the motion stays the
    same."""
    load: Load | None = None
    """Load torque of a drive. It replaces `mechanics.load`."""
    load_steps: (
        Many[Annotated[tuple[Annotated[int, Field(ge=0)], LoadTorque], Field(strict=False)]] | None
    ) = None
    """Load steps `[sample, amount]`. From this sample of each trial until the next step, the constant part of
    the load is `amount`. For a drive this is a torque against positive rotation, in place of the `torque` of
    `load`; for a linear plant it is the disturbance $d$ in the unit of the input $u$. `[]`: no load steps."""
    initial_angle: Angle | None = None  # rad
    """Angle of a drive at the start of each trial. Default: the first position of the reference."""
    initial_speed: AngularSpeed | None = None  # rad/s
    """Speed of a drive at the start of each trial. Default: 0."""
    initial_state: Many[float] | None = None
    """State of a linear plant at the start of each trial. Default: zeros."""
    each_trial: EachTrial | None = None
    """Random deviations of start and load [in each
    trial](/guide/trial-studies.md#starts-and-loads-at-random). Default: no deviations."""
    override: Override | None = None
    """Values that the simulated motor or plant has in this scenario, unknown to the controllers. For a drive:
    values of `motor` and `mechanics` by dotted key. For a linear plant: values of its parameters, or the
    number of one of its `vertex` tables, such as `{ vertex = 2 }`. [The
    certificate](/theory/trial-design.md#the-certificate) does not cover values outside the parameters'
    ranges."""

    @field_validator("override")
    @classmethod
    def _dotted(cls, override: dict[str, Any] | None) -> dict[str, Any] | None:
        return None if override is None else dotted_keys(override)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        steps = self.load_steps or ()
        for index in range(1, len(steps)):
            if steps[index][0] <= steps[index - 1][0]:
                raise invalid("expected a sample after that of the previous step", "load_steps", index)
        return self


class Change(TrialConditions):
    """New conditions from trial number `trial` on."""

    trial: Annotated[int, Field(ge=2)]
    """Number of the first trial with this change; the scenario's first trial has the number 1. Keys that you
    leave out keep their values."""


class TrialScenario(TrialConditions, Experiment):
    """An experiment of `trials` trials, each a whole number of samples long, with changes in between."""

    trials: Annotated[int, Field(ge=1, le=MOST_TRIALS)]
    """Number of trials of the scenario."""
    reference: PositionReference
    """Motion that each trial repeats."""
    changes: Many[Change] = ()
    """Changes of the scenario's keys. Each takes effect in its `trial`, and lasts until another change."""

    @model_validator(mode="after")
    def _changes(self) -> Self:
        before = 1
        for index, change in enumerate(self.changes):
            if not before < change.trial <= self.trials:
                expected = f"expected a trial after {before}, at most {self.trials}"
                raise invalid(expected, "changes", index, "trial")
            before = change.trial
        return self

    @property
    def run_time(self) -> float:
        return self.trials * self.duration

    @property
    def phases(self) -> tuple[tuple[int, TrialConditions], ...]:
        """First trial (counted from 1) and complete conditions of each phase (the trials between two
        changes)."""
        now = TrialConditions.model_construct(
            **{key: getattr(self, key) for key in TrialConditions.model_fields}
        )
        of_phases = [(1, now)]
        for change in self.changes:
            updates = {
                key: getattr(change, key)
                for key in TrialConditions.model_fields
                if getattr(change, key) is not None
            }
            if "override" in updates:
                updates["override"] = {**(now.override or {}), **updates["override"]}
                reloads = any(key.startswith("mechanics.load") for key in change.override or ())
                if reloads and change.load is None:
                    updates["load"] = None  # the override's load replaces an earlier phase's load
            now = now.model_copy(update=updates)
            of_phases.append((change.trial, now))
        return tuple(of_phases)

    @property
    def starts(self) -> tuple[int, ...]:
        """First trial of each phase, counted from 1."""
        return (1, *(change.trial for change in self.changes))


@dataclass(frozen=True)
class Hardware:
    """A drive's motor, mechanics and load, as they are in one phase of a scenario."""

    motor: Motor
    mechanics: Mechanics
    load: Load


class TrialStudy(StudyBase):
    """A validated study of trials, all SI. Made by `cogless.study.load`."""

    kind: ClassVar[Literal["trials"]] = "trials"
    outer_loop: ClassVar[str] = OUTER_LOOPS[1]
    overridable: ClassVar[tuple[str, ...]] = ("motor", "mechanics")
    signal_kinds: ClassVar[frozenset[str]] = frozenset({"trials"})

    plant: LinearPlant | None = None
    """A linear plant. It replaces `motor`, `mechanics` and `drive`."""
    motor: Motor | None = None
    """Data of the motor."""
    mechanics: Mechanics | None = None
    """Inertia, friction and load torque."""
    drive: Drive | None = None
    """Inverter, sensors, rates and current loop of the drive."""
    design: DesignSettings
    """Weights and parameter ranges from which `cogless design` computes the laws."""
    scenario: Annotated[dict[str, TrialScenario], Field(min_length=1)]
    """Scenarios (simulated experiments) by name, `[scenario.NAME]`."""
    controller: Annotated[dict[str, TrialController], Field(min_length=1)]
    """Controllers by name, `[controller.NAME]`."""
    # a drive's hardware in each phase, by scenario
    _hardware: dict[str, tuple[Hardware, ...]] = PrivateAttr(default={})

    @property
    def period(self) -> float:
        """Time between two samples of a trial, s."""
        if self.plant is not None:
            return self.plant.period
        assert self.drive is not None
        return 1 / self.drive.rates.outer_loop

    @property
    def states(self) -> int:
        """Number of the plant's states; for a drive two, angle and speed."""
        return len(self.plant.C) if self.plant is not None else 2

    def trial_law(self, name: str) -> TrialLaw:
        """A controller as a law of trials. The caller must know that the law is one."""
        return cast("TrialLaw", self.controller[name])

    def samples(self, scenario: str) -> int:
        """Number of samples in a trial."""
        return round(self.scenario[scenario].duration / self.period)

    def reference(self, scenario: str, conditions: TrialConditions) -> NDArray[np.float64]:
        """The reference of a phase at each sample, in rad or in the unit of y."""
        import numpy as np

        assert conditions.reference is not None
        return conditions.reference.values_at(
            self.period * np.arange(self.samples(scenario), dtype=np.float64)
        )

    def top_speed(self, scenario: str) -> float:
        """Largest magnitude of speed in a drive's references and initial conditions, rad/s."""
        import numpy as np

        speeds = [0.0]
        for _, conditions in self.scenario[scenario].phases:
            steps = np.abs(np.diff(self.reference(scenario, conditions))) / self.period
            spread = conditions.each_trial.most("initial_speed") if conditions.each_trial else 0.0
            speeds += [abs(conditions.initial_speed or 0.0) + spread, float(np.max(steps))]
        return max(speeds)

    @property
    def precision(self) -> str:
        return "double" if self.drive is None else self.drive.precision

    @property
    def file_rate(self) -> float:
        return inf

    @property
    def own_signals(self) -> dict[str, units.Dimension] | None:
        return None if self.plant is None else self.plant.signals

    @property
    def example_metric(self) -> dict[str, str]:
        signal = "theta_error" if self.plant is None else "y_error"
        return {"name": "error", "kind": "final-rms", "signal": signal}

    def timing(self, scenario: str) -> Timing:
        divider, rate = 1, 1 / self.period
        if self.drive is not None:
            divider, rate = self.drive.rates.divider, round(self.drive.rates.current_loop)
        return Timing(
            ticks=self.samples(scenario) * self.scenario[scenario].trials * divider,
            rate=rate,
            divider=divider,
            decimation=divider if self.trace.rate is None else round(rate / self.trace.rate),
        )

    def when(self, scenario: str, tick: int) -> str:
        return f" in trial {tick // (self.timing(scenario).divider * self.samples(scenario)) + 1}"

    def conditions(self, scenario: str) -> Conditions:
        experiment = self.scenario[scenario]
        return Conditions(
            pole_pairs=1 if self.motor is None else self.motor.pole_pairs,
            trials=experiment.trials,
            starts=experiment.starts,
        )

    def values_of(self, metric: Metric, scenario: str) -> int:
        experiment = self.scenario[scenario]
        return experiment.trials if metric.kind in EACH_TRIAL else len(experiment.starts)

    def columns_of(self, metric: Metric) -> list[tuple[int | None, str]]:
        if metric.kind not in EACH_PHASE:
            return [(None, LAST_TRIAL)]
        phases = max(len(scenario.starts) for scenario in self.scenario.values())
        return [(place, f"{place + 1}") for place in range(phases)]

    def scenario_facts(self, scenarios: Iterable[str]) -> dict[str, Any]:
        """Number of trials, samples per trial, and first trial of each phase, by scenario."""
        facts = {
            name: {
                "count": self.scenario[name].trials,
                "samples": self.samples(name),
                "phases": list(self.scenario[name].starts),
            }
            for name in scenarios
        }
        return {"trials": facts}

    def differs_at_random(self, scenario: str) -> bool:
        """Whether trials of a phase differ at random; the noise of a drive's sensors doesn't count."""
        plant = self.plant
        if plant is not None and (plant.load_noise > 0 or any(plant.state_noise)):
            return True
        spreads = (conditions.each_trial for _, conditions in self.scenario[scenario].phases)
        return any(spread is not None and not spread.empty for spread in spreads)

    def hardware(self, scenario: str) -> tuple[Hardware, ...]:
        """Motor, mechanics and load of each phase of a drive's scenario."""
        return self._hardware[scenario]


AnyTables = dict[str, Any]


def is_trial_study(tables: AnyTables) -> bool:
    """Whether these tables describe a study of trials: they have a plant, a design, or trials."""
    scenarios = tables.get("scenario")
    scenario_tables = scenarios.values() if isinstance(scenarios, dict) else ()
    has_own_table = "plant" in tables or "design" in tables
    return has_own_table or any(isinstance(s, dict) and "trials" in s for s in scenario_tables)
