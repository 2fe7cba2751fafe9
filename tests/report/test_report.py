"""The report: verdict and table from the numbers, waveforms that keep peaks, spectra, one offline page."""

import json
import math
import re
from dataclasses import replace
from html import escape
from html.parser import HTMLParser

import numpy as np
import pytest
import synthetic
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cogless.control_library import Status
from cogless.report import (
    Line,
    angle_charts,
    compare,
    comparison,
    map_charts,
    order_charts,
    render,
    verdicts,
    write,
    write_plots,
)
from cogless.report import waveforms as room
from cogless.report.comparison import QUANTITIES, factor_text, held_back, misses, pretty
from cogless.report.markup import number, pack, thin, unpack
from cogless.report.order_charts import order_spectrum, turned_back
from cogless.report.page import assumptions, settings
from cogless.report.pictures import SPEED_PICTURES
from cogless.report.speed_tracking import missed
from cogless.report.speed_verdict import MEASURED_SIGNALS
from cogless.report.verdicts import listed, ratio, times, worst
from cogless.results import Results, Run
from cogless.results.trace import Trace
from cogless.results.windows import late, span_of
from cogless.run.carry_out import measure
from cogless.run.simulate import simulate
from cogless.study import changed, load


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return synthetic.results(synthetic.study(tmp_path_factory.mktemp("study")), rate=5000)


@pytest.fixture(scope="module")
def page(made):
    return render(made)


def data_of(page):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


def with_metrics(results, **changes):
    """The results with other metrics in the runs of some controllers in "low-speed"."""
    names = {"pi": "pi", "fair_pi": "fair-pi", "pi_ilc": "pi-ilc"}
    changed = {names[key]: value for key, value in changes.items()}

    def one(run):
        other = changed.get(run.controller, {}) if run.scenario == "low-speed" else {}
        return replace(run, metrics={**run.metrics, **other})

    return replace(results, runs=[one(run) for run in results.runs])


def short(trace, rows):
    return replace(trace, data=trace.data[:rows])


# --- numbers


def test_lines_are_in_display_units_with_the_best_marked(made):
    lines = compare(made, "low-speed")
    sixth = lines[2]
    assert sixth.title == "speed orders: order 6 (electrical)"
    assert replace(sixth, name="speed_order").title == "speed: order 6 (electrical)"
    assert sixth.value_text("pi") == "4.80 rpm" and sixth.best == {"pi-ilc"}
    assert sixth.ratio("fair-pi", "pi") == pytest.approx(1.9 / 4.8, rel=1e-3)
    assert {line.unit for line in lines} == {"rpm", "mN·m", "W", "mA"}
    assert [line.name for line in compare(made, "step-on")][-2:] == ["dip", "settling"]


def line(better="lower", **values):
    return Line("n", "mean", "omega_m", None, "mechanical", better, "rpm", values)


def test_best():
    assert line(a=1.0, b=2.0).best == {"a"}
    assert line("higher", a=1.0, b=2.0).best == {"b"}
    assert line("none", a=1.0, b=2.0).best == set()
    assert line(a=1.0, b=1.0).best == set()
    assert line(a=1.0, b=1.0, c=2.0).best == {"a", "b"}
    assert line(a=1.0, b=1.0 + 5e-10, c=2.0).best == {"a", "b"}  # rounding
    assert line(a=1.0, b=1.0 + 5e-9, c=2.0).best == {"a"}
    assert line(a=None, b=2.0).best == {"b"}
    assert line(a=1.0).best == set()
    assert line(a=None, b=None).best == set()


def test_a_controller_that_did_not_hold_the_speed_is_not_the_best():
    def with_missed(*missed, **values):
        return replace(line(**values), missed=dict.fromkeys(missed, "mean 0 of 60 rpm"))

    assert with_missed("a", a=0.0, b=1.0, c=2.0).best == {"b"}
    assert with_missed("a", a=0.0, b=1.0).best == {"b"}
    assert with_missed("a", "b", a=0.0, b=1.0).best == set()
    assert with_missed("a", a=0.0, b=None).best == set()
    assert with_missed("a", a=0.0, b=1.0).ratio("a", "b") is None


def test_never_to_leave_a_band_is_the_best():
    def exceeds(better, **values):
        return replace(line(better, **values), kind="exceeds")

    for better in ("higher", "lower"):
        assert exceeds(better, a=None, b=2.0).best == {"a"}
    assert exceeds("none", a=None, b=2.0).best == set()
    assert exceeds("higher", a=1.0, b=2.0).best == {"b"}
    assert exceeds("higher", a=None).value_text("a") == "never"


def test_later_is_better_for_exceeds_unless_the_metric_says_otherwise(tmp_path):
    for better, best in (("", "pi"), ('better = "lower"', "fair-pi"), ('better = "none"', None)):
        metric = f'[[metric]]\nname = "m"\nkind = "exceeds"\nsignal = "omega_m"\nband = "1 rpm"\n{better}\n'
        study = synthetic.study(tmp_path, synthetic.STUDY + metric)
        runs = [
            Run("low-speed", c, short(synthetic.trace(study, "low-speed", c, 1000), 9000))
            for c in ("pi", "fair-pi")
        ]
        runs = [replace(run, metrics={"m_s": v}) for run, v in zip(runs, (5.0, 3.0), strict=True)]
        assert compare(Results(study, runs), "low-speed")[0].best == ({best} if best else set())


def test_ratio_says_nothing_where_there_is_none():
    assert line(a=None, b=2.0).ratio("a", "b") is None
    assert line(a=1.0, b=0.0).ratio("a", "b") is None
    assert line(a=1.0).ratio("a", "b") is None
    assert replace(line(a=None), kind="settling").value_text("a") == "never"
    assert line(a=None).value_text("a") == "not finite"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.46123, "0.461"), (48.37, "48.4"), (1234.5, "1234"), (0.001234, "0.00123"), (1e-7, "1e-07"),
        (0, "0"), (-3.14159, "-3.14"),
    ],
)  # fmt: skip
def test_number(value, text):
    assert number(value) == text


def test_factor():
    found = (0.0961, 0.1, 1.03, 99.994, 100, 250.3, 99_999, 1e5, 4e14)
    assert [factor_text(x).removeprefix("\u00d7\u202f") for x in found] == [
        "0.096", "0.10", "1.03", "99.99", "100", "250", "99999", "1.0e+05", "4.0e+14",
    ]  # fmt: skip
    assert {factor_text(x)[:2] for x in found} == {"\u00d7\u202f"}


def test_a_line_has_words_for_a_table_and_for_a_sentence():
    plain = replace(line(a=1.5), name="speed-ripple_rms")
    assert (plain.title, plain.quantity) == ("speed ripple rms", "speed ripple rms")
    electrical = replace(plain, frame="electrical")
    assert (electrical.title, electrical.quantity) == ("speed ripple rms (electrical)",) * 2
    sixth = replace(electrical, order=6.0)
    assert sixth.title == "speed ripple rms: order 6 (electrical)"
    assert sixth.quantity == "speed order 6 (electrical)"
    assert replace(sixth, signal="u_q").quantity == "u_q order 6 (electrical)"
    spans = {None: "", (0.0, 2.5): "0 to 2.5 s", (999.4, 1000.4): "999 to 1000 s"}
    spans[1234.5, 98765.4] = "1234 to 98765 s"
    assert {span: replace(plain, span=span).window for span in spans} == spans
    stalled = replace(plain, missed={"a": "mean 0 of 60 rpm"}, span=(8.0, 10.0))
    assert stalled.not_held("a") == "speed ripple rms, 8 to 10 s: mean 0 of 60 rpm"


def test_signals_have_words_and_measured_ones_those_of_the_true_ones():
    for true, measured in MEASURED_SIGNALS.items():
        assert QUANTITIES[measured] == f"measured {QUANTITIES[true]}"
    assert {QUANTITIES[f"i_{phase}"] for phase in "abc"} == {"phase current"}
    assert [QUANTITIES[f"i_{axis}"] for axis in "dq"] == ["d current", "q current"]
    torques = {"tau_e": "electric", "tau_motor": "motor", "tau_load": "load"}
    assert [QUANTITIES[name] for name in torques] == [f"{word} torque" for word in torques.values()]


@pytest.mark.parametrize(
    ("kind", "value", "number", "text"),
    [
        ("mean", 1.5, "1.50", "1.50 rpm"),
        ("mean", None, "not finite", "not finite"),
        ("trials-to-floor", 12.0, "12", "12 rpm"),
        ("trials-to-floor", None, "never", "never"),
        ("settling", None, "never", "never"),
    ],
)
def test_a_value_is_shown_with_its_unit(kind, value, number, text):
    one = replace(line(a=value), kind=kind)
    assert (one.number("a"), one.value_text("a"), one.number("b")) == (number, text, "")
    assert replace(one, unit="").value_text("a") == number


def test_a_ratio_is_of_what_has_a_direction_and_one_sign():
    assert line(a=3.0, b=2.0).ratio("a", "b") == 1.5
    assert line(a=0.0, b=2.0).ratio("a", "b") == 0.0
    assert line(a=-1.0, b=2.0).ratio("a", "b") is None
    assert line("none", a=3.0, b=2.0).ratio("a", "b") is None
    assert replace(line(a=3.0, b=2.0), missed={"b": "mean 0"}).ratio("a", "b") is None
    learned = replace(line(a=1.0, b=2.0, c=3.0), unlearned={"a": "too short"})
    assert learned.best == {"b"} and learned.ratio("a", "b") == 0.5


def test_the_guard_is_told_once_for_all_metrics_of_a_controller(made):
    """The first metric is named, the others are not; each controller has its own time."""
    one, two, three = (replace(line(), name=name, guarded={"pi-ilc": when}) for name, when in (
        ("ripple", "from 3.5 to 5.1 s"), ("loss", "from 1 to 2 s"), ("dip", "from 1 to 2 s")))  # fmt: skip
    said = (
        "the guard held back the learning of PI-ILC from 3.5 to 5.1 s (frozen, gentler or without effect): "
        "a part of its ripple is from this time"
    )
    assert (
        held_back(made.study, "low-speed", [one])
        == held_back(made.study, "low-speed", [one, two, three])
        == [said]
    )
    other = replace(two, guarded={"fair-pi": "from 1 to 2 s"})
    both = held_back(made.study, "low-speed", [one, other])
    assert [text.split(" from ")[0].split(" of ")[1] for text in both] == [
        "PI-ILC", "PI re-tuned",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("spans", "when"),
    [
        ([(3.5, 3.6), (5.0, 5.125)], "from 3.5 to 5.12 s"),
        ([(0.0, 0.1)], "from 0 to 0.1 s"),
        ([(0.0, 0.099)], ""),
        ([], ""),
    ],
)
def test_the_guard_is_told_of_a_tenth_of_a_second_or_more(made, monkeypatch, spans, when):
    monkeypatch.setattr(comparison, "spans", lambda *_: spans)
    low = {run.controller: run for run in made.runs if run.scenario == "low-speed"}
    assert comparison.guarded(made, low["pi-ilc"], slice(None)) == when
    assert comparison.guarded(made, low["pi"], slice(None)) == ""  # which doesn't learn


def test_a_guard_that_held_learning_back_in_a_whole_window_is_told_so(made, monkeypatch):
    low = {run.controller: run for run in made.runs if run.scenario == "low-speed"}["pi-ilc"]
    end = float(low.trace.time[-1])
    for since, when in ((0.0, "throughout"), (0.1 * end, f"from {0.1 * end:.3g} to {end:.3g} s")):
        monkeypatch.setattr(comparison, "spans", lambda *_, since=since: [(since, end)])
        assert comparison.guarded(made, low, slice(None)) == when
    text = (
        "the guard held back the learning of PI-ILC throughout (frozen, gentler or without effect): all of "
        "its ripple is from this time"
    )
    assert held_back(
        made.study, "low-speed", [replace(line(), name="ripple", guarded={"pi-ilc": "throughout"})]
    ) == [text]


def test_of_several_misses_the_one_with_the_latest_end_is_told():
    def missed(name, span):
        return replace(line(a=1.0), name=name, missed={"a": "mean 0 of 60 rpm"}, span=span)

    first, last, unknown = missed("first", (0.0, 0.5)), missed("last", (0.25, 0.75)), missed("unknown", None)
    for lines in ([first, last, unknown], [unknown, last, first], [last, first]):
        assert misses(lines) == {"a": "last, 0.25 to 0.75 s: mean 0 of 60 rpm"}
    assert misses([first, unknown]) == {"a": "first, 0 to 0.5 s: mean 0 of 60 rpm"}
    assert misses([missed("same", (0.0, 0.5)), first]) == {"a": "same, 0 to 0.5 s: mean 0 of 60 rpm"}


@pytest.mark.parametrize(
    ("unit", "shown"), [("N*m", "N·m"), ("kg*m^2/s^2", "kg·m²/s²"), ("mohm", "mΩ"), ("rad/s", "rad/s")]
)
def test_a_unit_is_printed_in_its_signs(unit, shown):
    assert pretty(unit) == shown


def test_words_of_a_sentence():
    assert [listed(parts) for parts in (["a"], ["a", "b"], ["a", "b", "c"])] == ["a", "a and b", "a, b and c"]
    assert [ratio(1.0, 2.0), ratio(0.0, 0.0), ratio(1.0, 0.0), ratio(0.0, 2.0)] == [0.5, 1.0, math.inf, 0.0]
    found = [times(ratio) for ratio in (1.6, 99.94, 100.4, 1234.5, math.inf)]
    assert found == ["1.60 times", "99.9 times", "100 times", "1234 times", "infinitely"]
    assert worst("better", "even") == "even" and worst("even", "worse", "better") == "worse"


# --- verdict


def test_verdict_leads_with_the_whole_ripple(made):
    low, step = verdicts(made)
    assert low.tone == "better"
    assert low.headline == (
        "At 60 rpm, PI-ILC leaves 1.57 rpm of speed ripple, 7.52 times less than PI as published (11.8 rpm)."
    )
    details = " ".join(low.details)
    assert (
        "In the strongest order, 6 (electrical): PI-ILC 0.461 rpm, PI re-tuned 1.90 rpm and PI as" in details
    )
    assert "3.29 times less than the best controller without learning, PI re-tuned (5.17 rpm)" in details
    assert step.tone == "even"  # the winner there doesn't learn
    assert "PI re-tuned doesn't learn; the best controller that learns is PI-ILC" in " ".join(step.details)
    assert "PI as published and PI re-tuned never settled (metric: settling)." in step.details


def test_verdict_is_of_the_baselines_strongest_order_where_no_ripple_is_taken(made):
    def without(run):
        return replace(run, metrics={n: v for n, v in run.metrics.items() if n != "speed_ripple_rad_s"})

    low = verdicts(Results(made.study, [without(run) for run in made.runs]))[0]
    assert low.headline == (
        "At 60 rpm, PI-ILC leaves 0.461 rpm of speed order 6 (electrical), "
        "10.4 times less than PI as published (4.80 rpm)."
    )
    assert "In the strongest order" not in " ".join(low.details)


def test_the_strongest_order_is_that_of_the_worst_where_the_baseline_has_no_number(made):
    winner = {"speed_orders_rad_s": [0.06, 0.006, 0.048]}
    low = verdicts(with_metrics(made, pi={"speed_ripple_rad_s": np.nan}, pi_ilc=winner))[0]
    assert "In the strongest order, 6 (electrical): PI-ILC 0.458 rpm and PI re-tuned 1.90 rpm." in low.details


@pytest.mark.parametrize(
    ("reference", "unit", "expected"),
    [
        ("60 rpm", "", "At 60 rpm, PI-ILC leaves 1.57 rpm of speed ripple"),
        ("1 rev/s", "", "At 1 rev/s, PI-ILC leaves 0.0261 rev/s of speed ripple"),
        ("6.283185307179586 rad/s", "", "At 6.283 rad/s, PI-ILC leaves 0.164 rad/s of speed ripple"),
        ("6.283185307179586 rad/s", 'unit = "rpm"', "At 60 rpm, PI-ILC leaves 1.57 rpm of speed ripple"),
    ],
)
def test_the_verdict_speaks_as_the_study_does(tmp_path, reference, unit, expected):
    """In its metrics' unit, else in its reference's."""
    text = synthetic.STUDY.replace('"60 rpm"', f'"{reference}"').replace('unit = "rpm"', unit)
    results = synthetic.results(synthetic.study(tmp_path, text), rate=2000)
    found = verdicts(results)[0]
    assert found.headline.startswith(expected)
    assert {line.unit for line in compare(results, "low-speed") if line.signal == "omega_m"} == {
        expected.split(",")[0].split()[-1]
    }


def test_verdict_names_the_costs(made):
    pi = made.runs[0].metrics
    costly = with_metrics(
        made, pi_ilc={"copper_loss_W": 1.03 * pi["copper_loss_W"], "chattering_A": 4.1 * pi["chattering_A"]}
    )
    details = " ".join(verdicts(costly)[0].details)
    assert "PI-ILC has 3 % more copper loss (" in details
    assert "and 4.10 times the chattering (" in details
    assert "None of the" not in details


def test_verdict_without_baseline_or_runs(made):
    alone = Results(made.study, [run for run in made.runs if run.controller == "pi-ilc"], interrupted=True)
    assert "nothing to compare" in " ".join(verdicts(alone)[0].details)
    assert verdicts(Results(made.study, [])) == []


# --- a speed that isn't held


def with_speed(results, speeds):
    """The results with other speeds, of the reference, in the runs of some controllers."""

    def one(run):
        if run.controller not in speeds:
            return run
        data = run.trace.data.copy()
        data[:, run.trace.names.index("omega_m")] = speeds[run.controller] * run.trace["omega_ref"]
        trace = replace(run.trace, data=data)
        metrics = run.metrics if np.any(np.isnan(data)) else measure(results.study, run.scenario, trace)
        return replace(run, trace=trace, metrics=metrics)

    return replace(results, runs=[one(run) for run in results.runs])


def test_a_controller_that_stalls_wins_nothing(made):
    stalled = with_speed(made, {"pi-ilc": 0.0})
    for line in compare(stalled, "low-speed"):
        assert line.missed == {"pi-ilc": "mean 0 of 60 rpm"}
        assert "pi-ilc" not in line.best and line.ratio("pi-ilc", "pi") is None
    assert compare(stalled, "low-speed")[0].best == {"fair-pi"}
    low, step = verdicts(stalled)
    assert low.headline.startswith("At 60 rpm, PI re-tuned leaves 5.17 rpm of speed ripple, 2.28 times less")
    assert "PI-ILC did not hold the speed in speed ripple, 8 to 10 s: mean 0 of 60 rpm." in low.details
    assert step.headline.startswith("At 60 rpm, PI re-tuned deviates by up to")
    page = render(stalled)
    assert page.count("PI-ILC did not hold the speed in ") == 6  # verdicts, tables, those of jitter
    assert 'class="missed"><span class="value">0 rpm</span></td>' in page


@pytest.mark.parametrize(
    ("speed", "held"), [(0.96, True), (1.04, True), (0.94, False), (1.06, False), (-1, False)]
)
def test_how_far_off_a_speed_may_be(made, speed, held):
    line = compare(with_speed(made, {"pi-ilc": speed}), "low-speed")[0]
    assert (line.missed == {}) == held


def test_verdict_when_the_baseline_or_everybody_stalls(made):
    low = verdicts(with_speed(made, {"pi": 0.5}))[0]
    assert low.tone == "better"
    assert low.headline == (
        "At 60 rpm, PI-ILC leaves 1.57 rpm of speed ripple; "
        "PI as published did not hold the speed (mean 30 of 60 rpm, 8 to 10 s)."
    )
    assert "The other controller: PI re-tuned 5.17 rpm." in low.details
    low = verdicts(with_speed(made, {"pi-ilc": 0.5, "fair-pi": 0.5}))[0]
    assert low.tone == "worse"
    assert low.headline == (
        "At 60 rpm, only PI as published holds the speed: it leaves 11.8 rpm of speed ripple."
    )
    low = verdicts(with_speed(made, {"pi": 0.5, "fair-pi": 0.0, "pi-ilc": np.nan}))[0]
    assert low.tone == "worse"
    assert low.headline == (
        "At 60 rpm, no controller holds the speed from 8 to 10 s: PI as published mean 30 of 60 rpm, "
        "PI re-tuned mean 0 of 60 rpm, PI-ILC speed not finite."
    )


def ripple_of(results, *metrics):
    """The results with other metrics of the study, measured anew."""
    text = synthetic.STUDY[: synthetic.STUDY.index("[[metric]]")] + "".join(
        f"[[metric]]\n{m}\n" for m in metrics
    )
    path = results.study.source.path.parent / "other.toml"
    path.write_text(text, encoding="utf-8")
    study = load(path)
    return Results(study, [replace(r, metrics=measure(study, r.scenario, r.trace)) for r in results.runs])


RMS = 'name = "speed_error"\nkind = "rms"\nsignal = "omega_error"\nunit = "rpm"\n'


def test_verdict_is_about_what_the_baseline_has(made):
    """Here angle_error has no value in the baseline, and comes first."""
    other = ripple_of(
        made, 'name = "angle_error"\nkind = "peak-to-peak"\nsignal = "theta_m"', RMS + 'last = "2 s"'
    )
    runs = [
        replace(r, metrics={k: v for k, v in r.metrics.items() if k != "angle_error_rad"})
        if r.controller == "pi"
        else r
        for r in other.runs
    ]
    low = verdicts(replace(other, runs=runs))[0]
    assert low.tone == "better" and low.headline.endswith(
        "of speed error, 8.74 times less than PI as published (3.47 rpm)."
    )
    assert "nothing to compare" not in " ".join(low.details)


def test_the_whole_error_goes_before_an_order(made):
    order = (
        'name = "orders"\nkind = "order"\nsignal = "omega_m"\norder = 6\nframe = "electrical"\nlast = "2 s"'
    )
    low = verdicts(ripple_of(made, order, RMS + 'last = "2 s"'))[0]
    assert "of speed error" in low.headline
    assert "In the strongest order, 6 (electrical): PI-ILC" in " ".join(low.details)


def test_of_several_windows_the_last_counts(made):
    early = RMS.replace("speed_error", "speed_early") + 'window = ["1 s", "2 s"]'
    low = verdicts(ripple_of(made, early, RMS + 'last = "2 s"'))[0]
    assert "of speed error" in low.headline


def test_a_miss_names_its_window_and_one_before_the_verdicts_is_none(made):
    """In the first two seconds a controller that begins to learn later is slow."""
    slow = with_speed_until(made, "pi-ilc", 0.5, 2.0)
    early = RMS.replace("speed_error", "speed_early") + 'window = ["0.5 s", "2 s"]'
    results = ripple_of(slow, RMS + 'last = "2 s"', early)
    assert misses(compare(results, "low-speed")) == {"pi-ilc": "speed early, 0.5 to 2 s: mean 30 of 60 rpm"}
    low = verdicts(results)[0]
    assert low.headline.startswith("At 60 rpm, PI-ILC leaves") and "hold" not in " ".join(low.details)
    # of several the one that ends last is told
    inner = RMS.replace("speed_error", "speed_inner") + 'window = ["1 s", "1.5 s"]'
    for both in ((early, inner), (inner, early)):
        lines = compare(ripple_of(slow, *both), "low-speed")
        assert misses(lines) == {"pi-ilc": "speed early, 0.5 to 2 s: mean 30 of 60 rpm"}
    # where that's the window of the verdict, it counts
    low = verdicts(ripple_of(slow, early))[0]
    assert "PI-ILC did not hold the speed in speed early, 0.5 to 2 s: mean 30 of 60 rpm." in low.details


def with_speed_until(results, controller, share, time):
    """The results with a share of the reference's speed until some time, in the runs of a controller."""

    def one(run):
        if run.controller != controller:
            return run
        data = run.trace.data.copy()
        early = run.trace.time <= time
        data[early, run.trace.names.index("omega_m")] = share * run.trace["omega_ref"][early]
        return replace(run, trace=replace(run.trace, data=data))

    return replace(results, runs=[one(run) for run in results.runs])


def missed_of(reference, speed, status=0):
    t = np.arange(len(reference)) / 1000
    signals = np.column_stack([t, reference, speed, np.broadcast_to(status, len(t))])
    trace = Trace(("time", "omega_ref", "omega_m", "status"), ("s", "rad/s", "rad/s", ""), signals)
    return missed(Run("s", "c", trace), slice(0, len(t)), "rad/s")


def test_a_speed_missed_at_the_limit_says_so():
    t = np.arange(1000)
    told = missed_of(
        np.full(1000, 6.0), np.zeros(1000), np.where(t > 600, Status.SATURATED | Status.FROZEN, 0)
    )
    assert told == "mean 0 of 6 rad/s, at the limit of current or voltage"
    told = missed_of(np.full(1000, 6.0), np.zeros(1000), np.where(t < 600, Status.SATURATED, Status.FROZEN))
    assert told == "mean 0 of 6 rad/s"
    for first, at_limit in ((725, True), (775, False)):  # 55 and 45 % of the second half
        told = missed_of(np.full(1000, 6.0), np.zeros(1000), np.where(t >= first, Status.SATURATED, 0))
        assert told.endswith("of current or voltage") == at_limit


def test_a_speed_missed_because_the_monitor_stopped_the_drive_says_so():
    """Stuck from .2 s on, tried again for an eleventh of the time; or no angle: the last speed goes on."""
    t, stuck = np.arange(1000), Status.FAULT | Status.OFF | Status.ANGLE_STUCK
    status = np.where((t > 200) & (t % 110 > 10), stuck, Status.SATURATED)
    told = missed_of(np.full(1000, 6.0), np.zeros(1000), status)
    assert told == (
        "mean 0 of 6 rad/s (the monitor has the output off 71 % of the time, first at 0.201 s: "
        "angle stuck, status bit 64)"
    )
    both = np.where(t < 300, stuck, np.where(t < 900, Status.OFF | Status.FAULT | Status.CURRENT, 0))
    assert missed_of(np.full(1000, 6.0), np.zeros(1000), both).endswith(
        "first at 0 s: angle stuck, status bit 64 and current not plausible, status bit 128)"
    )
    lost = np.where(t > 800, Status.ANGLE_LOST, 0)
    assert missed_of(np.full(1000, 6.0), np.zeros(1000), lost) == (
        "mean 0 of 6 rad/s (the monitor doesn't believe the measured speed 20 % of the time, "
        "first at 0.801 s: angle missing, status bit 16)"
    )
    assert missed_of(np.full(1000, 6.0), np.zeros(1000), np.where(t > 950, stuck, 0)) == "mean 0 of 6 rad/s"


def test_the_verdict_names_the_monitor_where_it_stopped_the_drive():
    """A hub motor starts from rest with a blocked wheel: full current does not overcome the friction."""
    changes = {
        "scenario.walk.initial_speed": "0 rpm", "scenario.walk.duration": "8 s",
        "mechanics.coulomb_friction": "30 N*m", "scenario.walk.controllers": ["pi", "pi-ilc"],
    }  # fmt: skip
    study = load("hub-motor", changes)
    runs = [simulate(study, "walk", controller) for controller in ("pi", "pi-ilc")]
    runs = [replace(run, metrics=measure(study, "walk", run.trace)) for run in runs]
    found = verdicts(Results(study, runs))[0]
    assert found.headline.startswith("At 90 rpm, no controller holds the speed from")
    assert "PI and PI-ILC mean 0 of 90 rpm (the monitor has the output off" in found.headline
    assert "angle stuck, status bit 64)" in found.headline


def test_what_a_speed_missed_is_rounded_to_nothing_below_a_thousandth():
    assert missed_of(np.full(1000, 6.0), np.full(1000, 0.03)) == "mean 0.03 of 6 rad/s"
    assert missed_of(np.full(1000, 6.0), np.full(1000, 0.003)) == "mean 0 of 6 rad/s"


def test_a_reference_that_averages_to_zero():
    sine = np.sin(np.linspace(0, 4 * np.pi, 1000, endpoint=False))
    late = np.sin(np.linspace(0, 4 * np.pi, 1000, endpoint=False) - 0.3)
    assert missed_of(sine, late) is None
    assert missed_of(sine, 0 * sine) == "error 0.707 rad/s rms, reference 0.707 rad/s rms"
    assert missed_of(0 * sine, 0.01 * sine) is None
    assert missed_of(0 * sine, 5 + sine) is not None
    # half of the reference, or without one 0.1 rad/s
    assert missed_of(sine, 0.51 * sine) is None and missed_of(sine, 0.49 * sine) is not None
    assert missed_of(0 * sine, 0 * sine + 0.09) is None and missed_of(0 * sine, 0 * sine + 0.11) is not None
    # a mean below a tenth of its magnitude counts as none
    for ahead, told in ((23, "mean 0 of 0.15 rad/s"), (21, "error 1.00 rad/s rms, reference 1.00 rad/s rms")):
        reference = np.tile(np.where(np.arange(40) < ahead, 1.0, -1.0), 25)
        assert missed_of(reference, 0 * reference) == told


def test_a_start_up_or_a_slow_ripple_in_the_window_is_no_stall():
    reference = np.full(1000, 6.0)
    assert missed_of(reference, np.minimum(6.0, np.arange(1000) * 0.02)) is None
    assert missed_of(reference, np.where(np.arange(1000) < 500, 0.0, 6.0)) is None
    assert missed_of(reference, 6.0 + 3 * np.sin(np.linspace(0, 2 * np.pi, 1000))) is None
    assert missed_of(reference, 3.0 + 3 * np.sin(np.linspace(0, 2 * np.pi, 1000))) is not None


def test_the_last_part_of_a_run_is_a_quarter_or_begins_half_way_after_an_event(made):
    """Of four seconds; without a metric of orders. A metric's window ends at the next event."""

    def span(*events):
        tables = [{"time": f"{t} s", "load": f"{0.1 * (n + 1):.1f} N*m"} for n, t in enumerate(events)]
        study = changed(made.study, {"metric": [], "scenario.step-on.events": tables})
        results, run = replace(made, study=study), made.runs[3]
        return run.trace.time[late(results, run)][[0, -1]], results, run

    for events, begin in (((1.0,), 3.0), ((3.0,), 3.5), ((1.0, 3.6), 3.8)):
        assert span(*events)[0] == pytest.approx([begin, 3.9998], abs=3e-4)
    settling = next(metric for metric in made.study.metrics_in("step-on") if metric.event is not None)
    for events, end in (((2.0,), 3.9998), ((2.0, 3.0), 2.9998)):
        _, results, run = span(*events)
        assert span_of(results, settling, run) == pytest.approx((2.0, end))


# --- waveforms


def test_thinning_keeps_peaks_and_their_time():
    x = np.sin(np.linspace(0, 60, 100_001))
    x[77_777] = 5.0
    x[33_333] = -4.0
    thinned, rows = thin(x, 2000)
    assert len(thinned) <= 2000 and thinned.max() == 5.0 and thinned.min() == -4.0
    assert abs(np.argmax(thinned) * rows - 77_777) <= 2 * rows
    assert abs(np.argmin(thinned) * rows - 33_333) <= 2 * rows
    np.testing.assert_allclose(
        thinned[100:200], x[: len(x)][(np.arange(100, 200) * rows).astype(int)], atol=0.05
    )


@pytest.mark.parametrize("length", [1, 2, 9, 10, 11, 19, 20, 21, 1000])
def test_thinning_of_any_length(length):
    x = np.random.default_rng(length).normal(size=length)
    thinned, rows = thin(x, 10)
    assert len(thinned) <= 10 and (thinned.min(), thinned.max()) == (x.min(), x.max())
    assert length <= len(thinned) * rows < length + 2 * rows + 1


def test_packing_loses_no_more_than_a_step():
    x = np.random.default_rng(0).normal(size=1000)
    x[7] = np.nan
    back = unpack(pack(x))
    assert np.isnan(back[7])
    assert np.nanmax(np.abs(back - x)) <= np.ptp(x[~np.isnan(x)]) / 65534
    assert np.all(unpack(pack(np.full(3, 60.0))) == 60.0)
    assert np.all(np.isnan(unpack(pack(np.full(3, np.nan)))))


# --- spectra


@pytest.mark.parametrize("direction", [1, -1])
def test_spectrum_under_acceleration(direction):
    theta = direction * 2 * np.pi * np.linspace(0, 1, 40_000) ** 1.5 * 3.3
    x = 6 + 0.5 * np.cos(24 * theta) + 0.1 * np.cos(18 * theta + 1)
    amplitudes = order_spectrum(theta, x, 48, pole_pairs=4)
    assert amplitudes[[18, 24]] == pytest.approx([0.1, 0.5], rel=1e-3)
    assert np.max(np.delete(amplitudes, [18, 24])) < 2e-4


def test_spectrum_of_less_than_a_revolution():
    theta = np.linspace(0, np.pi, 5000)
    amplitudes = order_spectrum(theta, np.cos(24 * theta), 48, pole_pairs=4)
    assert amplitudes[24] == pytest.approx(1, rel=1e-3)
    assert np.isnan(amplitudes[23]) and np.isnan(amplitudes[1])
    assert order_spectrum(theta[:100], theta[:100], 48, pole_pairs=4) is None


def test_spectrum_of_a_revolution_without_its_last_row():
    theta = 2 * np.pi * np.arange(1000) / 1000
    assert order_spectrum(theta, np.cos(3 * theta), 12, pole_pairs=4)[3] == pytest.approx(1, rel=1e-2)


def test_turning_back_by_less_than_a_hundredth_is_not_told(made):
    for back, told in ((0.0075, False), (0.0225, True)):  # of 1.5 revolutions
        other = with_angle(
            made, fair_pi=lambda t, back=back: 2 * np.pi * np.interp(t, [0, 9.5, 10], [0, 9.5, 9.5 - back])
        )
        assert bool(turned_back(other, other.runs[:3])) == told


def test_spectrum_of_a_rotor_that_turns_back_is_of_its_longest_way():
    """With net 1.8 revolutions, of which nothing would be seen if ahead and back were mixed."""
    time = np.linspace(0, 5.6, 80_000)
    theta = 2 * np.pi * np.interp(time, [0, 3.3, 5.2, 5.6], [0, 3.3, 1.4, 1.8])
    back = (time > 3.3) & (time <= 5.2)
    x = np.where(back, -6 - 0.9 * np.cos(24 * theta), 6 + 0.5 * np.cos(24 * theta))
    amplitudes = order_spectrum(theta, x, 48, pole_pairs=4)
    assert amplitudes[24] == pytest.approx(0.5, rel=1e-3)
    assert np.max(np.delete(amplitudes, 24)) < 1e-3


def with_angle(results, **angles):
    """The results with other angles over time in "low-speed" of some controllers."""

    def one(run):
        angle = angles.get(run.controller.replace("-", "_"))
        if angle is None or run.scenario != "low-speed":
            return run
        data = run.trace.data.copy()
        data[:, run.trace.names.index("theta_m")] = angle(run.trace.time)
        return replace(run, trace=replace(run.trace, data=data))

    return replace(results, runs=[one(run) for run in results.runs])


def spectra_part(page):
    return re.search(r'<section data-part="spectra">(.*?)</section>', page, re.S)[1]


def test_spectra_say_who_turns_back_and_who_has_none_and_why(made, page):
    """The window is from 8 to 10 s."""
    assert "turns back" not in spectra_part(page) and "no bars" not in spectra_part(page)
    other = with_angle(
        made,
        fair_pi=lambda t: 2 * np.pi * np.interp(t, [0, 9.5, 10], [0, 9.5, 9.25]),
        pi_ilc=lambda t: 0.01 * t,
    )
    told = render(other)
    low = data_of(told)["scenarios"][0]
    assert [s["controller"] for s in low["spectra"][0]["series"]] == [0, 1]
    assert (
        "The rotor turns back between 8 and 10 s. Only the longest travel in one direction counts: "
        "PI re-tuned 1.50 of 1.75 revolutions."
    ) in spectra_part(told)
    assert (
        "PI-ILC has no bars: between 8 and 10 s it turns less than an electrical revolution in one "
        "direction, 0.00318 of 0.00318 revolutions."
    ) in spectra_part(told)
    lost = spectra_part(render(with_angle(made, pi=lambda t: np.where(t > 9, np.nan, t))))
    assert "PI as published has no bars: between 8 and 10 s not all of its numbers are finite." in lost


# --- page


class Checker(HTMLParser):
    """Collects tags and what would be loaded from elsewhere; fails on elements that don't close."""

    VOID = ("meta", "input", "br", "link")

    def __init__(self):
        super().__init__()
        self.open, self.loaded = [], []

    def handle_starttag(self, tag, attributes):
        self.loaded += [value for name, value in attributes if name in ("src", "href") and tag != "a"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_one_offline_file(page):
    checker = Checker()
    checker.feed(page)
    assert checker.open == [] and checker.loaded == []
    assert not re.search(r"\b(None|nan)\b(?! of)", re.sub(r"<script.*?</script>", "", page, flags=re.S))
    assert "url(" not in page and "@import" not in page
    assert len(page) < 3_000_000
    assert page.index("7.52 times less") < page.index('class="numbers"') < page.index('data-part="waveforms"')
    for text in (
        "seed 7",
        "numpy",
        "Not in the datasheet",
        "2.5e-4 kg*m^2",
        "[controller.pi-ilc]",
        "(baseline)",
    ):
        assert text in page


def test_every_section_has_its_note(page):
    notes = [
        order_charts.SPECTRA_NOTE,
        map_charts.MAP_NOTE,
        angle_charts.PERIODS_NOTE,
        angle_charts.CRITERION_NOTE,
        angle_charts.SENSITIVITY_NOTE,
    ]
    notes += [order_charts.TRACKING_NOTE, order_charts.WATERFALL_NOTE]
    assert [text for text in notes if escape(text) not in page] == []
    assert "RMS of each term of the current reference late in scenario low-speed. The varying part is" in page


def test_settings_are_those_of_the_file(made):
    """A table each for a scenario and a controller; lists of tables in one line; no title, no seed."""
    page = settings(made.study)
    groups = dict(re.findall(r"<h3><code>\[(.*?)\]</code></h3>(.*?)</table>", page))
    assert list(groups) == [
        "trace", "motor", "mechanics", "drive", "scenario.low-speed", "scenario.step-on",
        "controller.pi", "controller.fair-pi", "controller.pi-ilc", "metric",
    ]  # fmt: skip
    shown = {name: dict(re.findall(r"<th>(.*?)</th><td>(.*?)</td>", rows)) for name, rows in groups.items()}
    assert shown["trace"] == {"rate": "15 kHz"}
    assert shown["motor"]["pole_pairs"] == "4"
    assert shown["motor"]["cogging"] == "order 24, torque 4 mN*m; order 18, torque 2 mN*m, phase 30 deg"
    assert shown["drive"]["rates.current_loop"] == "15 kHz"
    assert shown["scenario.step-on"]["events"] == "time 2 s, load 0.6 N*m"
    assert shown["controller.pi"]["baseline"] == "yes"
    assert shown["controller.fair-pi"]["tuning.phase_margin"] == "60 deg"
    assert shown["metric"]["dip"] == "kind dip; event 2 s; unit rpm"
    assert shown["metric"]["speed_orders"].startswith("kind order; signal omega_m; order 1, 2, 6; frame ")
    reasons = dict(re.findall(r"<tr><th><code>(.*?)</code></th><td>(.*?)</td></tr>", assumptions(made.study)))
    assert list(reasons) == ["mechanics.inertia", "drive.current_loop"]
    assert reasons["drive.current_loop"].startswith("The printed gains are 20 times too slow")
    assert assumptions(made.study.model_copy(update={"assumption": ()})) == ""


def test_page_data(page):
    low, step = data_of(page)["scenarios"]
    titles = [panel["title"] for panel in low["waveforms"]["panels"]]
    assert len(titles) == 4 and titles[-1].startswith("Learned part")
    assert all(panel["unit"] for panel in low["waveforms"]["panels"])
    last = ["last two revolutions", "last revolution"]
    assert [zoom["name"] for zoom in low["zooms"]] == ["whole run", "after start-up", *last]
    assert [zoom["name"] for zoom in step["zooms"]] == ["whole run", *last, "event at 2 s"]
    assert [zoom["name"] for zoom in low["zooms"] if "first" in zoom] == ["last revolution"]
    assert not any("first" in zoom for zoom in step["zooms"])
    electrical, mechanical = low["spectra"]
    assert electrical["series"][0]["values"][5] == pytest.approx(4.8, rel=1e-3)
    assert electrical["orders"] == list(range(1, 13))
    assert 18 in mechanical["orders"]
    assert "early" in electrical["series"][2] and "early" not in electrical["series"][0]
    assert len(low["maps"]) == 1 and low["maps"][0]["x"] == "electrical angle (°)"
    assert low["events"] == [] and len(step["events"]) == 1
    event = step["events"][0]
    assert event["start"] == pytest.approx(-0.1, abs=2e-3)
    assert event["panels"][0]["title"] == "Speed, load to 0.6 N·m at 2 s"


def test_page_data_are_the_rows_of_the_runs(made, page):
    """At 60 rpm a revolution takes a second; rows are 0.2 ms apart, and 10 s of them are drawn in 20,000."""
    shown = data_of(page)
    assert shown["controllers"] == [
        {"label": "PI as published", "colour": 0}, {"label": "PI re-tuned", "colour": 1},
        {"label": "PI-ILC", "colour": 2},
    ]  # fmt: skip
    low, step = shown["scenarios"]
    assert [(z["name"], z["from"], z["to"]) for z in low["zooms"]] == [
        ("whole run", 0.0, 9.9998), ("after start-up", pytest.approx(0.156, abs=2e-3), 9.9998),
        ("last two revolutions", pytest.approx(8.0, abs=1e-3), 9.9998), ("last revolution", 9.0, 9.9998),
    ]  # fmt: skip
    assert [(z["from"], z["to"]) for z in step["zooms"]] == [
        (0.0, 3.9998), (pytest.approx(2.0, abs=1e-3), 3.9998), (3.0, 3.9998), (1.9, 3.0)
    ]  # fmt: skip
    assert low["marks"] == low["strip"] == low["criterion"] == low["angle"] == low["waterfall"] == []
    # five rows in a bucket, whose two values stand at a quarter and three quarters of it
    waves = low["waveforms"]
    assert (waves["x"], waves["start"], waves["step"]) == (
        "time (s)",
        pytest.approx(1.5e-4),
        pytest.approx(5e-4),
    )
    assert waves["details"] == []
    speed, current, torque, learned = waves["panels"]
    assert [(p["title"].split(",")[0], p["quantity"], p["unit"]) for p in waves["panels"]] == [
        ("Speed", "speed", "rpm"), ("Current reference", "i_q_ref", "A"),
        ("Torque of the motor", "torque", "N·m"), ("Learned part of the current reference", "current", "A"),
    ]  # fmt: skip
    assert [s.get("controller") for s in speed["series"]] == [0, 1, 2, None] and speed["series"][3]["dash"]
    assert [s["controller"] for s in learned["series"]] == [2]
    trace = made.runs[0].trace
    drawn = unpack(speed["series"][0]["values"])
    rows = (trace["omega_m"] * 30 / np.pi).reshape(-1, 5)
    assert np.abs(drawn.reshape(-1, 2).min(axis=1) - rows.min(axis=1)).max() <= 2e-3
    assert np.abs(drawn.reshape(-1, 2).max(axis=1) - rows.max(axis=1)).max() <= 2e-3
    reference = unpack(speed["series"][3]["values"])
    assert reference.shape == (20_000,) and np.abs(reference - 60.0).max() <= 6e-5
    assert len(unpack(step["waveforms"]["panels"][0]["series"][0]["values"])) == 20_000  # all rows
    assert (step["waveforms"]["start"], step["waveforms"]["step"]) == (0.0, pytest.approx(2e-4))
    assert unpack(torque["series"][0]["values"]).max() == pytest.approx(
        np.max(trace["tau_e"] + trace["tau_cogging"]), abs=1e-5
    )
    assert unpack(current["series"][0]["values"]).max() == pytest.approx(np.max(trace["i_q_ref"]), abs=1e-5)
    (learned_map,) = low["maps"]
    assert (learned_map["title"], learned_map["unit"], len(learned_map["angle"])) == (
        "Learned current",
        "A",
        257,
    )
    angle = np.array(learned_map["angle"])
    assert (angle[0], angle[-1]) == (0.0, 360.0)
    (series,) = learned_map["series"]
    assert series["controller"] == 2
    assert series["values"] == pytest.approx(0.02 * np.cos(6 * np.radians(angle)), abs=1e-5)
    (event,) = step["events"]
    assert event["x"] == "time since the event (s)" and [p["title"] for p in event["panels"]] == [
        "Speed, load to 0.6 N·m at 2 s", "Current reference, load to 0.6 N·m at 2 s"
    ]  # fmt: skip
    assert (
        event["step"] == pytest.approx(1.4e-3)
        and len(unpack(event["panels"][0]["series"][0]["values"])) <= 1200
    )
    magnitude, phase = low["bode"]
    assert (magnitude["unit"], phase["unit"]) == ("dB", "°")
    assert (
        magnitude["frequency"][0] == 0.1 and magnitude["frequency"][-1] == 450.0
    )  # a tenth of 1 rev/s; 0.45 kHz
    assert len(magnitude["frequency"]) == 400
    assert [(s["controller"], s["label"], s["fade"]) for s in phase["series"]] == [
        (0, "", 1.0), (1, "", 1.0), (2, "off", 0.55), (2, "on", 1.0), (2, "between", 0.25)
    ]  # fmt: skip
    assert magnitude["series"][0]["values"][0] < -20 and abs(magnitude["series"][0]["values"][-1]) < 1


def test_an_event_is_drawn_if_more_than_ten_periods_follow_it(made):
    runs = [run for run in made.runs if run.scenario == "step-on"]
    (event,) = made.study.scenario["step-on"].events
    at = runs[0].trace.window(0.0, event.time).stop
    for rows, drawn in ((at + 8, 0), (at + 15, 1)):
        ended = [replace(run, trace=short(run.trace, rows)) for run in runs]
        assert len(room.events(made, ended)) == drawn


def test_waveforms_lie_in_time(page):
    """The first value of a waveform stands for the run's start, the last for its end."""
    waveforms = data_of(page)["scenarios"][0]["waveforms"]
    speed, *_, reference = waveforms["panels"][0]["series"]
    assert reference["dash"] and np.all(unpack(reference["values"]) == pytest.approx(60))
    values = unpack(speed["values"])
    end = waveforms["start"] + waveforms["step"] * (len(values) - 1)
    assert end == pytest.approx(10, abs=0.01) and waveforms["start"] == pytest.approx(0, abs=0.01)
    first_above_30 = waveforms["start"] + waveforms["step"] * int(np.argmax(values > 30))
    assert first_above_30 == pytest.approx(0.05 * np.log(2), abs=0.01)


def test_the_last_revolutions_have_finer_points(made, monkeypatch):
    monkeypatch.setattr(room, "WAVEFORM_POINTS_MOST", 2000)
    low = data_of(render(made))["scenarios"][0]
    waveforms, zoom = low["waveforms"], next(z for z in low["zooms"] if z["name"] == "last two revolutions")
    (detail,) = waveforms["details"]
    assert detail["start"] == pytest.approx(zoom["from"], abs=2e-3)
    assert detail["step"] < 0.5 * waveforms["step"]
    for panel in waveforms["panels"]:
        for series in panel["series"]:
            values = unpack(series["details"][0])
            assert detail["start"] + detail["step"] * (len(values) - 1) == pytest.approx(10, abs=2e-3)
    speed = unpack(waveforms["panels"][0]["series"][-2]["details"][0])
    time = detail["start"] + detail["step"] * np.arange(len(speed))
    run = next(run for run in made.runs if run.controller == "pi-ilc")
    expected = np.interp(time, run.trace.time, run.trace["omega_m"]) * 60 / (2 * np.pi)
    np.testing.assert_allclose(speed, expected, atol=0.2)


def test_text_of_the_user_is_escaped(tmp_path):
    nasty = '</script><script>alert(1)</script><!-- & \\" $title'
    text = synthetic.STUDY.replace("Torque ripple at 60 r/min", nasty).replace("PI-ILC", nasty)
    text = text.replace("Not in the datasheet", nasty).replace("A small motor", nasty)
    page = render(synthetic.results(synthetic.study(tmp_path, text), rate=1000))
    assert "alert(1)</script>" not in page and "<!--" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert data_of(page)["controllers"][2]["label"] == nasty.replace("\\", "")
    checker = Checker()
    checker.feed(page)
    assert checker.open == []


def test_page_of_an_interrupted_study_and_of_none(made):
    first = Results(made.study, made.runs[:1], interrupted=True)
    assert "Interrupted" in render(first)
    assert data_of(render(Results(made.study, [], interrupted=True)))["scenarios"] == []


@pytest.mark.parametrize("rows", [1, 2, 50])
def test_page_of_short_runs(made, rows):
    def one(run):
        return Run(run.scenario, run.controller, short(run.trace, rows), run.memory, {})

    page = render(Results(made.study, [one(run) for run in made.runs]))
    assert "No controller can be judged" in page


def spoilt(run, value, since):
    data = run.trace.data.copy()
    data[since:, 1:] = value
    memory = {**run.memory, "current": run.memory["current"] * value} if run.memory else {}
    return replace(run, trace=replace(run.trace, data=data), memory=memory)


def diverged(results, value, since):
    """The results with a value from some row on in the traces of PI-ILC, its map and two of its metrics."""
    runs = [spoilt(run, value, since) if run.controller == "pi-ilc" else run for run in results.runs]
    metrics = {name: value for name in ("speed_ripple_rad_s", "copper_loss_W")}
    runs[2] = replace(runs[2], metrics={**runs[2].metrics, **metrics})
    return replace(results, runs=runs)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_page_of_a_diverged_run(made, tmp_path, monkeypatch, value):
    """Without a warning too: they are errors here."""
    spoilt_results = diverged(made, value, since=5000)
    page = render(spoilt_results)
    assert len(data_of(page)["scenarios"]) == 2
    assert "PI-ILC did not hold the speed in " in page
    slow = [run for run in spoilt_results.runs if run.scenario == "low-speed"]
    if np.isnan(value):  # a plot draws what isn't finite alike
        assert len(write_plots(Results(made.study, slow), tmp_path)) == 4
    elif value == 1e300:  # and only a map has such a number
        monkeypatch.delitem(SPEED_PICTURES, "waveforms")
        monkeypatch.delitem(SPEED_PICTURES, "spectra")
        monkeypatch.delitem(SPEED_PICTURES, "revolution")
        assert len(write_plots(Results(made.study, slow), tmp_path)) == 1


@pytest.fixture(scope="module")
def coarse(made):
    """The results of `made` with every fifth row."""
    runs = [replace(run, trace=replace(run.trace, data=run.trace.data[::5])) for run in made.runs]
    return replace(made, runs=runs)


@pytest.mark.parametrize("since", [0, 1, 9_800])
@pytest.mark.parametrize("value", [np.nan, 1e300])
def test_page_of_a_run_that_diverges_at_once_or_at_its_end(coarse, value, since):
    page = render(diverged(coarse, value, since))
    assert len(data_of(page)["scenarios"]) == 2
    assert "PI-ILC did not hold the speed in " in page


def test_page_of_runs_without_traces(made):
    """As rollout leaves them."""
    bare = Results(made.study, [replace(run, trace=short(run.trace, 0)) for run in made.runs])
    page = render(bare)
    assert "7.52 times less" in page
    assert data_of(page)["scenarios"][0]["waveforms"]["panels"] == []
    nothing_learned = {"angle": np.zeros(0), "current": np.zeros(0), "frame": "electrical"}
    empty = [replace(run, memory=nothing_learned) for run in made.runs]
    assert data_of(render(Results(made.study, empty)))["scenarios"][0]["maps"] == []


def test_runs_of_different_speeds(made):
    """A slow rotor's orders stand beside the others', as far as its window holds them."""
    slow = made.runs[2].trace.data.copy()
    slow[:, made.runs[2].trace.names.index("theta_m")] *= 0.1
    runs = [made.runs[0], replace(made.runs[2], trace=replace(made.runs[2].trace, data=slow))]
    electrical, mechanical = data_of(render(Results(made.study, runs)))["scenarios"][0]["spectra"]
    assert len(electrical["series"]) == 1  # 0.2 mechanical, 0.8 electrical revolutions: no order to be had
    slow[:, made.runs[2].trace.names.index("theta_m")] *= 3
    electrical, mechanical = data_of(render(Results(made.study, runs)))["scenarios"][0]["spectra"]
    assert len(electrical["series"]) == 2
    assert mechanical["series"][1]["values"][mechanical["orders"].index(18)] is None


def test_page_of_a_standing_rotor(made):
    data = made.runs[0].trace.data.copy()
    data[:, 1:] = 0
    run = replace(made.runs[0], trace=replace(made.runs[0].trace, data=data))
    assert data_of(render(Results(made.study, [run])))["scenarios"][0]["spectra"] == []


def test_page_is_small(made, tmp_path):
    write(made, tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < 3_000_000


def test_plots(made, tmp_path, monkeypatch):
    drawn = []

    def keep(canvas, path, **options):
        drawn.append(canvas.figure)
        if len(drawn) == 8:  # rendering takes longer than all else: the last one is enough
            print_png(canvas, path, **options)
        path.touch()

    print_png = FigureCanvasAgg.print_png
    monkeypatch.setattr(FigureCanvasAgg, "print_png", keep)
    written = write_plots(made, tmp_path)
    assert {path.name for path in written} == {
        f"{scenario}-{kind}.png"
        for scenario in ("low-speed", "step-on")
        for kind in ("waveforms", "spectra", "map", "revolution")
    }
    assert written[-1].read_bytes().startswith(b"\x89PNG")
    figures = {path.name: figure for path, figure in zip(written, drawn, strict=True)}
    assert sorted(tmp_path.iterdir()) == sorted(written)
    rows = {"waveforms": 4 * 1.7, "spectra": 2 * 2.6, "map": 2.6}  # in; spectra of speed and current
    for kind, height in rows.items():
        figure = next(figure for name, figure in figures.items() if f"low-speed-{kind}" in name)
        assert figure.get_size_inches()[1] == pytest.approx(0.9 + height)
    # one legend below, each controller once, in the colour of its lines
    labels = [made.study.label(name) for name in made.study.controllers_in("low-speed")]
    figure = next(figure for name, figure in figures.items() if "low-speed-waveforms" in name)
    (legend,) = figure.legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert [text for text in texts if text in labels] == labels and len(set(texts)) == len(texts)
    colours = {line.get_label(): line.get_color() for axes in figure.axes for line in axes.get_lines()}
    shown = {text: line.get_color() for text, line in zip(texts, legend.get_lines(), strict=True)}
    assert shown == {text: colours[text] for text in texts}
    assert len({shown[label] for label in labels}) == len(labels)
    # each panel over two spans of time; what is the same below or at the left is said once
    assert [axes.get_xlabel() for axes in figure.axes] == ["", ""] * 3 + [
        "time (s), after start-up", "time (s), last revolution"
    ]  # fmt: skip
    assert [bool(axes.get_ylabel()) for axes in figure.axes] == [True, False] * 4
    assert figure.axes[1].get_lines()[0].get_xdata()[[0, -1]] == pytest.approx([9.0, 9.9998], abs=1e-3)
    # bars of an order side by side about its place, which has no line of the grid
    electrical, _ = next(figure for name, figure in figures.items() if "low-speed-spectra" in name).axes
    assert [text.get_text() for text in electrical.get_xticklabels()] == [f"{n}" for n in range(1, 13)]
    sixth = [bars[5] for bars in electrical.containers]
    assert [bar.get_x() + bar.get_width() / 2 for bar in sixth] == pytest.approx([4.74, 5.0, 5.26])
    assert [bar.get_width() for bar in sixth] == pytest.approx([0.92 * 0.26] * 3)
    assert sixth[0].get_height() == pytest.approx(4.8, rel=1e-3)
    (left, right), whole = electrical.get_xlim(), 11 + 2 * (0.26 + 0.13 * 0.92)
    assert (left, right) == pytest.approx((5.5 - 0.55 * whole, 5.5 + 0.55 * whole))
    assert not any(line.get_visible() for line in electrical.get_xgridlines())
    assert all(line.get_visible() for line in electrical.get_ygridlines())
