"""A file of another drive, or without a channel, is one line for every drive."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commands import cogless
from drives import odrive_files, simplefoc_files, test_vesc
from drives.moteus_stand_in import Moteus, tview_csv

from cogless.cli.drives import _source
from cogless.drives.adapter import FRAME_FILE, TableFrame
from cogless.drives.moteus import MOTEUS, read_logs
from cogless.drives.moteus_dump import read_dump
from cogless.errors import StudyError

# The headings of a log, two rows under them, and the column without which it is none.
LOGS = {
    "moteus": ("timestamp,d_A,position,q_A,velocity", "1.0,0,0.1,0.2,1\n1.1,0,0.2,0.2,1", "position"),
    "odrive": (
        "t,axis0.encoder.pos_estimate,axis0.motor.current_control.Iq_measured",
        "0.0,0.1,0.2\n0.1,0.2,0.2",
        "axis0.encoder.pos_estimate",
    ),
    "vesc": ("ms_today;q_axis_current;erpm;input_voltage;", "1;0.2;10;24;\n21;0.2;10;24;", "q_axis_current"),
    "simplefoc": ("1.0000\t200.0000\t1.0000\t0.1000", "1.0000\t200.0000\t1.0000\t0.1020", ""),
}
TITLES = {"moteus": "moteus", "odrive": "ODrive", "vesc": "VESC", "simplefoc": "SimpleFOC"}


@pytest.fixture
def configurations(tmp_path: Path) -> dict[str, Path]:
    texts = {
        "odrive": json.dumps({"axis0": odrive_files.OLD}),
        "vesc": test_vesc.XML,
        "simplefoc": simplefoc_files.MONITOR_TOML,
    }
    files = {"moteus": Moteus().dump(tmp_path / "dump.cfg")}
    for drive, text in texts.items():
        files[drive] = tmp_path / f"{drive}.config"
        files[drive].write_text(text)
    return files


def log_of(drive: str, folder: Path) -> Path:
    heading, rows, _ = LOGS[drive]
    path = folder / f"{drive}.{'txt' if drive == 'simplefoc' else 'csv'}"
    path.write_text(f"{heading}\n{rows}\n")
    return path


@pytest.mark.parametrize("drive", LOGS)
def test_a_log_or_configuration_of_another_drive_is_one_line(
    drive: str, configurations: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", tmp_path / "out"]
    for other in LOGS.keys() - {drive}:
        log, own = log_of(other, tmp_path), configurations[drive]
        code, _, err = cogless(capsys, "identify", log, "--drive", drive, "--drive-config", own, *out)
        assert (code, err.count("\n")) == (2, 1), err
        assert (
            err.startswith(f"{log}: its first lines are those of {TITLES[other]}, ")
            and f"expected a log of {TITLES[drive]}" in err
        )
        log, foreign = log_of(drive, tmp_path), configurations[other]
        code, _, err = cogless(capsys, "identify", log, "--drive-config", foreign, *out)
        assert (code, err.count("\n")) == (2, 1) and err.startswith(f"{foreign}: "), err


@pytest.mark.parametrize("drive", [drive for drive in LOGS if LOGS[drive][2]])
def test_a_log_without_a_channel_is_one_line(
    drive: str, configurations: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, column = log_of(drive, tmp_path), LOGS[drive][2]
    log.write_text(log.read_text().replace(column, "other", 1))
    own = ["--drive", drive, "--drive-config", configurations[drive]]
    code, _, err = cogless(capsys, "identify", log, *own, "-o", tmp_path / "out")
    assert (code, err.count("\n")) == (2, 1), err
    assert err.startswith(f"{log}: no column ") and column in err and "it has" in err


def turning(folder: Path, **changes: str) -> tuple[list[Path], Path]:
    """A log of tview, both channels, and the dump of the drive, with changes."""
    drive = Moteus(ratio=0.25)
    logs = tview_csv(drive.run([(0.0, 3.0), (4.0, 3.0)]), folder, "slow", every=5)
    return logs, drive.dump(folder / "dump.cfg", **changes)


def test_a_dump_among_the_logs_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As `cogless identify * --drive-config dump.cfg` names it."""
    log, dump = log_of("moteus", tmp_path), Moteus().dump(tmp_path / "dump.cfg")
    code, _, err = cogless(capsys, "identify", dump, log, "--drive-config", dump, "-o", tmp_path / "out")
    line = f"{dump}: is among the logs and in --drive-config: expected only in --drive-config\n"
    assert (code, err) == (2, line)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_a_dump_may_be_as_windows_redirects_it(encoding: str, tmp_path: Path) -> None:
    dump, redirected = Moteus().dump(tmp_path / "dump.cfg"), tmp_path / "redirected.cfg"
    redirected.write_text(dump.read_text().replace("\n", "\r\n"), encoding=encoding)
    assert read_dump(redirected).values == read_dump(dump).values


def test_firmware_that_takes_no_table_is_one_line(tmp_path: Path) -> None:
    logs, dump = turning(tmp_path, motor__cogging_dq_scale="")
    lacking = read_logs(logs, dump).frame.lacking
    assert (
        lacking == f"{dump} has no motor.cogging_dq_scale: expected firmware with it, of ABI 0x0105 or later"
    )


def test_a_table_that_was_on_is_one_line(tmp_path: Path) -> None:
    logs, dump = turning(tmp_path, motor__cogging_dq_scale="0.001", motor__cogging_dq_comp__3="9")
    (line,) = (line for line in read_logs(logs, dump).remarks if "table" in line and "logged" not in line)
    assert line.startswith(f"{dump}: the drive has a cogging table, scale 0.001 A: ")
    assert line.endswith("so a new table replaces the old one.") and "\n" not in line


def test_an_encoder_behind_a_gear_as_commutation_source_is_one_line(tmp_path: Path) -> None:
    logs, dump = turning(tmp_path, motor_position__sources__0__reference="1")
    with pytest.raises(StudyError) as error:
        read_logs(logs, dump)
    line = str(error.value)
    assert line.startswith(f"{dump}: motor_position.sources.0.reference: 1: expected 0, a commutation source")
    assert "\n" not in line


@pytest.mark.parametrize(("drive", "advises"), [("simplefoc", True), ("odrive", False)])
def test_a_table_of_another_drive_s_logs_names_no_drive_that_takes_none(
    drive: str, advises: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / FRAME_FILE).write_text(TableFrame(drive, zero=True).to_json())
    monkeypatch.setattr("cogless.drives.holding_current.from_identified", lambda path: None)
    lacking = _source(tmp_path, None, MOTEUS, None)[1].lacking
    assert lacking.startswith(f"its logs are of {drive}: expected ")
    assert (f"--to {drive}" in lacking) == advises and "--shift ANGLE" in lacking
