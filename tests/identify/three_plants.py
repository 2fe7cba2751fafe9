"""Three motors in a few lines of NumPy, apart from the project: logs whose every unit is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TURN = 2 * np.pi
STEP, EVERY = 1e-4, 10  # s, integration step; number of them between two rows
COUNTS = 16_384
SPEEDS = (0.0, 1.0, -1.0, 0.6, -0.25, 0.25, 0.0)  # shares of the fastest speed, reached in turn by ramps
RAMP, STAY = 0.5, 1.2  # s, duration of a ramp and of a constant speed


@dataclass(frozen=True)
class Plant:
    """A motor with two orders of cogging, in SI units. A log's `u_q` is the voltage of its current loop."""

    pole_pairs: int
    K_t: float
    R_s: float
    J: float
    b: float
    c: float
    fastest: float
    limit: float
    cogging: tuple[tuple[int, float, float], ...]

    def log(self, seed: int = 0, table: float = 0.0) -> dict[str, np.ndarray]:
        """A log at 1 kHz under a PI. `table`: share of the cogging that a table's current cancels."""
        chance = np.random.default_rng(seed)
        kp = TURN * 8 * self.J / self.K_t
        times = np.cumsum([0.0, *[RAMP, STAY] * (len(SPEEDS) - 1)])
        speeds = self.fastest * np.array([SPEEDS[0], *np.repeat(SPEEDS[1:], 2)])
        theta, omega, integral, current, rows = 0.3, 0.0, 0.0, 0.0, []
        counted = round(theta / TURN * COUNTS)
        wanted = 0.0
        slow = 0.0
        for k in range(int(times[-1] / STEP)):
            cogging = sum(size * np.sin(n * theta + phase) for n, size, phase in self.cogging)
            if k % EVERY == 0:
                before, counted = counted, int(theta / TURN * COUNTS)
                seen = (counted - before) / COUNTS * TURN / (STEP * EVERY)
                slow += 0.3 * (seen - slow)
                error = np.interp(k * STEP, times, speeds) - slow
                integral += kp * TURN * 2 * error * STEP * EVERY
                wanted = np.clip(kp * error + integral, -self.limit, self.limit) - table * cogging / self.K_t
                noisy = current + 2e-3 * chance.standard_normal()
                e_k = self.K_t / 1.5 * omega
                rows.append(
                    (k * STEP, counted / COUNTS * TURN, slow, noisy, wanted, self.R_s * current + e_k)
                )
            current += (wanted - current) * TURN * 300 * STEP
            torque = self.K_t * current + cogging - self.b * omega - self.c * np.tanh(omega / 0.02)
            omega += STEP * torque / self.J
            theta += STEP * omega
        return dict(zip(("t", "theta", "omega", "i_q", "i_q_ref", "u_q"), np.array(rows).T, strict=True))

    def columns(self) -> dict:
        """Tables of the file of columns: what the motor's user knows."""
        return {
            "columns": {name: name for name in ("t", "theta", "omega", "i_q", "i_q_ref", "u_q")},
            "motor": {
                "pole_pairs": self.pole_pairs,
                "R_s": f"{self.R_s} ohm",
                "L_d": "1 uH",
                "L_q": "1 uH",
                "K_t": f"{self.K_t} N*m/A",
            },
            "drive": {
                "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
                "current_loop": {"bandwidth": "300 Hz", "current_limit": f"{self.limit} A"},
                "inverter": {"bus_voltage": "48 V"},
                "position_sensor": {"kind": "encoder", "lines": COUNTS // 4, "speed_method": "M"},
            },
        }


PLANTS = {
    "gimbal": Plant(7, 0.08, 2.0, 6e-5, 1e-4, 3e-3, 25.0, 3.0, ((12, 2e-3, 0.4), (42, 1e-3, -1.0))),
    "servo": Plant(4, 0.3, 1.0, 2e-4, 5e-4, 1.5e-2, 60.0, 6.0, ((24, 1e-2, 1.2), (12, 4e-3, 0.2))),
    "hub": Plant(15, 0.6, 0.4, 6e-3, 4e-3, 0.12, 12.0, 12.0, ((30, 4e-2, -0.7), (90, 1.5e-2, 2.0))),
}
