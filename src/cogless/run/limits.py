"""What limits a run now: the same run again without one cause at a time, then with what may help.

A cause is a difference between the drive and an ideal one, such as the steps of its position sensor. Its
share of a result x is 1 - (x_without / x)^2: shares of independent causes add up to one, and where causes
act on each other they don't. The share of delay is taken between two runs whose sensor has neither steps nor
errors, since a sensor without delay has neither.

A change that may help is tried only against a cause with a clear share. All these runs have the study's seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from cogless.design.auto import filled, unfilled
from cogless.errors import StudyError
from cogless.results import Run
from cogless.results.limits import CLEAR_SHARE, Cause, Cure, Limits
from cogless.results.metrics import Value, result_name
from cogless.run.causes import suspects
from cogless.run.cures import candidates
from cogless.run.simulate import RunError, rollout
from cogless.study import Study, changed, for_scenario
from cogless.study.metric import Metric
from cogless.study.position_sensor import Counted
from cogless.study.reading import Changes, split
from cogless.units import ANGLE, ANGULAR_SPEED

MEAN_SHARE_MOST = 0.05  # of the top reference: a larger mean of the speed error isn't a speed that is held
MEAN_ERROR = "limits_mean_error"
SPEED_SHARE_LEAST = 1e-4  # of the top reference: a ripple of less leaves nothing to gain
STEP_SHARE_LEAST = 0.01  # of the position sensor's step, likewise


def limits(
    study: Study,
    run: Run,
    metric: Metric,
    order: float | None = None,
    jobs: int | None = None,
    traces: Path | None = None,
) -> Limits | None:
    """What limits a finished run, by a metric that is better when lower, or by one of its orders.

    `jobs`: runs at a time, default one per core. `traces`: a folder with room for traces that are too long
    for memory. None: the run has no such value, or next to nothing is left. KeyboardInterrupt: Ctrl-C was
    pressed.
    """
    tries = _Tries(study, run, metric, order, jobs, traces)
    value = tries.value_of(run.metrics)
    if value is None or value <= _negligible(study, run.scenario, metric):
        return None
    found = suspects(study, run, metric)
    together = _merged([each.without for each in found])
    pairs = [changes for each in found for changes in ({**each.beside, **each.without}, each.beside)]
    values = tries.values([*pairs, together])
    causes = []
    for each, without, beside in zip(found, values[:-1:2], values[1::2], strict=True):
        if without is not None and beside is not None:
            share = (min(beside, value) ** 2 - without**2) / value**2
            causes.append(Cause(each.name, without, share))
    causes.sort(key=lambda cause: -cause.share)
    clear = [cause.name for cause in causes if cause.share >= CLEAR_SHARE]
    options = [(cause, each) for cause in clear for each in candidates(study, run, metric, cause)]
    cures = [
        Cure(cause, tries.placed(option.changes), left, option.setting)
        for (cause, option), left in zip(options, tries.values([o.changes for _, o in options]), strict=True)
        if left is not None
    ]
    cures.sort(key=lambda cure: cure.value)
    return Limits(run.scenario, run.controller, result_name(metric), order, value, causes, values[-1], cures)


def _negligible(study: Study, scenario: str, metric: Metric) -> float:
    """The value, SI, below which nothing is left to gain."""
    if metric.dimension is ANGULAR_SPEED:
        return SPEED_SHARE_LEAST * study.scenario[scenario].top_reference
    sensor = for_scenario(study, scenario).drive.position_sensor
    if metric.dimension is ANGLE and isinstance(sensor, Counted):
        return STEP_SHARE_LEAST * sensor.step
    return 0.0


class _Tries:
    """Runs of one controller in one scenario of a changed study."""

    def __init__(
        self,
        study: Study,
        run: Run,
        metric: Metric,
        order: float | None,
        jobs: int | None,
        traces: Path | None,
    ) -> None:
        self._study, self._run, self._metric, self._order = study, run, metric, order
        self._jobs, self._traces = jobs, traces
        self._values: dict[str, float | None] = {"{}": self.value_of(run.metrics)}

    @cached_property
    def _unfilled(self) -> Study:
        return unfilled(self._study, self._run.controller)

    def value_of(self, metrics: Mapping[str, Value]) -> float | None:
        """The metric's value, SI; None if there is none, or it isn't finite."""
        value = metrics.get(result_name(self._metric))
        if isinstance(value, list):
            value = value[(self._metric.order or ()).index(self._order)] if self._order is not None else None
        return value if value is not None and math.isfinite(value) else None

    def values(self, of: Sequence[Changes]) -> list[float | None]:
        """The metric's value after each of these changes; None if a change is refused, if the run fails, or
        if it doesn't hold the speed. Equal changes are tried once."""
        new = {repr(changes): changes for changes in of if repr(changes) not in self._values}
        studies = {key: made for key, changes in new.items() if (made := self._changed(changes)) is not None}
        only = ["/".join((self._run.scenario, self._run.controller))]
        try:
            rolled = rollout([*studies.values()], only, self._jobs, keep_traces=False, traces=self._traces)
            if any(results.interrupted for results in rolled):
                raise KeyboardInterrupt
        except RunError as error:
            rolled = [*error.all_results]
        except StudyError:  # before the first run
            rolled = []
        self._values |= dict.fromkeys(new)
        for key, results in zip(studies, rolled, strict=False):
            for run in results.runs:
                self._values[key] = self.value_of(run.metrics) if self._held(run.metrics) else None
        return [self._values[repr(changes)] for changes in of]

    def placed(self, changes: Changes) -> dict[str, Any]:
        """The changes in the scenario's override where that has a say, too."""
        override = self._study.scenario[self._run.scenario].override
        over = {tuple(map(str, split(key))) for key in override}
        found: dict[str, Any] = {}
        inside: dict[str, Any] = {}
        for key, value in changes.items():
            path = tuple(map(str, split(key)))
            inner = any(path[: len(other)] == other[: len(path)] for other in over)
            (inside if inner else found)[key] = value
        if inside:
            found[f'scenario."{self._run.scenario}".override'] = {**override, **inside}
        return found

    def _changed(self, changes: Changes) -> Study | None:
        """The changed study, with a metric that tells whether the speed is held; None if it is refused."""
        metric, scenario = self._metric, self._run.scenario
        try:
            made = filled(changed(self._unfilled, self.placed(changes)))
            assert isinstance(made, Study)
            same = made.metric[self._study.metric.index(metric)]
            held = {"name": MEAN_ERROR, "kind": "mean", "signal": "omega_error", "scenarios": [scenario]}
            if same.window is not None:
                held["window"] = [f"{time!r} s" for time in same.window]
            elif same.last is not None:
                held["last"] = f"{same.last!r} s"
            return changed(made, {"metric": [*made.source.tables["metric"], held]})
        except StudyError:
            return None

    def _held(self, metrics: Mapping[str, Value]) -> bool:
        mean = next((value for name, value in metrics.items() if name.startswith(MEAN_ERROR)), None)
        most = MEAN_SHARE_MOST * self._study.scenario[self._run.scenario].top_reference
        return isinstance(mean, float) and abs(mean) <= most if most else True


def _merged(changes: Sequence[Changes]) -> dict[str, Any]:
    """All changes; of a table that one of them replaces, what others change in it is dropped."""
    found = {key: value for each in changes for key, value in each.items()}
    whole = {key for key, value in found.items() if isinstance(value, dict) and value}
    return {k: v for k, v in found.items() if not any(k.startswith(f"{table}.") for table in whole)}
