"""A carriage on a belt: its resonances by the closed form, its friction, and mistakes as one line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.errors import StudyError
from cogless.run.simulate import simulate
from cogless.run.suspects import suspects
from cogless.study import changed, load
from cogless.study.metric import Metric

RADIUS = 20 * 2e-3 / math.tau  # m, of 20 teeth of 2 mm
BELT = {"pulley_teeth": 20, "mass": "0.5 kg", "resonance": "75 Hz", "damping_ratio": 0.0}
INERTIA = 8.2e-6  # kg m^2, of the rotor
SCENARIO = {
    "duration": "0.4 s",
    "reference": "60 rpm",
    "initial_speed": "60 rpm",
    "events": [{"time": "0.1 s", "load": "10 mN*m"}],
}


def swing(folder: Path, belt: dict[str, Any]) -> tuple[float, float]:
    """Frequency of the belt's torque after a step of the load, Hz, and its mean, N m. No current flows."""
    changes = {
        "motor.cogging": [],
        "mechanics": {"inertia": f"{INERTIA} kg*m^2", "belt": belt},
        "drive.rates.current_loop": "16 kHz",
        "controller.pi": {"law": "pi", "kp": "0 A/rpm", "ki": "0 A/rpm/s"},
        "drive.current_loop": {"kind": "ideal", "current_limit": "3 A"},
        "scenario.low": SCENARIO,
        "trace": {"rate": "16 kHz"},
        "metric": [],
    }
    text = 'title = "A belt"\n' + studies.IDEAL + studies.BASE[studies.BASE.index("[scenario.low]") :]
    trace = simulate(studies.study(folder, changes, text), "low", "pi").trace
    time, torque = trace["time"], trace["tau_shaft"]
    torque = torque[time > 0.1]
    rising = np.flatnonzero((torque[:-1] < torque.mean()) & (torque[1:] >= torque.mean()))
    return 16e3 * (len(rising) - 1) / float(rising[-1] - rising[0]), float(torque.mean())


def test_a_free_rotor_and_its_carriage_swing_against_each_other(tmp_path: Path) -> None:
    """The resonance of the carriage alone, times the root of 1 + m r^2 / J."""
    frequency, _ = swing(tmp_path, BELT)
    assert frequency == pytest.approx(75 * math.sqrt(1 + 0.5 * RADIUS**2 / INERTIA), rel=3e-3)


def test_stiffness_and_resonance_say_the_same(tmp_path: Path) -> None:
    stiffness = 0.5 * (math.tau * 75) ** 2  # N/m
    words = {key: value for key, value in BELT.items() if key != "resonance"}
    path = studies.write(tmp_path)
    sides = [
        load(path, {"mechanics.belt": {**words, **word, "damping_ratio": 0.1}}).mechanics.load_side
        for word in ({"resonance": "75 Hz"}, {"stiffness": f"{stiffness / 1000!r} N/mm"})
    ]
    for side in sides:
        assert side is not None
        assert side.inertia == pytest.approx(0.5 * RADIUS**2)
        assert side.stiffness == pytest.approx(stiffness * RADIUS**2)
        assert side.damping / (2 * math.sqrt(side.stiffness * side.inertia)) == pytest.approx(0.1)


def test_friction_of_the_carriage_is_a_torque_of_the_pulley(tmp_path: Path) -> None:
    side = load(studies.write(tmp_path), {"mechanics.belt": {**BELT, "friction": "3 N"}}).mechanics.load_side
    assert side is not None and side.coulomb_friction == pytest.approx(3 * RADIUS)


RESONANCE = 'expected either resonance, such as "75 Hz", or stiffness, such as "110 N/mm"'


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"resonance": None}, f"resonance: missing: {RESONANCE}"),
        (
            {"stiffness": "110 N/mm"},
            'stiffness: "110 N/mm": expected no such key, since '
            "resonance is given: delete stiffness, or delete resonance",
        ),
        ({"mass": "500 mm"}, 'mass: "500 mm": expected a mass, such as "1 kg"'),
        ({"pitch": "2"}, 'pitch: "2": expected a unit, too, such as "2 mm"'),
        ({"friction": "3 N*m"}, 'friction: "3 N*m": expected a force, such as "1 N"'),
    ],
)
def test_mistakes_are_one_line(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    belt = {key: value for key, value in {**BELT, **change}.items() if value is not None}
    told = studies.refusal(studies.study, tmp_path, {"mechanics.belt": belt})
    assert told == f"study.toml: mechanics.belt.{message}"


def test_a_belt_beside_a_load_side_is_refused(tmp_path: Path) -> None:
    path = studies.write(tmp_path)
    side = {"inertia": "1e-4 kg*m^2", "stiffness": "100 N*m/rad"}
    with pytest.raises(
        StudyError, match=r"mechanics\.belt: .*expected no such key, since load_side is given"
    ):
        load(path, {"mechanics.belt": BELT, "mechanics.load_side": side})


def test_causes_of_a_ripple_are_sought_without_friction_and_detent(tmp_path: Path) -> None:
    """The suspects' changes fit a study with a belt and a datasheet's step motor."""
    motor = {
        "kind": "step",
        "step_angle": "1.8 deg",
        "R_s": "1 ohm",
        "L_0": "1 mH",
        "holding_torque": "0.45 N*m",
        "rated_current": "1.5 A",
        "detent_torque": "12 mN*m",
    }
    study = studies.study(tmp_path, {"motor": motor, "mechanics.belt": {**BELT, "friction": "3 N"}})
    changes: dict[str, Any] = {}
    for suspect in suspects(study, simulate(study, "low", "pi"), study.metric[0]):
        changes |= suspect.without if suspect.name in ("disturbance", "friction") else {}
    without = changed(study, changes)
    assert without.mechanics.load_side is not None
    assert without.mechanics.load_side.coulomb_friction == 0.0 and without.motor.star().cogging == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "carriage-ripple", "signal": "omega_m"}, "expected theta_load or theta_m"),
        ({"kind": "carriage-ripple", "order": [1]}, 'expected no such key, since kind = "carriage-ripple"'),
        ({"kind": "carriage-ripple", "unit": "rpm"}, 'expected a unit of a length, such as "mm"'),
    ],
)
def test_a_ripple_of_a_carriage_is_of_its_way(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Metric.model_validate({"name": "m", **changes})


def test_a_ripple_of_a_carriage_needs_a_belt_whole_turns_and_rows(tmp_path: Path) -> None:
    path, metric = studies.write(tmp_path), {"name": "m", "kind": "carriage-ripple", "scenarios": ["low"]}
    metric["last"] = "0.3 s"
    fast = {"mechanics.belt": BELT, "scenario.low": SCENARIO}
    for changes, message in (
        ({}, 'kind: "carriage-ripple": expected another kind, or the table mechanics.belt'),
        ({**fast, "trace.rate": "50 Hz"}, "expected another kind, or a trace.rate above 64 Hz"),
        ({**fast, "scenario.low.reference": "10 rpm", "scenario.low.initial_speed": "10 rpm"}, "revolutions"),
    ):
        changes = {"scenario.low.duration": "0.4 s", **changes, "metric": [metric]}
        assert message in studies.refusal(load, path, changes)
    study = load(path, {**fast, "metric": [metric]})
    assert study.conditions("low").carriage_radius == pytest.approx(RADIUS)
