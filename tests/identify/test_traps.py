"""Logs that mislead end in one clear sentence with its cure, and in nothing false."""

from __future__ import annotations

import gzip
import math
import re
from pathlib import Path

import numpy as np
import pytest
from identify.commissioned import commissioned, write

from cogless.errors import StudyError
from cogless.identify import config
from cogless.identify.command import standing_out
from cogless.identify.estimate import estimate_motor
from cogless.identify.log import load_logs
from cogless.identify.result import Estimate

INERTIA = 5e-4  # kg m^2, of the servo


def shortened() -> tuple[str, dict[str, dict[str, np.ndarray]]]:
    """The servo's logs, as much of them as a test needs."""
    text, logs = commissioned("servo", late=1)
    names = {"one-speed": slice(2000, 6000), "fast": slice(1000, 3400), "acceleration": slice(0, 5000)}
    return text, {name: {key: x[rows] for key, x in logs[name].items()} for name, rows in names.items()}


def told(folder: Path, text: str, logs: dict[str, dict[str, np.ndarray]]) -> Estimate:
    paths = write(folder, text, logs)
    known = config.load(folder / "id.toml")
    return estimate_motor(known, load_logs(paths, known), lambda what, share: None)


def refused(folder: Path, text: str, logs: dict[str, dict[str, np.ndarray]]) -> str:
    with pytest.raises(StudyError) as error:
        told(folder, text, logs)
    return str(error.value)


def changed(logs, name, **signals):
    return {**logs, name: {**logs[name], **signals}}


def test_one_speed_tells_no_inertia(tmp_path):
    text, logs = shortened()
    said = refused(tmp_path, text, {"one-speed": logs["one-speed"]})
    assert said.startswith(
        "The logs have only one speed (1 rev/s): inertia, friction and delay cannot be identified"
    )
    assert "add an acceleration log and a second speed" in said


def test_a_current_of_the_wrong_sign_is_refused_with_the_line_that_turns_it(tmp_path):
    text, logs = shortened()
    said = refused(tmp_path, text, changed(logs, "fast", i_q=-logs["fast"]["i_q"]))
    assert said.startswith("fast.npz: i_q: inertia and friction come out negative")
    assert 'columns.i_q = { name = "i_q", sign = -1 }' in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: {"t": np.round(s["t"] + 1.7e9)}, "of 4000 rows have the time of the row before"),
        (
            lambda s: {"theta": np.degrees(s["theta"]) % 360},
            'the angle looks like degrees: unit = "deg"',
        ),
        (lambda s: {"theta": s["theta"] % (6.55 * 2 * np.pi)}, "the angle jumps by 41.1"),
        (lambda s: {"theta": 4 * s["theta"]}, "expected units that agree; the angle looks electrical"),
    ],
    ids=["digits-of-time", "degrees", "counter-overflows", "electrical"],
)
def test_a_column_that_cannot_be_is_refused_with_its_cure(tmp_path, change, said):
    text, logs = shortened()
    log = logs["one-speed"]
    log["theta"] = 6 * log["theta"]  # several turns
    log["omega"] = 6 * log["omega"]
    assert said in refused(tmp_path, text, changed({"one-speed": log}, "one-speed", **change(log)))


def test_a_pause_in_a_log_is_a_gap_and_no_wrong_unit(tmp_path):
    text, logs = shortened()
    t = logs["fast"]["t"].copy()
    t[len(t) // 2 :] += 3.7
    made = told(tmp_path, text, changed(logs, "fast", t=t))
    assert any("fast.npz: 1 gaps, the longest 3.7" in line for line in made.remarks)
    assert made.values["j"].value * made.K_t == pytest.approx(INERTIA, rel=0.02)


def test_a_rotor_that_sticks_is_told_with_the_speed_at_which_it_would_not(tmp_path):
    text, logs = shortened()
    log = logs["one-speed"]
    passed = log["t"] % 0.1
    late = log["t"] - passed + np.maximum(0, 2 * passed - 0.1)  # it waits for 50 ms, then turns twice as fast
    slipping = {key: np.interp(late, log["t"], log[key]) for key in ("theta", "omega")}
    made = told(tmp_path, text, changed(logs, "one-speed", **slipping))
    (line,) = (line for line in made.remarks if line.startswith("one-speed.npz: the rotor stands still"))
    assert "the rotor sticks and slips at" in line
    speed, rows = re.findall(r"at ([\d.]+) rev/s.* with (\d+) rows a second", line)[0]
    assert float(speed) == pytest.approx(2, rel=0.2)
    assert float(rows) == pytest.approx(max(1000, 3 * 24 * float(speed)), rel=0.06)  # order 6 p in sight
    assert "one-speed.npz" not in {log.name for log in made.logs}


def test_the_sign_of_a_column_turns_it(tmp_path):
    text, logs = shortened()
    turned = {name: {**log, "i_q": -log["i_q"], "i_d": -log["i_d"]} for name, log in logs.items()}
    text = text.replace('i_q = "i_q"', 'i_q = { name = "i_q", sign = -1 }')
    text = text.replace('i_d = "i_d"', 'i_d = { name = "i_d", sign = -1 }')
    made = told(tmp_path, text, turned)
    assert made.values["j"].times(made.K_t).value == pytest.approx(INERTIA, rel=0.02)


@pytest.mark.parametrize(
    ("without", "sentence"),
    [
        (
            "theta",
            "no angle{}: cogging cannot be placed; record the encoder's angle as theta.",
        ),
        (
            "i_q",
            "no current{}: torque is not known; record i_q, or give",
        ),
    ],
)
def test_a_log_without_angle_or_current_says_what_to_record(tmp_path, without, sentence):
    text, logs = shortened()
    poor = {name: {key: x for key, x in log.items() if key != without} for name, log in logs.items()}
    lines = refused(tmp_path, text, poor).splitlines()
    assert len(lines) == len(logs)
    assert all(sentence.format("") in line for line in lines)
    whole = {key: x[:100] for key, x in next(iter(logs.values())).items()}
    lines = refused(tmp_path, text, {**poor, "whole": whole}).splitlines()
    assert sum(sentence.format(f' (no column "{without}")') in line for line in lines) == len(logs)


@pytest.mark.parametrize("every", [5, 20])
def test_few_rows_tell_inertia_and_leave_out_what_they_cannot_show(tmp_path, every):
    """200 and 50 Hz."""
    text, logs = shortened()
    seldom = {name: {key: x[::every] for key, x in log.items()} for name, log in logs.items()}
    made = standing_out(told(tmp_path, text, seldom))
    inertia = made.values["j"].times(0.3)
    assert abs(inertia.value - INERTIA) < inertia.error < 0.2 * INERTIA
    assert {wave.order for wave in made.cogging} <= {4, 24, 72}


def test_an_index_that_slips_between_logs_leaves_cogging_out(tmp_path):
    text, logs = shortened()
    logs["slow"] = {key: x[2000:7000] for key, x in commissioned("servo", late=1)[1]["slow"].items()}
    theta = (logs["one-speed"]["theta"] + 0.1) % (2 * np.pi)
    made = told(tmp_path, text, changed(logs, "one-speed", theta=theta))
    assert any(
        "the phase of order 24 differs by" in line and "index has slipped" in line for line in made.remarks
    )
    assert "Cogging is left out, since its place differs between the logs." in made.left_out
    assert made.cogging == ()
    assert made.values["j"].times(made.K_t).value == pytest.approx(INERTIA, rel=0.02)


def test_an_index_that_slips_within_a_log_cuts_it_there(tmp_path):
    text, logs = shortened()
    theta = logs["one-speed"]["theta"].copy()
    theta[3000:] = (theta[3000:] + 0.1) % (2 * np.pi)
    write(tmp_path, text, changed(logs, "one-speed", theta=theta))
    known = config.load(tmp_path / "id.toml")
    (log,) = load_logs([tmp_path / "one-speed.npz"], known)
    assert len(log) == 3000
    assert any("row 3001: the angle jumps by" in line for line in log.remarks)


def test_sessions_of_different_friction_are_told(tmp_path):
    text, logs = shortened()
    more = logs["one-speed"]["i_q"] + 0.1 * np.sign(logs["one-speed"]["omega"])
    made = told(tmp_path, text, changed(logs, "one-speed", i_q=more))
    assert any(
        line.startswith("Sessions differ: friction 0.1") and "one-speed.npz" in line for line in made.remarks
    )


def test_a_feedback_law_is_no_plant(tmp_path):
    text, logs = shortened()
    omega = logs["one-speed"]["omega"]
    law = np.roll(-0.05 * (omega - 6.28), 2)
    made = told(tmp_path, text, changed(logs, "one-speed", i_q=law))
    (said,) = [line for line in made.remarks if "feedback law" in line]
    assert said.startswith(
        "one-speed.npz: i_q follows the speed with a gain of 0.05 A*s/rad, 2 samples late (correlation "
        "1.0000)"
    )
    assert said.endswith("add an acceleration log.")
    assert made.values["j"].times(made.K_t).value == pytest.approx(INERTIA, rel=0.02)


CSV = "t,theta,omega,i_q\n" + "".join(f"{n / 1000},{0.01 * n:.5f},10,{0.1}\n" for n in range(200))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"", "a.csv: empty: expected a heading and rows of numbers"),
        ("a.csv", b"t,theta\n", "a.csv: no rows: expected a log"),
        (
            "a.csv",
            CSV.replace("0.01,0.10000", "0.01,x").encode(),
            'a.csv: theta: row 11: "x": expected a number',
        ),
        (
            "a.csv",
            CSV.replace("0.01,0.10000,10,0.1", "0.01").encode(),
            "a.csv: theta: row 11: missing: expected",
        ),
        (
            "a.csv",
            CSV.replace("0.01,0.10000,10,0.1", "0.01,0,10000,10,0.1").encode(),
            "a.csv: row 11: 5 cells: expected 4, as in the heading, with decimal points, not commas",
        ),
        (
            "a.csv",
            CSV.replace("omega", "theta", 1).encode(),
            "a.csv: theta: 2 columns have this heading: expected one",
        ),
        ("a.csv", b"# made by a drive\n\n", "a.csv: empty: expected a heading and rows of numbers"),
        ("a.csv", CSV.encode("utf-16-le") + b"\xff", "a.csv: not UTF-8: expected a CSV in UTF-8"),
        (
            "a.csv",
            b"t,theta,omega,I_q [A]\n1,2,3,4\n",
            'a.csv: no column "i_q" (i_q; similar: "I_q [A]"): expected in [columns] a heading that '
            "this "
            "file has",
        ),
        (
            "a.csv",
            b"time,angle\n1,2\n",
            'a.csv: no column "t" (t), "theta" (theta), "omega" (omega), "i_q" (i_q); it has "time", ',
        ),
        (
            "a.csv",
            CSV.replace("t,theta", "T,theta").encode(),
            'a.csv: no column "t" (t; similar: "T"): expected in [columns] a heading that this file has',
        ),
        (
            "a.csv",
            CSV.replace("\n0.1,", "\n0.01,").encode(),
            "a.csv: t: row 101: the time goes back: expected one clock",
        ),
        ("a.csv.gz", CSV.encode(), "a.csv.gz: Not a gzipped file"),
        ("a.csv.gz", gzip.compress(CSV.encode(), mtime=0)[:80], "a.csv.gz: Compressed file ended"),
        (
            "a.xls",
            CSV.encode(),
            "a.xls: unknown kind of file: expected one of .csv, .txt, .tsv, .npz, .parquet, .mat, .mf4, .nc",
        ),
        ("a.npz", b"PK no", "a.npz: "),
        ("a.mat", b"no", "a.mat: "),
        ("a.parquet", b"no", "a.parquet: "),
    ],
)
def test_a_bad_file_is_told_in_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    text = fewer_columns()
    (tmp_path / "id.toml").write_text(text)
    with pytest.raises(StudyError) as error:
        load_logs([tmp_path / name], config.load(tmp_path / "id.toml"))
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{tmp_path}/{message}")


def fewer_columns() -> str:
    """The file of columns for those that the CSV has."""
    columns = (f'{name} = "{name}"' for name in ("i_d", "i_q_ref", "u_q"))
    text = shortened()[0]
    for column in columns:
        assert column in text
        text = text.replace(column, "")
    return text


ROWS = [[float(x) for x in line.split(",")] for line in CSV.splitlines()[1:]]


@pytest.mark.parametrize(
    ("column", "factor", "said"),
    [
        (0, 1e3, 'omega is 1000 times .*; the time looks like milliseconds: unit = "ms"'),
        (1, 180 / math.pi, 'omega is 0.01745 times .*; the angle looks like degrees: unit = "deg"'),
        (2, 30 / math.pi, 'omega is 9.549 times the change of theta over t: expected .*: unit = "rpm"'),
        (2, -1.0, "omega is -1 times .*; one of them counts backwards: sign = -1"),
        (
            2,
            4.0,
            "omega is 4 times .*: expected .*; the speed looks electrical: scale = 1/4$",
        ),
        (
            3,
            1e3,
            "i_q: row 1: 100 A, where the drive's limit is .* A: expected the column's unit, "
            'such as unit = "mA"',
        ),
    ],
)
def test_a_column_in_another_unit_is_told(tmp_path, column, factor, said):
    """A step of speed by an angle, a speed, a time or a current that is so many times too large."""
    rows = [[x * (factor if n == column else 1.0) for n, x in enumerate(row)] for row in ROWS]
    lines = ["t,theta,omega,i_q", *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = fewer_columns()
    (tmp_path / "id.toml").write_text(text)
    with pytest.raises(StudyError, match=f"a.csv: {said}"):
        load_logs([tmp_path / "a.csv"], config.load(tmp_path / "id.toml"))


def test_comments_and_blank_lines_above_the_heading_are_passed_over(tmp_path):
    (tmp_path / "a.csv").write_text(f"# made by a drive\n\n{CSV}", encoding="utf-8")
    (tmp_path / "id.toml").write_text(fewer_columns())
    (log,) = load_logs([tmp_path / "a.csv"], config.load(tmp_path / "id.toml"))
    assert len(log) == len(ROWS)


@pytest.mark.parametrize(
    ("was", "now", "message"),
    [
        ('theta = "theta"', 'angle = "theta"', 'columns.angle: "theta": expected one of "t", "theta"'),
        (
            'omega = "omega"',
            'omega = { name = "omega", unit = "A" }',
            'columns.omega.unit: "A": expected an angular',
        ),
        ("pole_pairs = 4", "pole_pairs = 0", "motor.pole_pairs: 0: expected a number of 1 or more"),
        ('kind = "slow-sweep"', 'kind = "sweep"', 'log.0.kind: "sweep": expected "hold", "slow-sweep"'),
        ('controller = "pi"', 'controller = "p"', 'log.0.controller: "p": expected one of "pi"'),
    ],
)
def test_a_mistake_in_the_file_of_columns_names_its_key(tmp_path, was, now, message):
    path = tmp_path / "id.toml"
    text = shortened()[0]
    assert was in text
    path.write_text(text.replace(was, now, 1))
    with pytest.raises(StudyError) as error:
        config.load(path)
    assert str(error.value).splitlines()[0].startswith(f"{path}: {message}")
