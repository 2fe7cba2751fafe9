"""The time in which learning settles, beside runs: nine tenths of the ripple that it takes away are gone."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import drafts
import numpy as np
import pytest

import studies
from cogless import load, run_study
from cogless.design.settling import left_out, settling
from cogless.design.speed_blocks import speed_blocks
from cogless.design.summary import design
from cogless.results import Run
from cogless.study import Study, changed

LOSSLESS = {"drive.inverter.dead_time": "0 s", "drive.inverter.device_drop": "0 V"}


def held(speed: float, duration: float, changes: dict[str, Any]) -> Study:
    """The motor `uomodri` at one speed, r/min, which it has from the first sample on."""
    scenario = {"duration": f"{duration} s", "reference": f"{speed} rpm", "initial_speed": f"{speed} rpm"}
    laws = {**studies.HARMONIC, **studies.AFC}
    study = load("uomodri", {**laws, "scenario": {"held": scenario}, "trace.rate": "5 kHz", **changes})
    assert isinstance(study, Study)
    return study


def turns(run: Run, speed: float, rate: float = 5000.0) -> Any:
    """The spread of the speed in each revolution; `rate`: of the trace, Hz."""
    samples = round(rate * 60 / speed)
    omega = run.trace["omega_m"]
    return omega[: len(omega) // samples * samples].reshape(-1, samples).std(axis=1)


@pytest.mark.parametrize(
    ("speed", "duration", "changes", "slower"),
    [
        (60.0, 16.0, LOSSLESS, (1 / 1.5, 1.5)),
        (240.0, 6.0, LOSSLESS, (1 / 1.5, 1.5)),
        (240.0, 8.0, {}, (1.5, 2.6)),
    ],
)
def test_learning_settles_in_the_time_that_the_design_says(
    speed: float, duration: float, changes: dict[str, Any], slower: tuple[float, float]
) -> None:
    """Within a turn and a factor of 1.5; with dead time, which the model doesn't have, it takes longer."""
    study, (least, most) = held(speed, duration, changes), slower
    laws = ("pi-ilc", "pi-afc", "harmonic")
    pi, *runs = run_study(study, ["held/pi", *(f"held/{name}" for name in laws)], jobs=2).runs
    alone = turns(pi, speed)[-1]
    for run in runs:
        each, turn = turns(run, speed), 60 / speed
        goal = each[-1] + 0.1 * (alone - each[-1])
        settled = turn * int(np.argmax(each <= goal))  # the turn before it ended above
        (predicted,) = settling(study, run.controller, design(study, run.controller).certificate)
        assert predicted.omega_m == pytest.approx(speed * math.pi / 30)
        assert least * predicted.time - turn <= settled <= most * predicted.time + turn, run.controller


def test_what_isnt_known_isnt_said() -> None:
    """Robust ILC learns faster by its switching term; with a speed that varies, no time is one of a speed."""
    steady = held(60.0, 4.0, {})
    assert settling(steady, "robust-ilc") == []
    answers = {block.heading: dict(block.rows).get("settles", "") for block in speed_blocks(steady).blocks}
    ilc = "PI-ILC (pi-ilc, phase-margin)"
    assert answers["Robust ILC (robust-ilc)"] == "yes"
    assert (
        "s at 60 rpm; it may take longer (the estimate leaves out dead time, current noise)" in answers[ilc]
    )
    lossless = {block.heading: dict(block.rows) for block in speed_blocks(held(60.0, 4.0, LOSSLESS)).blocks}
    assert "dead time" not in lossless[ilc]["settles"]
    assert settling(load("verrelli2016"), "filtered") == []


def test_the_longest_scenario_at_a_speed_says_whether_learning_is_in_time() -> None:
    long = {"duration": "300 s", "reference": "15 rpm"}
    for extra, scenario, duration in (({}, "held", 1.0), ({"scenario.long": long}, "long", 300.0)):
        study = held(15.0, 1.0, {"metric": [], **extra})
        (predicted,) = settling(study, "harmonic", design(study, "harmonic").certificate)
        assert (predicted.scenario, predicted.duration) == (scenario, duration)
        assert 1 < predicted.time < 300
        assert predicted.in_time is (scenario == "long")


QUIET = {
    **LOSSLESS,
    "drive.current_sensors.noise": "0 A",
    "drive.current_sensors.bits": 0,
    "drive.position_sensor.error": [],
}
FINE = {"absolute": {"drive.position_sensor.bits": 22}, "encoder": {"drive.position_sensor.lines": 1 << 18}}
OF_SENSORS = ["dead time", "current noise", "the position sensor's steps and error"]


@pytest.mark.parametrize(
    ("motor", "drive", "encoder", "slower_most"),
    [
        ("gimbal", "moteus", "as5047", 30.0),
        ("nema23", "generic", "incremental", 2.0),
        ("spindle", "vesc", "as5047", 4.0),
        ("drone", "moteus", "ma732", 4.0),
    ],
)
def test_a_draft_settles_in_that_time_or_later_by_what_the_model_lacks(
    motor: str, drive: str, encoder: str, slower_most: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without that, within a turn and twice the time; with it, up to `slower_most` times and three turns.

    The drafts are those of the rules, which leave the dead time to the drive.
    """
    drafts.drafted_by_rules(monkeypatch)
    _, draft = drafts.written(tmp_path, drafts.request(motor, drive, encoder))
    (scenario,) = draft.scenario
    speed = draft.scenario[scenario].slowest * 30 / math.pi
    (predicted,) = settling(draft, "harmonic", design(draft, "harmonic").certificate)
    duration = max(8 * predicted.time, 12 * 60 / speed)
    held = {f"scenario.{scenario}.duration": f"{duration:.3g} s", "trace.rate": "1 kHz", "drive.guard": False}
    assert left_out(draft, "harmonic") == OF_SENSORS
    quiet = changed(draft, {**held, **QUIET, **FINE[draft.drive.position_sensor.kind]})
    # a sensor without steps is another one; the finest of these has hardly any
    assert left_out(quiet, "harmonic") == ["the position sensor's steps"]

    def settled(study: Study) -> float:
        pi, learned = (
            turns(run, speed, 1000.0)
            for run in run_study(study, [f"{scenario}/pi", f"{scenario}/harmonic"], jobs=2).runs
        )
        last = len(learned) // 4
        alone, goal = (float(np.median(one[-last:])) for one in (pi, learned))
        return 60 / speed * int(np.argmax(learned <= goal + 0.1 * (alone - goal)))

    assert predicted.time / 2 - 60 / speed <= settled(quiet) <= 2 * predicted.time + 60 / speed
    assert settled(changed(draft, held)) <= slower_most * predicted.time + 3 * 60 / speed
