"""What limits a run: the run is repeated without one cause at a time, then with changes that may help.

A cause is a difference between the drive and an ideal one, such as the steps of its position sensor. A
cause's share of a result x is 1 - (x_without / x)^2. Shares of independent causes add up to one; shares of
causes that act on each other don't. A sensor without delay has neither steps nor errors. So the share of
delay compares two runs that both lack steps and errors.

Two causes may hide each other: then neither has a share alone. So the largest causes are also removed in
pairs, unless single causes explain the result. Torque ripple is no such explanation with a law that learns,
since learning should reject it.

A change that may help is tried only against a cause with a clear share. All these runs have the study's seed.
Where the design says that the ripple of one run is partly chance, a change is advised only if it helps with
another seed, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

from cogless.design.answers import doubt, other_seeds
from cogless.design.auto import filled, unfilled
from cogless.errors import StudyError
from cogless.results import Results, Run
from cogless.results.held_speed import Miss, missed_in
from cogless.results.limits import (
    AND,
    HELPING_SHARE,
    NAMED_MOST,
    TORQUE_RIPPLE,
    Cause,
    Cost,
    Cure,
    Harm,
    InVain,
    Learner,
    Limits,
)
from cogless.results.metrics import Value, result_name
from cogless.run.cures import candidates
from cogless.run.settings_search import HOLDING_WAYS, Shortfall, searched
from cogless.run.simulate import RunError, rollout
from cogless.run.suspects import ROWS_KEY, Suspect, suspects
from cogless.study import AnyStudy, Study, changed, for_scenario
from cogless.study.metric import Metric
from cogless.study.numerics import voltage_reach
from cogless.study.position_sensor import Counted
from cogless.study.reading import Changes, split, with_tables
from cogless.units import ANGLE, ANGULAR_SPEED

SPEED_SHARE_LEAST = 1e-4  # speed ripple / top reference, below which nothing is left to gain
MOST_SHARE = 0.5  # share of the result's square that counts as most of it
PAIRED_CAUSES = 4  # number of the largest causes, which are also removed in pairs
CLEARLY_WORSE = 1.5  # metric's value after a change / before the change
PLANT_TABLES = ("motor", "drive", "mechanics")  # tables that a scenario may override
OF_WHOLE_STUDIES = ("calibration", "vary", "tune")
UNHELD = Shortfall(lost=1, ripple=math.inf, error=math.inf)
STEP_SHARE_LEAST = 0.01  # angle ripple / position sensor's step, below which nothing is left to gain


def limits(
    study: Study,
    run: Run,
    metric: Metric,
    order: float | None = None,
    jobs: int | None = None,
    traces: Path | None = None,
) -> Limits | None:
    """What limits a finished run, judged by a metric that is better when lower.

    `order`: the order by which the run is judged, if the metric has several orders. `jobs`: number of runs at
    a time, default one per core. `traces`: a folder for traces that are too long for memory. If the run's
    rotor turns in jerks, a change helps without making the speed even. Returns None if the run has no value
    of this metric, or if the value is negligible. KeyboardInterrupt: the user pressed Ctrl-C.
    """
    speed = missed_in(Results(study, [run]), metric, run)
    in_jerks = speed is not None and speed.kind == "error"
    tries = _Tries(study, run, metric, order, jobs, traces, in_jerks)
    value = tries.value_of(run.metrics)
    if value is None or value <= _negligible(study, run.scenario, metric):
        return None
    suspected = suspects(study, run, metric)
    pairs = [
        change
        for suspect in suspected
        for change in (tries.without(suspect), tries.placed(suspect.companions))
    ]
    values = [tries.value_of(metrics) for metrics in tries.metrics(pairs)]
    causes = []
    for suspect, without, placed in zip(suspected, values[::2], values[1::2], strict=True):
        if without is not None and placed is not None:
            share = (min(placed, value) ** 2 - without**2) / value**2
            causes.append(Cause(suspect.name, without, share))
    causes.sort(key=lambda cause: -cause.share)
    learns = study.controller[run.controller].learned
    explaining = [cause for cause in causes if not (learns and cause.name == TORQUE_RIPPLE)]
    if sum(max(0.0, cause.share) for cause in explaining) < MOST_SHARE:
        causes = sorted(
            [*causes, *_pairs(tries, suspected, explaining, value)], key=lambda cause: -cause.share
        )
    untried = [suspect.name for suspect in suspected if all(suspect.name != cause.name for cause in causes)]
    limited = Limits(
        scenario=run.scenario,
        controller=run.controller,
        metric=result_name(metric),
        order=order,
        value=value,
        causes=causes,
        untried=untried,
    )
    return _not_by_chance(tries, study, replace(limited, cures=_cures(tries, study, run, metric, limited)))


def holding(
    study: Study,
    run: Run,
    metric: Metric,
    order: float | None = None,
    jobs: int | None = None,
    traces: Path | None = None,
) -> Limits | None:
    """The settings with which a run that does not hold its speed holds it, as cures.

    Tries at most two settings together, in at most two dozen runs of the scenario. None: the speed is beyond
    the bus voltage, so nothing is tried. Parameters and KeyboardInterrupt: as of `limits`.
    """
    own_study = for_scenario(study, run.scenario)
    speed = study.scenario[run.scenario].top_reference
    if speed > voltage_reach(own_study):
        return None
    tries = _Tries(study, run, metric, order, jobs, traces)
    cures: dict[str, Cure] = {}

    def studies(changes: Changes) -> Study:
        return for_scenario(changed(study, tries.placed(changes)), run.scenario)

    def tried(of: Sequence[Changes]) -> list[Shortfall | None]:
        placed = [tries.placed(changes) for changes in of]
        if placed == [{}]:  # the run as it is
            return [UNHELD]
        lacking = tries.shortfalls(placed)
        for changes, lack in zip(placed, lacking, strict=True):
            if lack is not None and lack.lost == 0:
                cures[repr(changes)] = Cure("", changes, lack.ripple, True)
        return lacking

    _, in_vain = searched(HOLDING_WAYS, studies, tried, until_held=True)
    limited = Limits(
        scenario=run.scenario,
        controller=run.controller,
        metric=result_name(metric),
        order=order,
        value=math.inf,
        causes=[],
        cures=sorted(cures.values(), key=lambda cure: cure.value),
        in_vain=InVain(run.controller, in_vain) if in_vain and not cures else None,
    )
    return _not_by_chance(tries, study, limited)


@dataclass(frozen=True)
class Elsewhere:
    """A run of another scenario that holds its speed, and the metric, with its order, that judges it.

    `tried`: the limits of that run if they are known.
    """

    run: Run
    metric: Metric
    order: float | None = None
    tried: Limits | None = None


def without_harm(
    study: Study,
    limited: Limits,
    others: Sequence[Elsewhere],
    jobs: int | None = None,
    traces: Path | None = None,
) -> Limits:
    """Return `limited` with the harm that each advised change does to other scenarios.

    A harmful change gives way to the next best, which is tried in the same way.
    """
    tries = [(other, _Tries(study, other.run, other.metric, other.order, jobs, traces)) for other in others]
    checked: dict[str, list[Harm]] = {}
    while new := [cure for cure in limited.advised if repr(cure.changes) not in checked]:
        checked |= {repr(cure.changes): [] for cure in new}
        for other, tries_there in tries:
            before = tries_there.value_of(other.run.metrics)
            acting = {repr(cure.changes): _acting(cure, other.run.controller) for cure in new}
            acting = {key: changes for key, changes in acting.items() if changes and before is not None}
            values = _values([*acting.values()], other, tries_there)
            for key, value in zip(acting, values, strict=True):
                if before is not None and _is_worse(study, other, before, value):
                    checked[key].append(Harm(other.run.scenario, other.run.controller, before, value))
        cures = [replace(cure, harms=checked.get(repr(cure.changes), ())) for cure in limited.cures]
        limited = replace(limited, cures=cures)
    return limited


def _acting(cure: Cure, controller: str) -> dict[str, Any]:
    """The part of a change that acts on a controller in other scenarios than the change's own."""
    roots = {key: tuple(map(str, split(key)[:2])) for key in cure.changes}
    return {
        key: value
        for key, value in cure.changes.items()
        if roots[key][0] in PLANT_TABLES or roots[key] == ("controller", controller)
    }


def _values(of: Sequence[Changes], other: Elsewhere, tries: _Tries) -> list[float | None]:
    """The metric that judges another scenario, after each change; None: the speed is not held there."""
    cures = other.tried.cures if other.tried is not None else ()
    by_changes: dict[str, float | None] = {repr(cure.changes): cure.value for cure in cures}
    fresh = [changes for changes in of if repr(changes) not in by_changes]
    for changes, metrics in zip(fresh, tries.metrics(fresh), strict=True):
        by_changes[repr(changes)] = tries.value_of(metrics)
    return [by_changes[repr(changes)] for changes in of]


def _is_worse(study: Study, other: Elsewhere, before: float, value: float | None) -> bool:
    """Whether a change leaves so much more in another scenario that the way back would help."""
    least = max(before, _negligible(study, other.run.scenario, other.metric))
    return value is None or HELPING_SHARE * value >= least


def beside_learner(
    study: Study,
    limited: Limits,
    learner: Run,
    metric: Metric,
    holds: bool,
    jobs: int | None = None,
    traces: Path | None = None,
) -> Limits:
    """Return `limited` with the metric's values of a learning law's run after each advised change.

    `learner`: the run of that law. `holds`: whether this run held the speed. Changes of the limited
    controller's own keys are not tried.
    """
    tries = _Tries(study, learner, metric, limited.order, jobs, traces)
    of_drive = [cure for cure in limited.advised if not cure.of_law]
    if not of_drive:
        return limited
    metrics = tries.metrics([cure.changes for cure in of_drive])
    values = {id(cure): tries.value_of(after) for cure, after in zip(of_drive, metrics, strict=True)}
    return replace(
        limited,
        cures=[replace(cure, learner=values.get(id(cure))) for cure in limited.cures],
        learner=Learner(learner.controller, tries.value_of(learner.metrics) if holds else None),
    )


def _cures(tries: _Tries, study: Study, run: Run, metric: Metric, limited: Limits) -> list[Cure]:
    """Try changes against the named causes; return those whose run gave a value, the best first.

    A change that the whole study refuses is left out.
    """
    clear = dict.fromkeys(name for cause in limited.named[:NAMED_MOST] for name in cause.names)
    options = [(cause, candidate) for cause in clear for candidate in candidates(study, run, metric, cause)]
    changes = [tries.placed(option.changes) for _, option in options]
    cures = [
        Cure(cause, change, remaining, option.setting, _costs(study, run, metric, metrics))
        for (cause, option), change, metrics in zip(options, changes, tries.metrics(changes), strict=True)
        if (remaining := tries.value_of(metrics)) is not None and tries.fits(change)
    ]
    return sorted(cures, key=lambda cure: cure.value)


def _not_by_chance(tries: _Tries, study: Study, limited: Limits) -> Limits:
    """Mark the advised changes of `limited` that help only by chance; the next best then take their place.

    A change is tried with another seed if the design doubts the learning without or with the change.
    """
    seed = {"seed": other_seeds(study)[0]}
    doubted = bool(doubt(study, limited.controller, limited.scenario))
    checked: set[str] = set()
    while new := [cure for cure in limited.advised if repr(cure.changes) not in checked]:
        checked |= {repr(cure.changes) for cure in new}
        new = [cure for cure in new if doubted or _is_doubted(study, cure.changes, limited)]
        if not new:
            continue
        of_seed = [seed, *({**cure.changes, **seed} for cure in new)]
        before, *after = [tries.value_of(metrics) for metrics in tries.metrics(of_seed)]
        unhelpful = {
            repr(cure.changes)
            for cure, value in zip(new, after, strict=True)
            if value is None or (before is not None and value > HELPING_SHARE * before)
        }
        cures = [replace(c, by_chance=c.by_chance or repr(c.changes) in unhelpful) for c in limited.cures]
        limited = replace(limited, cures=cures)
    return limited


def _is_doubted(study: Study, changes: Changes, limited: Limits) -> bool:
    return bool(doubt(changed(study, changes), limited.controller, limited.scenario))


def _pairs(tries: _Tries, suspected: Sequence[Suspect], causes: Sequence[Cause], value: float) -> list[Cause]:
    """Pairs of the largest causes that together, but not alone, have most of the metric's square."""
    apart = {suspect.name: suspect for suspect in suspected if not suspect.companions}
    largest = [apart[cause.name] for cause in causes if cause.name in apart][:PAIRED_CAUSES]
    pairs = [
        Suspect(
            f"{a.name}{AND}{b.name}", {**a.without, **b.without}, {}, a.controller_knows or b.controller_knows
        )
        for a, b in combinations(largest, 2)
    ]
    values = [tries.value_of(metrics) for metrics in tries.metrics([tries.without(pair) for pair in pairs])]
    causes_of_two = [
        Cause(pair.name, without, 1 - (without / value) ** 2)
        for pair, without in zip(pairs, values, strict=True)
        if without is not None
    ]
    return [cause for cause in causes_of_two if cause.share >= MOST_SHARE]


def _costs(study: Study, run: Run, judged: Metric, metrics: Mapping[str, Value]) -> list[Cost]:
    """Metrics other than `judged` that a change made clearly worse."""
    costs = []
    for metric in study.metrics_in(run.scenario):
        name = result_name(metric)
        before, after = run.metrics.get(name), metrics.get(name)
        if metric == judged or metric.better_direction != "lower" or not before or isinstance(before, list):
            continue
        if isinstance(after, float) and after / before >= CLEARLY_WORSE:
            costs.append(Cost(name, before, after))
    return costs


def _negligible(study: Study, scenario: str, metric: Metric) -> float:
    """The metric's value, SI, below which a further reduction is no gain."""
    if metric.dimension is ANGULAR_SPEED:
        return SPEED_SHARE_LEAST * study.scenario[scenario].top_reference
    sensor = for_scenario(study, scenario).drive.position_sensor
    if metric.dimension is ANGLE and isinstance(sensor, Counted):
        return STEP_SHARE_LEAST * sensor.step
    return 0.0


class _Tries:
    """Runs of one controller in one scenario, each with other changes of the study."""

    def __init__(
        self,
        study: Study,
        run: Run,
        metric: Metric,
        order: float | None,
        jobs: int | None,
        traces: Path | None,
        in_jerks: bool = False,
    ) -> None:
        self._study, self._run, self._metric, self._order = study, run, metric, order
        self._jobs, self._traces, self._in_jerks = jobs, traces, in_jerks
        self._tried: dict[str, Mapping[str, Value]] = {repr({}): run.metrics}
        self._missed: dict[str, Miss] = {}

    def value_of(self, metrics: Mapping[str, Value]) -> float | None:
        """The judged metric's value, SI; None if the metric has no finite value."""
        value = metrics.get(result_name(self._metric))
        if isinstance(value, list):
            value = value[(self._metric.order or ()).index(self._order)] if self._order is not None else None
        return value if value is not None and math.isfinite(value) else None

    def metrics(self, of: Sequence[Changes]) -> list[Mapping[str, Value]]:
        """The run's metrics after each of these changes. Equal changes are tried once.

        The metrics are empty if the study refuses the change, the run fails or the speed isn't held.
        """
        new = {repr(changes): changes for changes in of if repr(changes) not in self._tried}
        studies = {
            key: study for key, changes in new.items() if (study := self._changed(changes)) is not None
        }
        self._tried |= {key: {} for key in new}
        for key, run, speed in zip(studies, *self._runs([*studies.values()]), strict=True):
            if speed is not None:
                self._missed[key] = speed
            if run is not None and (speed is None or (self._in_jerks and speed.kind == "error")):
                self._tried[key] = run.metrics
        return [self._tried[repr(changes)] for changes in of]

    def shortfalls(self, of: Sequence[Changes]) -> list[Shortfall | None]:
        """What the run lacks after each of these changes; None: the study refuses it, or the run fails."""
        lacking: list[Shortfall | None] = []
        for changes, metrics in zip(of, self.metrics(of), strict=True):
            speed, value = self._missed.get(repr(changes)), self.value_of(metrics)
            ripple = None if value is None else Shortfall(lost=0, ripple=value, error=0.0)
            lack = ripple if speed is None else UNHELD._replace(error=speed.error)
            lacking.append(lack if self.fits(changes) else None)
        return lacking

    def _runs(self, studies: Sequence[Study]) -> tuple[list[Run | None], list[Miss | None]]:
        """The run in each of these studies, None for a run that fails; and how it missed the speed, if so."""
        missed: dict[int, Miss | None] = {}
        by_id = {id(study): study for study in studies}

        def finished(study: AnyStudy, run: Run) -> None:
            own_study = by_id[id(study)]
            missed[id(study)] = missed_in(Results(own_study, [run]), own_study.metric[0], run)

        only = ["/".join((self._run.scenario, self._run.controller))]
        try:
            rolled = rollout(
                studies, only, self._jobs, keep_traces=False, traces=self._traces, finished=finished
            )
            if any(results.interrupted for results in rolled):
                raise KeyboardInterrupt
        except RunError as error:
            rolled = error.all_results
        runs = [next(iter(results.runs), None) for results in rolled]
        return runs, [missed.get(id(study)) for study in studies]

    def fits(self, changes: Changes) -> bool:
        """Whether the whole study, with its other scenarios and controllers, accepts these changes."""
        try:
            changed(self._study, changes)
        except StudyError:
            return False
        return True

    def without(self, suspect: Suspect) -> dict[str, Any]:
        """The changes that remove a cause."""
        return self.placed({**suspect.companions, **suspect.without}, suspect.controller_knows)

    def placed(self, changes: Changes, is_assumed: bool = True) -> dict[str, Any]:
        """The changes, each placed where it takes effect: in the study, or in the scenario's override.

        A key that the override sets is changed there. `is_assumed`: whether the controller knows of the
        changes. If not, changes of motor, drive and mechanics are placed only in the override.
        """
        scenario, override = self._run.scenario, self._override
        over = {tuple(map(str, split(key))) for key in override}
        placed: dict[str, Any] = {}
        for key, value in changes.items():
            path = tuple(map(str, split(key)))
            overridden = any(path[: len(other)] == other[: len(path)] for other in over)
            if overridden or (not is_assumed and path[0] in PLANT_TABLES):
                whole = {name: inner for name, inner in override.items() if not name.startswith(f"{key}.")}
                override = {**whole, key: value}
            else:
                placed[key] = value
        return (
            {**placed, f'scenario."{scenario}".override': override} if override != self._override else placed
        )

    @property
    def _override(self) -> dict[str, Any]:
        return self._study.scenario[self._run.scenario].override

    @cached_property
    def _alone(self) -> Study:
        """The study with this run's controller alone, without the numbers of the rule auto.

        The first metric judges the run.
        """
        return self._with_metrics(self._study.metrics_in(self._run.scenario))

    @cached_property
    def _at_samples(self) -> Study:
        """As `_alone`, but without metrics that need rows between current samples, save the judging one."""
        metrics = self._study.metrics_in(self._run.scenario)
        return self._with_metrics([m for m in metrics if not m.between_samples])

    def _with_metrics(self, metrics_kept: Sequence[Metric]) -> Study:
        study, scenario, controller = self._study, self._run.scenario, self._run.controller
        without_auto = unfilled(study, controller)
        source = without_auto.source
        tables = {key: source.tables[key] for key in source.tables if key not in OF_WHOLE_STUDIES}
        own = [m for m in metrics_kept if result_name(m) in self._run.metrics]
        places = [study.metric.index(m) for m in (self._metric, *(m for m in own if m != self._metric))]
        metrics = [source.tables["metric"][place] for place in places]
        tables["metric"] = [{**metrics[0], "scenarios": [scenario]}, *metrics[1:]]
        of_law = study.scenarios_of(controller)  # a rule looks at all of them
        tables["controller"] = {controller: tables["controller"][controller]}
        tables["scenario"] = {n: {**tables["scenario"][n], "controllers": [controller]} for n in of_law}
        for n, metric in enumerate(tables["metric"]):
            where = [name for name in metric.get("scenarios", of_law) if name in of_law]
            tables["metric"][n] = {**metric, "scenarios": where} if "scenarios" in metric else metric
        return with_tables(without_auto, tables)

    def _changed(self, changes: Changes) -> Study | None:
        """The study of this run alone with these changes; None if they are refused."""
        alone = self._at_samples if ROWS_KEY in changes else self._alone
        place = f"metric.{self._study.metric.index(self._metric)}."
        own = {
            f"metric.0.{key.removeprefix(place)}" if key.startswith(place) else key: value
            for key, value in changes.items()
        }
        try:
            return filled(changed(alone, own))
        except StudyError:
            return None
