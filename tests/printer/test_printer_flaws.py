"""Logs with flaws: gaps, a clipped accelerometer, a clock that is off, a ramp of another speed or way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from printer import printer_bench
from printer.printer_bench import FILE, ramp_records, write_klipper_logs
from printer.printer_plant import study_axes

from cogless.drives.klipper import identify_runs
from cogless.errors import StudyError
from cogless.printer.axis import read_axis
from cogless.printer.corrections import Coefficient

Records = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]
Change = Callable[[np.ndarray], np.ndarray]


@pytest.fixture(scope="module")
def records() -> Records:
    return ramp_records(study_axes(1), 1)


def identified(
    folder: Path, records: Records, change: Change | None = None
) -> dict[tuple[str, int], Coefficient]:
    """Coefficients by direction and order, where `change` is done to the rows of each log."""
    logs = write_klipper_logs(folder, records, 0, np.random.default_rng(5), 0.1)
    for path in logs if change is not None else ():
        heading, *lines = path.read_text().splitlines()
        rows = change(np.array([[float(cell) for cell in line.split(",")] for line in lines]))
        path.write_text("\n".join([heading, *(",".join(f"{x:.6f}" for x in row) for row in rows)]) + "\n")
    (folder / "printer.toml").write_text(FILE)
    directions = identify_runs(logs, read_axis(folder / "printer.toml")).directions
    return {(name, n): entry for name, table in directions.items() for n, entry in table.items()}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, records: Records) -> dict[tuple[str, int], Coefficient]:
    return identified(tmp_path_factory.mktemp("sound"), records)


def gaps(rows: np.ndarray) -> np.ndarray:
    """18 samples are lost out of 700."""
    return rows[(np.arange(len(rows)) - 300) % 700 >= 18]


def clipped(rows: np.ndarray) -> np.ndarray:
    most = 0.97 * np.max(np.abs(rows[:, 1]))
    return np.column_stack([rows[:, 0], np.clip(rows[:, 1], -most, most), rows[:, 2:]])


def with_clock(ratio: float) -> Change:
    """The clock is fast by this ratio."""
    return lambda rows: np.column_stack([ratio * rows[:, 0], rows[:, 1:]])


@pytest.mark.parametrize(("change", "most"), [(gaps, 1.5e-3), (clipped, 1e-5), (with_clock(1.005), 1.6e-3)])
def test_a_small_flaw_moves_the_coefficients_by_less_than_their_errors(
    change: Change,
    most: float,
    sound: dict[tuple[str, int], Coefficient],
    records: Records,
    tmp_path: Path,
) -> None:
    flawed = identified(tmp_path, records, change)
    moves = {key: abs(entry.value - sound[key].value) for key, entry in flawed.items()}
    assert max(moves.values()) < most  # as docs/guide/printers.md says
    assert all(move < sound[key].error for key, move in moves.items())


@pytest.mark.parametrize("ratio", [0.9, 0.97, 1.1])
def test_a_clock_that_is_off_is_one_line(ratio: float, records: Records, tmp_path: Path) -> None:
    with pytest.raises(StudyError) as refused:
        identified(tmp_path, records, with_clock(ratio))
    check_line(str(refused.value), 1 / ratio)


@pytest.mark.parametrize(
    ("speed", "travel"), [(0.15, 0.2), (0.195, 0.2), (0.22, 0.2), (0.2, 0.18), (0.2, 0.21)]
)
def test_a_ramp_that_is_not_the_file_s_is_one_line(
    speed: float, travel: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(printer_bench, "TOP_SPEED", speed)
    monkeypatch.setattr(printer_bench, "TRAVEL", travel)
    with pytest.raises(StudyError) as refused:
        identified(tmp_path, ramp_records(study_axes(1), 1))
    # A way of another length has another acceleration, which goes with the square of the pace.
    check_line(str(refused.value), (speed / 0.2) / np.sqrt(travel / 0.2))


def check_line(line: str, pace: float) -> None:
    assert "ward-plain-1.csv: the move is about " in line and "\n" not in line
    said = float(line.split("is about ")[1].split(" times")[0])
    assert said == pytest.approx(pace, rel=0.07) and (said > 1) == (pace > 1)
