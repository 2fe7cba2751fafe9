"""Whether a position sensor's edges come often enough for the loop around them.

At a speed omega an edge of q rad comes every T_e = q / omega. pi.py takes the measured speed to be the mean
over a sample, T / 2 late. Timed from edge to edge (T, MT) it is, where fewer than one edge comes in a sample,
the mean over the last T_e, and T_e / 2 old in the mean: T_e late, which costs w_c (T_e - T / 2) of the phase
margin at the crossover w_c. Where that is more than the margin the rotor goes from edge to edge and stops.

The speed between the last two edges stands until the next is overdue, then falls as q / t. Where intervals t
and r t < t alternate, its mean is (1 + r - ln r) / 2 times the true one: 1.10 at r = 1 / 2, 1.22 at 1 / 3. A
loop that holds that mean lets the rotor turn slower by so much.

Counted over a sample (M), or over a resolver's window, the mean is right, but comes in single counts: where
w_c T_e is above one, the rotor coasts from one to the next.
"""

from __future__ import annotations

import math

import numpy as np

from cogless.design.feedback import feedback_of
from cogless.design.pi import speed_loop
from cogless.design.position import position_margins
from cogless.design.ripple import sampled
from cogless.study import Study
from cogless.study.motion import course
from cogless.study.spoken import speed_text

SHARE = 0.05  # of the time that a reference moves: slower only for so long is passing
SPENT = 0.5  # of the phase margin
COASTS = 1.0  # rad


def slow_warning(study: Study, name: str) -> str | None:
    """A warning of the slowest speed that a controller holds; None where it has edges enough."""
    found = (_warning(study, name, key) for key in study.scenario if name in study.controllers_in(key))
    return next((line for line in found if line is not None), None)


def _warning(study: Study, name: str, scenario: str) -> str | None:
    omega, loop = held(study, scenario), speed_loop(study, scenario)
    source, feedback = sampled(study, scenario), feedback_of(study, name, omega)
    if not omega or source is None or feedback is None:
        return None
    margins = position_margins(loop, feedback)
    if not margins.stable or math.isnan(margins.crossover):
        return None
    edge, w_c = source.count / omega, margins.crossover
    comes = f"at {speed_text(study, omega)} an edge comes every {1e3 * edge:.2g} ms"
    around = f"the crossover is {w_c / math.tau:.3g} Hz"
    if not source.timed:
        if w_c * edge <= COASTS:
            return None
        needed = w_c * source.count / omega / COASTS
        return f"{comes}, {around}: the rotor coasts from count to count; {_helps(needed, w_c)}"
    late = edge - loop.period / 2
    lost = w_c * late / margins.phase_margin
    if lost <= SPENT:
        return None
    allowed = SPENT * margins.phase_margin / w_c + loop.period / 2
    high = "; where it stops and goes it reads high, by 10 % if every other edge takes twice as long"
    costs = f"the speed is {1e3 * late:.2g} ms late, which costs {math.degrees(w_c * late):.0f} deg"
    costs += f" of {math.degrees(margins.phase_margin):.0f} deg of phase margin"
    return f"{comes}, {around}: {costs}{high if lost > 1 else ''}; {_helps(edge / allowed, w_c)}"


def held(study: Study, scenario: str) -> float:
    """The slowest speed that a scenario's reference holds, rad/s; 0 where it never moves."""
    omega = np.abs(course(study.scenario[scenario]).omega)
    moving = omega[omega > 0]
    return float(np.quantile(moving, SHARE)) if len(moving) else 0.0


def _helps(factor: float, w_c: float) -> str:
    return f"{factor:.2g} times the counts would do, or a crossover of {w_c / math.tau / factor:.2g} Hz"
