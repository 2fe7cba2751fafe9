"""Drives' tables of their encoders, in scalar arithmetic as the notes on their sources say."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import TURN

ERROR = {1: (4e-3, 0.7), 2: (1.5e-3, -1.0), 14: (4e-4, 2.0)}  # rad, rad: of the identified frame


def folder_of(path: Path, direction: int, **changes: object) -> Path:
    path.mkdir()
    parts = [{"order": n, "amplitude_rad": a, "phase_rad": p} for n, (a, p) in ERROR.items()]
    (path / "identified.json").write_text(json.dumps({"K_t_N_m_per_A": 0.03, "encoder": parts}))
    frame = {"drive": "moteus", "direction": direction, "zero": True, "encoder": 1, **changes}
    (path / "drive.json").write_text(json.dumps(frame))
    return path


def corrected(text: str, offset_value: float) -> float:
    """The encoder's angle with its table: entry i at i / 256, linear, table / 127 * scale of a turn added."""
    values = dict(line.split() for line in text.splitlines() if not line.startswith("#"))
    prefix = "motor_position.sources.1."
    table = [int(values[f"{prefix}compensation_table.{n}"]) for n in range(256)]
    assert all(-128 <= entry <= 127 for entry in table)
    place = offset_value / TURN % 1.0 * 256
    low = int(place)
    entry = table[low % 256] * (1 - place + low) + table[(low + 1) % 256] * (place - low)
    return offset_value + TURN * entry / 127 * float(values[f"{prefix}compensation_scale"])


@pytest.mark.parametrize("direction", [1, -1])
def test_the_table_takes_the_error_away(
    direction: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The encoder counts `direction` times the identified angle, which reads too much by the error."""
    folder, table = folder_of(tmp_path / "found", direction), tmp_path / "encoder.cfg"
    code, out, err = cogless(capsys, "table", folder, "--to", "moteus", "--encoder", "-o", table)
    assert (code, err) == (0, "") and "calibrate, record new logs" in out
    text, rotor = table.read_text(), np.linspace(-7, 7, 600)
    measured = rotor + sum(a * np.sin(n * rotor + p) for n, (a, p) in ERROR.items())
    rest = np.array([direction * corrected(text, direction * angle) for angle in measured]) - rotor
    assert np.std(rest) < 0.02 * np.std(measured - rotor)
    third = text.replace("_scale ", "_scale -")
    turned = np.array([direction * corrected(third, direction * angle) for angle in measured]) - rotor
    assert np.std(turned) == pytest.approx(2 * np.std(measured - rotor), rel=0.02)
    assert f"{math.degrees(np.std(measured - rotor)):.2g}"[:3] in out


def simplefoc_corrected(text: str, raw: float) -> float:
    """CalibratedSensor: the sensor's angle less the table, straight lines between its entries."""
    entries = [float(x) for x in re.findall(r"[-+]?\d*\.\d+(?:e[-+]?\d+)?", text[text.index("= {") :])]
    count = len(entries)
    assert f"ENCODER_ENTRIES {count}\n" in text
    place = raw / TURN % 1.0 * count
    low = int(place)
    return raw - (entries[low % count] * (1 - place + low) + entries[(low + 1) % count] * (place - low))


def vesc_phase(text: str, raw: float, pairs: int) -> float:
    """The current's phase over the pole pairs: a whole number of degrees for each degree of the encoder."""
    cells = {int(a): int(b) for a, b in re.findall(r"\(enc-corr (\d+) (-?\d+)\)", text)}
    assert sorted(cells) == list(range(360)) and all(-120 <= x <= 120 for x in cells.values())
    assert text.endswith("(enc-corr-en 1)\n")
    return raw - math.radians(cells[int(math.degrees(raw) % 360)]) / pairs


@pytest.mark.parametrize("drive", ["simplefoc", "vesc"])
@pytest.mark.parametrize("direction", [1, -1])
def test_tables_over_the_sensors_own_angle_take_the_error_away(
    drive: str, direction: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sensor counts `direction` times the identified angle, and is 2.2 rad on."""
    frame = {"drive": drive, "encoder": 0, "encoder_direction": direction, "encoder_shift": 2.2}
    folder = folder_of(tmp_path / "found", 1, **frame, pole_pairs=21)
    table = tmp_path / "encoder"
    code, out, err = cogless(capsys, "table", folder, "--to", drive, "--encoder", "-o", table)
    assert (code, err) == (0, "") and out.startswith("Encoder's error: ")
    text, rotor = table.read_text(), np.linspace(-7, 7, 2000)
    measured = rotor + sum(a * np.sin(n * rotor + p) for n, (a, p) in ERROR.items())

    def rest(shift: float) -> float:
        raw = direction * measured + shift
        corrected = [
            simplefoc_corrected(text, x) if drive == "simplefoc" else vesc_phase(text, x, 21) for x in raw
        ]
        return float(np.std(direction * (np.array(corrected) - shift) - rotor))

    # Whole degrees of 21 pole pairs are off by 1/sqrt(12) of them, rms; in a degree the error changes little.
    rounding = 0.0 if drive == "simplefoc" else math.radians(1) / 21 / math.sqrt(12)
    assert rest(2.2) < 1.1 * rounding + 0.02 * np.std(measured - rotor)
    assert rest(2.2 + math.pi) > 5 * rest(2.2)


def test_the_check_of_the_sign_for_vesc_shows_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A current turns the rotor by the cosine of its phase's error, so a load takes more of it."""
    pairs, rotor = 42, np.linspace(0, TURN, 2000)
    frame = {"drive": "vesc", "encoder_direction": 1, "pole_pairs": pairs}
    folder, table = folder_of(tmp_path / "found", 1, **frame), tmp_path / "encoder.lisp"
    code, out, _ = cogless(capsys, "table", folder, "--to", "vesc", "--encoder", "-o", table)
    assert code == 0 and "the mean of q_axis_current falls" in out and "phase-all" not in out
    text = table.read_text()
    raw = rotor + sum(a * np.sin(n * rotor + p) for n, (a, p) in ERROR.items())
    moved = np.array([vesc_phase(text, x, pairs) for x in raw]) - raw
    assert np.degrees(pairs * np.std(raw - rotor)) == pytest.approx(8, rel=0.15)
    current = {share: np.mean(1 / np.cos(pairs * (raw - rotor + share * moved))) for share in (0, 1, -1)}
    assert current[1] < current[0] - 0.008
    assert current[-1] > current[0] + 0.008


def test_small_errors_are_less_than_vesc_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = folder_of(tmp_path / "found", 1, drive="vesc", encoder_direction=1, pole_pairs=1)
    code, _, err = cogless(capsys, "table", folder, "--to", "vesc", "--encoder")
    assert (code, err.count("\n")) == (2, 1) and "0.32 deg electrical: expected 0.5 to 120" in err


def test_what_it_cannot_be_made_from_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    on = folder_of(tmp_path / "on", 1, encoder_table_on=True)
    other = folder_of(tmp_path / "other", 1, drive="odrive")
    none = folder_of(tmp_path / "none", 1)
    foc = folder_of(tmp_path / "foc", 1, drive="simplefoc", encoder_lacking="expected sensor_direction = 1")
    (none / "identified.json").write_text(json.dumps({"encoder": []}))
    cases = {
        (on, "--to", "moteus"): f"{on}: the logs were recorded with an encoder table",
        (other, "--to", "moteus"): "is unknown: its logs are of odrive: expected logs of moteus",
        (none, "--to", "moteus"): "encoder: no order: expected logs that show the encoder's error",
        (on, "--to", "odrive"): "--encoder: odrive: expected a drive whose encoder table",
        (foc, "--to", "simplefoc"): "the encoder's own angle is not known: expected sensor_direction = 1",
        (on, "--to", "moteus", "--shift", "1 deg"): "--encoder: expected only --to and -o with this option",
    }
    for arguments, message in cases.items():
        code, _, err = cogless(capsys, "table", *arguments, "--encoder")
        assert (code, err.count("\n")) == (2, 1) and message in err, err
