"""Each command that `cogless run` suggests at its end is executed as it stands, and does what it is for."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from commands import cogless
from drafts import request, written

import studies

OWN = """class Own:
    def step(self, inputs):
        return 0.3 * (inputs.omega_ref - inputs.omega_m)
"""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def suggested(capsys: pytest.CaptureFixture[str], *arguments: object) -> list[list[str]]:
    """The commands after the last line of the results, as words, without the program and the comment."""
    code, out, _ = cogless(capsys, "run", *arguments, "-o", "out")
    assert code == 0
    lines = out.replace(" \\\n", "").splitlines()
    last = lines[lines.index("Report: out/report.html") + 1 :]
    assert [line[:6] for line in last] == ["Next: ", "  or: "][: len(last)]
    words = [shlex.split(line[6:], comments=True) for line in last]
    assert {program for program, *_ in words} <= {"cogless"}
    return [options for _, *options in words]


def test_the_best_controller_is_exported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    studies.write(tmp_path)
    export, drives = suggested(capsys, "study.toml", "--no-limits")
    assert export[:4] == ["export", "study.toml", "--controller", "fair"]
    assert cogless(capsys, *export)[0] == 0 and (tmp_path / "firmware" / "README.md").is_file()
    assert [export, drives] == suggested(capsys, "study.toml", "--no-limits")  # replaces the earlier export
    code, out, _ = cogless(capsys, *drives)
    assert code == 0 and "cogging table" in out


def test_no_controller_is_exported_where_all_are_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A coarse encoder hides the cogging from the law that learns."""
    written(tmp_path, request("gimbal", "moteus", "incremental", speed=60))
    commands = suggested(capsys, "mine.toml", "--no-limits")
    code, out, _ = cogless(capsys, "run", "mine.toml", "--no-limits", "-o", "out")
    assert code == 0 and "all are alike: " in out
    assert [name for name, *_ in commands] == ["identify"]


@pytest.mark.parametrize(
    ("drive", "last"),
    [
        ("odrive", ["identify", "--plan", "mine.toml", "--drive", "odrive"]),
        ("moteus", ["identify", "--plan", "mine.toml", "--drive", "moteus"]),
        ("vesc", []),
        ("generic", []),
    ],
)
def test_the_way_to_a_table_is_that_of_the_drive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], drive: str, last: list[str]
) -> None:
    """A VESC takes no table. ODrive takes none, either, but code of the user's own may add its currents. A
    board of one's own runs the exported C."""
    written(tmp_path, request("gimbal", drive, "as5047", speed=60))
    commands = suggested(capsys, "mine.toml", "--no-limits", "--only", "*/pi")
    assert commands == ([last] if last else [])
    if "--plan" in last:
        assert cogless(capsys, *last)[0] == 0
        assert (tmp_path / "results" / "plan" / f"record_{drive}.py").is_file()
    changed = suggested(capsys, "mine.toml", "--no-limits", "--only", "*/pi", "--set", "seed=1")
    assert changed == ([["drives"]] if drive == "moteus" else [])  # a plan takes no changes


def test_a_comment_that_is_too_wide_stands_in_a_line_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, request("gimbal", "odrive", "as5047", speed=60))
    options = ("run", "mine.toml", "--no-limits", "--only", "*/pi", "-o", "out")
    monkeypatch.setattr("cogless.lines.terminal_columns", lambda *_: 80)
    narrow = cogless(capsys, *options)[1].splitlines()[-2:]
    assert narrow == [
        "Next: cogless identify --plan mine.toml --drive odrive",
        "    # a script that records logs, for a table of currents in code of your own",
    ]
    monkeypatch.setattr("cogless.lines.terminal_columns", lambda *_: 200)
    assert cogless(capsys, *options)[1].splitlines()[-1] == f"{narrow[0]}  {narrow[1].strip()}"


def test_one_controller_alone_is_not_the_best(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    studies.write(tmp_path)
    assert suggested(capsys, "study.toml", "--no-limits", "--only", "*/pi") == [["drives"]]


def test_the_export_has_the_changes_of_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    studies.write(tmp_path)
    change = "mechanics.inertia=2e-5 kg*m^2"
    export, _ = suggested(capsys, "study.toml", "--no-limits", "--set", change)
    assert export[-2:] == ["--set", change] and cogless(capsys, *export)[0] == 0


def test_no_export_is_suggested_that_would_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The folder has a file of the user's, or the best law is Python."""
    path = studies.write(tmp_path)
    (tmp_path / "firmware").mkdir()
    (tmp_path / "firmware" / "main.c").write_text("int main(void) { return 0; }")
    (only,) = suggested(capsys, "study.toml", "--no-limits")
    assert only == ["drives"]
    (tmp_path / "firmware" / "main.c").unlink()
    own = (
        "class Own:\n    def step(self, inputs):\n        return 0.3 * (inputs.omega_ref - inputs.omega_m)\n"
    )
    (tmp_path / "own.py").write_text(own)
    text = path.read_text()
    rule = 'law = "pi"\ntuning = { rule = "phase-margin", phase_margin = "60 deg" }'
    assert rule in text
    path.write_text(text.replace(rule, 'law = "python"\nobject = "own.py:Own"'))
    assert [words[0] for words in suggested(capsys, "study.toml", "--no-limits")] == ["drives"]


def test_a_command_that_is_wider_than_the_terminal_is_broken_for_a_shell(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "a folder of drives that turn slowly"
    folder.mkdir()
    path = studies.write(folder).relative_to(tmp_path)
    monkeypatch.setattr("cogless.lines.terminal_columns", lambda *_: 60)
    code, out, _ = cogless(capsys, "run", path, "--no-limits", "-o", "out")
    last = out[out.index("Next: ") :]
    assert code == 0 and max(map(len, last.splitlines())) <= 60
    export = shlex.split(last.replace("\\\n", "").partition("  or:")[0].removeprefix("Next: "))
    assert export[1:] == f"export|{path}|--controller|fair|--to|c|-o|firmware".split("|")


def test_the_setting_that_holds_a_lost_speed_is_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A step motor whose rotor snaps from detent to detent at 20 r/min with either law."""
    written(tmp_path, request("nema17", "stepper", "as5047", speed=20))
    again, *_ = suggested(capsys, "mine.toml")
    limited = json.loads((tmp_path / "out" / "results.json").read_text())["limits"][0]
    assert limited["value"] is None and limited["tried"]
    assert again[:3] == ["run", "mine.toml", "--set"]
    export, *_ = suggested(capsys, *again[1:], "--no-limits")
    assert export[:4] == ["export", "mine.toml", "--controller", "harmonic"]
