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
FASTEST, SPLIT, MEAN, QUICK, SETTLE, NEW, FULL = 2.6, 0.5105, 0.25, 1 / 16, 64, 1.25, 6.0
TOGETHER = 1 / 16
BENT, SURE, STAYS, DOUBTED, CALM = 0.05, 2.5e-7, 1 / 8, 64.0, 0.02
TURN_OF_BEND, PARTS, FEW = 8, 2, 8
HUNTS = 2.0


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
        self.told, self.current = [0.0, 0.0], 0.0
        self.theta = self.shown = 0
        self.since_edge = 0.0
        self.loads = [0.0] * PARTS
        self.share = QUICK
        self.omega = self.load = self.mean = self.drift = self.calm = 0.0
        self.time = self.slowest = self.fastest = self.rate_now = 0.0
        self.round_step = 0.0
        free = 2 if self.base > 4 else 1 if self.base > 2 else 0
        self.bend = np.zeros(min(self.bends, free), dtype=complex)
        self.believed = self.bend_rate = self.power = self.rest = self.doubt = self.moved = self.before = 0.0
        self.here = self.slope = 0.0
        self.due = self.acting = self.low = 0
        self.since = 1
        self.wait, self.seated = SETTLE, False

    @property
    def a(self) -> np.ndarray:
        return self.c.real

    @property
    def sines(self) -> np.ndarray:
        return -self.c.imag

    def shares(self) -> tuple[float, list[float]]:
        """What stays of the lag, and the shares of the last three commands."""
        if self.d > 1.5:
            kept = self.d / (1 + self.d)
            return kept, [1 - kept, 0.0, 0.0]
        m, f = (0, self.d) if self.d < 1 else (1, self.d - 1)
        return 0.0, [0.0] * m + [1 - f, f] + [0.0] * (1 - m)

    def within_step(self, shown: int, omega_m: float) -> int:
        """Where the rotor is within the step that a sensor shows whose speed is timed from edge to edge."""
        turned_by = ((shown - self.shown + TURN // 2) % TURN - TURN // 2) / TURN
        half = min(self.sensor_step / (2 * math.tau), 0.25)
        way = self.since_edge + omega_m * self.pi.ts / math.tau - turned_by
        self.since_edge = 0.0 if math.isnan(way) else clip(way, half)
        self.shown = shown
        return (shown + parts(self.since_edge)) % TURN

    def tell(self, u: float) -> None:
        """What the feedback commands acts from the next step on."""
        kept, shares = self.shares()
        now = kept * self.current + sum(x * y for x, y in zip(shares, [u, *self.told], strict=True))
        self.current = clip(now, self.pi.limit)
        self.told = [u, self.told[0]]

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
        if speed > NEW * self.fastest or NEW * speed < self.slowest:
            self.slowest = min(self.slowest, speed) if self.fastest > 0 else speed
            self.fastest, self.time = max(self.fastest, speed), 0.0
        fast = self.orders if self.fast is None else self.fast
        fits, low = (
            int(min(count, most / abs(step) if step else math.inf))
            for count, most in ((fast, FASTEST), (self.orders, SPLIT))
        )
        self.acting = max(fits, low)
        between = slice(min(low, self.low), max(low, self.low))
        self.weight[between] = 0.0
        self.low = low
        shared = TOGETHER / (max(self.acting, 1) * self.pi.ts)
        full = min(self.rate, shared)
        begun = full * self.time
        rate = max(full / (1 + max(begun - FULL, 0.0) / 2), min(self.rate_min, shared))
        asked = HUNTS * self.base * self.pi.ts * abs(omega_ref)
        self.rate_now = min(rate, (asked if asked < abs(step) else abs(step)) / (math.pi * self.pi.ts))
        self.judge_bend(begun)
        self.round_step, self.due = step, 0

    def judge_bend(self, begun: float) -> None:
        """Set the bend's rate and share for the next round.

        No bend is learned if noise makes too much of it, or if fast orders have most of the ripple. No bend
        acts if noise may make all of it.
        """
        size, shows = self.base * self.power, self.power > self.rest
        self.calm = CALM * self.power / max(self.low, 1) * self.gain**2
        self.power = self.rest = self.bend_rate = 0.0
        if begun <= FULL / 2 or size <= 1e-9 or not shows or self.rate_now == 0:
            return
        variance = 2 * self.doubt / (self.rate_now * self.pi.ts * size**2)
        if variance < SURE:
            square = float(np.sum(np.abs(self.bend) ** 2))
            self.bend_rate = 2 / size
            self.believed = max(0.0, 1 - DOUBTED * variance / square) if square else 0.0

    def turn_bend(self, theta: int) -> None:
        """Every few steps the bend learns from how the phases moved; value and slope are computed anew."""
        turn = cmath.exp(1j * math.tau * theta / TURN)
        if self.learning and self.drift**2 < self.calm:
            now = STAYS * (self.moved - self.before) ** 2 - TURN_OF_BEND * self.doubt
            self.before = self.moved
            self.doubt += min(self.rate_now * self.pi.ts, 1 / TURN_OF_BEND) * now
            for m, one in enumerate(self.bend):
                grown = one + self.bend_rate * self.moved * turn ** -(m + 1)
                self.bend[m] = complex(clip(grown.real, BENT), clip(grown.imag, BENT))
        self.moved = 0.0
        parts_of = [one * turn ** (m + 1) for m, one in enumerate(self.bend)]
        self.here = self.believed * sum(one.real for one in parts_of)
        self.slope = -self.believed * sum((m + 1) * one.imag for m, one in enumerate(parts_of))

    def is_held(self, om: float) -> bool:
        return any(low <= om <= high for low, high in zip(self.held[::2], self.held[1::2], strict=True))

    def make_gain(self, pause: int, omega_ref: float) -> None:
        slow = MEAN * self.base * abs(self.omega)
        self.share = min(slow, QUICK) if self.learning else QUICK
        if self.learning and self.time < 1e6:
            self.time += pause * self.pi.ts
        if self.due >= self.acting:
            self.begin_round(omega_ref)
            return
        k = self.due
        om = (k + 1) * self.round_step
        z = cmath.exp(1j * om)
        turned = cmath.exp(1j * om * (0.5 + self.d))  # what acts is ahead of what is measured
        rate = 0.0 if self.is_held(abs(om)) else self.rate_now
        power = (k + 1) * abs(self.c[k]) ** 2
        if k < self.low:
            self.power += 0.0 if self.is_held(abs(om)) else power
            g = L3 / 2 * (z + 1) * z / (z - P) ** 3 * cmath.exp(0.5j * om)
            g *= (1 + z**-1) / PARTS
            turned *= 1 - 1j * math.copysign(MEAN, self.omega) / (k + 1)
        else:
            self.rest += power
            g = (z + 1) * (z - 1) / 2 / (z - P) ** 3 * cmath.exp(0.5j * om)
        self.weight[k] = rate / (self.b * self.pi.ts) / g * turned
        self.due = k + 1

    def sum_of_orders(self, angle: int, load: float, e: float) -> float:
        n = np.arange(self.acting)
        phasor = np.exp(1j * math.tau * (self.base * angle % TURN / TURN) * (n + 1))
        part = self.since % PARTS
        taught = (self.low * part // PARTS <= n) & (n < self.low * (part + 1) // PARTS)
        seen = np.where(n < self.low, np.where(taught, load, 0.0), e)
        off = seen * self.weight[: self.acting] * np.conj(phasor)
        moved = float(np.sum((np.conj(self.c[: self.acting]) * off).imag[: self.low]))
        self.moved += moved
        c = self.c[: self.acting] - off
        real, imag = (np.clip(part, -self.limit, self.limit) for part in (c.real, c.imag))
        self.c[: self.acting] = real + 1j * imag
        return clip(float(np.sum((self.c[: self.acting] * phasor).real)), self.limit)

    def follow(self, omega_ref: float, omega_m: float, theta: int | None, may: bool) -> None:
        """Observer, gains, amplitudes and the learned current of one step."""
        self.learning = may and self.wait == 0
        self.wait = max(self.wait - 1, 0) if may else SETTLE
        self.learned = 0.0
        if theta is None:
            self.seated = False
            return
        if not self.seated:
            self.theta, self.load, self.mean, self.drift = theta, 0.0, 0.0, 0.0
            self.loads = [0.0] * PARTS
            self.omega = clip(finite_or_zero(omega_m) * self.pi.ts, math.pi)
            self.wait, self.seated = SETTLE, True
        e = self.observe(theta)
        self.mean += self.share * (self.load - self.mean)
        self.loads = [self.load - self.mean, *self.loads[:-1]]
        self.drift += self.share * (self.loads[0] - self.drift)
        pause = 2 if self.acting > FEW else 4
        if self.since % pause == 1:
            self.make_gain(pause, omega_ref)
        ahead = self.omega * (0.5 + self.d) - self.here
        seen = (sum(self.loads), e) if self.learning else (0.0, 0.0)
        self.learned = self.sum_of_orders(turned(theta, ahead), *seen)

    def angle_of(self, theta_m: float, omega_m: float) -> int | None:
        if not is_angle(theta_m):
            return None
        return self.within_step(parts_of_angle(theta_m), omega_m)

    def take_turn(self, theta: int | None) -> None:
        """The bend goes on by its slope, and once in a while it has its turn."""
        if theta is None:
            self.since = TURN_OF_BEND - 1
            self.here = self.slope = 0.0
            return
        self.since = (self.since + 1) % TURN_OF_BEND
        self.here += self.slope * self.omega
        if self.since == 0 and len(self.bend):
            self.turn_bend(theta)

    def step(
        self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True, theta_ref: float = 0.0
    ) -> float:
        theta = self.angle_of(theta_m, omega_m)
        self.take_turn(theta)
        error = omega_ref - omega_m + self.slope * omega_m
        plausible = math.isfinite(omega_ref - omega_m) and is_angle(theta_m)
        if self.k_theta:
            plausible &= is_angle(theta_ref)
            if theta is not None and is_angle(theta_ref):
                asked = parts_of_angle(theta_ref)
                way = ((asked - theta + TURN // 2) % TURN - TURN // 2) / TURN * math.tau
                error += self.k_theta * (way + self.here)
        may = learn and omega_ref != 0 and plausible and not self.pi.saturated
        self.follow(omega_ref, omega_m, theta, may)
        out = self.pi.step(error, self.learned)
        self.tell(out - self.learned)
        return out

    def torque(self, current: float, omega_ref: float, omega_m: float, theta_m: float) -> float:
        theta = self.angle_of(theta_m, omega_m)
        self.take_turn(theta)
        self.follow(omega_ref, omega_m, theta, False)
        out = self.pi.torque(current, self.learned)
        self.tell(out - self.learned)
        return out
