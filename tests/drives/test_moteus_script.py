"""The script of a plan for moteus, played against a stand-in of the moteus package with a motor behind it."""

from __future__ import annotations

import enum
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
from drives.drive_bench import RATE, TURN
from drives.moteus_stand_in import Moteus

from cogless.study.reading import load


class Register(enum.IntEnum):
    POSITION = 0x001
    VELOCITY = 0x002
    TORQUE = 0x003
    Q_CURRENT = 0x004
    D_CURRENT = 0x005
    VOLTAGE = 0x00D
    FAULT = 0x00F
    ENCODER_0_POSITION = 0x050


class Bus(ClockedDrive):
    """The drive behind the package."""

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
    options = f"--drive moteus --drive-config {folder / 'dump.cfg'} --config {folder / 'plan' / 'logs.toml'}"
    logs = "slow.csv one-speed.csv fast.csv acceleration.csv"
    assert f"Next: cogless identify {options} {logs}\n" in done.stdout
    record, loaded = (
        line for line in done.stdout.splitlines() if line.startswith(("Record: ", "Not in the script"))
    )
    assert record.startswith("Record: slow (") and "load" not in record and "Columns: " not in done.stdout
    assert loaded.startswith("Not in the script, since they need a load: load-forwards (")
    return folder / "plan" / "record_moteus.py"


def test_nothing_moves_without_yes(script: Path, tmp_path: Path) -> None:
    """Not even the package is needed."""
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and not list(tmp_path.iterdir())
    assert "Nothing was moved. --yes moves the motor." in done.stdout
    assert (
        "slow.csv: 18.4 s, up to 0.0625 turns/s" in done.stdout
    )  # a quarter of the rotor's, behind the gear
    assert "At most 0.613 N m" in done.stdout  # 5 A of 30.6 mN m/A, times four


def test_a_missing_package_is_one_line(script: Path, tmp_path: Path) -> None:
    assert said_without("moteus", script, tmp_path) == "no package moteus: pip install moteus\n"


def test_what_it_records_tells_the_motor_and_its_table(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bus = Bus(Moteus(sign=-1, ratio=0.25))
    bus.play(script, bus.module(), tmp_path, monkeypatch)
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
    # With what the plan asked for, the drive's own law is played, which tells how late the currents are.
    command = ["identify", *logs, "--drive-config", dump, "--config", script.parent / "logs.toml"]
    code, _, err = cogless(capsys, *command, "-o", tmp_path / "played")
    assert (code, err) == (0, "")
    played = json.loads((tmp_path / "played" / "identified.json").read_text())
    before, after = (tables["values"]["delay"] for tables in (made, played))
    assert abs(after["value"]) < 1.2 * after["error"] and after["error"] < 0.8 * before["error"]
    assert 'object = "firmware_laws.py:Moteus"' in (tmp_path / "played" / "study.toml").read_text()
    assert load(tmp_path / "played" / "study.toml") and (tmp_path / "played" / "firmware_laws.py").is_file()
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
        bus.play(script, bus.module(), tmp_path, monkeypatch)
    assert str(end.value).endswith("stopped") and ("fault 33" in str(end.value)) == (reason == "fault")
    assert bus.stops == 2 and math.isnan(bus.velocity)


def test_a_drive_without_a_script_is_named(
    script: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = script.parents[1] / "study.toml"
    code, _, err = cogless(capsys, "identify", "--plan", study, "--drive", "csv", "-o", tmp_path)
    assert (
        code == 2 and '--drive: "csv": cogless writes no script for this drive: expected one of moteus' in err
    )
