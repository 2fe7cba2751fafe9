"""PI speed control with an anti-cogging table, learned by a slow run in both directions."""

import math
from dataclasses import dataclass, field

import numpy as np

from .limits import clip, is_angle
from .pi import Pi


@dataclass
class Leg:
    """One direction of the calibration run: every sample of current that was taken, by entry."""

    direction: int
    first: int  # entry number, counted in the direction from angle zero
    end: int
    start: float  # unwrapped [rad]
    steps: int = 0
    samples: dict[int, list[float]] = field(default_factory=dict)
    at: int = 0
    again: int = 0  # revolutions to repeat, since learning was forbidden in them


@dataclass
class AntiCogging:
    pi: Pi
    cells: int
    speed: float
    revolutions: int
    position_gain: float
    lead: float = 0.0
    table: np.ndarray = field(default_factory=lambda: np.zeros(0))
    friction: float = 0.0
    wrapped: float | None = None  # angle of the last step [rad]
    turns: int = 0
    legs: list[Leg] = field(default_factory=list)
    calibrating: bool = False

    def __post_init__(self) -> None:
        self.table = np.zeros(self.cells)

    def calibrate(self) -> None:
        self.pi.integral, self.pi.saturated = 0.0, False
        self.table[:] = 0
        self.calibrating, self.wrapped, self.legs = True, None, []

    @property
    def theta(self) -> float:
        """Unwrapped [rad], zero in the revolution where the leg began."""
        assert self.wrapped is not None
        return self.wrapped + 2 * math.pi * self.turns

    def start_leg(self, direction: int) -> None:
        """An eighth of a revolution to settle, then `revolutions` to record."""
        self.turns = 0
        first = math.trunc(direction * self.theta / (2 * math.pi) * self.cells) + self.cells // 8 + 1
        self.legs.append(Leg(direction, first, first + self.cells * self.revolutions, self.theta, at=first))

    def record(self, leg: Leg, i_q: float, learn: bool) -> None:
        nearest = leg.direction * math.floor(self.theta / (2 * math.pi) * self.cells + 0.5)
        nearest -= leg.again * self.cells
        if nearest < leg.at:
            return
        if not learn:
            leg.again += 1
            leg.samples.pop(leg.at, None)
            return
        for passed in range(leg.at, min(nearest, leg.end)):
            leg.samples.setdefault(passed, [i_q])
        leg.at = min(nearest, leg.end)
        if leg.at < leg.end:
            leg.samples.setdefault(leg.at, []).append(i_q)

    def finish(self) -> None:
        means = []
        for leg in self.legs:
            entries = np.arange(leg.first, leg.end)
            current = np.array([clip(float(np.mean(leg.samples[n])), self.pi.limit) for n in entries])
            means.append(current.mean())
            np.add.at(self.table, leg.direction * entries % self.cells, current / (2 * self.revolutions))
        self.table -= self.table.mean()
        self.friction = (means[0] - means[1]) / 2
        self.calibrating = False
        self.pi.integral = 0.0

    def calibration_error(self, omega_m: float, theta_m: float, i_q: float, learn: bool) -> float:
        """The speed error of the run."""
        wrapped = theta_m % (2 * math.pi)
        before, self.wrapped = self.wrapped, wrapped
        if before is None:
            self.start_leg(1)
        else:
            self.turns -= round((wrapped - before) / (2 * math.pi))
        leg = self.legs[-1]
        leg.steps += 1
        self.record(leg, i_q, learn)
        path = leg.start + leg.direction * self.speed * self.pi.ts * leg.steps
        error = leg.direction * self.speed + self.position_gain * (path - self.theta) - omega_m
        if leg.at >= leg.end:
            if leg.direction > 0:
                self.start_leg(-1)
            else:
                self.finish()
        return error

    def looked_up(self, theta_m: float) -> float:
        x = theta_m / (2 * math.pi) % 1.0 * self.cells
        n = min(int(x), self.cells - 1)
        here, there = self.table[n], self.table[(n + 1) % self.cells]
        return float(here + (x - n) * (there - here))

    def step(self, omega_ref: float, omega_m: float, theta_m: float, i_q: float, learn: bool = True) -> float:
        if self.calibrating:
            waits = not (math.isfinite(omega_m) and is_angle(theta_m) and math.isfinite(i_q))
            return self.pi.step(0.0 if waits else self.calibration_error(omega_m, theta_m, i_q, learn))
        usable = math.isfinite(omega_m) and is_angle(theta_m)
        ahead = theta_m + self.lead * omega_m
        return self.pi.step(omega_ref - omega_m, self.looked_up(ahead) if usable else 0.0)

    def torque(self, current: float, omega_m: float, theta_m: float) -> float:
        usable = math.isfinite(omega_m) and is_angle(theta_m)
        return self.pi.torque(current, self.looked_up(theta_m + self.lead * omega_m) if usable else 0.0)
