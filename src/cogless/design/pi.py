"""Speed PI by phase margin: the fair bar that learning laws stand beside.

The speed loop, from its error to its measured speed, sampled with period T:

    L = (kp + ki T z / (z - 1)) F(jw) b T / (z - 1) (1 + exp(-2 jw T_m)) / 2,    z = exp(jwT)

b = K_t / J (belief over true inertia), T_m the delay of the speed measurement (a mean over 2 T_m),
F = G / (1 + G) the closed current loop with G = (kp_q + ki_q / s) / (R_s + s L_q) exp(-s T_c), T_c from
sampling to the middle of the voltage that answers. Friction is left out: it only adds margin.

With z / (z - 1) = 1 / 2 + 1 / (2j tan(wT / 2)), K = kp + ki T / 2 and w' = tan(wT / 2) / (T / 2) the phase is
that of a continuous PI before an integrator and a delay:

    arg L(w) = -180 deg + atan(w' T_i) - w T_e,  T_e = T / 2 + T_m - arg F(jw) / w,  T_i = K / ki

The symmetrical optimum puts the crossover w_c where the phase is largest: d/dw = 0 gives
T_e = T_i / (1 + x^2) with x = w' T_i (for w' = w, which it nearly is). The phase margin there is

    PM = atan x - x / (1 + x^2)

which grows with x from 0 to 90 deg: the wanted margin gives x, then w_c = x / ((1 + x^2) T_e), then
T_i = x / w_c', and |L(w_c)| = 1 gives the gain. T_e depends on w_c through F, weakly: a few rounds of
substitution settle it.

Source: C. Kessler, "Das symmetrische Optimum", Regelungstechnik 6 (1958), here for a delay in place of a lag.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.study import Study
from cogless.study.controller import Feedback, Tuning
from cogless.study.drive import Encoder, Resolver


@dataclass(frozen=True)
class SpeedLoop:
    """What the speed controller acts on."""

    b: float  # rad/s^2/A, acceleration per current
    period: float  # s, of the speed loop
    measurement_delay: float  # s
    kp_q: float  # V/A, current loop
    ki_q: float  # V/A/s
    R_s: float  # ohm
    L_q: float  # H
    current_delay: float = 0.0  # s, from sampling the current to the voltage

    def current_loop(self, w: NDArray[np.float64]) -> NDArray[np.complex128]:
        """F(jw): current over its reference."""
        s = 1j * w
        G = (self.kp_q + self.ki_q / s) / (self.R_s + s * self.L_q) * np.exp(-s * self.current_delay)
        return np.asarray(G / (1 + G))

    def response(self, w: NDArray[np.float64], kp: float, ki: float) -> NDArray[np.complex128]:
        """L(jw), see above."""
        z = np.exp(1j * w * self.period)
        pi = kp + ki * self.period * z / (z - 1)
        measured = (1 + np.exp(-2j * w * self.measurement_delay)) / 2
        return np.asarray(pi * self.current_loop(w) * self.b * self.period / (z - 1) * measured)


@dataclass(frozen=True)
class PiDesign:
    """Gains of a speed PI and the margins of its loop."""

    kp: float  # A*s/rad
    ki: float  # A/rad
    crossover: float  # rad/s
    phase_margin: float  # rad
    gain_margin: float  # a factor


def speed_loop(study: Study) -> SpeedLoop:
    """The speed loop of a study, as its controller knows it."""
    rates, belief = study.drive.rates, study.belief
    gains = study.drive.current_loop.gains(belief)
    period = 1 / rates.speed_loop
    sensor = study.drive.position_sensor
    delay = 0.0
    if isinstance(sensor, Encoder):
        delay = period / 2  # a difference over one period is the speed at its middle
    elif isinstance(sensor, Resolver):
        delay = sensor.window / rates.current_loop / 2
    return SpeedLoop(
        b=1.5 * study.motor.pole_pairs * belief.psi_f / study.mechanics.inertia,
        period=period,
        measurement_delay=delay,
        kp_q=gains["kp_q"],
        ki_q=gains["ki_q"],
        R_s=belief.R_s,
        L_q=belief.L_q,
        current_delay=(study.drive.inverter.computation_delay + 0.5) / rates.current_loop,
    )


def gains(study: Study, name: str) -> tuple[float, float]:
    """kp and ki of a controller of the study: its own, or by its rule."""
    controller = study.controller[name]
    assert isinstance(controller, Feedback)
    if controller.tuning is None:
        return controller.kp or 0.0, controller.ki or 0.0
    try:
        design = phase_margin_pi(speed_loop(study), controller.tuning)
    except ValueError as error:
        raise StudyError(f"{study.source.path}: controller.{name}.tuning: {error}") from None
    return design.kp, design.ki


def phase_margin_pi(loop: SpeedLoop, tuning: Tuning) -> PiDesign:
    """Gains for a phase margin; ValueError where this loop has none such below half the sampling rate."""
    x = _root(lambda x: math.atan(x) - x / (1 + x * x) - tuning.phase_margin, 1e-3, 1e3)
    w = x / ((1 + x * x) * (loop.period / 2 + loop.measurement_delay + loop.L_q / max(loop.kp_q, 1e-12)))
    for _ in range(100):
        lag = -float(np.angle(loop.current_loop(np.array([w]))[0])) / w
        before, w = w, x / ((1 + x * x) * (loop.period / 2 + loop.measurement_delay + lag))
        if not 0 < w < math.pi / loop.period:
            break
        if math.isclose(w, before, rel_tol=1e-12):
            half = loop.period / 2
            ki = math.tan(w * half) / (half * x)  # for K = 1
            K = 1 / float(abs(loop.response(np.array([w]), 1 - ki * half, ki)[0]))
            design = margins(loop, K * (1 - ki * half), K * ki)
            # A current loop with a resonance crosses once more, further up.
            wanted = math.isclose(design.phase_margin, tuning.phase_margin, rel_tol=1e-6)
            if wanted and design.gain_margin > 1:
                return design
            break
    raise ValueError("expected a faster and better damped current loop for this margin")


def margins(loop: SpeedLoop, kp: float, ki: float) -> PiDesign:
    """Crossover, phase margin and gain margin of given gains; NaN where the loop has no such crossing.

    The crossover is the last one below half the sampling rate, the gain margin is against too much gain.
    """
    w = np.geomspace(1e-4, 1, 4001) * math.pi / loop.period * (1 - 1e-9)

    def gain(w: float) -> float:
        return math.log(max(float(abs(loop.response(np.array([w]), kp, ki)[0])), 1e-300))

    def phase(w: float) -> float:
        # Turned by half a circle, so that the crossing lies at zero and not at the cut.
        return float(np.angle(-loop.response(np.array([w]), kp, ki)[0]))

    L = loop.response(w, kp, ki)
    with np.errstate(divide="ignore"):
        below = np.flatnonzero((np.abs(L[:-1]) >= 1) & (np.abs(L[1:]) < 1))
    turned = np.angle(-L)
    falling = np.flatnonzero((turned[:-1] > 0) & (turned[1:] <= 0) & (turned[:-1] - turned[1:] < math.pi))
    crossover = _root(gain, *w[below[-1] : below[-1] + 2]) if len(below) else math.nan
    phase_margin = phase(crossover) if len(below) else math.nan
    gain_margin = math.nan
    if len(falling):
        gain_margin = math.exp(-gain(_root(phase, *w[falling[-1] : falling[-1] + 2])))
    return PiDesign(kp, ki, crossover, phase_margin, gain_margin)


def _root(f: Callable[[float], float], a: float, b: float) -> float:
    """Where f changes sign, by halving: importing scipy.optimize takes longer than a run does."""
    rising = f(b) > f(a)
    for _ in range(60):
        middle = (a + b) / 2
        if (f(middle) > 0) == rising:
            b = middle
        else:
            a = middle
    return float((a + b) / 2)
