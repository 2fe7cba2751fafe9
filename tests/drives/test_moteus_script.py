"""The script of a plan for moteus, played against a stand-in of the moteus package with a motor behind it."""

from __future__ import annotations

import asyncio
import enum
import json
import math
import random
import runpy
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from commands import cogless
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


class Register(enum.IntEnum):
    POSITION = 0x001
    VELOCITY = 0x002
    TORQUE = 0x003
    Q_CURRENT = 0x004
    D_CURRENT = 0x005
    VOLTAGE = 0x00D
    FAULT = 0x00F
    ENCODER_0_POSITION = 0x050


class Bus:
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
        """Position mode: the velocity that is asked for is reached at the given acceleration."""
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

    def module(self) -> ModuleType:
        """What the script uses of the package."""
        bus = self

        class Controller:
            def __init__(self, id: int, query_resolution: Any) -> None:
                extra = query_resolution._extra
                assert id == 1 and query_resolution.q_current == "f32" and list(extra.values()) == ["f32"]
                self.extra = list(extra)

            async def set_stop(self) -> None:
                bus.stops += 1
                bus.velocity = bus.position = math.nan
                bus.control_velocity = 0.0

            async def set_position(
                self,
                *,
                position: float,
                velocity: float,
                accel_limit: float,
                maximum_torque: float,
                query: bool,
            ) -> Any:
                assert math.isnan(position) and query and accel_limit > 0
                bus.velocity, bus.acceleration, bus.most = velocity, accel_limit, maximum_torque
                bus.wait(4e-4)
                drive = bus.drive
                values = {
                    Register.POSITION: bus.angle / TURN * drive.ratio + drive.offset,
                    Register.VELOCITY: bus.speed / TURN * drive.ratio,
                    Register.TORQUE: 0.0,
                    Register.Q_CURRENT: drive.sign * bus.rotor.current + bus.random.gauss(0, 2e-3),
                    Register.D_CURRENT: 0.0,
                    Register.VOLTAGE: 24.0,
                    Register.FAULT: 33 if bus.now - 100.0 > bus.fault else 0,
                }
                for register in self.extra:
                    values[register] = bus.encoder / TURN % 1.0
                return SimpleNamespace(values=values)

        module = ModuleType("moteus")
        for name, value in {
            "Register": Register,
            "QueryResolution": SimpleNamespace,
            "Controller": Controller,
            "F32": "f32",
        }.items():
            setattr(module, name, value)
        return module


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plan of a geared drive whose output counts backwards."""
    folder = tmp_path_factory.mktemp("plan")
    (folder / "study.toml").write_text(STUDY)
    Moteus(sign=-1, ratio=0.25).dump(folder / "dump.cfg")
    command = ["identify", "--plan", folder / "study.toml", "--drive", "moteus"]
    command += ["--drive-config", folder / "dump.cfg", "-o", folder / "plan"]
    done = subprocess.run(
        [sys.executable, "-m", "cogless", *map(str, command)], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "record_moteus.py. Its first lines say how to start it." in done.stdout
    return folder / "plan" / "record_moteus.py"


def played(script: Path, bus: Bus, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the script with --yes in a folder, on the bus's clock."""
    real_sleep = asyncio.sleep

    async def sleep(seconds: float) -> None:
        bus.wait(seconds)
        await real_sleep(0)

    monkeypatch.setitem(sys.modules, "moteus", bus.module())
    monkeypatch.setattr(time, "monotonic", lambda: bus.now)
    monkeypatch.setattr(asyncio, "sleep", sleep)
    monkeypatch.setattr(sys, "argv", [str(script), "--yes"])
    monkeypatch.chdir(folder)
    try:
        runpy.run_path(str(script), run_name="__main__")
    finally:
        monkeypatch.undo()


def test_nothing_moves_without_yes(script: Path, tmp_path: Path) -> None:
    """Not even the package is needed."""
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and not list(tmp_path.iterdir())
    assert "Nothing was moved. --yes moves the motor." in done.stdout
    assert "slow.csv: 18.4 s, up to 0.0625 rev/s" in done.stdout  # a quarter of the rotor's, behind the gear
    assert "At most 0.613 N m" in done.stdout  # 5 A of 30.6 mN m/A, times four


def test_what_it_records_tells_the_motor_and_its_table(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bus = Bus(Moteus(sign=-1, ratio=0.25))
    played(script, bus, tmp_path, monkeypatch)
    capsys.readouterr()
    assert bus.stops == 2
    logs = sorted(tmp_path.glob("*.csv"))
    assert [log.stem for log in logs] == ["acceleration", "fast", "one-speed", "slow"]
    dump = script.parents[1] / "dump.cfg"
    code, _, err = cogless(capsys, "identify", *logs, "--drive-config", dump, "-o", tmp_path / "found")
    assert (code, err) == (0, "")
    made = json.loads((tmp_path / "found" / "identified.json").read_text())
    plant = bus.drive.plant
    assert made["values"]["j"]["value"] == pytest.approx(plant.inertia / plant.K_t, rel=0.05)
    assert made["values"]["c"]["value"] == pytest.approx(plant.coulomb / plant.K_t, rel=0.05)
    code, _, err = cogless(
        capsys, "table", tmp_path / "found", "--to", "moteus", "-o", tmp_path / "table.cfg"
    )
    assert (code, err) == (0, "")
    tabled = Moteus(sign=-1, ratio=0.25)
    tabled.restore((tmp_path / "table.cfg").read_text())
    slow = [(0.0, 0.5 * TURN), (3.0, 0.5 * TURN)]
    none, mine = (drive.run(slow)["omega"][RATE:].std() for drive in (bus.drive, tabled))
    assert mine < 0.1 * none


@pytest.mark.parametrize("reason", ["fault", "speed"])
def test_a_fault_or_too_high_a_speed_stops_the_motor(
    reason: str, script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = Bus(Moteus(sign=-1, ratio=0.25), fault=0.5 if reason == "fault" else math.inf)
    if reason == "speed":
        text = script.read_text()
        slower = tmp_path / "slower.py"
        limit = text.split("SPEED_LIMIT = ")[1].split()[0]
        slower.write_text(text.replace(f"SPEED_LIMIT = {limit}", "SPEED_LIMIT = 0.03"))
        script = slower
    with pytest.raises(SystemExit) as end:
        played(script, bus, tmp_path, monkeypatch)
    assert str(end.value).endswith("stopped") and ("fault 33" in str(end.value)) == (reason == "fault")
    assert bus.stops == 2 and math.isnan(bus.velocity)


def test_a_drive_without_a_script_is_named(
    script: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = script.parents[1] / "study.toml"
    code, _, err = cogless(capsys, "identify", "--plan", study, "--drive", "odrive", "-o", tmp_path)
    assert code == 2 and '--drive: "odrive": no script for it is written: expected one of moteus' in err
