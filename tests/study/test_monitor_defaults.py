"""What a drive watches its measurements by: defaults, and that ordinary operation never meets them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from engine import unpacked

from cogless import changed
from cogless.design.auto import load
from cogless.design.trials.from_study import design_study
from cogless.errors import StudyError
from cogless.run.drive_config import engine_config
from cogless.run.own_law import make_law
from cogless.run.run_plan import compiled
from cogless.run.simulate import simulate
from cogless.run.trial_config import engine_config as trial_engine_config
from cogless.study import TrialStudy
from cogless.study.reading import is_arena, read

FILES = (Path(__file__).parents[2] / "studies").glob("*.toml")
STUDIES = sorted(path.stem for path in FILES if not is_arena(read(path)))
# not learning and at its limit are a law's own matter
ALARMS = 2 | 16 | 32 | 64 | 128 | 256 | 512 | 1024
SECONDS = 2.0


def statuses(drive: Any, engine: Any, ticks: int) -> int:
    """All bits of a run's first ticks."""
    state, recorder, met = drive.start(), engine.Recorder(drive, 1), 0
    drive.advance(state, recorder, ticks)
    column = [name for name, _ in drive.signals].index("status")
    for status in set(recorder.take()[:, column].tolist()):
        met |= int(status)
    return met


@pytest.mark.parametrize("name", STUDIES)
def test_no_shipped_study_triggers_anything(name: str) -> None:
    study = load(name)
    runs = [(s, controller) for s in study.scenario for controller in study.controllers_in(s)]
    if study.drive is None:
        return
    engine, rate = compiled(study), study.drive.rates.current_loop
    designs = design_study(study, runs) if isinstance(study, TrialStudy) else {}
    for scenario, controller in runs:
        if isinstance(study, TrialStudy):
            config = trial_engine_config(study, scenario, controller, designs[scenario, controller])
            drive = engine.Drive(config)
        else:
            drive = engine.Drive(engine_config(study, scenario, controller), make_law(study, controller))
        assert statuses(drive, engine, round(SECONDS * rate)) & ALARMS == 0, (scenario, controller)


def watched(name: str, changes: dict[str, Any] | None = None) -> dict[str, float]:
    study = changed(load(name), changes or {})
    scenario = next(iter(study.scenario))
    config = engine_config(study, scenario, study.controllers_in(scenario)[0])
    monitor: dict[str, float] = unpacked(config, study.drive.precision)["drive"]["control"]["monitor"]
    return monitor


def test_defaults_follow_from_the_drive() -> None:
    """uomodri: 24 V, 300 r/min/V peak from line to line, 20,000 counts, speed loop 5 kHz, 4 A."""
    step = 2 * math.pi / 20_000
    assert watched("uomodri") == pytest.approx(
        {
            "omega_max": 1.5 * 24 * 300 * 2 * math.pi / 60,
            "angle_step": step,
            "speed_window": 2 / 5000,
            "stuck_angle": 0.5 + 2 * step,
            "stuck_time": 0.1,
            "current_max": 8.0,
            "current_sum": 2.0,
            "bridge": 5e-3,
            "hold": 1e-2,
            "phases": 3,
        }
    )


def test_two_phases_reach_the_whole_bus_and_an_ideal_current_loop_has_no_bound() -> None:
    step_motor = watched("verrelli2016")
    assert step_motor["omega_max"] == pytest.approx(600)
    assert step_motor["current_sum"] == 0
    assert watched("verrelli2016-speed")["omega_max"] == 0


def test_what_a_study_gives_counts() -> None:
    given = watched("uomodri", {"drive.monitor.omega_max": "60 rpm", "drive.monitor.hold": "1 ms"})
    assert given["omega_max"] == pytest.approx(2 * math.pi)
    assert given["hold"] == pytest.approx(1e-3)
    assert given["current_max"] == 8


@pytest.mark.parametrize(
    "key, value, expected",
    [
        ("monitor.omega_max", "-1 rpm", "expected an angular speed of zero or more"),
        ("monitor.hold", "1 A", "expected"),
        ("monitor.bridge", "1e9 s", "expected 25000 s or less"),
        ("quality.outlier", 0.5, "expected a factor of 1 or more, or 0 to learn from every error"),
        ("quality.longest", "1 us", "expected 0.0002 s to"),
        ("monitor.omega_maks", "1 rpm", 'perhaps "omega_max"'),
    ],
)
def test_a_wrong_value_is_named(key: str, value: Any, expected: str) -> None:
    with pytest.raises(StudyError, match=f"drive.{key}.*{expected}"):
        changed(load("uomodri"), {f"drive.{key}": value})


def test_a_run_tells_how_good_learning_was() -> None:
    study = changed(load("uomodri"), {"scenario.fast.duration": "4 s"})
    learned, fixed = (simulate(study, "fast", name).quality for name in ("pi-ilc", "pi"))
    assert learned["known"]
    assert learned["progress"] > 0.5
    assert learned["residual"] < 0.5 * fixed["residual"]
    assert set(fixed) == {"known", "residual"}


def test_a_bound_in_the_way_is_told_and_stops_the_drive() -> None:
    """A monitor for half the speed of the scenario: no speed is believed, and after 5 ms the drive rests."""
    short = {"scenario.fast.duration": "0.5 s", "metric": []}
    study = changed(load("uomodri"), {**short, "drive.monitor.omega_max": "2 rev/s"})
    trace = simulate(study, "fast", "pi").trace
    status = trace["status"].astype(int)
    safe = (status & 2) > 0  # until the rotor is slow enough to be believed
    first = int(safe.argmax())
    assert trace.time[first] == pytest.approx(5e-3, abs=2e-4)
    assert status[first] & (2 | 16) == 18
    assert safe[(trace.time > 5.2e-3) & (trace.time < 15e-3)].all()
    assert not trace["i_q_ref"][safe].any()
    assert not trace["u_q"][safe].any()
