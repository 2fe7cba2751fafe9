"""What a law that learns in angle needs of the motor, the reference and the rates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cogless.study.space_controller import SpaceLearning, SpacePosition
from cogless.study.table import problem

if TYPE_CHECKING:
    from cogless.study.study import Study

FEWEST_SAMPLES = 4  # of a period


def space_laws(study: Study) -> None:
    """Periods that fit the motor; a delay line long enough, for a speed that never comes near zero."""
    rate = study.drive.rates.speed_loop
    for name, law in study.controller.items():
        if not isinstance(law, SpaceLearning):
            continue
        revolutions = law.period.revolutions(study.motor.pole_pairs)
        by_rotor = not isinstance(law, SpacePosition) or law.index == "rotor"
        if by_rotor and (1 / revolutions).denominator != 1:
            expected = "expected a period that fits into a revolution of the rotor, not"
            raise problem(f"{expected} {float(revolutions):.4g} of one", "controller", name, "period")
        for key, scenario in study.scenario.items():
            if not law.learning or name not in study.controllers_in(key):
                continue
            reference, turn = scenario.reference, 2 * math.pi * float(revolutions)
            if reference.top_speed > 0 and rate * turn / reference.top_speed < FEWEST_SAMPLES:
                samples = rate * turn / reference.top_speed
                expected = f"expected a longer one: at the top speed of scenario {key} it has {samples:.3g} "
                needed = f"samples, at least {FEWEST_SAMPLES} are needed"
                raise problem(expected + needed, "controller", name, "period")
            if law.memory == "delay":
                _delay_line(name, key, law, reference.slowest, rate * turn)


def _delay_line(name: str, scenario: str, law: SpaceLearning, slowest: float, reach: float) -> None:
    if slowest < law.omega_min:
        expected = f'expected "map": the reference of scenario {scenario} comes down to {slowest:.4g} rad/s, '
        needed = f"and a delay line needs omega_min, {law.omega_min:g} rad/s, or more"
        raise problem(expected + needed, "controller", name, "memory")
    samples = math.ceil(reach / slowest)
    if samples > law.cells:
        expected = f"expected {samples} or more, the samples of a period at the slowest speed of scenario"
        raise problem(f"{expected} {scenario}", "controller", name, "cells", value=law.cells)
