"""The study that an estimate becomes: its scenarios are the logs, and ripple is of their steady ends."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identify.commissioned import MOTORS, PI

from cogless.identify import config, plan
from cogless.identify.config import Identification, LogRule
from cogless.identify.described import (
    drive,
    mechanics,
    metrics,
    motor,
    replayable,
    scenario,
    scenario_name,
    sensed,
    steady_for,
    study,
)
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Value, Wave
from cogless.study.drive import Drive
from cogless.study.mechanics import Mechanics
from cogless.study.motor import Motor
from cogless.study.numerics import steps_needed

REVERSED = {
    "profile": [["0 s", "2 rad/s"], ["8 s", "2 rad/s"], ["8.4 s", "-2 rad/s"], ["12.4 s", "-2 rad/s"]]
}
SWEPT = {"profile": [["0 s", "2 rad/s"], ["1 s", "30 rad/s"], ["2 s", "-30 rad/s"]]}


@pytest.mark.parametrize(
    ("reference", "duration", "steady"),
    [
        (REVERSED, "12.4 s", 4.0),
        (REVERSED, "14 s", 5.6),
        (SWEPT, "2 s", 0.0),
        ("3 rad/s", "5 s", 5.0),
        ("0 rad/s", "5 s", 0.0),
        ({"offset": "1 rad/s", "amplitude": "1 rad/s", "frequency": "1 Hz"}, "5 s", 0.0),
    ],
)
def test_a_reference_ends_at_a_steady_speed(reference, duration, steady):
    assert steady_for(reference, duration) == pytest.approx(steady)


def test_ripple_is_of_steady_ends_alone():
    both = {
        "slow": {"reference": REVERSED, "duration": "12.4 s"},
        "swept": {"reference": SWEPT, "duration": "2 s"},
    }
    (ripple,) = metrics(both, [72, 12])  # too slow for a revolution
    assert ripple["scenarios"] == ["slow"] and ripple["last"] == "3 s"
    both["fast"] = {"reference": "9 rad/s", "duration": "12 s"}
    ripple, waves = metrics(both, [72, 12])
    assert ripple["scenarios"] == ["slow", "fast"] and waves["scenarios"] == ["fast"]
    assert waves["order"] == [12, 72]
    assert metrics({"swept": both["swept"]}) == []
    shorter = {"one": {"reference": "9 rad/s", "duration": "1 s"}}
    assert metrics(shorter)[0]["last"] == "0.75 s"  # a second is enough
    assert metrics({"one": {"reference": "9 rad/s", "duration": "0.99 s"}}) == []


@pytest.mark.parametrize(("speed", "turns"), [(9.3, True), (9.1, False), (-9.3, True)])
def test_orders_are_of_ends_that_turn_for_more_than_a_revolution(speed: float, turns: bool) -> None:
    """1.1 of it, 6.91 rad, in the last three quarters of a second."""
    found = metrics({"one": {"reference": f"{speed} rad/s", "duration": "1 s"}}, [24])
    assert [each["name"] for each in found] == ["speed_ripple", "speed_order"][: 1 + turns]


DT = 1e-3


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Identification:
    """A servo and the law and references of its logs."""
    servo, path = MOTORS["servo"], tmp_path_factory.mktemp("known") / "id.toml"
    logs = [
        {"file": "slow*", "reference": "2 rad/s", "controller": "pi"},
        {"file": "fast*", "reference": {"profile": [["0 s", "0 rad/s"], ["2 s", "-700 rad/s"]]}},
        {"file": "table*", "reference": "2 rad/s", "kind": "table-on"},
    ]
    columns = {name: name for name in ("t", "theta", "i_q")}
    tables = {"columns": columns, "motor": servo["motor"], "drive": servo["drive"], "controller": PI}
    path.write_text(plan.to_toml({**tables, "log": logs}))
    return config.load(path)


def turning(name: str, rule: LogRule, speed: float = 2.0, first: int = 0, dt: float = DT) -> Log:
    theta = 7.0 + speed * DT * np.arange(3000)
    return Log(name, rule, dt, {"theta": theta, "i_q": 0 * theta}, (slice(first, 2500), slice(2600, 3000)))


def estimate(known: Identification, *logs: Log, **values: Any) -> Estimate:
    made = Estimate(known, logs, {"j": Value(1e-3, 1e-5)}, (), (), (), {}, (), ())
    return replace(made, **values)


def test_a_scenario_begins_where_its_log_does(known: Identification) -> None:
    """At the angle and the speed of its first stretch, within a revolution, and with its load."""
    slow, fast = known.log[:2]
    log = turning("slow.csv", slow, first=500)
    found = scenario(estimate(known, log), log)
    assert found == {
        "duration": "2 s",
        "reference": "2 rad/s",
        "initial_angle": f"{8.0 - 2 * np.pi:.6g} rad",
        "initial_speed": "2 rad/s",
        "controllers": ["pi"],
    }
    log = turning("fast.csv", fast)
    found = scenario(estimate(known, log, loads={"fast.csv": Value(0.5, 0.1)}), log)
    assert found["load"] == "0.15 N*m" and "controllers" not in found  # K_t is 0.3 N m/A
    assert found["reference"] == {"profile": [["0 s", "0 rad/s"], ["2 s", "-700 rad/s"]]}
    bent = turning("slow.csv", slow)
    bent.signals["theta"][5:] += 0.005  # 5 ms after the first row
    assert scenario(estimate(known, bent), bent)["initial_speed"] == "3 rad/s"
    rare = turning("slow.csv", slow, dt=1.0)  # two rows, where they are rare
    rare.signals["theta"][2:] += 2.0
    assert scenario(estimate(known, rare), rare)["initial_speed"] == "1.002 rad/s"


ONCE, TWICE = (
    Wave(n, Value(math.radians(size), 0.0), Value(math.radians(-30), 0.0)) for n, size in ((1, 0.1), (2, 0.2))
)


def with_sensor(known: Identification, sensor: Any, folder: Path | None = None) -> Identification:
    """The file of columns with another position sensor."""
    table = {**known.tables["drive"], "position_sensor": sensor}
    context = {"folder": folder, "checks": ()} if folder else None
    other = known.model_copy(update={"drive": Drive.model_validate(table, context=context)})
    other._tables = {**known.tables, "drive": table}
    return other


@pytest.mark.parametrize(
    "sensor",
    [
        {"kind": "encoder", "lines": 2500},
        {"kind": "absolute", "bits": 14, "eccentricity": "0.45 deg"},
        {
            "kind": "resolver",
            "error": [{"order": 2, "amplitude": "1 deg"}, {"order": 1, "amplitude": "1 deg"}],
        },
    ],
)
def test_a_sensor_s_error_is_the_drive_s_in_the_place_of_the_one_told(
    known: Identification, sensor: dict[str, Any]
) -> None:
    """Of every sensor with counts; what was told of orders that were not found stays."""
    other = with_sensor(known, sensor)
    made = drive(estimate(other, encoder=(ONCE, TWICE)))
    assert {**made, "position_sensor": 0} == {**known.tables["drive"], "position_sensor": 0}
    assert made["position_sensor"] == {
        **sensor,
        "eccentricity": "0.1 deg",
        "eccentricity_phase": "-30 deg",
        "error": [{"order": 2, "amplitude": "0.2 deg", "phase": "-30 deg"}],
    }
    assert drive(estimate(other)) == other.tables["drive"]
    third = [{"order": 3, "amplitude": "1 deg"}]
    other = with_sensor(known, {**sensor, "error": third})
    assert drive(estimate(other, encoder=(ONCE,)))["position_sensor"]["error"] == third


def test_an_error_table_s_part_of_what_is_found_is_in_it_already(
    known: Identification, tmp_path: Path
) -> None:
    angles = range(0, 360, 5)
    rows = (f"{angle},{0.3 * math.sin(math.radians(2 * angle + 60))}" for angle in angles)
    (tmp_path / "error.csv").write_text("\n".join(["angle_deg,error_deg", *rows]))
    sensor = {"kind": "absolute", "bits": 14, "error_table": "error.csv"}
    other = with_sensor(known, sensor, tmp_path)
    found = drive(estimate(other, encoder=(TWICE,)))["position_sensor"]
    (left,) = found["error"]
    size, phase = (float(left[key].split()[0]) for key in ("amplitude", "phase"))
    kept = 0.3 * np.sinc(2 / 72) ** 2  # of a table that is straight between its points
    expected = 0.2 * np.exp(-1j * np.pi / 6) - kept * np.exp(1j * np.pi / 3)
    assert size * np.exp(1j * np.radians(phase)) == pytest.approx(expected, abs=1e-5)
    assert other.tells_error(1) and other.tells_error(2)


def test_orders_of_a_sensor_s_error_that_the_file_tells(known: Identification) -> None:
    told = {"eccentricity": "0.1 deg", "error": [{"order": 3, "amplitude": "1 deg"}]}
    for sensor in (
        {"kind": "resolver"},
        {"kind": "resolver", **told},
        {"kind": "hall"},
    ):
        tells = [n for n in (1, 2, 3) if with_sensor(known, sensor).tells_error(n)]
        assert tells == ([1, 3] if "error" in sensor else [])


def test_a_sensor_that_can_have_no_error_in_a_study_keeps_its_table(known: Identification) -> None:
    for kind in ({"kind": "hall"}, {"kind": "ideal"}):
        made = estimate(with_sensor(known, kind), encoder=(ONCE,))
        assert drive(made)["position_sensor"] == kind and sensed(made) == ()


def test_logs_of_a_known_law_and_reference_are_replayed(known: Identification) -> None:
    slow, fast, table = known.log
    logs = [turning("slow.csv", slow), turning("fast.csv", fast)]
    held, other = turning("slow2.csv", slow, dt=0.0), turning("x.csv", LogRule(file="*"))
    made = estimate(known, *logs, held, other, turning("table.csv", table))
    assert replayable(made) == logs
    assert list(study(made)["scenario"]) == ["slow", "fast"] and study(made)["controller"] == PI
    nothing = known.model_copy(update={"controller": {}})
    assert replayable(replace(made, identification=nothing)) == []


@pytest.mark.parametrize(
    ("name", "key"),
    [("a b.c.csv", "a-b"), ("traces.nc#1/pi", "traces"), ("-ä1_2-.csv", "1_2"), ("?.csv", "log")],
)
def test_a_log_s_name_becomes_a_key(name: str, key: str) -> None:
    assert scenario_name(turning(name, LogRule(file="*"))) == key


def test_a_study_of_other_logs_turns_at_their_largest_usual_speed(known: Identification) -> None:
    logs = [turning(name, LogRule(file="*"), speed) for name, speed in (("a", -3.0), ("b", 2.0))]
    (steady,) = study(estimate(known, *logs))["scenario"].items()
    at = {"reference": "3 rad/s", "initial_speed": "3 rad/s"}
    assert steady == ("steady", {"duration": "10 s", **at})
    held = study(estimate(known, turning("a", LogRule(file="*"), dt=0.0)))["scenario"]["steady"]
    assert held["reference"] == "6.28 rad/s"  # a revolution a second, where none turned


def test_the_engine_has_steps_for_the_fastest_speed_of_all(known: Identification) -> None:
    """A fifth above what was logged, at a log's start, or in a reference."""
    star, rate = known.motor.star(), known.drive.rates.current_loop
    light = Mechanics.model_validate({"inertia": "3e-4 kg*m^2"})

    def steps(*logs: Log) -> int:
        found: int = study(estimate(known, *logs))["drive"]["rates"]["integration_steps"]
        return found

    def needed(top: float) -> int:
        return max(known.drive.rates.integration_steps, steps_needed(star, light, 1.2 * top, rate))

    assert needed(2.0) < needed(700.0) < needed(5000.0)
    assert steps(turning("a", LogRule(file="*"))) == needed(2.0)
    assert steps(turning("fast.csv", known.log[1])) == needed(700.0)
    assert steps(turning("a", LogRule(file="*"), -5000.0)) == needed(5000.0)
    begins = turning("slow.csv", known.log[0])
    begins.signals["theta"][:10] -= 5000.0 * DT * np.arange(10)
    begins.signals["theta"][10:] -= 5000.0 * DT * 10
    assert steps(begins) == needed(4998.0)


def test_all_that_was_measured_is_in_the_study(known: Identification) -> None:
    """K_t is 0.3 N m/A. A wave of the pole pairs is cogging there, whatever its cause."""
    log = turning("slow.csv", known.log[0])
    values = {key: Value(value, 1e-3) for key, value in {"j": 1e-3, "c": 0.1, "offset": -0.02}.items()}
    falling = {"stribeck": Value(0.05, 0.01), "stribeck_speed": Value(3.0, 0.5)}
    made = estimate(
        known,
        log,
        values=values | falling,
        friction=(Wave(1, Value(0.04, 0.01), Value(0.5, 0.1)),),
        of_unknown_cause=(Wave(4, Value(0.01, 0.001), Value(-1.0, 0.1)),),
        loads={"slow.csv": Value(0.5, 0.1)},
    )
    masses = Mechanics.model_validate(mechanics(made))
    assert masses.coulomb_friction == pytest.approx(0.03) and masses.breakaway == pytest.approx(0.045)
    assert masses.stribeck_speed == pytest.approx(3.0)
    (harmonic,) = masses.friction_harmonics
    assert (harmonic.order, harmonic.torque, harmonic.phase) == (
        1,
        pytest.approx(0.012),
        pytest.approx(0.5, rel=1e-4),
    )
    assert masses.load.torque == pytest.approx(-0.006)
    assert scenario(made, log)["load"] == "0.144 N*m"
    (cogging,) = Motor.model_validate(motor(made)).cogging
    assert (cogging.order, cogging.torque) == (4, pytest.approx(0.003))


def test_what_would_drive_the_rotor_or_is_not_clear_is_not_in_the_study(known: Identification) -> None:
    values = {"j": Value(1e-3, 1e-5), "c": Value(0.1, 0.01), "offset": Value(0.02, 0.03)}
    wave = Wave(1, Value(0.11, 0.01), Value(0.5, 0.1))
    table = mechanics(estimate(known, values=values, friction=(wave,)))
    assert table == {"inertia": "0.0003 kg*m^2", "coulomb_friction": "0.03 N*m"}
    without = {"j": Value(1e-3, 1e-5), "stribeck": Value(0.05, 0.01), "stribeck_speed": Value(3.0, 0.5)}
    assert mechanics(estimate(known, values=without)) == {"inertia": "0.0003 kg*m^2"}
