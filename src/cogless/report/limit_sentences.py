"""Sentences on what limits a scenario's best run, with the changes that they advise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from cogless.catalogue import sensor_words
from cogless.design.answers import other_seeds
from cogless.design.changes import SENSOR, SENSOR_BITS
from cogless.report.comparison import shown_in, spoken
from cogless.report.markup import number
from cogless.report.verdicts import called, listed, ratio, times
from cogless.results.limits import CAUSES, NAMED_MOST, TORQUE_RIPPLE, Cause, Cure, Harm, Limits
from cogless.results.metrics import result_name
from cogless.study.base import StudyBase
from cogless.study.messages import MISSING, dotted, look_up
from cogless.study.metric import Metric
from cogless.study.reading import Changes, Remark, split
from cogless.study.toml import toml

# How a run would be without a cause, where "without" and the cause's name read badly.
WITHOUT = {
    "learning-time": "in a longer run",
    TORQUE_RIPPLE: "without any torque ripple",
    "delay": "with an exact position sensor in a loop without delay",
    "belief": "with the true motor parameters",
}


def remark(study: StudyBase, limits: Limits) -> Remark | None:
    """The causes that limit a run, and the setting and part that helped most; None: no cause stands out."""
    named = limits.named
    in_vain = _in_vain(study, limits)
    if not (named or limits.holding):
        text = in_vain or _by_chance(study, limits)
        return Remark(text) if text else None

    def with_unit(value: float) -> str:
        return _with_unit(study, _metric(study, limits, limits.metric), value)

    if limits.holding is not None:
        cure = limits.holding
        text = f"With {setting(study, cure.changes)}, {called(study, limits.controller)} held the speed:"
        text += f" simulated again, it left {with_unit(cure.value)}{_harms(study, cure)}."
        return Remark(text, (cure.changes,))
    parts = [f"{with_unit(cause.value)} {_cause_words(cause)}" for cause in named[:NAMED_MOST]]
    own = f"{called(study, limits.controller)}, which leaves {with_unit(limits.value)}"
    text = f"What limits {own}: simulated again, it left {listed(parts)}."
    by_chance = _by_chance(study, limits)
    text += "".join(f" {sentence}" for sentence in (in_vain, by_chance) if sentence)
    if limits.cures and not (limits.advised or in_vain or by_chance):
        text += " No change that was tried leaves clearly less."
    for cure in limits.advised:
        text += f" {'A setting' if cure.setting else 'Other hardware'} that was tried:"
        text += f" {setting(study, cure.changes)}{_sensor(study, cure)} left {with_unit(cure.value)}"
        text += f"{_costs(study, limits, cure)}{_harms(study, cure)}."
        text += _of_learner(study, limits, cure, with_unit)
    return Remark(text, tuple(cure.changes for cure in limits.advised))


def _by_chance(study: StudyBase, limits: Limits) -> str:
    """A sentence on the best change that helped only with the study's seed; "" if there is none."""
    cure = next((cure for cure in limits.cures if cure.by_chance), None)
    if cure is None:
        return ""
    seeds = f"with seed={study.seed}, but not with seed={other_seeds(study)[0]}"
    return f"The change {setting(study, cure.changes)} is not advised, since it helped by chance: {seeds}."


def _in_vain(study: StudyBase, limits: Limits) -> str:
    """The settings with which a controller does not hold the speed; "" if none were tried or one holds it."""
    vain = limits.in_vain
    if vain is None:
        return ""
    name = called(study, vain.controller)
    return f"Tried in vain to hold the speed with {name}: {listed(vain.settings)}."


def _of_learner(study: StudyBase, limits: Limits, cure: Cure, with_unit: Callable[[float], str]) -> str:
    """What the law that learns leaves with a cure and without it; "" if that law was not tried."""
    learner = limits.learner
    if learner is None or cure.of_law or (learner.value is None and cure.learner is None):
        return ""
    name = called(study, learner.controller)
    if cure.learner is None:
        return f" {name} then did not hold the speed."
    before = "not holding the speed" if learner.value is None else with_unit(learner.value)
    return f" {name} then left {with_unit(cure.learner)} instead of {before}."


def setting(study: StudyBase, changes: Changes) -> str:
    """Changes in words, each with its whole key, as the study or `--set` takes it.

    A controller with another law is written as a whole. A key that is deleted is written as `KEY=`.
    """
    new = [entry for name, value in changes.items() for entry in _new(study, split(name), value)]
    return " and ".join(
        f"{dotted(key)}= (deletes this key)" if value is None else f"{dotted(key)} = {toml(value)}"
        for key, value in new
    )


def _cause_words(cause: Cause) -> str:
    """How a run would be without the cause; two causes that only act together are named together."""
    words = " and ".join(WITHOUT.get(name, f"without {CAUSES[name]}") for name in cause.names)
    return words if len(cause.names) == 1 else f"both {words}"


def _sensor(study: StudyBase, cure: Cure) -> str:
    """What a change of the position sensor needs: sensors with so many bits, or a timer; "" if nothing.

    A timer is named only if the study names no drive; else only what its drive can do is tried.
    """
    bits, sensor = cure.changes.get(SENSOR_BITS), cure.changes.get(SENSOR, {})
    if "MT" in (cure.changes.get(f"{SENSOR}.speed_method"), sensor.get("speed_method")):
        make = look_up(study.source.tables, ("drive", "make"))
        return " (if the drive can time edges)" if make is MISSING else ""
    return "" if bits is None else f" ({sensor_words(bits)})"


def _costs(study: StudyBase, limits: Limits, cure: Cure) -> str:
    """The metric that a cure harms most, such as ", but 2.1 times the dip (6 rpm)"; "" if it harms none."""
    if not cure.costs:
        return ""
    cost = max(cure.costs, key=lambda cost: cost.ratio)
    metric = _metric(study, limits, cost.metric)
    return f", but {times(cost.ratio)} the {spoken(metric.name)} ({_with_unit(study, metric, cost.value)})"


def _metric(study: StudyBase, limits: Limits, name: str) -> Metric:
    """The metric of the scenario that has this name in results.json."""
    return next(metric for metric in study.metrics_in(limits.scenario) if result_name(metric) == name)


def _with_unit(study: StudyBase, metric: Metric, value: float) -> str:
    unit, scale = shown_in(study, metric)
    return f"{number(value / scale)} {unit}".rstrip()


def _harms(study: StudyBase, cure: Cure) -> str:
    """What the change does in the scenarios that it makes clearly worse; "" if there are none."""
    parts = [f"in {harm.scenario} {called(study, harm.controller)} then {_harm(harm)}" for harm in cure.harms]
    return f"; but {listed(parts)}" if parts else ""


def _harm(harm: Harm) -> str:
    if harm.value is None:
        return "did not hold the speed"
    return f"left {times(ratio(harm.value, harm.before))} as much"


def _new(study: StudyBase, key: tuple[Any, ...], value: Any) -> list[tuple[tuple[Any, ...], Any]]:
    """The keys whose values a change replaces, with the new values; None: the change removes the key."""
    old = look_up(study.source.tables, key)
    if isinstance(value, Mapping) and "law" in value:
        return [(key, value)]
    if not isinstance(value, Mapping) or not isinstance(old, Mapping):
        return [] if old == value else [(key, value)]
    gone = [((*key, name), None) for name in old if name not in value]
    return [pair for name, inner in value.items() for pair in _new(study, (*key, name), inner)] + gone
