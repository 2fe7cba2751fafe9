"""The sentences on a fault on either side of each bound, word by word, for made-up responses."""

from dataclasses import replace
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest

from cogless.report import faults as room
from cogless.results.fault_response import Fault, Response
from cogless.results.trace import Trace

RATE = 100
RPM = np.pi / 30
FAULT = Fault(2.0, 2.5, ("sensor stuck",))
USUAL = Response(FAULT, (), None, 0.0, None, 0.0, (1.0, 1.99), (3.0, 3.99), RPM, RPM, 2 * RPM, 2.0, 4.0)

USUALLY, MORE = "Afterwards the ripple is about the same as before", "Afterwards there is more ripple"
BEYOND = "The current exceeds its limit: pi"


def run_of(*found, name="pi", speed=60.0, late=None):
    """A run of four seconds, rows 10 ms apart, whose speed from 3 s on is `late`, r/min, if that is given."""
    time = np.arange(4 * RATE) / RATE
    reference = RPM * np.where(time < 2.99, speed, speed if late is None else late)
    trace = Trace(("time", "omega_ref"), ("s", "rad/s"), np.column_stack([time, reference]))
    return SimpleNamespace(scenario="faulty", controller=name, faults=list(found), trace=trace)


@pytest.fixture
def told(monkeypatch):
    """Results in which the speed is held, and there is no run without the fault."""
    monkeypatch.setattr(room, "speed_unit", lambda results: "rpm")
    monkeypatch.setattr(room, "_lost", lambda *_: None)
    monkeypatch.setattr(room, "_twin", lambda *_: None)
    return SimpleNamespace(study=SimpleNamespace(label=lambda name: name))


def at(time, *words):
    return replace(USUAL, fault=Fault(time, time + 0.5, words or ("sensor stuck",)))


def test_up_to_three_faults_are_told_and_the_others_are_counted(told):
    one = room.account(told, [run_of(USUAL)])
    assert (one.scenario, one.headline) == (
        "faulty", "2 s: sensor stuck for 0.5 s. Afterwards the ripple is about the same as before."
    )  # fmt: skip
    assert [(part.heading, len(part.sentences)) for part in one.paragraphs] == [("", 1)]
    many = [at(0.5, "a"), at(1.5, "b", "c"), at(2.5), at(3.5), at(4.5)]
    for count, rest in ((2, []), (3, []), (4, ["One more fault is"]), (5, ["2 more faults are"])):
        found = room.account(told, [run_of(*many[:count]), run_of(*many[:count], name="fair")])
        assert found.headline.startswith(f"{count} faults, the first at 0.5 s: a for 0.5 s. ")
        assert [part.heading for part in found.paragraphs] == [
            "0.5 s: a for 0.5 s", "1.5 s: b and c for 0.5 s",
            *["2.5 s: sensor stuck for 0.5 s"] * (count > 2),
            *(f"{words} in results.json." for words in rest),
        ]  # fmt: skip
        assert [len(part.sentences) for part in found.paragraphs][: min(count, 3)] == [2] * min(count, 3)
    assert room.account(told, [run_of()]) is None
    assert [
        name for name, _ in room.account(told, [run_of(), run_of(USUAL, name="fair")]).paragraphs[0].sentences
    ] == ["fair"]


@pytest.mark.parametrize(
    ("responses", "tone", "said"),
    [
        ([{}], "better", f"{USUALLY}."),
        ([{"largest_current": 4.2}], "better", f"{USUALLY}."),
        ([{"largest_current": 4.21}], "worse", f"{BEYOND} 4.21 A (limit 4 A)."),
        ([{"largest_current": 5.0}, {"largest_current": 1.0}], "worse", f"{BEYOND} 5.00 A (limit 4 A)."),
        ([{"largest_current": nan}], "worse", f"{BEYOND} no number (limit 4 A)."),
        ([{"largest_current": None}, {}], "better", f"{USUALLY}."),
        ([{"ripple_after": 1.25 * RPM}], "better", f"{USUALLY}."),
        ([{"ripple_after": 1.26 * RPM}, {}], "even", f"{MORE} than before: pi 1.26 times."),
        ([{}, {"ripple_after": None}], "even", f"{USUALLY}, where this can be judged."),
        ([{"ripple_after": None}], "even", ""),
        (
            [{"largest_current": 5.0, "ripple_after": 2 * RPM}],
            "worse",
            f"{BEYOND} 5.00 A (limit 4 A). {MORE} than before: pi 2.00 times.",
        ),
    ],
)
def test_the_outcome_of_a_fault(told, responses, tone, said):
    run = run_of(*(replace(USUAL, **values) for values in responses))
    assert room._outcome(told, [run]) == (tone, said)


def test_a_speed_that_is_lost_is_told_of_each_controller_and_its_ripple_is_not(told, monkeypatch):
    monkeypatch.setattr(
        room, "_lost", lambda results, run, response: "mean 0" if run.controller == "pi" else None
    )
    runs = [run_of(replace(USUAL, ripple_after=9.0), name=name) for name in ("pi", "fair")]
    assert room._outcome(told, runs) == (
        "worse",
        f"Afterwards the speed is not held: pi (mean 0). {MORE} than before: fair 85.9 times.",
    )
    assert "afterwards mean 0" in room._sentence(told, runs[0], USUAL).replace("\N{NO-BREAK SPACE}", " ")


def test_the_ripple_is_compared_with_that_of_a_run_without_the_fault_if_there_is_one(told, monkeypatch):
    monkeypatch.setattr(room, "_twin", lambda *_: SimpleNamespace(trace=None))
    monkeypatch.setattr(room, "ripple", lambda trace, span: 2 * RPM if span == USUAL.after else None)
    about = "Afterwards the ripple is about the same as without the fault."
    assert room._outcome(told, [run_of(replace(USUAL, ripple_after=2.4 * RPM))]) == ("better", about)
    more = "Afterwards there is more ripple than without the fault: pi 1.50 times."
    assert room._outcome(told, [run_of(replace(USUAL, ripple_after=3 * RPM))]) == ("even", more)
    sentence = room._sentence(told, run_of(USUAL), replace(USUAL, largest_current=None))
    assert sentence.replace("\N{NO-BREAK SPACE}", " ") == (
        "no check trips; speed off by up to 2.00 rpm; "
        "ripple 1.00 before, 1.00 after, 2.00 without the fault (rpm)."
    )


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"noticed_after": 0.015, "noticed": ("stuck",)}, "check trips at once (stuck)"),  # 1.5 periods
        ({"noticed_after": 0.016, "noticed": ("a", "b")}, "check trips after 16 ms (a, b)"),
        ({}, "no check trips"),
        ({"fault": Fault(2.0, 2.02, ("short",))}, "no check trips"),  # two periods
        ({"fault": Fault(2.0, 2.019, ("short",))}, ""),  # it may have fallen between them
    ],
)
def test_when_a_check_trips(values, says):
    assert room._noticed(run_of(), replace(USUAL, **values)) == says


@pytest.mark.parametrize(
    ("values", "run", "expected"),
    [
        ({}, {}, 1.0),
        ({"ripple_after": 3 * RPM}, {}, 3.0),
        # up to a ten-thousandth of 60 r/min, 0.006, it is none
        ({"ripple_after": 0.006 * RPM, "ripple_before": 0.001 * RPM}, {}, 1.0),
        ({"ripple_after": 0.007 * RPM, "ripple_before": 0.001 * RPM}, {}, 7.0),
        ({"ripple_before": 0.0}, {}, inf),
        ({"ripple_after": inf}, {}, None),
        ({"ripple_after": None}, {}, None),
        ({"after": None}, {}, None),
        ({"before": None}, {}, None),
        ({"ripple_before": None}, {}, None),
        ({}, {"late": 57.0}, 1.0),  # a twentieth slower is alike
        ({}, {"late": 56.9}, None),
        ({}, {"late": 63.1}, 1.0),
        ({}, {"late": 63.2}, None),
    ],
)
def test_a_ripple_is_compared_with_that_before_at_a_like_speed(told, values, run, expected):
    found = room._times_usual(told, run_of(**run), replace(USUAL, **values))
    assert found == (expected if expected is None else pytest.approx(expected))


def test_without_rows_nothing_is_compared(told):
    bare = run_of()
    bare.trace = replace(bare.trace, data=bare.trace.data[:0])
    assert room._times_usual(told, bare, USUAL) is None


@pytest.mark.parametrize(
    ("fault", "before", "span"),
    [
        ((2.0, 3.0), (0.5, 1.5), (1.7, 4.0)),  # a length after it, and three tenths of that before it
        ((2.0, 2.1), (0.5, 1.5), (1.75, 3.1)),  # a turn after it, and a quarter of that before it
        ((2.0, 2.1), (0.0, 2.0), (1.75, 3.1)),  # a second, if a turn takes longer
        ((2.0, 2.5), (-9.0, 9.0), (1.375, 5.0)),  # five times as long as the fault at most
        ((2.0, 2.01), None, (1.95, 2.21)),  # 0.2 s, if the time of a turn is not known
        ((0.1, 9.0), (0.0, 1.0), (0.0, 9.5)),  # within what is drawn
        ((0.0, 0.1), (0.0, 1.0), (0.0, 1.1)),
        ((9.5, 9.6), None, None),  # not after it
        ((-0.1, 9.0), None, None),
    ],
)
def test_a_fault_is_shown_a_little_before_and_a_turn_after_it(monkeypatch, fault, before, span):
    made = Fault(*fault, ("stuck",))
    monkeypatch.setattr(room, "faults_in", lambda study, scenario: [made])
    run = run_of(replace(USUAL, fault=made, before=before))
    found = room.spans(SimpleNamespace(study=None), [run], 0.0, 9.5)
    assert found == ([(made, *map(pytest.approx, span))] if span else [])
    if before is None and span:
        assert room.spans(SimpleNamespace(study=None), [run_of()], 0.0, 9.5) == found


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (0.0, "0 s"), (0.02, "20 ms"), (0.0995, "0.0995 s"), (0.0994, "99.4 ms"), (999, "999 s"),
        (1000, "1000 s"),
    ],
)  # fmt: skip
def test_a_time_in_words(time, text):
    assert room._seconds(time) == text
