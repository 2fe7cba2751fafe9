"""The report of studies that learn in angle: errors in their frame, growth, the criterion's curve."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_report import data_of

from cogless import load
from cogless.design.verdict import judged, verdict, warnings
from cogless.errors import StudyError
from cogless.report import render, verdicts
from cogless.report.angle_charts import growth, over_angle, sentences, worse_since
from cogless.report.charts import to_page
from cogless.report.comparison import compare
from cogless.report.markup import asset
from cogless.report.panels import errors, periods
from cogless.report.waveforms import needed_current
from cogless.results import Results, Run
from cogless.results.trace import Trace
from cogless.run import simulate
from cogless.run.carry_out import measure
from cogless.study import changed
from cogless.study.laws.space import Period


@pytest.fixture(scope="module")
def made():
    study = load("verrelli2016")
    names = ("pi", "printed", "filtered")
    return Results(study, [simulate.simulate(study, "twelve-seconds", name) for name in names])


def with_line(run, frequency, amplitude, since):
    """The run with a line in i_q and a speed error that begin at a time."""
    data = run.trace.data.copy()
    time = run.trace.time
    line = np.where(time > since, amplitude * np.sin(2 * np.pi * frequency * time), 0.0)
    for name in ("i_q", "omega_m", "omega_measured"):
        data[:, run.trace.names.index(name)] += line
    return replace(run, trace=replace(run.trace, data=data))


def test_errors_are_in_the_frame_of_the_metrics(made):
    speed, angle = errors(made, made.runs)
    assert (speed.signal, speed.ratio, angle.signal) == ("omega_error", 50, "theta_error")
    assert speed.title == "Speed error, electrical"
    part = made.runs[0].trace.window(3, 5)
    drawn = np.ptp(speed.displayed(made.runs[0].trace)[part])
    assert drawn == pytest.approx(made.runs[0].metrics["speed_before_rad_s"], rel=0.01)
    assert compare(made, "twelve-seconds")[0].title == "speed before (electrical)"


def test_a_law_that_may_not_learn_does_not(made):
    assert [made.study.controller[run.controller].learned for run in made.runs] == [False, True, True]
    assert periods(made, made.runs[0]) is None
    turns = periods(made, made.runs[2])
    assert turns[-1] == pytest.approx(12 * 0.3 / (2 * np.pi / 50), rel=0.02)


def test_what_was_learned_comes_to_what_was_needed(made):
    run = made.runs[2]
    needed = needed_current(made, run)(slice(None))
    late = run.trace.window(8, 12)
    learned = sum(run.trace[name] for name in ("term_alpha", "term_beta", "term_h"))
    assert np.std((needed - learned)[late]) < 0.1 * np.std(needed[late])


def test_growth_is_told_from_what_is_learned(made):
    pi, _, filtered = made.runs
    assert growth(made, filtered) is None and growth(made, pi) is None
    grown = with_line(filtered, 300, 1.0, 9.0)
    assert growth(made, grown) == pytest.approx(300, abs=2)
    assert worse_since(grown, pi, "omega_error") == 8.0  # windows of 2 s
    assert worse_since(filtered, pi, "omega_error") is None


def test_the_verdict_calls_what_gets_worse(made):
    pi, printed, filtered = made.runs
    text = " ".join(
        verdicts(replace(made, runs=[pi, with_line(printed, 400, 1.0, 9.0), filtered]))[0].details
    )
    assert (
        "printed scheme gets worse with time: until 8 s it is no worse than “PI, as published”, then" in text
    )
    found = verdict(made.study, "printed")
    assert f"grows at 400 Hz, as cogless design says ({found.short()})" in text
    # of what cogless design doesn't see it's said too
    unforeseen = replace(made, runs=[pi, with_line(filtered, 400, 1.0, 9.0)])
    text = " ".join(verdicts(unforeseen)[0].details)
    assert "which cogless design does not foresee" in text
    fine = verdicts(made)[0]
    assert "Worse" not in " ".join(fine.details) and "speed after" in fine.headline


def test_a_current_that_grows_as_the_design_says_is_told_where_the_error_is_no_worse(made):
    """Not of a law that design says settles: its line is then nothing that it has learned."""
    pi, *learning = made.runs
    grown = [with_line(run, 400, 1.0, 9.0) for run in learning]
    said = verdict(made.study, "printed").short()
    assert sentences(made, [pi, *grown], {}) == [
        f"The current of printed scheme grows at 400 Hz, as cogless design says ({said})."
    ]


def with_error(run, other, ratio, since, metric):
    """The run with the other's error, so many times as large from a time on; `metric`: times its metrics."""
    data, names = run.trace.data.copy(), run.trace.names
    reference, late = other.trace["omega_ref"], np.where(run.trace.time < since, 0.5, ratio)
    for name in ("omega_m", "omega_measured"):
        data[:, names.index(name)] = reference - late * (reference - other.trace["omega_m"])
    metrics = {name: metric * value for name, value in other.metrics.items()}
    return replace(run, trace=replace(run.trace, data=data), metrics=metrics)


@pytest.mark.parametrize(("ratio", "since"), [(0.98, None), (1.04, None), (1.06, 6.0), (3.0, 6.0)])
def test_worse_by_less_than_a_tie_is_not_worse(made, ratio, since):
    pi, _, filtered = made.runs
    run = with_error(filtered, pi, ratio, 6.0, 1.0)
    assert worse_since(run, pi, "omega_error") == since
    assert worse_since(with_error(filtered, pi, ratio, 0.0, 1.0), pi, "omega_error") is None  # from the start


def test_a_tie_in_the_end_is_no_blame(made):
    """3 % more for good, from 6 s on: a tie, in the headline and in all that follows."""
    pi, _, filtered = made.runs
    found = verdicts(replace(made, runs=[pi, with_error(filtered, pi, 1.03, 6.0, 1.03)]))[0]
    assert found.tone == "even" and "all are alike: " in found.headline
    assert "orse" not in found.headline + " ".join(found.details)


def test_who_has_grown_does_not_tie(made):
    """20 % more for good: to blame, although the numbers of the metrics are within 5 %."""
    pi, printed, filtered = made.runs
    grown = with_error(filtered, pi, 1.2, 6.0, 1.03)
    found = verdicts(replace(made, runs=[pi, grown]))[0]
    assert found.tone == "worse" and "no controller stays better than “PI, as published”" in found.headline
    assert found.details[0].startswith("filtered map gets worse with time: until 6")
    # nor are all alike where others tie
    tied = with_error(printed, pi, 1.02, 6.0, 1.02)
    found = verdicts(replace(made, runs=[pi, tied, grown]))[0]
    assert found.tone == "even" and "all are alike" not in found.headline
    assert "“PI, as published” and printed scheme tie" in found.headline
    assert found.details[0].startswith("filtered map gets worse with time")


def test_nobody_is_worse_than_a_baseline_that_stands(made):
    """Its error has no ripple at all."""
    pi, _, filtered = made.runs
    data = pi.trace.data.copy()
    data[pi.trace.time > 4, pi.trace.names.index("omega_m")] = 0.0
    data[pi.trace.time > 4, pi.trace.names.index("omega_ref")] = 0.3
    stands = replace(pi, trace=replace(pi.trace, data=data))
    found = verdicts(replace(made, runs=[stands, filtered]))[0]
    assert "did not hold the speed" in found.headline
    assert "gets worse with time" not in " ".join(found.details)


def test_what_gets_worse_is_said_where_the_design_can_tell_nothing(made, monkeypatch):
    def unknown(study, name, scenario):
        raise StudyError("no bounds")

    monkeypatch.setattr("cogless.report.angle_charts.in_scenario", unknown)
    pi, printed, _ = made.runs
    told = verdicts(replace(made, runs=[pi, with_line(printed, 400, 1.0, 9.0)]))[0].details
    (worse,) = (line for line in told if "gets worse with time" in line)
    assert re.search(
        r"until 8 s it is no worse than .*, then it is worse; its current grows at \d+ Hz\.$", worse
    )


def test_what_gets_worse_wins_nothing(made):
    """By its numbers, which are from before it grew, the printed scheme is the best."""
    pi, printed, filtered = made.runs
    best = replace(printed, metrics={k: 0.01 * v for k, v in printed.metrics.items()})
    assert verdicts(replace(made, runs=[pi, best]))[0].tone == "better"
    found = verdicts(replace(made, runs=[pi, with_line(best, 400, 1.0, 9.0), filtered]))[0]
    assert "filtered map leaves" in found.headline and "printed" not in found.headline
    assert found.details[0].startswith("printed scheme gets worse with time: until ")
    alone = verdicts(replace(made, runs=[pi, with_line(best, 400, 0.3, 3.0)]))[0]
    assert alone.tone == "worse"
    assert "no controller stays better than “PI, as published”: it leaves" in alone.headline


def test_at_varying_speed_the_rms_of_the_error_counts(made):
    """Not what omega_m does, most of which is the reference's own motion."""
    study = load(
        "verrelli2016",
        {"metric": [
            {"name": "speed", "kind": "ripple-rms", "signal": "omega_m"},
            {"name": "peak", "kind": "peak-to-peak", "signal": "omega_error", "last": "2 s"},
            {"name": "error", "kind": "rms", "signal": "omega_error", "last": "2 s"},
        ]},
    )  # fmt: skip
    runs = [replace(r, metrics=measure(study, "twelve-seconds", r.trace)) for r in made.runs]
    assert " of error, " in verdicts(Results(study, runs))[0].headline


def test_every_plot_over_time_has_its_axis_named():
    """They are cards of their own, not a stack."""
    assert re.search(
        r"decoded\.forEach\(\(p, i\) => sheet\.panel\(parent, \{\s*\.\.\.about\(\{ x: chart\.x,",
        asset("speed.js"),
    )


def test_the_page_has_the_angle_and_the_criterion(made):
    page = render(made)
    (drawn,) = data_of(page)["scenarios"]
    named = {panel["title"]: panel["quantity"] for panel in drawn["waveforms"]["panels"]}
    assert any(title.startswith("Time of the last period") for title in named)
    assert {"q current", "d current"} <= set(named)
    assert named["Angle error, electrical"] == "angle error"  # the frame is in the title alone
    assert {chart["quantity"] for chart in drawn["angle"]} == {"speed error", "angle error", "current"}
    assert len(drawn["angle"]) == 2 * 3 and len(drawn["angle"][0]["series"]) >= 3
    for chart in drawn["angle"]:  # faint is early, full is late, and each is to be seen
        fades = [s["fade"] for s in chart["series"]]
        assert 0.2 < fades[0] < 0.5 and min(np.diff(fades)) > 0 and fades[-1] == 1
    assert drawn["angle"][0]["x"] == "angle within the period (°)"  # a longer one is cut off on a phone
    assert " over one electrical revolution: " in drawn["angle"][0]["title"]
    assert [s["controller"] for s in drawn["criterion"][0]["series"]] == [1, 1, 2, 2]
    slow, fast = ((float(s["label"].split()[0]), s["fade"]) for s in drawn["criterion"][0]["series"][:2])
    assert slow[0] < fast[0] and (slow[1], fast[1]) == (0.4, 1)
    loops = [one for name in ("printed", "filtered") for one in judged(made.study, "twelve-seconds", name)]
    frequency = np.array(drawn["criterion"][0]["frequency"])  # over all that design looks at
    ends = min(loop.frequencies[0] for loop in loops), max(loop.frequencies[-1] for loop in loops)
    assert (frequency[0], frequency[-1]) == pytest.approx(ends, rel=1e-4)
    for loop, shown in zip(loops, drawn["criterion"][0]["series"], strict=True):
        drawn_to = max(f for f, value in zip(frequency, shown["values"], strict=True) if value is not None)
        assert drawn_to <= loop.highest * (1 + 1e-4) and drawn_to > 0.9 * loop.highest
    highest = [max(v for v in s["values"] if v is not None) for s in drawn["criterion"][0]["series"]]
    assert max(highest[:2]) == pytest.approx(1.71, abs=0.01) and max(highest[2:]) < 1
    assert len(drawn["maps"][0]["series"]) == 1  # neither of the PI nor of the delay line
    assert "Does learning settle?" in page


def test_speeds_and_angles_in_the_units_of_the_study(made):
    """Of a metric each; the criterion's words are those of the study too."""
    metrics = [
        {"name": "speed", "kind": "rms", "signal": "omega_error", "last": "2 s", "unit": "rpm"},
        {"name": "angle", "kind": "rms", "signal": "theta_error", "last": "2 s", "unit": "deg"},
        {"name": "most", "kind": "maximum", "signal": "theta_error", "last": "2 s"},
    ]
    study = load("verrelli2016", {"metric": metrics})
    runs = [replace(r, metrics=measure(study, "twelve-seconds", r.trace)) for r in made.runs]
    pi, printed, filtered = runs
    results = Results(study, [pi, with_line(printed, 400, 1.0, 9.0), filtered])
    speed, angle = errors(results, runs)
    assert (speed.unit, angle.unit) == ("rpm", "deg")
    trace = pi.trace
    assert speed.displayed(trace) == pytest.approx(trace["omega_error"] * 60 / (2 * np.pi))
    assert angle.displayed(trace) == pytest.approx(np.rad2deg(trace["theta_error"]))
    assert [line.unit for line in compare(results, "twelve-seconds")] == ["rpm", "deg", "deg"]
    (drawn,) = data_of(render(results))["scenarios"]
    panels = {p["title"]: p["unit"] for p in drawn["waveforms"]["panels"]}
    assert (panels["Speed error"], panels["Angle error"]) == ("rpm", "deg")
    assert {s["label"] for s in drawn["criterion"][0]["series"]} == {"1.91 rpm", "3.82 rpm"}
    (found,) = verdicts(results)
    words = found.headline + " ".join(found.details)
    assert "rad" not in words and "at 2.45 rpm" in words
    warned = " ".join(map(str, warnings(study, "printed")))
    assert "2.45 rpm" in warned and "rad/s" not in warned


RATE = 400  # rows a second
TURNED = 2 * np.pi / 50  # rad/s of the shaft: one electrical revolution a second


def steady(until, controller="printed", **signals):
    """Results with one run at one electrical revolution a second; learning begins at 5 s."""
    t = np.arange(round(RATE * until)) / RATE
    columns = {
        "time": t,
        "omega_ref": 0 * t + TURNED,
        "omega_m": 0 * t + TURNED,
        "theta_ref": 0.3 + TURNED * t,
    }
    columns |= {"theta_m": columns["theta_ref"], "i_q": 0 * t}
    columns |= {name: value(t) for name, value in signals.items()}
    trace = Trace(tuple(columns), ("",) * len(columns), np.column_stack(list(columns.values())))
    study = load("verrelli2016")
    run = Run("twelve-seconds", controller, trace)
    return Results(study, [run]), run


def learned(**rest):
    """Learned terms that sum to 3 A and 1 A more every second."""
    return {"term_alpha": lambda t: 0 * t + 1, "term_beta": lambda t: 0 * t + 2, "term_h": lambda t: t} | rest


@pytest.mark.parametrize("until", [21.0025, 21.7])
def test_periods_over_the_angle(until):
    """The last period without learning, then ever sparser later ones, and the last whole one."""
    results, run = steady(until, **learned())
    chart = to_page(over_angle(results, [run]))[-1]
    assert chart["title"] == "Learned current over one electrical revolution: printed scheme"
    assert chart["angle"] == list(range(361)) and (chart["quantity"], chart["unit"]) == ("current", "A")
    assert [s["label"] for s in chart["series"]] == [f"period {k}" for k in (5, 6, 8, 12, 21)]
    assert [s["fade"] for s in chart["series"]] == pytest.approx([0.25, 0.4375, 0.625, 0.8125, 1.0])
    for series, k in zip(chart["series"], (5, 6, 8, 12, 21), strict=True):
        assert series["values"] == pytest.approx(3 + k - 1 + np.arange(361) / 360, abs=2e-3)


@pytest.mark.parametrize(
    ("period", "words"),
    [
        (Period(), "one electrical revolution"),
        (Period(of="mechanical"), "one mechanical revolution"),
        (Period(parts=6), "1/6 of one electrical revolution"),
        (Period(of="mechanical", turns=2), "2/1 of one mechanical revolution"),
    ],
)
def test_a_period_in_words(period, words):
    assert period.description == words


def test_one_period_over_the_angle_is_drawn_once():
    """A run that ends as learning begins has one whole period to show: the fifth."""
    results, run = steady(5.5, **learned())
    assert [s["label"] for s in to_page(over_angle(results, [run]))[-1]["series"]] == ["period 5"]
    results, run = steady(0.9, **learned())  # no whole period at all
    assert over_angle(results, [run]) == []


def test_a_reference_that_turns_back_has_no_plot_over_the_angle():
    results, run = steady(12, **learned(theta_ref=lambda t: TURNED * np.minimum(t, 18 - t)))
    assert over_angle(results, [run]) == []


def test_a_reference_that_pauses_has_its_plot_over_the_angle():
    """For two seconds, after eight turns."""
    results, run = steady(12.01, **learned(theta_ref=lambda t: TURNED * np.maximum(np.minimum(t, 8), t - 2)))
    labels = [s["label"] for s in to_page(over_angle(results, [run]))[-1]["series"]]
    assert labels == [f"period {k}" for k in (5, 6, 8, 10)]


def line(early, later, frequency=40.0, first=40.0):
    """1 A, and a sine at `first` Hz that becomes one at `frequency` at 14 s.

    Learning is ramped up until 6 s. In each of four windows of 1600 rows from there on the sine falls on a
    spectral line, and is odd about the middle.
    """

    def current(t):
        angle = 2 * np.pi * (t - 6.0025 - 799.5 / RATE)
        return 1 + np.where(t < 14.001, early * np.sin(first * angle), later * np.sin(frequency * angle))

    return current


@pytest.mark.parametrize(
    ("early", "later", "first", "grew"),
    [
        (2e-3, 9.5e-3, 40.0, None),  # 4.75 times as large
        (2e-3, 10.5e-3, 40.0, 40.0),  # 5.25 times
        (0.0, 4.5e-3, 40.0, None),  # less than 0.5 % of the current
        (0.0, 5.5e-3, 40.0, 40.0),
        (2e-3, 9.5e-3, 22.0, None),  # an octave counts as the same line
        (2e-3, 9.5e-3, 18.0, 40.0),
        (2e-3, 9.5e-3, 78.0, None),
        (2e-3, 9.5e-3, 85.0, 40.0),
    ],
)
def test_a_line_grows_fivefold_and_to_a_share_of_the_current(early, later, first, grew):
    results, run = steady(22.0025, i_q=line(early, later, first=first))
    assert growth(results, run) == (grew and pytest.approx(grew, abs=0.01))


def test_a_drift_of_the_current_is_no_line_that_grows():
    def current(t):  # one bow in the four windows of 1600 rows
        return 1 + np.where(t < 14.001, 0.0, np.sin(np.pi * (t - 14) / 8) ** 2)

    assert growth(*steady(22.0025, i_q=current)) is None


@pytest.mark.parametrize(("bins", "grew"), [(3, 0.75), (4, 1.0)])
def test_the_fourth_line_of_a_spectrum_is_the_slowest_that_counts(bins, grew):
    """Lines are 1/4 Hz apart, with 1600 rows at 400 Hz; what is slower is a drift."""
    assert growth(*steady(22.0025, i_q=line(0.0, 0.5, frequency=bins / 4))) == pytest.approx(grew)


def test_a_current_that_is_no_number_for_a_while_has_no_lines_there():
    def current(t):
        return np.where((t > 11) & (t < 12), np.nan, line(0.0, 0.1)(t))

    assert growth(*steady(22.0025, i_q=current)) == pytest.approx(40.0, abs=0.01)


def test_a_line_grows_in_the_last_of_the_windows_too():
    def current(t):
        return 1 + np.where(t < 18.001, 0.0, 0.1 * np.sin(2 * np.pi * 40 * t))

    assert growth(*steady(22.0025, i_q=current)) == pytest.approx(40.0, abs=0.5)


@pytest.mark.parametrize(
    ("before", "early", "late", "grew"),
    [(10.0, 0.0, 0.04, False), (10.0, 0.0, 0.06, True), (0.0, 1.0, 4e-3, False), (0.0, 1.0, 5e-3, True)],
)
def test_the_current_is_that_before_learning_and_the_lines_that_were_there_when_it_began(
    before, early, late, grew
):
    """A line of 1 A is spread by Hann's window over three, of 1.5 A² together: 0.87 A rms."""

    def current(t):
        steady = np.where(t < 6.001, before, early * np.sin(2 * np.pi * 40 * t))
        return steady + np.where(t < 14.001, 0.0, late * np.sin(2 * np.pi * 150 * t))

    found = growth(*steady(22.0025, i_q=current))
    assert found == (pytest.approx(150.0, abs=0.01) if grew else None)


def test_a_baseline_that_learns_is_not_compared_with_itself():
    results, run = steady(22.0025, i_q=line(0.0, 0.1))
    swapped = changed(results.study, {"controller.pi.baseline": False, "controller.printed.baseline": True})
    assert swapped.baseline == run.controller
    assert growth(replace(results, study=swapped), run) == pytest.approx(40.0, abs=0.01)


def test_64_rows_are_enough_for_a_window():
    def current(t):
        return 1 + np.where(t < 6.1601, 0.0, 0.1 * np.sin(2 * np.pi * 50 * t))

    assert growth(*steady(6.6425, i_q=current)) == pytest.approx(50.0)
    assert growth(*steady(6.64, i_q=current)) is None
    assert growth(*steady(0.0, i_q=current)) is None


def test_three_windows_are_enough_to_tell_since_when_it_is_worse():
    def run(*sizes):
        """Peak to peak, in windows of two seconds."""
        t = np.arange(2000 * len(sizes)) / 1000
        x = np.repeat(sizes, 2000) / 2 * np.sign(np.sin(2 * np.pi * 5 * (t + 1e-6)))
        return Run("low", "any", Trace(("time", "x"), ("s", ""), np.column_stack([t, x])))

    assert worse_since(run(1, 1, 3), run(1, 1, 1), "x") == 4.0
    assert (
        worse_since(run(1, 3), run(1, 1), "x") is None
        and worse_since(run(3, 3, 3), run(1, 1, 1), "x") is None
    )
    assert worse_since(run(1, 3, np.nan), run(1, 1, 1, 1), "x") == 2.0
    assert worse_since(run(1, 1, 1.05), run(1, 1, 1), "x") is None


def test_growth_needs_a_law_that_learns_and_rows():
    assert growth(*steady(22.0025, "pi", i_q=line(2e-3, 1.0))) is None
    assert (
        growth(*steady(5.6, i_q=lambda t: np.sin(2 * np.pi * 40 * t) * (t > 5.2))) is None
    )  # 60 rows a part


def test_the_current_that_a_motion_needs():
    """K_t·i = J·dω/dt + b·ω + c·sign ω + load less cogging, whatever flows and whatever torque that makes."""
    given = {"alpha_ref": 7.0, "tau_load": 0.03, "tau_cogging": 0.02, "tau_e": 0.5, "i_q": 1.25}
    results, run = steady(0.1, **{name: lambda t, v=v: 0 * t + v for name, v in given.items()})
    study = changed(results.study, {"mechanics.coulomb_friction": "0.01 N*m"})
    mechanics, K_t = study.mechanics, 50 * 0.005  # pole pairs times the magnet's flux, two phases
    torque = 7.0 * mechanics.inertia + TURNED * mechanics.viscous_friction + 0.01 + 0.03 - 0.02
    needed = needed_current(Results(study, [run]), run)
    assert needed(slice(3, 5)) == pytest.approx([1.25 + (torque - 0.5) / K_t] * 2, rel=1e-12)
    backwards = replace(run, trace=replace(run.trace, data=run.trace.data * [1, -1, *[1] * 8]))
    torque -= 2 * (TURNED * mechanics.viscous_friction + 0.01)
    needed = needed_current(Results(study, [backwards]), backwards)
    assert needed(slice(0, 1)) == pytest.approx([1.25 + (torque - 0.5) / K_t], rel=1e-12)
