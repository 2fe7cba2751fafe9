"""Whether a feedback turns the rotor evenly over a torque that depends on its angle, or lets it snap.

A torque T sin(n theta) meets a rotor that turns at Omega. Small signals give it the speed ripple
|P_t S| T / K_t of ripple.py. Divided by Omega, it is also the swing of the phase n theta in rad. Where the
ripples of all orders add up to Omega, the rotor stops: then no result holds that is linear about a constant
speed, neither the ripple nor a margin of learning. The rotor waits in front of a hill, slips, and snaps into
the next detent at up to the rate

    omega_s = sqrt(n T / J)

that the detent has by its own stiffness n T. For one order and a PI with the crossover w_c the limits are

    n Omega far above w_c      (omega_s / (n Omega))^2 = 1      the energy is a quarter of a hill, 2 T / n
    n Omega far below w_c      n T / (K_t k_i) = 1              the integral is as stiff as a detent

The back-EMF of a light rotor changes the ripple by the factor of back_emf.py. Where it damps the ripple of a
rotor that turns, it does so only once the rotor turns: one that starts from rest may go on snapping. So the
larger of the two ripples decides.

docs/theory/detents.md has the grid of runs that this is compared with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cogless.design.back_emf import is_covered, response_factors, ripple_factors
from cogless.design.closed_loop import Linear
from cogless.design.ripple import disturbed, orders
from cogless.design.speed_loop import SpeedLoop, gains, speed_loop
from cogless.study import Study, for_scenario
from cogless.study.base import speed_text

STOPPING_RIPPLE = 1.0  # ripple / speed, at which the rotor stops
STALLING_RATIO = (
    0.4  # rms swing / speed; above this the peaks of several orders, 2 to 3 times rms, stop the rotor
)
TRIED_SPEED_STEP, SPEED_RANGE = (
    1.05,
    1e4,
)  # ratio of one tried speed to the one before; the fastest / the slowest


@dataclass(frozen=True, kw_only=True)
class Swing:
    """Ripple of the speed at a reference with the feedback alone, by the small-signal model."""

    size: float  # sum of the amplitudes of all orders / speed, the larger with or without the back-EMF
    least: float  # sum of the amplitudes of all orders / speed, the smaller with or without the back-EMF
    rms: float  # rms of all orders / speed
    order: int  # mechanical order with the largest amplitude
    is_certain: bool  # whether the back-EMF changes the response at that order little enough for the model
    rate: float  # rad/s: omega_s of that order

    @property
    def stops(self) -> bool:
        """Whether the ripple is large enough to stop the rotor. The small-signal model then fails."""
        return self.size >= STOPPING_RIPPLE

    @property
    def surely_stops(self) -> bool:
        """Whether it stops the rotor with and without the back-EMF."""
        return self.least >= STOPPING_RIPPLE


def swing(
    study: Study, scenario: str, feedback: Linear, omega_m: float, loop: SpeedLoop | None = None
) -> Swing | None:
    """The swing of the speed at omega_m, rad/s; None if no torque or sensor error depends on the angle.

    `loop`: the scenario's by default.
    """
    n, d = orders(study, scenario, omega_m)
    if not len(n) or not omega_m:
        return None
    loop, omega = loop or speed_loop(study, scenario), abs(omega_m)
    w = np.asarray(n * omega, dtype=float)
    plain = disturbed(loop, feedback, w / math.tau) * d / omega
    study_here = for_scenario(study, scenario)
    with_emf = plain * ripple_factors(study_here, feedback, w, loop)
    smaller, sizes = sorted((plain, with_emf), key=np.sum)
    k = int(np.argmax(sizes))
    return Swing(
        size=float(np.sum(sizes)),
        least=float(np.sum(smaller)),
        rms=math.sqrt(float(np.sum(sizes**2)) / 2),
        order=int(n[k]),
        is_certain=bool(is_covered(response_factors(study_here, w[k : k + 1]))[0]),
        rate=math.sqrt(int(n[k]) * loop.b * float(d[k])),
    )


def snaps(study: Study, swinging: Swing, omega_m: float, crossover: float) -> str:
    """Why the rotor doesn't turn evenly at omega_m, rad/s, in words.

    `crossover`: the feedback's crossover, rad/s.
    """
    least, most = (f"{float(f'{size:.2g}'):g}" for size in (swinging.least, swinging.size))
    sizes = most if swinging.surely_stops else f"{least} to {most}"
    around = (
        f", the feedback's crossover is {crossover / math.tau:.3g} Hz" if math.isfinite(crossover) else ""
    )
    return (
        f"at {speed_text(study, omega_m)} the feedback leaves a speed ripple of {sizes} times the speed, "
        f"most of it of order {swinging.order} (in a detent of this order the rotor swings at "
        f"{swinging.rate / math.tau:.3g} Hz{around}): {stop_claim(swinging)}"
    )


def stop_claim(swinging: Swing) -> str:
    """The end of what `snaps` says: how sure it is that the rotor stops."""
    return f"the rotor {'stops and snaps' if swinging.surely_stops else 'may stop and snap'}"


def turns_from(study: Study, scenario: str, feedback: Linear, omega_m: float) -> float | None:
    """The lowest speed from omega_m, rad/s, up, from which on the ripple doesn't stop the rotor.

    None: the rotor stops at every speed. That it turns is certain if the swing at this speed `is_certain`.
    """
    speeds = abs(omega_m) * np.geomspace(
        1, SPEED_RANGE, 1 + round(math.log(SPEED_RANGE) / math.log(TRIED_SPEED_STEP))
    )
    swings = [swing(study, scenario, feedback, float(omega)) for omega in speeds]
    stops = [k for k, swinging in enumerate(swings) if swinging is not None and swinging.stops]
    first = stops[-1] + 1 if stops else 0
    return float(speeds[first]) if first < len(speeds) else None


def overrun(study: Study, law: str) -> list[tuple[int, float]]:
    """Orders of cogging whose omega_s exceeds a law's crossover K_t kp / J, and their torques, N m.

    At an unstable angle such cogging drives the rotor away faster than the law can react.
    """
    star, inertia = study.motor.star(), study.mechanics.inertia
    kp, _ = gains(study, law)
    sizes = [(one.order, abs(one.torque or 0.0)) for one in star.cogging]
    return [(n, size) for n, size in sizes if n * size * inertia > (star.K_t * kp) ** 2]
