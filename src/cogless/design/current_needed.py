"""Whether the drive has the current that a scenario's motion needs.

With the functions of model (1), i = alpha(theta) + beta omega + h a. The mean of i over the angle carries
load, friction and acceleration. The part of i that varies with the angle cancels the ripple. If the limit is
below the mean, the rotor doesn't follow. If it is below the peak, ripple remains.

A rotor at rest needs the current of its breakaway friction and its cogging before it turns. A slow feedback
takes its time to ask for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.changes import either, helping, text
from cogless.design.closed_loop import Linear
from cogless.study import Study, for_scenario
from cogless.study.motion import course
from cogless.study.reading import Changes
from cogless.study.remark import Remark

WAVE_POINTS = 8  # angles in a wave of the highest order
CURRENT_RESERVE = 1.1  # limit that is advised / current that is needed


@dataclass(frozen=True)
class Needed:
    """Magnitudes of the current i_q that a scenario's motion needs, A."""

    mean: float  # the largest mean over the angle
    most: float  # the peak over angle and time


def needed(study: Study, scenario: str) -> Needed:
    """The current that a scenario's reference, load, load events and cogging need."""
    here, of = functions_in(study, scenario), for_scenario(study, scenario)
    experiment, K_t = study.scenario[scenario], of.motor.star().K_t
    theta = np.linspace(0, math.tau, WAVE_POINTS * max([*here.orders, 16]), endpoint=False)
    alpha = here.alpha(theta)
    mean = float(np.mean(alpha))
    load = experiment.load or of.mechanics.load
    steps = [0.0, *((event.load - load.torque) / of.mechanics.ratio / K_t for event in experiment.events)]
    way = course(experiment)
    moving = float(np.mean(here.beta(theta))) * way.omega + float(np.mean(here.h(theta))) * way.alpha
    means = [mean + step + moving for step in steps]
    largest = max(float(np.max(np.abs(each))) for each in means)
    return Needed(largest, largest + float(np.max(np.abs(alpha - mean))))


def starts_after(study: Study, scenario: str, feedback: Linear, omega: float) -> float:
    """Time, s, after which a feedback asks a resting rotor for the current that starts it, at a reference of
    `omega`, rad/s; infinite if it never does.

    Its output is ratio omega (k + (k k_theta + k_i + k_r) t + k_i k_theta t^2 / 2).
    """
    here = for_scenario(study, scenario)
    star, size = here.motor.star(), feedback.ratio * abs(omega)
    friction = here.mechanics.breakaway + sum(abs(wave.torque or 0.0) for wave in star.cogging)
    missing = friction / star.K_t - feedback.k * size
    slope = (feedback.k * feedback.k_theta + feedback.k_i + feedback.k_r) * size
    bend = feedback.k_i * feedback.k_theta * size / 2
    if missing <= 0:
        return 0.0
    if bend > 0:
        return (math.sqrt(slope**2 + 4 * bend * missing) - slope) / (2 * bend)
    return missing / slope if slope > 0 else math.inf


def too_much_current(study: Study, scenario: str) -> Remark | None:
    """Warning that the motion, or an even speed, needs more current than the limit; None if neither does."""
    limit, found = for_scenario(study, scenario).drive.current_loop.current_limit, needed(study, scenario)
    if found.most <= limit:
        return None
    if found.mean > limit:
        said = f"its motion and load take {found.mean:.3g} A, and current_limit is {limit:.3g} A"
    else:
        said = f"to turn evenly takes up to {found.most:.3g} A, and current_limit is {limit:.3g} A"

    def cured(other: Study) -> bool:
        there = for_scenario(other, scenario).drive.current_loop.current_limit
        return needed(other, scenario).most <= there

    more: Changes = {"drive.current_loop.current_limit": text(CURRENT_RESERVE * found.most, "A")}
    cures = helping(study, (more,), cured)
    return Remark(f"{said}; {either(cures)} would do" if cures else said, cures)
