"""Active disturbance rejection as a linear feedback: its response, its margins, and its bandwidths by rule.

With p = exp(-omega_o T), l1 = 1 - p^2 and l2 = (1 - p)^2 / T the sampled law is, from measured speed to
current,

    x[k] = A x[k-1] + B omega[k],    x = (omega^, f^, i),    i = -(omega_c omega^ + f^) / b

so C = i (I - A / z)^-1 B, and the open loop is -C P with P of speed_loop.py. The rule takes the observer
OBSERVER_RATIO times as fast as the loop and both as fast as the wanted phase margin allows.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from cogless.design.law_rules import LawRules, Values
from cogless.design.margins import Complex, Margins, Real, margins_of, root
from cogless.design.speed_loop import NoMarginError, SpeedLoop, speed_loop, tuned, tuning_of
from cogless.study import Study
from cogless.study.laws.adrc import OBSERVER_BANDWIDTH_MOST, Adrc

OBSERVER_RATIO = 4.0  # observer's bandwidth / the loop's: 3 to 10 in use
TRIED_BANDWIDTHS = 60  # number of loop bandwidths that are tried


def response(w: Real, T: float, b: float, omega_c: float, omega_o: float) -> Complex:
    """The law's response from measured speed to current, A*s/rad, at w in rad/s.

    The response is negative, since the law is a feedback.
    """
    p = math.exp(-omega_o * T)
    l1, l2 = 1 - p * p, (1 - p) ** 2 / T
    predicted = np.array([1.0, T, T * b])
    omega, f = (1 - l1) * predicted, np.array([0.0, 1.0, 0.0]) - l2 * predicted
    A = np.array([omega, f, -(omega_c * omega + f) / b])
    B = np.array([l1, l2, -(omega_c * l1 + l2) / b])
    back = np.exp(-1j * w * T)
    return np.asarray(np.linalg.solve(np.eye(3) - A * back[:, None, None], B[:, None])[:, 2, 0])


def adrc_margins(loop: SpeedLoop, b: float, omega_c: float, omega_o: float) -> Margins:
    """Margins of the loop around the plant that the controller assumes."""

    def opened(w: Real) -> Complex:
        return np.asarray(-response(w, loop.period, b, omega_c, omega_o) * loop.plant(w)[0])

    return margins_of(opened, loop.period, 2 if omega_c else 1, loop.near)


@lru_cache(maxsize=32)
def bandwidths(loop: SpeedLoop, b: float, phase_margin: float) -> tuple[float, float]:
    """omega_c and omega_o, 1/s, with this phase margin, rad; NoMarginError if there are none."""

    def margin(omega_c: float) -> float:
        margins = adrc_margins(loop, b, omega_c, OBSERVER_RATIO * omega_c)
        return margins.phase_margin if margins.stable else -1.0

    tried = np.geomspace(1e-3, 1, TRIED_BANDWIDTHS) * OBSERVER_BANDWIDTH_MOST / OBSERVER_RATIO / loop.period
    last = next((k for k in range(TRIED_BANDWIDTHS)[::-1] if margin(float(tried[k])) >= phase_margin), None)
    if last is None:
        raise NoMarginError
    if last + 1 == TRIED_BANDWIDTHS:
        omega_c = float(tried[-1])
    else:
        omega_c = root(lambda x: phase_margin - margin(x), float(tried[last]), float(tried[last + 1]))
    return omega_c, OBSERVER_RATIO * omega_c


class AdrcRules(LawRules[Adrc]):
    """The rules of the law `adrc`, whose feedback is no PI: it has a response and margins of its own."""

    def margins(self) -> Margins:
        law = self.law
        return adrc_margins(speed_loop(self.study), law.b, law.omega_c, law.omega_o)

    def auto(self) -> Values:
        """Loop and observer as fast as the phase margin allows."""
        b = self.study.K_t / self.study.mechanics.stiff.inertia

        def rule(study: Study) -> tuple[float, float]:
            return bandwidths(speed_loop(study).rigid, b, tuning_of(study, self.name).phase_margin)

        omega_c, omega_o = tuned(self.study, self.name, rule)
        return {"b": b, "omega_c": omega_c, "omega_o": omega_o}
