"""What a report says where the design is not sure that a run's result comes again."""

from __future__ import annotations

from pathlib import Path

import drafts
import pytest

from cogless import report
from cogless.design.answers import doubt
from cogless.run.simulate import run_study
from cogless.study import Study, changed

SENTENCE = "In another run, such as with --set seed=1, Harmonic may leave more: "


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A step motor with 14 bits, whose law takes the sensor's steps for motion."""
    numbers = {"holding_torque": 1.9, "rated_current": 2.8, "detent_torque": 0.04, "bits": 14, "speed": 60}
    of = drafts.request("nema23", "stepper", "absolute", load_inertia=3e-4, **numbers)
    return drafts.written(tmp_path_factory.mktemp("coarse"), of)[1]


def test_another_run_of_a_doubted_law_ends_otherwise_and_the_verdict_says_so(coarse: Study) -> None:
    why = doubt(coarse, "harmonic", "slow")
    assert why.startswith("at 60 rpm the position sensor's steps cause ")
    results = run_study(coarse)
    verdict = report.verdict(results, "slow")
    assert verdict is not None and verdict.doubts == [f"{SENTENCE}{why}."]
    assert verdict.doubts[0] in verdict.details
    left = [
        run_study(changed(coarse, {"seed": seed}), ["*/harmonic"]).runs[0].metrics["speed_ripple_rad_s"]
        for seed in range(1, 4)
    ]
    assert max(left) > 1.3 * min(left)


def test_a_law_that_is_sure_has_no_doubt(coarse: Study, tmp_path: Path) -> None:
    fine = changed(coarse, {"drive.position_sensor.bits": 20})
    assert doubt(fine, "harmonic", "slow") == "" and doubt(fine, "pi", "slow") == ""
    verdict = report.verdict(run_study(fine), "slow")
    assert verdict is not None and verdict.doubts == []
