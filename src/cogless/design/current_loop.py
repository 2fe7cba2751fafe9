"""The current loop of one axis, sampled with period T_c, as the drive runs it.

G is the open loop of the winding R, L and the PI controller of control/src/cogless/foc.c, whose integral is
forward Euler. The voltage acts `delay` periods after the current was sampled. G is exact for the averaged
inverter at standstill:

    G = (kp + ki T_c / (z - 1)) z^-delay (1 - a) / (R (z - a)),    a = exp(-R T_c / L),    z = exp(jw T_c)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cogless.design.margins import Complex, Margins, Real, margins_of
from cogless.errors import StudyError
from cogless.study import Study, for_scenario
from cogless.study.drive import IdealCurrentLoop
from cogless.study.error_messages import shown

NO_MARGIN = "expected a faster and better damped current loop for this margin"
LEAST = math.radians(30)  # smallest phase margin with which it is good enough for a speed loop


@dataclass(frozen=True)
class CurrentLoop:
    """Winding and current controller of one axis."""

    kp: float  # V/A
    ki: float  # V/A/s
    R: float  # ohm
    L: float  # H
    period: float  # s
    delay: int  # periods, from sampling the current to the voltage

    def response(self, w: Real) -> Complex:
        """The open loop G(jw), w in rad/s."""
        z = np.exp(1j * w * self.period)
        x = self.R * self.period / self.L
        gain = self.period / self.L * (-math.expm1(-x) / x if x > 0 else 1.0)
        pi = self.kp + self.ki * self.period / (z - 1)
        return np.asarray(pi * gain / (z - math.exp(-x)) / z**self.delay)

    def margins(self) -> Margins:
        """Margins of the open loop G."""
        return _margins(self)


@lru_cache(maxsize=16)  # called for every controller, at every speed
def _margins(loop: CurrentLoop) -> Margins:
    integrators = (loop.ki > 0) + (loop.R == 0 and loop.kp + loop.ki > 0)
    return margins_of(loop.response, loop.period, integrators)


@dataclass(frozen=True)
class IdealLoop:
    """An ideal current loop: the current equals its reference. Only the loop's period is needed."""

    period: float  # s


def current_loops(study: Study, scenario: str | None = None) -> dict[str, CurrentLoop]:
    """Loops of the q and d axes, with the motor that the controller assumes or with a scenario's true motor.

    The result is empty if the current loop is ideal.
    """
    study_here = study if scenario is None else for_scenario(study, scenario)
    drive = study_here.drive
    loop, inverter, T = drive.current_loop, drive.inverter, 1 / drive.rates.current_loop
    if isinstance(loop, IdealCurrentLoop) or inverter is None:
        return {}
    belief = drive.belief.resolved(study.motor.star())
    motor = belief if scenario is None else study_here.motor.star()
    gains, delay = loop.gains(belief), inverter.computation_delay
    return {
        "q": CurrentLoop(gains["kp_q"], gains["ki_q"], motor.R_s, motor.L_q, T, delay),
        "d": CurrentLoop(gains["kp_d"], gains["ki_d"], motor.R_s, motor.L_d, T, delay),
    }


def weakness(margins: Margins) -> str | None:
    """The reason, in words, why a current loop isn't good enough for a speed loop; None if it is."""
    if not margins.stable:
        return "is unstable"
    if margins.phase_margin < LEAST:
        return f"has {math.degrees(margins.phase_margin):.1f} deg"
    return None


@contextmanager
def tuned(study: Study, name: str) -> Iterator[None]:
    """Context for a tuning rule: StudyError if the current loop is too weak or the rule raises ValueError."""
    for axis, loop in current_loops(study).items():
        wrong = weakness(loop.margins())
        if wrong:
            given = study.source.tables["drive"]["current_loop"]
            at = {key: given[key] for key in ("kp", "ki", "bandwidth") if key in given}
            keys = " and ".join(f"drive.current_loop.{key}: {shown(value)}" for key, value in at.items())
            expected = f"expected {math.degrees(LEAST):.0f} deg of phase margin or more"
            found = f"to tune controller.{name} around it; its {axis} axis {wrong}"
            raise StudyError(f"{study.source.path}: {keys}: {expected} {found}")
    try:
        yield
    except ValueError as error:
        raise StudyError(f"{study.source.path}: controller.{name}.tuning: {error}") from None
