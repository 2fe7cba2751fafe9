"""Advice of a finer sensor names what is to be had: the chips of `cogless new`, else that it is none."""

from __future__ import annotations

from pathlib import Path

import drafts
import pytest

from cogless.catalogue import sensor_bits, sensor_words
from cogless.run.cures import candidates
from cogless.run.simulate import simulate


@pytest.mark.parametrize(("encoder", "bits"), [("as5600", [14]), ("as5048", [16, 20])])
def test_a_coarse_chip_is_tried_against_the_finest_chip(
    encoder: str, bits: list[int], tmp_path: Path
) -> None:
    """What a setting may do is tried first: another speed method, or another bandwidth of the observer."""
    _, study = drafts.written(tmp_path, drafts.request("gimbal", "simplefoc", encoder))
    (scenario,) = study.scenario
    run = simulate(study, scenario, "pi")
    tried = candidates(study, run, study.metric[0], "sensor-steps")
    key = "drive.position_sensor.bits"
    assert [one.changes[key] for one in tried if key in one.changes] == bits
    assert tried[0].setting and any("observer_bandwidth" in name for name in tried[0].changes)


def test_the_chips_are_those_of_the_parts() -> None:
    assert sensor_bits()["AS5600"] == 12 and sensor_words(13) == "AS5047P, AS5048A, MT6701"
    assert sensor_words(20) == "more than any chip that `cogless new` knows"
