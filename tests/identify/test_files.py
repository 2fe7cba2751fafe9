"""The same log from every kind of file, with units, counts, wraps, gaps and a rounded clock."""

from __future__ import annotations

import gzip
import os
import tomllib

import numpy as np
import pytest

from cogless.errors import StudyError
from cogless.identify import config, csv_log, plan
from cogless.identify.advice import AdvisedError, changed
from cogless.identify.log import load_logs
from cogless.identify.log_files import readable
from cogless.identify.read_log import read

KINDS = ("a.csv", "a.csv.gz", "a.npz", "a.mat", "a.parquet", "a.mf4")
COUNTS = 10_000
ID = f"""
[columns]
t = {{ name = "ms", unit = "ms" }}
theta = {{ name = "counts", unit = "count" }}
i_q = {{ name = "current", unit = "mA", sign = -1 }}
[motor]
pole_pairs = 4
R_s = "1 ohm"
L_d = "1 mH"
L_q = "1 mH"
K_t = "0.3 N*m/A"
[drive]
rates = {{ current_loop = "10 kHz", speed_loop = "1 kHz" }}
current_loop = {{ bandwidth = "500 Hz", current_limit = "10 A" }}
inverter = {{ bus_voltage = "48 V" }}
position_sensor = {{ kind = "encoder", lines = {COUNTS // 4} }}
"""
ROWS = 1000
COLUMNS = {
    "ms": np.arange(ROWS) * 1.0,
    "counts": np.floor(np.linspace(0, 3 * COUNTS, ROWS)) % COUNTS,
    "current": np.linspace(-100, 100, ROWS),
}


def logs(folder, name, columns=None):
    """The log of these columns in a file of this name."""
    path, columns = folder / name, columns or COLUMNS
    text = (
        ",".join(columns)
        + "\n"
        + "".join(f"{','.join(map(str, row))}\n" for row in zip(*columns.values(), strict=True))
    )
    if name.endswith(".gz"):
        path.write_bytes(gzip.compress(text.encode()))
    elif name.endswith(".csv"):
        path.write_text(text)
    elif name.endswith(".npz"):
        np.savez(path, **columns)
    elif name.endswith(".mat"):
        from scipy.io import savemat

        savemat(path, columns)
    elif name.endswith(".parquet"):
        pa = pytest.importorskip("pyarrow")
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
    else:
        asammdf = pytest.importorskip("asammdf", reason="the extra cogless[logs] is not installed")
        with asammdf.MDF() as file:
            file.append([asammdf.Signal(x, columns["ms"] * 1e-3, name=key) for key, x in columns.items()])
            file.save(path)
    (folder / "id.toml").write_text(ID)
    known = config.load(folder / "id.toml")
    return load_logs([path], known)


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_file_gives_the_same_log(tmp_path, name):
    (log,) = logs(tmp_path, name)
    assert log.dt == pytest.approx(1e-3)
    half = np.pi / COUNTS  # a count rounds down: the angle is half a count further
    assert log["theta"][[0, -1]] == pytest.approx([half, 6 * np.pi + half])
    assert log["i_q"][[0, -1]] == pytest.approx([0.1, -0.1])
    assert log.remarks == [f"{name}: the angle wraps 3 times, and is unwrapped."]


def test_a_gap_cuts_a_log_and_is_told(tmp_path):
    late = np.where(np.arange(ROWS) < 400, COLUMNS["ms"], COLUMNS["ms"] + 50)
    (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": late})
    assert [rows.stop - rows.start for rows in log.stretches] == [400, 600]
    assert "a.npz: 1 gaps, the longest 0.051 s; the log is cut at each gap." in log.remarks


def test_a_rounded_clock_is_a_regular_one_and_a_jittering_one_is_interpolated(tmp_path):
    theta = np.linspace(0, 3 * COUNTS, ROWS)
    regular = np.arange(ROWS) * 2.4
    (rounded,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": np.round(regular)})
    assert len(rounded) == ROWS
    told = "rows are 2.4 ms apart, with a spread of 0.49 ms rms; the times are taken as rounded, and the"
    assert any(told in line for line in rounded.remarks)
    jitter = regular + np.random.default_rng(0).uniform(-0.5, 0.5, ROWS)
    columns = {**COLUMNS, "ms": jitter, "current": np.interp(jitter, regular, theta)}
    (even,) = logs(tmp_path, "b.npz", columns)
    assert np.diff(even["i_q"], 2) == pytest.approx(0, abs=1e-6)
    assert any("each row is used at its own time" in line for line in even.remarks)


def test_rows_that_repeat_are_told(tmp_path):
    held = {key: x if key == "ms" else np.repeat(x[::2], 2) for key, x in COLUMNS.items()}
    (log,) = logs(tmp_path, "a.npz", held)
    assert any(line.startswith("a.npz: 50 % of the rows repeat the row before") for line in log.remarks)


def test_rows_of_the_same_time_are_left_out(tmp_path):
    twice = COLUMNS["ms"].copy()
    twice[10] = twice[9]
    (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": twice})
    assert any("1 rows have the time of the row before" in line for line in log.remarks)


def test_a_long_csv_is_read_in_blocks(tmp_path):
    rows = 150_000
    path = tmp_path / "a.csv"
    path.write_text("t;x\n" + "".join(f"{n};{n % 7}\n" for n in range(rows)))
    (log,) = read(path, ["t", "x", "absent"])
    columns = log.columns
    assert (log.name, log.headings) == ("", ("t", "x"))
    assert columns.keys() == {"t", "x"}
    assert len(columns["x"]) == rows
    assert columns["x"][-1] == (rows - 1) % 7


def test_a_law_of_one_s_own_is_refused(tmp_path):
    """Its code would run in every replay, and unsaid."""
    (tmp_path / "id.toml").write_text(ID + '[controller.mine]\nlaw = "python"\nobject = "my.py:Mine"\n')
    with pytest.raises(StudyError) as caught:
        config.load(tmp_path / "id.toml")
    expected = "expected a law of cogless, not code of your own, since each log is simulated many times"
    assert str(caught.value) == f'{tmp_path / "id.toml"}: controller.mine.law: "python": {expected}'


@pytest.mark.parametrize(("share", "refused"), [(1.0, False), (0.9, False), (0.7071, True)])
def test_a_current_in_rms_beside_peaks_of_the_phases_is_refused(tmp_path, share, refused):
    theta_e = 4 * 2 * np.pi * COLUMNS["counts"] / COUNTS
    phases = {
        name: COLUMNS["current"] * np.sin(theta_e - shift)
        for name, shift in (("a", 0.0), ("b", 2 * np.pi / 3))
    }
    path = tmp_path / "a.npz"
    np.savez(path, **{**COLUMNS, "current": share * COLUMNS["current"]}, **phases)
    known = "".join(f'i_{name} = {{ name = "{name}", unit = "mA" }}\n' for name in phases)
    (tmp_path / "id.toml").write_text(ID.replace("[motor]", f"{known}[motor]"))
    loaded = config.load(tmp_path / "id.toml")
    if not refused:
        assert load_logs([path], loaded)
        return
    with pytest.raises(StudyError) as caught:
        load_logs([path], loaded)
    assert str(caught.value) == (
        f"{path}: current is 0.707 of the amplitude that a and b have, as if it were rms: expected peak "
        "amperes: current with scale = 1.41421 in id.toml"
    )


def csv_of(folder, text, *wanted):
    """The columns t and x, or these, of a CSV; or what is said of it."""
    path = folder / "a.csv"
    path.write_text(text)
    try:
        (log,) = read(path, list(wanted or ("t", "x")))
    except StudyError as error:
        return str(error).removeprefix(f"{path}: ")
    return {name: values.tolist() for name, values in log.columns.items()}


def test_a_row_that_is_not_as_the_heading_is_read_by_itself(tmp_path, monkeypatch):
    """Empty cells at a row's end and empty lines are ignored. Rows are counted over all blocks of a file."""
    monkeypatch.setattr(csv_log, "BLOCK_CHARACTERS", 12)
    rows = ["t;y;x", "0;0;1", "1;0;2", "2;0;3;", "", '"3";0;4', "4;0;5"]
    assert csv_of(tmp_path, "\n".join(rows)) == {"t": [0, 1, 2, 3, 4], "x": [1, 2, 3, 4, 5]}
    assert csv_of(tmp_path, "\n".join([*rows, "5;0", "6;0;0"])) == "x: row 6: missing: expected a number"
    assert csv_of(tmp_path, "\n".join([*rows, "5;0;a"])) == 'x: row 6: "a": expected a number'
    assert csv_of(tmp_path, "\n".join([*rows, "5;0;6;7"])) == (
        "row 6: 4 cells: expected 3, as in the heading, with decimal points, not commas"
    )
    assert csv_of(tmp_path, "t\tx\n1\t2\n") == {"t": [1.0], "x": [2.0]}
    assert csv_of(tmp_path, " x , y\n1,2\n", "x") == {"x": [1.0]}


STRANGERS = {
    "a decimal comma": "t;x;u\n0,0;1,5;a\n0,1;2,5;b\n",
    "a preamble": "% a scope\n# 7\nt,x\n0.0,1.5\n0.1,2.5\n",
    "units": "t,x\ns,A\n0.0,1.5\n0.1,2.5\n",
    "units and decimal commas": "t\tx\ns\tA\n0,0\t1,5\n0,1\t2,5\n",
    "half a line": "t,x\n0.0,1.5\n0.1,2.5\n0.2",
    "separators at the end": "t,x,\n0.0,1.5,\n0.1,2.5,\n",
    "text before the heading": "Bench 3, run 7\nload: none\n\nt,x\n0.0,1.5\n0.1,2.5\n",
    "a heading between rows": "t,x\n0.0,1.5\nt,x\n0.1,2.5\nt,x\n",
    "plain": "t,x\n0.0,1.5\n0.1,2.5\n",
    "times of day": "t,x\n00:00:00.000,1.5\n00:00:00.100,2.5\n",
    "times with dates and decimal commas": "t;x\n2024-05-01 00:00:00,0;1,5\n2024-05-01 00:00:00,1;2,5\n",
    "quoted decimal commas": 't,x\n"0,0","1,5"\n"0,1","2,5"\n',
}
GUESSES = {
    "a decimal comma": ["commas are taken for decimal points."],
    "units": ['"s,A" is a row of units. It is not used: the units are those of --config.'],
    "units and decimal commas": [
        '"s A" is a row of units. It is not used: the units are those of --config.',
        "commas are taken for decimal points.",
    ],
    "half a line": ["the last line is incomplete, and is left out."],
    "text before the heading": ['the text before the heading, from "Bench 3, run 7" on, is left out.'],
    "a heading between rows": ["the heading comes 3 times; the headings between rows are left out."],
    "times of day": ['t: "00:00:00.000" is read as hours, minutes and seconds.'],
    "times with dates and decimal commas": [
        "commas are taken for decimal points.",
        't: "2024-05-01 00:00:00,0" is read as hours, minutes and seconds.',
    ],
    "quoted decimal commas": ["commas are taken for decimal points."],
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("kind", STRANGERS)
@pytest.mark.parametrize("name", ["a.csv", "a.txt", "a.tsv"])
def test_a_file_of_a_stranger_has_the_same_numbers(tmp_path, name, kind, encoding):
    """What is guessed is said. A heading with a micro sign is nothing in UTF-8 where the file is Latin-1."""
    separator = "\t" if "\t" in STRANGERS[kind] else ";" if ";" in STRANGERS[kind] else ","
    text = STRANGERS[kind].replace(f"{separator}x", f"{separator}x \u00b5")
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    (log,) = read(path, ["t", "x \u00b5"])
    assert {key: values.tolist() for key, values in log.columns.items()} == {
        "t": [0.0, 0.1],
        "x \u00b5": [1.5, 2.5],
    }
    assert list(log.remarks) == [f"{name}: {guess}" for guess in GUESSES.get(kind, [])]


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ('t,x\n0.5,"1,234.5"\n1.5,"12,345"\n', [1234.5, 12345]),
        ("t;x\n0,5;1.234,5\n1,5;12.345\n", [1234.5, 12345]),
        ("t;x\n0,5;1\u00a0234,5\n1,5;-12\u00a0345\n", [1234.5, -12345]),
        ("t;x\n0.5;1'234.5\n1.5;1'234'567\n", [1234.5, 1234567]),
        ('t,x\n1,"1,234,567"\n2,"1,234"\n', [1234567, 1234]),
    ],
)
def test_separators_of_thousands_are_read_and_said(tmp_path, text, numbers):
    """One that may as well be a decimal comma is read only where other cells show which of both it is."""
    (tmp_path / "a.csv").write_text(text, "utf-8")
    (log,) = read(tmp_path / "a.csv", ["t", "x"])
    assert log.columns["x"].tolist() == numbers
    assert log.remarks[-1].endswith(f"is read as {numbers[0]:.12g}, without its separators of thousands.")


def test_a_comma_that_may_be_of_thousands_or_decimals_is_refused(tmp_path):
    assert csv_of(tmp_path, 't,x\n1,"1,234"\n') == (
        'x: row 1: "1,234": expected a number with a decimal point'
    )
    assert csv_of(tmp_path, "t;x\n0,5;1.5\n") == 't: row 1: "0,5": expected a number with a decimal point'


def test_a_log_with_times_of_day_is_that_in_seconds(tmp_path):
    """Over midnight, too. Its column has no unit; another column is none of times."""
    rows = [f"{3600 * 24 - 5 + 0.001 * k:.3f},{k},{k}" for k in range(10_000)]
    times = []
    for row in rows:
        second, *rest = row.split(",")
        ms = round(1000 * float(second)) % (86_400 * 1000)
        clock = f"{ms // 3_600_000:02}:{ms // 60_000 % 60:02}:{ms // 1000 % 60:02}.{ms % 1000:03}"
        times.append(",".join([clock, *rest]))
    path = tmp_path / "a.csv"
    path.write_text("ms,counts,current\n" + "\n".join(times))
    (tmp_path / "id.toml").write_text(ID)
    with pytest.raises(AdvisedError) as caught:
        load_logs([path], config.load(tmp_path / "id.toml"))
    (advice,) = caught.value.mistakes
    assert advice == (
        f"{path}: ms: cogless converts times of day to seconds: expected columns.t without unit, sign or "
        f"scale"
    )
    (tmp_path / "id.toml").write_text(plan.to_toml(changed(tomllib.loads(ID), advice.cures[0])))
    (log,) = load_logs([path], config.load(tmp_path / "id.toml"))
    assert log.dt == pytest.approx(1e-3) and len(log) == 10_000
    assert any("the time begins again 1 times, after 86400 s" in remark for remark in log.remarks)
    path.write_text(path.read_text().replace("ms,counts", "counts,ms"))
    with pytest.raises(
        StudyError,
        match=r"counts: holds times of day: expected numbers, or if this is the "
        r"time, columns\.t\.name = ",
    ):
        load_logs([path], config.load(tmp_path / "id.toml"))


SPACED = "spaces are taken for the separators of columns."


@pytest.mark.parametrize(
    ("text", "guesses"),
    [
        ("  t     x   y\n0.0   1.5   7\n 0.1   2.5  -8\n", [SPACED]),
        (
            "t x y\ns A -\n0.0 1.5 7\n0.1 2.5 8\n",
            [SPACED, '"s A -" is a row of units. It is not used: the units are those of --config.'],
        ),
        ("t x y\n0,0 1,5 7\n0,1 2,5 8\n", [SPACED, "commas are taken for decimal points."]),
        (
            "t x y\n0.0 1.5 7\n0.1 2.5 8\n0.2 3\n",
            [SPACED, "the last line is incomplete, and is left out."],
        ),
        ("# a scope\nBench 3\nt x y\n\n0.0 1.5 7 \n  t  x  y\n0.1 2.5 8\n", None),
    ],
)
def test_columns_may_be_aligned_by_spaces(tmp_path, monkeypatch, text, guesses):
    """However many spaces stand between two cells, and wherever a block of the file ends."""
    for characters in (24, 1 << 22):
        monkeypatch.setattr(csv_log, "BLOCK_CHARACTERS", characters)
        if characters == 24 and guesses is None:
            continue  # the text before the heading fills a block of its own
        (tmp_path / "a.txt").write_text(text)
        (log,) = read(tmp_path / "a.txt", ["t", "x"])
        assert {key: values.tolist() for key, values in log.columns.items()} == {
            "t": [0.0, 0.1],
            "x": [1.5, 2.5],
        }
        if guesses is not None:
            assert list(log.remarks) == [f"a.txt: {guess}" for guess in guesses]


def test_a_clock_that_starts_anew_after_a_repeated_heading_is_refused(tmp_path):
    """Two recordings in a file are never taken for one of even rows."""
    rows = [f"{k},{10 * k},{k}\n" for k in range(500)]
    (tmp_path / "id.toml").write_text(ID)
    (tmp_path / "a.csv").write_text(
        "ms,counts,current\n" + "".join(rows) + "ms,counts,current\n" + "".join(rows)
    )
    with pytest.raises(
        StudyError,
        match=r"a.csv: ms: row 501: the time goes back: expected one clock, or a file for "
        r"each recording$",
    ):
        load_logs([tmp_path / "a.csv"], config.load(tmp_path / "id.toml"))


def test_a_heading_with_a_space_is_no_two_columns(tmp_path):
    """Nor does a space count where another separator stands."""
    assert csv_of(tmp_path, "t,motor x\n1,2\n", "t", "motor x") == {"t": [1.0], "motor x": [2.0]}
    assert csv_of(tmp_path, "motor speed\n1 2\n", "motor speed") == (
        'motor speed: row 1: "1 2": expected a number'
    )


def refused(folder, name, columns):
    """What is said of a log with these columns, and the changes that it advises."""
    with pytest.raises(AdvisedError) as caught:
        logs(folder, name, columns)
    (advice,) = caught.value.mistakes
    return advice.removeprefix(f"{folder / name}: "), advice.cures


def cured(folder, cure, *names):
    """The logs by the file of columns with this change."""
    tables = changed(tomllib.loads(ID), cure)
    (folder / "id.toml").write_text(plan.to_toml(tables))
    return load_logs([folder / name for name in names], config.load(folder / "id.toml"))


@pytest.mark.parametrize("name", KINDS)
def test_a_column_that_a_file_lacks_is_told_with_the_nearest_heading(tmp_path, name):
    """Here the current is one that most of the fit can do without: it was left out without a word once."""
    near = {"currents" if key == "current" else key: x for key, x in COLUMNS.items()}
    said, (renamed,) = refused(tmp_path, name, near)
    assert (
        said == 'no column "current" (i_q; similar: "currents"): expected in [columns] a heading that this '
        "file has"
    )
    assert cured(tmp_path, renamed, name)[0]["i_q"][[0, -1]] == pytest.approx([0.1, -0.1])


def test_a_heading_is_near_but_for_a_unit_spaces_and_capitals_and_if_it_is_no_other_s(tmp_path):
    for near in ("Current", "current [mA]", "current (A)", "_current_"):
        said, (cure,) = refused(
            tmp_path, "a.csv", {near if key == "current" else key: x for key, x in COLUMNS.items()}
        )
        assert said.startswith(f'no column "current" (i_q; similar: "{near}"): ')
        assert cure == {"columns.i_q.name": near}
    others = {"ms": COLUMNS["ms"], "count": COLUMNS["counts"], "volts": COLUMNS["current"]}
    said, (cure,) = refused(tmp_path, "a.csv", others)
    assert said.startswith('no column "counts" (theta; similar: "count"), "current" (i_q): expected ')
    assert cure == {"columns.theta.name": "count"}
    said, cures = refused(tmp_path, "a.csv", {"ms": COLUMNS["ms"], "x\x1b[2Jy": COLUMNS["counts"]})
    assert said.startswith('no column "counts" (theta), "current" (i_q); it has "ms", "x?[2Jy": expected ')
    assert cures == ()


def test_a_column_is_that_of_the_files_that_have_it(tmp_path):
    """Of two logs one lacks the current, the other's name has a bracket; then a pattern is too narrow."""
    paths = [tmp_path / "a[1].npz", tmp_path / "b.npz"]
    np.savez(paths[0], **COLUMNS)
    np.savez(paths[1], **{key: x for key, x in COLUMNS.items() if key != "current"})
    with pytest.raises(AdvisedError) as caught:
        load_logs(paths, known(tmp_path))
    (advice,) = caught.value.mistakes
    assert advice == (
        f'{paths[1]}: no column "current" (i_q); it has "ms", "counts": expected in [columns] a heading '
        "that this file has"
        ', or columns.i_q.files = ["a[[]1].npz"]'
    )
    a, b = cured(tmp_path, *advice.cures, *(path.name for path in paths))
    assert (set(a.signals), set(b.signals)) == ({"theta", "i_q"}, {"theta"})
    narrow = known(tmp_path, 'name = "current", ', 'name = "current", files = "c*", ')
    with pytest.raises(AdvisedError) as caught:
        load_logs(paths, narrow)
    (advice,) = caught.value.mistakes
    assert advice == (
        f'{paths[0]}: has the column "current" (i_q), but columns.i_q.files does not name this file: '
        "expected the files that have the column"
    )
    assert advice.cures == ({"columns.i_q.files": ["c*", "a[[]1].npz"]},)
    a, b = cured(tmp_path, *advice.cures, *(path.name for path in paths))
    assert (set(a.signals), set(b.signals)) == ({"theta", "i_q"}, {"theta"})


def test_a_log_of_nothing_but_the_time_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", ms=COLUMNS["ms"])
    (tmp_path / "id.toml").write_text(
        "\n".join(x for x in ID.splitlines() if x[:5] not in ("theta", "i_q ="))
    )
    with pytest.raises(StudyError, match=r"a.npz: no column but the time: expected an angle, a speed or a "):
        load_logs([tmp_path / "a.npz"], config.load(tmp_path / "id.toml"))


def test_a_column_of_parts_that_is_none_is_refused(tmp_path):
    """Each row would be a log of its own."""
    parts = known(tmp_path, "[columns]", '[columns]\npart = "part"')
    np.savez(tmp_path / "a.npz", **{key: np.arange(1001.0) for key in (*COLUMNS, "part")})
    with pytest.raises(StudyError, match=r"a.npz: part: 1001 parts: expected 1000 or fewer$"):
        load_logs([tmp_path / "a.npz"], parts)


def test_text_before_a_heading_is_left_out_within_fifty_lines(tmp_path):
    """A heading has two of the wanted names, or more; a cell may stand in quotes."""
    for lines, columns in ((49, {"t": [1.0], "x": [2.0]}), (50, {})):
        text = "Bench\n" + "no load\n" * lines + '"t"; "x"\n1; "2"\n'
        assert csv_of(tmp_path, text) == columns
    assert csv_of(tmp_path, "Bench\nt\n1\n") == {}


@pytest.mark.parametrize(
    ("name", "columns", "said"),
    [
        (
            "a.npz",
            {"x": np.zeros(3), "y": np.zeros(4)},
            "columns of 3 and 4 rows: expected columns of equal length",
        ),
        ("a.npz", {"x": np.zeros(0)}, "no rows: expected a log"),
        (
            "a.npz",
            {"x": np.array([1.0, np.nan, np.inf])},
            "x: row 2: nan: expected a finite number (2 rows lack one)",
        ),
        (
            "a.npz",
            {"x": np.array([1, 1e31])},
            "x: row 2: 1e+31: expected a number below 1e+30 (1 rows lack one)",
        ),
        ("a.npz", {"x": np.array(["a", "b"])}, "x: expected numbers"),
        (
            "a.npz",
            {"x": np.array([None])},
            "x: expected numbers",
        ),
        ("a.npz", {"x": np.array([1j])}, "x: expected numbers"),
        ("a.mat", {"x": np.array(["a", "b"])}, "x: expected numbers"),
        ("a.mat", {"x": np.array([1j])}, "x: expected numbers"),
    ],
)
def test_columns_that_are_no_log_are_refused(tmp_path, name, columns, said):
    path = tmp_path / name
    if name == "a.mat":
        from scipy.io import savemat

        savemat(path, columns)
    else:
        np.savez(path, **columns)
    with pytest.raises(StudyError) as caught:
        list(read(path, ["x", "y"]))
    assert str(caught.value) == f"{path}: {said}"


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.npz", b"PK\x03\x04 cut", ": File is not a zip file: expected a readable NPZ file"),
        ("a.csv.gz", gzip.compress(b"x\n1\n", mtime=0)[:-9], ": expected a readable CSV file"),
        ("A.CSV.GZ", b"x\n1\n", ": expected a readable CSV file"),
        ("a.mat", b"text" * 40, ": expected a readable MAT file"),
        ("a.parquet", b"text" * 40, ": expected a readable Parquet file"),
        ("a.mf4", b"text" * 40, ": it does not begin like an MDF 4 file: expected a readable MDF4 file"),
        ("a.nc", b"text" * 40, ": expected a readable netCDF file"),
    ],
)
def test_a_file_that_is_not_what_its_name_says_is_refused_in_a_line(tmp_path, name, content, said):
    for kind, module in ((".parquet", "pyarrow"), (".mf4", "asammdf")):
        if name.endswith(kind):
            pytest.importorskip(module)
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(StudyError) as caught:
        list(read(path, ["x"]))
    line = str(caught.value)
    assert line.startswith(f"{path}: ") and line.endswith(said) and "\n" not in line


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.npz", "a.parquet", "a.mat", "a.mf4", "a.nc"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(StudyError) as caught:
        list(read(path, ["x"]))
    kind = path.suffix if path.suffix != ".gz" else ".csv"
    assert str(caught.value) == f"{path}: not a regular file: expected a readable {kind} file"


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("\n  first.\nsecond\n"), "first"),
        (KeyError("x"), "KeyError 'x'"),
        (MemoryError(), "MemoryError"),
        (RuntimeError("\x1b[2J" + "x" * 200), "?[2J" + "x" * 153 + "..."),
        (OSError(5, "Input/output error", "a.npz"), "input/output error"),
        (type("Own", (Exception,), {})(), "Own"),
    ],
)
def test_whatever_a_library_raises_is_one_line(tmp_path, error, line):
    with pytest.raises(StudyError) as caught, readable(tmp_path / "a.npz", "NPZ"):
        raise error
    assert str(caught.value) == f"{tmp_path / 'a.npz'}: {line}: expected a readable NPZ file"


def test_a_fault_of_our_own_is_no_bad_file(tmp_path, monkeypatch):
    """Nor is an interrupt."""

    def broken(*of):
        raise RuntimeError("ours")

    monkeypatch.setattr(csv_log._Table, "converted", broken)
    with pytest.raises(RuntimeError, match="ours"):
        csv_of(tmp_path, "t,x\n1,2\n")
    with pytest.raises(KeyboardInterrupt), readable(tmp_path, "NPZ"):
        raise KeyboardInterrupt


@pytest.mark.parametrize("name", [*KINDS, "a.nc"])
def test_a_file_that_is_not_there_is_told(tmp_path, name):
    with pytest.raises(StudyError, match=r"a.*: no such file or directory: expected a readable .* file$"):
        read(tmp_path / name, ["x"])


def mdf(path, *groups):
    """An MDF file with a group for each of these: times, their channel's name, and channels."""
    asammdf = pytest.importorskip("asammdf", reason="the extra cogless[logs] is not installed")
    with asammdf.MDF() as file:
        for time, master, channels in groups:
            file.append(
                [
                    asammdf.Signal(values, time, name=name, master_metadata=(master, 0))
                    for name, values in channels.items()
                ]
            )
        file.save(path)


def test_channels_are_brought_to_the_time_of_the_first(tmp_path):
    """The time has a name of its own, once in each group; a channel may have it, too."""
    fast, slow = np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0])
    mdf(tmp_path / "a.mf4", (fast, "t", {"x": 2 * fast}), (slow, "t", {"y": slow}))

    def columns(name, *headings):
        (log,) = read(tmp_path / name, list(headings))
        return {key: values.tolist() for key, values in log.columns.items()}

    own = {"x": [0.0, 1.0, 2.0], "y": [0.0, 0.5, 1.0]}
    assert columns("a.mf4", "t", "x", "y", "z") == {"t": [0.0, 0.5, 1.0], **own}
    assert columns("a.mf4", "y", "x", "t") == {"y": [0.0, 1.0], "x": [0.0, 2.0], "t": [0.0, 1.0]}
    assert columns("a.mf4", "z") == columns("a.mf4", "t") == {}
    mdf(tmp_path / "b.mf4", (fast, "time", {"x": fast, "t": 1e3 * fast}))
    assert columns("b.mf4", "t", "x") == {"t": [0.0, 500.0, 1000.0], "x": [0.0, 0.5, 1.0]}
    mdf(tmp_path / "c.mf4", (fast, "t", {"x": fast}), (slow, "t", {"x": slow}))
    with pytest.raises(StudyError, match=r"c.mf4: x: 2 channels have this name: expected one$"):
        columns("c.mf4", "x")


def known(folder, was="", now="", more=""):
    """The file of columns with a change, and more at its end."""
    assert was in ID
    (folder / "id.toml").write_text(ID.replace(was, now) + more)
    return config.load(folder / "id.toml")


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        (
            f'"encoder", lines = {COUNTS // 4}',
            '"ideal"',
            'columns.theta.unit: "count": expected a drive.position_sensor with counts',
        ),
        (
            '{ name = "current", unit = "mA"',
            '{ name = "current", unit = "count"',
            'columns.i_q.unit: "count": expected a current',
        ),
    ],
)
def test_a_count_is_of_a_sensor_that_has_counts_and_of_the_angle(tmp_path, was, now, said):
    with pytest.raises(StudyError) as caught:
        known(tmp_path, was, now)
    assert str(caught.value).startswith(f"{tmp_path / 'id.toml'}: {said}")


def test_a_drive_with_a_current_reference_is_refused(tmp_path):
    with pytest.raises(StudyError, match=r"drive\.current_reference: .*the torque is taken from i_q alone"):
        known(tmp_path, "[drive]\n", "[drive]\ncurrent_reference = { field_weakening = true }\n")


@pytest.mark.parametrize(
    ("unit", "signal", "factor"),
    [("125 us", "t", 125e-6), ("2000 rpm", "omega", 2000 * np.pi / 30), ("0.5mA", "i_q", 0.5e-3)],
)
def test_a_unit_may_have_a_number(tmp_path, unit, signal, factor):
    """It is the scale of a log that counts ticks, or parts of a rated speed or current."""
    others = [line for line in ID.splitlines() if not line.startswith(f"{signal} = ")]
    column = f'{signal} = {{ name = "y", unit = "{unit}", scale = 2 }}'
    (tmp_path / "id.toml").write_text("\n".join(others).replace("[columns]", f"[columns]\n{column}"))
    assert config.load(tmp_path / "id.toml").factor(signal) == pytest.approx(2 * factor)


@pytest.mark.parametrize("unit", ["0 us", "-125 us", "1e999 s", "125 A", "125"])
def test_a_number_with_a_unit_is_above_0_and_of_its_signal(tmp_path, unit):
    with pytest.raises(StudyError, match=r"id.toml: columns.t.unit: .*expected"):
        known(tmp_path, '"ms", unit = "ms"', f'"ms", unit = "{unit}"')


def test_the_reciprocal_of_a_unit_is_no_number_with_a_unit(tmp_path):
    """1/s keeps its message of two readings."""
    with pytest.raises(StudyError, match=r'the unit "1/s" may be "rad/s" or "rev/s"$'):
        known(tmp_path, "[columns]", '[columns]\nomega = { name = "y", unit = "1/s" }')


def test_headings_name_a_time_or_an_angle(tmp_path):
    lines = ID.splitlines(keepends=True)
    named = [line for line in lines if not line.startswith(("t =", "theta ="))]
    (tmp_path / "id.toml").write_text("".join(named))
    with pytest.raises(
        StudyError, match=r'columns: expected the headings of the columns, such as t = "time_s"'
    ):
        config.load(tmp_path / "id.toml")
    for needed in ("t =", "theta ="):
        (tmp_path / "id.toml").write_text(
            "".join(line for line in lines if line in named or line.startswith(needed))
        )
        assert len(config.load(tmp_path / "id.toml").columns) == 2


def test_numbers_of_a_column_become_si_with_its_sign(tmp_path):
    loaded = known(tmp_path, '"counts", unit = "count"', '"counts", unit = "count", sign = -1')
    step = 2 * np.pi / COUNTS
    assert (loaded.counts, loaded.step) == (COUNTS, pytest.approx(step))
    assert loaded.path == tmp_path / "id.toml" and loaded.tables["motor"]["pole_pairs"] == 4
    assert [loaded.factor(name) for name in ("t", "theta", "i_q")] == pytest.approx([1e-3, -step, -1e-3])
    plain = known(tmp_path, '{ name = "ms", unit = "ms" }', '"ms"')
    assert plain.factor("t") == 1.0


def test_the_first_rule_that_a_file_s_name_matches_counts(tmp_path):
    rules = "".join(
        f'[[log]]\nfile = "{file}"\nsession = "{name}"\n' for name, file in (("a", "slow*"), ("b", "s*.csv"))
    )
    loaded = known(tmp_path, more=rules)
    found = [loaded.rule(file).session for file in ("slow.csv", "sweep.csv", "sweep.npz", "aslow")]
    assert found == ["a", "b", None, None]


TRUE_MS = np.arange(ROWS) * 1.0


def in_bursts(kind):
    """Stamps of rows 1 ms apart as packets give them, ms, and the rows that arrive."""
    chance, rows = np.random.default_rng(2), np.arange(ROWS)
    sizes = {"varying": chance.integers(4, 13, ROWS), "stamps rounded": np.full(ROWS, 3)}
    last = np.cumsum(sizes.get(kind, np.full(ROWS, 8))) - 1
    last = np.append(last[last < ROWS - 1], ROWS - 1)
    packet = np.searchsorted(last, rows)
    stamps = (last + chance.uniform(0, 1.5, len(last)))[packet]
    if kind == "bunched":
        stamps = stamps + 0.02 * (rows - np.append(-1, last)[packet])
    if kind == "stamps rounded":
        stamps = 3.0 * packet
    return stamps, rows[packet != 60] if kind == "one lost" else rows


@pytest.mark.parametrize("kind", ["even", "varying", "bunched", "stamps rounded", "one lost"])
def test_rows_in_bursts_are_even_by_their_number(tmp_path, kind):
    """Within a tenth of a row. A packet that is lost is a gap of eight rows and no slipped angle."""
    stamps, rows = in_bursts(kind)
    counts = np.floor(5.3 * TRUE_MS + 400 * np.sin(TRUE_MS / 300))
    columns = {"ms": stamps, "counts": counts, "current": TRUE_MS}
    (log,) = logs(tmp_path, "a.npz", {name: x[rows] for name, x in columns.items()})
    assert log.dt == pytest.approx(1e-3, rel=2e-3)
    assert -1e3 * log["i_q"] == pytest.approx(rows, abs=1e-9)
    (said,) = [line for line in log.remarks if "bursts" in line]
    start = f"a.npz: rows come in {len(set(stamps[rows].round(0 if kind == 'bunched' else 9)))} bursts of "
    assert said.endswith(" ms apart.") and (kind == "bunched" or said.startswith(start))
    gaps = [line for line in log.remarks if "gaps" in line]
    assert len(log.stretches) == 1 + len(gaps) == (2 if kind == "one lost" else 1)
    if gaps:
        assert log.stretches[1].start == 480


def test_a_recorder_that_is_triggered_gives_no_packets(tmp_path):
    """The angle moves on between its bursts, so its rows are not even."""
    number, own = TRUE_MS // 8, 0.02 * (TRUE_MS % 8)
    packets = {"ms": 8 * number + own, "counts": np.floor(5.3 * TRUE_MS), "current": TRUE_MS}
    assert len(logs(tmp_path, "a.npz", packets)[0]) == ROWS
    time = 100 * number + own
    with pytest.raises(StudyError) as caught:
        logs(tmp_path, "a.npz", {**packets, "ms": time, "counts": np.floor(5.3 * time)})
    assert str(caught.value) == (
        f"{tmp_path / 'a.npz'}: fewer than 100 rows between its gaps: expected a log with fewer gaps"
    )


@pytest.mark.parametrize("cell", ["", "nan", "NaN", "NA", "n/a", "null", "None", " "])
def test_rows_that_lack_a_number_are_left_out_and_cut_the_log(tmp_path, cell):
    """The current between them is not interpolated, and the rows behind do not slip."""
    rows = [[f"{k}", f"{11 * k}", f"{k / 8}"] for k in range(500)]
    rows[200][2] = rows[201][1] = rows[350][2] = cell
    text = "\n".join(["ms,counts,current", *map(",".join, rows)])
    (tmp_path / "a.csv").write_text(text)
    (log,) = load_logs([tmp_path / "a.csv"], known(tmp_path))
    assert [(rows.start, rows.stop) for rows in log.stretches] == [(0, 200), (200, 348), (348, 497)]
    whole = np.delete(np.arange(500), [200, 201, 350])
    assert -8e3 * log["i_q"] == pytest.approx(whole)
    assert log["theta"] * COUNTS / (2 * np.pi) == pytest.approx(11 * whole + 0.5)
    assert log.remarks == [
        'a.csv: 3 rows lack a number (1 in "counts", 2 in "current") and are left out.',
        "a.csv: 2 gaps, the longest 0.003 s; the log is cut at each gap.",
    ]


def test_a_column_at_half_the_rate_gives_a_log_of_half_the_rate(tmp_path):
    sparse = np.where(np.arange(ROWS) % 2, np.nan, COLUMNS["current"])
    (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "current": sparse})
    assert (len(log), log.dt, len(log.stretches)) == (500, pytest.approx(2e-3), 1)
    assert log.remarks[0] == 'a.npz: 500 rows lack a number (500 in "current") and are left out.'


def test_a_column_that_ends_before_the_log_is_told_with_its_time(tmp_path):
    """Rows behind it are no gaps; a number that is missing before stays one."""
    lacking = np.arange(ROWS) >= ROWS - 400
    lacking[100] = True
    current = np.where(lacking, np.nan, COLUMNS["current"])
    (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "current": current})
    assert len(log) == ROWS - 401
    assert log.remarks == [
        'a.npz: "current" ends at 0.599 s, the log at 0.999 s: rows after 0.599 s are left out.',
        'a.npz: 1 rows lack a number (1 in "current") and are left out.',
        "a.npz: 1 gaps, the longest 0.002 s; the log is cut at each gap.",
        "a.npz: the angle wraps 1 times, and is unwrapped.",
    ]


def test_columns_that_never_meet_in_a_row_are_refused_with_what_to_do(tmp_path):
    odd = np.arange(ROWS) % 2 == 1
    columns = {
        **COLUMNS,
        "counts": np.where(odd, COLUMNS["counts"], np.nan),
        "current": np.where(odd, np.nan, COLUMNS["current"]),
    }
    with pytest.raises(StudyError) as caught:
        logs(tmp_path, "a.npz", columns)
    assert str(caught.value) == (
        f"{tmp_path / 'a.npz'}: 0 of 1000 rows have a number in every column (lacking: 500 in "
        '"counts", 500 in "current"): expected 100 or more, so log the columns together or leave one out '
        "of [columns]"
    )


def test_a_decimal_comma_is_seen_beside_an_empty_cell(tmp_path):
    """And a part must have a number; a file that a drive's reader reads may lack none."""
    (tmp_path / "a.csv").write_text("t;y;x\n0,0;;1,5\n0,1;7,5;2,5\n")
    (log,) = read(tmp_path / "a.csv", ["t", "y", "x"], with_gaps=True)
    assert log.columns["x"].tolist() == [1.5, 2.5] and np.isnan(log.columns["y"][0])
    assert csv_of(tmp_path, "t;x\n0;1\n1;\n") == "x: row 2: nan: expected a finite number (1 rows lack one)"
    parts = known(tmp_path, "[columns]", '[columns]\npart = "part"')
    part = np.where(np.arange(ROWS) == 4, np.nan, 1.0)
    np.savez(tmp_path / "a.npz", **COLUMNS, part=part)
    with pytest.raises(
        StudyError,
        match=r"a.npz: part: row 5: no number: expected the number of the part that the row belongs to$",
    ):
        load_logs([tmp_path / "a.npz"], parts)
