"""The planned sequence turns the rotor, and its rows show what it is for."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identify.commissioned import METRIC, PI, study_tables

from cogless.errors import StudyError
from cogless.identify import config, plan
from cogless.identify.command import identified
from cogless.identify.findings import usable
from cogless.identify.log import load_logs
from cogless.results.trace import write_netcdf
from cogless.run.simulate import rollout
from cogless.study import load

STEPPER = {
    "title": "stepper",
    "motor": {
        "pole_pairs": 50,
        "R_s": "1.5 ohm",
        "L_d": "3 mH",
        "L_q": "3 mH",
        "K_t": "0.3 N*m/A",
        "cogging": [
            {"order": 200, "torque": "15 mN*m", "phase": "-23 deg"},
            {"order": 100, "torque": "8 mN*m", "phase": "43 deg"},
            {"order": 7, "torque": "3 mN*m", "phase": "-94 deg"},
        ],
    },
    "mechanics": {
        "inertia": "1.2e-5 kg*m^2",
        "coulomb_friction": "10 mN*m",
        "viscous_friction": "2e-4 N*m*s/rad",
    },
    "drive": {
        "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
        "current_loop": {"bandwidth": "500 Hz", "current_limit": "2 A"},
        "inverter": {"bus_voltage": "48 V"},
        "position_sensor": {
            "kind": "encoder",
            "lines": 16384,
            "speed_method": "M",
            "eccentricity": "0.2 deg",
            "eccentricity_phase": "60 deg",
        },
    },
    "scenario": {"one": {"duration": "1 s", "reference": "1 rev/s"}},
    "controller": PI,
    "metric": [METRIC],
}
HILLS = 2 * (15e-3 / 200 + 8e-3 / 100)  # J, of the orders that the law does not hold


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    """A folder with a stepper's plan and its logs."""
    folder = tmp_path_factory.mktemp("stepper")
    (folder / "motor.toml").write_text(plan.to_toml(STEPPER))
    plan.write(load(folder / "motor.toml"), folder)
    (results,) = rollout([load(folder / "study.toml")], jobs=1)
    write_netcdf(folder / "traces.nc", results.runs)
    return folder


def test_a_law_holds_the_cogging_below_its_crossover(logs):
    assert plan.overrun(load(logs / "motor.toml"), "pi") == [(200, 15e-3), (100, 8e-3)]


def test_a_rotor_that_cogging_would_stop_has_twice_the_energy_of_its_hills(logs):
    played, rate = plan.scenarios(load(logs / "motor.toml"), "pi")
    speeds = {name: one["reference"]["profile"][0][1] for name, one in played.items()}
    slow = float(speeds["slow"].split()[0])
    assert 1.2e-5 * slow**2 / 2 == pytest.approx(2 * HILLS, rel=1e-3)
    assert rate > 3 * 300 * float(speeds["fast"].split()[0]) / (2 * math.pi)  # order 6 p is in sight
    assert 10_000 % rate == 0


def test_a_plan_of_a_stepper_by_hand(logs):
    """Half above the speed of twice its hills' energy, and at twice that around, as fast as its hills do."""
    played, rate = plan.scenarios(load(logs / "motor.toml"), "pi")
    least = math.sqrt(2 * 2 * HILLS / 1.2e-5)
    v = 1.5 * least  # which is above the scenario's revolution a second
    found = {
        name: np.array([[float(x.split()[0]) for x in row] for row in each["reference"]["profile"]])
        for name, each in played.items()
    }
    speeds = {name: rows[0, 1] for name, rows in found.items()}
    assert speeds == pytest.approx(
        {"slow": least, "one-speed": v, "fast": 2 * v, "acceleration": 0, "load-forwards": least,
         "load-backwards": least}, rel=1e-5
    )  # fmt: skip
    around = 2 * 2 * v * 1.2e-5 / 23e-3  # s, by the torques of both orders
    turns = [[0.4 * n + late, (-1) ** n * 2 * v] for n in range(16) for late in (around, 0.4)]
    assert found["acceleration"] == pytest.approx(np.array([[0, 0], *turns]), rel=1e-5)
    assert rate == plan._rate(10e3, 300 * 2 * v) > plan.LOG_RATE


def test_no_planned_log_of_a_stepper_sticks(logs):
    known = config.load(logs / "id.toml")
    used, said = usable(known, load_logs([logs / "traces.nc"], known))
    assert len(used) == len(plan.SCENARIO_KINDS) and not said


def test_a_stepper_comes_out_of_its_planned_logs(logs):
    made = identified([logs / "traces.nc"], logs / "id.toml", lambda what, share: None).estimate
    for key, value, share in (("j", 1.2e-5, 0.01), ("c", 10e-3, 0.01), ("b", 2e-4, 0.05)):
        assert made.values[key].value * made.K_t == pytest.approx(value, rel=share), key
    assert made.values["delay"].value == pytest.approx(0, abs=5e-5)
    cogging = {wave.order: wave.size.value * made.K_t for wave in made.cogging}
    for order, torque in ((7, 3e-3), (100, 8e-3), (200, 15e-3)):
        assert cogging[order] == pytest.approx(torque, rel=0.03), order
    (error,) = made.encoder
    assert np.degrees(error.size.value) == pytest.approx(0.2, rel=0.05)


def servo() -> dict[str, Any]:
    """The servo without cogging, so that friction alone takes current, at a speed that it holds at 24 V."""
    tables = study_tables("servo")
    motor = {key: value for key, value in tables["motor"].items() if key != "cogging"}
    return {**tables, "motor": motor, "scenario": {"one": {"duration": "1 s", "reference": "300 rpm"}}}


def planned(folder: Path, tables: dict, volts: float) -> Path:
    """A folder with the plan of a motor at a bus voltage."""
    drive = {**tables["drive"], "inverter": {"bus_voltage": f"{volts} V"}}
    (folder / "motor.toml").write_text(plan.to_toml({**tables, "drive": drive}))
    plan.write(load(folder / "motor.toml"), folder)
    return folder


def tops(folder: Path) -> dict[str, float]:
    """The top speed of each scenario of a plan, rad/s."""
    return {name: one.top_reference for name, one in load(folder / "study.toml").scenario.items()}


@pytest.mark.parametrize(
    ("v", "slow", "loaded", "fast"),
    [
        (6.0, 1.5, 6.0, 36.0),  # a quarter of it, itself, six times it
        (15.0, 0.5 / (24 * 6e-3), 1 / (24 * 6e-3), 0.3 * 1000 * 2 * math.pi / 24),  # as order 24 is seen
        (30.0, 0.5 / (24 * 6e-3), 1 / (24 * 6e-3), 90.0),  # three times it, though that is not seen
    ],
)
def test_a_plan_by_hand(tmp_path, v, slow, loaded, fast):
    """Of a servo with four pole pairs, by the speed of its scenario; its kernel has a width of 6 ms."""
    one = {"duration": "1 s", "reference": f"{v} rad/s"}
    (tmp_path / "motor.toml").write_text(plan.to_toml({**servo(), "scenario": {"one": one}}))
    played, rate = plan.scenarios(load(tmp_path / "motor.toml"), "pi")
    assert rate == 1000
    found = {
        name: np.array([[float(x.split()[0]) for x in row] for row in each["reference"]["profile"]])
        for name, each in played.items()
    }
    for name, speed, turns in (
        ("slow", slow, 2),
        ("one-speed", v, 4),
        ("fast", fast, 12),
        ("load-forwards", loaded, 3),
        ("load-backwards", loaded, 3),
    ):
        time = max(2.0, turns * 2 * math.pi / speed)
        there_and_back = [[0, speed], [time, speed], [time + 0.4, -speed], [2 * time + 0.4, -speed]]
        assert found[name] == pytest.approx(np.array(there_and_back), rel=1e-5), name
        assert played[name]["initial_speed"] == f"{speed:.6g} rad/s"
    turns = [[0.5 + 0.8 * n, (-1) ** n * 5 / 6 * fast] for n in range(9)]
    assert found["acceleration"] == pytest.approx(np.array([[0, 0], *turns]), rel=1e-5)
    assert {name: float(each["duration"].split()[0]) for name, each in played.items()} == {
        name: rows[-1, 0] for name, rows in found.items()
    }
    loads = [played[f"load-{way}"]["load"] for way in ("forwards", "backwards")]
    assert loads == ["0.6 N*m", "-0.6 N*m"]  # a fifth of the largest torque


def test_a_plan_within_the_voltage_is_not_lowered(tmp_path):
    high = tops(planned(tmp_path, servo(), 48))
    assert high["one-speed"] == pytest.approx(300 * math.pi / 30, rel=1e-5)
    assert plan.lowered(load(tmp_path / "motor.toml")) == ""


def test_speeds_of_a_plan_end_where_the_voltage_drives_their_current(tmp_path):
    low = tops(planned(tmp_path, servo(), 15))
    top = max(low.values())
    psi_f = 0.3 / (1.5 * 4)
    i = (30e-3 + 1e-3 * top + 5e-4 * 2 * top / plan.REVERSAL_TIME) / 0.3
    u = math.hypot(0.8 * i + 4 * top * psi_f, 4 * top * 2e-3 * i)
    assert u == pytest.approx(15 / math.sqrt(3), rel=1e-4)
    assert low["fast"] == pytest.approx(3 * low["one-speed"], rel=1e-4)
    assert plan.lowered(load(tmp_path / "motor.toml")) == (
        f"The plan's speeds end at {top * 30 / math.pi:.4g} rpm: above this speed a bus voltage of 15 V is "
        "too low for the current that friction, cogging and reversals need."
    )
    (results,) = rollout([load(tmp_path / "study.toml")], ["fast/*"], jobs=1)
    trace = results.runs[0].trace
    assert np.max(trace["omega_m"]) == pytest.approx(top, rel=0.01)


def test_a_voltage_that_hardly_drives_a_torque_reaches_a_small_speed(tmp_path):
    """0.6 N m beside 0.03 of friction at rest."""
    planned(tmp_path, servo(), 48)
    study = load(tmp_path / "motor.toml", {"drive.inverter.bus_voltage": "2.95 V"})
    speed = plan.reach(study, lambda speed: 0.6)
    i = (0.63 + 1e-3 * speed) / 0.3
    assert 0 < speed < 0.2
    assert math.hypot(0.8 * i + 4 * speed * 0.05, 4 * speed * 2e-3 * i) == pytest.approx(2.95 / math.sqrt(3))


def test_a_plan_for_a_motor_at_rest_has_a_revolution_a_second(tmp_path):
    one = {"duration": "1 s", "reference": "0 rad/s"}
    (tmp_path / "motor.toml").write_text(plan.to_toml({**servo(), "scenario": {"one": one}}))
    played, _ = plan.scenarios(load(tmp_path / "motor.toml"), "pi")
    assert played["one-speed"]["initial_speed"] == "6.28319 rad/s"


def test_a_voltage_that_drives_no_current_is_refused(tmp_path):
    with pytest.raises(StudyError) as error:
        planned(tmp_path, servo(), 2)
    assert str(error.value) == (
        f"{tmp_path}/motor.toml: drive.inverter.bus_voltage: 2 V: expected more: the plan's currents take "
        f"{0.8 * (2 + 0.1) / (2 / math.sqrt(3)):.3g} times this voltage at standstill"
    )

    times = float(re.findall(r"take ([\d.]+) times", str(error.value))[0])
    assert planned(tmp_path, servo(), 2 * times * 1.01)  # as much as is expected, and a little to turn with


def test_a_stepper_whose_voltage_is_too_low_for_its_hills_is_refused(tmp_path):
    with pytest.raises(StudyError) as error:
        planned(tmp_path, STEPPER, 6)
    least = math.sqrt(2 * 2 * HILLS / 1.2e-5) * 30 / math.pi
    most = plan.highest(load(tmp_path / "motor.toml"), "pi") * 30 / math.pi
    assert str(error.value) == (
        f"{tmp_path}/motor.toml: drive.inverter.bus_voltage: 6 V: expected more: cogging stops this rotor "
        f"below {least:.3g} rpm, so the plan needs {3 * least:.3g} rpm, but the voltage reaches only "
        f"{most:.3g} rpm"
    )
    assert planned(tmp_path, STEPPER, 6 * 3 * least / most * 1.3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"drive.position_sensor": {"kind": "hall"}},
            "drive.position_sensor: Hall sensors show six angles of an electrical revolution, too few "
            "for cogging and friction: expected an encoder while the logs are recorded",
        ),
        (
            {"controller": {"ilc": {**PI["pi"], "law": "pi-ilc", "gain": "0.1 A*s/rad"}}},
            'controller: expected one without learning, such as law = "pi"',
        ),
    ],
)
def test_what_no_plan_is_for_is_refused(tmp_path, changes, said):
    (tmp_path / "motor.toml").write_text(plan.to_toml(servo()))
    with pytest.raises(StudyError) as error:
        plan.tables(load(tmp_path / "motor.toml", changes))
    assert str(error.value) == f"{tmp_path}/motor.toml: {said}"


@pytest.mark.parametrize("ideal", [False, True])
def test_the_columns_of_a_plan_are_those_that_its_study_records(tmp_path, ideal):
    """An ideal current loop has neither i_d nor voltages: a log must have each column that is named."""
    tables = study_tables("servo")
    if ideal:
        drive = {key: value for key, value in tables["drive"].items() if key != "inverter"}
        tables["drive"] = {**drive, "current_loop": {"kind": "ideal", "current_limit": "5 A"}}
    (tmp_path / "motor.toml").write_text(plan.to_toml(tables))
    plan.write(load(tmp_path / "motor.toml"), tmp_path)
    (results,) = rollout([load(tmp_path / "study.toml")])
    write_netcdf(tmp_path / "traces.nc", results.runs)
    known = config.load(tmp_path / "id.toml")
    for log in load_logs([tmp_path / "traces.nc"], known):
        assert set(log.signals) == set(known.columns) - {"t"}
        assert {"i_d", "u_q"} <= set(log.signals) or ideal
