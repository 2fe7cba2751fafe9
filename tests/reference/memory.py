"""What a learning law remembers: all that it ever stored, so that 'one period ago' is literal."""

import math
from dataclasses import dataclass, field
from itertools import pairwise

from .limits import clip, finite_or_zero, is_angle


@dataclass
class Recalled:
    filtered: float = 0.0  # what a law learns on from: Q filter and forgetting
    held: float = 0.0  # what it repeats while frozen
    known: bool = False


def passed_cells(start: float, moved: float) -> list[tuple[int, float]]:
    """The cells on the way from `start`, each with its share of the way."""
    end = start + moved
    forward = range(math.floor(start) + 1, math.floor(end) + 1)
    backward = range(math.ceil(start) - 1, math.ceil(end) - 1, -1)
    return [(n, (n - start) / moved) for n in (forward if moved > 0 else backward)]


@dataclass
class AngleMemory:
    """A map over the period whose cells are written where the rotor passes them.

    `record` is every value ever written, by cell, each with the number of the pass and its place in that
    pass. A pass is an unbroken row of neighbouring cells in one direction. The cells of the present pass on
    which the Q filter's window looks back count as not yet written: 'one period ago' is the map before the
    rotor came by.
    """

    cells: int
    periods_per_rev: int
    q_half_width: int
    forgetting: float
    limit: float
    lead: int = 0
    record: dict[int, list[tuple[int, int, float]]] = field(default_factory=dict)
    passes: int = 0
    pass_length: int = 0
    last: tuple[int, int] | None = None  # unwrapped cell and direction of the last one written
    heading: int = 0  # of the last cell written; stays while nothing is learned
    stored: tuple[float, float] | None = None  # unwrapped position [cells] and value of the last update
    asked: float = 0.0
    corrected: tuple[float, float] | None = None  # position and value of the last correction, `lead` behind

    def position(self, theta_m: float) -> float:
        return (theta_m / (2 * math.pi) * self.periods_per_rev) % 1.0 * self.cells

    def now(self, n: int) -> float:
        """What the map holds at cell n."""
        return self.record.get(n % self.cells, [(0, 0, 0.0)])[-1][2]

    def one_period_ago(self, n: int) -> float:
        here = math.floor(self.asked)
        ahead = n > here if self.last is None or self.last[1] > 0 else n <= here
        if ahead:
            return self.now(n)
        window = self.pass_length - (self.q_half_width + 1)
        for number, place, value in reversed(self.record.get(n % self.cells, [])):
            if number != self.passes or place < window:
                return value
        return 0.0

    def recall(self, theta_m: float, omega_ref: float) -> Recalled:
        if not is_angle(theta_m):
            self.stored = None
            return Recalled()
        self.asked = self.position(theta_m)
        here, q = math.floor(self.asked), self.q_half_width
        share = self.asked - here
        ends = [self.one_period_ago(n) for n in range(here - q, here + q + 2)]
        lines = [(1 - share) * a + share * b for a, b in pairwise(ends)]  # at asked - q to asked + q
        return Recalled(self.forgetting * math.fsum(lines) / len(lines), lines[q], True)

    def write(self, n: int, direction: int, value: float) -> None:
        if self.last is None or self.last[1] != direction or (self.last[0] + direction - n) % self.cells != 0:
            self.passes, self.pass_length = self.passes + 1, 0
        self.record.setdefault(n % self.cells, []).append((self.passes, self.pass_length, value))
        self.pass_length += 1
        self.last, self.heading = (n, direction), direction

    def correct(self, moved: float, correction: float) -> None:
        """Adds to the cells that the rotor passed `lead` samples ago, had it always moved as it does now."""
        if abs(self.lead * moved) > self.cells / 4:
            self.corrected = None
            return
        place = (self.asked - self.lead * moved) % self.cells
        if self.corrected is not None:
            start, before = self.corrected
            passed = (place - start + self.cells / 2) % self.cells - self.cells / 2
            if passed * moved <= 0:
                return
            if abs(passed) <= self.cells / 4:
                for n, share in passed_cells(start, passed):
                    change = clip((1 - share) * before + share * correction, self.limit)
                    rows = self.record.setdefault(n % self.cells, [(-1, 0, 0.0)])
                    rows[-1] = (*rows[-1][:2], clip(rows[-1][2] + change, self.limit))
        self.corrected = (place, correction)

    def update(self, value: float, correction: float = 0.0, learn: bool = True) -> float:
        change = correction if learn and not math.isnan(correction) else 0.0
        value = clip(finite_or_zero(value if self.lead else value + change), self.limit)
        if not learn:
            self.stored = self.corrected = None
            self.passes, self.pass_length, self.last = self.passes + 1, 0, None
            return value
        followed = False
        if self.stored is not None:
            start, before = self.stored
            half = self.cells / 2
            moved = (self.asked - start + half) % self.cells - half  # the shorter way round
            followed = abs(moved) <= self.cells / 4
            if followed and moved != 0:
                turned_back = self.heading * moved < 0
                wrote = False
                for n, share in passed_cells(start, moved):
                    self.write(n, 1 if moved > 0 else -1, (1 - share) * before + share * value)
                    wrote = True
                if turned_back and wrote:
                    self.corrected = None
                if self.lead:
                    self.correct(moved, change)
        if not followed:
            self.corrected = None
        self.stored = (self.asked, value)
        return value


@dataclass
class TimeMemory:
    """Every value ever stored, in a row; one period of the reference speed ago lies between two of them."""

    cells: int
    periods_per_rev: int
    q_half_width: int
    forgetting: float
    limit: float
    ts: float
    lead: int = 0
    values: list[float] = field(default_factory=list)

    def ago(self, samples: float) -> float:
        n = math.floor(samples)
        at = [self.values[-k] if 1 <= k <= len(self.values) else 0.0 for k in (n, n + 1)]
        return at[0] + (samples - n) * (at[1] - at[0])

    def recall(self, theta_m: float, omega_ref: float) -> Recalled:
        if not math.isfinite(omega_ref) or omega_ref == 0:
            return Recalled()
        period = 2 * math.pi / (abs(omega_ref) * self.periods_per_rev * self.ts)
        if not self.q_half_width + 1 <= period <= self.cells:
            return Recalled()
        reach = range(-self.q_half_width, self.q_half_width + 1)
        mean = math.fsum(self.ago(period + k) for k in reach) / len(reach)
        return Recalled(self.forgetting * mean, self.ago(period), True)

    def update(self, value: float, correction: float = 0.0, learn: bool = True) -> float:
        change = correction if learn and not math.isnan(correction) else 0.0
        acting = clip(finite_or_zero(value if self.lead else value + change), self.limit)
        self.values.append(acting)
        if 0 < self.lead < len(self.values):
            self.values[-1 - self.lead] = clip(self.values[-1 - self.lead] + change, self.limit)
        return acting
