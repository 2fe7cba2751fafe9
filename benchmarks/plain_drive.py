"""The plain drive that cogless, motulator and gym-electric-motor can all simulate.

A PMSM without ripple, friction or sensor errors; field-oriented current control and a PI speed
controller, both at every tick; averaged inverter; one sample of computation delay. SI units, angles
mechanical. This file needs only the standard library, since all competitors' environments import it.
"""

import math
import sys

TICK_RATE = 15_000  # Hz
DURATION = 0.5  # s, simulated
TICKS = round(DURATION * TICK_RATE)

# liu2018's motor (K_t = 0.41 N m/A) with the inertia of readings.md
POLE_PAIRS = 4
R_S = 15.42  # ohm
L_D = L_Q = 30e-3  # H
PSI_F = 0.41 / (1.5 * POLE_PAIRS)  # Wb
INERTIA = 2.5e-4  # kg m^2
BUS_VOLTAGE = 310.0  # V
CURRENT_LIMIT = 3.0  # A

SPEED_REFERENCE = 900 * math.pi / 30  # rad/s, from standstill
LOAD_TORQUE = 0.3  # N m, constant: the only load of all tools, and the fastest one of each

CURRENT_BANDWIDTH = 2 * math.pi * 800  # rad/s
SPEED_BANDWIDTH = 2 * math.pi * 20  # rad/s
K_T = 1.5 * POLE_PAIRS * PSI_F  # N m/A
SPEED_KP = 2 * SPEED_BANDWIDTH * INERTIA / K_T  # A/(rad/s); both closed-loop poles at the bandwidth
SPEED_KI = SPEED_BANDWIDTH**2 * INERTIA / K_T  # A/rad


def check(name: str, speed: float, i_q: float) -> None:
    """Exit unless the drive holds speed and load at the end; a fast run that doesn't must not count."""
    i_q_expected = LOAD_TORQUE / K_T
    if abs(speed / SPEED_REFERENCE - 1) > 0.01 or abs(i_q / i_q_expected - 1) > 0.02:
        expected = f"{SPEED_REFERENCE:.3f} rad/s, {i_q_expected:.4f} A"
        sys.exit(f"{name}: ends at {speed:.3f} rad/s, {i_q:.4f} A; expected {expected}")
