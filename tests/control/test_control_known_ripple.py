"""The laws of orders on a plant of a few lines: from rest, with 1 and 50 pole pairs, at 1 and 30 kHz.

The plant is an inertia under a held current u, a constant load and a known ripple:
theta'' = b (u - load + ripple(theta)). The current is held for a sample T, so no current removes the ripple
between samples. In a sample an order that turns by W adds V r to the speed and A r to the angle, and a held
current adds b T u and b T^2 u / 2. With Z = exp(j W) both together make

    of the sampled angle:  (T V + (Z - 1) A) r + b T^2 (Z + 1) / 2 u, over (Z - 1)^2
    of the sampled speed:  V r + b T u, over Z - 1

`harmonic` learns the u whose first line is 0. The speed then keeps the second line, which the feedback damps.
`pi_afc` is a resonator at the sampled speed, so nothing of its orders is left there.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from control_library import ControlLibrary, control_library

STEPS, SETTLED = 8000, 2000  # all samples, and the last ones, over which the ripple is taken
FIRST_ANGLE = 0.2  # rad in a sample of the lowest order
RIPPLE = ((1, 0.2, 0.4), (2, 0.1, -1.0))  # multiple of the lowest order, A, phase
CURRENT, LOAD = 5.0, 0.5  # A: limit, and load
PARTS = 4  # steps of the plant in a sample

Step = Callable[[float, float, float], float]


class Drive:
    """A drive whose numbers all follow from its sample and the order of its ripple."""

    def __init__(self, pole_pairs: int, ts: float) -> None:
        self.ts, self.order = ts, 6 * pole_pairs
        self.speed = FIRST_ANGLE / (self.order * ts)
        self.b = self.speed / (CURRENT * 200 * ts)  # the limit brings it to its speed in 200 samples
        self.kp = 0.3 / (self.b * ts)
        self.pi = {"kp": self.kp, "ki": 0.03 * self.kp / ts, "limit": CURRENT}

    def ripple_with(self, step: Step) -> float:
        """Standard deviation of the sampled speed, after a start from rest [rad/s]."""
        theta = omega = 0.0
        speeds, part = [], self.ts / PARTS
        for _ in range(STEPS):
            speeds.append(omega)
            current = step(self.speed, omega, theta % math.tau)
            for _ in range(PARTS):
                middle = self.order * (theta + part / 2 * omega)
                torque = current - LOAD + sum(r * math.cos(k * middle + phase) for k, r, phase in RIPPLE)
                theta += part * (omega + part / 2 * self.b * torque)
                omega += part * self.b * torque
        return float(np.std(speeds[-SETTLED:]))

    @property
    def floor_of_a_learned_angle(self) -> float:
        """Standard deviation of the sampled speed where the sampled angle has no ripple [rad/s]."""
        W = np.array([[k * FIRST_ANGLE] for k, _, _ in RIPPLE])
        r, part, m = np.array([r for _, r, _ in RIPPLE]), self.ts / PARTS, np.arange(PARTS) + 0.5
        turned, Z = np.exp(1j * W * m / PARTS), np.exp(1j * W[:, 0])
        V, A = self.b * part * turned.sum(axis=1), self.b * part**2 * (turned * (PARTS - m)).sum(axis=1)
        u = -(self.ts * V + (Z - 1) * A) / (self.b * self.ts**2 * (Z + 1) / 2)
        feedback = self.pi["kp"] + self.pi["ki"] * self.ts * Z / (Z - 1)
        damped = 1 / (1 + feedback * self.b * self.ts / (Z - 1))
        amplitude = r * np.abs((V + self.b * self.ts * u) / (Z - 1) * damped)
        return float(np.sqrt(np.sum(amplitude**2) / 2))


def stepper(library: ControlLibrary, law: str, ts: float, entries: int, config: dict[str, Any]) -> Step:
    lib, state = library.lib, library.new(f"cgl_{law}")
    memory, pointer = library.array(np.zeros(entries))
    made = library.new(f"cgl_{law}_config", **config)
    assert getattr(lib, f"cgl_{law}_init")(state, made, library.loop(ts), pointer, entries) == lib.CGL_OK
    i, out = library.new("cgl_law_input"), library.new("cgl_law_output")
    alive = (memory, made)  # C points to them

    def step(omega_ref: float, omega_m: float, theta_m: float) -> float:
        i.omega_ref, i.omega_m, i.theta_m, i.learn = omega_ref, omega_m, theta_m, bool(alive)
        getattr(lib, f"cgl_{law}_step")(state, i, out)
        return out.i_q_ref

    return step


def harmonic(library: ControlLibrary, drive: Drive, rate: float) -> Step:
    orders = 6
    numbers = {"b": drive.b, "base": drive.order, "orders": orders, "fast": orders, "limit": 1.0}
    config = {"pi": drive.pi, "rate": rate / drive.ts, "rate_min": rate / drive.ts, **numbers}
    return stepper(library, "harmonic", drive.ts, 5 * orders, config)


def pi_afc(library: ControlLibrary, drive: Drive, gain: float) -> Step:
    orders = [k * drive.order for k, _, _ in RIPPLE]
    numbers = {"gain": gain * drive.kp / drive.ts, "omega_min": drive.speed / 100, "limit": 1.0}
    config = {"pi": drive.pi, "orders": len(orders), "order": orders, **numbers}
    return stepper(library, "pi_afc", drive.ts, 3 * len(orders), config)


@pytest.mark.parametrize("rate", [1e3, 30e3])
@pytest.mark.parametrize("pole_pairs", [1, 50])
@pytest.mark.parametrize("precision", ["float", "double"])
def test_a_known_ripple_falls_to_what_a_held_current_leaves(
    precision: str, pole_pairs: int, rate: float
) -> None:
    """The angle is rounded, by up to 2^-22 rad in float and to 2^-32 of a turn in double. As ripple of the
    lowest order that is a speed."""
    library, drive = control_library(precision), Drive(pole_pairs, 1 / rate)
    before = drive.ripple_with(pi_afc(library, drive, 0.0))
    by_angle = drive.ripple_with(harmonic(library, drive, 0.01))
    by_speed = drive.ripple_with(pi_afc(library, drive, 0.01))
    floor = drive.floor_of_a_learned_angle
    rounding = (2**-22 if precision == "float" else math.tau * 2**-32) * drive.order * drive.speed
    assert before > 100 * floor
    assert abs(by_angle - floor) < 0.01 * floor + rounding
    assert by_speed < 1e-4 * before
