"""PI speed control with P-type iterative learning: liu2018 Fig. 1 and (29)."""

from dataclasses import dataclass

from .limits import clip
from .memory import AngleMemory, DelayLine
from .pi import Pi


@dataclass
class PiIlc:
    pi: Pi
    gain: float
    memory: AngleMemory | DelayLine
    learned: float = 0.0
    learning: bool = False

    def __post_init__(self) -> None:
        self.memory.centred = int(self.pi.ki > 0)

    def step(self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True) -> float:
        e = omega_ref - omega_m
        may = learn and self.gain > 0 and not self.pi.saturated
        (u,), self.learning = self.memory.step(theta_m, omega_ref, may, [self.gain * e])  # (29)
        self.learned = clip(u, self.memory.limit[0])
        if self.learning:
            self.pi.integral = clip(self.pi.integral + self.memory.transfer[0], self.pi.limit)
        return self.pi.step(e, self.learned)

    def torque(self, current: float, omega_ref: float, omega_m: float, theta_m: float) -> float:
        (u,), self.learning = self.memory.step(theta_m, omega_ref, False, [0.0])
        self.learned = clip(u, self.memory.limit[0])
        return self.pi.torque(current, self.learned)
