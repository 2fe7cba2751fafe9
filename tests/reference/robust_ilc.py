"""Robust iterative learning control by adaptive sliding mode: liu2018 (11) to (20)."""

import math
from dataclasses import dataclass, field

from .limits import clip, finite_or_zero, sgn
from .memory import AngleMemory, DelayLine


@dataclass
class RobustIlc:
    b: float
    c: float
    g: float
    eta: float
    q: float
    beta_1: float
    beta_2: float
    gamma: float
    viscous: float
    coulomb: float
    ts: float
    limit: float
    memory: AngleMemory | DelayLine
    integral_e: float = 0.0  # integral of e over time
    r: float = 0.0
    omega_ref_before: float | None = None
    saturated: bool = False
    learning: bool = False
    terms: dict[str, float] = field(default_factory=dict)  # terms of the last step's current, A

    def __post_init__(self) -> None:
        self.memory.centred = int(self.gamma > 0)

    def step(self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True) -> float:
        finite = math.isfinite(omega_ref - omega_m)
        e = omega_ref - omega_m if finite else 0.0
        omega = omega_m if finite else 0.0
        before = self.omega_ref_before
        d_omega_ref = (omega_ref - before) / self.ts if finite and before is not None else 0.0
        self.omega_ref_before = omega_ref if finite else None

        integrated = clip(self.integral_e + self.ts * e, 1e9)
        S = e + self.c * integrated  # (11)

        may = learn and finite and not self.saturated and self.q * (self.beta_1 + self.beta_2) > 0
        change = -self.q * (self.beta_1 * sgn(S) + self.beta_2 * S)  # (15)
        (f,), self.learning = self.memory.step(theta_m, omega_ref, may, [change])
        f = clip(f, self.memory.limit[0])
        if self.learning:
            self.r = clip(self.r - self.memory.transfer[0], self.b * self.limit)

        v = -self.g * sgn(S) - self.eta * S  # (16)
        B = self.viscous * omega + self.coulomb * sgn(omega)
        wanted = (self.c * e + d_omega_ref + B - f - v + self.r) / self.b  # (19)
        u = clip(wanted, self.limit)
        self.saturated = abs(wanted) >= self.limit
        self.terms = {
            "surface": (self.c * e + d_omega_ref + B) / self.b,
            "switching": self.g * sgn(S) / self.b,
            "linear": self.eta * S / self.b,
            "learned": -f / self.b,
            "adapted": self.r / self.b,
        }
        if finite and (not self.saturated or e * u < 0):
            self.integral_e = integrated
        if finite and learn and (not self.saturated or S * u < 0):
            self.r = clip(self.r + self.ts * self.gamma * S, self.b * self.limit)  # (20)
        return u

    def torque(self, current: float, omega_ref: float, omega_m: float, theta_m: float) -> float:
        """A step with somebody else's current. r then takes the current over, less the known friction."""
        current = finite_or_zero(current)
        omega = omega_m if math.isfinite(omega_ref - omega_m) else 0.0
        (f,), self.learning = self.memory.step(theta_m, omega_ref, False, [0.0])
        B = self.viscous * omega + self.coulomb * sgn(omega)
        r = self.b * clip(current, self.limit) - B
        self.r = clip(r, self.b * self.limit) if self.gamma > 0 else 0.0
        self.integral_e, self.omega_ref_before, self.saturated = 0.0, None, False
        return clip(current - clip(f, self.memory.limit[0]) / self.b, self.limit)
