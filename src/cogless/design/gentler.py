"""Changes that make a loop gentler: a finer or younger sensor, a slower feedback, weaker learning."""

from __future__ import annotations

import math

from cogless.catalogue import edge_timers
from cogless.design.changes import unit_text
from cogless.design.law_rules import pi_texts, rules_of
from cogless.study import Study
from cogless.study.messages import dotted
from cogless.study.position_sensor import Absolute, Counted, Encoder, Hall, Resolver
from cogless.study.reading import Changes

TRIED_HALVINGS = 12  # each tried gain is half the one before
CORNER_SHARES = (0.25, 0.5)  # corner of a PI's integral / crossover: 14 and 27 deg of phase lost


def finer_sensor(study: Study, factor: float) -> Changes | None:
    """The change to a position sensor with at least `factor` times the counts.

    None: the study has no key for the sensor's counts.
    """
    sensor, key = study.drive.position_sensor, "drive.position_sensor"
    if isinstance(sensor, Encoder):
        return {f"{key}.lines": math.ceil(sensor.lines * factor)}
    if isinstance(sensor, Absolute) and sensor.positions is not None:
        return {f"{key}.positions": math.ceil(sensor.positions * factor)}
    if isinstance(sensor, Absolute | Resolver):
        return {f"{key}.bits": (sensor.counts - 1).bit_length() + math.ceil(math.log2(factor))}
    return None


def other_law_rates(study: Study) -> list[Changes]:
    """Changes to the law's rate, from half to twice the present one, the nearest first.

    A faster rate is included only if its period is not shorter than the sensor's latency.
    """
    rates, sensor = study.drive.rates, study.drive.position_sensor
    latency = sensor.latency if isinstance(sensor, Counted) else 0.0
    periods = (n for n in range(-(-rates.divider // 2), 2 * rates.divider + 1) if n != rates.divider)
    near = sorted(periods, key=lambda n: abs(math.log(n / rates.divider)))
    return [
        {"drive.rates.speed_loop": f"{rates.current_loop / n:g} Hz"}
        for n in near
        if rates.current_loop % n == 0
        and rates.current_loop / n % 1 == 0
        and (n > rates.divider or n >= latency * rates.current_loop)
    ]


def timed_edges(study: Study) -> Changes | None:
    """The change to the speed method MT; None: sensor or drive can't do it, or the study has it."""
    sensor, key, make = study.drive.position_sensor, "drive.position_sensor", study.drive.make
    if make is not None and not edge_timers()[make]:
        return None
    if not isinstance(sensor, Encoder) or sensor.timed or sensor.latency:
        return None
    table = study.source.tables["drive"]["position_sensor"]
    own = {part: value for part, value in table.items() if part not in ("window", "observer_bandwidth")}
    if len(own) == len(table):
        return {f"{key}.speed_method": "MT"}
    return {key: {**own, "speed_method": "MT"}}  # the keys left out belong to other methods


def younger_speeds(study: Study) -> list[Changes]:
    """Changes to a speed of Hall sensors that is the mean over fewer edges, the most edges first.

    Empty if the sensors aren't evenly placed, since such a speed would show that.
    """
    sensor = study.drive.position_sensor
    if not isinstance(sensor, Hall) or any(sensor.placement):
        return []
    return [{"drive.position_sensor.edges": edges} for edges in range(sensor.edges - 1, 0, -1)]


def slower_feedback(study: Study, name: str, factor: float) -> Changes | None:
    """The change to a feedback `factor` times slower, equally damped; None: the law has no such gains."""
    return rules_of(study, name).slower(factor)


def slower_proportional(study: Study, name: str, factor: float, crossover: float) -> list[Changes]:
    """Changes to a PI with its gain divided by a factor, and an integral as quick as the new crossover bears.

    `crossover`: of the feedback as it is, rad/s. Empty: the law has no PI for the speed.
    """
    rules = rules_of(study, name)
    if rules.pi is None:
        return []
    kp, ki = rules.pi
    quick = [min(ki, share * crossover / factor * kp / factor) for share in CORNER_SHARES]
    return [rules.by_hand(pi_texts(kp / factor, integral)) for integral in quick]


def weaker_learning(study: Study, name: str, factor: float) -> Changes | None:
    """The change that divides the learning gains by a factor; None: the law has no such gains."""
    law, key = study.controller[name], dotted(("controller", name))
    values = {
        gain: unit_text(getattr(law, gain) / factor, law.unit_of(gain))
        for gain in law.LEARNING_GAINS
        if getattr(law, gain)
    }
    return {f"{key}.{gain}": value for gain, value in values.items()} or None
