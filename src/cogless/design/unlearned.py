"""Whether a law can learn in a scenario at all, or has learned in a run.

What is learned acts one period later. Until then a learning law acts like a law without a memory, maybe with
a higher gain, so its remaining error says nothing about its learning. A law that learns orders acts at once.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from cogless.design.learning import PeriodicLoop
from cogless.design.margins import Real
from cogless.design.order_learning import OrderLoop
from cogless.study import Study
from cogless.study.controller import Learning
from cogless.study.motion import course
from cogless.study.pi_afc import PiAfc
from cogless.study.space_controller import SpaceLearning

ALMOST = 0.995  # share of a period that counts as a whole one
FOLLOWS = 0.5  # of the way of its reference: a rotor that turns less does not follow it
NO_STEP = 1e-6  # relative variation; a speed that varies less is constant

Memory = Learning | SpaceLearning | PiAfc


def revolutions_learned(study: Study, name: str) -> Fraction | None:
    """Mechanical revolutions per learning period of a controller; None if it doesn't learn."""
    law = study.controller[name]
    if isinstance(law, Learning | PiAfc) or (isinstance(law, SpaceLearning) and law.learning):
        return law.revolutions(study.motor.pole_pairs)
    return None


def foreseen(study: Study, scenario: str, name: str) -> str | None:
    """The reason why a controller will learn nothing along a scenario's reference; None if it may learn."""
    law, experiment = study.controller[name], study.scenario[scenario]
    revolutions = revolutions_learned(study, name)
    if revolutions is None or not isinstance(law, Memory):
        return None
    begun = starts_too_late(law, experiment.duration) or never(study, scenario, name)
    if begun:
        return begun
    way = course(experiment)
    learns = way.time >= law.learning_start
    theta = np.cumsum(way.omega[learns]) * way.step
    return too_short(law, revolutions, theta, experiment.duration - law.learning_start, way.omega[learns])


def starts_too_late(law: Memory, end: float) -> str | None:
    """The message that learning starts only after the run's `end`, s; None if it starts before."""
    if law.learning_start < end:
        return None
    return f"learning_start is {law.learning_start:.3g} s, the run ends at {end:.3g} s"


def never(study: Study, scenario: str, name: str) -> str | None:
    """The reason why a memory learns nothing even at the scenario's top speed; None if it learns."""
    law, top = study.controller[name], study.scenario[scenario].top_speed
    if isinstance(law, SpaceLearning):
        fast = study.scenario[scenario].top_reference
        return "the reference never reaches omega_min" if fast < law.omega_min else None
    if not isinstance(law, Learning | PiAfc) or not top:
        return None
    kind = PeriodicLoop if isinstance(law, Learning) else OrderLoop
    return kind(study, name, top, scenario=scenario).frozen


def too_short(law: Memory, revolutions: Fraction, theta: Real, time: float, omega_ref: Real) -> str | None:
    """The message that too little was turned for any angle to be passed twice while learning; None if enough.

    All arguments are from the start of learning on: mechanical angle `theta` in rad, `time` in s, `omega_ref`
    in rad/s.
    """
    if isinstance(law, PiAfc):
        return None
    period = 2 * math.pi * float(revolutions)
    rise = float(np.max(theta - np.minimum.accumulate(theta), initial=0.0))
    fall = float(np.max(np.maximum.accumulate(theta) - theta, initial=0.0))
    if law.over_angle:
        turned, again = max(rise, fall), min(rise, fall)
        if again > period / law.cells:  # it turned back over angles that it had passed
            return None
    else:
        turned = float(np.sum(np.abs(np.diff(theta))))
    share = turned / period
    if share >= ALMOST:
        return None
    speed = float(np.max(np.abs(omega_ref), initial=0.0))
    constant = speed > 0 and float(np.ptp(omega_ref)) <= NO_STEP * speed
    if constant and share < FOLLOWS * time * speed / period:
        return f"the rotor turned by {share:.2g} of its period in {time:.3g} s"
    whole = f" of {period / speed:.3g} s" if constant else ""
    return f"{time:.3g} s are {share:.2g} of its period{whole}"
