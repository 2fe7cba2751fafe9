"""The ripple that the relay in robust ILC makes by itself: docs/laws/robust-ilc.md#the-relay.

The law's term g sgn(S) / b is a relay of amplitude M = g / b beside its linear feedback C. From the relay's
current to -S the loop has the response

    W = H P / (1 + C P),    H = 1 + c T z / (z - 1),    z = exp(jwT)

with the plant P of speed_loop.py. The relay switches to and fro where W turns its current by half a turn. A
current that is M for n samples and -M for n samples, with w n T = pi, has the fundamental 2 M / (n sin(pi /
(2 n))).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cogless.design.closed_loop import oscillation
from cogless.design.law_rules import feedback_of
from cogless.design.margins import FREQUENCY_POINTS
from cogless.design.ripple import ripple
from cogless.design.speed_loop import pi_response, speed_loop
from cogless.design.verdict import judged
from cogless.study import Study
from cogless.study.base import speed_text
from cogless.study.laws.periodic import RobustIlc
from cogless.study.messages import dotted
from cogless.study.reading import Changes
from cogless.study.remark import Remark
from cogless.units import TURN


@dataclass(frozen=True)
class Switching:
    """The oscillation that a relay keeps up in a loop without noise, ripple or load."""

    frequency: float  # Hz
    ripple: float  # rad/s, of the true speed, rms


def switching(study: Study, scenario: str, name: str) -> Switching | None:
    """How a controller's relay oscillates in a scenario: of several ways the one with the largest ripple.

    None if it has no relay, if the feedback is unstable, or if nothing makes the relay turn back.
    """
    law = study.controller[name]
    if not isinstance(law, RobustIlc) or not law.g:
        return None
    loop, feedback = speed_loop(study, scenario), feedback_of(study, name)
    if feedback is None or oscillation(loop, feedback):
        return None
    w = np.geomspace(1e-4, 1, FREQUENCY_POINTS) * math.pi / loop.period
    P, _ = loop.plant(w)
    closed = 1 / (1 + feedback.response(w, loop.period) * P)
    W = pi_response(w, loop.period, 1.0, law.c) * P * closed
    turned = np.append((W.imag[:-1] < 0) != (W.imag[1:] < 0), True)  # the last: W is real there anyway
    turned = np.flatnonzero(turned & (W.real < 0))
    if not len(turned):
        return None
    true, _ = replace(loop, window=0, bandwidth=0.0, edge=0.0, low_pass=0.0).plant(w)
    n = math.pi / (w * loop.period)
    fundamental = np.sqrt(2) / (n * np.sin(np.pi / (2 * n)))
    fundamental[-1] = 1.0  # rms of a current that changes its sign with each sample
    made = law.g / law.b * fundamental * np.abs(true * closed)
    most = turned[np.argmax(made[turned])]
    return Switching(float(w[most]) / TURN, float(made[most]))


def relay_warning(study: Study, name: str) -> Remark | None:
    """Warning of a relay that makes more ripple than the feedback beside it leaves; None if it makes less."""
    for key in study.scenarios_of(name):
        made = switching(study, key, name)
        if made is None:
            continue
        left = max((ripple(loop, 0.0).without for loop in judged(study, key, name)), default=math.inf)
        if made.ripple > left:
            alone, beside = (f"{speed_text(study, omega, 2)} rms" for omega in (made.ripple, left))
            switches = f"in {key} its relay switches at {made.frequency:.3g} Hz and makes {alone} of ripple"
            off: Changes = {f"{dotted(('controller', name))}.g": "0 rad/s^2"}
            return Remark(f"{switches}; g = 0 leaves {beside} before learning", (off,))
    return None
