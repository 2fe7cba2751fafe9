"""Check a law that learns over the angle against the motor, the reference and the rates."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from cogless.control_library import real_number
from cogless.study.laws.law import LINE_SAMPLES_MOST
from cogless.study.laws.space import SpaceLearning
from cogless.study.table import check_precision, invalid
from cogless.units import TURN

if TYPE_CHECKING:
    from cogless.study.speed_study import Study

FEWEST_SAMPLES = 4  # of a period
ANGLE_MAX = real_number("CGL_ANGLE_MAX")  # rad
MOST_PARTS = 65535  # largest denominator of a period in revolutions of the law's angle


def space_laws(study: Study) -> None:
    """Check that the learned period suits the motor and the speeds, and that a delay line is long enough.

    A delay line also needs a reference speed that doesn't come near zero.
    """
    rate = study.drive.rates.outer_loop
    for name, law in study.controller.items():
        if not isinstance(law, SpaceLearning):
            continue
        revolutions = law.revolutions(study.motor.pole_pairs)
        _numbers(study, name, law)
        _angles(name, revolutions, law.ratio(study.motor.pole_pairs))
        if law.by_rotor and (1 / revolutions).denominator != 1:
            expected = "expected a period that fits into a revolution of the rotor, not"
            raise invalid(f"{expected} {float(revolutions):.4g} of one", "controller", name, "period")
        for key, scenario in study.scenario.items():
            if not law.learning or name not in study.controllers_in(key):
                continue
            top, turn = scenario.top_reference, TURN * float(revolutions)
            if top > 0 and rate * turn / top < FEWEST_SAMPLES:
                samples = rate * turn / top
                expected = f"expected a longer one: at the top speed of scenario {key} it has {samples:.3g} "
                needed = f"samples, at least {FEWEST_SAMPLES} are needed"
                raise invalid(expected + needed, "controller", name, "period")
            if law.memory == "delay":
                _delay_line(name, key, law, scenario.speeds[0], rate * turn)


def _numbers(study: Study, name: str, law: SpaceLearning) -> None:
    """Check that the law's numbers fit the controller's number type, and that k_pp is below the loop's
    rate."""
    # `terms`: the Q filter adds up this many entries
    check_precision(law, study.drive.precision, "controller", name, terms=2 * law.q_half_width + 2)
    rate = study.drive.rates.outer_loop
    if law.memory == "delay" and law.delay_method == "ode" and law.k_pp >= rate:
        raise invalid(f"expected less than drive.rates.speed_loop, {rate:g} Hz", "controller", name, "k_pp")


def _angles(name: str, revolutions: Fraction, ratio: int) -> None:
    """Check that the reference angle stays small enough.

    The controller counts it up to the smallest angle that is a whole number of revolutions and of learned
    periods.
    """
    longest = int(ANGLE_MAX / (TURN * ratio))
    if revolutions.numerator > longest:
        expected = f"expected at most {longest} revolutions, until whole periods are whole revolutions, not"
        raise invalid(f"{expected} {revolutions.numerator}", "controller", name, "period")
    if (ratio * revolutions).denominator > MOST_PARTS:
        raise invalid(f"expected at most {MOST_PARTS} parts", "controller", name, "period")


def _delay_line(name: str, scenario: str, law: SpaceLearning, slowest: float, reach: float) -> None:
    if slowest < law.omega_min:
        expected = f'expected "map": the reference of scenario {scenario} comes down to {slowest:.4g} rad/s, '
        needed = f"and a delay line needs omega_min, {law.omega_min:g} rad/s, or more"
        raise invalid(expected + needed, "controller", name, "memory")
    samples = math.ceil(reach / slowest)
    if samples > LINE_SAMPLES_MOST:
        expected = f'expected "map": a period at the slowest speed of scenario {scenario} has {samples} '
        needed = f"samples, and a delay line at most {LINE_SAMPLES_MOST}"
        raise invalid(expected + needed, "controller", name, "memory")
    if samples > law.cells:
        expected = f"expected {samples} or more, the samples of a period at the slowest speed of scenario"
        raise invalid(f"{expected} {scenario}", "controller", name, "cells", value=law.cells)
