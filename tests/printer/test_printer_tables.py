"""A correction in the firmware's own formats: what the firmware makes of it, and what can't be written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from printer.printer_plant import TURN

from cogless.drives.wave_table import DEFAULT_WAVE

FORWARD = {1: 0.012 * np.exp(0.3j), 2: 0.02 * np.exp(-2j), 4: 0.03 * np.exp(0.4j)}
BACKWARD = {1: 0.012 * np.exp(0.5j), 2: 0.02 * np.exp(-1.8j), 4: 0.03 * np.exp(-0.4j)}


def correction_file(folder: Path, scale: float = 1.0) -> Path:
    folder.mkdir()
    tables = {
        name: [
            {"order": n, "magnitude_rad": scale * abs(c), "phase_rad": np.angle(c), "error_rad": 1e-3}
            for n, c in orders.items()
        ]
        for name, orders in (("forward", FORWARD), ("backward", BACKWARD))
    }
    contents = {"motor": "y", "current_A_rms": 0.8, "wavelength_m": 8e-4, "torque_N_m": 0.236, **tables}
    (folder / "correction.json").write_text(json.dumps(contents))
    return folder


def pairs_in(line: str) -> list[tuple[float, float]]:
    return [tuple(map(float, pair.split(","))) for pair in line[len("M973 YF") :].split(" ")]


def test_m973_is_what_the_firmware_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = correction_file(tmp_path / "a"), tmp_path / "table.gcode"
    code, out, err = cogless(capsys, "table", source, "--to", "prusa", "-o", target)
    assert (code, err) == (0, "") and "The firmware's table wraps at 0.195 rad" in out
    for line, letter, orders in zip(target.read_text().splitlines(), "FB", (FORWARD, BACKWARD), strict=True):
        assert line.startswith(f"M973 Y{letter}")
        spectrum = [m * np.exp(1j * p) for m, p in pairs_in(line)]
        assert spectrum == pytest.approx([orders.get(n, 0) for n in range(5)], abs=2e-6)
        # lut.cpp: steps of 1/4096 turn, cut by C, in eight bits.
        u = TURN / 1024 * np.arange(1024)
        shift = sum(np.imag(c * np.exp(1j * n * u)) for n, c in enumerate(spectrum))
        held = np.array([int(s) for s in 4096 / TURN * shift], dtype=np.int8) * TURN / 4096
        assert np.sqrt(np.mean((held - shift) ** 2) / np.mean(shift**2)) < 0.04


def test_m971_stores_each_order_with_phase_stepping_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = correction_file(tmp_path / "a"), tmp_path / "table.gcode"
    assert cogless(capsys, "table", source, "--to", "prusa-m971", "-o", target)[0] == 0
    first, reset, *lines, last = target.read_text().splitlines()
    assert (first, reset, last) == ("M970 Y0", "M971 Y F B R", "M970 Y1")
    assert len(lines) == 6 and lines[2] == "M971 Y F I4 M0.030000 P0.400000"


def test_a_shift_that_wraps_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = correction_file(tmp_path / "a", scale=4.0)
    code, out, err = cogless(capsys, "table", source, "--to", "prusa")
    assert (code, out, err.count("\n")) == (2, "", 1) and "expected 0.195 or less" in err


def registers(lines: list[str]) -> dict[str, int]:
    return {name.removeprefix("driver_"): int(value) for name, value in (line.split(": ") for line in lines)}


def decoded(register: dict[str, int]) -> np.ndarray:
    """The driver's quarter wave by the datasheet's words: widths W by segments, a bit a step."""
    values = [register["START_SIN"]]
    for i in range(256):
        segment = sum(i + 1 >= register[f"X{k}"] for k in (1, 2, 3))
        bit = register[f"MSLUT{i // 32}"] >> i % 32 & 1
        values.append(values[-1] + register[f"W{segment}"] - 1 + bit)
    return np.array(values)


def angle_ahead(quarter: np.ndarray) -> np.ndarray:
    return np.arctan2(quarter, quarter[::-1]) - TURN / 1024 * np.arange(257)


def test_the_default_wave_table_is_a_sine() -> None:
    quarter = decoded(registers(DEFAULT_WAVE.config_lines()))
    sine = 247 * np.sin(TURN / 1024 * np.arange(257))
    assert np.max(np.abs(quarter - sine)) < 1.3 and quarter[-1] == 247
    assert DEFAULT_WAVE.entries() == pytest.approx(quarter)


@pytest.mark.parametrize("chip", ["tmc2130", "tmc5160", "tmc2240"])
def test_a_wave_table_holds_the_sine_of_order_4(
    chip: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = correction_file(tmp_path / "a"), tmp_path / "table.cfg"
    code, out, err = cogless(capsys, "table", source, "--to", chip, "-o", target)
    assert (code, err) == (0, "")
    register = registers(target.read_text().splitlines())
    quarter = decoded(register)
    assert 0 < register["X1"] <= register["X2"] <= register["X3"] <= 255
    assert quarter[-1] == register["START_SIN90"] and np.min(quarter) >= 0 and np.max(quarter) <= 255
    u = TURN / 1024 * np.arange(257)
    held = angle_ahead(quarter) - angle_ahead(decoded(registers(DEFAULT_WAVE.config_lines())))
    mean = 0.03 * np.cos(0.4)
    size = 2 * np.mean((held * np.sin(4 * u))[1:])
    assert size == pytest.approx(mean, abs=1e-3)
    # What is said first is what the registers leave of all orders, in both directions.
    after = sum(
        abs(c - (size if n == 4 else 0)) ** 2 for table in (FORWARD, BACKWARD) for n, c in table.items()
    )
    before = sum(abs(c) ** 2 for table in (FORWARD, BACKWARD) for c in table.values())
    assert out.splitlines()[1].startswith(f"The table lacks {np.sqrt(after / before):.0%} of the correction")


@pytest.mark.parametrize("size", np.linspace(-0.1, 0.1, 9))
def test_a_wave_table_holds_a_tenth_of_a_radian_to_a_thousandth(size: float) -> None:
    from cogless.drives.wave_table import encode, quarter_angles

    wanted = size * np.sin(4 * quarter_angles())
    held = angle_ahead(decoded(registers(encode(wanted).config_lines())))
    assert np.sqrt(np.mean((held - wanted) ** 2)) < 1.5e-3
    assert 2 * np.mean(((held - wanted) * np.sin(4 * quarter_angles()))[1:]) == pytest.approx(0, abs=1e-3)


def test_another_current_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = correction_file(tmp_path / "a")
    code, _, err = cogless(capsys, "table", source, "--to", "prusa", "--current", "1 A")
    assert code == 0 and "for 0.8 A rms: at 1 A it leaves about 25% of the ripple" in err
    assert cogless(capsys, "table", source, "--to", "prusa", "--current", "0.8 A")[2] == ""


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--to", "prusa", "--reverse"], "--reverse: expected no such option with --to prusa"),
        (["--to", "klipper"], "--to: klipper: takes no table: Klipper has no correction of its own"),
        (["--to", "moteus", "--current", "1 A"], "--current: expected no such option with --to moteus"),
        (["--to", "prusa", "--current", "1 V"], '--current: "1 V": expected a current'),
    ],
)
def test_a_wrong_option_is_one_line(
    options: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = cogless(capsys, "table", correction_file(tmp_path / "a"), *options)
    assert (code, err.count("\n")) == (2, 1) and err.startswith(line)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"motor": "x"}', "null"])
def test_a_wrong_correction_is_one_line(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "correction.json"
    path.write_text(text)
    code, _, err = cogless(capsys, "table", tmp_path, "--to", "prusa")
    assert (code, err) == (2, f"{path}: expected what cogless identify --drive klipper or prusa writes\n")


@pytest.mark.parametrize(
    ("options", "kind", "order"),
    [
        (["--spacing", "0.8", "--speed", "50"], "Motor, electrical order 1", 1),
        (["--spacing", ".4 mm", "--speed", "50 mm/s", "--pulley", "20", "--step-angle", "1.8"], "order 2", 2),
        (["--spacing", "0.1", "--speed", "50", "--step-angle", "0.9"], "order 4", 4),
        (["--spacing", "0.283", "--speed", "50", "--diagonal"], "order 2", 2),
        (["--spacing", "2", "--speed", "100"], "Teeth of the belt", 0),
        (["--spacing", "40", "--speed", "100"], "Eccentric pulley", 0),
        (["--spacing", "0.6", "--speed", "30"], "Ringing at 50 Hz", 0),
    ],
)
def test_a_stripe_has_its_cause(
    options: list[str], kind: str, order: int, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = cogless(capsys, "stripe", *options)
    assert (code, err) == (0, "") and kind in out.splitlines()[1]
    assert ("removes it" in out.splitlines()[1]) == bool(order)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--spacing", "0", "--speed", "50"], '--spacing: "0": expected a length above zero'),
        (["--spacing", "0.4 s", "--speed", "50"], '--spacing: "0.4 s": expected a length'),
        (
            ["--spacing", "0.4", "--speed", "50", "--step-angle", "1.7"],
            '--step-angle: "1.7": expected 360 deg',
        ),
    ],
)
def test_a_wrong_stripe_is_one_line(
    options: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = cogless(capsys, "stripe", *options)
    assert (code, out, err.count("\n")) == (2, "", 1) and err.startswith(line)
