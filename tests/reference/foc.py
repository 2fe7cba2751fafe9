"""Field-oriented current control on complex dq numbers."""

import math
from dataclasses import dataclass

import numpy as np

from .limits import clip, finite_or_zero, is_angle
from .modulation import modulate
from .transform import clarke, park, park_inverse


@dataclass
class FocOutput:
    duty: np.ndarray
    i_dq: complex = 0j
    u_dq: complex = 0j
    i_ref: complex = 0j  # that is followed
    saturated: bool = False
    fault: bool = False


def shortened(x: complex, length: float) -> complex:
    return x if abs(x) <= length else x / abs(x) * length


@dataclass
class Foc:
    kp_d: float
    ki_d: float
    kp_q: float
    ki_q: float
    ts: float
    current_limit: float
    advance: float
    decoupling: bool
    L_d: float
    L_q: float
    psi_f: float
    phases: int = 3
    integral: complex = 0j

    def step(
        self, i_abc: np.ndarray, theta_e: float, omega_e: float, u_dc: float, i_ref: complex
    ) -> FocOutput:
        acting = theta_e + self.advance * self.ts * omega_e
        measured = [*i_abc[: self.phases], theta_e, omega_e, u_dc]
        if not (all(map(math.isfinite, measured)) and is_angle(theta_e) and is_angle(acting) and u_dc > 0):
            return FocOutput(np.full(3, 0.5), fault=True)
        i_stator = clarke(i_abc) if self.phases == 3 else complex(*i_abc[:2])
        i = park(i_stator, theta_e)
        asked = complex(finite_or_zero(i_ref.real), finite_or_zero(i_ref.imag))
        followed = shortened(asked, self.current_limit)
        error = followed - i
        wanted = complex(self.kp_d * error.real, self.kp_q * error.imag) + self.integral
        if self.decoupling:  # the speed voltages of liu2018 (1): j omega_e lambda, lambda = L i + psi_f
            wanted += 1j * omega_e * complex(self.L_d * i.real + self.psi_f, self.L_q * i.imag)
        u_max = u_dc / math.sqrt(3) if self.phases == 3 else u_dc
        u = shortened(wanted, u_max)

        # back calculation: the integral sees the error that the realised voltage would have needed
        missing = u - wanted
        seen_d = error.real + (missing.real / self.kp_d if self.kp_d > 0 else 0.0)
        seen_q = error.imag + (missing.imag / self.kp_q if self.kp_q > 0 else 0.0)
        self.integral = complex(
            clip(self.integral.real + self.ki_d * self.ts * seen_d, u_max),
            clip(self.integral.imag + self.ki_q * self.ts * seen_q, u_max),
        )
        u_stator = park_inverse(u, acting)
        if self.phases == 3:
            duty = modulate(u_stator, u_dc)
        else:  # two H-bridges: mean voltage u_dc (2 duty - 1)
            duty = np.array([(1 + x / u_dc) / 2 for x in (u_stator.real, u_stator.imag, 0.0)]).clip(0, 1)
        return FocOutput(duty, i, u, followed, abs(wanted) > u_max or abs(asked) > self.current_limit)
