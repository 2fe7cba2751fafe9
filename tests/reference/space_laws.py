"""Space-learning speed control, verrelli2016 (4), and position control, (6) and Section 5."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from .limits import clip, finite_or_zero, is_angle
from .memory import AngleMemory, DelayLine


class PositionInput(NamedTuple):
    theta_ref: float
    omega_ref: float
    alpha_ref: float
    theta_m: float
    omega_m: float
    learn: bool = True


def theta_tg(theta: float, theta_ref: float) -> float:
    """(6), with the four-quadrant arctangent of sine and cosine of theta_ref - theta"""
    sine = math.sin(theta_ref) * math.cos(theta) - math.sin(theta) * math.cos(theta_ref)
    cosine = math.cos(theta_ref) * math.cos(theta) + math.sin(theta_ref) * math.sin(theta)
    return -math.atan2(sine, cosine)


@dataclass
class SpacePosition:
    ratio: int
    k_theta: float
    k_omega: float
    k_v: float
    v_0: float
    v_2: float
    k_i: float
    mu_alpha: float
    mu_beta: float
    mu_h: float
    hand_over: bool
    ramp: float
    omega_min: float
    index: str  # "reference" or "rotor"
    ts: float
    limit: float
    memory: AngleMemory | DelayLine
    integral: float = 0.0  # A
    learned: int = 0
    saturated: bool = False
    plausible: bool = True
    learning: bool = False
    terms: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.memory.centred = 2 if self.k_i > 0 and not self.hand_over else 0

    def step(self, i: PositionInput) -> float:
        n = self.ratio
        self.plausible = all(map(math.isfinite, i[:5])) and is_angle(i.theta_ref) and is_angle(i.theta_m)
        speeds = (n * i.omega_m, n * i.omega_ref, n * i.alpha_ref)
        omega, omega_ref, alpha_ref = speeds if self.plausible else (0.0, 0.0, 0.0)
        error = theta_tg(n * i.theta_m, n * i.theta_ref) if self.plausible else 0.0
        omega_t = omega + self.k_theta * error - omega_ref
        moving = self.plausible and abs(i.omega_ref) >= self.omega_min

        theta = i.theta_m if self.index == "rotor" else i.theta_ref
        may = i.learn and moving and not self.saturated and self.mu_alpha + self.mu_beta + self.mu_h > 0
        share = 1.0 if self.learned * self.ts >= self.ramp else self.learned * self.ts / self.ramp
        f = [1.0, omega_ref, alpha_ref][: len(self.memory.limit)]
        mu = (self.mu_alpha, self.mu_beta, self.mu_h)
        change = [
            -share * m * f_i / abs(omega_ref) * omega_t if moving else 0.0
            for m, f_i in zip(mu, f, strict=False)
        ]
        values, self.learning = self.memory.step(theta, i.omega_ref if moving else 0.0, may, change)
        share *= self.learning or self.learned > 0
        self.learned += self.learning

        i_hat = [v * f_i for v, f_i in zip(values, f, strict=True)]
        v_omega = self.v_0 + self.v_2 * omega**2
        feedback = -self.k_omega * omega_t - self.k_v * error - v_omega * omega_t
        share_i = 1 - share if self.hand_over else 1.0
        if self.learning:
            transfer = sum(v * f_i for v, f_i in zip(self.memory.transfer, f, strict=True))
            self.integral = clip(self.integral - transfer, self.limit)
        self.integral = self.integral if share_i > 0 else 0.0
        integrated = clip(self.integral + self.ts * self.k_i * omega_t, self.limit)
        wanted = feedback - share_i * integrated + sum(i_hat)
        self.saturated = abs(wanted) >= self.limit
        if not self.saturated or omega_t * wanted > 0:
            self.integral = integrated
        self.terms = {"proportional": feedback, "integral": -share_i * self.integral}
        self.terms |= dict(zip(("alpha", "beta", "h"), [*i_hat, 0.0, 0.0], strict=False))
        return clip(sum(self.terms.values()), self.limit)

    def torque(self, i: PositionInput, current: float) -> float:
        """A step with somebody else's current. The integral takes it over if it has a share and a gain."""
        n, current = self.ratio, finite_or_zero(current)
        plausible = all(map(math.isfinite, i[:5])) and is_angle(i.theta_ref) and is_angle(i.theta_m)
        moving = plausible and abs(i.omega_ref) >= self.omega_min
        theta = i.theta_m if self.index == "rotor" else i.theta_ref
        values, self.learning = self.memory.step(
            theta, i.omega_ref if moving else 0.0, False, [0.0] * len(self.memory.limit)
        )
        f = [1.0, n * i.omega_ref, n * i.alpha_ref] if plausible else [1.0, 0.0, 0.0]
        ramp = 1.0 if self.learned * self.ts >= self.ramp else self.learned * self.ts / self.ramp
        share_i = 1 - ramp * (self.learned > 0) if self.hand_over else 1.0
        start = clip(-clip(current, self.limit) / share_i, self.limit) if share_i * self.k_i > 0 else 0.0
        self.integral, self.saturated = start, False
        return clip(current + sum(v * f_i for v, f_i in zip(values, f, strict=False)), self.limit)


@dataclass
class SpaceSpeed:
    k: float
    mu_alpha: float
    mu_beta: float
    mu_h: float
    eta_bar: float
    omega_min: float
    limit: float
    ratio: int
    memory: AngleMemory | DelayLine
    saturated: bool = False
    plausible: bool = True
    learning: bool = False
    terms: dict[str, float] = field(default_factory=dict)

    def step(self, i: PositionInput) -> float:
        known = (i.omega_ref, i.alpha_ref, i.omega_m)
        self.plausible = all(map(math.isfinite, known)) and is_angle(i.theta_m)
        omega_ref, alpha_ref, omega = known if self.plausible else (0.0, 0.0, 0.0)
        eta = omega - omega_ref
        moving = abs(omega) >= self.omega_min
        q = 1 / abs(omega) if abs(eta) < self.eta_bar and moving else 0.0
        f = [-1.0, -eta - omega_ref, -alpha_ref][: len(self.memory.limit)]
        mu = (self.mu_alpha, self.mu_beta, self.mu_h)
        may = i.learn and q > 0 and not self.saturated and sum(mu) > 0
        speed = omega if moving else 0.0
        by = [-1.0, -omega_ref, -alpha_ref]  # else alpha's and beta's means would drift apart
        change = [m * eta * f_i * q for m, f_i in zip(mu, by[: len(f)], strict=False)]
        delta, self.learning = self.memory.step(i.theta_m, speed, may, change)  # (4)
        learned = [-d * f_i for d, f_i in zip(delta, f, strict=True)]
        wanted = -self.k * eta + sum(learned)
        self.saturated = abs(wanted) >= self.limit
        self.terms = {"proportional": -self.k * eta}
        self.terms |= dict(zip(("alpha", "beta", "h"), [*learned, 0.0, 0.0], strict=False))
        return clip(finite_or_zero(wanted), self.limit)

    def torque(self, i: PositionInput, current: float) -> float:
        known = (i.omega_ref, i.alpha_ref, i.omega_m)
        plausible = all(map(math.isfinite, known)) and is_angle(i.theta_m)
        f = [1.0, i.omega_m, i.alpha_ref] if plausible else [1.0, 0.0, 0.0]
        speed = f[1] if abs(f[1]) >= self.omega_min else 0.0
        values, self.learning = self.memory.step(i.theta_m, speed, False, [0.0] * len(self.memory.limit))
        self.saturated = False
        wanted = finite_or_zero(current) + sum(v * f_i for v, f_i in zip(values, f, strict=False))
        return clip(wanted, self.limit)
