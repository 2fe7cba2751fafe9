"""The same log from every kind of file, with units, counts, wraps, gaps and a rounded clock."""

from __future__ import annotations

import gzip
import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from cogless.errors import StudyError
from cogless.identify import config, files
from cogless.identify.files import read
from cogless.identify.log import load_logs

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


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.npz", "a.mat", "a.parquet", "a.mf4"])
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
    assert "a.npz: 1 gaps, the longest 0.051 s; the log is cut there." in log.remarks


def test_a_rounded_clock_is_a_regular_one_and_a_jittering_one_is_interpolated(tmp_path):
    theta = np.linspace(0, 3 * COUNTS, ROWS)
    regular = np.arange(ROWS) * 2.4
    (rounded,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": np.round(regular)})
    assert len(rounded) == ROWS
    assert any("the clock jitters by 0.2" in line for line in rounded.remarks)
    jitter = regular + np.random.default_rng(0).uniform(-0.5, 0.5, ROWS)
    columns = {**COLUMNS, "ms": jitter, "current": np.interp(jitter, regular, theta)}
    (even,) = logs(tmp_path, "b.npz", columns)
    assert np.diff(even["i_q"], 2) == pytest.approx(0, abs=1e-6)


def test_rows_that_repeat_are_told(tmp_path):
    held = {key: x if key == "ms" else np.repeat(x[::2], 2) for key, x in COLUMNS.items()}
    (log,) = logs(tmp_path, "a.npz", held)
    assert any(line.startswith("a.npz: 50 % of the rows repeat the one before") for line in log.remarks)


def test_rows_of_the_same_time_are_left_out(tmp_path):
    twice = COLUMNS["ms"].copy()
    twice[10] = twice[9]
    (log,) = logs(tmp_path, "a.npz", {**COLUMNS, "ms": twice})
    assert any("1 rows have the time of the row before" in line for line in log.remarks)


def test_a_long_csv_is_read_in_blocks(tmp_path):
    rows = 150_000
    path = tmp_path / "a.csv"
    path.write_text("t;x\n" + "".join(f"{n};{n % 7}\n" for n in range(rows)))
    ((name, columns),) = read(path, ["t", "x", "absent"])
    assert name == "a.csv"
    assert columns.keys() == {"t", "x"}
    assert len(columns["x"]) == rows
    assert columns["x"][-1] == (rows - 1) % 7


def test_a_law_of_one_s_own_is_refused(tmp_path):
    """Its code would run in every replay, and unsaid."""
    (tmp_path / "id.toml").write_text(ID + '[controller.mine]\nlaw = "python"\nobject = "my.py:Mine"\n')
    with pytest.raises(StudyError) as caught:
        config.load(tmp_path / "id.toml")
    expected = "expected a law that cogless has: logs are replayed many times"
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
        f"{path}: current is 0.707 of the amplitude that a and b have, as rms is: expected peak amperes: "
        "current with scale = 1.41421 in the file of columns"
    )


def csv_of(folder, text, *wanted):
    """The columns t and x, or these, of a CSV; or what is said of it."""
    path = folder / "a.csv"
    path.write_text(text)
    try:
        ((_, columns),) = read(path, list(wanted or ("t", "x")))
    except StudyError as error:
        return str(error).removeprefix(f"{path}: ")
    return {name: values.tolist() for name, values in columns.items()}


def test_a_row_that_is_not_as_the_heading_is_read_by_itself(tmp_path, monkeypatch):
    """Empty cells at a row's end and empty lines are ignored. Rows are counted over all blocks of a file."""
    monkeypatch.setattr(files, "BLOCK", 2)
    rows = ["t;y;x", "0;0;1", "1;0;2", "2;0;3;", "", '"3";0;4', "4;0;5"]
    assert csv_of(tmp_path, "\n".join(rows)) == {"t": [0, 1, 2, 3, 4], "x": [1, 2, 3, 4, 5]}
    assert csv_of(tmp_path, "\n".join([*rows, "5;0;6", "6;0"])) == "x: row 7: missing: expected a number"
    assert csv_of(tmp_path, "\n".join([*rows, "5;0;a"])) == 'x: row 6: "a": expected a number'
    assert csv_of(tmp_path, "\n".join([*rows, "5;0;6;7"])) == (
        "row 6: 4 cells: expected 3, as in the heading, and decimal points"
    )
    assert csv_of(tmp_path, "t\tx\n1\t2\n") == {"t": [1.0], "x": [2.0]}
    assert csv_of(tmp_path, " x , y\n1,2\n", "x") == {"x": [1.0]}


def test_a_heading_that_is_nearly_the_wanted_one_is_told(tmp_path):
    """One that differs by a unit, spaces or capitals; not another that is wanted, too."""
    for near in ("T", "t [s]", "t (s)", " t_"):
        assert csv_of(tmp_path, f"{near},x\n1,2\n") == (
            f'no column "t", but "{near.strip()}": expected name = "{near.strip()}" in columns'
        )
    assert csv_of(tmp_path, "T,x\n1,2\n", "t", "T", "x") == {"T": [1.0], "x": [2.0]}
    assert csv_of(tmp_path, "tt,x\n1,2\n") == {"x": [2.0]}


def test_text_before_a_heading_is_told_within_fifty_lines(tmp_path):
    """A heading has two of the wanted names, or more; a line may stand in quotes."""
    told = 'comes after text, "Bench": expected it first, or # before each line of the text'
    for lines, found in ((49, True), (50, False)):
        text = "Bench\n" + "no load\n" * lines + '"t"; "x"\n1;2\n'
        said = csv_of(tmp_path, text)
        assert said == (f'the heading ""t"; "x"" {told}' if found else "columns Bench: expected t, x")
    assert csv_of(tmp_path, "Bench\nt\n1\n") == "columns Bench: expected t, x"


@pytest.mark.parametrize(
    ("name", "columns", "said"),
    [
        ("a.npz", {"x": np.zeros(3), "y": np.zeros(4)}, "columns of 3 and 4 rows: expected one clock"),
        ("a.npz", {"z": np.zeros(3)}, "no rows: expected a log"),
        ("a.npz", {"x": np.zeros(0)}, "no rows: expected a log"),
        (
            "a.npz",
            {"x": np.array([1.0, np.nan, np.inf])},
            "x: row 2: nan: expected a finite number (2 rows lack one)",
        ),
        ("a.npz", {"x": np.array(["a", "b"])}, "x: expected numbers"),
        (
            "a.npz",
            {"x": np.array([None])},
            "no NPZ file, or one with objects in it: expected arrays of numbers",
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
        ("a.npz", b"PK\x03\x04 cut", ": File is not a zip file: expected a readable .npz file"),
        ("a.npz", b"not at all", ": no NPZ file, or one with objects in it: expected arrays of numbers"),
        ("a.csv.gz", gzip.compress(b"x\n1\n", mtime=0)[:-9], ": expected a readable .csv file"),
        ("A.CSV.GZ", b"x\n1\n", ": expected a readable .csv file"),
        ("a.mat", b"text" * 40, ": expected a MAT file"),
        ("a.parquet", b"text" * 40, ": expected a Parquet file"),
        ("a.mf4", b"text" * 40, ": expected an MDF file"),
        ("a.nc", b"text" * 40, ": expected a readable .nc file"),
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


class Channels:
    """Stands in for an MDF file: x rises twice as fast as the time, and y as fast, in fewer rows."""

    def __init__(self, path):
        rows = {"x": np.array([0.0, 0.5, 1.0]), "y": np.array([0.0, 1.0]), "t": np.array([0.0, 0.5, 1.0])}
        self.channels = {name: self.signal(t, (2 if name == "x" else 1) * t) for name, t in rows.items()}
        if path.name == "bare.mf4":
            del self.channels["t"]

    def signal(self, timestamps, samples):
        return SimpleNamespace(
            timestamps=timestamps, interp=lambda t: SimpleNamespace(samples=np.interp(t, timestamps, samples))
        )

    def __enter__(self):
        return self

    def __exit__(self, *of):
        return None

    def __contains__(self, name):
        return name in self.channels

    def get(self, name):
        return self.channels[name]


def test_channels_are_brought_to_the_time_of_the_first(tmp_path, monkeypatch):
    """Without a channel of the time it is that of the first channel that is wanted."""
    error = type("MdfException", (Exception,), {})
    monkeypatch.setitem(sys.modules, "asammdf", SimpleNamespace(MDF=Channels))
    monkeypatch.setitem(sys.modules, "asammdf.blocks", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "asammdf.blocks.utils", SimpleNamespace(MdfException=error))

    def columns(name, *wanted):
        ((_, found),) = read(tmp_path / name, list(wanted))
        return {key: values.tolist() for key, values in found.items()}

    own = {"x": [0.0, 1.0, 2.0], "y": [0.0, 0.5, 1.0]}
    assert columns("a.mf4", "t", "x", "y", "z") == {"t": [0.0, 0.5, 1.0], **own}
    assert columns("bare.mf4", "t", "x", "y", "z") == {"t": [0.0, 0.5, 1.0], **own}
    assert columns("bare.mf4", "y", "x") == {"y": [0.0, 1.0], "x": [0.0, 2.0]}
    with pytest.raises(StudyError, match=r"no such channels: expected z$"):
        columns("a.mf4", "z")


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
