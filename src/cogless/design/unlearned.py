"""Whether a law can learn in a scenario: by the scenario's length, by the run, by its map's cells.

Whether a law can learn in a scenario at all, or has learned in a run.

What is learned acts one period later. Until then a learning law acts like a law without a memory, maybe with
a higher gain, so its remaining error says nothing about its learning. A law that learns orders acts at once.

Whether a map over the angle has enough cells for the known orders of motor and load.

A map interpolates linearly between two cells. This has the gain sinc^2(1 / c) for a wave of c cells per
wavelength. With fewer than 2 cells per wavelength the wave is aliased to a slower one. The Q filter is a
moving mean. In each period it keeps 0.83 of a wave that is three times as long as the filter is wide, and
almost nothing of a wave that is as long as the filter.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.changes import cure_words, helping
from cogless.design.law_rules import rules_of
from cogless.design.margins import Real
from cogless.design.verdict import judgement
from cogless.study import Study
from cogless.study.laws.law import Memory
from cogless.study.messages import dotted
from cogless.study.motion import course
from cogless.study.reading import Changes, Remark
from cogless.units import TURN

WHOLE_PERIOD_SHARE = 0.995  # share of a period that counts as a whole one
FOLLOWING_SHARE = 0.5  # a rotor that turns less than this share of its reference does not follow it
NO_STEP = 1e-6  # relative variation; a speed that varies less is constant


def revolutions_learned(study: Study, name: str) -> Fraction | None:
    """Mechanical revolutions per learning period of a controller; None if it doesn't learn."""
    memory = rules_of(study, name).memory
    return None if memory is None else memory.revolutions(study.motor.pole_pairs)


def foreseen(study: Study, scenario: str, name: str) -> str | None:
    """The reason why a controller will learn nothing along a scenario's reference; None if it may learn."""
    memory, experiment = rules_of(study, name).memory, study.scenario[scenario]
    if memory is None:
        return None
    begun = starts_too_late(memory, experiment.duration) or never(study, scenario, name)
    if begun:
        return begun
    way = course(experiment)
    learns = way.time >= memory.learning_start
    theta = np.cumsum(way.omega[learns]) * way.step
    time, revolutions = (
        experiment.duration - memory.learning_start,
        memory.revolutions(study.motor.pole_pairs),
    )
    return too_short(memory, revolutions, theta, time, way.omega[learns])


def starts_too_late(law: Memory, end: float) -> str | None:
    """The message that learning starts only after the run's `end`, s; None if it starts before."""
    if law.learning_start < end:
        return None
    return f"learning_start is {law.learning_start:.3g} s, but the run ends at {end:.3g} s"


def never(study: Study, scenario: str, name: str) -> str | None:
    """The reason why a memory learns nothing even at the scenario's top speed; None if it learns."""
    return rules_of(study, name).never(scenario)


def too_short(law: Memory, revolutions: Fraction, theta: Real, time: float, omega_ref: Real) -> str | None:
    """The message that too little was turned for any angle to be passed twice while learning; None if enough.

    All arguments are from the start of learning on: mechanical angle `theta` in rad, `time` in s, `omega_ref`
    in rad/s.
    """
    if law.by_order:
        return None
    period = TURN * float(revolutions)
    rise = float(np.max(theta - np.minimum.accumulate(theta), initial=0.0))
    fall = float(np.max(np.maximum.accumulate(theta) - theta, initial=0.0))
    if law.over_angle:
        turned, again = max(rise, fall), min(rise, fall)
        if again > period / law.cells:  # it turned back over angles that it had passed
            return None
    else:
        turned = float(np.sum(np.abs(np.diff(theta))))
    share = turned / period
    if share >= WHOLE_PERIOD_SHARE:
        return None
    speed = float(np.max(np.abs(omega_ref), initial=0.0))
    constant = speed > 0 and float(np.ptp(omega_ref)) <= NO_STEP * speed
    if constant and share < FOLLOWING_SHARE * time * speed / period:
        return f"in {time:.3g} s the rotor turned by only {share:.2g} of the law's learning period"
    whole = f" of {period / speed:.3g} s" if constant else ""
    return f"learning lasts {time:.3g} s, which is {share:.2g} of the law's learning period{whole}"


WAVE_CELLS_LEAST, WAVE_CELLS_ENOUGH = 2.0, 10.0  # cells per wavelength of the highest order
CELL_ROUNDING = 1e-9  # relative error of a number of cells
FILTERS_PER_WAVE = 3  # Q filter widths per wavelength of the highest order


def map_warning(study: Study, name: str) -> Remark | None:
    """Warning that a map has too few cells for the known orders; None if there are enough, or no map."""
    wave = _wave(study, name)
    if wave is None or wave[0] >= wave[1]:
        return None
    (cells, enough, order), law = wave, rules_of(study, name).memory
    assert law is not None
    has = f"with cells = {law.cells} a wave of order {order} (mechanical) has only {cells:.3g} cells"
    width = 2 * law.q_half_width + 1
    lost = 100 * (1 - share_kept(cells, law.q_half_width))
    if cells < WAVE_CELLS_LEAST:
        does = "too few for a map to hold the wave"
    elif law.q_half_width == 0:
        does = f"linear interpolation between cells loses {lost:.2g} % of the wave"
    else:
        losing = f"linear interpolation between cells and the Q filter over {width} cells"
        does = f"{losing} together lose {lost:.0f} % of the wave in each period"
    key = dotted(("controller", name))
    more: Changes = {f"{key}.cells": math.ceil(law.cells * enough / cells * (1 - CELL_ROUNDING))}
    narrower: Changes = {f"{key}.q_half_width": max(0, int(cells / FILTERS_PER_WAVE - 1) // 2)}
    now = _settles(study, name)

    def cured(other: Study) -> bool:
        after = _wave(other, name)
        return after is not None and after[0] >= after[1] and _settles(other, name) >= now

    cures = helping(study, (more, narrower), cured)
    return Remark(f"{has}: {does}{cure_words(cures, key)}", cures)


def _wave(study: Study, name: str) -> tuple[float, float, int] | None:
    """The map's cells per wave of the highest known order, the number that is enough, and that order.

    None: the law has no map over the angle, or no order is known.
    """
    law = rules_of(study, name).memory
    orders = {n for key in study.scenarios_of(name) for n in functions_in(study, key).orders}
    if law is None or law.by_order or not law.over_angle or not orders:
        return None
    revolutions = law.revolutions(study.motor.pole_pairs)
    order, enough = max(orders), max(WAVE_CELLS_ENOUGH, FILTERS_PER_WAVE * (2 * law.q_half_width + 1))
    return law.cells / (order * float(revolutions)), enough, order


def _settles(study: Study, name: str) -> bool:
    """Whether a controller's learning settles, by its design."""
    verdict = judgement(study, name)
    return verdict is not None and verdict.kind == "settles"


def share_kept(cells: float, half_width: int) -> float:
    """The share of a wave that a map with a Q filter keeps in a period; the wave is `cells` cells long."""
    width = 2 * half_width + 1
    filtered = np.sinc(width / cells) / np.sinc(1 / cells)
    return float(abs(filtered) * np.sinc(1 / cells) ** 2)
