"""How long a law learns until nine tenths of the ripple that it will take away are gone.

The models are those of ripple.py and learning_loop.py. Under the law `harmonic` an order's amplitude fades
as exp(-Re Gamma rate t / 2), with Gamma of laws/harmonic_transfer.py. The models are for small signals, and
`left_out` names what they lack of a drive. Without that, runs of drafts of `cogless new` settle
within a turn and twice the time; otherwise some take ten times as long (tests/design/test_settling.py has
both).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cogless.design.law_rules import feedback_of
from cogless.design.laws.harmonic import Certificate, harmonic_gains, loses_voltage
from cogless.design.laws.harmonic_transfer import gamma
from cogless.design.learning_loop import LearningLoop
from cogless.design.ripple import disturbed, orders, ripple
from cogless.design.speed_loop import speed_loop
from cogless.design.verdict import judged
from cogless.study import Study, for_scenario
from cogless.study.position_sensor import Counted, Hall

REMAINING_SHARE = 0.1  # share of the ripple that learning takes away; with this left, learning has settled
SETTLING_STEPS_MOST = 1 << 20  # learning periods, or thousandths of a time constant


@dataclass(frozen=True)
class Settling:
    """The time in which learning settles at one speed, and the longest scenario that holds that speed."""

    omega_m: float  # rad/s
    time: float  # s
    scenario: str
    duration: float  # s, of the scenario

    @property
    def in_time(self) -> bool:
        """Whether the scenario lasts until learning has settled."""
        return self.duration >= self.time


def settling(study: Study, name: str, certified: Certificate | None = None) -> list[Settling]:
    """The times at the slowest and the fastest speed that scenarios of a controller hold.

    `certified`: the certificate of the law `harmonic`. Empty if the reference varies in all scenarios, or if
    learning takes nothing away.
    """
    times: dict[float, float] = {}
    longest: dict[float, str] = {}
    for scenario in study.scenarios_of(name):
        omega = study.scenario[scenario].constant_speed
        if omega is None:
            continue
        if certified is not None:
            time = _time_of_harmonic(study, name, scenario, omega, certified)
        else:
            times_of_loops = (_time_of_loop(loop) for loop in judged(study, scenario, name))
            time = next((each_time for each_time in times_of_loops if each_time), None)
        if time is not None:
            times[omega] = max(time, times.get(omega, 0.0))
        best = longest.setdefault(omega, scenario)
        if study.scenario[scenario].duration > study.scenario[best].duration:
            longest[omega] = scenario
    speeds = sorted(times)
    return [
        Settling(omega, times[omega], longest[omega], study.scenario[longest[omega]].duration)
        for omega in dict.fromkeys([*speeds[:1], *speeds[-1:]])
    ]


def left_out(study: Study, name: str) -> list[str]:
    """What the drive of a controller's scenarios has and the model of its settling time lacks, in words."""
    drives = [for_scenario(study, scenario) for scenario in study.scenarios_of(name)]
    sensors = [one.drive.position_sensor for one in drives]
    phases = [one.drive.current_sensors for one in drives if not one.drive.ideal]
    # the model of the other laws has the noise of counts: ripple.py
    over_counts = study.controller[name].learns_every_order
    of_sensor = {
        "steps": over_counts and any(isinstance(one, Counted | Hall) for one in sensors),
        "error": any(map(_errs, sensors)),
    }
    parts = [word for word, present in of_sensor.items() if present]
    lacks = {
        "dead time": any(loses_voltage(one) for one in drives),
        "current noise": any(sensor.noise or sensor.bits for sensor in phases),
        f"the position sensor's {' and '.join(parts)}": bool(parts),
    }
    return [words for words, present in lacks.items() if present]


def _errs(sensor: object) -> bool:
    """Whether a position sensor has an error that repeats with the angle."""
    if isinstance(sensor, Hall):
        return any(sensor.placement)
    return isinstance(sensor, Counted) and bool(sensor.fields()["error"] or sensor.fields()["error_table"])


def _time_of_harmonic(
    study: Study, name: str, scenario: str, omega: float, certified: Certificate
) -> float | None:
    feedback = feedback_of(study, name, omega)
    speed = next((at for at in certified.speeds if at.fine and math.isclose(at.omega_m, omega)), None)
    n, d = orders(study, scenario, omega)
    if speed is None or feedback is None or not len(n):
        return None
    learner, loop = certified.learner, speed_loop(study, scenario)
    w = np.asarray(n * omega, dtype=np.float64)
    alone = disturbed(loop, feedback, w / math.tau) * d
    learned = np.isin(n, certified.learned_orders(speed))
    # a low speed bounds the rate: pi radians of the base order are the shortest time constant
    rate = min(speed.rate, learner.base * omega / math.pi)
    decay = np.where(learned, rate / 2 * gamma(loop, learner, harmonic_gains(study, name), w).real, 0.0)

    def remaining(steps: float) -> float:
        return math.sqrt(float(np.sum((alone * np.exp(-decay * steps / 1000 / rate)) ** 2)))

    steps = _steps(remaining, remaining(0), math.sqrt(float(np.sum(alone[decay <= 0] ** 2))))
    return None if steps is None else steps / 1000 / rate


def _time_of_loop(loop: LearningLoop) -> float | None:
    if loop.learns_more:
        return None
    period = 1 / loop.periods_per_second

    def remaining(steps: float) -> float:
        return ripple(loop, steps * period, settled=False).learned

    steps = _steps(remaining, ripple(loop, 0.0).without, ripple(loop, SETTLING_STEPS_MOST * period).learned)
    return None if steps is None else steps * period


def _steps(remaining: Callable[[float], float], begin: float, end: float) -> int | None:
    """The steps until a tenth is left of the way from `begin` to `end`; None if there is no such way."""
    if begin <= end:
        return None
    goal = end + REMAINING_SHARE * (begin - end)
    few, many = 0, 1
    while remaining(many) > goal:
        few, many = many, 2 * many
        if many > SETTLING_STEPS_MOST:
            return None
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (middle, many) if remaining(middle) > goal else (few, middle)
    return many
