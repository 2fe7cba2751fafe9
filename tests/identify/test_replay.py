"""What the logs are simulated with: a dead time as they tell it, where a drive can have it."""

from __future__ import annotations

import pytest
from identify.commissioned import MOTORS

from cogless.identify.replay import _likely, _said_of_dead_time
from cogless.identify.result import Value
from cogless.study.drive import Drive

OWN = 1e-7  # s, that the file of columns says


@pytest.fixture
def drive() -> Drive:
    tables = MOTORS["gimbal"]["drive"]
    return Drive.model_validate({**tables, "inverter": {"bus_voltage": "24 V", "dead_time": f"{OWN} s"}})


@pytest.mark.parametrize("told", [2e-7, -0.5e-7])
def test_a_dead_time_that_stands_out_is_simulated(drive, told):
    assert _likely(Value(told, 1e-8), drive) == told


@pytest.mark.parametrize(
    ("told", "error"),
    [
        (2e-7, 1.1e-7),  # within its error
        (-1.5e-7, 1e-8),  # less than none
        (1e-5, 1e-8),  # a tenth of the current loop's period
    ],
)
def test_a_dead_time_that_no_drive_has_is_not(drive, told, error):
    assert _likely(Value(told, error), drive) == 0


def test_a_dead_time_is_told_where_it_stands_out():
    assert _said_of_dead_time(Value(2e-7, 0.9e-7)).startswith(
        "The currents follow as with about 200 ns more dead time than the file of columns says"
    )
    assert _said_of_dead_time(Value(2e-7, 1.1e-7)) == _said_of_dead_time(Value(0.0, 0.0)) == ""
