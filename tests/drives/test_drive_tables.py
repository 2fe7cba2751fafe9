"""Tables between formats: the same current at the same place of the rotor, whichever way an index counts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import TURN
from drives.moteus_stand_in import Moteus

ANGLES = TURN / 3000 * np.arange(3000)


def current_at(angle: np.ndarray) -> np.ndarray:
    """A holding current, A, over the source's angle."""
    return 0.2 * np.sin(12 * angle + 0.3) + 0.05 * np.cos(84 * angle)


def csv_of(path: Path, count: int = 4096, load: float = 0.0) -> Path:
    angle = TURN / count * np.arange(count)
    rows = zip(np.degrees(angle), current_at(angle) + load, strict=True)
    path.write_text("angle [deg],current [A]\n" + "".join(f"{a:.9g},{i:.9g}\n" for a, i in rows))
    return path


def read_csv(path: Path) -> tuple[np.ndarray, np.ndarray]:
    heading, *lines = path.read_text().splitlines()
    assert heading == "angle [deg],current [A]"
    angle, current = np.array([line.split(",") for line in lines], dtype=float).T
    return np.radians(angle), current


@pytest.mark.parametrize("reverse", [False, True])
def test_a_table_goes_to_an_index_that_lies_elsewhere(
    reverse: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the source's angle is a, the index is 40 deg + a, or 40 deg - a if it counts the other way."""
    source, target = csv_of(tmp_path / "table.csv", load=0.3), tmp_path / "table.cfg"
    options = ["--from", "csv", "--to", "moteus", "--shift", "40 deg", "-o", target]
    options += ["--reverse"] if reverse else []
    code, out, err = cogless(capsys, "table", source, *options)
    assert (code, err) == (0, "") and "1024 entries" in out
    drive = Moteus()
    drive.restore(target.read_text())
    sign = -1 if reverse else 1
    added = [drive.table(np.radians(40) + sign * angle) for angle in ANGLES]
    # A current that counts the other way has the other sign; the load of the source is no cogging.
    assert added == pytest.approx(sign * current_at(ANGLES), abs=0.004)


def test_a_csv_of_a_csv_is_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = csv_of(tmp_path / "table.csv"), tmp_path / "again.csv"
    code, _, err = cogless(capsys, "table", source, "--from", "csv", "--to", "csv", "-o", target)
    assert (code, err) == (0, "")
    angle, current = read_csv(target)
    # The source's straight lines make order 84 smaller by sinc^2, the target's are made up for.
    inside = np.interp(ANGLES, np.append(angle, TURN), np.append(current, current[0]))
    assert inside == pytest.approx(current_at(ANGLES), abs=0.002)


def test_moteus_tables_come_as_csv(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The means of its own calibration belong to the middles of their bins."""
    fine = current_at(TURN / 8192 * (np.arange(8192) + 0.5)).reshape(1024, 8).mean(axis=1)
    source, target = tmp_path / "cogging.json", tmp_path / "cogging.csv"
    source.write_text(json.dumps({"forward": list(fine + 0.1), "reverse": list(fine - 0.1)}))
    code, _, err = cogless(capsys, "table", source, "--from", "moteus", "--to", "csv", "-o", target)
    assert (code, err) == (0, "")
    angle, current = read_csv(target)
    inside = np.interp(ANGLES, np.append(angle, TURN), np.append(current, current[0]))
    assert inside == pytest.approx(current_at(ANGLES), abs=0.002)


def test_a_stored_map_goes_to_a_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from cogless.maps import stored_map

    angle = TURN / 2048 * np.arange(2048)
    values = np.float32(current_at(angle))
    stored = stored_map.StoredMap(values=values, units=(stored_map.CURRENT_CODE,), limits=(1.0,))
    (tmp_path / "map.bin").write_bytes(bytes(stored))
    options = ["--to", "moteus", "--shift", "0 deg", "-o", tmp_path / "table.cfg"]
    code, _, err = cogless(capsys, "table", tmp_path / "map.bin", *options)
    assert (code, err) == (0, "")
    drive = Moteus()
    drive.restore((tmp_path / "table.cfg").read_text())
    assert [drive.table(a) for a in ANGLES] == pytest.approx(current_at(ANGLES), abs=0.004)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--from", "csv", "--to", "moteus"],
            "the rotor angle of the table's first entry is unknown: SOURCE does not say where its angle is "
            "zero on ",
        ),
        (
            ["--from", "csv", "--to", "motus"],
            '--to: "motus": expected one of moteus, simplefoc, csv, c, akd, ax8000, prusa, ',
        ),
        (["--from", "csv", "--to", "novanta"], "--to: novanta: takes no table: its table is over the"),
        (["--from", "csv", "--to", "vesc"], "--to: vesc: takes no table: "),
        (["--from", "simplefoc", "--to", "moteus"], "--from: simplefoc: expected a drive whose table"),
        (["--from", "csv", "--to", "csv", "--shift", "40"], '--shift: "40": expected a unit, too'),
        (["--from", "csv", "--to", "csv", "--reverse"], "--reverse: expected --shift ANGLE, too"),
        (["--from", "moteus", "--to", "csv"], "motor.poles: missing: expected the dump"),
        (
            ["--to", "csv"],
            "no stored map: expected a stored map, a folder of cogless identify, or --from DRIVE",
        ),
    ],
)
def test_a_table_that_cannot_be_written_is_one_line(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = csv_of(tmp_path / "table.csv", 360)
    code, _, err = cogless(capsys, "table", source, *options)
    assert code == 2 and message in err and err.count("\n") == 1


def test_a_source_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = cogless(capsys, "table", tmp_path / "none", "--to", "moteus")
    assert code == 2 and f"{tmp_path / 'none'}: no such file or folder: expected a folder of" in err


def test_a_table_without_a_target_lists_the_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = cogless(capsys, "table", csv_of(tmp_path / "table.csv", 360), "--from", "csv")
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert "--to: missing: expected one of moteus, simplefoc, csv, c, akd, ax8000, prusa, " in err


@pytest.mark.parametrize(("place", "reason"), [("none/table.cfg", "no such file"), (".", "is a directory")])
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_said(
    place: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = csv_of(tmp_path / "table.csv", 360)
    options = ["--from", "csv", "--to", "csv", "-o", tmp_path / place]
    code, out, err = cogless(capsys, "table", source, *options)
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert reason in err and "expected a file that can be written" in err
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_uneven_angles_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "table.csv"
    source.write_text("angle [deg],current [A]\n0,1\n100,2\n240,1\n")
    code, _, err = cogless(capsys, "table", source, "--from", "csv", "--to", "csv")
    assert code == 2 and "angle [deg]: expected even angles from 0 to below 360" in err
