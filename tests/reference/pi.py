"""PI control of a scalar with a limit and conditional anti-windup."""

from dataclasses import dataclass

from .limits import clip, finite_or_zero


@dataclass
class Pi:
    kp: float
    ki: float
    ts: float
    limit: float
    integral: float = 0.0
    saturated: bool = False

    def torque(self, current: float, feedforward: float = 0.0) -> float:
        """A step with somebody else's current. The integral takes it over if its gain can correct it."""
        current = finite_or_zero(current)
        self.integral, self.saturated = clip(current, self.limit) if self.ki > 0 else 0.0, False
        return clip(current + feedforward, self.limit)

    def step(self, error: float, feedforward: float = 0.0) -> float:
        e, ff = finite_or_zero(error), finite_or_zero(feedforward)
        integrated = clip(self.integral + self.ki * self.ts * e, self.limit)
        wanted = self.kp * e + integrated + ff
        self.saturated = abs(wanted) >= self.limit
        if not self.saturated or e * wanted < 0:  # held only where the error pushes on against the limit
            self.integral = integrated
        return clip(self.kp * e + self.integral + ff, self.limit)
