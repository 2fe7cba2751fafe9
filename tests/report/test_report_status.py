"""States of the controllers without faults: lanes below the waveforms, and the guard in table and verdict."""

import re
from dataclasses import replace

import numpy as np
import pytest
import synthetic
from test_report_orders import RATE, with_signals

from cogless.control_library import Status
from cogless.design.kinds import DESIGNS
from cogless.report import comparison
from cogless.report.charts import to_page
from cogless.report.comparison import compare, held_back, remarks, runs_in
from cogless.report.speed_tracking import active, spans, strip
from cogless.report.speed_verdict import verdict
from cogless.report.tables import _meters
from cogless.study import changed

WHERE = "low-speed"
SINCE, UNTIL = 8.5, 9.75  # s, of 10: the metrics' window is the last two


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return synthetic.results(synthetic.study(tmp_path_factory.mktemp("study")), rate=RATE)


def with_status(made, bits, since=SINCE, until=UNTIL):
    def status(run):
        time = run.trace.time
        return np.where((time >= since) & (time < until), int(bits), 0)

    return with_signals(made, WHERE, status=status)


def lanes(results):
    return {lane["name"]: lane["runs"] for lane in to_page(strip(results, runs_in(results, WHERE)))}


def test_a_state_that_lasts_has_a_lane_without_faults(made):
    assert lanes(made) == {}
    found = lanes(with_status(made, Status.GUARDED | Status.FROZEN))
    assert set(found) == {"not learning", "learning held back by the guard"}
    assert [run["controller"] for run in found["not learning"]] == [2]  # the others never do
    assert [run["controller"] for run in found["learning held back by the guard"]] == [0, 1, 2]
    for run in found["learning held back by the guard"]:
        assert run["spans"] == pytest.approx([SINCE, UNTIL], abs=1e-3)
    for until, count in ((1.095, 0), (1.105, 1)):  # shorter than a tenth of a second is a moment
        assert len(lanes(with_status(made, Status.FROZEN, 1.0, until))) == count


def test_every_state_has_a_lane_of_its_name(made):
    assert list(lanes(with_status(made, sum(Status)))) == [
        "safe output", "angle missing", "angle shifted", "angle stuck", "current not plausible",
        "bus voltage not plausible", "at its limit (current or voltage)", "not learning",
        "error far beyond the usual", "learning held back by the guard",
    ]  # fmt: skip


def test_the_guard_in_the_window_of_a_metric_is_told_in_table_and_verdict(made):
    held = with_status(made, Status.GUARDED)
    lines = compare(held, WHERE)
    learning = [c for c in held.study.controller if held.study.controller[c].learns]
    assert learning
    inside = [line for line in lines if line.span and line.span[1] > SINCE]
    assert inside and all(set(line.guarded) == set(learning) & set(line.values) for line in inside)
    told = [
        line
        for line in remarks(held.study, WHERE, lines)
        if line.startswith("the guard held back the learning of")
    ]
    assert len(told) == len(learning)
    label = held.study.label(learning[0])
    assert told[0].startswith(f"the guard held back the learning of {label} from 8.5 to 9.75 s (frozen, ")
    assert told[0].endswith(" is from this time") and ": a part of its " in told[0]
    found = verdict(held, runs_in(held, WHERE))
    assert any(line.startswith("The guard held back the learning of") for line in found.details)


def test_learning_that_the_guard_held_back_and_that_did_harm_is_told_with_its_reason(made, monkeypatch):
    held = with_status(made, Status.GUARDED)
    name = next(c for c in held.study.controller if held.study.controller[c].learns)
    base = held.study.label(held.study.baseline)
    (plain,) = (line for line in compare(held, WHERE) if line.name == "speed_ripple")
    harms = replace(DESIGNS["speed"], likely_harm=lambda study, controller, scenario: "it learns orders 5 k")
    monkeypatch.setattr(comparison, "DESIGNS", {**DESIGNS, "speed": harms})
    for times, said in (
        (1.24, "a part of its speed ripple is from this time"),
        (4.5, f"learning does harm here, with 4.50 times the speed ripple of {base}"),
    ):
        line = replace(plain, values={**plain.values, name: times * plain.values[held.study.baseline]})
        line = replace(line, missed={name: "mean 0 of 60 rpm"})
        (told,) = (one for one in held_back(held.study, WHERE, [line]) if held.study.label(name) in one)
        assert f": {said}" in told and told.endswith(" (it learns orders 5 k)") is (times > 4)


def test_a_law_whose_own_feedback_did_not_run_is_not_said_to_do_harm(made):
    """Its PI is not that of the baseline: what learning does is not known."""
    slower = changed(made.study, {"controller.pi-ilc.kp": 1e-3, "controller.pi-ilc.ki": 1e-2})
    held = with_status(replace(made, study=slower), Status.GUARDED)
    (plain,) = (line for line in compare(held, WHERE) if line.name == "speed_ripple")
    base = plain.values[slower.baseline]
    line = replace(plain, values={**plain.values, "pi-ilc": 2.12 * base})
    (told,) = (one for one in held_back(slower, WHERE, [line]) if slower.label("pi-ilc") in one)
    beside = f"its ripple is then 2.12 times the speed ripple of {slower.label(slower.baseline)}"
    assert told.endswith(f": {beside}, which has another feedback") and "harm" not in told


def test_a_guard_before_the_window_or_for_a_moment_changes_nothing(made):
    for since, until in ((1.0, 3.0), (9.0, 9.05)):
        other = with_status(made, Status.GUARDED, since, until)
        assert not any(line.guarded for line in compare(other, WHERE) if line.span and line.span[0] > 3.0)
    plain = verdict(made, runs_in(made, WHERE))
    assert not any("guard" in line for line in plain.details)


def blinking(made, on, off, count):
    """A run of which a state is active for `on` rows of each `on + off`, `count` times."""
    run = runs_in(made, WHERE)[0]
    rows = np.arange(len(run.trace))
    status = np.where((rows % (on + off) < on) & (rows < count * (on + off)), float(Status.SATURATED), np.nan)
    data = run.trace.data.copy()
    data[:, run.trace.names.index("status")] = status
    return replace(run, trace=replace(run.trace, data=data))


def test_spans_last_from_their_first_row_to_the_end_of_their_last(made):
    run = blinking(made, 3, 7, 4)
    period = run.trace.period
    assert spans(run, Status.SATURATED) == [
        (pytest.approx(10 * n * period), pytest.approx((10 * n + 3) * period)) for n in range(4)
    ]
    assert spans(run, Status.FROZEN) == []
    assert spans(replace(run, trace=replace(run.trace, data=run.trace.data[:0])), Status.SATURATED) == []
    inside = spans(run, Status.SATURATED, slice(12, 32))
    assert inside == [
        (pytest.approx(a * period), pytest.approx(b * period)) for a, b in ((12, 13), (20, 23), (30, 32))
    ]
    assert active(run, Status.SATURATED, slice(1, 5)).tolist() == [True, True, False, False]


def test_so_many_spans_are_joined_over_their_short_gaps(made):
    """Up to 300 stay; of more the gaps of two rows are closed, then of four, and so on."""
    assert len(spans(blinking(made, 1, 1, 300), Status.SATURATED)) == 300
    assert len(spans(blinking(made, 1, 1, 301), Status.SATURATED)) == 1
    run = blinking(made, 1, 3, 400)
    (whole,) = spans(run, Status.SATURATED)
    assert whole == (0.0, pytest.approx((4 * 399 + 1) * run.trace.period))
    wide = blinking(made, 1, 9, 310)
    assert len(spans(wide, Status.SATURATED)) == 1


def test_bars_of_figures_are_shares_of_the_largest():
    found = _meters([2.0, 1.0, np.inf, 0.0])
    assert [re.findall(r"width:([\d.]+)%", cell)[0] for cell in found] == ["100.0", "50.0", "0.0", "0.0"]
    assert found[1].startswith('<td class="figure">1.00 A</td>') and ">inf A<" in found[2]
    assert "width:0.0%" in _meters([0.0])[0]
