"""Configuration and captures of ODrive's firmware 0.5."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from drives.drive_bench import Plant

PLANT = Plant()
OLD = {
    "motor": {
        "config": {
            "pole_pairs": 7,
            "torque_constant": PLANT.K_t,
            "phase_resistance": 0.8,
            "phase_inductance": 0.00045,
            "current_lim": 8.0,
            "current_control_bandwidth": 1000.0,
        }
    },
    "encoder": {"config": {"cpr": 8192}},
    "controller": {"config": {"anticogging": {"pre_calibrated": False, "anticogging_enabled": True}}},
}
OLD_PATHS = ("encoder.pos_estimate", "encoder.vel_estimate", "motor.current_control.Iq_measured")


def old_csv(made: dict[str, np.ndarray], path: Path) -> Path:
    """BulkCapture's array with headings: some 500 rows a second, at the times when USB answered."""
    steps = np.random.default_rng(2).integers(8, 13, len(made["t"]) // 10)
    rows = np.cumsum(steps)
    rows = rows[rows < len(made["t"])]
    lines = [",".join(["t", *(f"axis0.{name}" for name in OLD_PATHS), "vbus_voltage"])]
    for k in rows:
        values = (made["t"][k], made["position"][k], made["velocity"][k], made["Iq"][k], 24.0)
        lines.append(",".join(f"{value:.9g}" for value in values))
    path.write_text("\n".join(lines) + "\n")
    return path
