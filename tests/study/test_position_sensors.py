"""Position sensors, speed filter and bus as a study writes them: what they measure, and what is refused."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.errors import StudyError
from cogless.export.prepared import prepare_whole
from cogless.run.drive_config import engine_config
from cogless.run.simulate import run_study
from cogless.study import load

SENSOR = "drive.position_sensor"
OBSERVER = {"speed_method": "observer", "observer_bandwidth": "100 Hz"}
WORD = {"kind": "absolute", "bits": 14}
ENCODER = {"kind": "encoder", "lines": 2500}
WAVES = {1: (0.4, 0.3), 2: (0.15, -1.0)}  # order: amplitude and phase, deg and rad
TURN = f"""title = "Errors of a sensor"
{studies.IDEAL}
[scenario]
turn = {{ duration = "1.2 s", reference = "60 rpm", initial_speed = "60 rpm" }}
[controller]
pi = {{ law = "pi", kp = "0.002 A/rpm", ki = "0.01 A/rpm/s" }}
[[metric]]
name = "position_error"
kind = "order"
signal = "theta_sensor_error"
frame = "mechanical"
order = [1, 2, 3]
unit = "deg"
[[metric]]
name = "true_ripple"
kind = "ripple-rms"
signal = "omega_m"
[[metric]]
name = "measured_ripple"
kind = "ripple-rms"
signal = "omega_measured"
"""


def csv(folder: Path, points: int = 720) -> str:
    rows = ["angle [deg],error [deg]"]
    for n in range(points + 1):
        angle = 360 * n / points
        error = sum(a * math.sin(k * math.radians(angle) + p) for k, (a, p) in WAVES.items())
        rows.append(f"{angle!r},{error!r}")
    (folder / "error.csv").write_text("\n".join(rows))
    return "error.csv"


def orders() -> list[dict[str, Any]]:
    return [{"order": k, "amplitude": f"{a} deg", "phase": f"{p} rad"} for k, (a, p) in WAVES.items()]


@pytest.mark.parametrize("kind", [WORD, {"kind": "resolver"}, {**ENCODER, "lines": 65536}])
@pytest.mark.parametrize("by", ["orders", "table"])
def test_the_orders_of_the_error_are_a_metric(tmp_path: Path, kind: dict[str, Any], by: str) -> None:
    error = {"error": orders()} if by == "orders" else {"error_table": csv(tmp_path)}
    study = load(studies.write(tmp_path, TURN), {SENSOR: {**kind, **error}})
    (run,) = run_study(study).runs
    found = np.degrees(run.metrics["position_error_rad"])
    # the angle is sampled in steps, and the trace has two rows a period of the law
    assert found == pytest.approx([0.4, 0.15, 0.0], abs=2e-3)
    assert run.metrics["measured_ripple_rad_s"] != run.metrics["true_ripple_rad_s"]


def test_eccentricity_is_the_error_of_order_one(tmp_path: Path) -> None:
    path = studies.write(tmp_path, TURN)
    eccentric = {**WORD, "eccentricity": "0.4 deg", "eccentricity_phase": "0.3 rad"}
    ordered = {**WORD, "error": orders()[:1]}
    one, other = (
        engine_config(load(path, {SENSOR: sensor}), "turn", "pi")["drive"]["position_sensor"]
        for sensor in (eccentric, ordered)
    )
    assert one == other


@pytest.mark.parametrize(
    ("sensor", "more"),
    [
        ({**WORD, "latency": "0.7 ms"}, {}),
        ({"kind": "absolute", "positions": 10_000, **OBSERVER}, {}),
        ({**ENCODER, "speed_method": "average", "window": 4}, {"drive.speed_filter": "100 Hz"}),
        ({"kind": "hall", "placement": ["3 deg", "0 deg", "-4 deg", "0 deg", "2 deg", "0 deg"]}, {}),
        (WORD, {"drive.bus": {"delay_measured": "1 ms", "delay_command": "2 ms", "quantum": "1 mA"}}),
    ],
)  # fmt: skip
def test_a_drive_turns_with_each(tmp_path: Path, sensor: dict[str, Any], more: dict[str, Any]) -> None:
    study = load(studies.write(tmp_path, TURN), {SENSOR: sensor, **more})
    (run,) = run_study(study).runs
    assert run.trace["omega_m"][-200:].mean() == pytest.approx(2 * math.pi, rel=0.1)


@pytest.mark.parametrize(
    "changes",
    [
        {"drive.bus": {"delay_command": "1 ms"}},
        {"scenario.low.override": {"drive.bus.delay_command": "1 ms"}},
    ],
)
def test_a_law_elsewhere_is_not_exported_with_the_drive(tmp_path: Path, changes: dict[str, Any]) -> None:
    study = load(studies.write(tmp_path), changes)
    with pytest.raises(StudyError) as error:
        prepare_whole(study, "low", "pi")
    assert str(error.value).endswith(
        "study.toml: drive.bus: behind a field bus the law runs apart from the drive: expected no drive.bus, "
        "since an export joins law and drive"
    )


def line_of(folder: Path, changes: dict[str, Any]) -> str:
    return studies.refusal(studies.study, folder, changes).removeprefix("study.toml: ")


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({SENSOR: {"kind": "absolute"}},
            "drive.position_sensor: expected either bits, such as 14, or positions, such as 10000"),
        ({SENSOR: {**WORD, "positions": 3}},
            "drive.position_sensor.positions: 3: expected no such key, since bits is given: delete "
            "positions, or delete bits"),
        ({SENSOR: {**WORD, "speed_method": "MT"}},
            'drive.position_sensor.speed_method: "MT": expected "M", "average" or "observer", perhaps "M"'),
        ({SENSOR: {**WORD, "speed_method": "observer"}},
            'drive.position_sensor.observer_bandwidth: missing: expected this key, since speed_method = '
            '"observer", such as "200 Hz"'),
        ({SENSOR: {**WORD, "speed_method": "M", "window": 3}},
            'drive.position_sensor.window: 3: expected no such key, since speed_method = "M": delete window, '
            'or set speed_method = "average"'),
        ({SENSOR: {**WORD, "latency": "-1 us"}},
            'drive.position_sensor.latency: "-1 us": expected a time of zero or more, such as "1 s"'),
        ({SENSOR: {**WORD, "latency": "7 s"}},
            'drive.position_sensor.latency: "7 s": expected at most 6.66667 s, 100000 periods of the current '
            'loop'),
        ({SENSOR: {**ENCODER, "speed_method": "MT", "latency": "1 us"}},
            'drive.position_sensor.latency: "1 us": expected no such key, since speed_method = "MT" times '
            'the edges: delete latency, or set speed_method = "M"'),
        ({SENSOR: {**WORD, "error": [{"order": 100, "amplitude": "1 deg"}]}},
            'drive.position_sensor.error: [{ order = 100, amplitude = "1 deg" }]: expected waves whose '
            'products order * amplitude add up to less than 1 rad: otherwise the measured angle runs '
            "backward"),
        ({SENSOR: {**WORD, "error": [{"order": 0, "amplitude": "1 deg"}]}},
            "drive.position_sensor.error.0.order: 0: expected a number of 1 or more"),
        ({SENSOR: {**WORD, "error": [{"order": 1, "amplitude": "1 mm"}]}},
            'drive.position_sensor.error.0.amplitude: "1 mm": expected an angle, such as "1 deg"'),
        ({SENSOR: {**WORD, "error_table": "none.csv"}},
            'drive.position_sensor.error_table: "none.csv": expected a readable file at none.csv'),
        ({SENSOR: {"kind": "hall", "placement": ["1 deg"]}},
            'drive.position_sensor.placement: ["1 deg"]: expected six angles, one for each edge'),
        ({SENSOR: {"kind": "hall", "placement": ["30 deg"] + 5 * ["0 deg"]}},
            'drive.position_sensor.placement: ["30 deg", "0 deg", "0 deg", "0 deg", "0 deg", "0 deg"]: '
            "expected less than 30 deg for each edge: otherwise edges change places"),
        ({SENSOR: {"kind": "hall", "edges": 7}},
            "drive.position_sensor.edges: 7: expected a number of 6 or less"),
        ({"drive.speed_filter": "5 kHz"},
            'drive.speed_filter: "5 kHz": expected at most 4775 Hz, a third of rates.current_loop'),
        ({"drive.bus": {"delay": "1 ms"}},
            'drive.bus.delay: "1 ms": expected a known key, perhaps "delay_measured" or "delay_command"'),
        ({"drive.bus": {"jitter": "8 s"}},
            'drive.bus.jitter: "8 s": expected at most 6.66667 s, 100000 periods of the current loop'),
        ({"drive.bus": {"quantum": "1 V"}},
            'drive.bus.quantum: "1 V": expected a current, such as "1 A"'),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, changes: dict[str, Any], line: str) -> None:
    assert line_of(tmp_path, changes) == line


def test_a_delay_may_be_a_hundred_thousand_periods(tmp_path: Path) -> None:
    bus = {"delay_command": "10 s", "jitter": "10 s"}
    changes = {"drive.rates.current_loop": "10 kHz", SENSOR: {**WORD, "latency": "10 s"}, "drive.bus": bus}
    drive = load(studies.write(tmp_path), changes).drive
    assert drive.position_sensor.latency == 10.0
    assert drive.bus is not None and drive.bus.mean_delay == 20.0


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([(a, math.nan if a == 50 else 0.1) for a in range(0, 360, 10)],
            'line 7: "nan": expected a finite error'),
        ([(a, 0.1) for a in range(0, 360, 10) if not 90 < a < 180],
            "line 11: the next angle comes after 90 deg: expected at most 50 deg, 5 times the usual spacing"),
        ([(a, 0.01 * a) for a in range(0, 361, 10)],
            "line 38: the error jumps from the last line to the first, "
            "36 times as far as anywhere else: expected a whole revolution"),
        ([(a, {10: 5.0, 20: -5.0}.get(a, 0.0)) for a in range(0, 360, 10)],
            "expected an error that falls more slowly than the angle rises: otherwise the measured angle "
            "runs backward"),
        ([(a, 15.0 * (a % 20 == 0)) for a in range(0, 360, 10)],
            "expected an error that falls more slowly than the angle rises: otherwise the measured angle "
            "runs backward"),
    ],
)  # fmt: skip
def test_a_table_that_is_none_is_one_line(tmp_path: Path, rows: list[Any], problem: str) -> None:
    text = "\n".join(["angle [deg],error [deg]", *(f"{a},{e}" for a, e in rows)])
    (tmp_path / "e.csv").write_text(text)
    found = line_of(tmp_path, {SENSOR: {**WORD, "error_table": "e.csv"}})
    assert found == f'drive.position_sensor.error_table: "e.csv": {problem}'
