"""Logs in which the drive reports a fault, or leaves its mode: used up to the fault, and named."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from drives.moteus_stand_in import Moteus, tview_csv, tview_jsonl
from drives.odrive_files import OLD, old_csv
from drives.test_vesc import XML, log, run

from cogless.drives.adapter import DriveLogs
from cogless.drives.moteus import read_logs as read_moteus
from cogless.drives.odrive import read_logs as read_odrive
from cogless.drives.vesc import read_logs as read_vesc
from cogless.errors import StudyError

Flags = dict[str, Callable[[int], int]]  # by heading: the value of a row


def with_columns(path: Path, flags: Flags, delimiter: str = ",") -> None:
    """Add or replace columns of a log."""
    with path.open(newline="") as file:
        headings, *rows = list(csv.reader(file, delimiter=delimiter))
    for heading, value in flags.items():
        if heading not in headings:
            headings.insert(1, heading)
            for row in rows:
                row.insert(1, "")
        place = headings.index(heading)
        for n, row in enumerate(rows):
            row[place] = str(value(n))
    with path.open("w", newline="") as file:
        csv.writer(file, delimiter=delimiter).writerows([headings, *rows])


def vesc(folder: Path, flags: Flags) -> DriveLogs:
    (folder / "motor.xml").write_text(XML)
    path = log(run([(0.0, 5.0), (4.0, 5.0)]), folder / "slow.csv")
    with_columns(path, flags, ";")
    return read_vesc([path], folder / "motor.xml")


def odrive(folder: Path, flags: Flags) -> DriveLogs:
    (folder / "config.json").write_text(json.dumps({"axis0": OLD}))
    t = np.arange(20000) / 5000
    made = {"t": t, "position": t, "velocity": np.ones(len(t)), "Iq": 0.1 + 0 * t}
    path = old_csv(made, folder / "slow.csv")
    with_columns(path, flags)
    return read_odrive([path], folder / "config.json")


def moteus(folder: Path, flags: Flags) -> DriveLogs:
    drive = Moteus()
    run_columns = drive.run([(0.0, 3.0), (4.0, 3.0)])
    paths = tview_csv(run_columns, folder, "slow", every=5)
    stats = next(path for path in paths if "servo_stats" in path.name)
    with_columns(stats, flags)
    return read_moteus(paths, drive.dump(folder / "dump.cfg"))


def moteus_jsonl(folder: Path, flags: Flags) -> DriveLogs:
    drive = Moteus()
    path = tview_jsonl(drive.run([(0.0, 3.0), (4.0, 3.0)]), folder / "slow.jsonl", every=5)
    records = [json.loads(line) for line in path.read_text().splitlines()]
    for n, record in enumerate(one for one in records if one["channel"] == "servo_stats"):
        record["data"] |= {name: value(n) for name, value in flags.items()}
    path.write_text("".join(json.dumps(record) + "\n" for record in records))
    return read_moteus([path], drive.dump(folder / "dump.cfg"))


def late(row: int, code: int, otherwise: int = 0) -> Callable[[int], int]:
    return lambda n: code if n >= row else otherwise


def lines(logs: DriveLogs) -> list[str]:
    return [*logs.remarks, *(line for one in logs.recordings for line in one.remarks)]


@pytest.mark.parametrize(
    ("drive", "flags", "says", "rows"),
    [
        (vesc, {"fault_code": late(100, 3)}, "fault_code is 3 from 2 s on, a fault of the drive", 99),
        (odrive, {"axis0.error": late(900, 64)}, "axis0.error is 64 from 1.8", 900),
        (odrive, {"axis0.active_errors": late(900, 512)}, "axis0.active_errors is 512 from 1.8", 900),
        (moteus, {"mode": late(2000, 1, 10), "fault": late(2000, 33)}, "fault is 33 from 2 s on", 2000),
        (moteus_jsonl, {"mode": late(2000, 1, 10), "fault": late(2000, 33)}, "fault is 33 from 2 s", 2000),
        (moteus, {"mode": late(2000, 1, 10)}, "mode is 1 from 2 s on, a fault", 2000),
    ],
)
def test_a_log_is_used_up_to_a_fault_which_is_named(
    drive: Callable[[Path, Flags], DriveLogs], flags: Flags, says: str, rows: int, tmp_path: Path
) -> None:
    logs = drive(tmp_path, flags)
    assert any(says in line and "the log is used up to this time" in line for line in lines(logs)), lines(
        logs
    )
    (recording,) = logs.recordings
    assert {len(values) for values in recording.signals.values()} == {rows}


@pytest.mark.parametrize(
    ("drive", "flags"),
    [
        (vesc, {}),
        (odrive, {"axis0.error": late(0, 0), "axis0.current_state": late(0, 8)}),
        # a limit that acts is no fault: moteus tells it in the same register
        (moteus, {"mode": late(0, 10), "fault": late(2000, 97)}),
        (moteus, {"mode": lambda n: 10 if 100 < n < 3800 else 0}),  # at rest before and after
    ],
)
def test_a_log_without_a_fault_is_whole_and_says_nothing(
    drive: Callable[[Path, Flags], DriveLogs], flags: Flags, tmp_path: Path
) -> None:
    logs = drive(tmp_path, flags)
    assert not any(word in line for line in lines(logs) for word in ("fault", "mode")), lines(logs)


@pytest.mark.parametrize(
    ("drive", "flags", "says"),
    [
        (moteus, {"mode": late(2000, 11, 10)}, "from 2 s on the mode is 11 instead of 10"),
        (odrive, {"axis0.current_state": late(900, 1, 8)}, "s on the mode is 1 instead of 8"),
    ],
)
def test_a_mode_that_ends_early_is_named(
    drive: Callable[[Path, Flags], DriveLogs], flags: Flags, says: str, tmp_path: Path
) -> None:
    logs = drive(tmp_path, flags)
    assert any(says in line for line in lines(logs)), lines(logs)


def test_a_fault_from_the_first_row_on_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r"slow.csv: fault_code: 3 in row 1: expected a log that begins with"
    ):
        vesc(tmp_path, {"fault_code": late(0, 3)})


def test_a_flag_in_words_is_passed_over(tmp_path: Path) -> None:
    """Python before 3.11 writes an enumeration of tview by its name."""
    drive = Moteus()
    paths = tview_csv(drive.run([(0.0, 3.0), (2.0, 3.0)]), tmp_path, "slow", every=5)
    stats = next(path for path in paths if "servo_stats" in path.name)
    text = stats.read_text().splitlines()
    stats.write_text("\n".join([f"{text[0]},mode", *(f"{row},mode.kPosition" for row in text[1:])]) + "\n")
    assert len(read_moteus(paths, drive.dump(tmp_path / "dump.cfg")).recordings) == 1
