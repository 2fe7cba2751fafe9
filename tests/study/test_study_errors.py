"""A mistake in a study is one line that names the file, the key, the value and what was expected."""

import re
import tomllib
from functools import partial
from pathlib import Path
from typing import Any, get_args

import pytest

import studies
from cogless.errors import StudyError
from cogless.study import changed, load
from cogless.study.laws import AnyController
from cogless.study.messages import look_up, toml_text
from cogless.study.motor import Motor
from cogless.study.reading import parse_change
from cogless.study.table import Table, check_precision
from cogless.study.toml import toml
from studies import refusal

LAWS = [get_args(model.model_fields["law"].annotation)[0] for model in get_args(AnyController)]
PI = {"law": "pi", "kp": 1, "ki": 1}
ILC = {**PI, "law": "pi-ilc", "gain": 0}
SPREAD = {key: {"uniform": "20 %"} for key in ("motor.R_s", "motor.L_d", "motor.L_q")}
TABLE = {**PI, "law": "anti-cogging", "calibration": {"speed": "2 rpm", "position_gain": "20 1/s"}}
METRIC = {"name": "m", "kind": "rms", "signal": "i_q"}
TARGET = {"scenario": "low", "controller": "pi", "metric": "speed_ripple", "value": "5 rpm"}
STEPS = "drive.rates.integration_steps: 1, the default: expected"
SIDE = {"inertia": "1e-4 kg*m^2", "stiffness": "30 N*m/rad"}
PARAMETER = {"key": "motor.cogging.0.torque"}

line_of = partial(refusal, studies.study)


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        # keys
        ("mechanics.inertai", "1 kg*m^2",
            'mechanics.inertai: "1 kg*m^2": expected a known key, perhaps "inertia"'),
        ("motor.r_s", "1 ohm", 'motor.r_s: "1 ohm": expected a known key, perhaps "R_s"'),
        ("motor.L", "1 mH", 'motor.L: "1 mH": expected a known key, perhaps "L_d" or "L_q"'),
        ("motor.R", "1 ohm", 'motor.R: "1 ohm": expected a known key, perhaps "R_s"'),
        ("motor.kt", "1 N*m/A", 'motor.kt: "1 N*m/A": expected a known key, perhaps "K_t"'),
        ("motor.K_e", "1 V/rpm",
            'motor.K_e: "1 V/rpm": expected a known key, perhaps "K_e_line_to_line_peak" or '
            '"K_e_line_to_line_rms" or "K_e_phase_peak" or "K_e_phase_rms"'),
        ("motor.torque_constant", "1 N*m/A",
            'motor.torque_constant: "1 N*m/A": expected the key K_t instead'),
        ("motor.J", "1 kg*m^2", 'motor.J: "1 kg*m^2": expected the key mechanics.inertia instead'),
        ("trace.zzz", 1, "trace.zzz: 1: expected one of rate, file_rate, energy"),
        ("controller.pi.gain", 1,
            'controller.pi.gain: 1: expected no such key, since law = "pi": delete gain, or set law = '
            '"pi-ilc" or "pi-afc"; gain is from --set, law from the file'),
        ("mechanics", {}, 'mechanics.inertia: missing: expected an inertia above zero, such as "1 kg*m^2"'),
        ("mechanics", 3, "mechanics: 3: expected a table with the keys inertia, viscous_friction, "
                         "coulomb_friction, "
            "breakaway_friction, stribeck_speed, friction_harmonics, friction_table, load_side, belt, load"),
        # quantities
        ("mechanics.load", 0.5, 'mechanics.load: 0.5: expected a text with a unit, such as "0.5 N*m"'),
        ("mechanics.inertia", "2.5e-4",
            'mechanics.inertia: "2.5e-4": expected a unit, too, such as "2.5e-4 kg*m^2"'),
        ("mechanics.inertia", "1 kg", 'mechanics.inertia: "1 kg": expected an inertia, such as "1 kg*m^2"'),
        ("mechanics.inertia", -1e-4,
            'mechanics.inertia: "-0.0001 kg*m^2": expected an inertia above zero, such as "1 kg*m^2"'),
        ("mechanics.inertia", "0 kg*m^2",
            'mechanics.inertia: "0 kg*m^2": expected an inertia above zero, such as "1 kg*m^2"'),
        ("mechanics.inertia", float("nan"),
            'mechanics.inertia: "nan kg*m^2": expected a number and a unit, such as "1 kg*m^2"'),
        ("motor.R_s", "-1 ohm",
            'motor.R_s: "-1 ohm": expected a resistance of zero or more, such as "1 ohm"'),
        ("scenario.low.reference", "1 Hz",
            'scenario.low.reference: "1 Hz": expected an angular speed, such as "1 rpm"; the unit "Hz" may '
            'be "rev/s", or the frequency of the current, pole_pairs times as much'),
        ("controller.pi.kp", "1 A",
            'controller.pi.kp: "1 A": expected a gain of the speed loop, such as "1 A/rpm"'),
        ("title", 5, "title: 5: expected a text"),
        ("seed", -1, "seed: -1: expected a number of 0 or more"),
        ("motor.pole_pairs", 4.5, "motor.pole_pairs: 4.5: expected a whole number"),
        ("motor.pole_pairs", True, "motor.pole_pairs: true: expected a whole number"),
        ("metric", 3, "metric: 3: expected an array of tables, written as [[metric]]"),
        # motor
        ("motor.winding", "wye", 'motor.winding: "wye": expected "star" or "delta"'),
        ("motor.cogging", [{"order": 24}],
            'motor.cogging.0: expected either torque, such as "4 mN*m", torque_peak_to_peak, '
            'or current, such as "0.2 A"'),
        ("motor.cogging.0.order", 0, "motor.cogging.0.order: 0: expected a number of 1 or more"),
        ("motor.torque_ripple", [{"order": 6}],
            "motor.torque_ripple.0: expected either percent, such as 1.5, or percent_peak_to_peak"),
        ("motor.saturation", {"q": {"current": ["0 A", "1 A", "2 A"]}},
            "motor.saturation.q: expected either flux or inductance"),
        ("motor.saturation", {"q": {"current": ["1 A", "2 A", "3 A"], "flux": ["0 Wb", "1 Wb", "2 Wb"]}},
            'motor.saturation.q.current: ["1 A", "2 A", "3 A"]: expected three or more values that rise, '
            "zero among them"),
        ("motor.saturation", {"q": {"current": ["0 A", "1 A", "2 A"], "inductance": ["3 mH", "3 mH"]}},
            'motor.saturation.q.inductance: ["3 mH", "3 mH"]: expected 3 values, as many as current has'),
        ("motor.saturation", {"q": {"current": ["0 A", "1 A", "2 A"], "flux": ["1 Wb", "2 Wb", "3 Wb"]}},
            'motor.saturation.q.flux: ["1 Wb", "2 Wb", "3 Wb"]: expected zero at zero current'),
        ("motor.saturation", {"q": {"current": ["0 A", "1 A", "4 A"], "inductance": ["3 H", "3 H", "0.5 H"]}},
            'motor.saturation.q.inductance: ["3 H", "3 H", "0.5 H"]: expected a flux linkage that grows with '
            "the current"),
        ("motor.saturation", {"q": {"current": ["0 A", "1 A", "2 A"], "inductance": ["15 mH"] * 3}},
            "motor.saturation.q: expected 0.03 H at zero current, as L_q, not 0.015 H"),
        ("motor.saturation", {"magnet": {"current": ["0 A", "1 A", "2 A"], "flux": ["1 Wb", "2 Wb", "3 Wb"]}},
            'motor.saturation.magnet.flux: ["1 Wb", "2 Wb", "3 Wb"]: expected zero at zero current'),
        ("motor.saturation", {"magnet": {"current": ["0 A", "1 A", "2 A"]}},
            "motor.saturation.magnet.flux: expected 3 values, as many as current has"),
        ("motor.temperature", {"winding": "350 K"},
            'motor.temperature.winding: "350 K": expected a temperature, such as "1 degC"'),
        ("motor.temperature", {"winding": "-300 degC"},
            'motor.temperature.winding: "-300 degC": expected -273.15 degC or more'),
        ("motor.temperature", {"winding": "90 degC", "flux_coefficient": "-0.02 1/K"},
            'motor.temperature.flux_coefficient: "-0.02 1/K": expected a coefficient that leaves a '
        'positive value at 90 degC'),
        ("motor.temperature", {"winding": "90 degC", "heating": {"ambient": "20 degC", "winding_capacity":
            "1 uJ/K", "magnet_capacity": "1 J/K", "winding_to_ambient": "1 K/W"}},
            "motor.temperature.heating: expected larger heat capacities: with these a temperature changes "
            "within 0.5 us, too fast for one step in each period of the current loop"),
        # drive
        ("drive.rates.speed_loop", "7 kHz",
            'drive.rates.speed_loop: "7 kHz": expected a rate that divides current_loop, 15000 Hz'),
        ("drive.rates.current_loop", "1.5 Hz",
            'drive.rates.current_loop: "1.5 Hz": expected a whole number of Hz, such as "1 kHz"'),
        ("trace.rate", "4 kHz",
            'trace.rate: "4 kHz": expected a rate that divides drive.rates.current_loop, 15000 Hz'),
        ("trace.rate", "30 kHz",
            'trace.rate: "30 kHz": expected a rate that divides drive.rates.current_loop, 15000 Hz; a higher '
            'rate needs drive.inverter.kind = "switched"'),
        ("drive.current_loop.kp", "1 V/A",
            'drive.current_loop.bandwidth: "800 Hz": expected no such key, since kp is given: delete '
            "bandwidth, or delete kp; bandwidth is from the file, kp from --set: add "
            "--set drive.current_loop.bandwidth= to delete bandwidth"),
        ("drive.current_loop", {"kp": "1e16 V/A", "ki": "1 V/A/s", "current_limit": "3 A"},
            'drive.current_loop.kp: "1e16 V/A": expected a size that single precision holds, 1e-15 to 1e+15 '
            "in SI units"),
        ("drive.dead_time_compensation", {"band": "0.9e-15 A"},
            'drive.dead_time_compensation.band: "0.9e-15 A": expected a size that single precision holds, '
            "1e-15 to 1e+15 in SI units"),
        ("drive", {"rates": {"current_loop": "2 kHz", "speed_loop": "1 kHz"},
                   "current_loop": {"kind": "ideal", "current_limit": "1e16 A"}},
            'drive.current_loop.current_limit: "1e16 A": expected a size that single precision holds, 1e-15 '
            "to 1e+15 in SI units"),
        ("drive.position_sensor", {"kind": "laser"},
            'drive.position_sensor.kind: "laser": expected one of "ideal", "encoder", "absolute", '
            '"resolver", "hall"'),
        ("drive.position_sensor", {"lines": 3},
            'drive.position_sensor.kind: missing: expected a kind of sensor, such as "encoder"'),
        ("drive.position_sensor", {"kind": "ideal", "lines": 3},
            'drive.position_sensor.lines: 3: expected no such key, since kind = "ideal": delete lines, or '
            'set kind = "encoder"'),
        ("drive.position_sensor", {"kind": "encoder", "lines": 0},
            "drive.position_sensor.lines: 0: expected a number of 1 or more"),
        ("drive.inverter.computation_delay", 2, "drive.inverter.computation_delay: 2: expected 0 or 1"),
        ("drive.current_sensors.offset", ["0 A", "0 A"],
            'drive.current_sensors.offset: ["0 A", "0 A"]: expected 3 values'),
        ("mechanics.breakaway_friction", "-1 N*m",
            'mechanics.breakaway_friction: "-1 N*m": expected a torque of zero or more, such as "1 N*m"'),
        ("mechanics.load_side", {"inertia": "1e-4 kg*m^2"},
            'mechanics.load_side.stiffness: missing: expected a torsional stiffness above zero, such as '
            '"1 N*m/rad"'),
        ("mechanics.load_side", {**SIDE, "stiffness": "30 N*m"},
            'mechanics.load_side.stiffness: "30 N*m": expected a torsional stiffness, such as "1 N*m/rad"'),
        ("mechanics.load_side", {**SIDE, "ratio": 0},
            "mechanics.load_side.ratio: 0: expected a number above 0"),
        ("mechanics.load_side", {**SIDE, "stiffness": "1e9 N*m/rad"},
            f"{STEPS} 499 or more, since the twist of the shaft "
            "(mechanics.load_side: stiffness, damping, both inertias) changes within 0.267 us"),
        ("mechanics.load_side", {**SIDE, "damping": "1 N*m*s/rad"},
            f"{STEPS} 2 or more, since the twist of the shaft "
            "(mechanics.load_side: stiffness, damping, both inertias) changes within 71.6 us"),
        ("mechanics.load_side",
            {**SIDE, "gear_errors": [{"side": "input", "order": 100, "angle": "10 mrad"}]},
            'mechanics.load_side.gear_errors: [{ side = "input", order = 100, angle = "10 mrad" }]: '
            "expected smaller errors: with these errors the gear's output would turn back"),
        ("drive.position_sensor", {"kind": "ideal", "side": "load"},
            'drive.position_sensor.side: "load": expected "motor", since there is no mechanics.load_side'),
        ("mechanics",
            {"inertia": "1 g*m^2", "coulomb_friction": "2 mN*m", "breakaway_friction": "1.99 mN*m"},
            'mechanics.breakaway_friction: "1.99 mN*m": expected coulomb_friction or more'),
        ("mechanics.load", {"angle_table": {"angle": ["0 deg"], "file": "a.csv"}},
            'mechanics.load.angle_table.file: "a.csv": expected no such key, since angle is given: '
            'delete file, or delete angle and torque'),
        ("mechanics.load", {"angle_table": {"torque": ["1 N*m"], "file": "a.csv"}},
            'mechanics.load.angle_table.file: "a.csv": expected no such key, since torque is given: '
            'delete file, or delete angle and torque'),
        ("mechanics.stribeck_speed", "1 rpm",
            'mechanics.stribeck_speed: "1 rpm": expected no such key, since breakaway_friction is not '
            "above coulomb_friction: delete stribeck_speed, or raise breakaway_friction"),
        ("mechanics.friction_harmonics", [{"order": 1, "torque": "1 N*m"}],
            'mechanics.friction_harmonics: [{ order = 1, torque = "1 N*m" }]: expected amplitudes '
            "whose sum is at most 0 N*m, so that friction is nowhere negative"),
        ("mechanics.friction_table", {"angle": ["0 deg", "90 deg"], "torque": ["0 N*m", "-1 N*m"]},
            "mechanics.friction_table: expected torques with which coulomb_friction plus table is "
            "nowhere negative"),
        ("mechanics.friction_table", {"file": "nowhere.csv"},
            'mechanics.friction_table.file: "nowhere.csv": expected a readable file at nowhere.csv'),
        ("metric", [{**METRIC, "signal": "omega_load"}],
            'metric.0.signal: "omega_load": expected another signal, or the table mechanics.load_side'),
        ("mechanics.load", {"time_table": {"time": ["1 s", "0 s"], "torque": ["1 N*m", "1 N*m"]}},
            'mechanics.load.time_table.time: ["1 s", "0 s"]: '
            "expected one or more values, each above the previous one"),
        ("mechanics.load", {"time_table": {"time": ["1 s", "1 s"], "torque": ["1 N*m", "1 N*m"]}},
            'mechanics.load.time_table.time: ["1 s", "1 s"]: '
            "expected one or more values, each above the previous one"),
        ("mechanics.load", {"time_table": {"time": ["1 s"], "torque": []}},
            "mechanics.load.time_table.torque: []: expected 1 values, as many as time has"),
        ("mechanics.load", {"angle_table": {"angle": ["0 deg", "360 deg"], "torque": ["1 N*m", "1 N*m"]}},
            'mechanics.load.angle_table.angle: ["0 deg", "360 deg"]: '
            "expected less than one revolution from the first to the last angle"),
        # scenarios
        ("scenario", {}, "scenario: {}: expected 1 or more"),
        ("scenario.low.controllers", ["x"], 'scenario.low.controllers.0: "x": expected one of "pi", "fair"'),
        ("scenario.step.events.1.time", 0.5,
            'scenario.step.events.1.time: "0.5 s": expected a time within the scenario\'s 0.3 s'),
        ("scenario.step.events.1.time", 0.1,
            'scenario.step.events.1.time: "0.1 s": expected a time after the previous event'),
        ("scenario.low.reference", {"speed": "1 rpm", "offset": "1 rpm"},
            "scenario.low.reference: expected the keys of one form: speed; ramp, speed; profile; "
            "amplitude, frequency, offset; amplitude, depth, frequency, modulation, offset; offset, sines; "
            "moves; file"),
        ("scenario.low.reference", {"profile": [["1 s", "0 rpm"], ["0 s", "1 rpm"]]},
            'scenario.low.reference.profile: [["1 s", "0 rpm"], ["0 s", "1 rpm"]]: '
            "expected one or more points, each later than the previous one"),
        ("scenario.low.torque_mode", {"time": "0.1 s", "profile": [["1 s", "1 A"], ["1 s", "2 A"]]},
            'scenario.low.torque_mode.profile: [["1 s", "1 A"], ["1 s", "2 A"]]: expected points, each later '
            "than the previous one"),
        ("scenario.low.override", {"seed": 2},
            "scenario.low.override.seed: 2: expected a key of motor, drive or mechanics"),
        ("scenario.low.override", {"mechanics.inertia": "-1 kg*m^2"},
            'scenario.low.override: mechanics.inertia: "-1 kg*m^2": '
            'expected an inertia above zero, such as "1 kg*m^2"'),
        ('scenario."a/b"', {"duration": "1 s", "reference": "1 rpm"},
            "scenario.a/b: expected a name of letters, digits, _, - and ."),
        # controllers
        ("controller.pi.law", "pid",
            'controller.pi.law: "pid": expected one of '
            + ", ".join(f'"{name}"' for name in LAWS) + ', perhaps "pi"'),
        ("controller.pi.law", "harmonics",
            'controller.pi.law: "harmonics": expected one of '
            + ", ".join(f'"{name}"' for name in LAWS) + ', perhaps "harmonic"'),
        ("motor.winding", "Star", 'motor.winding: "Star": expected "star" or "delta", perhaps "star"'),
        *(("controller.afc", {**PI, "law": "pi-afc", "gain": 1, "orders": orders},
            f"controller.afc.orders: {orders}: expected 1 to 16 rising orders between 1 and 65535")
          for orders in ([], [0], [6, 6], [12, 6], [70000], [*range(1, 18)])),
        ("controller.afc", {**PI, "law": "pi-afc", "gain": 1, "orders": [6.5]},
            "controller.afc.orders.0: 6.5: expected a whole number"),
        ("controller.pi", {"kp": 1},
            "controller.pi.law: missing: expected a law that cogless list shows"),
        ("controller.fair.kp", 1,
            "controller.fair.tuning: expected no such key, since kp is given: delete tuning, or delete kp; "
            "tuning is from the file, kp from --set: add --set controller.fair.tuning= to delete tuning"),
        ("controller.fair.tuning.phase_margin", 100,
            'controller.fair.tuning.phase_margin: "100 deg": '
            'expected a phase margin from "20 deg" to "80 deg"'),
        ("controller.fair.tuning", {"rule": "phase-margin", "phase_margin": 60},
            "controller.fair.tuning.phase_margin: 60: "
            'expected a phase margin from "20 deg" to "80 deg"; a plain number is in rad, perhaps "60 deg"'),
        ("controller.fair.tuning.phase_margin", 5,
            'controller.fair.tuning.phase_margin: "5 deg": '
            'expected a phase margin from "20 deg" to "80 deg"'),
        ("controller.fair.tuning", {"rule": "auto", "phase_margin": 5},
            "controller.fair.tuning.phase_margin: 5: "
            'expected a phase margin from "20 deg" to "80 deg"; a plain number is in rad'),
        ("controller.fair.tuning", {"rule": "phase-margin"},
            'controller.fair.tuning.phase_margin: missing: expected a phase margin, such as "60 deg"'),
        ("controller.t", {**PI, "law": "anti-cogging", "start": {}},
            'controller.t.start: expected either map = "FILE.bin" or table = "FILE.csv"'),
        ("controller.t", {**PI, "law": "anti-cogging", "start": {"map": "a.bin", "table": "a.csv"}},
            'controller.t.start.table: "a.csv": expected no such key, since map is given: delete table, or '
            'delete map'),
        *(("controller.t", {**PI, "law": "anti-cogging", "start": {"map": "a.bin", key: word}},
            f'controller.t.start.{key}: "{word}": expected no such key, since the stored map '
            f"contains it: delete {key}, or give table in place of map")
          for key, word in (("sign", "holding"), ("frame", "mechanical"))),
        ("controller.ilc", {**ILC, "forgetting": 0},
            "controller.ilc.forgetting: 0: expected a number above 0"),
        ("controller.ilc", {**ILC, "cells": 8, "q_half_width": 4},
            "controller.ilc.q_half_width: 4: expected a filter that fits into the 8 cells of the memory"),
        ("controller.ilc", {**ILC, "memory": "space"},
            'controller.ilc.memory: "space": expected "time" or "angle"'),
        ("controller.t", {**TABLE, "calibration": {"speed": "-2 rpm", "position_gain": 1}},
            'controller.t.calibration.speed: "-2 rpm": '
            'expected an angular speed above zero, such as "1 rad/s"'),
        ("controller.t", {**TABLE, "calibration": {"speed": "2 rpm", "position_gain": 1e16}},
            "controller.t.calibration.position_gain: 1e+16: expected a size that single precision holds, "
            "1e-15 to 1e+15 in SI units"),
        ("controller.mine", {"law": "python", "object": "law.py"},
            'controller.mine.object: "law.py": expected a file and a class, such as "my_law.py:MyLaw"'),
        ("controller", {"pi": {**PI, "baseline": True}, "fair": {**PI, "baseline": True}},
            'controller.fair.baseline: true: expected only one baseline, which is "pi" already'),
        # metrics
        ("metric", [{**METRIC, "kind": "first-rms"}],
            'metric.0.kind: "first-rms": expected another kind, since there are no trials'),
        ("metric", [{**METRIC, "signal": "temperature_winding"}],
            'metric.0.signal: "temperature_winding": expected another signal, or the table '
            'motor.temperature'),
        ("metric.0.window", [0.1, 1],
            'metric.0.window: ["0.1 s", "1 s"]: expected a window within the 0.4 s of scenario "low"'),
        ("metric.0.last", "0.1 s", 'metric.0.last: "0.1 s": expected only one of window, last and event'),
        ("metric", [{"name": "m", "kind": "rms", "signal": "i_q", "last": "1 s"}],
            'metric.0.last: "1 s": expected at most the 0.4 s of scenario "low"'),
        ("metric.0.window", [0.3, 0.2],
            'metric.0.window: ["0.3 s", "0.2 s"]: expected an end after the beginning'),
        ("metric", [{**METRIC, "signal": "term_ilc"}],
            'metric.0.signal: "term_ilc": expected a signal that a controller of this study has'),
        ("metric.0.unit", "A", 'metric.0.unit: "A": expected a unit of an angular speed, such as "rpm"'),
        ("metric.0.scenarios", ["x"], 'metric.0.scenarios: ["x"]: expected one of "low", "step"'),
        ("metric.1.name", "speed_ripple",
            'metric.1.name: "speed_ripple": expected a name that no other metric of scenario "low" has'),
        ("metric.1.name", "a b", 'metric.1.name: "a b": expected a name of letters, digits and _'),
        ("metric.1.order", [1, 2000],
            "metric.1.order: [1, 2000]: expected orders below 1875: at the top speed of scenario "
            '"low" only these are below half the trace\'s rate of 15000 Hz'),
        ("metric.1.order", [], 'metric.1.order: []: expected this key, since kind is "order"'),
        ("metric.0.band", "1 rpm", 'metric.0.band: "1 rpm": expected no such key, since kind = '
            '"peak-to-peak": delete band, or set a kind that takes band; band is from --set, kind from the '
            'file'),
        ("metric.2.event", 0.15, 'metric.2.event: "0.15 s": expected the time of an event in a scenario'),
        ("metric.2.scenarios", ["low"],
            'metric.2.event: "0.1 s": expected the time of an event in scenario "low"'),
        ("metric.2.band", "1 A", 'metric.2.band: "1 A": expected an angular speed, such as "1 rpm"'),
        ("metric", [{**METRIC, "kind": "settling"}],
            'metric.0.event: missing: expected this key, since kind is "settling"'),
        ("metric", [{"name": "m", "kind": "rms"}],
            'metric.0.signal: missing: expected this key, since kind is "rms"'),
        # calibration
        ("calibration", {"parameters": [], "targets": [TARGET]},
            "calibration.parameters: []: expected one or more"),
        ("calibration", {"parameters": [{**PARAMETER, "scenario": "x"}], "targets": [TARGET]},
            'calibration.parameters.0.scenario: "x": expected one of "low", "step"'),
        ("calibration", {"parameters": [PARAMETER], "targets": [{**TARGET, "metric": "recovery"}]},
            'calibration.targets.0.metric: "recovery": expected one of "speed_ripple", "speed"'),
        ("calibration", {"parameters": [PARAMETER], "targets": [{**TARGET, "value": "5 A"}]},
            'calibration.targets.0.value: "5 A": expected an angular speed, such as "1 rpm"'),
        ("calibration", {"parameters": [PARAMETER], "targets": [{**TARGET, "metric": "speed"}]},
            'calibration.targets.0.value: "5 rpm": expected 3 values'),
    ],
)  # fmt: skip
def test_a_wrong_value(tmp_path: Path, key: str, value: object, line: str) -> None:
    assert line_of(tmp_path, {key: value}) == f"study.toml: {line}"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"motor.L_d": "1 mH"},
            f"{STEPS} 3 or more, since the current (R_s / L) changes "
            "within 64.9 us"),
        ({"scenario.step.reference": "9000 rpm"},  # the fastest scenario counts
            f"{STEPS} 3 or more, since the highest order at the "
            "9000 rpm of scenario.step.reference changes within 52.8 us; at the bus voltage the motor "
            "reaches "
            "6284 rpm without load, not 9000 rpm"),
        ({"scenario.low.initial_speed": "-9000 rpm"},  # something else turns it that fast
            f"{STEPS} 4 or more, since the highest order at the "
            "9000 rpm of scenario.low.initial_speed changes within 44.2 us"),
        ({"mechanics.inertia": "1e-12 kg*m^2"},
            f"{STEPS} 257 or more, since the oscillation of speed and current "
            "(K_t, inertia, L) changes within 0.52 us"),
        ({"drive.inverter.dead_time": "1 s"},
            'drive.inverter.dead_time: "1 s": expected less than half a period of the current loop, '
            "3.33e-05 s"),
        ({"drive.inverter.minimum_pulse": "-1 us"},
            'drive.inverter.minimum_pulse: "-1 us": expected a time of zero or more, such as "1 s"'),
        ({"drive.inverter.minimum_pulse": "20 us"},
            'drive.inverter.minimum_pulse: "20 us": expected minimum_pulse + dead_time below 1.67e-05 s, a '
            "quarter of a current-loop period"),
        ({"drive.inverter.minimum_pulse": "30 us", "drive.inverter.dead_time": "4 us",
          "drive.inverter.pwm": "two-updates"},
            'drive.inverter.minimum_pulse: "30 us": expected minimum_pulse + dead_time below 3.33e-05 s, '
            'half '
            "of a current-loop period"),
        ({"scenario.low.duration": "1e9 s"},
            'scenario.low.duration: "1e9 s": expected at most 1333.33 s at a trace.rate of 15000 Hz'),
        ({"controller.ilc": {**PI, "law": "pi-ilc", "gain": 0.01, "memory": "time", "cells": 200}},
            "controller.ilc.cells: 200: expected at least 1000 cells: a period has so many samples of the "
            "speed loop"),
        ({"controller.ilc": {**PI, "law": "pi-ilc", "gain": 0.01, "period": "electrical", "lead": "70 ms"}},
            'controller.ilc.lead: "70 ms": expected at most 0.0625 s, a quarter of a period at top speed'),
        ({"controller.ilc": {**PI, "law": "pi-ilc", "gain": 0.01, "period": "electrical"},
          "scenario.low.reference": "9000 rpm", "scenario.step.reference": "9000 rpm",
          "scenario.low.initial_speed": "9000 rpm", "drive.rates.integration_steps": 9,
          "metric.1.order": [1]},
            'controller.ilc.period: "electrical": expected a longer period: at top speed this one has 1.67 '
            "samples of the speed loop, but needs 4"),
        ({"metric.0.window": ["0.1 s", "0.10001 s"]},
            'metric.0.window: ["0.1 s", "0.10001 s"]: expected a window of 10 or more rows of the trace'),
    ],
)  # fmt: skip
def test_what_the_simulation_cannot_do(tmp_path: Path, changes: dict[str, object], line: str) -> None:
    assert line_of(tmp_path, changes) == f"study.toml: {line}"


WITH_ILC = {f"scenario.{key}.controllers": ["pi", "ilc"] for key in ("low", "step")}
BY_TIME = {**PI, "law": "pi-ilc", "gain": 0.01, "memory": "time"}
BY_ANGLE = {**PI, "law": "pi-ilc", "gain": 0.01, "period": "mechanical"}
ADRC = {"law": "adrc", "b": 1e3, "omega_c": 100.0}
WORD = {"kind": "absolute", "bits": 14}
HEATING = {"ambient": "20 degC", "magnet_capacity": "1 J/K", "winding_to_ambient": "1 K/W"}
STUCK = {"kind": "angle-stuck", "time": "1 ms", "duration": "1 ms"}
IDEAL = {"drive": {"rates": {"current_loop": "2 kHz", "speed_loop": "1 kHz"},
                   "current_loop": {"kind": "ideal", "current_limit": "3 A"}},
         "scenario.step.override": {}, "trace.rate": "1 kHz"}  # fmt: skip
RESTS = {"scenario.step.reference": "0 rpm", "scenario.step.initial_speed": "0 rpm"}


@pytest.mark.parametrize(
    ("common", "key", "most", "beyond"),
    [
        # the fastest scenario has 500 samples in a period, the slowest 1000
        ({**WITH_ILC, "scenario.step.reference": "120 rpm"}, "controller.ilc",
            {**BY_TIME, "cells": 500}, {**BY_TIME, "cells": 499}),
        ({**WITH_ILC, "scenario.step.reference": "120 rpm"}, "controller.ilc",
            {**BY_ANGLE, "lead": "249 ms"}, {**BY_ANGLE, "lead": "251 ms"}),
        ({**WITH_ILC, **RESTS}, "controller.ilc",
            {**BY_ANGLE, "lead": "249 ms"}, {**BY_ANGLE, "lead": "251 ms"}),
        ({"trace.rate": "1 kHz"}, "scenario.low.duration", "20000 s", "20001 s"),
        ({}, "controller.adrc", {**ADRC, "omega_o": 1999.998}, {**ADRC, "omega_o": 1999.9985}),
        ({"drive.current_sensors.bits": 12}, "drive.current_sensors.range", "3 A", "2.999 A"),
        # rounding is allowed: 1e-9 of a time, 1e-12 of a rate
        ({}, "trace.rate", "5000.000000002 Hz", "5000.000000007 Hz"),
        ({"trace.rate": "1 kHz", "metric": []}, "scenario.low.duration",
            "9.999999995 ms", "9.999999985 ms"),
        ({"trace.rate": "1 kHz"}, "metric.0.window", ["0.1 s", "0.11 s"], ["0.1 s", "0.109999999985 s"]),
        ({}, "controller.ilc", {**BY_ANGLE, "cells": 403, "lead": "100.00000005 ms"},
            {**BY_ANGLE, "cells": 403, "lead": "100.00000015 ms"}),
        ({"metric": [{**METRIC, "scenarios": ["low"]}]}, "metric.0.window",
            ["0.1 s", "0.4 s"], ["0.1 s", "0.4000001 s"]),
        ({"metric": [{**METRIC, "scenarios": ["low"]}]}, "metric.0.last", "0.4 s", "0.4000001 s"),
        ({}, "metric.1.order", [1874], [1875]),  # half of 15 kHz at four electrical turns a second
        ({"metric.1": {"name": "m", "kind": "chattering", "scenarios": ["low"]}}, "metric.1.window",
            ["0.1 s", "0.11 s"], ["0.1 s", "0.1099 s"]),
        ({}, "scenario.step.events.1.time", "0.3 s", "0.3000001 s"),
        # a load's angle tells the motor's behind a whole ratio
        ({"mechanics.load_side": {**SIDE, "ratio": 3}, "drive.position_sensor.kind": "ideal"},
            "drive.position_sensor.side", "load", "rotor"),
        # sensors and what watches them
        ({}, "drive.position_sensor", {**WORD, "error": [{"order": 10, "amplitude": "0.0999 rad"}]},
            {**WORD, "error": [{"order": 10, "amplitude": "-0.1 rad"}]}),
        ({}, "drive.position_sensor", {"kind": "hall", "placement": ["-29.99 deg"] * 6},
            {"kind": "hall", "placement": ["0 deg"] * 5 + ["-30 deg"]}),
        ({"drive.position_sensor": {**WORD, "speed_method": "observer"}},
            "drive.position_sensor.observer_bandwidth", "4774 Hz", "4775 Hz"),
        ({}, "drive.speed_filter", "4774 Hz", "4775 Hz"),
        *(({"drive.position_sensor": WORD,
            "drive.encoder_table": {"orders": [1], "omega_min": "1 rpm", "limit": "1 mrad"}},
            "drive.encoder_table.orders", most, beyond)
          for most, beyond in (
              ([1000], [1001]), ([1, 2, 3, 4], [1, 2, 3, 4, 5]), ([1, 3], [3, 3]), ([1], [0]),
          )),
        ({}, "drive.monitor.hold", "33333.3 s", "33333.4 s"),
        ({}, "drive.quality.longest", "1 ms", "0.99 ms"),
        ({}, "drive.quality.longest", "500000 s", "500001 s"),
        ({}, "drive.quality.outlier", 1, 0.99),
        # temperatures
        ({"motor.temperature": {"winding": "20 degC", "resistance_coefficient": "0.003 1/K"}},
            "motor.temperature.magnet", "-273.15 degC", "-273.16 degC"),
        ({"motor.temperature": {"winding": "120 degC"}},
            "motor.temperature.flux_coefficient", "-0.00999 1/K", "-0.01 1/K"),
        ({"motor.temperature": {"winding": "20 degC"}}, "motor.temperature.heating",
            {**HEATING, "winding_capacity": "0.26667 mJ/K"}, {**HEATING, "winding_capacity": "0.26666 mJ/K"}),
        # orders
        ({}, "controller.afc", {**PI, "law": "pi-afc", "gain": 1, "orders": [*range(1, 16), 65535]},
            {**PI, "law": "pi-afc", "gain": 1, "orders": [*range(1, 16), 65536]}),
        # a lead is a quarter of a period at most
        ({}, "controller.ilc",
            {**PI, "law": "pi-ilc", "gain": 0.01, "period": "electrical", "lead": "62.5 ms"},
            {**PI, "law": "pi-ilc", "gain": 0.01, "period": "electrical", "lead": "62.51 ms"}),
        # signals that a run has
        *(({**has, "metric": []}, "metric", [{**METRIC, "signal": signal}], [{**METRIC, "signal": "i_x"}])
          for has, signal in (
              ({}, "i_c"), ({}, "u_d"), ({}, "status"), ({"trace.energy": True}, "energy_residual"),
              ({"motor.temperature": {"winding": "90 degC"}}, "temperature_magnet"),
              ({"mechanics.load_side": SIDE}, "omega_load"), (IDEAL, "omega_m"),
              ({"controller.afc": {**PI, "law": "pi-afc", "gain": 1, "orders": [6]}}, "term_afc"),
          )),
        # a fault covers one measurement at least, before the end
        ({"drive.rates.current_loop": "10 kHz", "scenario.low.faults": [STUCK]},
            "scenario.low.faults.0.duration", "99.99999995 us", "99.99999985 us"),
        ({"drive.rates.current_loop": "10 kHz", "scenario.low.faults": [STUCK]},
            "scenario.low.faults.0.time", "0.39994 s", "0.39996 s"),
        ({**IDEAL, "metric": []}, "scenario.low.faults", [STUCK],
            [{**STUCK, "kind": "current-zero", "phase": "a"}]),
        ({**IDEAL, "metric": []}, "scenario.low.faults", [STUCK],
            [{**STUCK, "kind": "bus-voltage", "voltage": "9 V"}]),
        ({"drive.current_sensors.sensors": 2}, "scenario.low.faults",
            [{**STUCK, "kind": "current-zero", "phase": "b"}],
            [{**STUCK, "kind": "current-zero", "phase": "c"}]),
        ({}, "scenario.low.faults",
            [{**STUCK, "kind": "current-missing", "phase": "c"}], [{**STUCK, "time": "1 s"}]),
        ({"drive.position_sensor": WORD, "drive.encoder_table": {"orders": [5, 10], "omega_min": "60 rpm"}},
            "drive.encoder_table.limit", "0.1 rad", "0.1001 rad"),
        ({}, "controller.fair.tuning.phase_margin", "0.301 rad", "0.3 rad"),
        ({}, "controller.fair.tuning.phase_margin", "1.449 rad", "1.45 rad"),
        ({"mechanics.coulomb_friction": "2 mN*m"}, "mechanics.breakaway_friction", "2 mN*m", "1.999 mN*m"),
        ({"scenario.low.torque_mode.current": "0 A"}, "scenario.low.torque_mode.time", "0.3999 s", "0.4 s"),
    ],
)  # fmt: skip
def test_what_the_simulation_can_just_do(
    tmp_path: Path, common: dict[str, object], key: str, most: object, beyond: object
) -> None:
    studies.study(tmp_path, {**common, key: most})
    assert key in line_of(tmp_path, {**common, key: beyond})


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"seed": 2**64}, "seed: 18446744073709551616: expected a number below 18446744073709551616"),
        ({"controller.pi": 3}, "controller.pi: 3: expected a table"),
        ({"mechanics.inertia": "9" * 5000},
            f'mechanics.inertia: "{"9" * 56}...: expected a unit, too, such as "1 kg*m^2"'),
        ({"motor.psi_f": "1e-300 Wb", "motor.kv": "1e-300 rpm/V"},
            f"{STEPS} inf or more, since the oscillation of speed and current (K_t, "
            "inertia, L) changes within 0 us"),
        ({"mechanics.inertia": "1e-300 kg*m^2"},
            f"{STEPS} 2.56e+146 or more, since the oscillation of speed and current "
            "(K_t, inertia, L) changes within 5.2e-145 us"),
        ({"motor": "x", "motor.K_t": 1}, "motor.K_t: 1: expected a table at motor"),
        ({"motor.datasheet": "x" * 5000}, f'motor.datasheet: "{"x" * 56}...: no such datasheet: '),
        ({"metric": [{"name": "m", "kind": "rms", "unit": "rpm"}]},
            'metric.0.signal: missing: expected this key, since kind is "rms"'),
        ({"metric": [{"name": "m", "kind": "settling", "signal": "x", "band": "1 rpm", "event": "0.1 s"}]},
            'metric.0.signal: "x": expected a signal: '),
        ({"metric": [{**METRIC, "signal": "status", "unit": "A"}]},
            'metric.0.unit: "A": expected a unit of a plain number, none'),
        ({"scenario.low.reference": {"file": "a\0b"}},
            'scenario.low.reference.file: "a\\u0000b": expected a readable file at '),
        ({'scenario.""': {"duration": "1 s", "reference": "1 rpm"}},
            'scenario."": expected a name of letters, digits, _, - and .'),
        ({"scenario.low.override": {"motor.cogging.7.torque": "1 N*m"}},
            'scenario.low.override: motor.cogging.7.torque: "1 N*m": expected an index of motor.cogging, 0'),
        ({"controller.n": {"law": "library", "library": "x.so", "params": ["a"]}},
            'controller.n.params.0: "a": expected a number'),
        ({"scenario.low.controllers": []}, 'scenario.low.controllers: []: expected one of "pi"'),
        ({"metric.0.scenarios": []}, 'metric.0.scenarios: []: expected one of "low", "step"'),
        ({"drive.current_sensors.bits": 12, "drive.current_loop.current_limit": "12 A"},
            "drive.current_sensors.range: 10 A: expected 12 A (drive.current_loop.current_limit) or more"),
        ({"drive.current_sensors": {"bits": 12, "range": "2 A"}, "drive.current_loop.current_limit": "3 A"},
            'drive.current_sensors.range: "2 A": expected 3 A (drive.current_loop.current_limit) or more'),
        ({"controller.t": {**TABLE, "calibration": {"speed": "1e-9 rpm", "position_gain": 1}}},
            'controller.t.calibration.speed: "1e-9 rpm": expected a run of at most 20000 s, not 1.35e+11 s'),
        ({"controller.l": {**ILC, "cells": 100, "lead": "26 ms"}, "drive.rates.speed_loop": "1 kHz"},
            'controller.l.lead: "26 ms": expected at most 0.025 s, the time of '
            "cells/4 samples of the speed loop"),
        ({"mechanics.load_side": {**SIDE, "ratio": 1.5},
          "drive.position_sensor": {"kind": "ideal", "side": "load"}, "drive.rates.integration_steps": 20},
            'drive.position_sensor.side: "load": expected "motor", since the ratio 1.5 is not a whole '
            'number, '
            "so the load's angle does not determine the motor's"),
        ({"drive.rates.position_loop": "1 kHz"},
            'drive.rates.position_loop: "1 kHz": expected no such key, since speed_loop is given'),
        ({"controller.h": {"law": "harmonic", "base": 24, "kp": "0.02 A*s/rad", "ki": "1 A/rad",
          "position": True}},
            "controller.h.k_theta: missing: expected a gain, since kp and ki are given and position is true"),
        ({"controller.h": {"law": "harmonic", "base": 24, "k_theta": "5 1/s", "kp": "0.02 A*s/rad",
          "ki": "1 A/rad"}},
            'controller.h.k_theta: "5 1/s": expected no such key, since position = false: delete k_theta, or '
            'set position = true and give kp and ki'),
        ({"vary": {**SPREAD, "together": [{"keys": ["motor.R_s"], "correlation": 0.5}]}},
            'vary.together.0.keys: ["motor.R_s"]: expected two or more different keys'),
        ({"vary": {**SPREAD, "together": [{"keys": ["motor.R_s"] * 2, "correlation": 0.5}]}},
            'vary.together.0.keys: ["motor.R_s", "motor.R_s"]: expected two or more different keys'),
        ({"vary": {**SPREAD, "together": [{"keys": [*SPREAD], "correlation": -0.51}]}},
            "vary.together.0.correlation: -0.51: expected -0.5 or more: 3 values can't all have a "
        "lower correlation with each other"),
        ({"vary": {**SPREAD, "together": [{"keys": [*SPREAD][:2], "correlation": -1.0},
                                          {"keys": [*SPREAD][1:], "correlation": 0.5}]}},
            'vary.together.1.keys.0: "motor.L_d": expected a key that is in no other group of vary.together'),
        ({"vary": {**SPREAD, "together": [{"keys": ["motor.R_s", "motor.psi_f"], "correlation": 0.5}]}},
            'vary.together.0.keys.1: "motor.psi_f": expected one of motor.R_s, motor.L_d, motor.L_q'),
    ],
)  # fmt: skip
def test_what_once_was_a_traceback_a_hang_or_unclear(
    tmp_path: Path, changes: dict[str, object], line: str
) -> None:
    assert line_of(tmp_path, changes).removeprefix("study.toml: ").startswith(line)


class Numbers(Table):
    x: float = 0.0


@pytest.mark.parametrize(
    ("x", "precision", "terms", "told"),
    [
        (0.0, "single", 1, None),
        (-3.3e38, "single", 1, None),
        (-3.5e38, "single", 1, "expected 0, or from 1.2e-38 to 3.4e+38 in single precision"),
        (1e38, "single", 4, "expected 0, or from 1.2e-38 to 8.5e+37 in single precision"),
        (-1.1e-38, "single", 1, "expected 0, or from 1.2e-38 to 3.4e+38 in single precision"),
        (1.3e-38, "single", 1, None),
        (1e39, "double", 1, None),
        (1e-308, "double", 1, "expected 0, or from 2.3e-308 to 1.7e+308 in double precision"),
    ],
)
def test_a_number_that_the_controller_cannot_hold(
    x: float, precision: str, terms: int, told: str | None
) -> None:
    if told is None:
        check_precision(Numbers(x=x), precision, terms=terms)
    else:
        with pytest.raises(ValueError, match=f"^{re.escape(told)}$") as error:
            check_precision(Numbers(x=x), precision, "controller", "c", terms=terms)
        assert error.value.context["key"] == ("controller", "c", "x")


def test_values_are_as_little_alike_as_they_can_be(tmp_path: Path) -> None:
    together = [{"keys": [*SPREAD], "correlation": -0.5}]
    found = studies.study(tmp_path, {"vary": {**SPREAD, "together": together}}).vary
    assert found is not None and found.together[0].correlation == -0.5


def test_a_scenario_whose_name_is_a_number_can_be_changed(tmp_path: Path) -> None:
    text = studies.BASE.replace("[scenario.low]", "[scenario.60]").replace('["low"]', '["60"]')
    changed = studies.study(tmp_path, {"scenario.60.duration": "0.5 s"}, text)
    assert changed.scenario["60"].duration == 0.5


MAGNET, RESISTANCE = 'psi_f = "68 mWb"', 'R_s = "15.42 ohm"'
INDUCTANCE = 'L_d = "30 mH"\nL_q = "30 mH"'


TABLE = '{ file = "emf.csv", frame = "electrical", between = "phase", speed = "10 rad/s" }'
SATURATION = '{ q = { current = ["0 A", "1 A", "2 A"], inductance = ["30 mH", "30 mH", "20 mH"] } }'
PHASE_OR_LINES = (
    "; the values differ by 2, the factor between phase and line to line, or poles and pole pairs"
)


@pytest.mark.parametrize(
    ("before", "after", "line"),
    [
        (MAGNET, "", 'motor: expected a constant of the magnet, such as psi_f = "68 mWb", K_t = "0.4 N*m/A" '
                     'or kv = "300 rpm/V"'),
        (RESISTANCE, "",
            'motor.R_s: missing: expected a resistance, such as "1 ohm", or resistance_line_to_line'),
        ('L_q = "30 mH"', "",
            'motor.L_q: missing: expected an inductance, such as "1 mH", or inductance_line_to_line'),
        (MAGNET, 'kv_phase_rms = "60 rpm/V"\nwinding = "delta"',
            'motor.kv_phase_rms: "60 rpm/V": expected a key with line_to_line in its name, '
            "since a delta has no star point"),
        (MAGNET, f'winding = "delta"\nback_emf_table = {TABLE}',
            'motor.back_emf_table.between: "phase": expected "line-to-line", '
            "since a delta has no star point"),
        (MAGNET, f'{MAGNET}\nwinding = "delta"\nsaturation = {SATURATION}',
            'motor.saturation: expected no such key, since winding = "delta": delete saturation, or set '
            'winding = "star"'),
        (MAGNET, 'K_e_phase_rms = "1 V"',
            'motor.K_e_phase_rms: "1 V": expected a voltage per speed, such as "1 V/rpm"'),
        (RESISTANCE, f'{RESISTANCE}\nresistance_line_to_line = "15.42 ohm"',
            'motor.resistance_line_to_line: "15.42 ohm": expected R_s and resistance_line_to_line to agree '
            f"within 5%{PHASE_OR_LINES}"),
        (INDUCTANCE, f'{INDUCTANCE}\ninductance_line_to_line = "30 mH"',
            'motor.inductance_line_to_line: "30 mH": expected L_d and inductance_line_to_line to agree '
            f"within 5%{PHASE_OR_LINES}"),
    ],
)  # fmt: skip
def test_words_of_a_datasheet(tmp_path: Path, before: str, after: str, line: str) -> None:
    rows = [f"{45 * k},{v}" for k, v in enumerate((0, 7, 10, 7, 0, -7, -10, -7))]
    (tmp_path / "emf.csv").write_text("\n".join(["angle [deg],voltage [V]", *rows]), encoding="utf-8")
    assert line_of(tmp_path, None, studies.BASE.replace(before, after)) == f"study.toml: {line}"


@pytest.mark.parametrize(
    ("kv", "why"),
    [
        ("14.33 rpm/V", "; the values differ by sqrt(2), the factor between rms and peak"),
        ("35.11 rpm/V", "; the values differ by sqrt(3), the factor between phase and line to line"),
        ("27 rpm/V", "; they differ by a factor of 1.33"),
    ],
)
def test_a_torque_and_a_speed_constant_that_disagree(tmp_path: Path, kv: str, why: str) -> None:
    text = studies.BASE.replace(MAGNET, f'K_t = "0.408 N*m/A"\nkv = "{kv}"')
    expected = f"expected K_t and kv to agree within 5%{why}"
    assert line_of(tmp_path, None, text) == f'study.toml: motor.kv: "{kv}": {expected}'


def test_energies_are_recorded_on_request(tmp_path: Path) -> None:
    metric = {"name": "lost", "kind": "maximum", "signal": "energy_residual"}
    expected = 'metric.0.signal: "energy_residual": expected another signal, or trace.energy = true'
    assert line_of(tmp_path, {"metric": [metric]}) == f"study.toml: {expected}"
    assert studies.study(tmp_path, {"metric": [metric], "trace": {"energy": True}}).trace.energy


def test_rows_between_the_samples_are_whole_numbers_in_periods_of_a_switched_drive(tmp_path: Path) -> None:
    switched = {"drive.inverter.kind": "switched", "trace.rate": "40 kHz"}
    expected = "expected a rate that divides drive.rates.current_loop, 15000 Hz, or a multiple of it"
    assert line_of(tmp_path, switched) == f'study.toml: trace.rate: "40 kHz": {expected}'
    back = {**switched, "trace.rate": "45 kHz", "scenario.step.override": {"drive.inverter.kind": "averaged"}}
    assert 'a higher rate needs drive.inverter.kind = "switched"' in line_of(tmp_path, back)


def test_voltages_need_rows_between_the_samples(tmp_path: Path) -> None:
    change = {"metric": [{"name": "m", "kind": "rms", "signal": "u_a"}], "drive.inverter.kind": "switched"}
    expected = "expected another signal, or a trace.rate above drive.rates.current_loop"
    assert line_of(tmp_path, change) == f'study.toml: metric.0.signal: "u_a": {expected}'
    assert studies.study(tmp_path, {**change, "trace.rate": "30 kHz"}).rows_per_period == 2


def test_the_ripple_of_switching_needs_pulses_and_rows_that_show_them(tmp_path: Path) -> None:
    change = {"metric": [{"name": "m", "kind": "switching-ripple", "signal": "tau_e", "scenarios": ["low"]}]}
    kind = 'study.toml: metric.0.kind: "switching-ripple": expected another kind, '
    assert line_of(tmp_path, change) == f"{kind}since the inverter is averaged"
    switched = {**change, "drive.inverter.kind": "switched"}
    least = "or a trace.rate of 240000 Hz or more, so that a PWM period has 16 rows"
    for rate in ("15 kHz", "225 kHz"):
        assert line_of(tmp_path, {**switched, "trace.rate": rate}) == f"{kind}{least}"
    fine = {**switched, "trace.rate": "240 kHz"}
    assert studies.study(tmp_path, fine).conditions("low").pwm_period == 1 / 15_000
    short = {**fine, "metric.0.last": "0.6 ms"}
    expected = 'metric.0.last: "0.6 ms": expected a window of 10 or more periods of the PWM'
    assert line_of(tmp_path, short) == f"study.toml: {expected}"
    halves = {**fine, "drive.inverter.pwm": "two-updates", "trace.rate": "120 kHz"}
    assert studies.study(tmp_path, halves).conditions("low").pwm_period == 2 / 15_000


def test_an_ideal_current_loop_has_no_ripple_of_switching(tmp_path: Path) -> None:
    ideal = {"kind": "ideal", "current_limit": "3 A"}
    metric = {"name": "m", "kind": "switching-ripple", "signal": "i_q"}
    changes = {"drive.current_loop": ideal, "drive.inverter": None, "metric": [metric]}
    changes["scenario.step.override"] = {}
    kind = 'study.toml: metric.0.kind: "switching-ripple": expected another kind'
    assert line_of(tmp_path, changes) == f"{kind}, since the current loop is ideal"


def test_metrics_of_one_name_mean_the_same(tmp_path: Path) -> None:
    ripple = {"name": "m", "kind": "rms", "signal": "i_q", "scenarios": ["low"]}
    other = {"name": "m", "kind": "mean", "signal": "i_q", "scenarios": ["step"]}
    expected = "expected the same kind, signal, order and frame as in the other metric of this name"
    assert line_of(tmp_path, {"metric": [ripple, other]}) == f'study.toml: metric.1.name: "m": {expected}'


def test_chattering_needs_the_speed_loops_samples(tmp_path: Path) -> None:
    change = {"metric": [{"name": "m", "kind": "chattering"}], "trace.rate": "0.5 kHz"}
    expected = 'metric.0.kind: "chattering": expected another kind, or a trace.rate of 1000 Hz or more'
    assert line_of(tmp_path, change) == f"study.toml: {expected}"


def test_an_unknown_signal_lists_what_there_is_unless_it_is_like_one(tmp_path: Path) -> None:
    line = line_of(tmp_path, {"metric.0.signal": "ripple"})
    assert line.startswith('study.toml: metric.0.signal: "ripple": expected a signal: theta_m, omega_m, ')
    line = line_of(tmp_path, {"metric.0.signal": "omega"})
    assert line == 'study.toml: metric.0.signal: "omega": expected a signal, perhaps "omega_m"'


def lines_of(folder: Path, changes: dict[str, Any] | None, text: str = studies.BASE) -> list[str]:
    """Each line without the file, which all of them name."""
    with pytest.raises(StudyError) as error:
        load(studies.write(folder, text), changes)
    start = f"{folder}/study.toml: "
    lines = str(error.value).splitlines()
    assert all(line.startswith((start, "and ")) for line in lines)
    return [line.removeprefix(start) for line in lines]


def test_several_mistakes_are_all_told_in_the_order_of_the_file(tmp_path: Path) -> None:
    """Values, unknown and missing keys of one table and of others; keys meant are not missing too."""
    text = studies.BASE.replace("pole_pairs = 4\n", 'pole_pairs = 4.5\nteeths = 1\nr_s = "1 H"\n')
    text = text.replace('R_s = "15.42 ohm"\n', "").replace("{order = 24, ", "{")
    text = text.replace('"2.5e-4 kg*m^2"', '"1 s"').replace('kp = "0.015 A/rpm"', "kp = false")
    text = text.replace("order = [1, 2, 6]", 'order = ["x"]').replace('event = "0.1 s"', "event = 1")
    assert lines_of(tmp_path, None, text) == [
        "motor.pole_pairs: 4.5: expected a whole number",
        "motor.teeths: 1: expected one of " + ", ".join(Motor.model_fields),
        'motor.r_s: "1 H": expected a known key, perhaps "R_s"',
        "motor.cogging.0.order: missing: expected a whole number",
        'mechanics.inertia: "1 s": expected an inertia, such as "1 kg*m^2"',
        'controller.pi.kp: false: expected a gain of the speed loop of zero or more, such as "1 A/rpm"',
        'metric.1.order.0: "x": expected a number',
        'metric.2.event: 1: expected a text with a unit, such as "1 s"',
    ]


@pytest.mark.parametrize(
    ("missing", "told"),
    [
        ("drive.rates", '{ current_loop = "10 kHz", speed_loop = "1 kHz" }'),
        ("drive.current_loop", '{ bandwidth = "1 kHz", current_limit = "4 A" }'),
        ("scenario.low.reference", '"60 rpm"'),
    ],
)
def test_a_missing_table_is_told_with_one_to_write(tmp_path: Path, missing: str, told: str) -> None:
    """A study that has it is read."""
    tables = tomllib.loads(studies.BASE)
    *above, last = missing.split(".")
    del look_up(tables, tuple(above))[last]
    text = f"title = {toml(tables.pop('title'))}\n"
    text += "".join(f"{key} = {toml(value)}\n" for key, value in tables.items())
    assert line_of(tmp_path, None, text) == f"study.toml: {missing}: missing: expected one, such as {told}"
    studies.study(tmp_path, dict([parse_change(f"{missing}={told}")]), text)


def test_what_is_missing_is_told_by_its_type(tmp_path: Path) -> None:
    text = "title = 'x'\nvary = { together = [{}] }\ntune = {}\nmetric = [{}]\n"
    text += "drive = { position_sensor = { kind = 'encoder' } }\n"
    found = lines_of(tmp_path, None, text)
    kinds = found.pop(5)
    assert kinds.startswith('metric.0.kind: missing: expected one of "peak-to-peak", "rms", ')
    assert found == [
        "vary.together.0.keys: missing: expected an array",
        "vary.together.0.correlation: missing: expected a number",
        "tune.keys: missing: expected a table",
        "tune.minimise: missing: expected a text",
        "metric.0.name: missing: expected a text",
        "drive.position_sensor.lines: missing: expected a whole number",
        'drive.rates: missing: expected one, such as { current_loop = "10 kHz", speed_loop = "1 kHz" }',
        'drive.current_loop: missing: expected one, such as { bandwidth = "1 kHz", current_limit = "4 A" }',
        "scenario: missing: expected a table [scenario.NAME]",
        "controller: missing: expected a table [controller.NAME]",
        "motor: missing: expected a table with pole_pairs, ...",
        "mechanics: missing: expected a table with inertia, ...",
    ]


def test_a_file_that_is_all_wrong_tells_twenty_mistakes(tmp_path: Path) -> None:
    many = {f"controller.c{n}": {"law": "pi", "kp": "x", "ki": "y"} for n in range(12)}
    lines = lines_of(tmp_path, many)
    assert (len(lines), lines[-1]) == (21, "and 4 more mistakes")


def test_mistakes_in_the_overrides_of_several_scenarios(tmp_path: Path) -> None:
    wrong = {name: {"mechanics.inertia": "1 s", "motor.R_s": "1 H"} for name in ("low", "step")}
    lines = lines_of(tmp_path, {f"scenario.{name}.override": value for name, value in wrong.items()})
    assert [line.split(": ")[:2] for line in lines] == [
        [f"scenario.{name}.override", key] for name in wrong for key in ("motor.R_s", "mechanics.inertia")
    ]


def test_what_either_of_two_types_takes(tmp_path: Path) -> None:
    one = {"parameters": [{**PARAMETER, "initial": True}], "targets": [TARGET]}
    line = "calibration.parameters.0.initial: true: expected a text or a number"
    assert lines_of(tmp_path, {"calibration": one}) == [line]


@pytest.mark.parametrize("part", ["a", "'a'"])
def test_a_key_of_very_many_parts(tmp_path: Path, part: str) -> None:
    """tomllib takes minutes for it, and all memory."""
    key = ".".join([part] * 50_000)
    told = "study.toml: not readable as TOML: expected keys of at most 32 parts (at line 2)"
    for line in (f"{key} = 1", f"[{key}]"):
        assert line_of(tmp_path, None, f'title = "x"\n{line}\n') == told
    assert line_of(tmp_path, {key: 1}) == f'"{key[:56]}...: expected a key of at most 32 parts'
    assert line_of(tmp_path, {"." * 50_000: 1}).endswith(": expected a dotted key, such as controller.pi.kp")


@pytest.mark.parametrize("depth", [33, 1000, 100_000])
def test_arrays_in_arrays(tmp_path: Path, depth: int) -> None:
    value = "[" * depth + "]" * depth
    line = line_of(tmp_path, None, f"title = {value}\n")
    assert line == "study.toml: not readable as TOML: expected at most 32 levels of tables and arrays"
    line = line_of(tmp_path, dict([parse_change(f"seed={value}")]))
    assert line == f'study.toml: seed: "{value[:56]}...: expected a whole number'


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(studies.BASE, encoding="utf-8-sig")
    assert load(path).title == "A small drive"
    for encoding, found in (("utf-16", "UTF-16"), ("utf-16-be", None), ("latin-1", "not UTF-8")):
        path.write_text("# é\n" + studies.BASE, encoding=encoding)
        line = refusal(load, path)
        if found:
            assert line == f"study.toml: {found}: expected a TOML file in UTF-8"


def test_a_slower_trace_holds_fewer_orders(tmp_path: Path) -> None:
    fast = {"scenario.low.reference": "6000 rpm", "trace.rate": "5 kHz", "drive.rates.integration_steps": 3}
    assert "expected orders below 6.25" in line_of(tmp_path, {**fast, "metric.1.order": [7]})
    assert studies.study(tmp_path, {**fast, "metric.1.order": [6]}).metric[1].order == (6.0,)


def test_toml_that_cannot_be_read_names_the_line(tmp_path: Path) -> None:
    line = line_of(tmp_path, None, 'title = "x"\n[motor\n')
    assert line.startswith("study.toml: not readable as TOML: ")
    assert "line 2" in line


def test_a_mistake_in_the_datasheet_names_the_datasheet(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text('pole_pairs = 4\nR_s = "1 A"\n', encoding="utf-8")
    text = studies.BASE.replace('R_s = "15.42 ohm"\n', 'datasheet = "m.toml"\n')
    assert line_of(tmp_path, None, text) == 'm.toml: R_s: "1 A": expected a resistance, such as "1 ohm"'


def test_a_change_of_a_datasheet_s_value_names_the_study(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text('R_s = "15.42 ohm"\n', encoding="utf-8")
    text = studies.BASE.replace('R_s = "15.42 ohm"\n', 'datasheet = "m.toml"\n')
    study = studies.study(tmp_path, {}, text)
    for read in (partial(studies.study, tmp_path, text=text), partial(changed, study)):
        for new, line in (({"motor.R_s": "x"}, 'R_s: "x"'), ({"motor": {}}, "pole_pairs: missing")):
            with pytest.raises(StudyError, match=rf"^\S*study\.toml: motor\.{line}: expected"):
                read(new)


def test_what_datasheet_and_study_lack_together_is_told_of_the_study(tmp_path: Path) -> None:
    text = studies.BASE.replace(MAGNET, 'datasheet = "m.toml"')
    (tmp_path / "m.toml").write_text('winding = "star"\n', encoding="utf-8")
    assert line_of(tmp_path, None, text) == (
        'study.toml: motor: expected a constant of the magnet, such as psi_f = "68 mWb", K_t = "0.4 N*m/A" '
        'or kv = "300 rpm/V"'
    )
    (tmp_path / "m.toml").write_text('psi_f = "1 A"\n', encoding="utf-8")
    there = {"scenario.low.override": {"motor.psi_f": "2 A"}}  # an override is a key of the study
    (tmp_path / "n.toml").write_text('psi_f = "68 mWb"\n', encoding="utf-8")
    assert line_of(tmp_path, None, text).startswith('m.toml: psi_f: "1 A": expected a flux linkage')
    found = line_of(tmp_path, there, text.replace("m.toml", "n.toml"))
    assert found.startswith('study.toml: scenario.low.override: motor.psi_f: "2 A": expected a flux linkage')


@pytest.mark.parametrize(("length", "named"), [(1000, 1000 * "x"), (1001, f'"{56 * "x"}...')])
def test_a_long_path_is_named_in_short(length: int, named: str) -> None:
    told = refusal(load, length * "x")
    assert told.startswith(f"{named}: no such study: expected a file, or one of the shipped studies: ")


def test_a_value_is_shown_in_sixty_characters() -> None:
    assert toml_text(58 * "x") == f'"{58 * "x"}"' and toml_text(59 * "x") == f'"{56 * "x"}...'
    assert (
        toml_text({"a.b": [1, 0.5, True, float("inf")], "c": {}}) == '{ "a.b" = [1, 0.5, true, inf], c = {} }'
    )
    assert toml_text("\x7f\u2028°") == '"\\u007f\\u2028°"' and toml_text("°") == '"°"'


def test_a_file_that_cannot_be_read_or_is_no_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "arena.toml"
    path.write_text("[plant.a]\n[law.b]\n")
    assert (
        refusal(load, path)
        == "arena.toml: is an arena: expected a study, since only cogless run takes an arena"
    )

    def refused(*_: Any, **__: Any) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_text", refused)
    assert refusal(load, path) == "arena.toml: permission denied: expected a readable TOML file"


def test_no_such_study(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r"x\.toml: no such study: expected a file, or one of the shipped studies: "
    ):
        load(tmp_path / "x.toml")


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("motor.cogging.5.torque", 1,
            "study.toml: motor.cogging.5.torque: 1: expected an index of motor.cogging, 0"),
        ("motor.cogging.x", 1, "study.toml: motor.cogging.x: 1: expected an index of motor.cogging, 0"),
        ("metric.3", 1, "study.toml: metric.3: 1: expected an index of metric, 0 to 2"),
        ("title.x", 1, "study.toml: title.x: 1: expected a table at title, not a text"),
        ("seed.x.y", 1, "study.toml: seed.x.y: 1: expected a key of the study"),
        ("scenario.low.reference.speed", 1,
            "study.toml: scenario.low.reference.speed: 1: expected a table at scenario.low.reference, not a "
            "text"),
        ("", 1, '"": expected a dotted key, such as controller.pi.kp'),
    ],
)  # fmt: skip
def test_a_change_that_has_no_place(tmp_path: Path, key: str, value: object, line: str) -> None:
    assert line_of(tmp_path, {key: value}, f"seed = 1\n{studies.BASE}") == line


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("monitor.omega_max", "1e39 rad/s", "0, or from 1.2e-38 to 3.4e+38 in single precision"),
        ("monitor.current_max", "1e-39 A", "0, or from 1.2e-38 to 3.4e+38 in single precision"),
        ("quality.span", "1e-50 rad", "0, or from 1.2e-38 to 3.4e+38 in single precision"),
        ("quality.span", "1e300 rad", "0, or from 1.2e-38 to 3.4e+38 in single precision"),
        ("quality.floor", "1e40 rpm", "0, or from 1.2e-38 to 3.4e+38 in single precision"),
        ("quality.outlier", 1e40, "0, or from 1.2e-38 to 3.4e+38 in single precision"),
    ],
)
def test_what_watches_holds_in_the_controllers_precision(
    tmp_path: Path, key: str, value: Any, line: str
) -> None:
    text = f'"{value}"' if isinstance(value, str) else value
    assert line_of(tmp_path, {f"drive.{key}": value}) == f"study.toml: drive.{key}: {text}: expected {line}"
    studies.study(tmp_path, {f"drive.{key}": value, "drive.precision": "double"})


@pytest.mark.parametrize("character", ["\n", "\x01", "\x7f", "\x85", "\ufffe"])
def test_names_and_titles_have_no_control_characters(tmp_path: Path, character: str) -> None:
    """In a message, in a file's name, in an FMU's XML."""
    name, code = f"a{character}b", f"a\\u{ord(character):04x}b".replace("\\u000a", "\\n")
    one = "expected one line, without control characters"
    for key in ("title", "controller.pi.label"):
        line = line_of(tmp_path, {key: name})
        assert line == f'study.toml: {key}: "{code}": {one}'
    for table, entry in (("controller", PI), ("scenario", {"duration": "1 s", "reference": "1 rpm"})):
        line = line_of(tmp_path, {f'{table}."{name}"': entry})
        assert line == f'study.toml: {table}."{code}": expected a name of letters, digits, _, - and .'
    assert studies.study(tmp_path, {"title": "Größe, 5\u00a0µm"}).title


EMPTY = {
    "scenario.low.override": {"drive": {"nonsense": {}}},
    "vary": {"drive": {"nonsense": {}}, "motor": {"R_s": {"uniform": "20 %"}}},
    "tune": {"keys": {"controller": {"nonsense": {}}}, "minimise": "speed_ripple"},
    "drive.nonsense": {},
}


@pytest.mark.parametrize("key", EMPTY)
def test_an_empty_table_of_nonsense_is_refused_by_name(tmp_path: Path, key: str) -> None:
    assert "nonsense" in line_of(tmp_path, {key: EMPTY[key]}).partition(": expected")[0]


def test_an_empty_table_of_nonsense_is_refused_in_a_change_of_conditions() -> None:
    """Of trials, from one of them on."""
    for override in ({"mechanics": {"nonsense": {}}}, {"nonsense": {}}):
        with pytest.raises(StudyError, match=r"scenario\.table-1\..*nonsense"):
            load("mandra2019", {"scenario.table-1.changes.1.override": override})


def test_an_empty_table_is_a_value_wherever_values_are_changed(tmp_path: Path) -> None:
    """It is that table with its defaults, and replaces what stood there."""
    monitor = studies.study(tmp_path, {"drive.monitor.omega_max": "500 rad/s"})
    key, value = parse_change("drive.monitor={}")
    assert changed(monitor, {key: value}).drive.monitor.omega_max is None
    assert monitor.drive.monitor.omega_max == 500
    scenario = studies.study(tmp_path, {"scenario.low.override": {"drive": {"bus": {}}}}).scenario["low"]
    assert scenario.override == {"drive.bus": {}}
