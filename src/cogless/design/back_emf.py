"""The margins of a loop with the motor's back-EMF, which the other models leave out.

The back-EMF K_e omega_m disturbs the current. The current loop takes most of it away. The drive's decoupling
adds the back-EMF of the measured speed to the voltage. That speed is late, by the observer or the filter
behind it, so the decoupling helps less towards higher frequencies, and then does harm. With the admittance Y
of the closed current loop, the response H from the true to the measured speed, and the delay D of the voltage

    i = i_ref G / (1 + G) - Y (K_e - K_d H D) omega_m,    Y = 1 / ((R + s L) (1 + G))

G is the open current loop, and K_d is K_e as the drive believes it, or 0 without decoupling. With

    E = b Y (K_e - K_d H D) / s

the open loop L becomes L / (1 + E). The closed loop is stable if L + E does not encircle -1. At low
frequencies Y is s / k_i, so the back-EMF acts like a further inertia, K_t K_e / k_i. The inertia of a small
step motor is a fraction of that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cogless.design.changes import cure_words, first
from cogless.design.closed_loop import Linear, open_loop, position_margins
from cogless.design.law_rules import feedback_of
from cogless.design.margins import UNSTABLE, Complex, Margins, Real, margins_of
from cogless.design.speed_loop import (
    BELIEF_FACTORS,
    PHASE_MARGIN_LEAST,
    CurrentLoop,
    SpeedLoop,
    faster_loop,
    speed_loop,
)
from cogless.study import Study
from cogless.study.reading import Changes, Remark


def margins_with_back_emf(study: Study, feedback: Linear) -> Margins:
    """Margins of a feedback around the study's motor; without back-EMF where that is not modelled.

    The back-EMF is not modelled behind an ideal current loop, nor with a soft shaft.
    """
    loop, current = speed_loop(study), _current_loop(study)
    if current is None or not current.margins().stable:
        return position_margins(loop, feedback)

    def total(w: Real) -> Complex:
        return open_loop(loop, feedback, w) + _back_emf(study, current, w)

    def effective(w: Real) -> Complex:
        return np.asarray(open_loop(loop, feedback, w) / (1 + _back_emf(study, current, w)))

    if not margins_of(total, loop.period, feedback.integrators).stable:
        return UNSTABLE
    return margins_of(effective, loop.period, feedback.integrators)


def _current_loop(study: Study) -> CurrentLoop | None:
    """The current loop that the back-EMF disturbs; None: it is ideal, or the shaft is soft."""
    loop = speed_loop(study)
    return loop.current if isinstance(loop.current, CurrentLoop) and loop.shaft is None else None


def _back_emf(study: Study, current: CurrentLoop, w: Real) -> Complex:
    """E at w in rad/s."""
    loop, drive, motor = speed_loop(study), study.drive, study.motor.star()
    s = 1j * w
    admittance = 1 / ((current.R + s * current.L) * (1 + current.response(w)))
    emf = np.full(np.shape(w), motor.pole_pairs * motor.psi_f, dtype=complex)
    if drive.current_loop.decoupling:
        believed = motor.pole_pairs * drive.belief.resolved(motor).psi_f
        late = np.exp(-s * (current.period * (current.delay + 0.5) + loop.delay))
        emf -= believed * late * _measured(study, w)
    return np.asarray(loop.b * admittance * emf / s)


def _measured(study: Study, w: Real) -> Complex:
    """Response from the true to the measured speed at w in rad/s; the angle's age cancels out."""
    loop = speed_loop(study)
    speed, theta = loop.plant(w)
    # The decoupling runs in each current-loop period; its speed may be held for the law's whole period.
    waiting = (loop.steps - 1) / 2 * loop.current.period if loop.is_held else 0.0
    return np.asarray(speed / (1j * w * theta) * np.exp(-1j * w * waiting))


def ripple_factors(study: Study, feedback: Linear, w: Real, loop: SpeedLoop | None = None) -> Real:
    """The ripple that a torque makes with the back-EMF, divided by that without, at w in rad/s.

    A torque makes a speed of P_t / (1 + L) without the back-EMF, and of P_t / (1 + L + E) with the back-EMF.
    `loop`: the study's by default.
    """
    current = _current_loop(study)
    if current is None:
        return np.ones(np.shape(w))
    returned = 1 + open_loop(loop or speed_loop(study), feedback, w)
    return np.asarray(np.abs(returned / (returned + _back_emf(study, current, w))))


def response_factors(study: Study, w: Real) -> Real:
    """The rotor's response to a current with the back-EMF, divided by that without, at w in rad/s."""
    current = _current_loop(study)
    return (
        np.ones(np.shape(w)) if current is None else np.asarray(1 / np.abs(1 + _back_emf(study, current, w)))
    )


def is_covered(factors: Real) -> NDArray[np.bool_]:
    """Whether each factor of a response is in the range that the designs are made for, BELIEF_FACTORS."""
    return np.asarray((factors >= min(BELIEF_FACTORS)) & (factors <= max(BELIEF_FACTORS)))


def is_unstable_with_back_emf(study: Study, name: str) -> bool:
    """Whether a controller's loop is stable without the back-EMF, and unstable with it."""
    plain, with_emf = study.once(_margins, name)
    return plain >= 0 > with_emf


def back_emf_warning(study: Study, name: str) -> Remark | None:
    """The warning of a controller whose loop has little margin left with the back-EMF."""
    plain, with_emf = study.once(_margins, name)
    if plain < PHASE_MARGIN_LEAST or with_emf >= PHASE_MARGIN_LEAST:
        return None
    margins = "is unstable" if with_emf < 0 else f"has {math.degrees(with_emf):.0f} deg of phase margin"
    alone = f"without it the margin is {math.degrees(plain):.0f} deg"
    sentence = f"with the motor's back-EMF its loop {margins}; {alone}"
    if study.drive.current_loop.decoupling:
        sentence += ". The decoupling does not prevent this, since the speed that it uses comes late"

    def cured(other: Study) -> bool:
        return other.once(_margins, name)[1] >= PHASE_MARGIN_LEAST

    cures = tuple(cure for tried in _ways(study) for cure in first(study, tried, cured))
    return Remark(sentence + cure_words(cures), cures)


def _margins(study: Study, name: str) -> tuple[float, float]:
    """Phase margins, rad, of a controller's loop without and with the back-EMF; -1: it is unstable."""
    feedback = feedback_of(study, name, 0.0)
    if feedback is None:
        return -1.0, -1.0
    loops = (position_margins(speed_loop(study), feedback), margins_with_back_emf(study, feedback))
    plain, with_emf = (-1.0 if math.isnan(loop.phase_margin) else loop.phase_margin for loop in loops)
    return plain, with_emf


def _ways(study: Study) -> Iterator[list[Changes]]:
    """Lists of changes that make the back-EMF disturb less; each list begins with the smallest change."""
    if study.drive.current_loop.decoupling:
        yield [{"drive.current_loop.decoupling": False}]
    yield from faster_loop(study)
