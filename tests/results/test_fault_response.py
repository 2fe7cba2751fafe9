"""What a run did about each fault: which faults count, and the numbers of results.json."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

import cogless
import studies
from cogless.control_library import Status
from cogless.results import Results
from cogless.results.fault_response import Fault, faults_in, responses, ripple, without_faults
from cogless.results.results_json import to_dict
from cogless.results.trace import Trace
from cogless.run.simulate import simulate

TURN = 2 * np.pi


def angle(time: str, duration: str, kind: str = "angle-missing") -> dict[str, str]:
    return {"kind": kind, "time": time, "duration": duration}


def trace(status=lambda t: 0 * t, error=lambda t: 0 * t, current=lambda t: 0 * t, until=10.0, rate=1000):
    """At one turn a second, `rate` rows a second."""
    t = np.arange(round(rate * until)) / rate
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


def test_a_fault_within_another_adds_its_words_only(tmp_path):
    within = [angle("0.1 s", "0.2 s"), angle("0.15 s", "0.1 s", "angle-stuck")]
    (one,) = faults_in(studies.study(tmp_path, {"scenario.low.faults": within}), "low")
    assert (one.time, one.end, one.lasting) == (0.1, pytest.approx(0.3), False)
    up_to_the_end = [within[0], angle("0.2 s", "0.2 s", "angle-stuck")]
    (one,) = faults_in(studies.study(tmp_path, {"scenario.low.faults": up_to_the_end}), "low")
    assert (one.time, one.end, one.lasting) == (0.1, 0.4, True)


def test_a_fault_that_begins_as_another_ends_is_the_same_fault(tmp_path):
    faults = [angle("0.125 s", "0.125 s"), angle("0.25 s", "62.5 ms", "angle-stuck")]
    (one,) = faults_in(studies.study(tmp_path, {"scenario.low.faults": faults}), "low")
    assert (one.time, one.end) == (0.125, 0.3125)


def test_a_load_that_comes_and_goes_is_a_fault_in_a_study_with_faults(tmp_path):
    assert faults_in(studies.study(tmp_path), "step") == []
    (load,) = faults_in(studies.study(tmp_path, {"scenario.low.faults": [angle("0.1 s", "1 ms")]}), "step")
    assert (load.time, load.end, load.words, load.lasting) == (0.1, 0.2, ("load of 200 mN·m",), False)
    stays = {"scenario.step.events": [{"time": "0.1 s", "load": "0.2 N*m"}], "metric": []}
    stays["scenario.low.faults"] = [angle("0.1 s", "1 ms")]
    assert faults_in(studies.study(tmp_path, stays), "step") == []


def test_of_several_loads_only_the_last_before_the_usual_one_is_a_fault(tmp_path):
    events = [{"time": f"{t} s", "load": f"{load} N*m"} for t, load in ((0.1, 0.2), (0.15, 0.3), (0.2, 0))]
    changes = {"scenario.low.faults": [angle("0.1 s", "1 ms")], "scenario.step.events": events}
    (load,) = faults_in(studies.study(tmp_path, changes), "step")
    assert (load.time, load.end, load.words) == (0.15, 0.2, ("load of 300 mN·m",))


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
    assert first.safe == pytest.approx(0.5)
    assert first.not_learning == pytest.approx(1.0)
    assert first.saturated == 0 and second.saturated == pytest.approx(2.0)
    assert first.noticed == ("angle stuck",) and first.noticed_after == pytest.approx(0.1)
    assert second.noticed == () and second.noticed_after is None and second.safe == 0
    assert one(trace(status), learns=False)[0].not_learning is None


def test_a_row_at_the_fault_s_time_counts_despite_rounding_and_rows_without_a_status_do_not():
    off = trace(lambda t: np.where(t < 0.2, np.nan, (t == 0.3) * int(Status.OFF)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        first, second = one(off, Fault(0.1, 0.15, ("x",)), Fault(0.1 + 0.2, 0.5, ("y",)))
    assert (first.safe, second.safe) == (0.0, pytest.approx(1e-3))


def test_what_is_noticed_first_is_told_first():
    def status(t):
        stuck = (t >= 4.1) * int(Status.ANGLE_STUCK)
        return stuck + ((t >= 4.2) & (t < 4.3)) * int(Status.ANGLE_LOST)

    (found,) = one(trace(status))
    assert found.noticed == ("angle stuck", "angle missing")
    assert found.noticed_after == pytest.approx(0.1)
    assert one(trace(status), Fault(4.1, 4.5, ("x",)))[0].noticed_after == 0.0


def test_ten_rows_are_enough_for_a_ripple():
    assert one(trace(until=0.9, rate=10), Fault(0.5, 0.6, ("x",))) == []
    (found,) = one(trace(until=1.0, rate=10), Fault(0.5, 0.6, ("x",)))
    assert found.before is None
    (found,) = one(trace(until=1.1, rate=10), Fault(1.0, 1.0, ("x",)))
    assert found.before == pytest.approx((0.0, 1.0)) and found.after is None


def test_ripple_is_of_the_last_turn_before_and_after():
    def error(t):
        return np.where(t < 4, 1.0, np.where(t < 8, 50.0, 3.0)) * np.sin(20 * np.pi * t)

    (found,) = one(trace(error, error=error))
    assert found.before == pytest.approx((3.0, 4.0))
    assert found.after == pytest.approx((9.0, 10.0))
    assert found.ripple_before == pytest.approx(1 / np.sqrt(2))
    assert found.ripple_after == pytest.approx(3 / np.sqrt(2))
    assert found.largest_error == pytest.approx(50)
    assert ripple(trace(), None) is None


def test_ripple_before_a_second_fault_is_without_the_first():
    faults = (Fault(2.0, 4.8, ("x",)), Fault(6.0, 6.5, ("y",)))
    assert one(trace(), *faults)[1].before == pytest.approx((5.0, 6.0))
    late = (Fault(2.0, 5.2, ("x",)), Fault(6.0, 6.5, ("y",)))
    first, second = one(trace(), *late)
    assert first.before == pytest.approx((1.0, 2.0))
    assert second.before is None and second.ripple_before is None  # 0.8 turns


def test_less_than_a_turn_has_no_ripple():
    (found,) = one(trace(until=5.0), Fault(0.5, 4.5, ("x",)))
    assert found.before is None and found.after is None
    assert found.ripple_before is None and found.ripple_after is None


def test_largest_current_is_since_the_fault():
    (found,) = one(trace(current=lambda t: np.where(t < 4, 9.0, np.where(t < 4.2, -5.0, 0.1))))
    assert found.largest_current == 5.0 and found.current_limit == 4.0


def test_nothing_is_made_up_without_currents_or_faults():
    made = trace()
    without = Trace(made.names[:-2], made.units[:-2], made.data[:, :-2])
    assert one(without)[0].largest_current is None
    assert responses([], made, 4.0, learns=True) == []


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
