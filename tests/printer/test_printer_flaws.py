"""Logs with flaws, such as gaps, a clipped sensor, a wrong clock, a ramp of another speed, wrong teeth."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from printer import printer_bench
from printer.printer_bench import FILE, SIGNS, ramp_records, write_klipper_logs
from printer.printer_plant import sampled, study_axes

from cogless.drives.klipper import identify_runs
from cogless.errors import StudyError
from cogless.printer.axis import read_axis
from cogless.printer.corrections import Coefficient
from cogless.printer.moves import ramp
from cogless.printer.ramps import HIDDEN_PACE, check_duration, check_pace, find_start
from cogless.printer.records import Run

Records = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]
Change = Callable[[np.ndarray], np.ndarray]


@pytest.fixture(scope="module")
def records() -> Records:
    return ramp_records(study_axes(1), 1)


def identified(
    folder: Path, records: Records, change: Change | None = None, text: str = FILE
) -> dict[tuple[str, int], Coefficient]:
    """Coefficients by direction and order, where `change` is done to the rows of each log."""
    logs = write_klipper_logs(folder, records, 0, np.random.default_rng(5), 0.1)
    for path in logs if change is not None else ():
        heading, *lines = path.read_text().splitlines()
        rows = change(np.array([[float(cell) for cell in line.split(",")] for line in lines]))
        path.write_text("\n".join([heading, *(",".join(f"{x:.6f}" for x in row) for row in rows)]) + "\n")
    (folder / "printer.toml").write_text(text)
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
    assert max(moves.values()) < most
    assert all(move < sound[key].error for key, move in moves.items())


@pytest.mark.parametrize("ratio", [0.9, 0.97, 1.1])
def test_a_clock_that_is_off_is_one_line(ratio: float, records: Records, tmp_path: Path) -> None:
    with pytest.raises(StudyError) as refused:
        identified(tmp_path, records, with_clock(ratio))
    check_line(str(refused.value), 1 / ratio)


@pytest.mark.parametrize(("speed", "travel"), [(0.15, 0.2), (0.195, 0.2), (0.22, 0.2), (0.2, 0.21)])
def test_a_ramp_that_is_not_the_file_s_is_one_line(
    speed: float, travel: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(printer_bench, "TOP_SPEED", speed)
    monkeypatch.setattr(printer_bench, "TRAVEL", travel)
    with pytest.raises(StudyError) as refused:
        identified(tmp_path, ramp_records(study_axes(1), 1))
    # A way of another length has another acceleration, which goes with the square of the pace.
    check_line(str(refused.value), (speed / 0.2) / np.sqrt(travel / 0.2))


@pytest.mark.parametrize("travel", [0.18, 0.22])
def test_a_way_of_another_length_is_seen_in_a_log_of_one_direction(
    travel: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By its time alone, whatever the sensor's scale is; in so much noise that nothing is told it is not."""
    monkeypatch.setattr(printer_bench, "TRAVEL", travel)
    t, values = ramp_records(study_axes(1), 1)["forward", "plain"]
    (tmp_path / "printer.toml").write_text(FILE)
    axis, rng = read_axis(tmp_path / "printer.toml"), np.random.default_rng(1)

    def log(noise: float, scale: float) -> Run:
        times, x = sampled(t, scale * values[:, 0], rng, 3200, noise, start=-0.5, end=t[-1] + 0.3)
        return Run("a.csv", "forward", times, x, {})

    for scale in (0.9, 1.0, 1.1):
        run = log(0.1, scale)
        with pytest.raises(StudyError) as refused:
            check_duration(run, find_start(run, ramp(axis), axis.wavelength), ramp(axis))
        said = re.fullmatch(
            r"a.csv: the move takes about (\d\.\d\d) times as long as the planned 200 mm with up to 200 "
            r"mm/s: expected the --drive-config file of --plan",
            str(refused.value),
        )
        assert said is not None and float(said[1]) == pytest.approx(travel / 0.2, abs=0.03)
    check_duration(log(3.0, 1.0), 0.0, ramp(axis))


def test_a_way_that_is_too_short_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its orders sweep nearly as they should: the pace of the first log looks right."""
    monkeypatch.setattr(printer_bench, "TRAVEL", 0.18)
    with pytest.raises(StudyError) as refused:
        identified(tmp_path, ramp_records(study_axes(1), 1))
    assert re.match(r"\S+forward-plain-1.csv: the move takes about 0.(89|90|91) times", str(refused.value))


@pytest.mark.parametrize("noise", [0.1, 0.3, 1.0, 3.0])
def test_noise_makes_no_move_seem_of_another_time_or_pace(
    noise: float, records: Records, tmp_path: Path
) -> None:
    (tmp_path / "printer.toml").write_text(FILE)
    axis, rng = read_axis(tmp_path / "printer.toml"), np.random.default_rng(2)
    for direction in SIGNS:
        t, values = records[direction, "plain"]
        for _ in range(4):
            times, x = sampled(t, values[:, 0], rng, 3200, noise, start=-0.5, end=t[-1] + 0.3)
            run = Run(direction, direction, times, x, {})
            start = find_start(run, ramp(axis), axis.wavelength)
            assert start == pytest.approx(0.0, abs=0.015)
            check_duration(run, start, ramp(axis))
        check_pace(run, start, ramp(axis), axis.wavelength)


@pytest.mark.parametrize(("noise", "hides"), [(0.1, False), (1.0, False), (3.0, True)])
def test_noise_that_hides_wrong_teeth_is_told(
    noise: float, hides: bool, records: Records, tmp_path: Path
) -> None:
    """With 18 teeth in the file for 20 the log is refused, or the remark says that it may not be."""
    rng = np.random.default_rng(2)
    t, values = records["forward", "plain"]
    times, x = sampled(t, values[:, 0], rng, 3200, noise, start=-0.5, end=t[-1] + 0.3)
    run = Run("a.csv", "forward", times, x, {})
    for teeth in (20, 18):
        (tmp_path / "printer.toml").write_text(FILE.replace("pulley_teeth = 20", f"pulley_teeth = {teeth}"))
        axis = read_axis(tmp_path / "printer.toml")
        start = find_start(run, ramp(axis), axis.wavelength)
        if teeth == 18 and not hides:
            with pytest.raises(StudyError, match=r"^a\.csv: the move is about 0\.\d\d times as fast as "):
                check_pace(run, start, ramp(axis), axis.wavelength)
        else:
            assert check_pace(run, start, ramp(axis), axis.wavelength) == (HIDDEN_PACE if hides else "")


def test_teeth_that_are_wrong_by_2_are_one_line(records: Records, tmp_path: Path) -> None:
    with pytest.raises(StudyError) as refused:
        identified(tmp_path, records, text=FILE.replace("pulley_teeth = 20", "pulley_teeth = 40"))
    assert re.fullmatch(
        r"\S+forward-probe-1.csv: an electrical turn is half as long as with printer.pulley_teeth = 40 and "
        r'printer.step_angle = "1.8 deg", as the effect of the probe shows: '
        r'expected printer.pulley_teeth = 20 or printer.step_angle = "0.9 deg"',
        str(refused.value),
    )


@pytest.mark.parametrize(("noise", "words"), [(3.0, "expected the move"), (0.0, "of the log's energy")])
def test_noise_alone_is_no_move(noise: float, words: str, tmp_path: Path) -> None:
    """Beside noise of a fan nothing is left; without it, what shakes otherwise is none of the orders."""
    (tmp_path / "printer.toml").write_text(FILE)
    axis, rng = read_axis(tmp_path / "printer.toml"), np.random.default_rng(2)
    for _ in range(3):
        times = np.arange(0, 3.2, 1 / 3200)
        x = rng.normal(0, noise, len(times))
        if not noise:
            x[1600:8000] = rng.normal(0, 3.0, 6400)
        with pytest.raises(StudyError) as refused:
            find_start(Run("a.csv", "forward", times, x, {}), ramp(axis), axis.wavelength)
        assert words in str(refused.value)
        lost = re.match(r"a.csv: the motor's orders are lost in noise of 3(\.1)? m/s\^2:", str(refused.value))
        assert (lost is not None) == bool(noise)


def check_line(line: str, pace: float) -> None:
    assert "ward-plain-1.csv: the move is about " in line and "\n" not in line
    said = float(line.split("is about ")[1].split(" times")[0])
    assert said == pytest.approx(pace, rel=0.07) and (said > 1) == (pace > 1)
