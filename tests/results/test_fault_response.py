"""What a run did about each fault: which faults count, and the numbers of results.json."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import cogless
import studies
from cogless.results import Results
from cogless.results.fault_response import Fault, faults_in, responses, ripple, without_faults
from cogless.results.results_json import to_dict
from cogless.results.status import Status
from cogless.results.trace import Trace
from cogless.run.simulate import simulate

TURN = 2 * np.pi


def angle(time: str, duration: str, kind: str = "angle-missing") -> dict[str, str]:
    return {"kind": kind, "time": time, "duration": duration}


def trace(status=lambda t: 0 * t, error=lambda t: 0 * t, current=lambda t: 0 * t, until=10.0):
    """At one turn a second, 1000 rows a second."""
    t = np.arange(round(1000 * until)) / 1000
    columns = (t, np.full_like(t, TURN), TURN - error(t), status(t), current(t), 0 * t)
    names = ("time", "omega_ref", "omega_m", "status", "i_q", "i_d")
    return Trace(names, ("s", "rad/s", "rad/s", "", "A", "A"), np.column_stack(columns))


def one(made: Trace, *faults: Fault, learns: bool = True):
    return responses(faults or (Fault(4.0, 4.5, ("x",)),), made, 4.0, learns)


def test_faults_that_overlap_are_one_and_end_with_the_scenario(tmp_path):
    faults = [angle("0.3 s", "1e300 s"), angle("0.1 s", "10 ms"), angle("0.105 s", "20 ms", "angle-stuck")]
    study = studies.study(tmp_path, {"scenario.low.faults": faults})
    first, last = faults_in(study, "low")
    assert (first.time, first.end, first.lasting) == (0.1, pytest.approx(0.125), False)
    assert first.words == ("position sensor gives no number", "position sensor stuck")
    assert (last.time, last.end, last.lasting) == (0.3, 0.4, True)


def test_a_load_that_comes_and_goes_is_a_fault_in_a_study_with_faults(tmp_path):
    assert faults_in(studies.study(tmp_path), "step") == []
    (load,) = faults_in(studies.study(tmp_path, {"scenario.low.faults": [angle("0.1 s", "1 ms")]}), "step")
    assert (load.time, load.end, load.words) == (0.1, 0.2, ("load of 200 mN·m",))
    stays = {"scenario.step.events": [{"time": "0.1 s", "load": "0.2 N*m"}], "metric": []}
    stays["scenario.low.faults"] = [angle("0.1 s", "1 ms")]
    assert faults_in(studies.study(tmp_path, stays), "step") == []


def test_the_scenario_without_faults():
    study = cogless.load("faults")
    assert without_faults(study, "stuck") == without_faults(study, "shock") == "nothing"
    assert without_faults(study, "nothing") is None
    assert without_faults(cogless.load("uomodri"), next(iter(cogless.load("uomodri").scenario))) is None


def test_times_are_counted_from_the_fault_to_the_next():
    def status(t):
        safe = ((t >= 4.1) & (t < 4.6)) * int(Status.FAULT | Status.OFF | Status.ANGLE_STUCK)
        return safe + (t < 5) * int(Status.FROZEN) + (t >= 8) * int(Status.SATURATED)

    first, second = one(trace(status), Fault(4.0, 4.5, ("x",)), Fault(7.0, 7.5, ("y",)))
    assert first.safe == pytest.approx(0.5, abs=2e-3)
    assert first.not_learning == pytest.approx(1.0, abs=2e-3)
    assert first.saturated == 0 and second.saturated == pytest.approx(2.0, abs=2e-3)
    assert first.noticed == ("angle stuck",) and first.noticed_after == pytest.approx(0.1, abs=2e-3)
    assert second.noticed == () and second.noticed_after is None and second.safe == 0
    assert one(trace(status), learns=False)[0].not_learning is None


def test_ripple_is_of_the_last_turn_before_and_after():
    def error(t):
        return np.where(t < 4, 1.0, np.where(t < 8, 50.0, 3.0)) * np.sin(20 * np.pi * t)

    (found,) = one(trace(error, error=error))
    assert found.before == pytest.approx((3.0, 4.0), abs=2e-3)
    assert found.after == pytest.approx((9.0, 10.0), abs=2e-3)
    assert found.ripple_before == pytest.approx(1 / np.sqrt(2), rel=1e-3)
    assert found.ripple_after == pytest.approx(3 / np.sqrt(2), rel=1e-3)
    assert found.largest_error == pytest.approx(50, rel=1e-3)
    assert ripple(trace(), None) is None


def test_ripple_before_a_second_fault_is_without_the_first():
    faults = (Fault(2.0, 4.8, ("x",)), Fault(6.0, 6.5, ("y",)))
    assert one(trace(), *faults)[1].before == pytest.approx((5.0, 6.0), abs=2e-3)
    late = (Fault(2.0, 5.2, ("x",)), Fault(6.0, 6.5, ("y",)))
    first, second = one(trace(), *late)
    assert first.before == pytest.approx((1.0, 2.0), abs=2e-3)
    assert second.before is None and second.ripple_before is None  # 0.8 turns


def test_less_than_a_turn_has_no_ripple():
    (found,) = one(trace(until=5.0), Fault(0.5, 4.5, ("x",)))
    assert found.before is None and found.after is None
    assert found.ripple_before is None and found.ripple_after is None


def test_largest_current_is_since_the_fault():
    (found,) = one(trace(current=lambda t: np.where(t < 4, 9.0, np.where(t < 4.2, -5.0, 0.1))))
    assert found.largest_current == 5.0 and found.current_limit == 4.0


def test_results_json_has_them(tmp_path):
    changes = {"scenario.low.faults": [angle("0.1 s", "20 ms")], "scenario.low.reference": "600 rpm",
               "scenario.low.initial_speed": "600 rpm"}  # fmt: skip
    study = studies.study(tmp_path, changes)
    run = simulate(study, "low", "pi")
    written = json.loads(json.dumps(to_dict(Results(study, [run])), allow_nan=False))["runs"][0]["faults"]
    (fault,) = written
    assert (fault["time_s"], fault["duration_s"]) == (0.1, pytest.approx(0.02))
    assert fault["what"] == ["position sensor gives no number"] and fault["noticed"] == ["angle missing"]
    # 5 ms are bridged; the safe output is held for 10 ms more
    assert fault["safe_s"] == pytest.approx(0.025, abs=1e-3)
    assert fault["not_learning_s"] is None and fault["current_limit_A"] == 3.0
    assert all(np.isfinite(fault[key]) for key in ("ripple_before_rad_s", "ripple_after_rad_s"))
    plain = replace(run, faults=())
    assert "faults" not in to_dict(Results(study, [plain]))["runs"][0]


def test_a_diverged_run_is_null():
    def error(t):
        return np.where(t > 5, np.nan, 0.0)

    (found,) = one(trace(error=error))
    assert np.isnan(found.largest_error) and np.isnan(found.ripple_after)
