"""What SimpleFOC's monitor prints, and the file that describes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

NAMES = ["target", "Iq", "velocity", "angle"]
MONITOR_TOML = """
monitor = ["target", "Iq", "velocity", "angle"]
row_period = "2 ms"
[motor]
pole_pairs = 7
R_s = "0.8 ohm"
L_d = "0.45 mH"
L_q = "0.45 mH"
K_t = "0.0306 N*m/A"
[drive]
rates = { current_loop = "1 kHz", speed_loop = "1 kHz" }
current_loop = { kind = "ideal", current_limit = "6 A" }
[PID_velocity]
P = 0.06
I = 0.9
output_ramp = 300
[LPF_velocity]
Tf = 3e-3
"""


def monitor(made: dict[str, np.ndarray], path: Path, every: int = 10, spoilt: tuple[int, ...] = ()) -> Path:
    """Lines of the monitor, four decimals between tabs; some of them spoilt by another print."""
    lines = []
    for number, k in enumerate(range(0, len(made["t"]), every)):
        lines.append("\t".join(f"{made[name][k]:.4f}" for name in NAMES))
        if number in spoilt:
            lines[-1] = lines[-1][:9] + "hello"
    path.write_text("\r\n".join(lines) + "\r\n")
    return path
