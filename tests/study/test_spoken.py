"""A user who wrote rpm reads rpm: the unit in which speeds and angles are told."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.study.base import speed_text, spoken_unit
from cogless.units import ANGLE, ANGULAR_SPEED, TORQUE, Dimension

NO_METRIC: dict[str, Any] = {"metric": []}
RADIANS = {"speed": "6 rad/s"}


@pytest.mark.parametrize(
    ("changes", "dimension", "unit"),
    [
        ({}, ANGULAR_SPEED, "rpm"),
        ({"metric.0.unit": "rev/s"}, ANGULAR_SPEED, "rev/s"),  # a metric's unit comes before a scenario's
        (NO_METRIC, ANGULAR_SPEED, "rpm"),
        # of two scenarios the first one's
        ({**NO_METRIC, "scenario.low.reference": RADIANS}, ANGULAR_SPEED, "rad/s"),
        ({**NO_METRIC, "scenario.low.reference": {"profile": [["0 s", "1 rev/s"]]}}, ANGULAR_SPEED, "rev/s"),
        # the motor's units describe no run
        ({"motor.cogging.0.phase": "30 deg", "mechanics.load": "2 mN*m"}, ANGLE, "rad"),
        ({"scenario.step.initial_angle": "5 deg"}, ANGLE, "deg"),
        ({"drive.position_sensor": {"kind": "resolver", "eccentricity": "1 mrad"}}, ANGLE, "mrad"),
        ({"scenario.low.load": "2 mN*m"}, TORQUE, "N*m"),
    ],
)
def test_the_first_unit_that_describes_a_run_counts(
    tmp_path: Path, changes: dict[str, Any], dimension: Dimension, unit: str
) -> None:
    assert spoken_unit(studies.study(tmp_path, changes), dimension) == unit


def test_a_speed_is_told_by_its_magnitude_in_four_digits(tmp_path: Path) -> None:
    assert speed_text(studies.study(tmp_path), -123.456 * math.pi / 30) == "123.5 rpm"
