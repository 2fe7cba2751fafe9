"""Whether learning settles: how much an error of each frequency shrinks or grows from one period to the next.

With G = P / (1 + P C) from the learned current to the measured speed (P motor, current loop and measurement,
C the linear feedback), gain W of the correction, forgetting a, and a lead of n samples of period T:

    without lead, u_{k+1} = a u_k + W e_{k+1}:              factor  a / |1 + W G|
    with lead,    u_{k+1}(t) = a u_k(t) + W e_k(t + n T):   factor  |a - W G exp(jw n T)|

Below one at every frequency, each component decays; above one it grows, until a limit or the Q filter holds
it. The Q filter is left out here, and so are friction and the switching terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.design.pi import SpeedLoop, gains, speed_loop
from cogless.study import Study
from cogless.study.controller import PiIlc, RobustIlc

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Learning:
    """The worst factor per period, and the frequency that has it."""

    factor: float
    frequency: float  # Hz


def learning(study: Study, name: str) -> Learning | None:
    """The worst factor of a learning controller of the study; None for any other."""
    controller = study.controller[name]
    if not isinstance(controller, PiIlc | RobustIlc):
        return None
    loop = speed_loop(study)
    w = np.geomspace(1e-4, 1, 8001) * math.pi / loop.period * (1 - 1e-9)
    if isinstance(controller, PiIlc):
        kp, ki = gains(study, name)
        weight: float | Complex = controller.gain
    else:
        kp = (controller.c + controller.eta) / controller.b
        ki = controller.c * controller.eta / controller.b
        weight = controller.q * controller.beta_2 / controller.b * _surface(loop, controller.c, w)
    lead = round(controller.lead / loop.period)
    change = weight * _answer(loop, kp, ki, w)
    if lead:
        factor = np.abs(controller.forgetting - change * np.exp(1j * w * lead * loop.period))
    else:
        factor = controller.forgetting / np.abs(1 + change)
    worst = int(np.argmax(factor))
    return Learning(float(factor[worst]), float(w[worst]) / (2 * math.pi))


def _answer(loop: SpeedLoop, kp: float, ki: float, w: NDArray[np.float64]) -> Complex:
    """G(jw): measured speed over a current added to the feedback's."""
    return np.asarray(loop.response(w, 1.0, 0.0) / (1 + loop.response(w, kp, ki)))


def _surface(loop: SpeedLoop, c: float, w: NDArray[np.float64]) -> Complex:
    """S over e: 1 + c integral."""
    z = np.exp(1j * w * loop.period)
    return np.asarray(1 + c * loop.period * z / (z - 1))
