"""Every sentence that advises a change, with a study in which it is said: the change helps.

A producer of such sentences is a function that gives a `Remark` cures, or an error that is `advising`. Each
is in `CASES` with the studies in which it speaks; a new one without a case fails here.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from design.test_back_emf import STEP_MOTOR
from design.test_detent import NEMA_17

import cogless
from cogless.cli.printed import a_metric
from cogless.design.auto import load
from cogless.design.trials import learning_gain
from cogless.design.trials.from_study import design_study
from cogless.design.trials.response import FACTOR_ROUNDING
from cogless.design.warnings import beyond_drive, warnings
from cogless.errors import StudyError
from cogless.report import lines, verdicts
from cogless.report.comparison import error_metric
from cogless.run.simulate import run_study, simulate
from cogless.study import AnyStudy, TrialStudy, changed
from cogless.study.reading import Remark
from studies import IDEAL

ROOT = Path(__file__).parents[1]
ROOMS = ("design", "run", "report", "cli")
MY_MOTOR, SMALLEST = ROOT / "examples" / "my_motor.toml", ROOT / "examples" / "smallest.toml"
DRIVE = """
[scenario]
slow = { duration = "6 s", reference = "60 rpm" }
[controller.pi]
law = "pi"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
"""
# A step motor of 50 teeth: 20 mN m of order 200 on 54 g cm^2 are 137 Hz.
NEMA = f'title = "A step motor"\n{NEMA_17.replace("bits = 17", "bits = 14")}{DRIVE}'
# A worm drive that follows the stars, with few counts a second.
TELESCOPE = f"""title = "A telescope"
[motor]
pole_pairs = 4
slots = 12
R_s = "0.8 ohm"
L_d = "2 mH"
L_q = "2 mH"
K_t = "0.1 N*m/A"
[mechanics]
inertia = "1e-4 kg*m^2"
viscous_friction = "1e-3 N*m*s/rad"
[drive]
rates = {{ current_loop = "10 kHz", speed_loop = "1 kHz" }}
current_loop = {{ bandwidth = "500 Hz", current_limit = "5 A" }}
inverter = {{ bus_voltage = "24 V" }}
position_sensor = {{ kind = "encoder", lines = 2500 }}
{DRIVE}"""
# A servo with few volts for its inductance, on a drive for large currents.
NOISY_SERVO = """title = "A servo on a large drive"
[motor]
pole_pairs = 4
slots = 12
R_s = "15.4 ohm"
L_d = "30 mH"
L_q = "30 mH"
K_t = "0.41 N*m/A"
cogging = [ {order = 24, torque = "12.7 mN*m"} ]
[mechanics]
inertia = "2e-5 kg*m^2"
[drive]
rates = { current_loop = "30 kHz", speed_loop = "6 kHz" }
current_loop = { bandwidth = "1200 Hz", current_limit = "1.5 A", decoupling = false }
inverter = { bus_voltage = "44 V" }
current_sensors = { noise = "60 mA" }
position_sensor = { kind = "absolute", bits = 16, speed_method = "observer", observer_bandwidth = "300 Hz" }
[scenario]
slow = { duration = "6 s", reference = "240 rpm", initial_speed = "240 rpm" }
[controller.harmonic]
law = "harmonic"
tuning = { rule = "auto" }
"""
# A small motor on a drive whose current sensors are for large currents.
SMALL_LIMIT = """title = "A gimbal motor on a large drive"
motor = { datasheet = "gm5208", cogging = [ {order = 84, torque = "4 mN*m"} ] }
[mechanics]
inertia = "2.5e-5 kg*m^2"
coulomb_friction = "3 mN*m"
[drive]
rates = { current_loop = "30 kHz", speed_loop = "6 kHz" }
current_loop = { bandwidth = "1200 Hz", current_limit = "10 mA" }
inverter = { bus_voltage = "24 V" }
current_sensors = { noise = "58.6 mA", bits = 12, range = "120 A" }
position_sensor = { kind = "absolute", bits = 14, speed_method = "observer", observer_bandwidth = "300 Hz" }
[scenario.slow]
duration = "4 s"
reference = "20 rpm"
initial_speed = "20 rpm"
[controller.pi]
law = "pi"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
"""
SLOW_SKY = {"scenario.slow.reference": "0.1 rpm", "scenario.slow.duration": "40 s"}
TABLE = f"""title = "A table"
{IDEAL}[scenario]
slow = {{ duration = "2 s", reference = "60 rpm", initial_speed = "60 rpm" }}
[controller.pi]
law = "pi"
kp = 0.15
ki = 3.0
"""


@cache
def texts() -> Path:
    """A folder for studies that are a text."""
    from tempfile import mkdtemp

    return Path(mkdtemp())


def read(study: str | Path, changes: dict[str, Any]) -> AnyStudy:
    if isinstance(study, str) and "\n" in study:
        path = texts() / f"{abs(hash(study))}.toml"
        path.write_text(study, encoding="utf-8")
        return load(path, changes)
    return load(study, changes)


# What is measured: less is better


def error(study: AnyStudy, scenario: str, name: str) -> float:
    """RMS of the speed error in the last quarter of a run, over the largest reference."""
    trace = simulate(study, scenario, name).trace
    late = 3 * len(trace) // 4
    reference = trace["omega_ref"]
    return float(np.sqrt(np.mean((reference - trace["omega_m"])[late:] ** 2)) / np.max(np.abs(reference)))


def current_error(study: AnyStudy, scenario: str, name: str) -> float:
    """The rms deviation of i_q from its reference in the second half of a run, A."""
    trace = simulate(study, scenario, name).trace
    rows = slice(len(trace) // 2, None)
    return float(np.sqrt(np.mean((trace.part("i_q", rows) - trace.part("i_q_ref", rows)) ** 2)))


def copper(study: AnyStudy, scenario: str, name: str) -> float:
    """RMS of the phase current in the second half of a run, A."""
    trace = simulate(study, scenario, name).trace
    rows = slice(len(trace) // 2, None)
    return float(np.sqrt(np.mean(trace.part("i_d", rows) ** 2 + trace.part("i_q", rows) ** 2)))


def last_trial(study: AnyStudy, scenario: str, name: str) -> float:
    """RMS of the error in the last trial over the first one's; a law that doesn't run leaves it infinite."""
    try:
        run = simulate(study, scenario, name)
    except StudyError:
        return math.inf
    signal = "theta_error" if "theta_error" in run.trace else "y_error"
    trials = np.array_split(run.trace[signal], study.scenario[scenario].trials)
    sizes = [float(np.sqrt(np.mean(each**2))) for each in trials]
    return sizes[-1] / sizes[0] if np.isfinite(sizes[-1]) else math.inf


def trial(study: AnyStudy, scenario: str, name: str) -> float:
    """RMS of the error in the last trial."""
    error = simulate(study, scenario, name).trace["y_error"]
    return float(np.sqrt(np.mean(error[-len(error) // study.scenario[scenario].trials :] ** 2)))


def growth(study: AnyStudy, scenario: str, name: str) -> float:
    """By how much an error may grow from trial to trial, as certified; too little to see in a few trials."""
    assert isinstance(study, TrialStudy)
    certificate = design_study(study, [(scenario, name)])[scenario, name].certificate
    learning = (certificate.exact or certificate.design).learning
    assert learning is not None
    return max(0.0, learning.norm - 1 - FACTOR_ROUNDING)


def growth_with_ends(study: AnyStudy, scenario: str, name: str) -> float:
    """The factor of an error from trial to trial in tried trials, which begin and end."""
    assert isinstance(study, TrialStudy)
    found = design_study(study, [(scenario, name)])[scenario, name].certificate.design.growth
    assert found is not None
    return found


Measure = Callable[[AnyStudy, str, str], float]


@dataclass(frozen=True)
class Case:
    """A study in which a sentence is said, and how much less is left with each of its changes."""

    study: str | Path
    changes: dict[str, Any]
    says: str  # a part of the sentence
    name: str = "pi"
    scenario: str = "slow"
    left: float = 0.8  # at most, of what is measured without
    cures: int = 1
    measure: Measure = error

    def remark(self) -> tuple[AnyStudy, Remark]:
        study = read(self.study, self.changes)
        if isinstance(study, TrialStudy):
            said = [*design_study(study, [(self.scenario, self.name)])[self.scenario, self.name].notes]
        else:
            said = [*warnings(study, self.scenario, self.name), *beyond_drive(study, [self.scenario])]
        found = [each for each in said if self.says in str(each)]
        assert len(found) == 1, [*map(str, said)]
        return study, found[0]


def encoder(lines: int = 2500, **more: Any) -> dict[str, Any]:
    return {"drive.position_sensor": {"kind": "encoder", "lines": lines, **more}}


def absolute(**more: Any) -> dict[str, Any]:
    return {"drive.position_sensor": {"kind": "absolute", **more}}


def law(**keys: Any) -> dict[str, Any]:
    return {"controller.x": keys}


RULE = {"rule": "phase-margin", "phase_margin": "60 deg"}
NONE: dict[str, Any] = {"metric": []}
SETTLING = {**NONE, "scenario.slow.duration": "20 s"}
ANGLE = {"law": "space-speed", "k": "0.3 A*s/rad", "eta_bar": "100 rad/s", "cells": 1024,
         "period": {"of": "mechanical"}, "q_half_width": 0}  # fmt: skip


def ilc(**keys: Any) -> dict[str, Any]:
    """A law of trials, and a study without the changes that its scenario has."""
    return {"controller.ilc": {"law": "trial-ilc", **keys}, "scenario.move.changes": []}


def trials(changes: dict[str, Any], says: str, **more: Any) -> Case:
    given = {"study": trial_studies.DRIVE, "name": "ilc", "scenario": "move", "measure": last_trial}
    return Case(changes=changes, says=says, **{**given, **more})


ZERO = """title = "A zero outside the unit circle"
[plant]
model = "discrete"
period = "10 ms"
A = [[0.9, -0.2], [1.0, 0.0]]
B = ["b", 0]
C = [1.0, -1.4]
[plant.parameter]
b = [0.8, 1.2]
[design]
state_weight = [1, 1, 0.01]
input_weight = 10
initial_state = [1, 0, 0]
initial_change = [0.1, 0, 0]
initial_error = 1
[scenario]
move = { duration = "3 s", trials = 12, reference = [["0.2 s", 0], ["2 s", 1], ["3 s", 1]] }
[controller.ilc]
law = "trial-ilc"
"""
NEAR_ONE = {"plant.C": [1.0, -1.005], "controller.ilc": {"law": "trial-ilc", "learning": False}}
SHAFT = """title = "A drive train that Euler's model is too slow for"
[plant]
period = "2.5 ms"
A = [[0, 1, 0, 0], ["-100/J", "-0.021/J", "100/J", "0.02/J"], [0, 0, 0, 1], [2e5, 40, -2e5, -42]]
B = [0, 0, 0, 740]
C = [1, 0, 0, 0]
[plant.parameter]
J = [7e-4, 9e-4]
[design]
state_weight = [1e4, 1, 1e2, 0.1, 1]
input_weight = 1
initial_state = [0.01, 0, 0.01, 0, 0]
[scenario]
move = { duration = "1 s", trials = 3, reference = [["0.1 s", 0], ["0.8 s", 1]] }
[controller.ilc]
law = "trial-ilc"
learning = false
"""
AFC = {"law": "pi-afc", "tuning": RULE, "orders": [24, 120], "gain": "300 A/rad"}
LEARNS = {"law": "pi-ilc", "tuning": RULE, "memory": "angle", "cells": 1024}
TURNS_BACK = {"scenario.slow.reference": {"offset": "0 rpm", "amplitude": "120 rpm", "frequency": "0.2 Hz"}}
COGGING = [{"order": 84, "torque": "4 mN*m"}, {"order": 21, "torque": "2 mN*m"}]
# Five samples in a period: neither lead nor filter has room.
FAST = {**SETTLING, "drive.inverter.bus_voltage": "400 V", "drive.rates.integration_steps": 4,
        "scenario.slow.reference": "3000 rpm", "scenario.slow.initial_speed": "3000 rpm",
        "motor.cogging": [{"order": 4, "torque": "20 mN*m"}]}  # fmt: skip
HALLS = {**NONE, "motor.cogging": [{"order": 12, "torque": "0.5 mN*m"}], "scenario.slow.duration": "4 s",
         "drive.position_sensor": {"kind": "hall"}, "scenario.slow.reference": "100 rpm",
         "scenario.slow.initial_speed": "100 rpm"}  # fmt: skip
# Seven pole pairs at 3600 r/min, sampled 4000 times a second: 9.5 samples in an electrical turn.
FEW_SAMPLES = {"drive.rates": {"current_loop": "4 kHz", "speed_loop": "1 kHz", "integration_steps": 16},
               "drive.current_loop.bandwidth": "360 Hz", "drive.inverter.bus_voltage": "192 V",
               "scenario.slow.duration": "2 s",
               "controller.pi": {"law": "pi", "kp": 0.005, "ki": 0.03}}  # fmt: skip
LATE = {"scenario.slow.reference": "1200 rpm", "scenario.slow.initial_speed": "1200 rpm",
        "scenario.slow.duration": "2 s", "drive.inverter.bus_voltage": "48 V", "mechanics.load": "5 mN*m",
        "drive.rates.integration_steps": 4,
        "controller.pi": {"law": "pi", "kp": 0.005, "ki": 0.03}}  # fmt: skip
SLOW_GIMBAL = {"motor.R_s": "10 ohm", "motor.L_d": "3.5 mH", "motor.L_q": "3.5 mH",
               "motor.cogging": [{"order": 84, "torque": "6 mN*m"}], "mechanics.inertia": "4e-5 kg*m^2",
               "mechanics.coulomb_friction": "0 N*m",
               "drive.position_sensor": {"kind": "absolute", "bits": 14},
               "scenario.slow.reference": "1 rpm", "scenario.slow.initial_speed": "0 rpm"}  # fmt: skip
CASES: dict[str, list[Case]] = {
    "design.warnings._snapping": [
        Case(NEMA, {"scenario.slow.reference": "0.5 rpm"}, "stops and snaps", left=0.1),
        Case(NEMA, {"scenario.slow.reference": "30 rpm"}, "stops and snaps", left=0.5),
    ],
    "design.warnings._few_edges": [
        Case(TELESCOPE, SLOW_SKY, "coasts from count to count", left=0.3, cures=2),
        *(
            Case(MY_MOTOR, {**HALLS, "controller.pi": {"law": "pi", "kp": kp, "ki": 4 * kp}},
                 "leaves none of the", left=0.1, cures=cures)
            for kp, cures in ((0.012, 2), (0.02, 1))
        ),
        # No slower feedback is advised here: it leaves more of the cogging than it saves of the counts.
        *(Case(MY_MOTOR, SLOW_GIMBAL, "coasts", name, cures=1) for name in ("pi", "harmonic")),
        Case(TELESCOPE, {**SLOW_SKY, **encoder(speed_method="MT")}, "phase margin", left=0.3, cures=2),
        Case(TELESCOPE, {**SLOW_SKY, **absolute(bits=14, window=10)}, "coasts", left=0.3, cures=2),
        Case(TELESCOPE, {**SLOW_SKY, **absolute(positions=20000, window=10)}, "coasts", left=0.3, cures=2),
        *(
            Case(MY_MOTOR, {**NONE, **encoder(1000), "scenario.slow.reference": "5 rpm"}, "coasts", name,
                 cures=2)
            for name in ("pi", "harmonic")
        ),
        *(
            Case(TELESCOPE, {**SLOW_SKY, **law(**keys)}, "coasts", "x", left=0.5, cures=2)
            for keys in (
                {**LEARNS, "gain": "0.01 A*s/rad"},
                {**ANGLE, "k": "0.2 A*s/rad", "mu_alpha": "0.1 mA"},
                {"law": "space-position", "k_theta": "30 1/s", "k_omega": "0.2 A*s/rad", "k_i": "3 A/rad",
                 "learning": False, "frame": "mechanical"},
                {"law": "harmonic", "position": True, "tuning": {"rule": "auto"}},
            )
        ),
    ],
    "design.warnings.reads_zero": [
        Case(
            MY_MOTOR, {**NONE, **encoder(), "scenario.slow.reference": "11 rpm"}, "speed samples are 0", name
        )
        for name in ("pi", "harmonic")
    ] + [
        Case(MY_MOTOR, {**NONE, **encoder(speed_method="average", window=2),
                        "scenario.slow.reference": "11 rpm"}, 'speed_method = "MT" } would time the edges'),
    ],
    "design.unlearned.map_warning": [
        Case(SMALLEST, {**SETTLING, **law(**{**LEARNS, "cells": 100}, gain="0.2 A*s/rad")},
             "a wave of order 24 (mechanical) has only", "x"),
        Case(SMALLEST, {**SETTLING, **law(**{**LEARNS, "cells": 512}, gain="0.2 A*s/rad", q_half_width=10)},
             "a wave of order 24 (mechanical) has only", "x", cures=2),
    ],
    "design.laws.periodic.relay_warning": [
        Case("liu2018", {}, "its relay g switches", "robust-ilc",
             "900-rpm"),
    ],
    "design.turning.unstable_turning": [
        Case(MY_MOTOR, {**NONE, **FEW_SAMPLES, "scenario.slow.reference": "3600 rpm"},
             "an electrical turn has only", left=0.5, cures=3),
    ],
    "design.current_needed.noisy_voltage": [
        Case(NOISY_SERVO, {}, "drives the voltage to its limit", "harmonic", left=0.5),
    ],
    "design.back_emf.back_emf_warning": [
        Case(STEP_MOTOR, {"controller.pi.tuning.phase_margin": "45 deg"}, "back-EMF its loop is unstable",
             left=0.1),
    ],
    "design.turning.late_angle": [
        Case(MY_MOTOR, {**NONE, **LATE, "drive.position_sensor.latency": "2 ms"}, "reverses the torque",
             left=0.1),
        Case(MY_MOTOR, {**NONE, **LATE, "drive.position_sensor.latency": "1.3 ms"}, "of the torque",
             measure=copper, left=0.8),
        *(
            Case(NEMA, {"drive.position_sensor.latency": latency, "scenario.slow.reference": "120 rpm",
                        "scenario.slow.initial_speed": "120 rpm", "scenario.slow.duration": "1 s",
                        "mechanics.inertia": "400 g*cm^2", "mechanics.load": "0.2 N*m"},
                 "the torque", left=0.1)
            for latency in ("2 ms", "3 ms")
        ),
    ],
    "design.laws.anti_cogging._warning": [
        Case(TABLE, law(law="anti-cogging", kp=0.15, ki=3.0, cells=1024,
                        calibration={"speed": speed, "position_gain": gain}), "its calibration run", "x")
        for speed, gain in ((6.0, 20.0), (12.0, 20.0), (0.7, 2000.0))
    ] + [
        Case(TABLE, {"motor.cogging.0.torque": "16 mN*m",
                     **law(law="anti-cogging", kp=0.05, ki=0.3, cells=1024,
                           calibration={"speed": 0.3, "position_gain": 4.0})}, "records nothing", "x",
             left=0.5)
    ],
    "design.verdict._remedy": [
        Case("liu2018", {"scenario.60-rpm.duration": "40 s"}, "grows", "pi-ilc-printed", "60-rpm",
             left=0.1),
        Case(SMALLEST, {**SETTLING, **law(**AFC)}, "grows", "x", left=0.1),
        Case(SMALLEST, {**SETTLING, **law(**{**LEARNS, "memory": "time", "cells": 1200}, gain="2.5 A*s/rad")},
             "grows", "x"),
        Case(SMALLEST, {**SETTLING, **encoder(), **law(**LEARNS, gain="20 A*s/rad", q_half_width=1)},
             "unstable", "x"),
        Case(SMALLEST, {**SETTLING, **law(**ANGLE, mu_alpha="50 A")}, "unstable", "x", left=0.1),
        Case(SMALLEST, {**FAST, **law(**{**LEARNS, "cells": 4}, period="electrical", gain="4 A*s/rad")},
             "may grow", "x"),
        Case(SMALLEST, {**SETTLING, **TURNS_BACK, **law(**ANGLE, mu_alpha="5 A")}, "reference passes", "x"),
        Case(SMALLEST, {**SETTLING, **TURNS_BACK, **law(**{**ANGLE, "q_half_width": 2}, mu_alpha="1 A")},
             "the reference passes", "x"),
    ],
    "design.verdict.steadier": [
        Case(MY_MOTOR, {**NONE, **law(law="pi-ilc", kp="3 A*s/rad", ki="100 A/rad", gain="0.02 A*s/rad")},
             "feedback unstable", "x", left=0.1),
    ],
    "design.verdict._few_counts": [
        Case(MY_MOTOR, {**NONE, **absolute(bits=12, window=4),
                        **law(**LEARNS, gain="0.02 A*s/rad", q_half_width=1)}, "not sure: at 30 rpm", "x"),
    ],
    "design.verdict.Verdict.remark": [
        Case(SMALLEST, {**SETTLING, **law(**{**AFC, "gain": "3 A/rad"})}, "grows", "x", left=0.5),
    ],
    "design.warnings.loop_remarks": [
        Case(SMALLEST, {**SETTLING, **law(law="pi", kp="0.1 A*s/rad", ki="1 A/rad"),
                        "drive.current_loop": {"kp": gain, "ki": "30000 V/A/s", "current_limit": "10 A"}},
             "is unstable", "x", left=0.1, measure=current_error)
        for gain in ("30 V/A", "1000 V/A")
    ] + [
        Case(MY_MOTOR, {**NONE, "drive.current_loop": {"kp": "60 V/A", "ki": "3000 V/A/s",
                        "current_limit": "1.5 A"}, "controller.pi": {"law": "pi", "kp": 0.01, "ki": 0.05},
                        "motor.cogging": [], "scenario.slow.reference": "300 rpm"},
             "the current loop is unstable", left=0.2),
    ],
    "design.warnings._feedback_and_learning": [
        Case(MY_MOTOR, {**NONE, **law(law="pi", kp="3 A*s/rad", ki="100 A/rad")}, "unstable", "x", left=0.1),
        Case(MY_MOTOR, {**NONE, **law(law="harmonic", kp="3 A*s/rad", ki="100 A/rad")}, "unstable", "x",
             left=0.1),
    ],
    "design.laws.harmonic._not_learned": [
        Case(MY_MOTOR, {**NONE, "motor.cogging": COGGING}, "the cogging has order 21", "harmonic", left=0.5),
    ],
    "design.laws.harmonic._no_room": [
        Case(MY_MOTOR, {**NONE, "drive.position_sensor.eccentricity": "0.3 deg",
                        "controller.harmonic.base": 2}, "too close together to learn", "harmonic"),
    ],
    "design.current_needed.too_much_current": [
        Case(MY_MOTOR, {**NONE, "drive.current_loop.current_limit": "0.05 A"}, "current_limit", "harmonic",
             left=0.5),
        Case(MY_MOTOR, {**NONE, "drive.current_loop.current_limit": "20 mA"}, "its motion and load"),
        Case(MY_MOTOR, {**NONE, "drive.current_loop.current_limit": "20 mA",
                        "drive.current_reference.field_weakening": True}, "the limits of current "
             "and voltage allow"),
        Case(SMALL_LIMIT, NONE, "current_limit = ", left=0.5),
        Case(SMALL_LIMIT, {**NONE, "drive.current_sensors.sensors": 2, "drive.monitor.current_max": "0.2 A"},
             "current_max = ", left=0.5),
    ],
    "design.current_needed.noisy_currents": [
        Case(SMALL_LIMIT, {**NONE, "drive.current_loop.current_limit": "0.2 A",
                           "drive.monitor.current_sum": "0.1 A"}, "switch the drive off", left=0.5),
        Case(SMALL_LIMIT, {**NONE, "drive.current_loop.current_limit": "2 A",
                           "drive.current_sensors.offset": ["0.5 A", "0.5 A", "0.5 A"]},
             "switch the drive off", left=0.5),
    ],
    "design.trials.gains._warnings": [
        trials(ilc(shift=2), "can grow", measure=growth, left=0.0),
        trials({**ilc(), "controller.ilc": {"law": "norm-optimal", "change_weight": 1e-9}}, "can grow",
               measure=growth, left=0.0),
    ],
    "design.trials.gains._by_frequency": [
        trials({**ilc(shift=2, q_filter={"cutoff": "25 Hz", "acts_on": "signal"}),
                "design.state_weight": [1e3, 0.1, 0.05]}, "shift = ", measure=growth_with_ends, left=0.9),
        trials(ilc(shift=8, q_filter={"cutoff": "30 Hz", "acts_on": "signal"}), "shift = 3",
               measure=growth_with_ends, left=0.9),
    ],
    "design.trials.from_study._designs": [
        trials(ilc(shift=4), "low-pass filter"),
    ],
    "design.trials.gains._learning_gain": [
        trials({"controller.ilc.shift": 1}, "low-pass filter", study=ZERO, left=0.2),
    ],
    "design.trials.from_study._better_sampled": [
        trials({}, "within a trial the loop is stable with", study=SHAFT, cures=2, measure=trial, left=0.1),
    ],
}  # fmt: skip


@dataclass(frozen=True)
class Refusal:
    """A study that is refused, and runs with each of the changes that the message advises."""

    study: str | Path
    changes: dict[str, Any]
    says: str
    name: str = "pi"
    scenario: str = "slow"
    cures: int = 1
    most: float = 0.5  # error that is left, over the reference, or over that of the first trial
    measure: Measure = error


def loop(**keys: Any) -> dict[str, Any]:
    return {**NONE, "drive.current_loop": {"current_limit": "10 A", **keys}}


NO_MARGIN = "expected a loop that reaches this phase margin with some gains"
REFUSALS: dict[str, list[Refusal]] = {
    "design.speed_loop._too_weak": [
        Refusal(SMALLEST, loop(bandwidth="1500 Hz"), "expected 30 deg of phase margin"),
        Refusal(SMALLEST, loop(kp="30 V/A", ki="30000 V/A/s"), "expected 30 deg of phase margin"),
        Refusal(SMALLEST, loop(kp="7 V/A", ki="30000 V/A/s"), "expected 30 deg of phase margin"),
        Refusal(SMALLEST, loop(kp="1000 V/A", ki="30000 V/A/s"), "expected 30 deg of phase margin"),
    ],
    "design.speed_loop._no_margin": [
        Refusal("uomodri", {"controller.x.law": "adrc", "controller.x.tuning": {"rule": "auto",
                "phase_margin": "70 deg"}}, NO_MARGIN, "x", "fast"),
    ],
    "design.trials.from_study._study_error": [
        Refusal(ZERO, {"controller.ilc.shift": 1}, "expected a zero-phase low-pass filter", "ilc", "move",
                most=0.2, measure=last_trial),
    ],
    "design.trials.feedforward.dynamic": [
        Refusal(ZERO, {**NEAR_ONE, "scenario.move.trials": 2}, "expected false", "ilc", "move", most=1.1,
                measure=last_trial),
    ],
}  # fmt: skip


def producers() -> Iterator[str]:
    """Functions of the rooms that give a remark or an error changes which they advise."""
    package = Path(cogless.__file__).parent
    for room in ROOMS:
        for path in sorted((package / room).rglob("*.py")):
            module = ".".join(path.relative_to(package).with_suffix("").parts)
            yield from (f"{module}.{name}" for name in advising(ast.parse(path.read_text(encoding="utf-8"))))


def advising(tree: ast.Module) -> Iterator[str]:
    """The functions and methods of a module that advise, by name."""
    for outer in tree.body:
        inside = outer.body if isinstance(outer, ast.ClassDef) else [outer]
        for each in inside:
            if isinstance(each, ast.FunctionDef) and any(map(_advises, ast.walk(each))):
                yield f"{outer.name}.{each.name}" if isinstance(outer, ast.ClassDef) else each.name


def _advises(node: ast.AST) -> bool:
    if not isinstance(node, ast.Call):
        return False
    if isinstance(node.func, ast.Attribute):
        return node.func.attr == "advising"
    named = isinstance(node.func, ast.Name) and node.func.id == "Remark"
    return named and (len(node.args) > 1 or any(word.arg == "cures" for word in node.keywords))


def test_every_function_that_advises_has_a_case() -> None:
    assert sorted(producers()) == sorted({*CASES, *REFUSALS, *BY_ITSELF})


@pytest.mark.parametrize(
    ("producer", "case"), [(name, case) for name, cases in CASES.items() for case in cases]
)
def test_what_is_advised_helps(producer: str, case: Case) -> None:
    study, remark = case.remark()
    assert len(remark.cures) == case.cures, str(remark)
    before = case.measure(study, case.scenario, case.name)
    for cure, cured in zip(remark.cures, remark.cured(study), strict=True):
        after = case.measure(cured, case.scenario, case.name)
        assert after <= case.left * before, (cure, before, after)


@pytest.mark.parametrize(
    ("producer", "case"), [(name, case) for name, them in REFUSALS.items() for case in them]
)
def test_what_a_refusal_advises_is_taken(producer: str, case: Refusal) -> None:
    with pytest.raises(StudyError, match=case.says) as refused:
        simulate(read(case.study, case.changes), case.scenario, case.name)
    assert len(refused.value.cures) == case.cures, str(refused.value)
    for cure in refused.value.cures:
        study = read(case.study, {**case.changes, **cure})
        assert case.measure(study, case.scenario, case.name) <= case.most, cure


def test_a_certificate_that_is_not_found_has_the_number_to_give(monkeypatch: pytest.MonkeyPatch) -> None:
    """We know no study in which the inequalities fail and the frequency response does not."""
    with monkeypatch.context() as without:
        without.setattr(learning_gain, "_solve", lambda *_: (None, None))
        study = read(trial_studies.DRIVE, {**ilc(shift=2), "drive.position_sensor.bits": 20})
        missing = design_study(study, [("move", "ilc")])["move", "ilc"].no_K_3
    assert missing is not None and "K_3: missing: expected a number" in str(missing)
    (cure,) = missing.cures
    assert last_trial(changed(study, cure), "move", "ilc") < 0.6


def test_a_metric_that_is_advised_judges() -> None:
    """Without one nothing is compared; of a speed that varies only its error is judged."""
    for study, name in ((read(TELESCOPE, NONE), "slow"), (read(trial_studies.DRIVE, ilc() | NONE), "move")):
        (cured,) = a_metric(study).cured(study)
        assert not lines(run_study(study), name) and lines(run_study(cured), name)
    varying = {"scenario.slow.reference": {"profile": [["0 s", "60 rpm"], ["6 s", "90 rpm"]]}}
    varying |= {"metric": [{"name": "ripple", "kind": "ripple-rms", "signal": "omega_m"}]}
    varying |= {"controller.other": {"law": "pi", "kp": "0.1 A*s/rad", "ki": "1 A/rad"}}
    study = read(TELESCOPE, varying)
    (before,) = verdicts(run_study(study))
    advice = error_metric(study)
    assert str(advice) in before.headline
    (cured,) = advice.cured(study)
    (after,) = verdicts(run_study(cured))
    assert "speed error" in after.headline


# What limits a run is found by running it with each cure: tests/run/test_limits.py.
BY_ITSELF = (
    "cli.printed.a_metric",
    "design.trials.learning_gain.learning_gain",
    "report.comparison.error_metric",
    "report.limit_sentences.remark",
)
