"""What a report says where the design is not sure that a run's result comes again."""

from __future__ import annotations

import re
from pathlib import Path

import drafts
import pytest
from commands import cogless

import studies
from cogless import report
from cogless.design.answers import doubt
from cogless.design.auto import load
from cogless.design.warnings import likely_harm
from cogless.run.simulate import run_study
from cogless.study import Study, changed
from studies import IDEAL

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
    again = report.verdict(run_study(changed(coarse, {"seed": 1})), "slow")
    assert again is not None and all("--set seed=0, " in text for text in again.doubts)
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


TWO_SPEEDS = f"""title = "Few counts at one of two speeds"
{IDEAL}
position_sensor = {{ kind = "encoder", lines = 1024 }}
[scenario]
at_60_rpm = {{ duration = "6 s", reference = "60 rpm", initial_speed = "60 rpm" }}
at_10_rpm = {{ duration = "6 s", reference = "10 rpm", initial_speed = "10 rpm" }}
[controller]
pi = {{ law = "pi", kp = "0.05 A*s/rad", ki = "1 A/rad" }}
harmonic = {{ law = "harmonic", base = 24, kp = "0.05 A*s/rad", ki = "1 A/rad" }}
pi-ilc = {{ law = "pi-ilc", tuning = {{ rule = "auto" }} }}
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "2 s"
unit = "rpm"
"""


def test_a_doubt_below_a_scenario_is_of_this_scenario(tmp_path: Path) -> None:
    """4096 counts a turn at 1 kHz: 4.1 counts per sample at 60 rpm, and 0.68 at 10 rpm."""
    study = load(studies.write(tmp_path, TWO_SPEEDS))
    assert doubt(study, "harmonic", "at_60_rpm") == ""
    assert doubt(study, "harmonic", "at_10_rpm").startswith("at 10 rpm the position sensor gives 0.68 counts")
    results = run_study(study)
    for scenario, other in (("at_60_rpm", "10 rpm"), ("at_10_rpm", "60 rpm")):
        verdict = report.verdict(results, scenario)
        assert verdict is not None and not any(other in line for line in verdict.doubts)
        for name in ("harmonic", "pi-ilc"):
            assert other not in (likely_harm(study, name, scenario) or "")
    harm = likely_harm(study, "pi-ilc", "at_10_rpm")
    assert harm is not None and "at 10 rpm the position sensor gives 0.68 counts" in harm


def test_a_warning_below_all_scenarios_names_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = studies.write(tmp_path, TWO_SPEEDS)
    places = ("--no-limits", "--no-traces", "-o", tmp_path / "out")
    _, _, err = cogless(capsys, "run", path, "--set", "drive.position_sensor.lines=16", *places)
    warnings = [line for line in err.splitlines() if "a sensor edge comes every" in line]
    assert warnings
    for line in warnings:
        named = re.search(r"in scenario (at_\d+_rpm): at (\d+) rpm a sensor edge", line)
        assert named is not None and named[1] == f"at_{named[2]}_rpm", line
