"""A drive on a clock of its own: it runs as long as a script waits, in velocity mode with ramps."""

from __future__ import annotations

import asyncio
import math
import os
import random
import runpy
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
from drives.drive_bench import RATE, TURN, Rotor, Tracker
from drives.moteus_stand_in import CPR, Moteus

STUDY = """
title = "A gimbal"
[motor]
pole_pairs = 7
slots = 12
R_s = "0.8 ohm"
L_d = "0.45 mH"
L_q = "0.45 mH"
kv = "270 rpm/V"
cogging = [{ order = 84, torque = "4 mN*m" }]
[mechanics]
inertia = "2e-5 kg*m^2"
coulomb_friction = "3 mN*m"
[drive]
rates = { current_loop = "20 kHz", speed_loop = "4 kHz" }
current_loop = { bandwidth = "800 Hz", current_limit = "5 A" }
inverter = { bus_voltage = "24 V" }
position_sensor = { kind = "absolute", bits = 14 }
[scenario.slow]
duration = "6 s"
reference = "60 rpm"
[controller.pi]
law = "pi"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
"""


class ClockedDrive:
    """A drive that runs as long as the script's clock says. `fault`: raised at this time, s."""

    def __init__(self, drive: Moteus, fault: float = math.inf) -> None:
        self.drive, self.fault = drive, fault
        self.now, self.steps = 100.0, 0
        self.rotor, self.tracker = Rotor(drive.plant), Tracker(CPR, 400)
        self.velocity, self.position, self.integral = math.nan, math.nan, 0.0
        self.control_velocity, self.acceleration = 0.0, 0.0
        self.stops, self.most = 0, 0.0
        self.random = random.Random(1)

    def wait(self, seconds: float) -> None:
        self.now += seconds + self.random.expovariate(1 / 3e-4)
        self.run()

    def run(self) -> None:
        """Run up to the clock's time in position mode: the velocity is reached at the given acceleration."""
        drive = self.drive
        while self.steps < (self.now - 100.0) * RATE:
            self.steps += 1
            encoder, speed = self.tracker.step(self.rotor.phi + drive.encoder_zero, self.rotor.omega)
            self.encoder, angle = encoder, drive.sign * encoder
            self.angle, self.speed = angle, drive.sign * speed
            current = 0.0
            if not math.isnan(self.velocity):
                if math.isnan(self.position):
                    self.position = angle
                step = self.acceleration / RATE
                self.control_velocity += max(-step, min(step, self.velocity - self.control_velocity))
                wanted = self.control_velocity / drive.ratio * TURN
                self.position += wanted / RATE
                error = self.position - angle
                self.integral += 0.2 / RATE * error
                torque = 0.05 * error + 2.2e-3 * (wanted - self.speed) + self.integral
                most = self.most * drive.ratio
                current = max(-most, min(most, torque)) / drive.plant.K_t + drive.table(encoder)
            self.rotor.step(drive.sign * current)

    def play(self, script: Path, package: ModuleType, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Run a script with --yes in a folder, with this package, on this clock."""
        real_sleep = asyncio.sleep

        async def sleep(seconds: float) -> None:
            self.wait(seconds)
            await real_sleep(0)

        monkeypatch.setitem(sys.modules, package.__name__, package)
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(time, "sleep", self.wait)
        monkeypatch.setattr(asyncio, "sleep", sleep)
        monkeypatch.setattr(sys, "argv", [str(script), "--yes"])
        monkeypatch.chdir(folder)
        try:
            runpy.run_path(str(script), run_name="__main__")
        finally:
            monkeypatch.undo()


def said_without(package: str, script: Path, folder: Path) -> str:
    """What a script, told to move, says on standard error where Python does not find its drive's package."""
    (folder / package).mkdir()  # hides an installed one
    (folder / package / "__init__.py").write_text("raise ModuleNotFoundError")
    ended = subprocess.run(
        [sys.executable, script, "--yes"],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
    )
    assert ended.returncode == 1
    return ended.stderr
