"""What each feature of the motor costs: ns a tick beside the same drive without it (CPU time, best of many).

python benchmarks/motor.py
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from cogless import _simulator_f32
from cogless.run.drive_config import engine_config
from cogless.study import load

STUDY = Path(__file__).with_name("study.toml")
TICKS, ROUNDS = 3000, 60
BODIES = {"ambient": "20 degC", "winding_capacity": "20 J/K", "magnet_capacity": "60 J/K"}
FEATURES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "torque ripple, 2 orders": {
        "motor.torque_ripple": [{"order": 7, "percent": 1}, {"order": 12, "percent": 1}],
    },
    "given temperatures": {"motor.temperature": {"winding": "80 degC"}},
    "temperatures that drift": {"motor.temperature": {"winding": "20 degC", "heating": BODIES}},
    "saturation of the q axis": {
        "motor.saturation": {
            "q": {"current": ["0 A", "1 A", "5 A"], "inductance": ["32 mH", "32 mH", "25 mH"]}
        },
    },
    "48 orders of cogging": {
        "motor.cogging": [{"order": n, "torque": "0.1 mN*m"} for n in range(3, 147, 3)],
    },
}


def ns_per_tick(changes: dict[str, Any], kind: str) -> float:
    """The best time of a tick."""
    study = load(STUDY, {**changes, "drive.inverter.kind": kind})
    scenario = next(iter(study.scenario))
    config = engine_config(study, scenario, study.controllers_in(scenario)[0])
    drive = _simulator_f32.Drive(config, None)
    best = float("inf")
    for _ in range(ROUNDS):
        state, recorder = drive.start(), _simulator_f32.Recorder(drive, 100)
        before = time.process_time()
        drive.advance(state, recorder, TICKS)
        best = min(best, time.process_time() - before)
    return 1e9 * best / TICKS


def main() -> None:
    for name, changes in FEATURES.items():
        times = ", ".join(f"{kind} {ns_per_tick(changes, kind):.0f} ns" for kind in ("averaged", "switched"))
        print(f"{name:26s} {times}")


if __name__ == "__main__":
    main()
