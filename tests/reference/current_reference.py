"""Currents of most torque per current and of field weakening, from a torque as an equivalent q current."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from .limits import clip, finite_or_zero

GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass
class CurrentReference:
    """Currents are in A, inductances in H, `omega_e` in rad/s, electrical."""

    mtpa: bool
    field_weakening: bool
    L_d: float
    L_q: float
    psi_f: float
    R_s: float
    current_limit: float
    voltage_share: float = 0.95
    phases: int = 3

    def torque(self, i: complex) -> float:
        """Equivalent q current of a current vector, torque / (1.5 p psi_f)."""
        return i.imag * (1 - (self.L_q - self.L_d) / self.psi_f * i.real)

    @property
    def reach(self) -> float:
        """The largest equivalent current at the current limit."""
        if not self.mtpa:
            return self.current_limit
        c = (self.L_q - self.L_d) / self.psi_f
        i_d = -2 * c * self.current_limit**2 / (1 + math.sqrt(1 + 8 * (c * self.current_limit) ** 2))
        return self.torque(complex(i_d, math.sqrt(self.current_limit**2 - i_d**2)))

    def least(self, torque: float) -> float:
        """The d current of the shortest vector of a torque: x (1 + x)^3 = (c torque)^2, x = -c i_d >= 0."""
        c = (self.L_q - self.L_d) / self.psi_f
        size = abs(c * torque)
        if not self.mtpa or not size:
            return 0.0
        low, high = 0.0, min(size**2, math.sqrt(size))
        for _ in range(100):
            x = (low + high) / 2
            low, high = (x, high) if x * (1 + x) ** 3 < size**2 else (low, x)
        return -low / c

    def voltage(self, i: complex, omega_e: float) -> float:
        """Length of the steady voltage."""
        return abs(self.R_s * i + 1j * omega_e * complex(self.L_d * i.real + self.psi_f, self.L_q * i.imag))

    def largest(self, i_d: float, side: float, omega_e: float, u_max: float) -> float:
        """Largest equivalent current with this i_d; if none is possible, minus the least excess voltage."""
        q_max = math.sqrt(max(0.0, self.current_limit**2 - i_d**2))
        z, w = complex(self.R_s, 0.0), abs(omega_e)
        # u = start + slope q, for q >= 0
        start = complex(self.R_s * i_d, w * (self.psi_f + self.L_d * i_d))
        slope = complex(-side * w * self.L_q, side * z.real)
        a, b = abs(slope) ** 2, (start.conjugate() * slope).real
        deepest = min(max(0.0, -b / a), q_max) if a else 0.0
        least = abs(start + slope * deepest) ** 2 - u_max**2
        if least > 0:
            return -least
        root = math.sqrt(max(0.0, b * b - a * (abs(start) ** 2 - u_max**2)))
        q = min(q_max, (root - b) / a) if a else q_max
        return self.torque(complex(i_d, q))

    def step(self, i_q_ref: float, omega_e: float, u_dc: float) -> tuple[complex, bool]:
        """Current references, and whether the torque was shortened."""
        wanted = finite_or_zero(i_q_ref)
        side = -1.0 if wanted < 0 else 1.0
        torque = abs(clip(wanted, self.reach))
        i_d = self.least(torque)
        u_max = self.voltage_share * u_dc * (1.0 if self.phases == 2 else 1 / math.sqrt(3))
        c = (self.L_q - self.L_d) / self.psi_f
        driving = -1.0 if omega_e * side < 0 else 1.0

        def fits(d: float) -> bool:
            i = complex(d, driving * torque / (1 - c * d))
            return abs(i) <= self.current_limit * (1 + 1e-12) and self.voltage(i, abs(omega_e)) <= u_max

        weak = self.field_weakening and math.isfinite(u_max) and u_max > 0 and math.isfinite(omega_e)
        if weak and self.voltage(complex(i_d, driving * torque / (1 - c * i_d)), abs(omega_e)) > u_max:
            limit = self.current_limit
            low = max(-limit, 1 / c) if c < 0 else -limit
            high = min(limit, 1 / c) if c > 0 else limit
            best = maximum(lambda d: self.largest(d, driving, omega_e, u_max), low, high)
            largest = self.largest(best, driving, omega_e, u_max)
            if torque >= largest:
                torque, i_d = max(0.0, largest), best
            else:
                inside, outside = best, i_d
                for _ in range(60):
                    middle = (inside + outside) / 2
                    inside, outside = (middle, outside) if fits(middle) else (inside, middle)
                i_d = inside
        i_q = torque / (1 - c * i_d) if torque else 0.0
        return complex(i_d, side * i_q), torque < abs(wanted)


def maximum(f: Callable[[float], float], low: float, high: float) -> float:
    """Where f, with one maximum, is largest, by golden section."""
    for _ in range(60):
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        low, high = (low, right) if f(left) > f(right) else (left, high)
    return (low + high) / 2
