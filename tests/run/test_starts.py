"""Starts from rest under friction: a healthy drive reaches its speed, and a stuck rotor is detected."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine import unpacked

import studies
from cogless.control_library import Status
from cogless.design.auto import load
from cogless.run.drive_config import engine_config
from cogless.run.simulate import simulate
from cogless.study import Study

# 0.3 N m/A at any number of pole pairs, 1.5 N m at full current; no load at 138 rad/s
STARTS = """
title = "A start"
[motor]
pole_pairs = 1
slots = 12
R_s = "0.5 ohm"
L_d = "1 mH"
L_q = "1 mH"
psi_f = "0.2 Wb"
[mechanics]
inertia = "2e-3 kg*m^2"
coulomb_friction = "0.6 N*m"
breakaway_friction = "0.9 N*m"
[trace]
rate = "1 kHz"
[drive]
rates = { current_loop = "10 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "500 Hz", current_limit = "5 A" }
inverter = { bus_voltage = "48 V" }
[scenario]
start = { duration = "4 s", reference = "50 rad/s" }
[controller.pi]
law = "pi"
kp = "0.05 A*s/rad"
ki = "0.1 A/rad"
"""
OBSERVED = {"speed_method": "observer", "observer_bandwidth": "60 Hz"}
AVERAGED = {"speed_method": "average", "window": 32}
SENSORS: dict[str, dict[str, Any]] = {
    "ideal": {"kind": "ideal"},
    "encoder M": {"kind": "encoder", "lines": 5000, "speed_method": "M"},
    "encoder T": {"kind": "encoder", "lines": 256, "speed_method": "T"},
    "encoder MT": {"kind": "encoder", "lines": 256, "speed_method": "MT"},
    "encoder average": {"kind": "encoder", "lines": 256, **AVERAGED},
    "encoder observer": {"kind": "encoder", "lines": 256, **OBSERVED},
    "absolute M": {"kind": "absolute", "bits": 14, "speed_method": "M"},
    "absolute average": {"kind": "absolute", "bits": 12, **AVERAGED},
    "absolute observer": {"kind": "absolute", "bits": 12, **OBSERVED},
    "resolver average": {"kind": "resolver", "bits": 12, **AVERAGED},
    "resolver observer": {"kind": "resolver", "bits": 12, **OBSERVED},
    "hall": {"kind": "hall"},
    "hall misplaced": {"kind": "hall", "placement": ["9 deg", "-6 deg", "3 deg", "-9 deg", "6 deg", "0 deg"]},
}
AUTO = {"rule": "auto"}
LAWS: dict[str, dict[str, Any]] = {
    law: {"law": law, "tuning": AUTO}
    for law in ("pi", "adrc", "pi-ilc", "pi-afc", "harmonic", "robust-ilc", "space-speed", "space-position")
}
RATES = {"1 kHz": ("10 kHz", "1 kHz"), "30 kHz": ("30 kHz", "30 kHz")}
STOPS = int(Status.FAULT | Status.OFF | Status.ANGLE_STUCK | Status.ANGLE_LOST | Status.ANGLE_SHIFTED)


def start_of(folder: Path, sensor: str, pole_pairs: int, law_rate: str = "1 kHz", **changes: Any) -> Study:
    current, law = RATES[law_rate]
    return load(
        studies.write(folder, STARTS),
        {
            "motor.pole_pairs": pole_pairs,
            "motor.psi_f": f"{0.2 / pole_pairs} Wb",
            "drive.position_sensor": SENSORS[sensor],
            "drive.rates": {"current_loop": current, "speed_loop": law},
            **changes,
        },
    )


def monitor_of(study: Study) -> dict[str, float]:
    """The monitor's bounds as the engine gets them."""
    config = unpacked(engine_config(study, "start", "pi"), study.drive.precision)
    monitor: dict[str, float] = config["drive"]["control"]["monitor"]
    return monitor


@pytest.mark.parametrize("law_rate", RATES)
@pytest.mark.parametrize("pole_pairs", [1, 50])
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("speed", ["50 rad/s", "-20 rad/s"])
def test_a_healthy_drive_starts_against_friction(
    sensor: str, pole_pairs: int, law_rate: str, speed: str, tmp_path: Path
) -> None:
    study = start_of(tmp_path, sensor, pole_pairs, law_rate, **{"scenario.start.reference": speed})
    trace = simulate(study, "start", "pi").trace
    late = trace.time > 3
    asked = float(trace["omega_ref"][-1])
    assert np.mean(trace["omega_m"][late]) == pytest.approx(asked, rel=0.05)
    assert not (trace["status"].astype(int) & STOPS).any()


def test_the_hub_motor_starts_against_a_heavy_load() -> None:
    """The friction is 20 times the usual one, so the integral takes a second to turn the rotor."""
    changes = {
        "scenario.walk.initial_speed": "0 rpm",
        "scenario.walk.duration": "8 s",
        "mechanics.coulomb_friction": "3 N*m",
        "metric": [],
    }
    trace = simulate(load("hub-motor", changes), "walk", "pi").trace
    assert np.mean(trace["omega_m"][trace.time > 6]) == pytest.approx(3 * np.pi, rel=0.02)
    assert not (trace["status"].astype(int) & STOPS).any()


def test_a_speed_in_steps_beyond_every_speed_is_believed(tmp_path: Path) -> None:
    """With 100 counts and 10 kHz, a count in a period shows 628 rad/s: three times the highest speed."""
    study = start_of(
        tmp_path,
        "encoder M",
        1,
        **{
            "drive.position_sensor.lines": 25,
            "drive.rates": {"current_loop": "10 kHz", "speed_loop": "10 kHz"},
            "drive.current_loop.decoupling": False,  # by such a speed it would ask for more than the bus has
            "mechanics.viscous_friction": "0.01 N*m*s/rad",
            "controller.pi.kp": "0.002 A*s/rad",
            "controller.pi.ki": "0.05 A/rad",
        },
    )
    trace = simulate(study, "start", "pi").trace
    assert trace["omega_measured"].max() > 600
    assert np.mean(trace["omega_m"][trace.time > 3]) == pytest.approx(50, rel=0.05)
    assert not (trace["status"].astype(int) & STOPS).any()


@pytest.mark.parametrize("law_rate", RATES)
@pytest.mark.parametrize("pole_pairs", [1, 50])
@pytest.mark.parametrize("sensor", SENSORS)
def test_a_rotor_that_full_current_cannot_turn_is_found_in_the_stated_time(
    sensor: str, pole_pairs: int, law_rate: str, tmp_path: Path
) -> None:
    """The friction exceeds full current. The rotor counts as stuck stuck_time after the limit is reached."""
    blocked = {"mechanics.coulomb_friction": "1.6 N*m", "mechanics.breakaway_friction": "1.6 N*m"}
    study = start_of(tmp_path, sensor, pole_pairs, law_rate, **blocked)
    run = simulate(study, "start", "pi")
    trace = run.trace
    status = trace["status"].astype(int)
    stuck = (status & int(Status.ANGLE_STUCK)) > 0
    full = trace.time[int(np.argmax(trace["i_q_ref"] >= 0.95 * 5.0))]
    found = trace.time[int(np.argmax(stuck))]
    assert stuck.any()
    assert found - full == pytest.approx(monitor_of(study)["stuck_time"], abs=5e-3)
    assert (status[stuck] & int(Status.OFF)).all()
    assert not trace["i_q_ref"][stuck].any()
    attempts = np.flatnonzero(np.diff(stuck.astype(int)))
    if len(attempts) > 2:  # with the whole torque again
        assert trace["i_q_ref"][attempts[1] : attempts[2]].max() == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize("blocked", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_every_law_starts_and_says_that_it_is_at_its_limit(law: str, blocked: bool, tmp_path: Path) -> None:
    changes: dict[str, Any] = {"drive.position_sensor.lines": 5000, "controller.of": LAWS[law]}
    if blocked:
        changes |= {"mechanics.coulomb_friction": "1.6 N*m", "mechanics.breakaway_friction": "1.6 N*m"}
    trace = simulate(start_of(tmp_path, "encoder MT", 4, **changes), "start", "of").trace
    stops = (trace["status"].astype(int) & STOPS) > 0
    if blocked:
        assert stops.any()
        assert not trace["omega_m"].any()
    else:
        assert not stops.any()
        assert np.mean(trace["omega_m"][trace.time > 3]) == pytest.approx(50, rel=0.05)
