"""How good learning is, from all the samples of a window at its end."""

import math
from dataclasses import dataclass, field

import numpy as np

from .limits import clip

ERROR_MAX = 1e14
TREND, MOST = 0.25, 0.16
IN_A_ROW = 4  # outliers to one side


@dataclass
class Quality:
    span: float
    longest: float
    outlier: float
    floor: float
    ts: float
    errors: list[float] = field(default_factory=list)
    outliers: list[bool] = field(default_factory=list)  # whether each of these errors is an outlier
    signs: str = ""  # signs of the outliers, one character for each sample
    refused: float = math.inf
    last_peak: float = 0.0
    wait: int = 0
    waiting: int = 0  # samples
    count: int = 0
    turned: float = 0.0
    learned: bool = False
    usual: float = math.inf
    ripples: list[float] = field(default_factory=list)  # standard deviations
    before: float = 0.0
    began: bool = False  # learning
    centre: float | None = None  # mean of the last window; at first the first error
    trend: float = 0.0

    def step(self, error: float, omega: float, learning: bool) -> bool:
        counts, outlier = abs(error) <= ERROR_MAX, abs(error) > self.usual
        refused = not abs(error) <= self.refused
        self.count += 1
        self.turned += omega * self.ts if math.isfinite(omega) else 0.0
        if counts:
            self.centre = error if self.centre is None else self.centre
            self.errors.append(error)
            self.outliers.append(outlier)
        self.signs += "-+"[error > 0] if outlier and counts else " "
        in_a_row = self.signs.endswith(("+" * IN_A_ROW, "-" * IN_A_ROW))
        self.waiting = self.wait if counts and refused and in_a_row else max(self.waiting - 1, 0)
        taught = counts and not refused and not self.waiting
        self.learned |= learning and taught
        if abs(self.turned) >= self.span or self.count >= round(self.longest / self.ts):
            self._end()
        return not taught

    def _end(self) -> None:
        if self.errors:
            self._take(float(np.std(self.errors)), abs(float(np.mean(self.errors)) - (self.centre or 0.0)))
            self.centre = float(np.mean(self.errors))
            if self.outlier:
                self._judge(np.array(self.errors), np.array(self.outliers))
        self.signs = ""
        self.errors, self.outliers, self.count, self.turned, self.learned = [], [], 0, 0.0, False

    def _take(self, ripple: float, drift: float) -> None:
        if self.ripples:
            largest = max(ripple, self.ripples[-1]) ** 2
            change = (ripple**2 - self.ripples[-1] ** 2) / largest if largest else None
            self.trend += TREND * (clip(change, MOST) - self.trend) if change is not None else 0.0
        if abs(self.turned) >= self.span / 16 and drift <= ripple and not self.began:
            self.before = self.before if self.learned and self.before else ripple
            self.began = self.learned
        self.ripples.append(ripple)

    def _judge(self, errors: np.ndarray, outliers: np.ndarray) -> None:
        clipped = np.where(outliers, self.usual, errors)
        self.usual = max(self.outlier * float(np.sqrt(np.mean(clipped**2))), self.floor) or math.inf
        unusual = "+" * IN_A_ROW in self.signs or "-" * IN_A_ROW in self.signs
        peak = float(np.max(np.abs(errors[outliers]))) if unusual else 0.0
        self.refused = max(self.usual, 2 * min(peak, self.last_peak))
        self.last_peak = peak
        self.wait = len(errors) // 16

    @property
    def residual(self) -> float:
        return self.ripples[-1] if self.ripples else 0.0

    @property
    def progress(self) -> float:
        return 1 - self.residual / self.before if self.before and self.began else 0.0
