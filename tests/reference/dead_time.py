"""Dead-time compensation: each phase gets back what its leg loses, by the sign of its delayed reference."""

import dataclasses

import numpy as np

from reference.transform import clarke_inverse, park_inverse


@dataclasses.dataclass
class DeadTime:
    time: float
    drop: float
    band: float
    lag: float
    advance: float
    phases: int
    ts: float
    current: complex = 0j  # the delayed reference, A

    def step(
        self, theta_e: float, omega_e: float, u_dc: float, i_ref: complex, duty: np.ndarray
    ) -> np.ndarray:
        self.current += self.ts / (self.lag + self.ts) * (i_ref - self.current)
        stationary = park_inverse(self.current, theta_e + self.advance * self.ts * omega_e)
        i = (
            np.array([stationary.real, stationary.imag, 0.0])
            if self.phases == 2
            else clarke_inverse(stationary)
        )
        loss = min(self.time / self.ts + self.drop / u_dc, 1.0)
        corrected = np.clip(duty + loss * np.clip(i / self.band, -1, 1), 0, 1)
        return np.where((duty > 0) & (duty < 1), corrected, duty)
