"""Keys of the law microstepping: a mistake is one line that names the key and what was expected."""

from __future__ import annotations

import math
from typing import Any

import pytest

from cogless.errors import StudyError
from cogless.study import load

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
        ({TABLE: [{"order": 4, "magnitude": 0.25}]}, "order times magnitude below 1 rad together, not 1 rad"),
        ({TABLE: 9 * [{"order": 1, "magnitude": "1 mrad"}]}, "forward"),
        ({"drive.rates.speed_loop": "10 kHz"}, "expected drive.rates.speed_loop like current_loop"),
        ({"drive.bus": {"delay_command": "1 ms"}}, "expected no drive.bus"),
        (
            {"drive.position_sensor": {"kind": "encoder", "lines": 1000}},
            "expected the position sensor ideal, which only stands for the driver's coils",
        ),
        (
            {"scenario.20-mm-s.torque_mode": {"time": "0.1 s", "current": "0 A"}},
            "expected no torque_mode in scenario 20-mm-s",
        ),
    ],
)
def test_a_mistake_is_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StudyError) as error:
        load("printer", changes)
    assert message in str(error.value) and len(str(error.value).splitlines()) == 1


def test_a_servo_motor_has_no_microsteps() -> None:
    law = {"law": "microstepping", "current": "1 A"}
    with pytest.raises(StudyError, match='"microstepping": expected a motor of kind step'):
        load("uomodri", {"controller.steps": law})


def test_the_current_is_an_effective_one() -> None:
    law: Any = load("printer", {f"{PATH}.current": 0.5}).controller["table"]
    assert law.amplitude == pytest.approx(0.5 * math.sqrt(2))
    assert law.learned and not law.learns and law.holds_position
