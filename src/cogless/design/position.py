"""Position feedback of the laws that learn in angle, and its tuning for a phase margin, for fair comparison.

The open loop, closed through omega_t = omega - omega_ref + k_theta (theta - theta_ref), is

    L = (k_omega + k_i T z / (z - 1)) (P_omega + k_theta P_theta),    z = exp(jwT)

with the plants P of pi.py. If the law has v(omega), it is added to k_omega. If it has k_v, k_v P_theta is
added to L. `ratio` converts all mechanical angles to the frame of the gains.

The rule gives the stiffest loop with the wanted margin. Both of its zeros are at the same frequency, k_i / K
= k_theta with K = k_omega + k_i T / 2 (docs/theory/learning-in-angle.md#a-fair-pi). It is found by search. A
formula for a delay that is the same at all frequencies isn't good enough: the delay of verrelli2016's current
loop falls from 2 ms to 0.6 ms over frequency, and the formula's loop would be 4 to 6 times too soft at 45
deg.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from cogless.design.closed_loop import Linear
from cogless.design.current_loop import CurrentLoop, NoMarginError, tuned
from cogless.design.margins import UNSTABLE, Complex, Margins, Real, margins_of, root
from cogless.design.pi import SpeedLoop, gains, speed_loop, tuning_of
from cogless.study import Study
from cogless.study.controller import Tuning
from cogless.study.harmonic import Harmonic
from cogless.study.space_controller import SpacePosition

POINTS = 2000  # frequencies
PLACES = 200  # tried for the zeros
Gains = tuple[float, float, float]  # k_theta, k_omega, k_i, in the law's frame


def feedback_at(study: Study, name: str, omega_m: float) -> Linear:
    """A position law's feedback before it learns, with v and k_v, at mechanical speed omega_m in rad/s."""
    law = study.controller[name]
    assert isinstance(law, SpacePosition)
    ratio, (k_theta, k_omega, k_i) = law.ratio(study.motor.pole_pairs), position_gains(study, name)
    v = law.v_0 + law.v_2 * (ratio * omega_m) ** 2
    return Linear(ratio=ratio, k=k_omega + v, k_theta=k_theta, k_i=k_i, k_v=law.k_v)


def position_gains(study: Study, name: str) -> Gains:
    """k_theta, k_omega and k_i of a controller of the study: as given there, or from its tuning rule."""
    controller = study.controller[name]
    assert isinstance(controller, SpacePosition)
    if controller.tuning is None:
        return controller.k_theta or 0.0, controller.k_omega or 0.0, controller.k_i
    ratio = controller.ratio(study.motor.pole_pairs)
    return _by_rule(study, name, ratio)


def harmonic_gains(study: Study, name: str) -> Gains:
    """k_theta, kp and ki of a controller with the law harmonic; k_theta is 0 where it controls the speed."""
    law = study.controller[name]
    assert isinstance(law, Harmonic)
    if not law.position or law.tuning is None or law.kp is not None:
        kp, ki = gains(study, name)
        return law.k_theta or 0.0, kp, ki
    return _by_rule(study, name, 1)


def _by_rule(study: Study, name: str, ratio: int) -> Gains:
    return tuned(
        study,
        name,
        lambda study: phase_margin_position(speed_loop(study).rigid, ratio, tuning_of(study, name)),
    )


def open_loop(loop: SpeedLoop, feedback: Linear, w: Real) -> Complex:
    """The open loop L, with v and k_v, at w in rad/s."""
    (speed, angle), C = loop.plant(w), feedback.response(w, loop.period)
    held = C * (speed + feedback.k_theta * angle)
    return np.asarray(feedback.ratio * (held + feedback.k_v * angle))


def position_margins(loop: SpeedLoop, feedback: Linear) -> Margins:
    """Margins of the open loop L; unstable if its current loop is."""
    if isinstance(loop.current, CurrentLoop) and not loop.current.margins().stable:
        return UNSTABLE
    integrators = 0
    if feedback.k or feedback.k_i:
        double = feedback.k_r > 0 and feedback.c > 0
        integrators = 1 + (feedback.k_theta > 0) + max(feedback.k_i > 0, feedback.k_r > 0) + double
    if feedback.k_v:
        integrators = max(integrators, 2)
    return margins_of(lambda w: open_loop(loop, feedback, w), loop.period, integrators, loop.near)


@lru_cache(maxsize=32)
def phase_margin_position(loop: SpeedLoop, ratio: int, tuning: Tuning) -> Gains:
    """Gains for a phase margin; NoMarginError if no crossover below half the sampling rate has it."""
    half = loop.period / 2
    w = np.geomspace(1e-3, 1, POINTS) * math.pi / loop.period
    z = np.exp(1j * w * loop.period)
    speed, angle = (ratio * part for part in loop.plant(w))
    integral = loop.period * z / (z - 1)

    def stiffness(place: float) -> tuple[float, int]:
        """The largest stiffness with both zeros at `place`, and its crossover's grid index; 0 if none."""
        L = (1 + place * (integral - half)) * (speed + place * angle)  # K = 1
        enough = np.append(np.unwrap(np.angle(-L)) >= tuning.phase_margin, False)
        begin = int(np.argmax(enough))
        last = begin + int(np.argmin(enough[begin:])) - 1
        if not enough[begin] or last + 1 == POINTS:
            return 0.0, 0
        return place**2 / float(abs(L[last])), last

    places = np.geomspace(1e-4, 1, PLACES) * math.pi / loop.period
    for _ in range(2):  # the whole range first, then between the best one's neighbours
        k = int(np.argmax([stiffness(place)[0] for place in places]))
        best = float(places[k])
        places = np.geomspace(places[max(k - 1, 0)], places[min(k + 1, PLACES - 1)], PLACES)
    found, last = stiffness(best)
    if found > 0:
        unit = Linear(ratio=ratio, k=1 - best * half, k_theta=best, k_i=best)
        w_c = root(
            lambda w: tuning.phase_margin - float(np.angle(-open_loop(loop, unit, np.array([w]))[0])),
            float(w[last]),
            float(w[last + 1]),
        )
        K = 1 / float(abs(open_loop(loop, unit, np.array([w_c]))[0]))
        feedback = Linear(ratio=ratio, k=K * unit.k, k_theta=best, k_i=K * unit.k_i)
        margins = position_margins(loop, feedback)
        # With a resonant current loop, |L| may cross one again at a higher frequency, with less margin.
        if margins.stable and math.isclose(margins.phase_margin, tuning.phase_margin, rel_tol=1e-3):
            return feedback.k_theta, feedback.k, feedback.k_i
    raise NoMarginError
