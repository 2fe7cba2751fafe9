"""Active disturbance rejection: Gao 2003, with the current observer of Miklosovic, Radke and Gao 2006."""

from dataclasses import dataclass
from math import exp, isfinite

from .limits import clip, finite_or_zero


@dataclass
class Adrc:
    b: float
    omega_c: float
    omega_o: float
    ts: float
    limit: float
    omega: float | None = None
    f: float = 0.0
    before: float = 0.0

    def torque(self, current: float) -> float:
        """A step with somebody else's current, from which the estimate of the disturbance then goes on."""
        self.before, self.omega = clip(finite_or_zero(current), self.limit), None
        self.f = -self.b * self.before
        return self.before

    def step(self, omega_ref: float, omega_m: float) -> float:
        p = exp(-self.omega_o * self.ts)
        push = self.ts * (self.f + self.b * self.before)
        if self.omega is None and isfinite(omega_m):
            self.omega = omega_m - push
        if self.omega is not None:
            predicted = self.omega + push
            e = omega_m - predicted if isfinite(omega_m) else 0.0
            self.omega = predicted + (1 - p**2) * e
            self.f = clip(self.f + (1 - p) ** 2 / self.ts * e, self.b * self.limit)
        error = omega_ref - self.omega if self.omega is not None and isfinite(omega_ref) else 0.0
        self.before = clip((self.omega_c * error - self.f) / self.b, self.limit)
        return self.before
