"""Pieces of the way from a file to an estimate, each by itself: clocks, angles, units, kernels, errors."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.test_files import COLUMNS, ID, logs

from cogless.errors import StudyError
from cogless.identify import balance, jackknife, plan, steady
from cogless.identify import log as logging
from cogless.identify.config import Identification, LogRule, load
from cogless.identify.kernel import Kernel, shifted
from cogless.identify.log import Log
from cogless.study.position_sensor import Absolute

TURN = 2 * np.pi
NO_GAP = np.zeros(0, dtype=np.int_)
TICK = TURN / 4096
T = np.arange(2000) * 1e-3
THETA = 8.0 * T + 0.5 * np.sin(3.0 * T)
OMEGA = 8.0 + 1.5 * np.cos(3.0 * T)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Identification:
    """4 pole pairs, 10,000 counts."""
    path = tmp_path_factory.mktemp("known") / "id.toml"
    path.write_text(ID.replace("[motor]", 'omega = "omega"\n[motor]'))
    return load(path)


# --- units


@pytest.mark.parametrize(
    ("factor", "cure"),
    [
        (30 / np.pi, 'the speed looks like rpm: unit = "rpm"'),
        (1.04 * 30 / np.pi, 'the speed looks like rpm: unit = "rpm"'),
        (1.07 * 30 / np.pi, ""),
        (180 / np.pi, 'the speed looks like deg/s: unit = "deg/s"'),
        (np.pi / 180, 'the angle looks like degrees: unit = "deg"'),
        (1 / TURN, 'the speed looks like revolutions: unit = "rev/s"'),
        (TURN, 'the angle looks like revolutions: unit = "rev"'),
        (1e3, 'the time looks like milliseconds: unit = "ms"'),
        (0.9505e3, 'the time looks like milliseconds: unit = "ms"'),
        (0.9495e3, ""),
        (1e6, 'the time looks like microseconds: unit = "us"'),
        (-1.0, "one of them counts backwards: sign = -1"),
        (1 / 4, "the angle looks electrical: scale = 1/4"),
        (1.55, ""),
        (1 / 1.55, ""),
    ],
)
def test_a_speed_that_is_no_change_of_the_angle_is_told_what_it_looks_like(
    known: Identification, factor: float, cure: str
) -> None:
    with pytest.raises(StudyError) as error:
        logging._units_agree("a", T, {"omega": factor * OMEGA, "theta": THETA}, known)
    end = f"; {cure}" if cure else ""
    assert str(error.value) == (
        f"a: omega is {factor:.4g} times the change of counts over ms: expected units that agree{end}"
    )


def test_counts_of_other_bits_are_told(known: Identification) -> None:
    """Of 14 bits, taken for 12, here beside 4 pole pairs."""
    sensor = Absolute(kind="absolute", bits=12)
    twelve: Any = SimpleNamespace(
        step=1e-3, columns=known.columns, motor=known.motor, drive=SimpleNamespace(position_sensor=sensor)
    )
    for factor, bits in ((0.125, 15), (0.25, 14), (2.0, 11)):
        with pytest.raises(StudyError, match=rf"the counts look like those of \S+\.bits = {bits}$"):
            logging._units_agree("a", T, {"omega": factor * OMEGA, "theta": THETA}, twelve)


def test_a_speed_may_lag_lose_counts_and_stop_for_a_gap(known: Identification) -> None:
    def agree(t: np.ndarray, omega: np.ndarray, theta: np.ndarray = THETA) -> None:
        logging._units_agree("a", t, {"omega": omega, "theta": theta}, known)

    for factor in (1.45, 1.0, 1 / 1.45):
        agree(T, factor * OMEGA)
    agree(np.where(T < 1, T, T + 5.0), OMEGA)  # it stands in between
    agree(T, 100 * OMEGA, 0.01 * THETA)  # about 0.05 rad: it hardly turns
    agree(T, np.where(T > 0, OMEGA, 1e5))  # its first value means nothing
    logging._units_agree("a", T, {"theta": THETA}, known)


@pytest.mark.parametrize(("counts", "told"), [(1.05, False), (0.95, True)])
def test_a_rotor_that_turns_by_less_than_twenty_counts_tells_no_unit(
    known: Identification, counts: float, told: bool
) -> None:
    """Rms, about its mean."""
    step = counts * float(np.std(THETA[1:])) / 20
    coarse: Any = SimpleNamespace(step=step, columns=known.columns, motor=known.motor, drive=known.drive)
    with pytest.raises(StudyError) if told else nullcontext():
        logging._units_agree("a", T, {"omega": 100 * OMEGA, "theta": THETA}, coarse)


def test_a_current_beyond_three_times_the_drive_s_limit_is_in_another_unit(tmp_path: Path) -> None:
    """0.3 A here; signals that are not in the log are not beyond it."""
    (tmp_path / "id.toml").write_text(
        ID.replace('"10 A"', '"0.3 A"').replace("[motor]", 'i_d = "direct"\n[motor]')
    )
    small = load(tmp_path / "id.toml")
    for most in (0.89, -0.89):
        logging._within_limit("a", {"i_q": np.array([0.0, most])}, small)
    for signal, heading in (("i_q", "current"), ("i_d", "direct"), ("i_b", "columns.i_b")):
        with pytest.raises(StudyError) as error:
            logging._within_limit("a", {signal: np.array([0.0, 0.5, -0.91])}, small)
        assert str(error.value) == (
            f"a: {heading}: row 3: 0.91 A, where the drive's limit is 0.3 A: expected the column's unit, "
            'such as unit = "mA"'
        )


def test_a_current_in_rms_is_told_beside_phases_alone_and_with_its_other_axis(known: Identification) -> None:
    a, b = np.sin(THETA), np.sin(THETA - TURN / 3)
    for found in (
        {"i_q": np.full(2000, math.sqrt(0.5)), "i_a": a, "i_b": b},
        {"i_q": np.full(2000, 0.5), "i_d": np.full(2000, 0.5), "i_a": a, "i_b": b, "i_c": -a - b},
    ):
        with pytest.raises(StudyError, match=r"^a: current is \S+ of the amplitude that columns.i_a and"):
            logging._amplitudes_agree("a", found, known)
        logging._amplitudes_agree("a", {**found, "i_q": np.ones(2000)}, known)
        for still in ({"i_a": 0 * a, "i_b": 0 * b, "i_c": 0 * b}, {"i_q": 0 * a, "i_d": 0 * a}):
            logging._amplitudes_agree("a", {**found, **still}, known)


def test_a_run_s_currents_are_turned_to_the_angle_that_its_drive_measures(tmp_path: Path) -> None:
    """If the measured angle is ahead by a, i_d + j i_q becomes (i_d + j i_q) e^(-j p a)."""
    import netCDF4

    (tmp_path / "id.toml").write_text(
        ID.replace('{ name = "counts", unit = "count" }', '"angle"')
        .replace('{ name = "current", unit = "mA", sign = -1 }', '"i_q"')
        .replace("[motor]", 'i_d = "i_d"\n[motor]')
    )
    known, angle = load(tmp_path / "id.toml"), 0.01 * np.arange(1000)
    made = {
        "ms": COLUMNS["ms"], "angle": angle, "theta_m": angle - math.pi / 16, "i_q": 2 + 0 * angle,
        "i_d": 1 + 0 * angle,
    }  # fmt: skip
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as file:
        run = file.createGroup("slow").createGroup("pi")
        run.createDimension("time", 1000)
        for name, x in made.items():
            run.createVariable(name, "f8", ("time",))[:] = x
    np.savez(tmp_path / "a.npz", **made)  # in a file of another kind they are turned already
    (run, other) = logging.load_logs([tmp_path / "a.nc", tmp_path / "a.npz"], known)
    assert (run.name, other.name, run.duration) == ("slow", "a.npz", pytest.approx(1.0))
    turned = (1 + 2j) * np.exp(-1j * math.pi / 4)
    assert (run["i_d"][7], run["i_q"][7]) == pytest.approx((turned.real, turned.imag))
    assert (other["i_d"][7], other["i_q"][7]) == (1.0, 2.0)


# --- clocks


def test_a_clock_that_jitters_is_brought_to_equal_times() -> None:
    """Below 2 % of a period nothing moves; nor where times are rounded to steps larger than their jitter."""
    even = np.arange(1000) * 1e-3
    noise = np.random.default_rng(0).normal(size=1000)
    kept, use = logging._even(even + 1e-5 * noise, {"x": even}, 1e-3)
    assert kept["x"] is even and use == logging.EVEN_ROWS
    moved, use = logging._even(even + 5e-5 * noise, {"x": even + 5e-5 * noise}, 1e-3)
    assert use == logging.OWN_TIMES
    assert np.diff(moved["x"]) == pytest.approx(1e-3, rel=1e-3)
    assert (len(moved["x"]), moved["x"][0]) == (999, pytest.approx(5e-5 * noise[0]))
    grained = 5e-5 * np.round((even + 3e-5 * noise) / 5e-5)  # rounded by far less than a period
    moved, _ = logging._even(grained, {"x": even}, 1e-3)
    assert moved["x"] is not even
    rounded = np.round(np.arange(1000) * 2.4e-3, 3)
    kept, use = logging._even(rounded, {"x": even}, 2e-3)
    assert kept["x"] is even and use == logging.EVEN_ROWS


def test_what_is_told_of_uneven_rows_is_their_spacing(tmp_path: Path) -> None:
    """Rows as USB answers, 1.6 to 2.4 ms apart: their times wander by more than that from a straight line."""
    t = 0.2 * np.cumsum(np.random.default_rng(2).integers(8, 13, 1000))
    rows = np.arange(1000)
    assert np.std(t - np.polyval(np.polyfit(rows, t, 1), rows)) > 1.0
    (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": t})
    line = "a.npz: rows are 2 ms apart, with a spread of 0.28 ms rms; each row is used at its own time."
    assert line in log.remarks


def test_the_period_is_that_between_gaps() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.2, 10.0, 11.0])
    assert logging._period(t, 1.0) == pytest.approx((1 + 1 + 1.2 + 1) / 4)


@pytest.mark.parametrize(("step", "cut"), [(2.5, False), (2.6, True)])
def test_more_than_two_and_a_half_periods_between_rows_are_a_gap(
    tmp_path: Path, step: float, cut: bool
) -> None:
    (tmp_path / "id.toml").write_text(ID.replace('{ name = "ms", unit = "ms" }', '"ms"'))
    t = np.concatenate((np.arange(400.0), 399 + step + np.arange(600)))
    np.savez(tmp_path / "a.npz", **{**COLUMNS, "ms": t})
    (log,) = logging.load_logs([tmp_path / "a.npz"], load(tmp_path / "id.toml"))
    assert log.stretches == ((slice(0, 400), slice(400, 1000)) if cut else (slice(0, 1000),))
    gaps = [line for line in log.remarks if "gaps" in line]
    assert gaps == ["a.npz: 1 gaps, the longest 2.6 s; the log is cut at each gap."] * cut


def test_half_of_the_rows_may_have_the_time_of_the_row_before(tmp_path: Path) -> None:
    twice = {name: np.repeat(values[:500], 2) for name, values in COLUMNS.items()}
    (log,) = logs(tmp_path, "a.npz", twice)
    assert len(log) == 500
    assert log.remarks[0] == "a.npz: 500 rows have the time of the row before and are left out."
    twice["ms"][-2:] = twice["ms"][-3]
    with pytest.raises(StudyError) as error:
        logs(tmp_path, "a.npz", twice)
    assert str(error.value) == (
        f"{tmp_path / 'a.npz'}: ms: 501 of 1000 rows have the time of the row before: expected all digits of "
        "the time"
    )


def test_a_hundred_rows_are_a_log(tmp_path: Path) -> None:
    (log,) = logs(tmp_path, "a.npz", {key: x[:100] for key, x in COLUMNS.items()})
    assert len(log) == 100


def test_an_uneven_spacing_of_rows_is_told_from_a_twentieth_of_a_period_of_jitter_on(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).normal(size=1000)
    noise /= np.std(noise)
    for share, told in ((0.045, False), (0.06, True)):
        (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": COLUMNS["ms"] + share * noise})
        said = [line for line in log.remarks if "apart" in line]
        line = "a.npz: rows are 1 ms apart, with a spread of 0.085 ms rms; each row is used at its own time."
        assert said == [line] * told


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({**COLUMNS, "ms": np.zeros(1000)}, "ms: never changes: expected changing values of t"),
        (
            {**COLUMNS, "counts": np.full(1000, 7.0)},
            "counts: never changes: expected changing values of theta",
        ),
        ({key: x[:99] for key, x in COLUMNS.items()}, "99 rows: expected 100 or more"),
        (
            {key: x for key, x in COLUMNS.items() if key != "ms"},
            'no column "ms" (t); it has "counts", "current": expected in [columns] a heading that this '
            "file has",
        ),
        (
            {**COLUMNS, "ms": np.arange(1000) + 10.0 * (np.arange(1000) // 90)},
            "fewer than 100 rows between its gaps: expected a log with fewer gaps",
        ),
        (
            {**COLUMNS, "counts": COLUMNS["counts"] + 1500.0 * (np.arange(1000) >= 60)},
            "counts: row 61: the angle jumps after only 60 rows: expected 100 or more before a jump, "
            "and an encoder's angle, not one of Hall sensors",
        ),
    ],
)
def test_a_log_that_cannot_be_used_says_why(
    tmp_path: Path, columns: dict[str, np.ndarray], says: str
) -> None:
    with pytest.raises(StudyError) as error:
        logs(tmp_path, "a.npz", columns)
    assert str(error.value) == f"{tmp_path / 'a.npz'}: {says}"


def test_the_same_log_twice_is_refused(tmp_path: Path) -> None:
    logs(tmp_path, "a.npz")
    with pytest.raises(StudyError, match=r"^a.npz: given twice: expected each log once$"):
        logging.load_logs([tmp_path / "a.npz"] * 2, load(tmp_path / "id.toml"))


def test_parts_of_a_file_are_logs_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "id.toml").write_text(ID.replace("[motor]", 'part = "run"\n[motor]'))
    np.savez(tmp_path / "a.npz", **COLUMNS, run=np.repeat([2.0, 1.0, 7.5], [200, 300, 500]))
    found = logging.load_logs([tmp_path / "a.npz"], load(tmp_path / "id.toml"))
    assert [(log.name, len(log)) for log in found] == [("a.npz#1", 300), ("a.npz#2", 200), ("a.npz#7.5", 500)]


def test_a_hold_map_needs_the_direction_that_the_rotor_came_from(tmp_path: Path) -> None:
    text = ID.replace('t = { name = "ms", unit = "ms" }\n', "").replace(
        "[motor]", 'direction = "from"\n[motor]'
    )
    text += '[[log]]\nfile = "a*"\nkind = "hold"\n'
    (tmp_path / "id.toml").write_text(text)
    hold = {key: COLUMNS[key] for key in ("counts", "current")}
    np.savez(tmp_path / "a.npz", **hold, **{"from": np.where(COLUMNS["ms"] < 500, -3.0, 0.5)})
    (log,) = logging.load_logs([tmp_path / "a.npz"], load(tmp_path / "id.toml"))
    assert log.dt == 0 and log.stretches == (slice(0, 1000),)
    assert log["direction"].tolist() == [-1.0] * 500 + [1.0] * 500
    np.savez(tmp_path / "a.npz", **hold)
    text = text.replace('direction = "from"\n', "")
    needs = "columns.direction: missing: a hold map needs theta, i_q and direction"
    for kind, said in (("hold", needs), ("load", "columns.t: missing: expected the time of each row")):
        (tmp_path / "id.toml").write_text(text.replace("hold", kind))
        with pytest.raises(StudyError, match=said):
            logging.load_logs([tmp_path / "a.npz"], load(tmp_path / "id.toml"))


# --- angles


def test_a_gap_is_no_slip_and_no_other_unit() -> None:
    """In a gap a rotor moves any angle: what follows stays."""
    theta = 0.02 * np.arange(500)
    theta[200:] += 13.5
    theta[350:] += 13.6
    remarks: list[str] = []
    gaps = np.array([200, 350])
    unwrapped = logging._unwrapped("a", "a: x", theta, gaps, remarks, TICK)
    assert logging._slip("a", unwrapped, 5e-4, gaps, remarks) == 500
    assert not remarks


@pytest.mark.parametrize(("jump", "slips"), [(0.015, False), (0.025, True), (-0.025, True)])
def test_an_angle_slips_where_it_jumps_by_ten_times_the_rows_around(jump: float, slips: bool) -> None:
    """Rows of 1 mrad and counts of 0.5 mrad: beyond 10 + 10 + 1 mrad it is no rotor."""
    theta = 1e-3 * np.arange(500) + jump * (np.arange(500) >= 300)
    remarks: list[str] = []
    assert logging._slip("a", theta, 5e-4, NO_GAP, remarks) == (300 if slips else 500)
    degrees = math.degrees(jump + 1e-3)
    assert (
        remarks
        == [
            f"a: row 301: the angle jumps by {degrees:.2g} deg: the encoder's index has slipped, or counts "
            "are lost; the rows after it are left out."
        ]
        * slips
    )


@pytest.mark.parametrize("apart", [2, 3])
def test_rows_that_move_alike_within_two_of_each_other_are_no_slip(apart: int) -> None:
    rows = np.arange(500)
    theta = 1e-3 * rows + 0.025 * ((rows >= 300) * 1.0 + (rows >= 300 + apart))
    assert logging._slip("a", theta, 5e-4, NO_GAP, []) == (500 if apart == 2 else 300)


@pytest.mark.parametrize(("share", "told"), [(0.19, False), (0.21, True)])
def test_rows_that_repeat_are_told_from_a_fifth_on(share: float, told: bool) -> None:
    moved = np.ones(1000)
    moved[: round(1000 * share)] = 0.0
    theta = np.concatenate(([0.0], np.cumsum(moved)))
    remarks: list[str] = []
    logging._repeats("a", {"theta": theta, "i_q": theta}, 0.1, remarks)
    expected = "a: 21 % of the rows repeat the row before: the log has more rows than the drive has samples."
    assert remarks == [expected] * told
    logging._repeats("a", {"theta": theta, "i_q": theta}, 1.0, slow := [])  # a count lasts longer than a row
    logging._repeats("a", {"theta": theta, "i_q": np.arange(1001.0)}, 0.1, slow)  # a new current in each row
    assert slow == []


def test_an_angle_that_wraps_is_unwrapped_and_one_of_no_turn_is_refused() -> None:
    remarks: list[str] = []
    theta = np.arange(1000) * 0.05
    assert logging._unwrapped("a", "a: x", theta % TURN, NO_GAP, remarks, TICK) == pytest.approx(theta)
    assert remarks == ["a: the angle wraps 7 times, and is unwrapped."]
    with pytest.raises(StudyError) as error:
        logging._unwrapped("a", "a: x", theta % 10.0, NO_GAP, remarks, TICK)
    assert str(error.value) == (
        "a: x: row 201: the angle jumps by 9.95 rad, which is not a whole turn: expected its unit, such "
        "as unit = "
        '"deg", or counts that do not overflow'
    )
    logging._unwrapped("a", "a: x", np.array([0.0, math.pi, 0.0]), NO_GAP, half := [], TICK)
    assert half == []


@pytest.mark.parametrize("counts", [10_000, 16_384, 60_000])
@pytest.mark.parametrize(("size", "way"), [(2**16, 1.0), (2**16, -1.0), (2**32, 1.0)])
def test_a_count_that_overflows_after_several_turns_is_laid_end_to_end(
    counts: int, size: int, way: float
) -> None:
    tick, remarks = TURN / counts, list[str]()
    true = np.round(way * np.arange(4000) * 0.05 / tick)
    logged = (true + size - 1000) % size
    theta = logging._unwrapped("a", "a: x", tick * logged, NO_GAP, remarks, tick)
    assert theta - theta[0] == pytest.approx(tick * true, abs=1e-4)
    times = np.sum(np.abs(np.diff(logged)) > size // 2)
    assert times and remarks == [f"a: the count overflows {times} times, at {size}, and is unwrapped."]


# --- steady parts


def test_the_longest_run_of_true() -> None:
    def longest(text: str) -> list[int]:
        return steady._longest(np.array([c == "x" for c in text])).tolist()

    assert longest("..xx.xxx.x") == [5, 6, 7]
    assert longest("xx..xx") == [0, 1] and longest("....") == [] and longest("..x") == [2]


def part(speed: float = 6.0, **waves: float) -> steady.Steady:
    """Five seconds at a speed, with waves of it by order."""
    t = np.arange(5000) * 1e-3
    theta = speed * t
    noise = np.random.default_rng(0).normal(0, 0.01, 5000)
    omega = speed + noise + sum(size * np.cos(int(n) * theta + 0.7) for n, size in waves.items())
    theta = theta + sum(size / (int(n) * speed) * np.sin(int(n) * theta + 0.7) for n, size in waves.items())
    signals = {"theta": theta, "omega": omega, "i_q": 0.2 + 0 * t}
    whole = Log("a", LogRule(file="*"), 1e-3, signals, (slice(0, 5000),))
    (found,) = steady.steady(whole)
    return found


def test_waves_of_a_steady_part_have_their_size_and_phase() -> None:
    found = part(**{"6": 0.3, "24": 0.1})
    assert found.orders[:2] == (6, 24)
    for order, size in ((6, 0.3), (24, 0.1)):
        assert found.motion(order) == pytest.approx(size * np.exp(0.7j), abs=6e-3)
    assert found.motion(11) == 0.0 and found.logged_ripple == pytest.approx(0.224, rel=0.02)
    assert (found.speed, found.load, found.current) == pytest.approx((6.0, 0.2, 0.2), rel=1e-3)
    assert found.ripple == pytest.approx(math.sqrt((0.09 + 0.01) / 2), rel=0.03)
    back = part(-6.0, **{"6": 0.3})
    assert (back.speed, back.load, back.current) == pytest.approx((-6.0, -0.2, 0.2), rel=1e-3)


def test_an_order_is_visible_up_to_half_of_the_rows_rate() -> None:
    """1000 rows a second: 500 Hz, at 6 rad/s order 523."""
    assert part().visible(523) and not part().visible(524)


def test_parts_turn_for_a_revolution_at_one_speed() -> None:
    t = np.arange(3000) * 1e-3
    for turned, parts in ((1.05, 1), (0.95, 0)):
        theta = turned * TURN * t / t[-1]
        log = Log("a", LogRule(file="*"), 1e-3, {"theta": theta}, (slice(0, 3000),))
        found = list(steady.steady(log))
        assert len(found) == parts and all(math.isnan(each.load) for each in found)
    both = Log("a", LogRule(file="*"), 1e-3, {"theta": 10 * np.minimum(t, 3 - t)}, (slice(0, 3000),))
    assert [round(each.speed) for each in steady.steady(both)] == [10, -10]


def test_a_vibration_within_a_fifth_of_a_second_leaves_the_speed_steady() -> None:
    t = np.arange(3000) * 1e-3
    for hertz, whole in ((5.0, True), (3.0, False)):
        theta = 10 * t - 5 / (TURN * hertz) * np.cos(TURN * hertz * t)  # half the speed
        log = Log("a", LogRule(file="*"), 1e-3, {"theta": theta}, (slice(0, 3000),))
        assert (max((len(each.rows) for each in steady.steady(log)), default=0) > 2700) == whole


def test_speeds_within_a_tenth_of_the_usual_one_are_steady() -> None:
    """At any speed. Here it changes after two thirds of the log."""
    t = np.arange(3000) * 1e-2
    for speed, more, share in ((10.0, 0.08, 1.0), (10.0, 0.15, 2 / 3), (0.5, 0.0, 1.0)):
        theta = speed * (t + more * np.maximum(0.0, t - 20))
        log = Log("a", LogRule(file="*"), 1e-2, {"theta": theta}, (slice(0, 3000),))
        (found,) = steady.steady(log)
        assert len(found.rows) == pytest.approx(3000 * share, abs=20)


def test_a_part_has_twenty_rows_and_an_angle_from_the_speed_where_none_was_recorded() -> None:
    for rows, parts in ((20, 1), (19, 0)):
        theta = 1.05 * TURN * np.arange(rows) / (rows - 1)
        log = Log("a", LogRule(file="*"), 1e-3, {"theta": theta}, (slice(0, rows),))
        assert len(list(steady.steady(log))) == parts and steady.with_angle(log) is log
    alone = Log("a", LogRule(file="*"), 1e-2, {"omega": np.array([3.0, 4.0])}, (slice(0, 2),))
    assert steady.with_angle(alone)["theta"] == pytest.approx([0.03, 0.07])
    none = replace(alone, signals={"i_q": np.zeros(2)})
    assert steady.with_angle(none) is none


# --- the balance


def test_a_kernel_smooths_and_derives_a_parabola_exactly() -> None:
    """Of 2 + 3 x + 4 x^2: itself but for the kernel's width, its slope, and twice 4."""
    kernel = Kernel(6e-3, 1e-3)
    assert kernel.half == 24 and len(kernel.value) == 49 and Kernel(6.1e-3, 1e-3).half == 25
    t = (np.arange(49) - 24) * 1e-3
    assert kernel.slope == pytest.approx(t * kernel.value / np.sum(t**2 * kernel.value))
    late = Kernel(6e-3, 1e-3, 2.5e-3)  # the derivatives of its angle are those of 2.5 ms before
    assert late.half == 27
    x = np.arange(200) * 1e-3
    signal = 2 + 3 * x + 4 * x**2
    middle = x[24:-24]
    width = float(kernel.value @ ((np.arange(49) - 24) * 1e-3) ** 2)
    assert width == pytest.approx(6e-3**2, rel=2e-3)
    assert kernel.filter(signal, kernel.value, 1) == pytest.approx(2 + 3 * middle + 4 * (middle**2 + width))
    assert kernel.filter(signal, kernel.slope, 1) == pytest.approx(3 + 8 * middle)
    assert kernel.filter(signal, kernel.curvature, 1) == pytest.approx(8.0 + 0 * middle)
    before = x[27:-27] - 2.5e-3
    assert late.filter(signal, late.speed, 1) == pytest.approx(3 + 8 * before, abs=1e-3)
    assert late.filter(signal, late.acceleration, 1) == pytest.approx(8.0 + 0 * before)
    for step in (2, 5, 7):
        assert kernel.filter(signal, kernel.slope, step) == pytest.approx(
            kernel.filter(signal, kernel.slope, 1)[::step]
        )


def test_rows_that_hold_the_rotor_are_filtered_where_they_have_times() -> None:
    """A map of held angles is taken as it is; stretches of four half kernels or less are left out."""
    theta = 3.0 * np.arange(3000) * 1e-3
    signals = {"theta": theta, "i_q": 0.1 + 0 * theta, "direction": 1 + 0 * theta}
    held = Log("a", LogRule(file="*", kind="hold"), 0.0, signals, (slice(0, 3000),))
    sensor, model = balance.Sensor(0.0, 4), balance.Model()
    (found,) = balance.rows_of(held, model, sensor)
    assert len(found.y) == 3000
    stretches = (slice(0, 96), slice(100, 197), slice(200, 2900), slice(2985, 2995))
    timed = replace(held, dt=1e-3, stretches=stretches)
    rows = [len(each.y) for each in balance.rows_of(timed, model, sensor)]
    assert len(rows) == 2 and sum(rows) < 1000


def test_a_signal_is_moved_by_parts_of_a_row() -> None:
    x = np.arange(50.0)
    wave = x**2
    assert shifted(wave, 0.0) is wave
    quick = np.sin(0.8 * x)
    assert shifted(quick, -0.4)[5:-5] == pytest.approx(np.sin(0.8 * (x - 0.4))[5:-5], abs=2e-4)
    assert shifted(wave, 3.0)[5:-5] == pytest.approx(((x + 3) ** 2)[5:-5])
    assert shifted(wave, 2.25)[5:-7] == pytest.approx(((x + 2.25) ** 2)[5:-7])
    assert shifted(wave, -1.5)[6:-6] == pytest.approx(((x - 1.5) ** 2)[6:-6])
    assert shifted(wave, 3.0)[-1] == wave[-1] and shifted(wave, -3.0)[0] == wave[0]


# --- errors


def test_leaving_one_out_gives_the_error_of_a_mean() -> None:
    x = np.random.default_rng(0).normal(size=12)
    without = (x.sum() - x) / 11
    error = jackknife.jackknife(without[:, None])
    assert error == pytest.approx(np.std(x, ddof=1) / math.sqrt(12))


def test_columns_alike_inflate_each_others_variance() -> None:
    """By 1 / (1 - r^2) with a correlation r; a column of zeros can't be told."""
    r = 0.8
    matrix = np.array([[4.0, 2 * 3 * r, 0.0], [2 * 3 * r, 9.0, 0.0], [0.0, 0.0, 0.0]])
    factors = jackknife.inflation(matrix)
    assert factors[:2] == pytest.approx(1 / (1 - r**2)) and math.isinf(factors[2])
    values, _ = jackknife.solved(matrix, np.array([8.0, 0.0, 0.0]))
    assert matrix @ values == pytest.approx([8.0, 0.0, 0.0]) and values[2] == 0.0


@pytest.mark.parametrize(
    ("loop", "wave", "rate"),
    [
        (10e3, 300.0, 1000.0),
        (10e3, TURN * 299.0, 1000.0),
        (10e3, TURN * 301.0, 1250.0),
        (10e3, TURN * 1e4, 10e3),
        (8e3, TURN * 310.0, 1600.0),
    ],
)
def test_rows_of_a_plan_show_its_fastest_wave(loop: float, wave: float, rate: float) -> None:
    """A third of the rate shows; nine tenths of that is planned with."""
    assert plan._rate(loop, wave) == pytest.approx(rate)


@pytest.mark.parametrize(
    ("unit", "period", "times"),
    [
        ("us", 2**16, 30),  # a 16-bit timer
        ("us", 2**32, 1),  # micros() of a microcontroller
        ("s", 2**32 * 1e-6, 1),  # the same, as seconds
        ("ms", 86_400_000, 1),  # of the day
    ],
)
def test_a_clock_that_begins_anew_is_laid_end_to_end(unit: str, period: float, times: int) -> None:
    """Where another time is missing, as after a restart, the log has two clocks."""
    factor = {"us": 1e-6, "ms": 1e-3, "s": 1.0}[unit]
    known: Any = SimpleNamespace(factor=lambda signal: factor)
    remarks: list[str] = []
    start = period - 0.3 / factor if times == 1 else 0.0
    t = factor * ((T / factor + start) % period)
    whole = logging._one_clock("a.csv", t, known, remarks)
    assert whole - whole[0] == pytest.approx(T, abs=1e-6)
    assert remarks == [
        f"a.csv: the time begins again {times} times, after {period * factor:.7g} s; the parts are "
        "joined end to end."
    ]
    restarted = np.concatenate([T[:1000], T[:500]])
    assert logging._one_clock("a.csv", restarted, known, remarks) is restarted and len(remarks) == 1
