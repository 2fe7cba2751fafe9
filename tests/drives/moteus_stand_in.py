"""moteus as the notes on its source say: position mode with the cogging table, and the files that it writes.

Written apart from cogless.drives, in scalar arithmetic: what the tests compare with.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from drives.drive_bench import RATE, TURN, Plant, Tracker, play, profile

CPR = 16384
GAINS = 0.05, 2.2e-3, 0.2  # of the position's PID: N m over rad, over rad/s, over rad s, at the rotor
DUMP = """\
uuid.uuid.0 18
id.id 1
motor.poles 14
motor.phase_invert 0
motor.resistance_ohm 0.8
motor.inductance_d_H 0.00045
motor.inductance_q_H 0.00045
motor.Kv {kv:.9g}
motor.offset.0 1.2
motor.cogging_dq_scale {scale:.9g}
{comps}servo.pwm_rate_hz 30000
servo.max_current_A 8
servo.pid_dq.kp 0.85
servo.pid_dq.ki 1508
servo.pid_position.kp {kp:.9g}
servo.pid_position.kd {kd:.9g}
servo.pid_position.ki {ki:.9g}
servo.pid_position.ilimit 10
servopos.position_min nan
motor_position.sources.0.cpr 16384
motor_position.sources.0.sign 1
motor_position.sources.0.reference 0
motor_position.commutation_source 0
motor_position.output.source 0
motor_position.output.offset 0.21
motor_position.output.sign {sign}
motor_position.rotor_to_output_ratio {ratio:.9g}
"""


@dataclass
class Moteus:
    """A drive with its motor. The encoder counts with the rotor, from `encoder_zero` on."""

    plant: Plant = field(default_factory=Plant)
    sign: int = 1  # output.sign
    ratio: float = 1.0
    encoder_zero: float = 1.9  # rad: the encoder's angle where the rotor's is 0
    offset: float = 0.21  # turns of the output, in the reported position
    scale: float = 0.0
    comp: list[int] = field(default_factory=lambda: [0] * 1024)

    def restore(self, text: str) -> None:
        """Set what the lines of a configuration file say, as `--restore-config` does."""
        for line in text.splitlines():
            line = line.split("#")[0].strip()
            if not line:
                continue
            name, value = line.split()
            if name == "motor.cogging_dq_scale":
                self.scale = float(np.float32(value))
            else:
                stem, _, number = name.rpartition(".")
                assert stem == "motor.cogging_dq_comp" and 0 <= int(number) < 1024
                assert -128 <= int(value) <= 127
                self.comp[int(number)] = int(value)

    def table(self, encoder: float) -> float:
        """The current added in position mode, A: entry i at i/1024 of the encoder's turn, linear."""
        fraction = (encoder / TURN) % 1.0
        place = fraction * 1024
        low = int(place)
        share = place - low
        low %= 1024
        return self.scale * (self.comp[low] * (1 - share) + self.comp[(low + 1) % 1024] * share)

    def run(self, points: list[tuple[float, float]]) -> dict[str, np.ndarray]:
        """Play speeds of the output's direction at the rotor, rad/s over s."""
        reference = profile(points)
        tracker = Tracker(CPR, 400)
        kp, kd, ki = GAINS
        rows: list[tuple[float, float, float, float]] = []
        integral, start = 0.0, None

        def law(t: float, phi: float, omega: float) -> float:
            nonlocal integral, start
            encoder, speed = tracker.step(phi + self.encoder_zero, omega)
            angle, velocity = self.sign * encoder, self.sign * speed
            start = angle if start is None else start
            wanted, wanted_speed = reference(t)
            error = start + wanted - angle
            integral += ki / RATE * error
            torque = kp * error + kd * (wanted_speed - velocity) + integral
            current = torque / self.plant.K_t + self.table(encoder)
            rows.append((encoder, angle, velocity, self.sign * current))
            return self.sign * current

        made = play(self.plant, law, points[-1][0], self.sign * points[0][1])
        encoder, angle, velocity, _ = np.array(rows).T
        return {
            **made,
            "filtered_value": np.mod(encoder / TURN, 1.0) * CPR,
            "position": angle / TURN * self.ratio + self.offset,
            "velocity": velocity / TURN * self.ratio,
            "q_A": self.sign * made["i"] + 2e-3 * np.random.default_rng(3).standard_normal(len(encoder)),
        }

    def dump(self, path: Path, **changes: str) -> Path:
        comps = "".join(f"motor.cogging_dq_comp.{n} {value}\n" for n, value in enumerate(self.comp))
        kv = 1.5 / math.sqrt(3) * 60 / TURN / self.plant.K_t
        gains = {
            name: TURN * gain / self.ratio**2 for name, gain in zip(("kp", "kd", "ki"), GAINS, strict=True)
        }
        text = DUMP.format(kv=kv, scale=self.scale, comps=comps, sign=self.sign, ratio=self.ratio, **gains)
        for key, value in changes.items():
            name = key.replace("__", ".")
            text = "".join(line for line in text.splitlines(True) if not line.startswith(f"{name} "))
            text += f"{name} {value}\n" if value else ""
        path.write_text(text)
        return path


def arrivals(t: np.ndarray, seed: int) -> np.ndarray:
    """Times at which a PC stamps rows: late by a millisecond or more, some together, never out of order."""
    random = np.random.default_rng(seed)
    late = 1.7e9 + t + random.exponential(0.8e-3, len(t)) + 8e-3 * (random.random(len(t)) < 0.02)
    return np.maximum.accumulate(late)


def channel(run: dict[str, np.ndarray], every: int, names: dict[str, str]) -> dict[str, np.ndarray]:
    return {heading: run[name][::every] for heading, name in names.items()}


def tview_csv(run: dict[str, np.ndarray], folder: Path, name: str, every: int = 10) -> list[Path]:
    """The two files that tview writes for the channels, headings in its order."""
    stats = channel(run, every, {"position": "position", "q_A": "q_A", "velocity": "velocity"})
    stats |= {"bus_V": np.full(len(stats["q_A"]), 24.0), "d_A": 0 * stats["q_A"]}
    place = channel(run, 5 * every, {"position": "position", "sources.0.filtered_value": "filtered_value"})
    paths = []
    for kind, columns, step, seed in (
        ("servo_stats", stats, every, 1),
        ("motor_position", place, 5 * every, 2),
    ):
        names = ["timestamp", *sorted(columns)]
        columns["timestamp"] = arrivals(run["t"][::step], seed)
        path = folder / f"{name}_1_{kind}.csv"
        rows = zip(*(columns[heading] for heading in names), strict=True)
        path.write_text(
            ",".join(names) + "\n" + "".join(",".join(repr(float(v)) for v in row) + "\n" for row in rows)
        )
        text = path.read_text()
        assert text.count("\n") == len(columns["timestamp"]) + 1
        paths.append(path)
    return paths


def tview_jsonl(run: dict[str, np.ndarray], path: Path, every: int = 10) -> Path:
    """One record a line, channels interleaved in the order of arrival."""
    stamps = arrivals(run["t"][::every], 1), arrivals(run["t"][:: 5 * every], 2)
    records = []
    for k, stamp in enumerate(stamps[0]):
        row = k * every
        data = {name: float(run[name][row]) for name in ("position", "velocity", "q_A")}
        records.append((stamp, "servo_stats", {**data, "d_A": 0.0, "bus_V": 24.0, "mode": 10}))
    for k, stamp in enumerate(stamps[1]):
        row = 5 * k * every
        source = {"filtered_value": float(run["filtered_value"][row]), "raw": 1}
        records.append(
            (stamp, "motor_position", {"sources": [source], "position": float(run["position"][row])})
        )
    lines = [
        json.dumps({"controller": "1", "timestamp": stamp, "channel": name, "data": data})
        for stamp, name, data in sorted(records, key=lambda record: record[0])
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def python_csv(run: dict[str, np.ndarray], path: Path, every: int = 10, encoder: bool = True) -> Path:
    """The registers that the library's example asks for; 0 where one was not."""
    names = ["time", "MODE", "POSITION", "VELOCITY", "TORQUE", "Q_CURRENT", "D_CURRENT", "VOLTAGE"]
    names += ["ENCODER_0_POSITION"]
    lines = [",".join(names)]
    for k in range(0, len(run["t"]), every):
        index = run["filtered_value"][k] / CPR if encoder else 0
        row = [run["t"][k], 10, run["position"][k], run["velocity"][k], 0, run["q_A"][k], 0, 24.0, index]
        lines.append(",".join(f"{value:.9g}" for value in row))
    path.write_text("\n".join(lines) + "\n")
    return path
