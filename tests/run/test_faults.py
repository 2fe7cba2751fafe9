"""Faults of sensors and bus in the simulator, and what a drive makes of them."""

from __future__ import annotations

import numpy as np
import pytest

import cogless
import studies
from cogless import StudyError
from cogless.run.simulate import simulate

SHIFTED, STUCK, LOST, CURRENT, FAULT, SATURATED = 32, 64, 16, 128, 2, 1
RPM = 30 / np.pi
FAULTY = ("dropout", "glitch", "jump", "stuck", "no-current", "current-lost", "bus-sag", "shock")
LEARNERS = ("pi-ilc", "robust-ilc")


@pytest.fixture(scope="module")
def runs():
    """Of what learns, and for as long as its faults last of what does not; side by side they are quicker."""
    briefly = {f"scenario.{name}.duration": "17 s" for name in ("nothing", *FAULTY)}
    studies_of = {
        controllers: cogless.load("faults", {"metric": [], **changes} | only(controllers))
        for controllers, changes in {LEARNERS: {}, ("pi",): briefly}.items()
    }
    return {
        (run.scenario, run.controller): run
        for results in cogless.rollout(list(studies_of.values()), jobs=1)
        for run in results.runs
    }


def only(controllers: tuple[str, ...]) -> dict[str, list[str]]:
    return {f"scenario.{name}.controllers": list(controllers) for name in ("nothing", *FAULTY)}


def ripple(run, start: float) -> float:
    """Of the second from `start`, r/min rms."""
    return float(np.std(run.trace.part("omega_m", run.trace.window(start, start + 1))) * RPM)


@pytest.mark.parametrize("controller", LEARNERS)
def test_it_takes_ten_seconds_to_learn(runs, controller):
    """Until the ripple of the run without faults is 1.2 times what it is at 15 s."""
    run = runs["nothing", controller]
    assert next(n for n in range(16) if ripple(run, n) < 1.2 * ripple(run, 15)) >= 10


@pytest.mark.parametrize("controller", LEARNERS)
@pytest.mark.parametrize("scenario", FAULTY)
def test_the_ripple_is_back_within_one_learning_time(runs, scenario, controller):
    """Long before it: two turns after the fault's end, at 16.5 s, and from then on."""
    run, good = runs[scenario, controller], runs["nothing", controller]
    for start in (18.5, 20.0, 26.5):
        assert ripple(run, start) < 1.2 * ripple(good, start)
    assert ripple(run, 26.5) < 0.05 * ripple(runs["nothing", "pi"], 15)


@pytest.mark.parametrize("scenario", FAULTY)
@pytest.mark.parametrize("controller", ("pi", *LEARNERS))
def test_the_current_stays_within_its_limit(runs, scenario, controller):
    largest = np.abs(runs[scenario, controller].trace["i_amplitude"]).max()
    assert largest < 1.03 * 4.0  # the limit is on the reference


@pytest.mark.parametrize("controller", LEARNERS)
@pytest.mark.parametrize("scenario", FAULTY)
def test_what_was_learned_is_unspoilt(runs, scenario, controller):
    """The map at the end is that of the run without a fault at every angle, up to what noise teaches."""
    good = runs["nothing", controller].memory["current"]
    spoilt = runs[scenario, controller].memory["current"]
    difference = spoilt - good - np.mean(spoilt - good)
    assert np.std(difference) < 0.05 * np.std(good)
    assert np.abs(difference).max() < 0.5 * np.std(good)


def test_each_fault_says_what_it_is(runs):
    def said(scenario: str) -> int:
        run = runs[scenario, "pi-ilc"]
        time = run.trace["time"]
        during = (time >= 16.0) & (time < 16.5)
        return int(np.bitwise_or.reduce(run.trace["status"][during].astype(int)))

    assert said("nothing") & (FAULT | LOST | SHIFTED | STUCK | CURRENT) == 0
    assert said("dropout") & (LOST | FAULT) == LOST | FAULT
    assert said("glitch") & (LOST | FAULT) == LOST
    assert said("jump") & (SHIFTED | FAULT) == SHIFTED
    assert said("stuck") & (STUCK | FAULT) == STUCK | FAULT
    assert said("no-current") & (CURRENT | FAULT) == CURRENT | FAULT
    assert said("bus-sag") & SATURATED


def test_a_fault_acts_from_its_time_for_its_duration(tmp_path):
    fault = {"kind": "angle-missing", "time": "0.02 s", "duration": "0.01 s"}
    study = studies.study(tmp_path, {"scenario.low.faults": [fault]})
    trace = simulate(study, "low", "pi").trace
    missing = np.isnan(trace["omega_measured"])
    assert trace["time"][missing].min() == pytest.approx(0.02)
    assert missing.sum() == pytest.approx(0.01 * study.trace_rate, abs=1)


@pytest.mark.parametrize("duration", ["1e300 s", "1e15 s", "0.38 s"])
def test_a_fault_may_last_beyond_the_end(tmp_path, duration):
    fault = {"kind": "angle-missing", "time": "0.02 s", "duration": duration}
    study = studies.study(tmp_path, {"scenario.low.faults": [fault]})
    trace = simulate(study, "low", "pi").trace
    assert np.array_equal(np.isnan(trace["omega_measured"]), trace["time"] >= 0.02 - 1e-9)


def test_a_slipped_index_is_a_jump_that_stays(tmp_path):
    """The 25 counts that are lost are missing in the measured angle from then on."""
    counts = 2 * np.pi / (4 * 2500)
    fault = {"kind": "angle-jump", "angle": f"{-25 * counts} rad", "time": "0.1 s", "duration": "1 s"}
    sensor = {"kind": "encoder", "lines": 2500, "speed_method": "M"}
    study = studies.study(tmp_path, {"scenario.low.faults": [fault], "drive.position_sensor": sensor})
    trace = simulate(study, "low", "pi").trace
    error, before = trace["theta_measured"] - trace["theta_m"], trace["time"] < 0.1 - 1e-9
    error = (error + np.pi) % (2 * np.pi) - np.pi
    assert np.all(np.abs(error[before] + counts / 2) <= counts / 2 * (1 + 1e-6))
    assert np.all(np.abs(error[~before] + 25.5 * counts) <= counts / 2 * (1 + 1e-6))


@pytest.mark.parametrize("time", ["0.02 s", "0.02003 s", "0.02005 s"])
def test_one_period_is_enough_to_be_seen(tmp_path, time):
    fault = {"kind": "angle-missing", "time": time, "duration": f"{1 / 15000} s"}
    study = studies.study(tmp_path, {"scenario.low.faults": [fault]})
    status = simulate(study, "low", "pi").trace["status"].astype(int)
    assert np.count_nonzero(status & LOST)


def test_a_lower_bus_is_what_the_inverter_has(tmp_path):
    """Less voltage than the speed needs: the loop says that it is saturated."""
    fault = {"kind": "bus-voltage", "voltage": "1 mV", "time": "0.02 s", "duration": "1 s"}
    study = studies.study(tmp_path, {"scenario.low.faults": [fault]})
    trace = simulate(study, "low", "pi").trace
    late = trace["time"] > 0.03
    assert np.all(trace["status"][late].astype(int) & SATURATED)


@pytest.mark.parametrize(
    "fault, line",
    [
        ({"kind": "angle-gone", "time": "1 ms", "duration": "1 ms"}, 'kind: "angle-gone": expected one of'),
        ({"kind": "angle-jump", "time": "1 ms", "duration": "1 ms"}, "angle: missing: expected an angle"),
        ({"kind": "angle-stuck", "time": "9 s", "duration": "1 ms"}, 'time: "9 s": expected a time within'),
        ({"kind": "angle-stuck", "time": "0.4 s", "duration": "1 ms"},
            'time: "0.4 s": expected a time within'),
        ({"kind": "angle-stuck", "time": "0.39999 s", "duration": "1 ms"},
            'time: "0.39999 s": expected a time at least 6.66667e-05 s (one period of the current loop)'),
        ({"kind": "angle-stuck", "time": "1 ms", "duration": "0 s"},
            'duration: "0 s": expected a time above zero'),
        ({"kind": "angle-stuck", "time": "1 ms", "duration": "20 us"},
            'duration: "20 us": expected at least 6.66667e-05 s (one period of the current loop)'),
        ({"kind": "current-zero", "phase": "d", "time": "1 ms", "duration": "1 ms"},
            'phase: "d": expected'),
        ({"kind": "bus-voltage", "voltage": "1 A", "time": "1 ms", "duration": "1 ms"},
            'voltage: "1 A": expected'),
    ],
)  # fmt: skip
def test_a_wrong_fault_is_one_line(tmp_path, fault, line):
    with pytest.raises(StudyError) as caught:
        studies.study(tmp_path, {"scenario.low.faults": [fault]})
    assert "\n" not in str(caught.value)
    assert f"scenario.low.faults.0.{line}" in str(caught.value)


def test_a_phase_that_is_not_measured_has_no_fault(tmp_path):
    fault = {"kind": "current-zero", "phase": "c", "time": "1 ms", "duration": "1 ms"}
    with pytest.raises(StudyError, match="expected one of the measured phases a, b"):
        studies.study(tmp_path, {"scenario.low.faults": [fault], "drive.current_sensors": {"sensors": 2}})
