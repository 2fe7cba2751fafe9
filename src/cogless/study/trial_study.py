"""A whole study of trials: a drive or a linear plant, controllers that learn from trial to trial, metrics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PrivateAttr

from cogless.study.base import StudyBase
from cogless.study.drive import Drive
from cogless.study.mechanics import Load, Mechanics
from cogless.study.metric import EACH_TRIAL, Metric
from cogless.study.motor import Motor
from cogless.study.plant import LinearPlant
from cogless.study.trial_controller import DesignSettings, TrialController
from cogless.study.trial_scenario import TrialConditions, TrialScenario

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Hardware:
    """A drive's motor, mechanics and load, as they are in one phase of a scenario."""

    motor: Motor
    mechanics: Mechanics
    load: Load


class TrialStudy(StudyBase):
    """A validated study of trials, all SI. Made by `cogless.study.load`."""

    plant: LinearPlant | None = None  # in place of motor, mechanics and drive
    motor: Motor | None = None
    mechanics: Mechanics | None = None
    drive: Drive | None = None
    design: DesignSettings
    scenario: Annotated[dict[str, TrialScenario], Field(min_length=1)]
    controller: Annotated[dict[str, TrialController], Field(min_length=1)]
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

    def samples(self, scenario: str) -> int:
        """Number of samples in a trial."""
        return round(self.scenario[scenario].duration / self.period)

    def reference(self, scenario: str, conditions: TrialConditions) -> NDArray[np.float64]:
        """The reference of a phase at each sample, in rad or in the unit of y."""
        import numpy as np

        assert conditions.reference is not None
        return conditions.reference.at(self.period * np.arange(self.samples(scenario), dtype=np.float64))

    def top_speed(self, scenario: str) -> float:
        """Largest magnitude of speed in a drive's references and initial conditions, rad/s."""
        import numpy as np

        found = [0.0]
        for _, conditions in self.scenario[scenario].phases:
            steps = np.abs(np.diff(self.reference(scenario, conditions))) / self.period
            spread = conditions.each_trial.most("initial_speed") if conditions.each_trial else 0.0
            found += [abs(conditions.initial_speed or 0.0) + spread, float(np.max(steps))]
        return max(found)

    def values_of(self, metric: Metric, scenario: str) -> int:
        """Number of values of a metric: one per trial, or one per phase."""
        experiment = self.scenario[scenario]
        return experiment.trials if metric.kind in EACH_TRIAL else len(experiment.starts)

    def differs_at_random(self, scenario: str) -> bool:
        """Whether trials of a phase differ at random, beside the noise of a drive's sensors."""
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
    found = scenarios.values() if isinstance(scenarios, dict) else ()
    told = "plant" in tables or "design" in tables
    return told or any(isinstance(s, dict) and "trials" in s for s in found)
