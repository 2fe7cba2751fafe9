"""What each feature of motor, mechanics and sensors costs: time of a tick with it, and without it.

python benchmarks/features.py [--instructions]

Each number is the CPU time of the best of many short runs, all drives in turns, so that a busy machine counts
little. With --instructions, valgrind's callgrind counts instructions instead: this takes some minutes, and
the load of the machine makes no difference.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cogless import _simulator_f32
from cogless.run.drive_config import engine_config
from cogless.study import load

HERE = Path(__file__).parent
PIECE, ROUNDS = 1500, 150
COUNTED = (1000, 5000)  # ticks of two runs; the difference of their instructions is used
KINDS = ("averaged", "switched")
TABLE = """angle [deg],error [deg]
0,0.02
45,0.05
90,0.01
135,-0.03
180,-0.06
225,-0.02
270,0.01
315,0.03
"""
BODIES = {"ambient": "20 degC", "winding_capacity": "20 J/K", "magnet_capacity": "60 J/K"}
SHAFT = {"inertia": "1e-4 kg*m^2", "stiffness": "60 N*m/rad", "damping": "2e-4 N*m*s/rad"}
GEAR_ERROR = {"side": "input", "order": 2, "angle": "0.3 mrad"}
ENCODER = {"kind": "encoder", "lines": 2500}
TIMER = {"timer": "90 MHz"}
LOAD = {"torque": "0.2 N*m"}


def sensor(**keys: Any) -> dict[str, Any]:
    """The drive's encoder with some keys; they may replace its kind."""
    return {"drive.position_sensor": ENCODER | keys}


def shaft(**keys: Any) -> dict[str, Any]:
    """The mechanics' load side with some keys."""
    return {"mechanics.load_side": SHAFT | keys}


FEATURES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "torque ripple, 2 orders": {
        "motor.torque_ripple": [{"order": 7, "percent": 1}, {"order": 12, "percent": 1}],
    },
    "48 orders of cogging": {
        "motor.cogging": [{"order": n, "torque": "0.1 mN*m"} for n in range(3, 147, 3)],
    },
    "given temperatures": {"motor.temperature": {"winding": "80 degC"}},
    "temperatures that drift": {"motor.temperature": {"winding": "20 degC", "heating": BODIES}},
    "saturation of the q axis": {
        "motor.saturation": {
            "q": {"current": ["0 A", "1 A", "5 A"], "inductance": ["32 mH", "32 mH", "25 mH"]}
        },
    },
    "load over the angle, 2 orders": {
        "mechanics.load": {
            **LOAD,
            "harmonics": [{"order": n, "torque": "10 mN*m"} for n in (1, 2)],
        },
    },
    "load over the angle, a table": {
        "mechanics.load": {
            **LOAD,
            "angle_table": {
                "angle": [f"{n} deg" for n in (0, 90, 180, 270)],
                "torque": [f"{n} mN*m" for n in (0, 10, 0, -10)],
            },
        },
    },
    "load over time, a table": {
        "mechanics.load": {
            **LOAD,
            "time_table": {"time": ["0 s", "5 s"], "torque": ["0 N*m", "10 mN*m"]},
        },
    },
    "Stribeck friction": {
        "mechanics.breakaway_friction": "0.015 N*m",
        "mechanics.stribeck_speed": "10 rpm",
    },
    "friction over the angle": {"mechanics.friction_harmonics": [{"order": 1, "torque": "1 mN*m"}]},
    "two masses, a soft shaft": shaft(),
    "and backlash": shaft(backlash="0.1 deg"),
    "and a gear's error": shaft(gear_errors=[GEAR_ERROR]),
    "speed by T": sensor(speed_method="T", **TIMER),
    "speed by MT": sensor(speed_method="MT", **TIMER),
    "speed by an average": sensor(speed_method="average", window=30),
    "speed by an observer": sensor(speed_method="observer", observer_bandwidth="200 Hz"),
    "sensor's error, 2 orders": sensor(
        error=[{"order": n, "amplitude": "0.05 deg"} for n in (1, 2)], speed_method="M"
    ),
    "sensor's error, a table": sensor(error_table="error.csv", speed_method="M"),
    "sensor's latency": sensor(latency="100 us", speed_method="M"),
    "Hall sensors": {"drive.position_sensor": {"kind": "hall", **TIMER}},
    "noise of the currents": {"drive.current_sensors.noise": "5 mA"},
    "low-pass of the speed": {"drive.speed_filter": "500 Hz"},
    "sensor's own error learned": {
        "drive.encoder_table": {"orders": [1, 2], "omega_min": "30 rpm"},
    },
    "dead time compensated": {"drive.dead_time_compensation": {"band": "0.1 A"}},
    "the law over a bus": {
        "drive.bus": {"delay_measured": "1 ms", "delay_command": "1 ms", "jitter": "0.2 ms"}
    },
}


@dataclass
class Drive:
    """A drive that is timed. `best`: its shortest piece, s."""

    engine: Any
    best: float = float("inf")

    def piece(self, ticks: int = PIECE) -> None:
        """Run from the start, and keep the time if it is the shortest."""
        state, recorder = self.engine.start(), _simulator_f32.Recorder(self.engine, 100)
        before = time.process_time()
        self.engine.advance(state, recorder, ticks)
        self.best = min(self.best, time.process_time() - before)


def drive(name: str, kind: str) -> Drive:
    """The drive with a feature, under PI."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "study.toml"
        copy.write_text((HERE / "study.toml").read_text())
        (Path(folder) / "error.csv").write_text(TABLE)
        study = load(copy, {**FEATURES[name], "drive.inverter.kind": kind})
        return Drive(_simulator_f32.Drive(engine_config(study, "low-speed", "pi"), None))


def times() -> dict[str, list[float]]:
    """ns a tick of each drive, averaged and switched."""
    drives = {name: [drive(name, kind) for kind in KINDS] for name in FEATURES}
    for _ in range(ROUNDS):
        for both in drives.values():
            for each in both:
                each.piece()
    return {name: [1e9 * each.best / PIECE for each in both] for name, both in drives.items()}


def count(name: str, kind: str, ticks: int) -> int:
    """Instructions of a whole process that runs this drive for `ticks` ticks."""
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "callgrind"
        tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={written}"]
        ran = [*tool, sys.executable, __file__, "--one", name, kind, str(ticks)]
        subprocess.run(ran, check=True, capture_output=True, env={"PYTHONHASHSEED": "0"})
        line = next(line for line in written.read_text().splitlines() if line.startswith("summary:"))
        return int(line.split()[1])


def instructions() -> dict[str, list[float]]:
    """Instructions a tick of each drive, averaged and switched."""
    first, last = COUNTED
    return {
        name: [(count(name, kind, last) - count(name, kind, first)) / (last - first) for kind in KINDS]
        for name in FEATURES
    }


def main() -> None:
    match sys.argv[1:]:
        case ["--one", name, kind, ticks]:
            drive(name, kind).piece(int(ticks))
            return
        case ["--instructions"]:
            found, unit = instructions(), "instructions"
        case _:
            found, unit = times(), "ns"
    print(f"| {unit} a tick | averaged | more | switched | more |\n| --- | --- | --- | --- | --- |")
    base = found["as it is"]
    for name, both in found.items():
        cells = [f"{x:.0f} | {x - of:+.0f}" for x, of in zip(both, base, strict=True)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
