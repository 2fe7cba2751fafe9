"""PI speed control with P-type iterative learning: liu2018 Fig. 1 and (29)."""

import math
from dataclasses import dataclass

from .limits import is_angle
from .memory import AngleMemory, TimeMemory
from .pi import Pi


@dataclass
class PiIlc:
    pi: Pi
    gain: float
    memory: AngleMemory | TimeMemory
    learned: float = 0.0
    learning: bool = False

    def step(self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True) -> float:
        e = omega_ref - omega_m
        u_k = self.memory.recall(theta_m, omega_ref)
        plausible = math.isfinite(e) and is_angle(theta_m)
        self.learning = learn and plausible and u_k.known and not self.pi.saturated
        before = u_k.filtered if self.learning else u_k.held
        self.learned = self.memory.update(before, self.gain * e, self.learning)  # (29)
        return self.pi.step(e, self.learned)
