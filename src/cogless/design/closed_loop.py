"""Sampled position and speed loops: whether they are stable, and the tuning of position feedback.

Poles of a sampled position or speed loop: whether it is stable, and how fast an oscillation grows if not.

The state is the plant's x of speed_loop.py, x' = A x + B i_ref from one sample of the law to the next, with
the integral, the angles that the sensor remembers or its observer's state, a filter's states, and a delay's
past speeds and angles. The feedback is

    i_ref = -(C + sum R) omega_t - k_v ratio theta,    omega_t = ratio (omega + k_theta theta)
    C = k + k_i T z / (z - 1) + k_r T / (z - 1) (1 + c T z / (z - 1))

margins.py computes how far a stable loop is from instability. This module computes at which frequency an
unstable loop oscillates.

Position feedback of the laws that learn in angle, and its tuning for a phase margin, for fair comparison.

The open loop, closed through omega_t = omega - omega_ref + k_theta (theta - theta_ref), is

    L = (k_omega + k_i T z / (z - 1)) (P_omega + k_theta P_theta),    z = exp(jwT)

with the plants P of speed_loop.py. If the law has v(omega), it is added to k_omega. If it has k_v, k_v
P_theta is added to L. `ratio` converts all mechanical angles to the frame of the gains.

The rule gives the stiffest loop with the wanted margin. Both of its zeros are at the same frequency, k_i / K
= k_theta with K = k_omega + k_i T / 2 (docs/theory/learning-in-angle.md#a-fair-pi). It is found by search. A
formula for a delay that is the same at all frequencies isn't good enough: the delay of verrelli2016's current
loop falls from 2 ms to 0.6 ms over frequency, and the formula's loop would be 4 to 6 times too soft at 45
deg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cogless.design.margins import UNSTABLE, Complex, Margins, Real, margins_of, root
from cogless.design.speed_loop import (
    CurrentLoop,
    NoMarginError,
    SpeedLoop,
    observer_step,
    pi_response,
    speed_loop,
    tuned,
    tuning_of,
)
from cogless.study import Study
from cogless.study.laws.law import Tuning
from cogless.units import TURN

CIRCLE_MAGNITUDE = 1 - 1e-12  # magnitude given to a pole on the unit circle, so that its response is finite
POLE_ROUNDING = 1e-6  # rounding error of the integrators' poles at z = 1, which are double without feedback


@dataclass(frozen=True, kw_only=True)
class Linear:
    """Linear feedback of a law, in its frame: mechanical angles times `ratio`. Law (4): only k, ratio 1."""

    ratio: int
    k: float  # A*s/rad, on omega_t
    k_theta: float = 0.0  # 1/s
    k_i: float = 0.0  # A/rad
    k_v: float = 0.0  # A/rad
    k_r: float = 0.0  # A/rad, on the sum of past S = omega_t + c integral(omega_t)
    c: float = 0.0  # 1/s

    @property
    def integrators(self) -> int:
        """Poles of the open loop at z = 1."""
        integrators = 0
        if self.k or self.k_i:
            double = self.k_r > 0 and self.c > 0
            integrators = 1 + (self.k_theta > 0) + max(self.k_i > 0, self.k_r > 0) + double
        return max(integrators, 2) if self.k_v else integrators

    def response(self, w: Real, T: float) -> Complex:
        """C at w in rad/s with sample period T."""
        C = pi_response(w, T, self.k, self.k_i)
        if self.k_r:
            S = pi_response(w, T, 1.0, self.c)
            C = C + self.k_r * T / (np.exp(1j * w * T) - 1) * S
        return C


@dataclass(frozen=True)
class Resonator:
    """The resonator R that learns one order's coefficients, at a constant speed (docs/laws/pi-afc.md)."""

    gain: float  # A/rad
    w: float  # rad/s, of the order
    lead: float  # s

    def response(self, w: Real, T: float) -> Complex:
        """R at w in rad/s with sample period T; R is very large at the order's own frequency."""
        forth, back = (
            1 / (1 - CIRCLE_MAGNITUDE * np.exp(1j * (signed_w - w) * T)) for signed_w in (self.w, -self.w)
        )
        phase = np.exp(1j * self.w * self.lead)
        return np.asarray(self.gain * T / 2 * (phase * forth + np.conj(phase) * back))


@dataclass(frozen=True)
class Oscillation:
    """An oscillation that grows in an unstable loop."""

    frequency: float  # Hz; 0: it grows without oscillating
    rate: float  # 1/s, rate of its exponential growth


@lru_cache(maxsize=1024)  # a verdict asks several times, and for a feedback that is the same at all speeds
def oscillation(loop: SpeedLoop, feedback: Linear) -> Oscillation | None:
    """The fastest growing oscillation of a loop with linear feedback; None if the loop is stable."""
    roots = poles(loop, feedback)
    fastest = roots[np.argmax(np.abs(roots))]
    if abs(fastest) <= 1 + POLE_ROUNDING:
        return None
    T = loop.period
    return Oscillation(abs(float(np.angle(fastest))) / (TURN * T), math.log(abs(fastest)) / T)


def poles(loop: SpeedLoop, feedback: Linear, resonators: Sequence[Resonator] = ()) -> Complex:
    """Closed-loop poles in z at the law's sample rate, including integrators outside any feedback."""
    whole, states, (speed, angle) = loop.step_of(loop.steps), loop.states, loop.sensed
    samples = -(-loop.window // loop.steps)  # samples of the law over which the sensor measures the speed
    first = states + 1 + (3 if loop.bandwidth else samples)
    filtered = first + 2 * len(resonators)
    delayed, late = filtered + 2 * bool(loop.low_pass), loop.delay / loop.period
    back = int(late + POLE_ROUNDING)  # whole samples
    line_length = back + 1 if loop.delay else 0
    summed = delayed + 2 * line_length
    # x, the integral, past angles or the observer's state, resonators' states in a fixed frame, the filter,
    # past speeds and angles, the integral in S and the sum of S
    size = summed + 2 * bool(feedback.k_r)

    def unit(n: int) -> Real:
        return np.asarray(np.eye(size)[n])

    omega = unit(speed)
    if loop.bandwidth:
        omega = unit(states + 2) / loop.current.period
    elif samples:
        omega = (unit(angle) - unit(first - 1)) / (loop.window * loop.current.period)
    step = np.zeros((size, size))
    if loop.low_pass:
        a_step = math.exp(-loop.low_pass * loop.current.period)
        decay = a_step**loop.steps
        new = 1 - a_step if loop.is_held else (1 - decay) / 2  # else its input moves between two samples
        step[filtered + 1] = omega
        step[filtered] = decay * unit(filtered) + (1 - decay - new) * unit(filtered + 1) + new * omega
        omega = step[filtered].copy()

    def past(signal: Real, line: int) -> Real:
        """The signal `loop.delay` ago, from the samples kept at `line`; linear between two samples."""
        if not line_length:
            return signal
        samples = [signal, *(unit(line + n) for n in range(line_length))]
        step[line : line + line_length] = samples[:-1]
        share = max(0.0, late - back)
        return np.asarray((1 - share) * samples[back] + share * samples[back + 1])

    omega, theta = past(omega, delayed), past(unit(angle), delayed + line_length)
    omega_t = feedback.ratio * (omega + feedback.k_theta * theta)
    integral = unit(states) + feedback.k_i * loop.period * omega_t
    current = -feedback.k * omega_t - integral - feedback.k_v * feedback.ratio * theta
    if feedback.k_r:
        step[summed] = unit(summed) + feedback.c * loop.period * omega_t
        step[summed + 1] = unit(summed + 1) + loop.period * (omega_t + step[summed])
        current = current - feedback.k_r * unit(summed + 1)

    for n, resonator in enumerate(resonators):
        turn, phase, at = resonator.w * loop.period, resonator.w * resonator.lead, first + 2 * n
        p, q = unit(at), unit(at + 1)
        drive = resonator.gain * loop.period * omega_t
        step[at] = math.cos(turn) * p - math.sin(turn) * q + math.cos(phase) * drive
        step[at + 1] = math.sin(turn) * p + math.cos(turn) * q + math.sin(phase) * drive
        current = current - step[at]
    step[:states, :states] = whole[:states, :states]
    step[:states] += np.outer(whole[:states, states], current)
    step[states] = integral
    if loop.bandwidth:
        M, gains = observer_step(loop.bandwidth, loop.current.period)
        seen = np.eye(size)[states + 1 : first]
        for n in range(1, loop.steps + 1):
            then = loop.step_of(n)[angle]
            theta_n = then[states] * current
            theta_n[:states] += then[:states]
            seen = M @ seen + np.outer(gains, theta_n)
        step[states + 1 : first] = seen
    elif samples:
        then = loop.step_of(samples * loop.steps - loop.window)[angle]
        step[states + 1, :states] = then[:states]
        step[states + 1] += then[states] * current
        step[states + 2 : first, states + 1 : first - 1] = np.eye(samples - 1)
    return np.asarray(np.linalg.eigvals(step))


OSCILLATION_POINTS = 2000  # frequencies
ZERO_FREQUENCIES = 200  # frequencies among which the zeros are searched
Gains = tuple[float, float, float]  # k_theta, k_omega, k_i, in the law's frame


def position_gains_by_rule(study: Study, name: str, ratio: int) -> Gains:
    """k_theta, k_omega and k_i of a position law by its tuning rule; `ratio`: of its frame."""
    return tuned(
        study,
        name,
        lambda study: phase_margin_position(speed_loop(study).rigid, ratio, tuning_of(study, name)),
    )


def open_loop(loop: SpeedLoop, feedback: Linear, w: Real) -> Complex:
    """The open loop L, with v and k_v, at w in rad/s."""
    (speed, angle), C = loop.plant(w), feedback.response(w, loop.period)
    inner = C * (speed + feedback.k_theta * angle)
    return np.asarray(feedback.ratio * (inner + feedback.k_v * angle))


def position_margins(loop: SpeedLoop, feedback: Linear) -> Margins:
    """Margins of the open loop L; unstable if its current loop is."""
    if isinstance(loop.current, CurrentLoop) and not loop.current.margins().stable:
        return UNSTABLE
    return margins_of(lambda w: open_loop(loop, feedback, w), loop.period, feedback.integrators, loop.near)


@lru_cache(maxsize=32)
def phase_margin_position(loop: SpeedLoop, ratio: int, tuning: Tuning) -> Gains:
    """Gains for a phase margin; NoMarginError if no crossover below half the sampling rate has it."""
    half = loop.period / 2
    w = np.geomspace(1e-3, 1, OSCILLATION_POINTS) * math.pi / loop.period
    z = np.exp(1j * w * loop.period)
    speed, angle = (ratio * part for part in loop.plant(w))
    integral = loop.period * z / (z - 1)

    def stiffness(place: float) -> tuple[float, int]:
        """The largest stiffness with both zeros at `place`, and its crossover's grid index; 0: none."""
        L = (1 + place * (integral - half)) * (speed + place * angle)  # K = 1
        enough = np.append(np.unwrap(np.angle(-L)) >= tuning.phase_margin, False)
        begin = int(np.argmax(enough))
        last = begin + int(np.argmin(enough[begin:])) - 1
        if not enough[begin] or last + 1 == OSCILLATION_POINTS:
            return 0.0, 0
        return place**2 / float(abs(L[last])), last

    places = np.geomspace(1e-4, 1, ZERO_FREQUENCIES) * math.pi / loop.period
    for _ in range(2):  # the whole range first, then between the best one's neighbours
        k = int(np.argmax([stiffness(place)[0] for place in places]))
        best = float(places[k])
        places = np.geomspace(
            places[max(k - 1, 0)], places[min(k + 1, ZERO_FREQUENCIES - 1)], ZERO_FREQUENCIES
        )
    stiffest, last = stiffness(best)
    if stiffest > 0:
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
