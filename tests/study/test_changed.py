"""A changed study is what it would be if it were read so, with the same mistakes told."""

import random
from pathlib import Path
from typing import Any

import pytest

import cogless
import studies
from cogless.errors import StudyError
from cogless.study import Study, changed, load
from cogless.study.messages import look_up
from cogless.study.reading import checked, is_arena, read, shipped, split

FILES = {name: path for name, path in shipped("studies").items() if not is_arena(read(path))}
SPEED = [name for name in FILES if isinstance(load(name), Study)]
# Values that are right, wrong by themselves, or wrong beside others; a key may not have them at all.
VALUES = [
    0, 1, 3, 0.5, -1, True, 1e9, "1 s", "0.1 s", "20 ms", "1 kHz", "7 kHz", "1e-9 kg*m^2", "2e-4 kg*m^2",
]  # fmt: skip
VALUES += ["3 A", "1 uH", "60 rpm", "5000 rpm", "ideal", "pi", "1 N*m", "0.02 N*m/A", "10 ms", "us", [], {}]
# Changes that only a check of several tables refuses, and such as touch the tables of one scenario.
TOGETHER: list[dict[str, Any]] = [
    {"drive.rates.current_loop": "10 kHz"},
    {"drive.current_loop": {"kind": "ideal", "current_limit": "1 A"}},
    {"drive.current_loop.kind": "ideal"},
    {"mechanics.inertia": "1e-12 kg*m^2"},
    {"motor.kind": "step"},
    {"motor.pole_pairs": 9},
    {"motor.K_t": "0.1 N*m/A", "seed": 7},
    {"trace.rate": "100 Hz"},
    {"trace.energy": True},
    {"metric.0.signal": "nothing"},
    {"metric.0.scenarios": ["nowhere"]},
    {"controller.new.law": "pi"},
    {"controller.new": {"law": "pi", "kp": 0.1, "ki": 1.0}},
    {"tables": 1},
]


def keys(tables: Any, path: str = "") -> list[str]:
    """Every dotted key of these tables."""
    items = (
        tables.items() if isinstance(tables, dict) else enumerate(tables) if isinstance(tables, list) else ()
    )
    found = []
    for key, value in items:
        part = f'"{key}"' if "." in str(key) else str(key)
        found += [f"{path}{part}", *keys(value, f"{path}{part}.")]
    return found


def told(make: Any) -> Any:
    """What a study is, in each of its scenarios, or what is wrong with it."""
    try:
        study = make()
    except StudyError as error:
        return str(error)
    each = {name: one.model_dump() for name, one in study._scenarios.items()}
    return study.model_dump(), each, study.source.tables, study.motor.star()


def as_read(study: Study, changes: dict[str, Any]) -> Any:
    """The changed study, validated as a whole."""
    from cogless.study.reading import _replaced

    return checked(_replaced(study.source, changed_tables(study, changes), changes))


def changed_tables(study: Study, changes: dict[str, Any]) -> dict[str, Any]:
    from cogless.study.reading import _overridden

    return _overridden(study.source, changes)


@pytest.mark.parametrize("name", SPEED)
def test_a_changed_study_is_as_if_it_were_read_so(name: str) -> None:
    study, draw = load(name), random.Random(name)
    known = [key for key in keys(study.source.tables) if not key.startswith(("assumption", "calibration"))]
    drawn = [
        {key: draw.choice(VALUES) for key in draw.sample(known, draw.choice((1, 1, 2)))} for _ in range(20)
    ]
    right = [{key: look_up(study.source.tables, split(key))} for key in draw.sample(known, 10)]
    wrong = 0
    for changes in (*TOGETHER, *drawn, *right):
        found = told(lambda changes=changes: changed(study, changes))
        assert found == told(lambda changes=changes: as_read(study, changes)), changes
        wrong += isinstance(found, str)
    assert 10 < wrong < len(drawn) + len(TOGETHER)  # so that both are seen


def test_a_variant_of_a_variant_is_as_if_it_were_read_so(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    first = changed(
        study, {"trace.rate": "50 Hz", "metric": []}
    )  # too slow for metrics, of which there are none
    for changes in ({"metric": study.source.tables["metric"]}, {"trace.rate": "1 kHz"}):
        found = told(lambda changes=changes: changed(first, changes))
        assert found == told(lambda changes=changes: as_read(first, changes))


def test_a_change_leaves_the_study_as_it_was(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    before = told(lambda: study)
    variant = changed(study, {"motor.cogging.0.torque": "9 mN*m", "controller.pi.kp": 0.2})
    assert told(lambda: study) == before
    assert variant.motor.star().cogging[0].torque == pytest.approx(9e-3)
    assert cogless.for_scenario(variant, "step").motor.cogging[0].torque == pytest.approx(9e-3)
    assert cogless.for_scenario(study, "step").motor.cogging[0].torque == pytest.approx(4e-3)


PI = {"law": "pi", "kp": 0.1, "ki": 1.0}
SHORT = {"duration": "0.3 s", "reference": "60 rpm"}


@pytest.mark.parametrize(
    ("before", "changes", "wrong"),
    [
        # names of controllers and scenarios
        ({"controller.pi.baseline": True}, {"controller.new": {**PI, "baseline": True}}, "controller.new"),
        ({"controller.pi.baseline": True}, {"controller.new": PI}, ""),
        ({}, {"scenario.new": {**SHORT, "duration": "1e9 s"}}, "scenario.new.duration"),
        ({}, {"scenario.new": {**SHORT, "controllers": ["x"]}}, "scenario.new.controllers.0"),
        ({}, {"scenario.new": SHORT}, ""),
        ({}, {"scenario.step.controllers": ["x"]}, "scenario.step.controllers.0"),
        # a table that is new
        ({"metric": []}, {"mechanics.load_side": {"inertia": "1e-4 kg*m^2", "stiffness": "1e9 N*m/rad"}},
            "drive.rates.integration_steps"),
        ({}, {"drive.dead_time_compensation": {"band": "0.1 A", "time": "1 s"}},
            "drive.dead_time_compensation.time"),
        ({}, {"motor.temperature": {"winding": "90 degC"}}, ""),
        # a table of another kind
        ({}, {"controller.pi": {"law": "adrc", "b": 1e3, "omega_c": 100.0, "omega_o": 1e6}}, "controller.pi"),
        ({}, {"controller.pi": {**PI, "law": "pi-ilc", "gain": 0.01, "lead": "1 s"}}, "controller.pi.lead"),
        ({}, {"drive.position_sensor": {"kind": "ideal", "side": "load"}}, "drive.position_sensor.side"),
        # a value that checks of other tables read
        ({"drive.current_sensors.bits": 12}, {"drive.current_loop.current_limit": "12 A"},
            "drive.current_sensors.range"),
        ({"drive.current_sensors.bits": 12}, {"drive.current_loop.current_limit": "10 A"}, ""),
        ({}, {"scenario.step.events.0.time": "0.11 s"}, "metric.2.event"),
        ({}, {"metric.0.window": ["0.1 s", "0.35 s"]}, "metric.0.window"),
        ({}, {"motor.cogging.0.order": 2000}, "drive.rates.integration_steps"),
    ],
)  # fmt: skip
def test_a_change_is_checked_by_all_that_read_it(
    tmp_path: Path, before: dict[str, Any], changes: dict[str, Any], wrong: str
) -> None:
    study = studies.study(tmp_path, before)
    found = told(lambda: changed(study, changes))
    assert found == told(lambda: as_read(study, changes))
    assert f"study.toml: {wrong}" in found if wrong else not isinstance(found, str)


def test_what_did_not_change_is_taken_over(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    variant = changed(study, {"controller.pi.kp": 0.2})
    assert variant.motor is study.motor and variant.controller["fair"] is study.controller["fair"]
    assert variant.controller["pi"] is not study.controller["pi"]
    assert list(variant.controller) == list(study.controller)
