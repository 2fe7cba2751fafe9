"""Logs and configurations of drives whose motor turns under their firmware's law, and that law with a table.

It needs no pytest, so that the pictures of the docs are made by it, too.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from drives import oracle
from drives.drive_bench import RATE, TURN, Plant, Tracker
from drives.moteus_stand_in import CPR, GAINS, Moteus, tview_csv
from drives.odrive_files import OLD, old_csv
from drives.oracle import motions, played
from drives.simplefoc_files import MONITOR_TOML, monitor

from cogless.drives.firmware_laws import ODRIVE_CELLS

PLANT = Plant()
SIMPLEFOC_GAINS = {"P": 0.06, "I": 0.9, "output_ramp": 300.0, "Tf": 3e-3}
ODRIVE_GAINS = {"pos_gain": 20.0, "vel_gain": 2.2e-3 * TURN, "vel_integrator_gain": 0.03 * TURN}
LOOP_ROWS = RATE // 1000  # of the trace for one step of SimpleFOC's loop

Trace = dict[str, np.ndarray]
Law = dict[str, object]


@dataclass(frozen=True)
class Firmware:
    """A drive's firmware. `law` takes the text of a file with a table, and returns the law with this table;
    an empty text has no table."""

    title: str
    speed_rate: str
    configuration: str  # its file's name
    form: str  # of `cogless table --to`
    table: str  # its file's name
    law: Callable[[str], Law]
    write_log: Callable[[Trace, Path], object]
    write_configuration: Callable[[Path], object]

    def write(self, folder: Path) -> list[Path]:
        """Write logs of each motion and the configuration; return the logs."""
        for run in played(motions(), {"own": self.law("")}, self.speed_rate):
            self.write_log(run.trace, folder / f"{run.scenario}.csv")
        self.write_configuration(folder / self.configuration)
        return sorted(folder.glob("*.csv"))


def tracked(trace: Trace, counts: int, bandwidth: float) -> np.ndarray:
    """Angle and speed of the rotor as the drive's observer has them, rad and rad/s."""
    tracker = Tracker(counts, bandwidth)
    pairs = zip(np.unwrap(trace["theta_m"]), trace["omega_m"], strict=True)
    return np.array([tracker.step(theta, omega) for theta, omega in pairs]).T


def moteus_log(trace: Trace, path: Path) -> list[Path]:
    """tview's channels at 1 kHz. The encoder's zero is the rotor's."""
    angle, speed = tracked(trace, CPR, 400)
    noise = 2e-3 * np.random.default_rng(3).standard_normal(len(angle))
    log = {
        "t": np.arange(len(angle)) / RATE,
        "filtered_value": np.mod(angle / TURN, 1.0) * CPR,
        "position": angle / TURN + Moteus().offset,
        "velocity": speed / TURN,
        "q_A": trace["i_q"] + noise,
    }
    return tview_csv(log, path.parent, path.stem, every=5)


def moteus_dump(path: Path) -> Path:
    """Write a dump of the configuration, whose current loop has a bandwidth of 1 kHz."""
    drive = Moteus(encoder_zero=0.0)
    return drive.dump(path, servo__pid_dq__kp="2.83", servo__pid_dq__ki="5027")


def moteus_law(table: str) -> Law:
    """Position mode with the gains of the dump and a table as `--restore-config` takes it."""
    drive = Moteus()
    drive.restore(table)
    gains = dict(zip(("kp", "kd", "ki"), (TURN * gain for gain in GAINS), strict=True))
    return oracle.law("Moteus", **gains, ilimit=10.0, scale=drive.scale, entries=drive.comp)


def simplefoc_log(trace: Trace, path: Path) -> Path:
    """The monitor's lines at 500 Hz of a loop of 1 kHz. The drive's angle is the rotor's."""
    turned, target = np.unwrap(trace["theta_m"])[::LOOP_ROWS], trace["omega_ref"][::LOOP_ROWS]
    angle = np.floor(turned / TURN * 2**14) / 2**14 * TURN
    share = SIMPLEFOC_GAINS["Tf"] / (SIMPLEFOC_GAINS["Tf"] + 1e-3)
    velocity, filtered = [], float(target[0])
    for speed in np.diff(angle, prepend=angle[0]) * 1e3:
        filtered = share * filtered + (1 - share) * speed
        velocity.append(filtered)
    noise = 2e-3 * np.random.default_rng(5).standard_normal(len(angle))
    log = {
        "t": np.arange(len(angle)) * 1e-3,
        "target": target,
        "Iq": 1e3 * (trace["i_q"][::LOOP_ROWS] + noise),
        "velocity": np.array(velocity),
        "angle": angle,
    }
    return monitor(log, path, every=2)


def simplefoc_law(table: str) -> Law:
    """Speed control with the table of a header that cogless wrote."""
    if not table:
        return oracle.law("SimpleFoc", **SIMPLEFOC_GAINS)
    body = re.search(r"\{([^{}]*)\}", table)
    assert body is not None
    entries = [float(word) for word in re.findall(r"[-+]?\d+\.\d*(?:e[-+]?\d+)?", body[1])]
    return oracle.law("SimpleFoc", **SIMPLEFOC_GAINS, entries=entries)


def odrive_log(trace: Trace, path: Path) -> Path:
    """A BulkCapture over USB, some 500 rows a second."""
    angle, speed = tracked(trace, 8192, 1000 / TURN)
    noise = 2e-3 * np.random.default_rng(4).standard_normal(len(angle))
    log = {
        "t": np.arange(len(angle)) / RATE,
        "position": angle / TURN,
        "velocity": speed / TURN,
        "Iq": trace["i_q"] + noise,
    }
    return old_csv(log, path)


def odrive_configuration(path: Path) -> None:
    """The configuration of firmware 0.5, with the gains of the law."""
    axis = {**OLD, "controller": {"config": ODRIVE_GAINS}}
    axis["encoder"] = {"config": {"cpr": 8192, "bandwidth": 1000.0}}
    path.write_text(json.dumps({"axis0": axis}))


def odrive_law(table: str) -> Law:
    """Position over speed; the currents of a CSV become the torques of the map at the middle of its cells."""
    if not table:
        return oracle.law("Odrive", **ODRIVE_GAINS)
    angle, current = np.loadtxt(table.splitlines(), delimiter=",", skiprows=1).T
    cells = TURN / ODRIVE_CELLS * (np.arange(ODRIVE_CELLS) + 0.5)
    torques = PLANT.K_t * np.interp(cells, np.radians(angle), current, period=TURN)
    return oracle.law("Odrive", **ODRIVE_GAINS, cells=torques.tolist())


FIRMWARES = {
    "moteus": Firmware(
        "moteus",
        "30 kHz",
        "dump.cfg",
        "moteus",
        "cogging.cfg",
        moteus_law,
        moteus_log,
        moteus_dump,
    ),
    "odrive": Firmware(
        "ODrive", "8 kHz", "config.json", "csv", "cogging.csv", odrive_law, odrive_log, odrive_configuration
    ),
    "simplefoc": Firmware(
        "SimpleFOC",
        "1 kHz",
        "monitor.toml",
        "simplefoc",
        "cogging.h",
        simplefoc_law,
        simplefoc_log,
        lambda path: path.write_text(MONITOR_TOML),
    ),
}
