"""Tables for firmware of one's own, for AKD and AX8000, and the tests that their manuals leave open."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import TURN
from drives.test_simplefoc import COMPILER, compiled, needs_compiler

ANGLES = TURN / 2048 * np.arange(2048)
K_T = 0.03
ORDERS = {12: (5e-3, 0.4), 84: (4e-3, 1.1), 24: (1.5e-3, -2.0)}  # N m, rad


def current_at(angle: np.ndarray) -> np.ndarray:
    """What holds the rotor, A."""
    return -sum(size / K_T * np.sin(n * angle + phase) for n, (size, phase) in ORDERS.items())


@pytest.fixture
def found(tmp_path: Path) -> Path:
    """What identify writes of the cogging."""
    folder = tmp_path / "found"
    folder.mkdir()
    cogging = [{"order": n, "amplitude_N_m": a, "phase_rad": p} for n, (a, p) in ORDERS.items()]
    (folder / "identified.json").write_text(json.dumps({"K_t_N_m_per_A": K_T, "cogging": cogging}))
    return folder


def left(applied: np.ndarray) -> float:
    """Share of the holding current's rms that is left."""
    return float(np.std(current_at(ANGLES) - applied) / np.std(current_at(ANGLES)))


@needs_compiler
def test_a_header_holds_the_rotor(found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header = tmp_path / "cogging.h"
    code, out, err = cogless(capsys, "table", found, "--to", "c", "-o", header)
    assert (code, err) == (0, "") and COMPILER and f"#include {header}" in out
    feed = compiled(header, tmp_path)
    assert left(np.array([feed(angle - 3 * TURN) for angle in ANGLES])) < 0.02
    for name, value in (("third", 0.3), ("minus", -0.3), ("none", 0.0)):
        folder = tmp_path / name
        folder.mkdir()
        other = folder / "cogging.h"
        other.write_text(header.read_text().replace("COGGING_SHARE 1.0f", f"COGGING_SHARE {value}f"))
        shared = compiled(other, folder)
        assert left(np.array([shared(angle) for angle in ANGLES])) == pytest.approx(1 - value, abs=0.01)


def test_akd_gets_its_entries(found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "akd.csv"
    code, _, err = cogless(capsys, "table", found, "--to", "akd", "-o", table)
    assert code == 2 and "--shift ANGLE" in err and not table.exists()
    options = ["--to", "akd", "--shift", "30 deg", "-o", table]
    code, out, err = cogless(capsys, "table", found, *options)
    assert (code, err) == (0, "") and "8192 entries" in out and "peak or rms" in out
    values = np.array([float(line) for line in table.read_text().splitlines()])
    assert len(values) == 8192
    at_angles = values[np.round((ANGLES / TURN + 30 / 360) * 8192).astype(int) % 8192]
    assert left(at_angles) < 0.03
    # A drive whose currents are rms makes them larger: then 71 % of the table leaves less than all of it.
    assert left(0.71 * np.sqrt(2) * at_angles) < 0.05 < left(np.sqrt(2) * at_angles)
    assert left(0.71 * at_angles) > left(at_angles)


CONVENTIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "cosine": np.cos,
    "minus cosine": lambda x: -np.cos(x),
    "sine": np.sin,
    "minus sine": lambda x: -np.sin(x),
}


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_ax8000_finds_its_phase_by_the_test_that_is_printed(
    convention: str, found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "ax8000.txt"
    options = ["--to", "ax8000", "--shift", "0 deg", "-o", table]
    code, out, err = cogless(capsys, "table", found, *options)
    assert (code, err) == (0, "") and "3 entries" in out
    assert "add 0, 90, 180 and 270 deg to the order's phase" in out
    values = dict(re.findall(r"^:(\d+) \S+ (\S+)$", table.read_text(), re.MULTILINE))
    assert values["01"] == "3"
    wave = CONVENTIONS[convention]
    best = {}
    for first in (7, 10, 13):
        order, phase, torque = (float(values[f"{n:02d}"]) for n in (first, first + 1, first + 2))
        rests = {}
        for more in (0, 90, 180, 270):
            drive = 0.3 * torque / K_T * wave(order * ANGLES + np.radians(phase + more))
            spectrum = np.fft.rfft(current_at(ANGLES) - drive)
            rests[more] = abs(spectrum[int(order)])
        best[int(order)] = more = min(rests, key=lambda key: rests[key])
        values[f"{first + 1:02d}"] = str(phase + more)
    assert set(best) == set(ORDERS) and len(set(best.values())) == 1
    rows = [[float(values[f"{n + k:02d}"]) for k in range(3)] for n in (7, 10, 13)]
    assert left(sum(r / K_T * wave(n * ANGLES + np.radians(phase)) for n, phase, r in rows)) < 1e-4


def test_ax8000_holds_ten_orders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "found"
    folder.mkdir()
    cogging = [{"order": 12 * n, "amplitude_N_m": 1e-3 / n, "phase_rad": 0.3} for n in range(1, 20)]
    (folder / "identified.json").write_text(json.dumps({"K_t_N_m_per_A": K_T, "cogging": cogging}))
    table = tmp_path / "table.txt"
    code, out, _ = cogless(capsys, "table", folder, "--to", "ax8000", "--shift", "0 deg", "-o", table)
    assert code == 0 and "10 entries" in out and "most of it in order 132" in out
    assert table.read_text().count("UINT32") == 10


def test_torques_need_their_constant(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table.csv"
    rows = (f"{360 * n / 720:.9g},{i:.9g}" for n, i in enumerate(current_at(TURN / 720 * np.arange(720))))
    table.write_text("angle [deg],current [A]\n" + "\n".join(rows) + "\n")
    options = ["--from", "csv", "--to", "ax8000", "--shift", "0 deg"]
    code, _, err = cogless(capsys, "table", table, *options)
    assert code == 2 and f"{table}: no K_t: AX8000 takes torques" in err and err.count("\n") == 1
