"""Drives that go on together, each in a lane: the bits of each alone, whatever happens in one of them."""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from engine import PI_ILC, RIPPLE, config, drive_of
from hypothesis import given, settings
from hypothesis import strategies as st

from cogless import _simulator_f32
from cogless import _simulator_f64 as engine

KERNELS = range(len(engine.lane_kernels()))
STOPS = {"mechanics": {"coulomb_friction": 0.02, "breakaway_friction": 0.05}, "initial_speed": 0.0}
ENCODER = {"kind": "encoder", "counts": 2000.0, "speed_method": "MT", "timer": 1e6}
ECCENTRIC = {**ENCODER, "error": [{"order": 1, "amplitude": 0.01, "phase": 0.3}]}
WORD = {"kind": "absolute", "counts": 2.0**14, "speed_method": "average", "window": 10}
HALL = {"kind": "hall", "counts": 24.0, "window": 6, "timer": 1e6, "placement": [0.01] + 5 * [0.0]}
SENSORS = {"noise": 0.05, "bits": 12, "range": 25.0, "offset": [0.05, -0.03, 0.0]}
REVERSING = {"kind": "sine", "offset": 0.0, "amplitude": 2.0, "frequency": 20.0}
THIRD = {"harmonics": [{"order": 3, "torque": 0.05, "phase": 0.1}]}


def made(change: dict[str, Any]) -> Any:
    return drive_of(engine, config(change))


def alone(drives: Sequence[Any], ticks: int, decimation: int = 1) -> list[Any]:
    rows = []
    for drive in drives:
        state, recorder = drive.start(), engine.Recorder(drive, decimation)
        drive.advance(state, recorder, ticks)
        rows.append(recorder.take())
    return rows


def together(drives: Sequence[Any], pieces: Sequence[int], kernel: int) -> list[Any]:
    states, recorders = [drive.start() for drive in drives], [engine.Recorder(drive, 1) for drive in drives]
    for ticks in pieces:
        assert not any(engine.advance_lanes(list(drives), states, recorders, ticks, kernel))
    return [recorder.take() for recorder in recorders]


def variants(count: int, seed: int, **change: Any) -> list[Any]:
    random = np.random.default_rng(seed)
    drives = []
    for n in range(count):
        each = copy.deepcopy(change)
        each.setdefault("mechanics", {})["inertia"] = 5e-4 * random.uniform(0.5, 2.0)
        each["seed"] = n
        each["controller"] = {**PI_ILC, "config": {**PI_ILC["config"], "gain": 0.05 * random.uniform()}}
        drives.append(made(each))
    return drives


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize(
    "change",
    [
        {"motor": RIPPLE, "drive": {"position_sensor": ECCENTRIC, "current_sensors": SENSORS}},
        {
            "motor": RIPPLE,
            "drive": {
                "position_sensor": {**WORD, "latency": 2.5e-4},
                "speed_filter": 900.0,
                "bus": {"delay_measured": 1e-3, "delay_command": 5e-4, "jitter": 1e-3, "quantum": 0.01},
            },
        },
        {"motor": RIPPLE, "drive": {"position_sensor": HALL}},
        {"motor": RIPPLE, "energy": True, "drive": {"integration_steps": 3}},
        {
            "motor": RIPPLE,
            **STOPS,
            "reference": REVERSING,
        },
        {"motor": RIPPLE, "load": {"torque": 0.1, "lag": 0.002}, "events": [{"time": 0.01, "load": 0.4}]},
        {"motor": RIPPLE, "faults": [{"kind": "angle-missing", "time": 0.01, "duration": 0.02}]},
        {
            "motor": {**RIPPLE, "phases": 2},
            "load": THIRD,
        },
        {"motor": RIPPLE, "drive": {"inverter": {"pwm": "two-updates", "dead_time": 2e-6}}},
        {"motor": RIPPLE, "drive": {"inverter": {"dead_time": 2e-6, "device_drop": 0.7}}},
        {
            "motor": RIPPLE,
            "reference": REVERSING,
            "drive": {
                "inverter": {"pwm": "edge", "dead_time": 2e-6, "minimum_pulse": 2e-6, "bus_voltage": 6.0}
            },
        },
    ],
    ids=[
        "sensors",
        "bus",
        "hall",
        "energy",
        "stick-slip",
        "load",
        "open bridge",
        "two phases",
        "two updates",
        "dead time and drop",
        "short pulses",
    ],
)
def test_a_lane_has_the_bits_of_its_drive_alone(change: dict[str, Any], kernel: int) -> None:
    count = engine.lane_kernels()[kernel][1]
    drives = variants(count, 1, **change)
    expected = alone(drives, 500)
    assert len({rows.tobytes() for rows in expected}) == count
    for rows, lane in zip(expected, together(drives, [1, 299, 200], kernel), strict=True):
        assert rows.tobytes() == lane.tobytes()


QUIET = {"motor": RIPPLE, "drive": {"position_sensor": ENCODER, "current_sensors": SENSORS}}


def quiet(**change: Any) -> dict[str, Any]:
    """Drives whose sensor shows the same angle for many periods, and with `change` in their drive."""
    return {**QUIET, "drive": {**QUIET["drive"], **change}}


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize(
    "change",
    [
        quiet(),
        quiet(current_sensors={**SENSORS, "sensors": 2, "gain_error": [0.01, -0.02, 0.0]}),
        quiet(integration_steps=3, decoupling=False),
        quiet(inverter={"pwm": "two-updates", "dead_time": 2e-6, "minimum_pulse": 2e-6}),
        quiet(inverter={"computation_delay": 0, "device_drop": 0.7, "minimum_pulse": 2e-6}),
        quiet(inverter={"bus_voltage": 3.0}),
        {**quiet(current_limit=5.0, current_sensors={"noise": 0.2}), "load": {"torque": 1.45}},
        quiet(monitor={"omega_max": 11.0, "bridge": 0.005, "speed_window": 0.002}),
        quiet(monitor={"current_max": 0.3, "current_sum": 0.1, "hold": 0.003}),
        {**QUIET, **STOPS, "reference": REVERSING},
        {
            **quiet(monitor={"stuck_angle": 0.2, "stuck_time": 0.004}, current_limit=5.0),
            "mechanics": {"coulomb_friction": 4.0, "breakaway_friction": 4.0},
            "reference": {"kind": "constant", "speed": 60.0},
            "initial_speed": 0.0,
        },
        {**QUIET, "load": {"torque": 0.1, "lag": 0.002}, "events": [{"time": 0.0104, "load": 0.4}]},
        {**QUIET, "faults": [{"kind": "current-zero", "time": 0.0103, "duration": 0.02, "phase": "a"}]},
        {**quiet(current_sensors={}), "motor": {**RIPPLE, "phases": 2}, "energy": True},
    ],
    ids=[
        "noise",
        "two sensors",
        "steps",
        "two updates",
        "no delay",
        "low voltage",
        "low current",
        "speed bound",
        "current bound",
        "stick-slip",
        "stuck",
        "load step",
        "fault",
        "two phases",
    ],
)
def test_a_lane_rests_between_rows_with_the_bits_of_its_drive_alone(
    change: dict[str, Any], kernel: int
) -> None:
    count = engine.lane_kernels()[kernel][1]
    drives = variants(count, 3, **change)
    expected = alone(drives, 800, 7)
    states, recorders = [each.start() for each in drives], [engine.Recorder(each, 7) for each in drives]
    for ticks in (1, 298, 201):
        assert not any(engine.advance_lanes(list(drives), states, recorders, ticks, kernel))
    for drive, state, recorder, rows in zip(drives, states, recorders, expected, strict=True):
        drive.advance(state, recorder, 300)  # what the lanes leave, a drive takes over
        assert recorder.take().tobytes() == rows.tobytes()


def test_lanes_with_different_sensors_and_settings_go_together() -> None:
    dead_time = {"inverter": {"dead_time": 2e-6}}
    drives = [
        made(each)
        for each in (
            quiet(),
            quiet(position_sensor={**ENCODER, "speed_method": "T"}, current_sensors={}),
            quiet(position_sensor={**ENCODER, "speed_method": "M"}),
            quiet(position_sensor=ECCENTRIC, **dead_time),
            quiet(position_sensor=HALL, decoupling=False),
            quiet(position_sensor={"kind": "ideal"}, inverter={"computation_delay": 0}),
            quiet(speed_filter=900.0, current_sensors={**SENSORS, "sensors": 2}),
            {**QUIET, "faults": [{"kind": "angle-stuck", "time": 0.01, "duration": 0.005}]},
        )
    ]
    for kernel in KERNELS:
        lanes = engine.lane_kernels()[kernel][1]
        for some in (drives[:lanes], drives[-lanes:]):
            states, recorders = [each.start() for each in some], [engine.Recorder(each, 7) for each in some]
            assert not any(engine.advance_lanes(some, states, recorders, 500, kernel))
            for rows, recorder in zip(alone(some, 500, 7), recorders, strict=True):
                assert recorder.take().tobytes() == rows.tobytes()


def test_a_lane_that_fails_while_it_rests_says_why_and_the_others_rest_on() -> None:
    good, bad = made(QUIET), made({**QUIET, "events": [{"time": 0.0104, "load": 1e307}]})
    states, recorders = [good.start(), bad.start()], [engine.Recorder(each, 1000) for each in (good, bad)]
    errors = engine.advance_lanes([good, bad], states, recorders, 3001)
    with pytest.raises(RuntimeError) as failure:
        state = bad.start()
        bad.advance(state, engine.Recorder(bad, 1000), 3001)
    assert errors == ["", str(failure.value)] and states[1].tick == state.tick
    assert np.array_equal(recorders[0].take(), alone([good], 3001, 1000)[0])


@settings(max_examples=20, deadline=None)
@given(
    count=st.integers(1, 4),
    speed=st.floats(-300.0, 300.0),
    friction=st.floats(0.0, 0.2),
    torque=st.floats(-0.3, 0.3),
)
def test_any_drive_is_the_same_in_a_lane(count: int, speed: float, friction: float, torque: float) -> None:
    drives = variants(
        count,
        2,
        motor=RIPPLE,
        initial_speed=speed,
        mechanics={"coulomb_friction": friction, "breakaway_friction": 1.5 * friction},
        load={"torque": torque},
    )
    for rows, lane in zip(alone(drives, 300), together(drives, [300], 0), strict=True):
        assert rows.tobytes() == lane.tobytes()


HARMONIC = {"law": "harmonic", "config": {"pi": {"kp": 0.1, "ki": 1.0}, "b": 100.0, "base": 3, "rate": 20.0}}
MISSING = {"faults": [{"kind": "angle-missing", "time": 0.15, "duration": 0.01}]}


@pytest.mark.parametrize("module", [_simulator_f32, engine], ids=["single", "double"])
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize(
    ("orders", "speeds", "of_one"),
    [
        (1, [10.0], {}),
        (7, [10.0, -10.0], {}),
        (24, [1.0], {}),
        (24, [10.0, 10.0, 10.0, 30.0], {}),
        (24, [100.0, 200.0], {}),
        (128, [0.5, 0.6, 20.0], {}),
        (24, [10.0], MISSING),
        (24, [10.0], {"controller": PI_ILC}),
    ],
    ids=[
        "one",
        "both ways",
        "slow",
        "most together",
        "fast and slow",
        "many",
        "without an angle",
        "another law",
    ],
)
def test_sums_of_orders_taken_together_have_the_bits_of_each_alone(
    module: Any, kernel: int, orders: int, speeds: list[float], of_one: dict[str, Any]
) -> None:
    """Lanes of other speeds have other slow and fast orders; `of_one` changes one lane."""
    drives = []
    for n in range(module.lane_kernels()[kernel][1]):
        speed = speeds[n % len(speeds)]
        law = {**HARMONIC["config"], "orders": orders, "fast": orders // 2, "rate": 20.0 + n, "bends": n % 2}
        law["limit"] = 0.01 if n % 3 == 2 else 0.0  # 0: the current limit
        settings = {
            "motor": RIPPLE,
            "seed": n,
            "drive": {"position_sensor": ENCODER, "current_sensors": SENSORS},
            "reference": {"kind": "constant", "speed": speed},
            "initial_speed": speed,
            "controller": {**HARMONIC, "config": law},
        }
        drives.append(drive_of(module, config({**settings, **(of_one if n == 1 else {})})))
    states = [drive.start() for drive in drives]
    recorders = [module.Recorder(drive, 10) for drive in drives]
    for ticks in (1499, 1001):
        assert not any(module.advance_lanes(drives, states, recorders, ticks, kernel))
    learned = []
    for drive, state, recorder in zip(drives, states, recorders, strict=True):
        alone, rows = drive.start(), module.Recorder(drive, 10)
        drive.advance(alone, rows, 2500)
        assert recorder.take().tobytes() == rows.take().tobytes()
        assert drive.law_memory(state).tobytes() == drive.law_memory(alone).tobytes()
        learned.append(np.abs(drive.law_memory(alone)[: 2 * orders]).max())
    assert min(learned) > 1e-4


def test_a_lane_that_fails_says_why_and_the_others_go_on() -> None:
    good = made({"motor": RIPPLE})
    bad = made({"motor": RIPPLE, "load": {"torque": 1e307}})
    drives = [good, bad]
    states, recorders = [drive.start() for drive in drives], [engine.Recorder(drive, 1) for drive in drives]
    errors = engine.advance_lanes(drives, states, recorders, 3000)
    assert errors[0] == ""
    with pytest.raises(RuntimeError) as failure:
        bad.advance(bad.start(), engine.Recorder(bad, 1), 3000)
    assert errors[1] == str(failure.value)
    assert np.array_equal(recorders[0].take(), alone([good], 3000)[0])
    assert states[1].tick < 3000 == states[0].tick


def test_a_lane_that_fails_leaves_the_others_in_their_half_of_the_pwm_period() -> None:
    pwm = {"drive": {"inverter": {"pwm": "two-updates", "dead_time": 2e-6}}}
    bad, good = made({"motor": RIPPLE, "load": {"torque": 1e307}, **pwm}), made({"motor": RIPPLE, **pwm})
    states, recorders = (
        [each.start() for each in (bad, good)],
        [engine.Recorder(each, 1) for each in (bad, good)],
    )
    errors = engine.advance_lanes([bad, good], states, recorders, 3000)
    assert errors[0] and not errors[1]
    assert np.array_equal(recorders[1].take(), alone([good], 3000)[0])


def test_drives_that_differ_in_kind_do_not_go_together() -> None:
    base = made({})
    for change in (
        {"drive": {"inverter": {"kind": "switched"}}},
        {"drive": {"inverter": {"pwm": "edge"}}},
        {"drive": {"integration_steps": 2}},
        {"drive": {"current_rate": 20000}},
        {"energy": True},
        {"motor": RIPPLE},
        {"mechanics": {"breakaway_friction": 0.1}},
        {"load": {"time_table": {"time": [0.0, 1.0], "torque": [0.0, 1.0]}}},
    ):
        other = made(change)
        assert not base.alike(other)
        with pytest.raises(ValueError, match="lanes: expected drives that are alike"):
            together([base, other], [1], 0)
    assert base.alike(made({"mechanics": {"inertia": 1e-3}}))


def test_a_kernel_that_the_processor_lacks_is_refused() -> None:
    with pytest.raises(ValueError, match="advance_lanes: expected a state"):
        together([made({})], [1], len(KERNELS))


def test_a_recorder_takes_selected_columns_across_takes_and_expected_rows() -> None:
    drive = made({"motor": RIPPLE})
    state, recorder = drive.start(), engine.Recorder(drive, 3, 2, [4, 0])
    parts = []
    for ticks in (10, 1, 0, 50):
        drive.advance(state, recorder, ticks)
        parts.append(recorder.take())
    assert [len(part) for part in parts] == [4, 0, 0, 17]
    assert np.array_equal(np.concatenate(parts), alone([drive], 61)[0][::3, [4, 0]])
    with pytest.raises(ValueError, match="selected: expected places of signals"):
        engine.Recorder(drive, 1, 0, [len(drive.signals)])
