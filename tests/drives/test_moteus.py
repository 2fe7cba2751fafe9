"""moteus: from its logs and its dump to a table in its own format, and back into a stand-in of it."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import RUNS, TURN, ripple
from drives.moteus_stand_in import Moteus, python_csv, tview_csv, tview_jsonl

from cogless.drives import moteus
from cogless.drives.adapter import TableFrame
from cogless.drives.holding_current import HoldingCurrent, residue
from cogless.errors import StudyError

SLOW = [(0.0, 0.5 * TURN), (4.0, 0.5 * TURN)]
RUN_LISTS: dict[int, dict[str, dict[str, np.ndarray]]] = {}


def runs(sign: int) -> dict[str, dict[str, np.ndarray]]:
    """The logs' motions of a drive whose output counts this way, with a gear where it counts backwards."""
    if sign not in RUN_LISTS:
        drive = drive_of(sign)
        RUN_LISTS[sign] = {name: drive.run(points) for name, points in RUNS.items()}
    return RUN_LISTS[sign]


def drive_of(sign: int) -> Moteus:
    return Moteus(sign=sign, ratio=1.0 if sign > 0 else 0.25)


def true_table(drive: Moteus, late: float = 0.0) -> str:
    """Lines of the table that holds the rotor exactly, but for its rounding; `late`: in entries."""
    index = TURN / 1024 * (np.arange(1024) + late)
    values = drive.sign * drive.plant.holding(index - drive.encoder_zero)
    scale = float(np.max(np.abs(values))) / 127
    entries = "".join(f"motor.cogging_dq_comp.{n} {round(v / scale)}\n" for n, v in enumerate(values))
    return f"motor.cogging_dq_scale {scale}\n{entries}"


def left_by(sign: int, table: str, way: int = 1) -> float:
    """Ripple at half a turn a second with these lines restored, rad/s rms. `way`: -1 turns backward."""
    drive = drive_of(sign)
    drive.restore(table)
    return ripple(drive.run([(t, way * speed) for t, speed in SLOW]))


def left_both_ways(sign: int, table: str) -> float:
    """The same of both directions, rms: a table is one for both.

    The current loop's lag moves what acts against the turning, and the half count by which an encoder reads
    low moves it one way. So the true table alone leaves 1.6 times as much in one direction as in the other.
    """
    return math.hypot(left_by(sign, table), left_by(sign, table, way=-1)) / math.sqrt(2)


@pytest.mark.parametrize(("sign", "form"), [(1, "csv"), (-1, "csv"), (1, "jsonl"), (-1, "python")])
def test_a_table_from_logs_takes_the_ripple_away_as_the_true_one_does(
    sign: int, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, logs = drive_of(sign), []
    for name, run in runs(sign).items():
        if form == "csv":
            logs += tview_csv(run, tmp_path, name)
        elif form == "jsonl":
            logs.append(tview_jsonl(run, tmp_path / f"{name}.jsonl"))
        else:
            logs.append(python_csv(run, tmp_path / f"{name}.csv"))
    dump = drive.dump(tmp_path / "dump.cfg")
    code, out, err = cogless(capsys, "identify", *logs, "--drive-config", dump, "-o", tmp_path / "found")
    assert (code, err) == (0, "")
    assert f"Next: cogless table {tmp_path / 'found'} --to moteus -o FILE\n  or: cogless run" in out
    assert "its first lines are those of moteus, a log of " in out
    values = json.loads((tmp_path / "found" / "identified.json").read_text())
    for key, truth in (("j", drive.plant.inertia), ("c", drive.plant.coulomb), ("b", drive.plant.viscous)):
        told = values["values"][key]
        assert abs(told["value"] - truth / drive.plant.K_t) < 1.2 * told["error"], key
    code, out, err = cogless(
        capsys, "table", tmp_path / "found", "--to", "moteus", "-o", tmp_path / "cogging.cfg"
    )
    assert (code, err) == (0, "")
    assert "--restore-config" in out and "Check the sign" in out
    table = (tmp_path / "cogging.cfg").read_text()
    none, exact, mine = (left_both_ways(sign, lines) for lines in ("", true_table(drive), table))
    assert exact < 0.1 * none
    assert mine < 1.2 * exact, (none, exact, mine)
    scale = float(table.splitlines()[1].split()[1])
    third, wrong = (
        left_both_ways(sign, table + f"motor.cogging_dq_scale {share * scale:.4g}\n") for share in (0.3, -0.3)
    )
    assert third < 0.85 * none < none < wrong  # the check of the sign that the command prints


def ripples_in(out: str) -> dict[int, list[float]]:
    """What `cogless table` predicts, r/min rms by r/min: without the table, with it, 30 %, -30 %."""
    lines = [line for line in out.splitlines() if line.startswith("Predicted ripple at ")]
    number = r"[\d.]+(?:e-?\d+)?"
    pattern = (
        rf"at (\d+) rpm: ({number}) .* ({number}) with it\. .*: ({number}) with 30 .*, ({number}) with "
        "-30"
    )
    matches = [re.search(pattern, line) for line in lines]
    return {int(match[1]): [float(match[n]) for n in (2, 3, 4, 5)] for match in matches if match}


@pytest.mark.parametrize("sign", [1, -1])
def test_the_ripple_that_is_predicted_comes(
    sign: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the stand-in, which the prediction knows by the logs and the dump only; the study runs, too."""
    drive = drive_of(sign)
    logs = [tview_csv(run, tmp_path, name) for name, run in runs(sign).items()]
    dump = drive.dump(tmp_path / "dump.cfg", servo__pid_dq__kp="2.83", servo__pid_dq__ki="5027")  # 1 kHz
    found, table = tmp_path / "found", tmp_path / "cogging.cfg"
    code, _, _ = cogless(
        capsys, "identify", *(p for pair in logs for p in pair), "--drive-config", dump, "-o", found
    )
    assert code == 0
    command = ["table", found, "--to", "moteus", "-o", table, "--study", tmp_path / "try"]
    code, out, err = cogless(capsys, *command)
    assert (code, err) == (0, "")
    text = table.read_text()
    scale = float(text.splitlines()[1].split()[1])
    tables = ("", text, *(text + f"motor.cogging_dq_scale {s * scale:.4g}\n" for s in (0.3, -0.3)))
    played = [left_by(sign, lines) / TURN * 60 for lines in tables]
    predicted = ripples_in(out)[30]
    assert [predicted[n] for n in (0, 2, 3)] == pytest.approx([played[n] for n in (0, 2, 3)], rel=0.1)
    assert predicted[1] < 0.05 * predicted[0]
    code, out, _ = cogless(capsys, "run", tmp_path / "try" / "study.toml", "-o", tmp_path / "results")
    assert code == 0 and "table leaves" in out
    code, _, err = cogless(capsys, *command[:-1], found)
    assert code == 2 and f"--study: {found}: expected a folder other than" in err


def test_half_an_entry_late_leaves_more() -> None:
    drive = drive_of(1)
    assert left_by(1, true_table(drive, late=0.5)) > 2 * left_by(1, true_table(drive))


def waves(*parts: tuple[int, complex]) -> HoldingCurrent:
    spectrum = np.zeros(max(n for n, _ in parts) + 1, complex)
    for n, c in parts:
        spectrum[n] = c
    return HoldingCurrent(spectrum, 0.03, "test")


@pytest.mark.parametrize("direction", [1, -1])
def test_a_written_table_is_read_back_to_its_rounding(direction: int, tmp_path: Path) -> None:
    current = waves((12, 0.2 + 0.1j), (84, -0.05j), (250, 0.03))
    written = moteus.write(current, TableFrame("moteus", direction, zero=True))
    drive = Moteus()
    drive.restore(written.text)
    again = moteus.read_table(drive.dump(tmp_path / "dump.cfg"), None).turned(direction)
    if direction < 0:  # the index turns the other way, the current has the same sign
        again = HoldingCurrent(-again.waves, 0.0, "test")
    for n in (12, 84, 250):
        assert again.waves[n] == pytest.approx(current.waves[n], abs=1.5 * drive.scale / np.sqrt(1024 / 2))


def test_the_look_up_is_that_of_the_stand_in(tmp_path: Path) -> None:
    written = moteus.write(waves((12, 0.2), (84, 0.1j)), TableFrame("moteus", -1, zero=True))
    drive = Moteus()
    drive.restore(written.text)
    angles = np.linspace(-9, 9, 500)
    mine = written.applied(angles)
    assert mine == pytest.approx([drive.table(-angle) for angle in angles], abs=1e-6)


def test_each_order_is_as_large_as_it_is_between_the_entries() -> None:
    current = waves((84, 0.1), (200, 0.05j))
    written = moteus.write(current, TableFrame("moteus", zero=True))
    angle = TURN * np.arange(1 << 15) / (1 << 15)
    spectrum = 2 / len(angle) * np.fft.rfft(written.applied(angle))
    assert spectrum[84] == pytest.approx(0.1, rel=0.01)  # with entries of the current alone 2.2 % less
    assert spectrum[200] == pytest.approx(0.05j, rel=0.01)


def test_orders_that_the_table_cannot_hold_are_told() -> None:
    written = moteus.write(waves((84, 0.1), (600, 0.1)), TableFrame("moteus", zero=True))
    rest = residue(waves((84, 0.1), (600, 0.1)), 1024, written.applied)
    assert rest.order == 600 and rest.amplitude == pytest.approx(0.1, rel=0.01)


def histogram(drive: Moteus, load: float = 0.0) -> dict[str, list[float]]:
    """What compensate_cogging.py writes: the mean of q_A in each bin of the encoder, friction in it."""
    fine = TURN / (1024 * 8) * (np.arange(1024 * 8) + 0.5)
    mean = (drive.sign * drive.plant.holding(fine - drive.encoder_zero)).reshape(1024, 8).mean(axis=1)
    friction = drive.plant.coulomb / drive.plant.K_t
    return {"reverse": list(mean - friction + load), "forward": list(mean + friction + load)}


@pytest.mark.parametrize("load", [0.0, 0.4])
def test_its_own_calibration_makes_a_better_table_than_its_own_tool(
    load: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = drive_of(1)
    source = tmp_path / "cogging.json"
    measured = histogram(drive, load)
    source.write_text(json.dumps(measured))
    command = ["table", source, "--from", "moteus", "--to", "moteus", "-o", tmp_path / "table.cfg"]
    code, _, err = cogless(capsys, *command)
    assert (code, err) == (0, "")
    mean = (np.array(measured["forward"]) + measured["reverse"]) / 2
    scale = np.max(np.abs(mean)) / 127
    its_own = f"motor.cogging_dq_scale {scale}\n" + "".join(
        f"motor.cogging_dq_comp.{n} {int(value / scale)}\n" for n, value in enumerate(mean)
    )
    exact, own = left_by(1, true_table(drive)), left_by(1, its_own)
    mine = left_by(1, (tmp_path / "table.cfg").read_text())
    assert mine < 1.5 * exact < own


def lines_of(err: str) -> list[str]:
    return [line for line in err.splitlines() if line]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motor__poles": "0"}, "motor.poles: 0: expected poles of a calibrated motor"),
        ({"motor__poles": ""}, "motor.poles: missing: expected the dump of moteus_tool"),
        ({"motor__Kv": "nan"}, "motor.Kv: nan: expected the Kv"),
        ({"servo__max_current_A": "many"}, 'servo.max_current_A: "many": expected a current'),
        (
            {"motor_position__sources__0__reference": "1", "motor_position__rotor_to_output_ratio": "0.1"},
            "motor_position.sources.0.reference: 1: expected 0, a commutation source on the rotor",
        ),
    ],
)
def test_a_dump_that_does_not_fit_is_one_line(
    change: dict[str, str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = python_csv(runs(1)["accel"], tmp_path / "accel.csv")
    dump = Moteus().dump(tmp_path / "dump.cfg", **change)
    code, _, err = cogless(capsys, "identify", log, "--drive-config", dump, "-o", tmp_path / "out")
    assert code == 2 and len(lines_of(err)) == 1
    assert f"{dump}: {message}" in err


def test_what_is_missing_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = runs(1)["accel"]
    stats, place = tview_csv(run, tmp_path, "accel")
    dump = Moteus().dump(tmp_path / "dump.cfg")
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    out = ["-o", tmp_path / "out"]
    cases = {
        (stats,): f"{stats}: a log of moteus: expected --drive-config FILE with the dump of moteus_tool",
        (
            place,
            "--drive-config",
            dump,
        ): f"{place}: expected one log of channel servo_stats from the same time (found: none), or",
        (other,): f"{other}: its first lines fit no known drive: expected --config FILE",
        (other, "--drive", "moteus", "--drive-config", dump): f'{other}: no column "time"; it has a, b',
        (
            stats,
            "--drive",
            "motus",
        ): '--drive: "motus": expected one of moteus, odrive, vesc, simplefoc, klipper, prusa\n',
        (stats, "--drive-config", other): f"{other}: motor.poles: missing: expected the dump",
    }
    for arguments, message in cases.items():
        code, _, err = cogless(capsys, "identify", *arguments, *out)
        assert (code, len(lines_of(err))) == (2, 1), err
        assert message in err


@pytest.mark.parametrize("firmware", ["with a table", "without"])
def test_a_table_needs_the_index(firmware: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The output's position has another zero; older firmware has no table."""
    logs = [python_csv(run, tmp_path / f"{name}.csv", encoder=False) for name, run in runs(1).items()]
    changes = {} if firmware == "with a table" else {"motor__cogging_dq_scale": ""}
    dump = Moteus().dump(tmp_path / "dump.cfg", **changes)
    code, out, err = cogless(capsys, "identify", *logs, "--drive-config", dump, "-o", tmp_path / "found")
    assert (code, err) == (0, "")
    assert "No cogging table can be written for this drive, since " in out and "cogless table" not in out
    code, _, err = cogless(capsys, "table", tmp_path / "found", "--to", "moteus")
    assert code == 2 and len(lines_of(err)) == 1
    expected = (
        "expected channel motor_position (sources.0.filtered_value)" if not changes else "expected firmware"
    )
    assert expected in err


def test_a_table_that_is_on_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The identified current is the whole one, so the new table replaces the one that was on."""
    drive = drive_of(1)
    half = true_table(drive).splitlines()
    drive.restore("\n".join([f"motor.cogging_dq_scale {0.5 * float(half[0].split()[1])}", *half[1:]]))
    logs = [tview_csv(drive.run(points), tmp_path, name) for name, points in RUNS.items()]
    dump = drive.dump(tmp_path / "dump.cfg")
    files = [file for pair in logs for file in pair]
    code, out, _ = cogless(capsys, "identify", *files, "--drive-config", dump, "-o", tmp_path / "found")
    assert code == 0 and f"{dump}: the drive has a cogging table" in out
    cogless(capsys, "table", tmp_path / "found", "--to", "moteus", "-o", tmp_path / "cogging.cfg")
    mine = left_by(1, (tmp_path / "cogging.cfg").read_text())
    assert mine < 0.1 * left_by(1, "")


def test_channels_of_two_drives_do_not_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stats, place = tview_csv(runs(1)["accel"], tmp_path, "accel")
    _, other = tview_csv(runs(1)["slow"], tmp_path, "slow")
    other.replace(place)
    dump = Moteus().dump(tmp_path / "dump.cfg")
    code, _, err = cogless(capsys, "identify", stats, place, "--drive-config", dump, "-o", tmp_path / "out")
    assert code == 2 and "do not move alike" in err and len(lines_of(err)) == 1


def test_channels_meet_by_their_time(tmp_path: Path) -> None:
    """Files may have any name; of logs made at one time those of one name belong together."""
    dump = Moteus().dump(tmp_path / "dump.cfg")
    stats, place = tview_csv(runs(1)["accel"], tmp_path, "accel")
    renamed = [path.rename(tmp_path / name) for path, name in ((stats, "a.csv"), (place, "b.csv"))]
    logs = moteus.read_logs(renamed, dump)
    assert [log.path.name for log in logs.recordings] == ["a.csv"] and logs.frame.zero
    more = tview_csv(runs(1)["slow"], tmp_path, "slow") + tview_csv(runs(1)["fast"], tmp_path, "fast")
    assert len(moteus.read_logs(more, dump).recordings) == 2
    with pytest.raises(
        StudyError,
        match=r"b.csv: .* servo_stats from the same time \(found: a.csv, slow_1_\S+, fast_1_\S+\), ",
    ):
        moteus.read_logs([*renamed, *more], dump)
    with pytest.raises(
        StudyError,
        match=r"lacks the angle over which moteus reads its cogging table, "
        r"which other",
    ):
        moteus.read_logs(more[:3], dump)


@pytest.mark.parametrize("form", ["csv", "jsonl"])
@pytest.mark.parametrize("short", ["servo_stats", "motor_position"])
def test_a_channel_that_ends_early_is_told_and_used_up_to_there(
    form: str, short: str, tmp_path: Path
) -> None:
    from cogless.drives.registry import prepare

    slow = runs(1)["slow"]
    if form == "csv":
        logs = tview_csv(slow, tmp_path, "slow")
        cut = next(path for path in logs if short in path.name)
        lines = cut.read_text().splitlines(True)
        cut.write_text("".join(lines[: len(lines) // 2]))
        ended = cut.name
    else:
        logs = [tview_jsonl(slow, tmp_path / "slow.jsonl")]
        lines = logs[0].read_text().splitlines(True)
        kept = [line for k, line in enumerate(lines) if short not in line or k < len(lines) / 2]
        logs[0].write_text("".join(kept))
        ended = f"slow.jsonl: {short}"
    prepared = prepare(logs, "moteus", Moteus().dump(tmp_path / "dump.cfg"), None)
    (log,) = prepared.logs
    whole = slow["t"][-1]
    assert log.duration == pytest.approx(whole / 2 if short == "servo_stats" else whole, rel=0.01)
    (remark,) = log.remarks
    times = re.match(rf"{ended} ends at ([\d.]+) s, .* at ([\d.]+) s: rows after \1 s are left out\.", remark)
    assert times is not None, remark
    assert [float(time) for time in times.groups()] == pytest.approx([whole / 2, whole], rel=0.02)
    assert prepared.frame.zero and prepared.frame.zero_error < 1e-3


def test_the_drives_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = cogless(capsys, "drives")
    assert code == 0 and "moteus" in out and "verified in the drive's source" in out


def test_a_file_beside_the_drive_adds_and_replaces(tmp_path: Path) -> None:
    """A word for the magnet replaces the drive's; kinds of logs are said; columns are the drive's own."""
    from cogless.drives.registry import prepare

    logs = [python_csv(run, tmp_path / f"{name}.csv") for name, run in runs(1).items()]
    dump, more = Moteus().dump(tmp_path / "dump.cfg"), tmp_path / "more.toml"
    more.write_text(
        'motor = { K_t = "0.04 N*m/A", slots = 12 }\n[[log]]\nfile = "accel*"\nkind = "acceleration"\n'
    )
    prepared = prepare(logs, "moteus", dump, more)
    motor = prepared.identification.motor
    assert motor.star().K_t == pytest.approx(0.04) and (motor.slots, motor.pole_pairs) == (12, 7)
    assert {log.name: log.kind for log in prepared.logs} == {
        "slow.csv": "",
        "fast.csv": "",
        "accel.csv": "acceleration",
    }
    older = Moteus().dump(tmp_path / "older.cfg", motor__Kv="", motor__v_per_hz="0.2")
    assert prepare(logs, "moteus", older, more).identification.motor.star().K_t == pytest.approx(0.04)
    with pytest.raises(StudyError, match=r"older.cfg: motor: expected a constant of the magnet, .*kv = "):
        prepare(logs, "moteus", older, None)
    more.write_text('columns = { t = "time" }\n')
    with pytest.raises(StudyError, match=f"{more}: columns: expected one of title, motor, drive, .*moteus"):
        prepare(logs, "moteus", dump, more)
    more.write_text('motor = { slots = "many" }\n')
    with pytest.raises(StudyError, match=f'{more}: motor.slots: "many": expected a whole number'):
        prepare(logs, "moteus", dump, more)
