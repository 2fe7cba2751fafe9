"""`make same` shows each line that a change alters, and none that only another run alters."""

from pathlib import Path

import pytest
import same


def folder(root: Path, name: str, files: dict[str, str]) -> Path:
    for path, text in files.items():
        same.write(root / name / path, text)
    return root / name


def test_a_changed_a_missing_and_a_new_file_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = folder(tmp_path, "kept", {"equal": "1\n", "a/changed": "1\n2\n3\n", "missing": "x\n"})
    now = folder(tmp_path, "now", {"equal": "1\n", "a/changed": "1\n2.5\n3\n", "new": "y\n"})
    unequal = {"a/changed": ["-2", "+2.5"], "missing": ["-x"], "new": ["+y"]}
    assert same.differences(kept, now) == unequal
    assert same.compare(kept, now) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "3 files differ"
    assert same.compare(kept, kept) == 0


def test_what_only_another_run_alters_is_no_difference(tmp_path: Path) -> None:
    first = {
        "results.json": '"run": "0123456789abcdef", "version": "0.1.0", "ripple_rad_s": 0.2512345678901233'
    }
    second = {
        "results.json": '"run": "fedcba9876543210", "version": "0.2.0", "ripple_rad_s": 0.2512345678901233'
    }
    third = {
        "results.json": '"run": "fedcba9876543210", "version": "0.2.0", "ripple_rad_s": 0.2512345678901234'
    }
    for hash_digit, files in zip("abc", (first, second, third), strict=True):
        files["live-data.txt"] = f"script-src 'sha256-{hash_digit * 43}='"
    kept, now, moved = (
        folder(tmp_path, name, files) for name, files in (("a", first), ("b", second), ("c", third))
    )
    assert same.differences(kept, now) == {}
    assert list(same.differences(kept, moved)) == ["results.json"]


def test_every_value_of_a_study_is_asked_for() -> None:
    tables = {"title": "a", "motor": {"cogging": [{"order": 6, "torque": 1.0}, {"order": 12}], "R_s": 1}}
    assert list(same.keys(tables)) == [
        "title", "motor.cogging.0.order", "motor.cogging.0.torque", "motor.cogging.1.order", "motor.R_s",
    ]  # fmt: skip


def test_wrong_values_are_kept_with_the_line_that_refuses_them() -> None:
    lines = same.refusals(same.studies()["smallest"]).splitlines()
    assert any(line.startswith("mechanics.inertia = -1: ") and "expected" in line for line in lines)
    assert not [line for line in lines if "Error: " in line]
    assert len(lines) > 40
