"""Keys of the law microstepping: a mistake is one line that names the key and what was expected."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.errors import StudyError
from cogless.files import shipped
from cogless.printer.corrections import Coefficient, Correction
from cogless.run.drive_config import control_layout, engine_config
from cogless.study import changed, load

SIGNS = {"forward": 1, "backward": -1}

PATH = "controller.table"
TABLE = f"{PATH}.correction.forward"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({f"{PATH}.current": "2 A"}, 'current: "2 A": expected at most 1.41421 A rms'),
        ({f"{PATH}.current": "0 A"}, 'current: "0 A": expected'),
        ({f"{PATH}.microsteps": 100}, "microsteps: 100: expected a power of two, such as 256"),
        ({f"{PATH}.microsteps": 2048}, "microsteps: 2048: expected"),
        ({TABLE: [{"order": 0, "magnitude": "0.1 rad"}]}, "order: 0: expected"),
        ({TABLE: [{"order": 1, "magnitude": "-0.1 rad"}]}, 'magnitude: "-0.1 rad": expected'),
        ({TABLE: [{"order": 4, "magnitude": 0.25}]}, "expected waves whose products order * magnitude add "
        "up to "
        "less than 1 rad, not 1 rad"),
        ({TABLE: 9 * [{"order": 1, "magnitude": "1 mrad"}]}, "forward"),
        ({"drive.rates.speed_loop": "10 kHz"}, "expected drive.rates.speed_loop equal to current_loop"),
        ({"drive.bus": {"delay_command": "1 ms"}}, "expected no drive.bus"),
        ({"drive.position_sensor": {"kind": "encoder", "lines": 1000}},
            "expected no drive.position_sensor, since a driver of step motors has none"),
        ({"scenario.20-mm-s.torque_mode": {"time": "0.1 s", "current": "0 A"}},
            "expected no torque_mode in scenario 20-mm-s"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(changes: dict[str, Any], message: str) -> None:
    assert message in studies.refusal(load, "printer", changes)


def printer_with_file(folder: Path, text: str | None, **more: Any) -> Any:
    """The study's correction out of a file beside it."""
    study = folder / "mine.toml"
    study.write_text(shipped("studies")["printer"].read_text("utf-8"), encoding="utf-8")
    if text is not None:
        (folder / "found.json").write_text(text, encoding="utf-8")
    return load(study, {f"{PATH}.correction": {"file": "found.json", **more}})


def test_a_correction_that_identify_wrote_is_taken(tmp_path: Path) -> None:
    waves: Any = {direction: {4: Coefficient(0.02j * sign, 1e-3)} for direction, sign in SIGNS.items()}
    found = Correction(motor="x", current=0.8, wavelength=8e-4, torque=None, directions=waves)
    study = printer_with_file(tmp_path, found.to_json())
    assert (wave := study.controller["table"].correction.forward[0]).order == 4
    assert (wave.magnitude, wave.phase) == pytest.approx((0.02, math.pi / 2))
    assert changed(study, {f"{PATH}.current": "0.5 A"}).controller["table"].correction.backward[0].phase < 0
    assert changed(study, {f"{PATH}.current": "0.5 A"}).controller["table"].correction.current == 0.8
    config = engine_config(study, "20-mm-s", "table")["controller"]["config"]
    assert control_layout("double").decode("cgl_microstepping_config", config)["forward"][0]["order"] == 4


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        (None, {}, "expected a file at"),
        ("[]", {}, "expected the correction.json that cogless identify writes"),
        ('{"forward": [{"order": 1}], "backward": []}', {}, "expected the correction.json that"),
        ('{"current_A_rms": 0.8, "forward": [{"order": 4, "magnitude_rad": 0.3, "phase_rad": 0}], '
            '"backward": []}', {}, "expected waves whose products order * magnitude add up to less than 1 "
            "rad, not "
            "1.2 rad"),
        ('{"current_A_rms": 0, "forward": [], "backward": []}', {},
            "expected the correction.json that cogless identify writes"),
        ("{}", {"current": "1 A"}, 'current: "1 A": expected no such key, since the file contains it'),
        ("{}", {"forward": [{"order": 1, "magnitude": 0.1}]}, "expected no such key, since the file "
                                                              "contains it: delete forward, or"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_one_line(
    tmp_path: Path, text: str | None, more: dict[str, Any], message: str
) -> None:
    assert message in studies.refusal(printer_with_file, tmp_path, text, **more)


def test_a_servo_motor_has_no_microsteps() -> None:
    law = {"law": "microstepping", "current": "1 A"}
    with pytest.raises(StudyError, match='"microstepping": expected a motor of kind step'):
        load("uomodri", {"controller.steps": law})


def test_the_current_is_an_effective_one() -> None:
    law: Any = load("printer", {f"{PATH}.current": 0.5}).controller["table"]
    assert law.amplitude == pytest.approx(0.5 * math.sqrt(2))
    assert law.learned and not law.learns and law.holds_position
