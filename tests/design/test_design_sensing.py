"""What a law gets of a drive through its sensor, against a simulation of its own.

That has the closed form of an axis with friction under a held input, at the current loop's rate, and takes
angles of the past out of a list.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from numpy.typing import NDArray

from cogless import run_study
from cogless.design.trials.certificate import Gains
from cogless.design.trials.from_study import design_study, sensor_of, uncertain_plant
from cogless.design.trials.polytope import UncertainPlant, from_parameters
from cogless.design.trials.prediction import Conditions, simulated
from cogless.design.trials.quantisation import steps
from cogless.design.trials.sensing import Sensor
from cogless.design.trials.trial_observer import QUIET_SHARE, ObserverGains, input_by_steps
from cogless.design.trials.trial_observer import observer_gains as observer_and_feedback

Real = NDArray[np.float64]
PERIOD, DIVIDER, J, B, K_T = 2.5e-3, 20, 8e-4, 1.4e-3, 0.37
SOFT = Gains(np.array([-20.0, -0.4]), 0.3, 20.0, True, True)
OBSERVER = ObserverGains(K_T / J * PERIOD**2, 0.7)


def motor(low: float = J, high: float = J) -> UncertainPlant:
    def model(p: Any) -> Any:
        return [[0.0, 1.0], [0.0, -B / p["J"]]], [0.0, K_T / p["J"]]

    return from_parameters(model, {"J": (low, high)}, [1.0, 0.0], PERIOD, "euler")


def trial(reference: Real, sensor: Sensor, law: Any, start: tuple[float, float], step: float = 0.0) -> Real:
    """True angles of a trial, one a sample; the drive is simulated at each period of its current loop."""
    h, a, b = PERIOD / DIVIDER, B / J, K_T / J
    theta, omega = start
    ago = [theta - omega * h * k for k in range(4000, 0, -1)]  # the axis came at its speed
    speeds = [omega] * 4000
    observed = [theta - omega * sensor.latency, omega, 0.0]
    angles, psi, state = [], 0.0, None
    back = sensor.latency / h
    whole = int(back + 1e-9)
    part = max(0.0, back - whole) if abs(back - round(back)) > 1e-9 else 0.0

    def late(more: int = 0) -> float:
        return (1 - part) * ago[-1 - whole - more] + part * ago[-2 - whole - more]

    for p in range(len(reference)):
        for tick in range(DIVIDER):
            ago.append(theta)
            speeds.append(omega)
            seen = np.floor(late() / step) * step if step else late()
            window = round(sensor.window / h)
            if sensor.bandwidth:
                q = np.exp(-sensor.bandwidth * h)
                rise = h * observed[2]
                ahead = observed[0] + h * (observed[1] + rise / 2)
                e = seen - ahead
                observed = [
                    ahead + (1 - q**3) * e,
                    observed[1] + rise + 1.5 * (1 - q) ** 2 * (1 + q) / h * e,
                    observed[2] + (1 - q) ** 3 / h**2 * e,
                ]
                speed = observed[1]
            elif window:
                before = np.floor(late(window) / step) * step if step else late(window)
                speed = (seen - before) / sensor.window
            else:
                speed = speeds[-1 - whole]
            if tick == 0:
                angles.append(theta)
                error = reference[p] - seen
                if isinstance(law, Gains):
                    u = float(law.K_1 @ [seen, speed]) + law.K_2 * psi
                    psi += error
                else:
                    (corrects, k), g = observer_and_feedback(law.pole), law.response
                    state = np.array([error, 0.0, 0.0]) if state is None else state
                    state = state + corrects * (error - state[0])
                    u = float(np.append(k, 1.0) @ state) / g
                    push = state[2] - g * u
                    state = np.array([state[0] + state[1] + push / 2, state[1] + push, state[2]])
            decay = np.exp(-a * h)  # of omega' = -a omega + b u
            rest = b * u / a
            theta += rest * h + (omega - rest) * (1 - decay) / a
            omega = rest + (omega - rest) * decay
    return np.array(angles)


SENSORS = [
    Sensor(), Sensor(latency=1e-3), Sensor(latency=2.5e-3, window=2e-3),
    Sensor(latency=0.6e-3, window=2.5e-3), Sensor(latency=6.5e-3, window=0.25e-3), Sensor(window=4e-3),
]  # fmt: skip


@pytest.mark.parametrize("law", [SOFT, OBSERVER], ids=["state", "observer"])
@pytest.mark.parametrize("sensor", SENSORS, ids=str)
def test_a_delayed_loop_is_that_of_a_simulation_between_the_samples(sensor: Sensor, law: Any) -> None:
    plant = motor().seen_by(sensor)
    assert plant.exact_nominal is not None
    reference = 0.5 * (1 - np.cos(np.linspace(0, np.pi, 150)))
    start = (0.02, 0.4)
    phase = Conditions(reference, np.zeros(150), np.array(start), 1)
    error, _, _ = simulated([plant.exact_nominal], plant.C, law, phase, np.zeros(150), np.zeros((1, 150)))
    expected = reference - trial(reference, sensor, law, start)
    largest = np.abs(expected).max()
    assert error[0] == pytest.approx(expected, abs=3e-5 * largest)
    if not sensor.at_once:
        plain, _, _ = simulated(
            [motor().exact_nominal], plant.C, law, phase, np.zeros(150), np.zeros((1, 150))
        )
        differs = np.abs(plain[0] - expected).max()
        assert differs > 1e-3 * largest or (isinstance(law, ObserverGains) and not sensor.latency)


def test_an_observer_and_a_filter_are_nearly_those_of_the_current_loop_s_rate() -> None:
    """They are taken as continuous, of which their sampling at 8 kHz differs by part of a period."""
    sensor = Sensor(latency=0.5e-3, bandwidth=2 * np.pi * 120)
    plant = motor().seen_by(sensor)
    reference = 0.5 * (1 - np.cos(np.linspace(0, np.pi, 150)))
    phase = Conditions(reference, np.zeros(150), np.array([0.0, 0.0]), 1)
    error, _, _ = simulated([plant.exact_nominal], plant.C, SOFT, phase, np.zeros(150), np.zeros((1, 150)))
    expected = reference - trial(reference, sensor, SOFT, (0.0, 0.0))
    assert error[0] == pytest.approx(expected, abs=0.01 * np.abs(expected).max())


@pytest.mark.parametrize(("law", "latencies"), [(SOFT, (0.0, 5e-3, 30e-3)), (OBSERVER, (2e-3, 5e-3, 30e-3))])
def test_the_certificate_s_pole_is_the_delayed_loop_s(law: Any, latencies: tuple[float, ...]) -> None:
    """From rest, an offset decays or grows as the largest pole says; more latency makes the loop unstable."""
    rates = []
    for latency in latencies:
        sensor = Sensor(latency=latency, window=2e-3)
        plant = motor().seen_by(sensor)
        assert plant.exact_nominal is not None
        radius = law.closed(plant.exact_nominal, plant.C).radius
        offset = trial(np.zeros(700), sensor, law, (1e-3, 0.0))
        size = [np.sqrt(np.mean(offset[at : at + 200] ** 2)) for at in (300, 500)]
        assert (size[1] / size[0]) ** (1 / 200) == pytest.approx(radius, abs=2e-3)
        rates.append(radius)
    assert rates[0] < 1 < rates[-1]


def test_steps_leave_as_much_as_in_a_simulation_that_rounds() -> None:
    """Of a motion that passes several steps in a sample: RMS of the difference to a sensor without steps."""
    sensor = Sensor(window=2e-3, step=2e-3)
    plant = motor().seen_by(sensor)
    reference = 8.0 * np.linspace(0, 1, 500) + 0.3 * np.sin(np.linspace(0, 12, 500))
    for law in (SOFT, OBSERVER):
        found = steps(
            [plant.exact_nominal], plant.C, law, None, None, "error",
            sensor=sensor, period=PERIOD, trials=[1],
        )  # fmt: skip
        smooth = trial(reference, sensor, law, (0.0, 6.4))
        coarse = trial(reference, sensor, law, (0.0, 6.4), sensor.step)
        left = np.std((coarse - smooth)[100:])
        assert found.feedback[0] == pytest.approx(left, rel=0.35)


def test_the_observer_s_rule_takes_a_slower_pole_where_latency_or_steps_ask_for_it(tmp_path: Path) -> None:
    law = {"controller.ilc": {"law": "observer-ilc"}}

    def pole(**sensor: Any) -> float:
        given = {"kind": "resolver", "bits": 20} | sensor
        study = trial_studies.loaded(tmp_path, {**law, "drive.position_sensor": given})
        design = design_study(study, [("move", "ilc")])["move", "ilc"]
        observer, plant = design.gains.observer, design.certificate
        assert observer is not None and plant.deciding.stable
        return observer.pole

    at_once, late, later = pole(), pole(latency="1 ms"), pole(latency="3 ms")
    assert at_once < late < later
    assert at_once < pole(bits=11) < pole(bits=9)
    study = trial_studies.loaded(tmp_path, {**law, "drive.position_sensor": {"kind": "resolver", "bits": 11}})
    plant = uncertain_plant(study)
    observer = design_study(study, [("move", "ilc")])["move", "ilc"].gains.observer
    assert observer is not None and input_by_steps(plant, observer) <= QUIET_SHARE * 10.0
    faster = replace(observer, pole=observer.pole - 0.02)
    assert input_by_steps(plant, faster) > QUIET_SHARE * 10.0


@pytest.mark.parametrize("latency", ["0.5 ms", "1 ms", "3.1 ms"])
def test_a_late_sensor_s_prediction_is_the_run(tmp_path: Path, latency: str) -> None:
    changes = {
        "controller.ilc": {"law": "observer-ilc", "guard": False},
        "controller.feedback": {"law": "observer-ilc", "learning": False},
        "drive.precision": "double",
        "drive.position_sensor": {"kind": "resolver", "bits": 30, "latency": latency},
        "drive.current_loop.current_limit": "1000 A",
        "scenario.move.initial_speed": "0.3 rad/s",
        "scenario.move.changes": [{"trial": 5, "load_steps": [[40, "0.5 N*m"]]}],
    }
    for run in run_study(trial_studies.loaded(tmp_path, changes)).runs:
        assert run.design is not None and run.design.prediction is not None
        prediction = run.design.prediction
        at = prediction.labels.index("mechanics.inertia = 0.00059")
        learned = np.concatenate([phase.learned[at] for phase in prediction.phases])
        assert learned == pytest.approx(np.asarray(run.metrics["error_rad"]), rel=1e-4)


def test_a_study_may_leave_the_sensor_out_of_its_design(tmp_path: Path) -> None:
    late = {"drive.position_sensor": {"kind": "resolver", "bits": 12, "latency": "1 ms"}}
    known = sensor_of(trial_studies.loaded(tmp_path, late))
    assert known == Sensor(latency=1e-3, window=2e-3, step=2 * np.pi / 4096)
    left_out = sensor_of(trial_studies.loaded(tmp_path, {**late, "design.sensor": False}))
    assert left_out == replace(known, certified=False) and left_out.at_once and not known.at_once
    assert sensor_of(trial_studies.loaded(tmp_path, {"drive.position_sensor": {"kind": "ideal"}})) == Sensor()


@pytest.mark.parametrize("late", [{}, {"latency": "1 ms", "speed_method": "average"}], ids=["steps", "late"])
def test_a_rule_that_knows_its_sensor_spares_current_and_error(tmp_path: Path, late: dict[str, str]) -> None:
    """1024 lines at 1 kHz: a rule for an ideal sensor takes 9 A for 1 A, and is called certified."""
    found = {}
    for sensor in (False, True):
        changes = {
            "controller.ilc": {"law": "observer-ilc"},
            "design.sensor": sensor,
            "drive.position_sensor": {"kind": "encoder", "lines": 1024, **late},
            "drive.rates.position_loop": "1 kHz",
            "scenario.move.changes": [],
        }
        (run,) = run_study(trial_studies.loaded(tmp_path, changes), ["move/ilc"]).runs
        error = run.metrics["error_rad"]
        assert run.design is not None and isinstance(error, list)
        found[sensor] = np.abs(run.trace["i_q"]).max(), error[-1], run.design.certified
    (ideal, ideal_error, called), (known, error, certified) = found[False], found[True]
    assert called and not certified
    assert ideal > 9.0 and known < 0.2 * ideal and error < 0.9 * ideal_error
