"""What the engine and the C code are told of a drive, by hand."""

from math import pi, radians, sqrt, tau
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.c_layout import control_layout
from cogless.run.drive_config import OBSERVER_PEAK, engine_config

# all that a drive may have, and a belief that is neither the motor nor the scenario's motor
RICH: dict[str, Any] = {
    "drive.precision": "double",
    "drive.position_sensor": {"kind": "encoder", "lines": 2500, "speed_method": "MT"},
    "drive.encoder_table": {"orders": [8, 16], "omega_min": "10 rad/s", "time_constant": "0.25 s"},
    "drive.speed_filter": "200 Hz",
    "drive.bus": {"delay_measured": "1 ms", "jitter": "0.1 ms"},
    "drive.inverter.dead_time": "2 us",
    "drive.inverter.device_drop": "0.7 V",
    "drive.dead_time_compensation": {"band": "0.1 A"},
    "drive.belief": {"psi_f": "60 mWb", "L_q": "25 mH"},
    "scenario.low.override": {"motor.psi_f": "50 mWb", "mechanics.inertia": "5e-4 kg*m^2"},
    "scenario.step.load": {"torque": "0.1 N*m"},
}
LAYOUT = control_layout("double")


def drive(folder: Path, changes: dict[str, Any], controller: str = "pi") -> dict[str, Any]:
    """The drive of a run, its structs decoded."""
    found = engine_config(studies.study(folder, {**RICH, **changes}), "low", controller)["drive"]
    return {
        key: LAYOUT.decode(f"cgl_{key.replace('control', 'drive')}_config", value)
        if isinstance(value, bytes)
        else value
        for key, value in found.items()
    }


def test_the_current_loop_is_tuned_for_the_motor_that_is_believed(tmp_path: Path) -> None:
    """A bandwidth of 800 Hz: kp = 2π·800·L, ki = 2π·800·R; scenarios change the motor, not the belief."""
    foc = drive(tmp_path, {})["control"]["foc"]
    assert foc == pytest.approx(
        {
            "kp_d": tau * 800 * 30e-3,
            "kp_q": tau * 800 * 25e-3,
            "ki_d": tau * 800 * 15.42,
            "ki_q": tau * 800 * 15.42,
            "current_limit": 3.0,
            "advance": 1.5,  # periods: one of computing, half of holding
            "decoupling": 1,
            "L_d": 30e-3,
            "L_q": 25e-3,
            "psi_f": 60e-3,
            "phases": 3,
        }
    )


def test_the_monitor_is_told_the_speed_and_the_currents_of_the_belief(tmp_path: Path) -> None:
    monitor = drive(tmp_path, {})["control"]["monitor"]
    assert monitor["omega_max"] == pytest.approx(1.5 * 310 / sqrt(3) / (4 * 60e-3))  # of the no-load speed
    assert (monitor["current_max"], monitor["current_sum"], monitor["phases"]) == (6.0, 1.5, 3)
    assert monitor["speed_window"] == pytest.approx(2e-3 + 10 / (tau * 200))  # ten of the filter's times


ENCODER = {"kind": "encoder", "lines": 2500}
OBSERVER = {**ENCODER, "speed_method": "observer", "observer_bandwidth": "400 Hz"}
COUNT, SECTOR = tau / 10_000, tau / 24  # of the encoder; of Hall sensors with four pole pairs


@pytest.mark.parametrize(
    ("sensor", "step", "window"),
    [
        (ENCODER, COUNT, 2e-3),  # counted in one period of the law, used in the next
        ({**ENCODER, "speed_method": "average", "window": 6}, COUNT, 6 / 15e3),
        (OBSERVER, COUNT, 10 / (tau * 400)),
        ({"kind": "hall"}, 1.5 * SECTOR, 2e-3),  # an edge may be half a sector late
        ({"kind": "ideal"}, 0.0, 0.0),
    ],
)
def test_the_monitor_waits_for_what_the_sensor_needs_to_forget_a_jump(
    tmp_path: Path, sensor: dict[str, Any], step: float, window: float
) -> None:
    changes = {"drive.position_sensor": sensor, "drive.encoder_table": None}
    for more, filtered in ((None, 0.0), ("200 Hz", 10 / (tau * 200))):
        monitor = drive(tmp_path, {**changes, "drive.speed_filter": more})["control"]["monitor"]
        assert (monitor["angle_step"], monitor["stuck_angle"]) == pytest.approx(
            (step, max(0.5 + 2 * step, 4 * step))
        )
        assert monitor["speed_window"] == pytest.approx(window + filtered)


def test_what_two_sensors_of_current_cannot_tell_and_how_far_a_window_of_quality_is(tmp_path: Path) -> None:
    control = drive(tmp_path, {"drive.current_sensors.sensors": 2})["control"]
    assert (control["monitor"]["current_sum"], control["monitor"]["current_max"]) == (0.0, 6.0)
    assert control["quality"]["span"] == pytest.approx(tau)
    given = drive(tmp_path, {"drive.quality.span": "1 rad", "drive.quality.floor": "2 rad/s"})["control"]
    assert (given["quality"]["span"], given["quality"]["floor"]) == (1.0, 2.0)


def test_the_encoder_table_s_observer(tmp_path: Path) -> None:
    """The torque constant believed, over the study's inertia; a quarter of the lowest order's speed."""
    assert drive(tmp_path, {})["encoder_table"] == pytest.approx(
        {
            "orders": 2,
            "order": pytest.approx([8, 16, 0, 0]),
            "gain": 4.0,
            "omega_min": 10.0,
            "bandwidth": 10 * 8 / 4,
            "b": 1.5 * 4 * 60e-3 / 2.5e-4,
            "limit": radians(2),
        }
    )


@pytest.mark.parametrize(
    ("changes", "time", "drop"),
    [
        ({}, 2e-6, 0.7),
        ({"drive.dead_time_compensation": {"band": "0.1 A", "time": "0 s", "drop": "0 V"}}, 0.0, 0.0),
        ({"drive.dead_time_compensation": {"band": "0.1 A", "time": "3 us", "drop": "1 V"}}, 3e-6, 1.0),
        ({"drive.inverter.pwm": "two-updates"}, 1e-6, 0.7),  # an edge of two is in a current-loop period
    ],
)
def test_what_the_dead_time_s_compensation_is_told(
    tmp_path: Path, changes: dict[str, Any], time: float, drop: float
) -> None:
    """The inverter's, unless it is given, be it zero; currents follow their references with 1/(2π·800)."""
    found = drive(tmp_path, changes)["dead_time"]
    lag = 1 / (2 * pi * 800)
    wanted = {"time": time, "drop": drop, "band": 0.1, "lag": lag, "advance": 1.5, "phases": 3}
    assert found == pytest.approx(wanted)


def test_no_compensation_and_no_table_unless_they_are_asked_for(tmp_path: Path) -> None:
    full = set(drive(tmp_path, {}))
    plain = engine_config(studies.study(tmp_path), "low", "pi")["drive"]
    assert full - set(plain) == {"dead_time", "encoder_table", "speed_filter", "bus"}
    ideal = engine_config(studies.load(studies.write(tmp_path, IDEAL)), "low", "pi")["drive"]
    assert "inverter" not in ideal and "dead_time" not in ideal
    foc = control_layout("single").decode("cgl_drive_config", ideal["control"])
    assert foc["foreign"] and foc["foc"]["current_limit"] == 3.0 and foc["monitor"]["phases"] == 0


IDEAL = f"""title = "Ideal"
{studies.IDEAL}
[scenario]
low = {{ duration = "0.4 s", reference = "60 rpm" }}
[controller.pi]
law = "pi"
kp = "0.015 A/rpm"
ki = "0.3 A/rpm/s"
"""


@pytest.mark.parametrize(
    ("guard", "controller", "unguarded"),
    [(True, "pi", True), (True, "afc", False), (False, "afc", True), (False, "pi", True)],
)
def test_only_what_learns_is_guarded(tmp_path: Path, guard: bool, controller: str, unguarded: bool) -> None:
    learns = {
        "law": "pi-afc",
        "kp": "0.015 A/rpm",
        "ki": "0.3 A/rpm/s",
        "orders": [24],
        "gain": "3 A/rad",
        "lead": "0.6 ms",
    }
    changes = {"drive.guard": guard, "controller.afc": learns}
    control = drive(tmp_path, changes, controller)["control"]
    assert (control["unguarded"], control["learn_saturated"]) == (unguarded, False)
    assert (control["pole_pairs"], control["divider"], control["foreign"]) == (4, 15, False)


def test_a_run_has_its_scenario_s_load_and_a_commissioning_has_not(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {**RICH, "scenario.step.initial_angle": "0.5 rad"})
    run = engine_config(study, "step", "pi")
    learn = engine_config(study, "step", "pi", "learn")
    assert (run["load"]["torque"], learn["load"]["torque"]) == (0.1, 0.0)
    assert (run["initial_angle"], learn["initial_angle"]) == (0.5, 0.0)
    assert [event["load"] for event in run["events"]] == [0.2, 0.0] and learn["events"] == []
    assert run["initial_speed"] == run["reference"]["speed"] == pytest.approx(tau)
    assert learn["initial_speed"] == learn["reference"]["speed"] == 0.0
    assert (run["controller"]["calibrate"], learn["controller"]["calibrate"]) == (False, True)
    low = engine_config(study, "low", "pi")
    assert low["motor"]["psi_f"] == pytest.approx(50e-3) and low["mechanics"]["inertia"] == 5e-4


@pytest.mark.parametrize(
    ("sensor", "resolution"),
    [
        ({**ENCODER, "speed_method": "M"}, COUNT * 1e3),  # a count in a period of the law
        ({**ENCODER, "speed_method": "MT"}, 0.0),
        ({**ENCODER, "speed_method": "average", "window": 6}, COUNT * 15e3 / 6),
        (OBSERVER, 0.80 * COUNT * tau * 400),
    ],
)
def test_the_monitor_believes_what_one_step_of_the_sensor_shows(
    tmp_path: Path, sensor: dict[str, Any], resolution: float
) -> None:
    monitor = drive(tmp_path, {"drive.position_sensor": sensor})["control"]["monitor"]
    no_load = 310 / sqrt(3) / (4 * 60e-3)
    assert monitor["omega_max"] == pytest.approx(max(1.5 * no_load, no_load + resolution))


def test_an_observer_shows_no_more_of_a_step_than_is_said() -> None:
    """The observer has three poles at 100 rad/s; its answer to a step of the angle is computed in 10 us."""
    h, w, most = 1e-5, 100.0, 0.0
    theta = omega = alpha = 0.0
    for _ in range(20_000):
        error = 1.0 - theta
        theta, omega, alpha = (
            theta + h * (omega + 3 * w * error),
            omega + h * (alpha + 3 * w**2 * error),
            alpha + h * w**3 * error,
        )
        most = max(most, omega)
    assert most / w == pytest.approx(OBSERVER_PEAK, rel=0.01)


@pytest.mark.parametrize(("kind", "step"), [("hall", 1.5 * SECTOR), ("encoder", COUNT)])
def test_a_heavy_rotor_has_the_time_that_full_current_takes_to_turn_it_by_a_step(
    tmp_path: Path, kind: str, step: float
) -> None:
    """The time is that in which a tenth of the torque at 3 A, by the believed flux, turns it by a step."""
    inertia = 0.1
    sensor = {"kind": "hall"} if kind == "hall" else ENCODER
    changes = {
        "drive.position_sensor": sensor,
        "drive.encoder_table": None,
        "mechanics.inertia": f"{inertia} kg*m^2",
    }
    monitor = drive(tmp_path, changes)["control"]["monitor"]
    acceleration = 0.1 * 1.5 * 4 * 60e-3 * 3.0 / inertia
    assert monitor["stuck_time"] == pytest.approx(max(0.1, sqrt(2 * step / acceleration)))
    assert (monitor["stuck_time"] > 0.5) == (kind == "hall")


def test_a_sensor_on_the_load_steps_by_the_gear_s_ratio_at_the_motor(tmp_path: Path) -> None:
    """The sensor's table works in the sensor's revolutions, where speed and acceleration are lower."""
    side = {"inertia": "1e-3 kg*m^2", "stiffness": "50 N*m/rad", "damping": "0.01 N*m*s/rad", "ratio": 10}
    found = drive(
        tmp_path, {"mechanics.load_side": side, "drive.position_sensor": {**ENCODER, "side": "load"}}
    )
    monitor, table = found["control"]["monitor"], found["encoder_table"]
    assert monitor["angle_step"] == pytest.approx(10 * COUNT)
    assert (table["omega_min"], table["bandwidth"]) == pytest.approx((1.0, 2.0))
    assert table["b"] == pytest.approx(1.5 * 4 * 60e-3 / (2.5e-4 + 1e-3 / 100) / 10)
