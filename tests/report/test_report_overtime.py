"""Plots over time: which spans have buttons and finer points, and how many points there are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cogless.report import waveforms
from cogless.report.charts import Grid, Waveforms, to_page
from cogless.report.waveforms import View
from cogless.results.fault_response import Fault
from cogless.results.trace import Trace

RATE = 100


def run_of(seconds, speed=1.0, **more):
    """A run at this many revolutions a second, without an error."""
    time = np.arange(round(RATE * seconds)) / RATE
    signals = {"omega_ref": 2 * np.pi * speed + 0 * time, "omega_error": 0 * time, **more}
    names, columns = ("time", *signals), [time, *signals.values()]
    trace = Trace(names, ("s", *("" for _ in signals)), np.column_stack(columns))
    return SimpleNamespace(scenario="low", controller="pi", trace=trace)


def results_of(*times, runs=1):
    """Results of a scenario with steps of its load at these times."""
    events = [SimpleNamespace(time=t, load=0.125 * n) for n, t in enumerate(times, 1)]
    study = SimpleNamespace(scenario={"low": SimpleNamespace(events=events)})
    return SimpleNamespace(study=study, runs=[None] * runs)


@pytest.fixture
def broken(monkeypatch):
    """Shows the faults from a second before to a second after them."""

    def at(*faults):
        made = [Fault(t, end, ("stuck",), ()) for t, end in faults]
        shown = [(fault, fault.time - 1, fault.end + 1) for fault in made]
        monkeypatch.setattr(waveforms, "spans", lambda *_: shown)

    at()
    monkeypatch.setattr(waveforms, "in_angle", lambda results, run: getattr(run, "law", None))
    monkeypatch.setattr(waveforms, "speed_unit", lambda results: "rpm")
    return at


def buttons(results, *runs):
    return [
        (z["name"], z["from"], z["to"], *(["first"] if "first" in z else []))
        for z in to_page(waveforms.zooms(results, runs))
    ]


def test_the_points_of_a_view_are_in_the_middle_of_the_rows_that_they_stand_for(monkeypatch):
    """100 rows in 20 points: of each ten rows the least and largest value, at 1/4 and 3/4 of their time."""
    trace = run_of(1.0).trace
    assert View(None, 100).grid(trace) == Grid(0.0, pytest.approx(0.01))
    assert View(None, 20).grid(trace) == Grid(pytest.approx(0.02), pytest.approx(0.05))
    assert View((0.2, 0.599), 20).grid(trace) == Grid(pytest.approx(0.205), pytest.approx(0.02))
    values = np.sin(np.arange(100.0))

    def of(rows):
        return values[rows]

    whole = View(None, 20).thinned(trace, of)
    assert whole.reshape(-1, 2).min(axis=1) == pytest.approx(values.reshape(-1, 10).min(axis=1))
    assert whole.reshape(-1, 2).max(axis=1) == pytest.approx(values.reshape(-1, 10).max(axis=1))
    assert View((0.2, 0.599), 40).thinned(trace, of) == pytest.approx(values[20:60])
    read = []
    for block in (25, 3):  # rows that are read at once, but a bucket at least
        monkeypatch.setattr(waveforms, "BLOCK_ROWS", block)
        pieces = []
        part = View((0.1, 0.999), 20).thinned(trace, lambda rows: pieces.append(rows) or values[rows])  # noqa: B023
        assert part.tolist() == View((0.1, 0.999), 20).thinned(trace, of).tolist()
        read.append([rows.stop - rows.start for rows in pieces])
    assert read == [[18] * 5, [9] * 10]


@pytest.mark.parametrize("seconds", [9, 2.5])
def test_a_run_of_more_than_two_revolutions_opens_on_its_last(broken, seconds):
    end = seconds - 0.01
    last = [("last two revolutions", seconds - 2.01, end), ("last revolution", seconds - 1.01, end)]
    found = buttons(results_of(), run_of(seconds))
    assert [name for name, *_ in found] == ["whole run", *(name for name, *_ in last)]
    assert found[0] == ("whole run", 0.0, end)
    for (_, since, until, *_), (_, start, stop) in zip(found[1:], last, strict=True):
        assert (since, until) == pytest.approx((start, stop), abs=0.011)
    assert [len(zoom) == 4 for zoom in found] == [False, False, True]
    assert not any(len(zoom) == 4 for zoom in buttons(results_of(1), run_of(seconds)))


def test_a_run_of_one_revolution_has_no_button_for_two(broken):
    assert [name for name, *_ in buttons(results_of(), run_of(1.5))] == ["whole run", "last revolution"]
    assert [name for name, *_ in buttons(results_of(), run_of(0.5))] == ["whole run"]


def test_six_faults_have_buttons_and_the_first_is_shown(broken):
    broken(*((t + 0.5, t + 0.75) for t in range(7)))
    found = buttons(results_of(), run_of(9))
    assert found[3:] == [
        ("fault at 0.5 s", 0.0, 1.75, "first"),
        *((f"fault at {t}.5 s", t - 0.5, t + 1.75) for t in range(1, 6)),
    ]
    assert not any(len(zoom) == 4 for zoom in found[:3])


def test_events_have_buttons_unless_a_fault_is_there_or_the_run_has_ended(broken):
    broken((3.0, 4.0))
    found = buttons(results_of(0.05, 2.9, 3, 4, 4.1, 9.5, 9.99, 20), run_of(10))
    assert [zoom for zoom in found if zoom[0].startswith("event")] == [
        (f"event at {t:g} s", max(0.0, t - 0.1), pytest.approx(min(t + 1, 9.99)))
        for t in (0.05, 2.9, 4.1, 9.5)
    ]


def test_where_learning_begins_is_a_button(broken):
    """Once for all laws that begin there; none where they do from the start, or never."""
    runs = [run_of(10) for _ in range(6)]
    for run, start in zip(runs, (3.0, 3.0, 0.0, 9.99, 0.5, None), strict=True):
        run.law = start if start is None else SimpleNamespace(learns_from=start)
    assert [zoom for zoom in buttons(results_of(), *runs) if "learning" in zoom[0]] == [
        ("learning begins at 0.5 s", 0.0, 5.5), ("learning begins at 3 s", 1.0, 8.0)
    ]  # fmt: skip


@pytest.mark.parametrize(("sizes", "started"), [((9, 1.0), 1.99), ((9, 8.0), None), ((1.1, 1.0), None)])
def test_start_up_ends_when_the_error_is_within_a_fifth_above_that_of_later(broken, sizes, started):
    early, late = sizes
    time = np.arange(10 * RATE) / RATE
    error = np.where(time < 1.995, -early, late)
    found = buttons(results_of(), run_of(10, omega_error=error), run_of(10))
    assert [since for name, since, *_ in found if name == "after start-up"] == ([started] if started else [])
    assert waveforms._started([run_of(10, omega_error=np.where(error < 0, np.nan, error))], 10.0) == 0.0
    event = buttons(results_of(1.5), run_of(10, omega_error=error))  # all the same up to there
    assert "after start-up" not in [name for name, *_ in event]


def test_two_faults_and_the_last_revolutions_have_finer_points(broken):
    """Spans that overlap are one. They share the points that are left, if these are twice as fine."""
    broken((2.0, 3.0), (3.5, 6.0), (7.0, 8.0))
    runs = [run_of(20)]
    details = waveforms._details(results_of(), runs, 3000, 4)
    assert [view.points for view in details] == [4000] * 3
    assert [view.span for view in details] == [
        (1.0, 4.0), (4.0, 7.0), pytest.approx((17.99, 19.99), abs=0.011)
    ]  # fmt: skip
    assert [view.points for view in waveforms._details(results_of(), runs, 100, 30)] == [200_000 // 90] * 3
    assert [view.points for view in waveforms._details(results_of(), runs, 100, 100)] == [1500] * 3
    broken((1.0, 8.99))  # half of the run
    (last,) = waveforms._details(results_of(), runs, 4003, 4)
    assert last.span[0] == pytest.approx(17.99, abs=0.011)
    assert len(waveforms._details(results_of(), runs, 4002, 4)) == 2
    broken()
    assert waveforms._details(results_of(), [run_of(1.5)], 10, 4) == []


def test_a_fault_has_a_mark_from_its_beginning_to_its_end(monkeypatch):
    found = [Fault(2.0, 3.0, ("stuck", "late")), Fault(4.0, 4.5, ("lost",))]
    monkeypatch.setattr(waveforms, "faults_in", lambda study, scenario: found if scenario == "low" else [])
    assert to_page(waveforms.marks(results_of(), [run_of(1)])) == [
        {"from": 2.0, "to": 3.0, "label": "stuck and late"}, {"from": 4.0, "to": 4.5, "label": "lost"}
    ]  # fmt: skip


def test_the_last_revolutions_begin_a_row_before_the_rows_that_turn_them():
    """Of four rows a second, each a quarter of a revolution; what is no number doesn't turn."""
    trace = run_of(5).trace
    slow = replace(trace, data=trace.data[:20] * [25, 1, 1])
    assert [waveforms._since(slow, n) for n in (1, 2)] == [3.75, 2.75]
    short = [waveforms._since(replace(slow, data=slow.data[:rows]), 2) for rows in (10, 9, 8)]
    assert short == [0.25, None, None]
    assert waveforms._since(slow, 5) is None and waveforms._since(slow, 6) is None
    data = slow.data.copy()
    data[-2, 1], data[-3, 1] = np.nan, -data[-3, 1]
    assert waveforms._since(replace(slow, data=data), 1) == pytest.approx(3.5)


@pytest.fixture
def drawn(broken, monkeypatch):
    """The panels and views of each chart, in place of their points."""
    made = []

    def keep(results, runs, panels, views):
        made.append(([(p.title, p.signal, p.quantity, p.unit) for p in panels], views))
        return Waveforms([], "time (s)", views[0].span[0] if views[0].span else 0.0)

    monkeypatch.setattr(waveforms, "_times", keep)
    return made


def test_an_event_is_drawn_from_a_tenth_before_to_one_and_a_half_seconds_after_it_or_the_next(drawn):
    charts = to_page(waveforms.events(results_of(0.05, 2.0, 3.0, 9.95), [run_of(10)]))
    spans = [view.span for _, (view,) in drawn]
    assert spans == [(0.0, 1.55), (1.9, 3.0), (2.9, 4.5)]  # four rows after the last are too few
    assert [chart["start"] for chart in charts] == pytest.approx([-0.05, -0.1, -0.1])
    assert {chart["x"] for chart in charts} == {"time since the event (s)"}
    assert drawn[1][0] == [
        ("Speed, load to 0.25 N·m at 2 s", "omega_m", "speed", "rpm"),
        ("Current reference, load to 0.25 N·m at 2 s", "i_q_ref", "i_q_ref", "A"),
    ]
    assert {view.points for _, (view,) in drawn} == {1200}


@pytest.mark.parametrize(("runs", "points"), [(1, 20_000), (10, 14_000), (20, 7_000), (100, 1_500)])
def test_points_are_shared_by_all_waveforms_of_a_page(drawn, monkeypatch, runs, points):
    monkeypatch.setattr(waveforms, "errors", lambda *_: [])
    waveforms.waveforms(results_of(runs=runs), [run_of(1)])
    ((panels, views),) = drawn
    assert [view.points for view in views][:1] == [points]
    assert panels == [
        ("Speed, reference dashed", "omega_m", "speed", "rpm"),
        ("Current reference", "i_q_ref", "i_q_ref", "A"),
        ("Torque of the motor, cogging included", "tau_motor", "torque", "N*m"),
        ("Learned part of the current reference", "learned terms", "current", "A"),
    ]


def test_laws_that_learn_in_angle_have_their_currents_and_the_time_of_a_period(drawn, monkeypatch):
    monkeypatch.setattr(waveforms, "errors", lambda *_: [])
    for needed, signals, titles in (
        (None, {}, ["Learned part of the current reference", "q current", "d current"]),
        (1, {"P_t": np.zeros(100)},
            ["Learned part of the current reference; dashed: the current that the motion needs", "q current",
            "d current", "Time of the last period, P_t, by the delay memory"]),
    ):  # fmt: skip
        monkeypatch.setattr(waveforms, "needed_current", lambda *_, needed=needed: needed)
        run = run_of(1, **signals)
        run.law = SimpleNamespace()
        waveforms.waveforms(results_of(), [run_of(1), run] if needed is None else [run])
        assert [title for title, *_ in drawn[-1][0]][3:] == titles
    assert [panel[1:] for panel in drawn[-1][0]][4:] == [
        ("i_q", "i_q", "A"), ("i_d", "i_d", "A"), ("P_t", "P_t", "s")
    ]  # fmt: skip
    assert to_page(waveforms.waveforms(results_of(), [])) == {"panels": []}


def test_the_spread_of_a_signal_is_that_of_its_second_half():
    assert waveforms._spread(np.array([9.0, -9.0, 1.0, 3.0])) == 1.0
    assert waveforms._spread(np.array([1.0, 9.0, 1.0, np.nan])) == waveforms._spread(np.zeros(0)) == 0.0
