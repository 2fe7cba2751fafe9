"""How good learning is, from all the samples of a window at its end."""

import math
from dataclasses import dataclass, field

import numpy as np

ERROR_MAX = 1e14
TREND = 0.125


@dataclass
class Quality:
    span: float
    longest: float
    outlier: float
    floor: float
    ts: float
    errors: list[float] = field(default_factory=list)
    count: int = 0
    turned: float = 0.0
    learned: bool = False
    usual: float = math.inf
    ripples: list[float] = field(default_factory=list)  # standard deviations
    before: float | None = None
    trend: float = 0.0

    def step(self, error: float, omega: float, learning: bool) -> bool:
        counts = abs(error) <= ERROR_MAX
        outlier = not counts or abs(error) > self.usual
        self.count += 1
        self.turned += omega * self.ts if math.isfinite(omega) else 0.0
        if counts:
            self.errors.append(error)
            self.learned |= learning and not outlier
        if abs(self.turned) >= self.span or self.count >= round(self.longest / self.ts):
            self._end()
        return outlier

    def _end(self) -> None:
        if self.errors:
            self._take(float(np.std(self.errors)), float(np.sqrt(np.mean(np.square(self.errors)))))
        self.errors, self.count, self.turned, self.learned = [], 0, 0.0, False

    def _take(self, ripple: float, rms: float) -> None:
        if self.ripples:
            largest = max(ripple, self.ripples[-1]) ** 2
            change = (ripple**2 - self.ripples[-1] ** 2) / largest if largest else None
            self.trend += TREND * (change - self.trend) if change is not None else 0.0
        if self.learned and self.before is None:
            self.before = self.ripples[-1] if self.ripples else ripple
        self.ripples.append(ripple)
        if self.outlier:
            self.usual = max(self.outlier * rms, self.floor)

    @property
    def residual(self) -> float:
        return self.ripples[-1] if self.ripples else 0.0

    @property
    def progress(self) -> float:
        return 1 - self.residual / self.before if self.before else 0.0
