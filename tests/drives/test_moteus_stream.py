"""moteus's high-rate stream, written record by record as the notes on its source say."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import RATE, RUNS
from drives.moteus_stand_in import CPR, Moteus

from cogless.drives import moteus
from cogless.errors import StudyError

MASK = 1 << 1 | 1 << 3 | 1 << 11  # velocity, q_A, sources[0].raw
DRIVES = {sign: Moteus(sign=sign) for sign in (1, -1)}


def stream(run: dict[str, np.ndarray], path: Path, lost: int = 0, turns: int = 0) -> Path:
    """Records at the law's rate; after `lost` bytes in the middle the stream goes on."""
    records = bytearray()
    for velocity, current, value in zip(run["velocity"], run["q_A"], run["filtered_value"], strict=True):
        raw = (int(value) + turns * CPR) % 65536
        raw -= 65536 if raw > 32767 else 0
        scaled = (round(x * 32767 / 100) for x in (velocity, current))
        records += b"\x5a" + struct.pack("<hhh", *scaled, raw)
    middle = len(records) // 3
    path.write_bytes(records[:middle] + records[middle + lost :])
    return path


def dump_of(drive: Moteus, path: Path, **changes: str) -> Path:
    return drive.dump(path, servo__emit_debug=str(MASK), servo__pwm_rate_hz=str(RATE), **changes)


@pytest.mark.parametrize("sign", DRIVES)
def test_a_stream_tells_the_motor_and_its_table(
    sign: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = DRIVES[sign]
    logs = [stream(drive.run(points), tmp_path / f"{name}.bin", turns=2) for name, points in RUNS.items()]
    dump = dump_of(drive, tmp_path / "dump.cfg")
    options = ["--drive", "moteus", "--drive-config", dump, "-o", tmp_path / "found"]
    code, out, err = cogless(capsys, "identify", *logs, *options)
    assert (code, err) == (0, "") and "--to moteus -o FILE" in out
    values = json.loads((tmp_path / "found" / "identified.json").read_text())["values"]
    for key, truth in (("j", drive.plant.inertia), ("c", drive.plant.coulomb)):
        assert values[key]["value"] == pytest.approx(truth / drive.plant.K_t, rel=0.03)
    table = tmp_path / "cogging.cfg"
    code, _, err = cogless(capsys, "table", tmp_path / "found", "--to", "moteus", "-o", table)
    assert (code, err) == (0, "")
    restored = Moteus(sign=sign)
    restored.restore(table.read_text())
    angles = np.linspace(0, 6, 500)
    truth = sign * drive.plant.holding(angles - drive.encoder_zero)
    rest = truth - [restored.table(angle) for angle in angles]
    assert np.std(rest) < 0.08 * np.std(truth)


def test_lost_bytes_leave_the_longest_stretch(tmp_path: Path) -> None:
    run = DRIVES[1].run([(0.0, 3.0), (1.0, 3.0)])
    dump = dump_of(DRIVES[1], tmp_path / "dump.cfg")
    whole, cut = (moteus.read_logs([stream(run, tmp_path / f"{n}.bin", n)], dump) for n in (0, 4))
    rows = [len(logs.recordings[0].signals["t"]) for logs in (whole, cut)]
    assert rows[0] == len(run["t"]) and rows[1] == pytest.approx(2 / 3 * rows[0], abs=3)
    angles = [logs.recordings[0].signals["theta"] for logs in (whole, cut)]
    assert np.ptp(np.unwrap(angles[1] - angles[0][-rows[1] :])) < 1e-9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"servo__emit_debug": ""}, "servo.emit_debug: missing: expected the bits"),
        ({"servo__emit_debug": "2"}, r"servo.emit_debug: 2: expected q_A and sources.0.raw in the stream"),
        ({"servo__emit_debug": str(MASK | 1 << 2)}, r"0.bin: no records of 9 bytes"),
    ],
)
def test_a_mask_that_does_not_fit_is_told(changes: dict[str, str], message: str, tmp_path: Path) -> None:
    log = stream(DRIVES[1].run([(0.0, 3.0), (0.2, 3.0)]), tmp_path / "0.bin")
    dump = DRIVES[1].dump(tmp_path / "dump.cfg", **{"servo__pwm_rate_hz": str(RATE), **changes})
    with pytest.raises(StudyError, match=message):
        moteus.read_logs([log], dump)


def test_raw_counts_that_are_not_the_index_place_no_table(tmp_path: Path) -> None:
    log = stream(DRIVES[1].run([(0.0, 3.0), (0.5, 3.0)]), tmp_path / "0.bin")
    dump = dump_of(DRIVES[1], tmp_path / "dump.cfg", motor_position__sources__0__offset="120")
    frame = moteus.read_logs([log], dump).frame
    assert not frame.zero and "lacks the angle over which moteus reads its cogging table" in frame.lacking
