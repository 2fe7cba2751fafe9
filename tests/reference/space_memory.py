"""What the space-learning laws remember, by channel: a map over the period of an angle, or all samples in a
row (verrelli2016 (4), (6) and Section 5)."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from .limits import clip, finite_or_zero, is_angle
from .memory import AngleMemory


class Map(AngleMemory):
    """Counts periods of any length. Of the present pass, the cells on which the Q filter's window looks back
    count as not yet written."""

    period: float = 2 * math.pi  # rad

    def position(self, theta_m: float) -> float:
        return theta_m / self.period % 1.0 * self.cells

    def one_period_ago(self, n: int) -> float:
        window = self.pass_length - (self.q_half_width + 1)
        for number, place, value in reversed(self.record.get(n % self.cells, [])):
            if number != self.passes or place < window:
                return value
        return 0.0


@dataclass
class SpaceMap:
    cells: int
    turns: int
    parts: int
    q_half_width: int
    limit: list[float]
    values: list[float] = field(default_factory=list)  # the last ones
    p_t: float = 0.0
    maps: list[Map] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.values = [0.0] * len(self.limit)
        for limit in self.limit:
            one = Map(self.cells, 1, self.q_half_width, 1.0, limit)
            one.period = 2 * math.pi * self.turns / self.parts
            self.maps.append(one)

    def recall(self, theta: float, moving: bool, learn: bool) -> tuple[list[float], bool]:
        recalled = [one.recall(theta, 0.0) for one in self.maps]
        self.plausible = is_angle(theta)
        if not self.plausible:
            return list(self.values), False
        return [r.filtered if learn else r.held for r in recalled], learn

    def update(self, values: list[float], learn: bool) -> None:
        self.values = [clip(finite_or_zero(v), k) for v, k in zip(values, self.limit, strict=True)]
        for one, value in zip(self.maps, self.values, strict=True):
            one.update(value, learn=learn and self.plausible)


@dataclass
class SpaceDelay:
    """Samples of the angle and of each channel; the last `cells` + `q_half_width` + 1 can be read. An angle
    is kept as whole periods and the rest, which loses nothing however long it runs."""

    cells: int
    turns: int
    parts: int
    q_half_width: int
    limit: list[float]
    method: str  # "ode" or "inversion"
    k_pp: float
    ts: float
    whole: list[int] = field(default_factory=list)
    rest: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)  # (sample, channel)
    values: list[float] = field(default_factory=list)
    p_t: float = 0.0
    tracking: bool = False
    advances: bool = False
    now: tuple[int, float] = (0, 0.0)

    def __post_init__(self) -> None:
        self.values = [0.0] * len(self.limit)

    @property
    def length(self) -> int:
        return self.cells + self.q_half_width + 1

    def apart(self, later: tuple[int, float], n: int) -> float:
        """How far the angle rose from sample n [periods]."""
        return (later[0] - self.whole[n]) + (later[1] - self.rest[n])

    def ode(self, dx: float) -> float:
        """P_t after an Euler step of its differential equation; x(t - P_t) on the line between samples."""
        newest = len(self.rest) - 1
        then = newest - self.p_t / self.ts  # the place, counted in samples; the last step was at `newest`
        newer = math.ceil(then - 1e-12)
        slope = self.apart((self.whole[newer], self.rest[newer]), newer - 1) / self.ts
        error = (
            self.apart((self.whole[newest], self.rest[newest]), newer)
            + (newer - then) * self.ts * slope
            - 1.0
        )
        return self.p_t + self.ts * (1.0 - (dx + self.k_pp * error) / slope)

    def find_period(self) -> None:
        newest, count = len(self.rest), min(len(self.rest), self.length)
        self.tracking = self.tracking and self.p_t / self.ts < count - 1  # both neighbours are still there
        if self.tracking and self.method == "ode":
            self.p_t = self.ode(self.apart(self.now, newest - 1) / self.ts)
            self.tracking = 1 <= self.p_t / self.ts < count
        if not self.tracking or self.method == "inversion":
            ages = range(1, count + 1)  # how far the angle rose grows with the age
            older = bisect_right(ages, 1.0, key=lambda age: self.apart(self.now, newest - age)) + 1
            self.tracking = older <= count
            self.p_t = 0.0
            if self.tracking:
                near = [self.apart(self.now, newest - age) for age in (older - 1, older)]
                self.p_t = float(np.interp(1.0, near, (older - 1, older))) * self.ts

    def ago(self, samples: int) -> list[float]:
        return (
            self.rows[-samples]
            if 1 <= samples <= min(len(self.rows), self.length)
            else [0.0] * len(self.limit)
        )

    def recall(self, theta: float, moving: bool, learn: bool) -> tuple[list[float], bool]:
        self.advances = False
        if not is_angle(theta):
            return list(self.values), False
        rest = theta / (2 * math.pi * self.turns / self.parts) % 1.0
        self.now, self.advances = (0, rest), moving
        if self.rest:
            moved = rest - self.rest[-1]
            wraps = round(moved)
            self.now = (self.whole[-1] - wraps, rest)
            self.advances = moving and moved - wraps > 0
        if not self.advances:
            return list(self.values), False
        if self.rest:
            self.find_period()
        nothing = [0.0] * len(self.limit)
        if not self.tracking:
            return nothing, learn and len(self.rest) < self.length
        age = math.floor(self.p_t / self.ts)
        m = self.q_half_width
        if not (age > m and age + m < self.length):
            return nothing, False
        part = self.p_t / self.ts - age
        reach = range(-m, m + 1) if learn else [0]
        lines = [
            (1 - part) * np.array(self.ago(age + k)) + part * np.array(self.ago(age + k + 1)) for k in reach
        ]
        return [float(v) for v in np.mean(lines, axis=0)], learn

    def update(self, values: list[float], learn: bool) -> None:
        self.values = [clip(finite_or_zero(v), k) for v, k in zip(values, self.limit, strict=True)]
        if self.advances:
            self.whole.append(self.now[0])
            self.rest.append(self.now[1])
            self.rows.append(self.values)
