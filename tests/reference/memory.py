"""What a learning law remembers, by channel, without running sums: a map over the period of an angle, or all
samples in a row (liu2018 (29), verrelli2016 (4), (6) and Section 5)."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from .limits import is_angle

WHOLE = 1 << 32  # a revolution, or a period
QUARTER = 1 << 30
MOVES = 8  # samples by which the place of one period ago moves in a step, at most


def mean_between(rows: list[list[float]], part: float) -> list[float]:
    """By channel, the mean of the points that lie `part` of the way from each row to the next."""
    return [
        (sum(column) - (1 - part) * column[-1] - part * column[0]) / (len(rows) - 1)
        for column in zip(*rows, strict=True)
    ]


@dataclass(kw_only=True)
class Memory:
    """What both kinds share. `real` is the number type in which an angle is divided by a revolution."""

    cells: int
    limit: list[float]  # by channel
    turns: int = 1
    parts: int = 1
    q_half_width: int = 0
    lead: int = 0
    forgetting: float = 1.0
    ratio: int = 1
    real: type = float
    revolution: tuple[int, int] = (0, 0)  # number of the present turn; angle in that turn
    centred: int = 0  # number of the first channels whose mean over the period belongs to an integral

    def __post_init__(self) -> None:
        self.value = [0.0] * len(self.limit)  # the last step's values
        self.mean = [0.0] * len(self.limit)  # mean over the last period that was gathered
        self.transfer = [0.0] * len(self.limit)  # part of the mean that an integral takes over in this step
        self.gathered: list[list[float]] = []  # values for the next mean
        self.beyond = 0.0  # in a delay line, the share of the first gathered value that counts

    def recalled(self, values: list[float]) -> list[float]:
        """The values of a period ago, less what this period takes away; learning continues from these."""
        return [self.forgetting * v - lost for v, lost in zip(values, self.lost, strict=True)]

    @property
    def lost(self) -> list[float]:
        """What a period takes away of the mean in addition to forgetting. At most 15/16 of it is recalled."""
        beyond = max(0.0, self.forgetting - 15 / 16)
        return [beyond * mean * (c < self.centred) for c, mean in enumerate(self.mean)]

    def take_mean(self, weights: list[float]) -> None:
        columns = zip(*self.gathered, strict=True)
        self.mean = self.clipped([float(np.average(column, weights=weights)) for column in columns])

    def place(self, theta: float) -> int:
        """Place in the period, in 2^-32 periods. The turn that the rotor is in is found by the shorter way
        round."""
        x = self.real(theta) * (self.real(1) / self.real(2 * math.pi))
        rest = x - self.real(int(x))
        angle = (int(rest * 2.0**32) if self.real is float else int(float(rest) * 2.0**31) * 2) % WHOLE
        turn, before = self.revolution
        if self.turns > 1:
            rises = (angle - before) % WHOLE < WHOLE // 2
            turn = (turn + (rises and angle < before) - (not rises and angle > before)) % self.turns
        self.revolution = (turn, angle)
        periods = self.ratio * self.parts
        return (turn * WHOLE * periods // self.turns + angle * periods // self.turns) % WHOLE

    def repeat(self) -> tuple[list[float], bool]:
        return list(self.value), False

    @property
    def fewest(self) -> int:
        """Samples in a period in which it learns, at least."""
        return 4 * max(1, self.lead)

    def clipped(self, values: list[float]) -> list[float]:
        return [
            k if v > k else -k if v < -k else 0.0 if v != v else v  # here most of the time is spent
            for v, k in zip(values, self.limit, strict=True)
        ]


@dataclass(kw_only=True)
class AngleMemory(Memory):
    """A map over the period, written where the rotor passes. The values of one period ago are, behind the
    rotor, those of the map before the rotor passed; ahead of the rotor, those of the map now."""

    x: int = (
        0  # the last place, as it is counted: on the way back from the other end, so that it always rises
    )
    at: int = 0  # the cell at or before x, counted like x and without wrapping
    back: bool = False
    passed: int = 0  # cells that the rotor passed in the last step
    half: int = 0  # present half width of the filter
    started: bool = False
    follows: bool = False  # the last step learned
    behind: dict[int, list[float]] = field(default_factory=dict)  # the last cells passed, as they were
    corrected: tuple[int, list[float]] | None = None  # place and values of the last correction with a lead

    def __post_init__(self) -> None:
        super().__post_init__()
        self.map = [[0.0] * len(self.limit) for _ in range(self.cells)]

    def counted(self, place: int) -> int:
        """The place, which on the way back counts from the last cell instead of the first."""
        return (-place - WHOLE // self.cells if self.back else place) % WHOLE

    def cell(self, n: int) -> list[float]:
        return self.map[(self.cells - 1 - n if self.back else n) % self.cells]

    def ago(self, m: int) -> list[list[float]]:
        """The values of one period ago, from m cells before the last cell to m + 1 after it."""
        behind = [self.behind[n] for n in range(self.at - m, self.at + 1)]
        return [*behind, *(self.cell(n) for n in range(self.at + 1, self.at + m + 2))]

    def follow(self, place: int) -> int:
        """How far the rotor moved [2^-32 periods]; 0 where it stands, or starts anew, but after a leap."""
        x = self.counted(place)
        moved = (x - self.x) % WHOLE
        count = (x * self.cells // WHOLE - self.at) % self.cells
        if self.started and moved > WHOLE - WHOLE // self.cells:
            moved = self.passed = 0
        elif self.started and moved <= QUARTER and count <= 16 + 2 * self.passed:
            for n in range(self.at + max(1, count - self.q_half_width), self.at + count + 1):
                self.behind[n] = list(self.cell(n))
            self.x, self.at, self.passed = x, self.at + count, count
        else:  # a new way begins: what was passed is the map
            self.back ^= self.started and moved >= WHOLE - QUARTER - WHOLE // self.cells
            leaps = self.started and QUARTER < moved < WHOLE - QUARTER - WHOLE // self.cells
            self.x, self.passed = self.counted(place), count if moved <= QUARTER else 0
            self.at, moved = self.x * self.cells // WHOLE, WHOLE if leaps else 0
            reach = range(self.at - self.q_half_width, self.at + 1)
            self.behind = {n: list(self.cell(n)) for n in reach}
            self.half, self.started, self.follows, self.corrected = 0, True, False, None
        return moved

    def between(self, x: int, moved: int) -> list[tuple[int, float]]:
        """The cells on the last `moved` to x, each with its share of the way."""
        cell = WHOLE / self.cells
        first, last = (x - moved) * self.cells // WHOLE + 1, x * self.cells // WHOLE
        return [(n, 1 - (x - n * cell) / moved) for n in range(first, last + 1)]

    def correct(self, moved: int, correction: list[float]) -> None:
        """Adds to the cells that the rotor passed `lead` samples ago, had it always moved as it does now."""
        x = (self.x - moved * self.lead) % WHOLE
        if self.corrected is not None:
            start, before = self.corrected
            passed = (x - start) % WHOLE
            if passed == 0 or passed > WHOLE // 2:
                return
            way = self.between(x, passed)
            if passed <= QUARTER and len(way) <= 16 + 2 * self.passed:
                for n, share in way:
                    added = [b + share * (c - b) for b, c in zip(before, correction, strict=True)]
                    cell = self.cell(n)
                    cell[:] = self.clipped([v + a for v, a in zip(cell, added, strict=True)])
        self.corrected = (x, list(correction))

    def step(
        self, theta: float, speed: float, learn: bool, correction: list[float]
    ) -> tuple[list[float], bool]:
        learn = learn and all(map(math.isfinite, correction))
        if not is_angle(theta):
            self.started = self.follows = False
            self.corrected = None
            return self.repeat()
        moved = self.follow(self.place(theta))
        part = self.x * self.cells % WHOLE / WHOLE
        m = self.q_half_width
        if not (learn and self.half == m and moved <= WHOLE // self.fewest):
            self.half = min(self.half + 1, m)
            self.follows, self.corrected = False, None
            here, there = self.cell(self.at), self.cell(self.at + 1)
            values = [a + part * (b - a) for a, b in zip(here, there, strict=True)]
            self.value = self.clipped(values)
            return values, False
        values = self.recalled(mean_between(self.ago(m), part))
        if self.lead == 0:
            values = [v + c for v, c in zip(values, correction, strict=True)]
        stored = self.clipped(values)
        if self.follows and moved > 0:
            ends = list(zip(self.value, stored, strict=True))
            for n, share in self.between(self.x, moved):
                self.cell(n)[:] = self.clipped([a + share * (b - a) for a, b in ends])
        self.value, self.follows = stored, True
        if self.lead > 0 and moved > 0:
            self.correct(moved, correction)
        if self.centred:
            self.transfer = [lost * moved / WHOLE for lost in self.lost]
            first = len(self.gathered)
            self.gathered += [list(cell) for cell in self.map[first : first + max(1, self.passed)]]
            if len(self.gathered) == self.cells:
                self.take_mean([1.0] * self.cells)
                self.gathered = []
        return values, True


@dataclass(kw_only=True)
class DelayLine(Memory):
    """Samples in a row. None is added in a step in which goes_on() is false. By time, the period is that of
    the reference speed. Else it is P_t, from its differential equation or by inversion of the angle. Angles
    are kept as whole periods and the rest."""

    kind: str  # "time", "ode" or "inversion"
    ts: float
    k_pp: float = 10.0
    whole: list[int] = field(default_factory=list)
    rest: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)  # (sample, channel)
    p_t: float = 0.0
    then: int = 0  # the sample just after the place of one period ago
    tracking: bool = False
    now: tuple[int, float] = (0, 0.0)

    @property
    def fewest(self) -> int:
        return max(super().fewest, self.q_half_width + 1)

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

    def moves_to(self, then: int) -> int:
        """Move `self.then` towards a sample within the line, by at most MOVES; returns the whole distance."""
        oldest, newest = max(0, len(self.rest) - self.length), len(self.rest) - 1
        way = min(max(then, oldest), newest) - self.then
        self.then += min(max(way, -MOVES), MOVES)
        return abs(way)

    def find_angle(self) -> None:
        newest, count = len(self.rest), min(len(self.rest), self.length)
        self.tracking = self.tracking and self.then > newest - count  # both neighbours are still there
        if self.tracking and self.kind == "ode":
            self.p_t = self.ode(self.apart(self.now, newest - 1) / self.ts)
            age = math.floor(self.p_t / self.ts)
            self.tracking = self.moves_to(newest - age) <= MOVES and 1 <= age < count
        if not self.tracking or self.kind == "inversion":
            ages = range(1, count + 1)  # how far the angle rose grows with the age
            older = bisect_right(ages, 1.0, key=lambda age: self.apart(self.now, newest - age)) + 1
            self.tracking = self.moves_to(newest - older + 1) < MOVES and older <= count
            self.p_t = 0.0
            if self.tracking:
                near = [self.apart(self.now, newest - age) for age in (older - 1, older)]
                self.p_t = float(np.interp(1.0, near, (older - 1, older))) * self.ts

    def goes_on(self, theta: float, speed: float) -> bool:
        """Find the present period; returns whether the line goes on in this step."""
        if self.kind == "time":
            a_sample = abs(speed) * self.ts * self.ratio * self.parts / (2 * math.pi * self.turns)
            within = a_sample > 0 and a_sample * self.cells >= 1 and a_sample * self.fewest <= 1
            self.p_t = self.ts / a_sample if within else 0.0
            return within
        rest = self.place(theta) / WHOLE
        self.now = (0, rest)
        if self.rest:
            moved = rest - self.rest[-1]
            wraps = round(moved)
            self.now = (self.whole[-1] - wraps, rest)
            if moved - wraps <= 0:
                return False
        if speed > 0 and self.rest:
            self.find_angle()
        return speed > 0

    def gather(self, period: float) -> None:
        """Collect the samples of a period. The first and the last may count in part."""
        self.gathered.append(list(self.value))
        weights = [self.beyond or 1.0, *[1.0] * (len(self.gathered) - 1)]
        missing = period - sum(weights[:-1]) if len(weights) > 1 else period
        if missing < 1:
            weights[-1] = max(missing, 0.0)
            self.take_mean(weights)
            self.gathered, self.beyond = [list(self.value)], 1 - weights[-1]

    def ago(self, samples: int) -> list[float]:
        known = 1 <= samples <= min(len(self.rows), self.length)
        return self.rows[-samples] if known else [0.0] * len(self.limit)

    def step(
        self, theta: float, speed: float, learn: bool, correction: list[float]
    ) -> tuple[list[float], bool]:
        learn = learn and all(map(math.isfinite, correction))
        if not (is_angle(theta) and self.goes_on(theta, speed)):
            return self.repeat()
        by_time = self.kind == "time"
        age, m = math.floor(self.p_t / self.ts), self.q_half_width
        reads = by_time or (self.tracking and age > m and age + m < self.length)
        learn = learn and (
            (reads and age >= self.fewest) or (len(self.rows) < self.length and not self.tracking)
        )
        values = [0.0] * len(self.limit)
        self.transfer = list(values)
        if reads:
            part = self.p_t / self.ts - age
            reach = range(age - m, age + m + 2) if learn else (age, age + 1)
            values = mean_between([self.ago(n) for n in reach], part)
            values = self.recalled(values) if learn else values
        if learn and self.lead == 0:
            values = [v + c for v, c in zip(values, correction, strict=True)]
        self.value = self.clipped(values)
        self.rows.append(list(self.value))
        if learn and 0 < self.lead < len(self.rows):
            late = self.rows[-1 - self.lead]
            late[:] = self.clipped([v + c for v, c in zip(late, correction, strict=True)])
        if not by_time:
            self.whole.append(self.now[0])
            self.rest.append(self.now[1])
            self.then = max(self.then, len(self.rest) - self.length)
        if learn and self.centred and reads:
            self.transfer = [lost * self.ts / self.p_t for lost in self.lost]
            self.gather(self.p_t / self.ts)
        return values, learn
