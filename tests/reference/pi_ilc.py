"""PI speed control with P-type iterative learning: liu2018 Fig. 1 and (29)."""

import math
from dataclasses import dataclass

from .limits import clip, is_angle
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
        if self.learning:
            self.learned = clip(u_k.filtered + self.gain * e, self.memory.limit)  # (29)
        else:
            self.learned = u_k.held
        self.memory.update(self.learned, self.learning)
        return self.pi.step(e, self.learned)
