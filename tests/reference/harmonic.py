"""PI speed control with learned harmonics: amplitudes of a base order's multiples, seen through an observer.

The equations of docs/laws/harmonic.md, in complex numbers; angles are whole parts of a turn, as in C.
"""

import cmath
import math
from dataclasses import dataclass, field

import numpy as np

from .limits import clip, finite_or_zero, is_angle
from .pi import Pi
from .turns import TURN, parts, parts_of_angle, turned

P = math.exp(-0.5)
L1, L2, L3 = 1 - P**3, 1.5 * (1 - P) ** 2 * (1 + P), (1 - P) ** 3
FASTEST, SLOW_ANGLE_MOST, HUNTING_FACTOR = 2.6, 0.5105, 2.0
MEAN_SHARE_PER_RAD, MEAN_SHARE_MOST = 0.25, 1 / 16
RATE_SUM_MOST, FULL_RATE_LENGTH, NEW_SPEED_FACTOR = 1 / 16, 6.0, 1.25
BEND_MOST, BEND_VARIANCE_MOST, BEND_NOISE_SHARE = 0.05, 2.5e-7, 1 / 8
BEND_DOUBT_FACTOR, BEND_DRIFT_SHARE = 64.0, 0.02
BEND_PERIOD, SLOW_SHARES, FEW_ORDERS, SETTLE = 8, 2, 8, 64


@dataclass
class Harmonic:
    pi: Pi
    b: float
    delay: float
    base: int
    orders: int
    rate: float
    rate_min: float
    limit: float
    held: tuple[float, ...] = ()
    k_theta: float = 0.0
    bends: int = 2
    sensor_step: float = 0.0
    fast: int | None = None
    c: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=complex))
    learned: float = 0.0
    learning: bool = False

    def __post_init__(self) -> None:
        ts = self.pi.ts
        self.c, self.weight = np.zeros((2, self.orders), dtype=complex)
        self.d, self.gain = self.delay / ts, self.b * ts * ts
        self.pending, self.current = [0.0, 0.0], 0.0
        self.theta = self.theta_sensor = 0
        self.since_edge = 0.0
        self.loads = [0.0] * SLOW_SHARES
        self.share = MEAN_SHARE_MOST
        self.omega = self.load = self.mean = self.drift = self.drift_most = 0.0
        self.time = self.slowest = self.fastest = self.rate_now = 0.0
        self.round_step = 0.0
        free = 2 if self.base > 4 else 1 if self.base > 2 else 0
        self.bend = np.zeros(min(self.bends, free), dtype=complex)
        self.bend_share = self.bend_rate = self.slow_power = self.fast_power = 0.0
        self.variance = self.phase_sum = self.last_phase_sum = 0.0
        self.bend_angle = self.slope = 0.0
        self.next_gain = self.acting = self.low = 0
        self.tick = 1
        self.wait, self.follows = SETTLE, False

    @property
    def a(self) -> np.ndarray:
        return self.c.real

    @property
    def sines(self) -> np.ndarray:
        return -self.c.imag

    def shares(self) -> tuple[float, list[float]]:
        """Return the share of the current that a lag leaves, and those of the last three commands."""
        if self.d > 1.5:
            kept = self.d / (1 + self.d)
            return kept, [1 - kept, 0.0, 0.0]
        m, f = (0, self.d) if self.d < 1 else (1, self.d - 1)
        return 0.0, [0.0] * m + [1 - f, f] + [0.0] * (1 - m)

    def refine_angle(self, shown: int, omega_m: float) -> int:
        """Return the angle within a step of a sensor whose speed is measured from edge to edge."""
        turned_by = ((shown - self.theta_sensor + TURN // 2) % TURN - TURN // 2) / TURN
        half = min(self.sensor_step / (2 * math.tau), 0.25)
        way = self.since_edge + omega_m * self.pi.ts / math.tau - turned_by
        self.since_edge = 0.0 if math.isnan(way) else clip(way, half)
        self.theta_sensor = shown
        return (shown + parts(self.since_edge)) % TURN

    def set_current(self, u: float) -> None:
        """Delay the current of the feedback, which acts from the next step on."""
        kept, shares = self.shares()
        now = kept * self.current + sum(x * y for x, y in zip(shares, [u, *self.pending], strict=True))
        self.current = clip(now, self.pi.limit)
        self.pending = [u, self.pending[0]]

    def observe(self, theta_m: int) -> float:
        rise = self.gain * self.current + self.load
        ahead = turned(self.theta, self.omega + rise / 2)
        e = ((theta_m - ahead + TURN // 2) % TURN - TURN // 2) / TURN * math.tau
        self.theta = turned(ahead, L1 * e)
        self.omega = clip(self.omega + rise + L2 * e, math.pi)
        self.load = clip(self.load + L3 * e, math.pi)
        return e

    def begin_round(self, omega_ref: float) -> None:
        speed, step = abs(self.omega), self.base * self.omega
        if speed > NEW_SPEED_FACTOR * self.fastest or NEW_SPEED_FACTOR * speed < self.slowest:
            self.slowest = min(self.slowest, speed) if self.fastest > 0 else speed
            self.fastest, self.time = max(self.fastest, speed), 0.0
        fast = self.orders if self.fast is None else self.fast
        fits, low = (
            int(min(count, most / abs(step) if step else math.inf))
            for count, most in ((fast, FASTEST), (self.orders, SLOW_ANGLE_MOST))
        )
        self.acting = max(fits, low)
        between = slice(min(low, self.low), max(low, self.low))
        self.weight[between] = 0.0
        self.low = low
        shared = RATE_SUM_MOST / (max(self.acting, 1) * self.pi.ts)
        full = min(self.rate, shared)
        begun = full * self.time
        rate = max(full / (1 + max(begun - FULL_RATE_LENGTH, 0.0) / 2), min(self.rate_min, shared))
        asked = HUNTING_FACTOR * self.base * self.pi.ts * abs(omega_ref)
        self.rate_now = min(rate, (asked if asked < abs(step) else abs(step)) / (math.pi * self.pi.ts))
        self.set_bend_rate(begun)
        self.round_step, self.next_gain = step, 0

    def set_bend_rate(self, begun: float) -> None:
        """Set the bend's rate and share for the next round.

        No bend is learned if noise makes too much of it, or if fast orders have most of the ripple. No bend
        acts if noise may make all of it.
        """
        size, shows = self.base * self.slow_power, self.slow_power > self.fast_power
        self.drift_most = BEND_DRIFT_SHARE * self.slow_power / max(self.low, 1) * self.gain**2
        self.slow_power = self.fast_power = self.bend_rate = 0.0
        if begun <= FULL_RATE_LENGTH / 2 or size <= 1e-9 or not shows or self.rate_now == 0:
            return
        variance = 2 * self.variance / (self.rate_now * self.pi.ts * size**2)
        if variance < BEND_VARIANCE_MOST:
            square = float(np.sum(np.abs(self.bend) ** 2))
            self.bend_rate = 2 / size
            self.bend_share = max(0.0, 1 - BEND_DOUBT_FACTOR * variance / square) if square else 0.0

    def update_bend(self, theta: int) -> None:
        """Correct the bend by the phase that the orders gained together, and compute value and slope anew."""
        turn = cmath.exp(1j * math.tau * theta / TURN)
        if self.learning and self.drift**2 < self.drift_most:
            now = BEND_NOISE_SHARE * (self.phase_sum - self.last_phase_sum) ** 2 - BEND_PERIOD * self.variance
            self.last_phase_sum = self.phase_sum
            self.variance += min(self.rate_now * self.pi.ts, 1 / BEND_PERIOD) * now
            for m, one in enumerate(self.bend):
                grown = one + self.bend_rate * self.phase_sum * turn ** -(m + 1)
                self.bend[m] = complex(clip(grown.real, BEND_MOST), clip(grown.imag, BEND_MOST))
        self.phase_sum = 0.0
        parts_of = [one * turn ** (m + 1) for m, one in enumerate(self.bend)]
        self.bend_angle = self.bend_share * sum(one.real for one in parts_of)
        self.slope = -self.bend_share * sum((m + 1) * one.imag for m, one in enumerate(parts_of))

    def is_held(self, om: float) -> bool:
        return any(low <= om <= high for low, high in zip(self.held[::2], self.held[1::2], strict=True))

    def make_gain(self, pause: int, omega_ref: float) -> None:
        slow = MEAN_SHARE_PER_RAD * self.base * abs(self.omega)
        self.share = min(slow, MEAN_SHARE_MOST) if self.learning else MEAN_SHARE_MOST
        if self.learning and self.time < 1e6:
            self.time += pause * self.pi.ts
        if self.next_gain >= self.acting:
            self.begin_round(omega_ref)
            return
        k = self.next_gain
        om = (k + 1) * self.round_step
        z = cmath.exp(1j * om)
        turned = cmath.exp(1j * om * (0.5 + self.d))  # what acts is ahead of what is measured
        rate = 0.0 if self.is_held(abs(om)) else self.rate_now
        power = (k + 1) * abs(self.c[k]) ** 2
        if k < self.low:
            self.slow_power += 0.0 if self.is_held(abs(om)) else power
            g = L3 / 2 * (z + 1) * z / (z - P) ** 3 * cmath.exp(0.5j * om)
            g *= (1 + z**-1) / SLOW_SHARES
            turned *= 1 - 1j * math.copysign(MEAN_SHARE_PER_RAD, self.omega) / (k + 1)
        else:
            self.fast_power += power
            g = (z + 1) * (z - 1) / 2 / (z - P) ** 3 * cmath.exp(0.5j * om)
        self.weight[k] = rate / (self.b * self.pi.ts) / g * turned
        self.next_gain = k + 1

    def sum_of_orders(self, angle: int, load: float, e: float) -> float:
        n = np.arange(self.acting)
        phasor = np.exp(1j * math.tau * (self.base * angle % TURN / TURN) * (n + 1))
        part = self.tick % SLOW_SHARES
        taught = (self.low * part // SLOW_SHARES <= n) & (n < self.low * (part + 1) // SLOW_SHARES)
        seen = np.where(n < self.low, np.where(taught, load, 0.0), e)
        off = seen * self.weight[: self.acting] * np.conj(phasor)
        moved = float(np.sum((np.conj(self.c[: self.acting]) * off).imag[: self.low]))
        self.phase_sum += moved
        c = self.c[: self.acting] - off
        real, imag = (np.clip(part, -self.limit, self.limit) for part in (c.real, c.imag))
        self.c[: self.acting] = real + 1j * imag
        return clip(float(np.sum((self.c[: self.acting] * phasor).real)), self.limit)

    def learn(self, omega_ref: float, omega_m: float, theta: int | None, may: bool) -> None:
        """Observer, gains, amplitudes and the learned current of one step."""
        self.learning = may and self.wait == 0
        self.wait = max(self.wait - 1, 0) if may else SETTLE
        self.learned = 0.0
        if theta is None:
            self.follows = False
            return
        if not self.follows:
            self.theta, self.load, self.mean, self.drift = theta, 0.0, 0.0, 0.0
            self.loads = [0.0] * SLOW_SHARES
            self.omega = clip(finite_or_zero(omega_m) * self.pi.ts, math.pi)
            self.wait, self.follows = SETTLE, True
        e = self.observe(theta)
        self.mean += self.share * (self.load - self.mean)
        self.loads = [self.load - self.mean, *self.loads[:-1]]
        self.drift += self.share * (self.loads[0] - self.drift)
        pause = 2 if self.acting > FEW_ORDERS else 4
        if self.tick % pause == 1:
            self.make_gain(pause, omega_ref)
        ahead = self.omega * (0.5 + self.d) - self.bend_angle
        seen = (sum(self.loads), e) if self.learning else (0.0, 0.0)
        self.learned = self.sum_of_orders(turned(theta, ahead), *seen)

    def angle_of(self, theta_m: float, omega_m: float) -> int | None:
        if not is_angle(theta_m):
            return None
        return self.refine_angle(parts_of_angle(theta_m), omega_m)

    def step_bend(self, theta: int | None) -> None:
        """Extrapolate the bend by its slope, and update it every few steps."""
        if theta is None:
            self.tick = BEND_PERIOD - 1
            self.bend_angle = self.slope = 0.0
            return
        self.tick = (self.tick + 1) % BEND_PERIOD
        self.bend_angle += self.slope * self.omega
        if self.tick == 0 and len(self.bend):
            self.update_bend(theta)

    def step(
        self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True, theta_ref: float = 0.0
    ) -> float:
        theta = self.angle_of(theta_m, omega_m)
        self.step_bend(theta)
        error = omega_ref - omega_m + self.slope * omega_m
        plausible = math.isfinite(omega_ref - omega_m) and is_angle(theta_m)
        if self.k_theta:
            plausible &= is_angle(theta_ref)
            if theta is not None and is_angle(theta_ref):
                asked = parts_of_angle(theta_ref)
                way = ((asked - theta + TURN // 2) % TURN - TURN // 2) / TURN * math.tau
                error += self.k_theta * (way + self.bend_angle)
        may = learn and omega_ref != 0 and plausible and not self.pi.saturated
        self.learn(omega_ref, omega_m, theta, may)
        out = self.pi.step(error, self.learned)
        self.set_current(out - self.learned)
        return out

    def torque(self, current: float, omega_ref: float, omega_m: float, theta_m: float) -> float:
        theta = self.angle_of(theta_m, omega_m)
        self.step_bend(theta)
        self.learn(omega_ref, omega_m, theta, False)
        out = self.pi.torque(current, self.learned)
        self.set_current(out - self.learned)
        return out
