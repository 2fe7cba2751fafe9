"""PI speed control with adaptive feedforward cancellation: Fourier coefficients learned over the angle."""

import math
from dataclasses import dataclass, field

import numpy as np

from .limits import clip, is_angle
from .pi import Pi
from .turns import TURN, parts_of_angle


@dataclass
class PiAfc:
    pi: Pi
    orders: np.ndarray
    gain: float
    lead: float
    omega_min: float
    limit: float
    a: np.ndarray = field(default_factory=lambda: np.zeros(0))
    b: np.ndarray = field(default_factory=lambda: np.zeros(0))
    learned: float = 0.0
    learning: bool = False

    def __post_init__(self) -> None:
        self.a, self.b = np.zeros(len(self.orders)), np.zeros(len(self.orders))

    def step(self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True) -> float:
        e, ts = omega_ref - omega_m, self.pi.ts
        before = theta_m - omega_ref * self.lead
        self.learning = learn and self.gain > 0 and math.isfinite(e)
        self.learning = self.learning and is_angle(theta_m) and is_angle(before)
        self.learning = self.learning and abs(omega_ref) >= self.omega_min and not self.pi.saturated
        if not is_angle(theta_m):
            self.learned = 0.0
            return self.pi.step(e, 0.0)
        # an order that passes in less than two samples is left out
        sampled = ~(self.orders * abs(omega_ref) * ts >= math.pi)
        if self.learning:
            there = self.of_orders(before)
            a = self.a + self.gain * ts * e * np.cos(there)
            b = self.b + self.gain * ts * e * np.sin(there)
            self.a = np.where(sampled, np.clip(a, -self.limit, self.limit), self.a)
            self.b = np.where(sampled, np.clip(b, -self.limit, self.limit), self.b)
        self.learned = self.recalled(theta_m, sampled)
        return self.pi.step(e, self.learned)

    def of_orders(self, theta: float) -> np.ndarray:
        """Angles of the orders where the rotor is at theta [rad]; in C angles are whole parts of a turn."""
        turns = np.asarray(self.orders, dtype=np.int64) * parts_of_angle(theta) % TURN
        return turns * (math.tau / TURN)

    def recalled(self, theta_m: float, sampled: np.ndarray) -> float:
        there = self.of_orders(theta_m)
        terms = self.a * np.cos(there) + self.b * np.sin(there)
        return clip(float(np.sum(terms[sampled])), self.limit)

    def torque(self, current: float, omega_ref: float, omega_m: float, theta_m: float) -> float:
        sampled = ~(self.orders * abs(omega_ref) * self.pi.ts >= math.pi)
        self.learning = False
        self.learned = self.recalled(theta_m, sampled) if is_angle(theta_m) else 0.0
        return self.pi.torque(current, self.learned)
