"""What a verdict on a speed says where controllers tie, miss the speed or learn nothing: word by word."""

from dataclasses import replace
from importlib import import_module
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic
from test_report_orders import RATE, with_signals

from cogless.report.comparison import Line, compare, remarks, runs_in
from cogless.report.speed_verdict import Sensor
from cogless.report.verdicts import change_words
from cogless.results.metrics import result_name
from cogless.results.runs import LearningOff
from cogless.study.reading import Remark

room = import_module("cogless.report.speed_verdict")
PI, FAIR, ILC = "PI as published", "PI re-tuned", "PI-ILC"  # the first is the baseline, the last learns
NAMES = {"pi": "pi", "fair": "fair-pi", "ilc": "pi-ilc"}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return synthetic.study(tmp_path_factory.mktemp("study"))


def line(name="speed_ripple", kind="ripple-rms", missed=(), unlearned=(), **more):
    """A line with the values of `NAMES`; those that `missed` had 0 rpm, from 8 to 10 s."""
    values = {long: more.pop(short) for short, long in NAMES.items() if short in more}
    about = {"signal": "omega_m", "order": None, "frame": "mechanical", "better": "lower", "unit": "rpm"}
    about |= {"span": (8.0, 10.0)} | more
    return Line(
        name,
        kind,
        values=values,
        missed={NAMES[short]: "mean 0 of 60 rpm" for short in missed},
        unlearned={NAMES[short]: "its gain is 0" for short in unlearned},
        **about,
    )


def order(n, name="speed_orders", **more):
    return line(name, "order", order=n, **more)


def other(name, **more):
    return line(name, "rms", signal="tau_e", **more)


def case(study, *lines, worsened=()):
    return room._Case(study, "At 60 rpm", lines, lines[0], {NAMES[short]: 4.0 for short in worsened})


@pytest.mark.parametrize(
    ("given", "worsened", "tone", "said"),
    [
        ({"pi": 1, "fair": 2, "missed": ["pi", "fair"]}, (), "worse",
            f"no controller holds the speed from 8 to 10 s: {PI} and {FAIR} mean 0 of 60 rpm."),
        ({"ilc": 1}, (), "even", f"speed ripple: {ILC} 1.00 rpm."),
        ({"pi": 1}, (), "even", f"speed ripple: {PI} 1.00 rpm."),
        ({"ilc": 1, "fair": 2}, (), "even", f"speed ripple: {FAIR} 2.00 rpm and {ILC} 1.00 rpm."),
        ({"pi": None, "ilc": 1}, (), "even", f"speed ripple: {PI} not finite and {ILC} 1.00 rpm."),
        ({"pi": None, "ilc": None}, (), "even", f"speed ripple: {PI} not finite and {ILC} not finite."),
        ({"pi": 1, "ilc": 0.5, "missed": ["ilc"]}, (), "worse",
            f"only {PI} holds the speed: it leaves 1.00 rpm of speed ripple."),
        ({"pi": 1, "ilc": 0.5, "unlearned": ["ilc"]}, (), "even",
            f"nothing was learned: {ILC} 0.500 rpm and {PI} 1.00 rpm of speed ripple."),
        ({"pi": 1, "ilc": 2}, ["ilc"], "worse",
            f"no controller stays better than {PI}: it leaves 1.00 rpm of speed ripple."),
        ({"pi": 1, "ilc": 2, "fair": 3, "unlearned": ["fair"]}, ["ilc"], "worse",
            f"no controller stays better than {PI}: it leaves 1.00 rpm of speed ripple."),
        ({"pi": 9, "ilc": 1, "fair": 2, "missed": ["pi"]}, (), "better",
            f"{ILC} leaves 1.00 rpm of speed ripple; "
            f"{PI} did not hold the speed (mean 0 of 60 rpm, 8 to 10 s)."),
        ({"pi": 1, "ilc": 1.05}, (), "even",
            f"all are alike: {PI} 1.00 rpm and {ILC} 1.05 rpm of speed ripple."),
        ({"pi": 1, "ilc": 1.05, "fair": 1, "missed": ["fair"]}, (), "even",
            f"{PI} and {ILC} tie: they leave 1.00 rpm and 1.05 rpm of speed ripple."),
        ({"pi": 1, "fair": 2, "ilc": 3}, (), "worse",
            f"no controller beats {PI}: it leaves 1.00 rpm of speed ripple; "
            f"the next, {FAIR}, 2.00 rpm (worse: 2.00 times as much)."),
        ({"pi": 2, "fair": 1.5, "ilc": 1}, (), "better",
            f"{ILC} leaves 1.00 rpm of speed ripple, 2.00 times less than {PI} (2.00 rpm)."),
        ({"pi": 2, "fair": 1.04, "ilc": 1}, (), "even",
            f"{ILC} and {FAIR} tie: they leave 1.00 rpm and 1.04 rpm of speed ripple, "
            f"about 2.00 times less than {PI} (2.00 rpm)."),
        ({"pi": 2, "ilc": 0}, (), "better", f"{ILC} leaves 0 rpm of speed ripple, against {PI} (2.00 rpm)."),
        ({"pi": 0, "ilc": 1}, (), "worse",
            f"no controller beats {PI}: it leaves 0 rpm of speed ripple; the next, {ILC}, 1.00 rpm (worse)."),
        ({"pi": 2, "ilc": 0, "fair": 0}, (), "even",
            f"{FAIR} and {ILC} tie: they leave 0 rpm and 0 rpm of speed ripple, against {PI} (2.00 rpm)."),
    ],
)  # fmt: skip
def test_the_first_sentence(study, given, worsened, tone, said):
    assert room._headline(case(study, line(**given), worsened=worsened)) == (tone, f"At 60 rpm, {said}")


@pytest.mark.parametrize(
    ("off", "tone", "said"),
    [
        (1.02, "even", f"as much as with learning off (1.02 rpm): its feedback, not its learning, leaves "
         f"2.00 times less than {PI} (2.00 rpm)."),
        (0.8, "worse", f"1.25 times as much as with learning off (0.800 rpm): its feedback, not its "
         f"learning, leaves 2.00 times less than {PI} (2.00 rpm)."),
        (4.0, "better", f"2.00 times less than {PI} (2.00 rpm) and 4.00 times less than with learning off "
         "(4.00 rpm)."),
        (None, "better", f"2.00 times less than {PI} (2.00 rpm) and with learning off it does not hold the "
         "speed."),
    ],
)  # fmt: skip
def test_the_best_law_stands_beside_itself_with_learning_off(study, off, tone, said):
    """What its feedback alone does is no merit of its learning."""
    metric = next(m for m in study.metrics_in("low-speed") if m.name == "speed_ripple")
    value = None if off is None else off * np.pi / 30
    beside = LearningOff("low-speed", "pi-ilc", result_name(metric), None, value)
    of_learning = replace(case(study, line(pi=2, ilc=1)), off=beside)
    start = f"At 60 rpm, {ILC} leaves 1.00 rpm of speed ripple, "
    assert room._headline(of_learning) == (tone, start + said)
    of_order = replace(of_learning, off=replace(beside, order=6.0))
    assert room._headline(of_order) == room._headline(case(study, line(pi=2, ilc=1)))


BEST = {  # the controller to take; the baseline is the PI as published
    "": [
        {"ilc": 1, "fair": 2},  # no baseline
        {"pi": 1, "fair": 2, "missed": ["pi", "fair"]},
        {"pi": 1, "ilc": 0.5, "unlearned": ["ilc"]},
        {"pi": 1, "ilc": 1.05},
        {"pi": 1.05, "ilc": 1},
        {"pi": 1.04, "ilc": 1, "fair": 2},
    ],
    "pi": [{"pi": 1, "ilc": 0.5, "missed": ["ilc"]}, {"pi": 1, "fair": 2, "ilc": 3}],
    "ilc": [{"pi": 2, "fair": 1.5, "ilc": 1}, {"pi": 9, "ilc": 1, "fair": 2, "missed": ["pi"]}],
    "fair": [{"pi": 2, "fair": 1.04, "ilc": 1}, {"pi": 2, "fair": 1, "ilc": 3}],
}


@pytest.mark.parametrize(("best", "values"), [(best, one) for best, all_ in BEST.items() for one in all_])
def test_the_best_is_what_the_headline_calls_so(study, best, values):
    """Where a learner ties with a law that does not learn, its learning is not worth it."""
    of_lines = case(study, line(**values))
    assert room._best(of_lines, room._headline(of_lines)[0]) == NAMES.get(best, "")


@pytest.mark.parametrize(
    ("off", "missed", "best"),
    [(1.02, [], ""), (0.8, [], ""), (4.0, [], "pi-ilc"), (None, [], "pi-ilc"), (1.02, ["pi"], "pi-ilc")],
)
def test_a_law_whose_learning_does_not_help_is_not_the_best(study, off, missed, best):
    """Unless it alone holds the speed."""
    metric = next(m for m in study.metrics_in("low-speed") if m.name == "speed_ripple")
    value = None if off is None else off * np.pi / 30
    beside = LearningOff("low-speed", "pi-ilc", result_name(metric), None, value)
    of_learning = replace(case(study, line(pi=2, ilc=1, missed=missed)), off=beside)
    assert room._best(of_learning, room._headline(of_learning)[0]) == best


def test_a_dip_is_told_as_thrown_off_and_not_as_left(study):
    dip = line("dip", "dip", pi=4, fair=2.04, ilc=2)
    assert room._headline(case(study, dip))[1] == (
        f"At 60 rpm, {ILC} and {FAIR} tie: they deviate by up to 2.00 rpm and 2.04 rpm (dip), about "
        f"2.00 times less than {PI} (4.00 rpm)."
    )
    assert (
        "PI-ILC deviates by up to 2.00 rpm (dip)"
        in room._headline(case(study, replace(dip, values={"pi": 4.0, "pi-ilc": 2.0})))[1]
    )


@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        (0.0, "nothing left"),
        (0.5, "2.00 times less"),
        (0.94, "1.06 times less"),
        (0.96, "as much"),
        (1.04, "as much"),
        (1.06, "worse: 1.06 times as much"),
        (inf, "worse"),
    ],
)
def test_a_change_in_words(ratio, said):
    assert change_words(ratio) == said


def test_what_a_speed_is_judged_by():
    """Its ripple; where the reference moves, its error; else the baseline's strongest order, or a dip."""
    mean, rest = line("mean", "mean", pi=1), other("torque", pi=1)
    ripple, error = line(pi=1), line("error", "rms", signal="omega_error", pi=1)
    both = line("error_ripple", "peak-to-peak", signal="omega_error", pi=1)
    small, large = order(1, pi=1), order(6, pi=2)
    later, dip = order(2, "late_orders", pi=9), line("dip", "dip", signal="omega_m", pi=1)
    torque = line("torque_ripple", "peak-to-peak", signal="tau_e", pi=1)
    nobody = line("nobody", ilc=1)
    for lines, still, moving in (
        ([mean, rest, torque, dip, small, large, later, ripple, error], ripple, error),
        ([rest, error, ripple, both], ripple, error),
        ([rest, both, error], both, error),
        ([rest, torque, dip, small, large, later, ripple], ripple, large),
        ([rest, torque, dip, small, large, later], large, large),
        ([rest, torque, dip, later, small], later, later),  # of the first order metric
        ([rest, torque, dip], dip, dip),
        ([rest, torque], torque, torque),
        ([mean, rest], rest, rest),
        ([mean], None, None),
        ([nobody, rest], rest, rest),  # the baseline has a value
        ([nobody], nobody, None),
    ):
        assert room._decisive(lines, "pi", False) is still
        assert room._decisive(lines, "pi", True) is (nobody if lines == [nobody] else moving)


@pytest.mark.parametrize(
    ("reference", "speed", "said"),
    [
        (lambda run: 6 * np.sin(run.trace.time), lambda run: 6.01 * np.sin(run.trace.time),
            "In low-speed, no speed is judged: the reference varies, which would count as ripple; "
            'add a [[metric]] with kind = "rms" and signal = "omega_error".'),
        (lambda run: 0 * run.trace.time, lambda run: 1e-3 * np.sin(run.trace.time),
            "At 0 rpm, no speed is judged: the reference is at rest."),
    ],
)  # fmt: skip
def test_a_ripple_that_is_no_controller_s_is_neither_judged_nor_starred(tmp_path, reference, speed, said):
    blocks = synthetic.STUDY.split("[[metric]]")
    text = "[[metric]]".join(block for block in blocks if 'kind = "order"' not in block)
    error = '[[metric]]\nname = "error"\nkind = "rms"\nsignal = "omega_error"\nlast = "2 s"\n'
    made = synthetic.results(synthetic.study(tmp_path, text + error), rate=RATE)
    moved = with_signals(made, "low-speed", omega_ref=reference, omega_m=speed)
    lines = {one.name: one for one in compare(moved, "low-speed")}
    ripple = lines["speed_ripple"]
    assert ripple.unjudged and not ripple.best and ripple.ratio("pi-ilc", "pi") is None
    assert not lines["torque_ripple"].unjudged
    (told,) = (line for line in remarks(moved.study, "low-speed", [*lines.values()]) if "not judged" in line)
    assert told.startswith("speed ripple") and ripple.unjudged in told
    by_error = room.verdict(moved, runs_in(moved, "low-speed")).headline
    assert ("of error" in by_error) if "varies" in said else by_error == said
    without = replace(moved, study=synthetic.study(tmp_path, text))
    assert room.verdict(without, runs_in(without, "low-speed")).headline == said


def test_of_several_windows_of_a_metric_the_last_one_judges():
    first, last, apart = line("early", pi=1), line("late", pi=1), line("torque", signal="tau_e", pi=1)
    spans = {"early": (0.0, 4.0), "late": (6.0, 9.0), "torque": (9.0, 10.0), "whole": None}
    metrics = [SimpleNamespace(name=name, span=lambda _, span=span: span) for name, span in spans.items()]
    study = SimpleNamespace(scenario={"low": SimpleNamespace(duration=10.0)}, metrics_in=lambda _: metrics)

    def latest(chosen, *lines):
        return room._latest(SimpleNamespace(study=study), "low", chosen, lines)

    assert latest(first, first, last, apart) is last and latest(last, last, first) is last
    assert latest(first, first, apart) is first
    assert latest(first, first, line("whole", pi=1)) is first  # without a window of its own
    assert latest(None) is None
    early, late = order(6, "early", pi=1), order(6, "late", pi=1)
    assert latest(early, early, late) is early


def test_the_strongest_order_is_told_of_the_best_two_and_the_baseline(study):
    orders = [order(1, pi=1, fair=1, ilc=9), order(6, pi=5, fair=2, ilc=1), order(7, signal="tau_e", pi=9)]
    told = room._strongest_order(case(study, line(pi=3, fair=2, ilc=1), *orders))
    assert (
        told == f"In the strongest order, 6 (mechanical): {ILC} 1.00 rpm, {FAIR} 2.00 rpm and {PI} 5.00 rpm."
    )
    lacking = [order(6, pi=5, ilc=1), order(1, pi=1, fair=1, ilc=9)]
    told = room._strongest_order(case(study, line(pi=3, fair=2, ilc=1), *lacking))
    assert told == f"In the strongest order, 6 (mechanical): {ILC} 1.00 rpm and {PI} 5.00 rpm."
    behind = line(pi=1, fair=2, ilc=3)
    assert room._strongest_order(case(study, behind, *orders)).endswith(
        f": {PI} 5.00 rpm and {FAIR} 2.00 rpm."
    )
    lost = room._strongest_order(case(study, replace(behind, missed={"pi": "mean 0 of 60 rpm"}), *orders))
    assert lost == f"In the strongest order, 1 (mechanical): {FAIR} 1.00 rpm and {ILC} 9.00 rpm."
    assert [one.order for one in room._orders([order(1, pi=0.0), order(2, pi=0.5)], "pi")] == [2, 1]
    for nothing in (
        case(study, other("torque", pi=1, ilc=2), *orders),
        case(study, line(pi=1), *orders),
        case(study, behind),
        case(study, behind, orders[2]),
    ):
        assert room._strongest_order(nothing) == ""


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pi": 3, "fair": 2, "ilc": 1},
            f"{ILC} has 2.00 times less than the best controller without learning, {FAIR} (2.00 rpm)."),
        ({"pi": 3, "fair": 1, "ilc": 2},
            f"{FAIR} doesn't learn; the best controller that learns is {ILC} with 2.00 rpm."),
        ({"pi": 3, "fair": 1, "ilc": 1.04}, ""),  # they tie
        ({"pi": 1, "fair": 2, "ilc": 3}, ""),
        ({"pi": 2, "fair": 3, "ilc": 1}, ""),  # the headline has the baseline
        ({"pi": 2, "ilc": 1}, ""),
        ({"pi": 2, "fair": 1}, ""),
        ({"pi": 2, "fair": 1, "ilc": 0}, ""),
        ({"pi": 3, "fair": 1, "ilc": 2, "unlearned": ["ilc"]}, ""),
    ],
)  # fmt: skip
def test_the_best_without_learning_is_told_where_it_is_not_the_baseline(study, given, said):
    assert room._without_learning(case(study, line(**given))) == said


def test_metrics_in_which_the_next_best_is_better_by_half_are_told(study):
    """Three at most, the worst first; for each of the two if they tie; never against the baseline."""
    names = ("loss", "heat", "noise", "jerk", "wear")
    others = [
        other(n, unit="W", pi=1, fair=1, ilc=ratio)
        for n, ratio in zip(names, (2, 4, 1.49, 3, 1.5), strict=True)
    ]
    told = room._against_the_next(case(study, line(pi=9, fair=2, ilc=1), *others, order(6, fair=1, ilc=9)))
    assert told == (
        f"Compared with {FAIR}, {ILC} has 4.00 times the heat (4.00 W against 1.00 W), 3.00 times the jerk "
        "(3.00 W against 1.00 W) and 2.00 times the loss (2.00 W against 1.00 W)."
    )
    edge = room._against_the_next(case(study, line(pi=9, fair=2, ilc=1), others[-1]))
    assert edge == f"Compared with {FAIR}, {ILC} has 1.50 times the wear (1.50 W against 1.00 W)."
    tie = [line(pi=9, fair=1.04, ilc=1), others[0], other("shock", unit="W", fair=2, ilc=1)]
    assert room._against_the_next(case(study, *tie)) == (
        f"Compared with {FAIR}, {ILC} has 2.00 times the loss (2.00 W against 1.00 W). "
        f"Compared with {ILC}, {FAIR} has 2.00 times the shock (2.00 W against 1.00 W)."
    )
    assert room._against_the_next(case(study, tie[0], tie[2])).startswith(f"Compared with {ILC}, {FAIR} has")
    assert room._against_the_next(case(study, line(pi=2, ilc=1, fair=3), *others)) == ""
    dips = [line("dip", "dip", fair=2, ilc=1), order(6, fair=1, ilc=9)]
    assert "9.00 times the speed order 6" in room._against_the_next(case(study, *dips))  # no part of a dip


def test_a_cost_is_more_than_a_hundredth_of_the_baselines(study):
    best = line(pi=2, ilc=1)
    for ratio, said in (
        (1.01, None),
        (1.02, "2 % more loss"),
        (1.99, "99 % more loss"),
        (2, "2.00 times the loss"),
    ):
        told = room._costs(case(study, best, other("loss", unit="W", pi=1, ilc=ratio)))
        costs = said and f"Compared with {PI}, {ILC} has {said} ({ratio:.2f} W)."
        assert told == (
            costs or f"Of the other metrics compared, none is clearly worse with {ILC} than with {PI}."
        )
    two = [other("loss", pi=1, ilc=1), other("heat", pi=1, ilc=1)]
    none = f"Of the other metrics compared, none is clearly worse with {ILC} than with {PI}."
    assert room._costs(case(study, best, *two)) == none
    assert room._costs(case(study, best, *two, other("noise", pi=0, ilc=1))) == none  # of nothing no share
    slight = order(6, pi=0.001, ilc=0.099)  # less than a twentieth of the baseline's ripple
    assert room._costs(case(study, best, *two, slight)) == none
    assert room._costs(case(study, best)) == ""
    tie = line(pi=1, ilc=1.04)
    assert (
        room._costs(case(study, tie, two[0]))
        == f"Of the other metrics compared, none is clearly worse with {ILC} than with {PI}."
    )
    for nothing in (line(pi=1, ilc=2), line(pi=2, ilc=1, missed=["pi"])):
        assert room._costs(case(study, nothing, *two)) == ""


@pytest.mark.parametrize(
    ("size", "unit", "total", "slight"),
    [
        (0.049, "rpm", 1.0, True),
        (0.05, "rpm", 1.0, False),
        (0.001, "rpm", 0.0, False),
        (1.0, "rad/s", 200.0, True),
        (1.0, "rad/s", 180.0, False),
    ],
)
def test_an_order_is_slight_below_a_twentieth_of_the_total(study, size, unit, total, slight):
    judged = case(study, line(pi=total, ilc=1))
    assert room._is_slight(judged, order(6, unit=unit, ilc=size), "pi-ilc") is slight


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pi": 2, "fair": 1.5, "ilc": 1}, f", compared with {PI}: {FAIR} 1.50 rpm (1.33 times less)."),
        ({"pi": 2, "fair": 1.04, "ilc": 1}, None),
        ({"pi": 1, "fair": 2, "ilc": 3},
            f", compared with {PI}: {ILC} 3.00 rpm (worse: 3.00 times as much)."),
        ({"pi": 1, "fair": 2, "ilc": 1.04},
            f", compared with {PI}: {FAIR} 2.00 rpm (worse: 2.00 times as much)."),
        ({"pi": 2, "fair": 3, "ilc": 1, "missed": ["pi"]}, f": {FAIR} 3.00 rpm."),
    ],
)  # fmt: skip
def test_the_others_are_those_that_the_headline_leaves_out(study, given, said):
    assert room._rest(case(study, line(**given))) == (f"The other controller{said}" if said else "")


def test_who_missed_the_speed_is_told_unless_the_headline_has_it(study):
    """So is who missed it in another metric, if that one's window ends after this one's begins."""
    missed, lost = line(pi=1, ilc=2, fair=3, missed=["ilc"]), "did not hold the speed in"
    window = "8 to 10 s: mean 0 of 60 rpm"
    told = f"{ILC} {lost} speed ripple, {window}."
    assert room._failures(case(study, missed)) == [told]
    assert room._failures(case(study, replace(missed, span=None))) == [
        f"{ILC} {lost} speed ripple: mean 0 of 60 rpm."
    ]
    for span, words in (
        ((0.0, 8.0), []),
        ((0.0, 8.5), [f"{FAIR} {lost} early, 0 to 8.5 s: mean 0 of 60 rpm."]),
    ):
        early = line("early", missed=["fair"], span=span, fair=1)
        assert room._failures(case(study, missed, early)) == [*words, told]
    early = line("early", missed=["fair"], span=(0.0, 0.5), fair=1)
    assert len(room._failures(case(study, replace(missed, span=None), early))) == 2
    both = line(pi=1, ilc=2, missed=["pi", "ilc"])
    assert room._failures(case(study, both)) == []  # nobody holds it: the headline has all
    assert room._failures(case(study, line(pi=1, ilc=2, missed=["pi"]))) == []
    unsettled = line("settling", "settling", unit="s", pi=None, fair=None, ilc=None, missed=["ilc"])
    assert room._failures(case(study, line(pi=1), replace(unsettled, missed={}, span=None))) == [
        f"{PI}, {FAIR} and {ILC} never settled (metric: settling)."
    ]
    assert f"{PI} and {FAIR} never settled (metric: settling)." in room._failures(
        case(study, line(pi=1), unsettled)
    )


def test_what_a_sensor_adds_of_its_own_is_told_where_it_is_most(study):
    true, seen = line(pi=2, ilc=1, fair=3), line("as seen", pi=1.5, ilc=0.4, fair=3)
    whole = case(study, true, other("loss", pi=1))
    assert room._of_the_sensor(whole, None, None) == ""
    assert room._of_the_sensor(whole, Sensor(seen, dict.fromkeys(true.values, 0.5)), None) == ""
    one = {"pi": 0.5, "pi-ilc": 0.84, "fair-pi": 0.0}
    own = "Most of the true speed ripple comes from the sensor's own error, which no law can see"
    own += " (in brackets: its share of the mean square)"
    measured = f"The measured values show: {ILC} 0.400 rpm."
    assert room._of_the_sensor(whole, Sensor(seen, one), None) == f"{own}: {ILC} 1.00 rpm (84 %). {measured}"
    limited = Remark("What limits ILC is the sensor's own error.")
    assert room._of_the_sensor(whole, Sensor(seen, one), limited) == measured
    every = Sensor(seen, {"pi": 0.75, "pi-ilc": 0.84, "fair-pi": 0.51})
    said = room._of_the_sensor(whole, every, None)
    assert f"{own}: {ILC} 1.00 rpm (84 %), {PI} 2.00 rpm (75 %) and {FAIR} 3.00 rpm (51 %)." in said
    assert said.endswith(f"The measured values show: {ILC} 0.400 rpm, {PI} 1.50 rpm and {FAIR} 3.00 rpm.")
