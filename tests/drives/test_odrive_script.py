"""The script of a plan for ODrive, played against stand-ins of both firmwares' interfaces."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from commands import cogless
from drives.clocked_drive import STUDY, ClockedDrive, said_without
from drives.drive_bench import TURN
from drives.moteus_stand_in import Moteus
from drives.odrive_files import OLD
from drives.test_odrive import NEW

from cogless.drives.registry import script_files
from cogless.study import load


class Readings:
    """Attributes that are read over USB, which takes a while; what is set is kept."""

    def __init__(self, drive: ClockedDrive, **readings: Any) -> None:
        object.__setattr__(self, "_drive", drive)
        object.__setattr__(self, "_readings", readings)

    def __getattr__(self, name: str) -> Any:
        if name not in self._readings:
            raise AttributeError(name)
        self._drive.now += 1e-4
        self._drive.run()
        return self._readings[name]()


class Axis(Readings):
    """An axis; closed loop, idle and the input's speed reach the drive."""

    def __setattr__(self, name: str, value: Any) -> None:
        assert name == "requested_state" and value in (1, 8)
        self._drive.velocity = 0.0 if value == 8 else math.nan
        self._drive.position, self._drive.control_velocity = math.nan, 0.0
        self._drive.stops += value == 1


class Controller:
    def __init__(self, drive: ClockedDrive) -> None:
        self.drive = drive
        self.config = SimpleNamespace(control_mode=3, input_mode=1, vel_ramp_rate=0.7)

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "input_vel":
            assert (self.config.control_mode, self.config.input_mode) == (2, 2)
            self.drive.velocity, self.drive.acceleration = value, self.config.vel_ramp_rate
        object.__setattr__(self, name, value)


def package(drive: ClockedDrive, firmware: str) -> tuple[ModuleType, SimpleNamespace, Controller]:
    """The odrive package with one axis, its motor's settings, its controller."""
    controller = Controller(drive)
    settings = SimpleNamespace(current_lim=40.0, current_soft_max=40.0)
    estimates = {
        "pos_estimate": lambda: drive.angle / TURN + 0.4,
        "vel_estimate": lambda: drive.speed / TURN,
    }
    currents = {"Iq_measured": lambda: drive.rotor.current + drive.random.gauss(0, 2e-3)}

    def errors() -> int:
        return 0x20 if drive.now - 100.0 > drive.fault else 0

    if firmware == "0.5":
        motor = SimpleNamespace(current_control=Readings(drive, **currents), config=settings)
        more = {"encoder": lambda: Readings(drive, **estimates), "motor": lambda: motor, "error": errors}
    else:
        motor = SimpleNamespace(foc=Readings(drive, **currents))
        config = SimpleNamespace(motor=settings)
        more = {**estimates, "motor": lambda: motor, "config": lambda: config, "active_errors": errors}
    axis = Axis(drive, controller=lambda: controller, **more)
    module = ModuleType("odrive")
    odrv = SimpleNamespace(axis0=axis, vbus_voltage=24.0)
    module.find_any = lambda: odrv  # type: ignore[attr-defined]
    return module, settings, controller


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan")
    (folder / "study.toml").write_text(STUDY)
    for name, text in script_files(load(folder / "study.toml"), "odrive", None).items():
        (folder / name).write_text(text)
    return folder / "record_odrive.py"


def test_nothing_moves_without_yes(script: Path, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and not list(tmp_path.iterdir())
    assert "Nothing was moved. --yes moves the motor." in done.stdout and "At most 5 A" in done.stdout


def test_a_missing_package_is_one_line(script: Path, tmp_path: Path) -> None:
    assert said_without("odrive", script, tmp_path) == "no package odrive: pip install odrive\n"


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
def test_what_it_records_tells_the_motor(
    firmware: str,
    script: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    drive = ClockedDrive(Moteus())
    drive.most = 10.0
    module, settings, controller = package(drive, firmware)
    drive.play(script, module, tmp_path, monkeypatch)
    capsys.readouterr()
    assert drive.stops == 1 and (settings.current_lim, settings.current_soft_max) == (40.0, 40.0)
    config = controller.config
    assert (config.control_mode, config.input_mode, config.vel_ramp_rate) == (3, 1, 0.7)
    (tmp_path / "config.json").write_text(json.dumps({"axis0": OLD} if firmware == "0.5" else NEW))
    logs = sorted(tmp_path.glob("*.csv"))
    options = ["--drive-config", tmp_path / "config.json", "-o", tmp_path / "found"]
    code, out, err = cogless(capsys, "identify", *logs, *options)
    assert (code, err) == (0, "") and f"a capture of firmware {firmware}" in out
    made = json.loads((tmp_path / "found" / "identified.json").read_text())
    plant = drive.drive.plant
    assert made["values"]["j"]["value"] == pytest.approx(plant.inertia / plant.K_t, rel=0.05)
    assert made["values"]["c"]["value"] == pytest.approx(plant.coulomb / plant.K_t, rel=0.05)
    sizes = {wave["order"]: wave["amplitude_N_m"] for wave in made["cogging"]}
    assert sizes[12] == pytest.approx(5e-3, rel=0.06)


@pytest.mark.parametrize("reason", ["error", "speed"])
def test_an_error_or_too_high_a_speed_stops_the_motor(
    reason: str, script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = ClockedDrive(Moteus(), fault=1.0 if reason == "error" else math.inf)
    drive.most = 10.0
    module, settings, _ = package(drive, "0.6")
    if reason == "speed":
        text = script.read_text()
        limit = text.split("SPEED_LIMIT = ")[1].split()[0]
        script = tmp_path / "slower.py"
        script.write_text(text.replace(f"SPEED_LIMIT = {limit}", "SPEED_LIMIT = 0.1"))
    with pytest.raises(SystemExit) as end:
        drive.play(script, module, tmp_path, monkeypatch)
    assert str(end.value).endswith("stopped") and ("error 0x20" in str(end.value)) == (reason == "error")
    assert drive.stops == 1 and math.isnan(drive.velocity) and settings.current_soft_max == 40.0
