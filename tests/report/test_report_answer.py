"""The answer that a report opens with: two figures, a revolution before and after, ripple over the time."""

import re
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
import synthetic
from browser import MISSING, browser
from test_report import data_of, with_metrics
from test_report_layout import RECORD, TEXTS
from test_report_orders import with_signals

from cogless.report import render, write, write_plots
from cogless.report.answer import answer, pictures
from cogless.report.charts import to_page
from cogless.report.comparison import runs_in
from cogless.report.markup import unpack
from cogless.report.trials import answer as trial_answer
from cogless.results import Results

RATE = 5000
RPM = np.pi / 30


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return synthetic.results(synthetic.study(tmp_path_factory.mktemp("study")), rate=RATE)


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    return synthetic.trial_results(synthetic.study(tmp_path_factory.mktemp("trials"), synthetic.TRIALS))


def low(results):
    return runs_in(results, "low-speed")


def ripple_at(degrees, amplitudes):
    """The formula of `synthetic.trace`, r/min: four pole pairs, orders 1, 2, 6, and the mechanical 18."""
    theta = np.deg2rad(degrees)
    parts = [a * np.cos(4 * n * theta + n) for n, a in zip((1, 2, 6), amplitudes, strict=True)]
    return 60 + sum(parts) + 0.3 * np.cos(18 * theta)


def rms_of(amplitudes):
    return sqrt(sum(a**2 for a in (*amplitudes, 0.3)) / 2)


BEFORE, AFTER = synthetic.CHARACTER["pi"][0], synthetic.CHARACTER["pi-ilc"][1]


def test_the_figures_are_those_of_the_metric_that_judges(made):
    found = answer(made, low(made))
    values = {run.controller: run.metrics["speed_ripple_rad_s"] / RPM for run in low(made)}
    assert [name for name, *_ in found.figures] == ["pi", "pi-ilc"]
    for name, _, text in found.figures:
        number, unit = text.split(" ")
        assert (float(number), unit) == (pytest.approx(values[name], rel=5e-3), "rpm")
    assert found.change == f"{values['pi'] / values['pi-ilc']:.3g} times less"
    assert found.quantity == "speed ripple, 8 to 10 s"


def test_a_revolution_is_drawn_by_the_rotors_angle(made):
    turn = to_page(pictures(made, low(made)))[0]
    assert (turn["x"], turn["unit"]) == ("angle of the rotor (°)", "rpm")
    degrees = turn["start"] + turn["step"] * np.arange(2161)
    assert degrees[-1] == pytest.approx(360)
    for series, amplitudes in zip(turn["series"], (BEFORE, AFTER), strict=True):
        drawn = unpack(series["values"])
        assert np.max(np.abs(drawn - ripple_at(degrees, amplitudes))) < 0.02
    assert [s["text"].split(" ")[1] for s in turn["series"]] == ["rpm", "rpm"]


def test_a_rotor_that_turns_the_other_way_is_drawn_at_the_same_angles(made):
    backward = with_signals(made, "low-speed", theta_m=lambda run: -run.trace["theta_m"])
    backward = with_signals(backward, "low-speed", omega_ref=lambda run: -run.trace["omega_ref"])
    drawn = [unpack(to_page(pictures(r, low(r)))[0]["series"][0]["values"]) for r in (made, backward)]
    assert np.max(np.abs(drawn[1] - drawn[0][::-1])) < 0.05


def test_the_strongest_order_counts_the_cycles(made):
    """Order 6 of four pole pairs; the others are below a third of it."""
    assert to_page(pictures(made, low(made)))[0]["cycles"] == 24


def test_the_ripple_over_the_time_is_the_rms_of_a_revolution(made):
    chart = to_page(pictures(made, low(made)))[1]
    assert chart["title"].startswith("Speed ripple, rms of the last revolution")
    assert chart["start"] == pytest.approx(1.0, abs=0.02) and len(chart["series"]) == 3
    pi, _, ilc = (np.array(series["values"]) for series in chart["series"])
    time = chart["start"] + chart["step"] * np.arange(len(pi))
    assert time[-1] == pytest.approx(10.0, abs=0.02)
    assert pi[time > 2] == pytest.approx(rms_of(BEFORE), rel=0.01)
    assert ilc[-1] == pytest.approx(rms_of(AFTER), rel=0.01)
    assert np.all(np.diff(ilc[time > 1.5]) < 0.002) and ilc[0] > 3 * ilc[-1]


def test_a_varying_reference_is_judged_by_its_error_whose_mean_counts(tmp_path):
    text = synthetic.STUDY.replace(
        'kind = "peak-to-peak"\nsignal = "omega_m"', 'kind = "rms"\nsignal = "omega_error"'
    )
    made = synthetic.results(synthetic.study(tmp_path, text), rate=RATE)
    off = with_signals(made, "low-speed", omega_m=lambda run: run.trace["omega_ref"] + 2 * RPM)
    turn, ripple = to_page(pictures(off, low(off)))
    assert turn["quantity"] == "speed error" and ripple["quantity"] == "speed error, rms"
    assert np.array(ripple["series"][0]["values"]) == pytest.approx(2.0, rel=1e-3)


def test_a_rotor_that_turns_less_is_drawn_over_the_time(made):
    still = with_signals(made, "low-speed", theta_m=lambda run: 1e-3 * run.trace["theta_m"])
    chart = to_page(pictures(still, low(still)))[0]
    values = unpack(chart["series"][0]["values"])
    assert chart["x"] == "time (s)" and chart["cycles"] == 0
    assert (chart["start"], chart["start"] + chart["step"] * len(values)) == pytest.approx((9, 10), abs=0.01)


def test_a_dip_is_drawn_about_its_event(made):
    runs = runs_in(made, "step-on")
    chart = to_page(pictures(made, runs))[0]
    values = unpack(chart["series"][0]["values"])
    assert (chart["x"], chart["start"]) == ("time (s)", pytest.approx(1.9))
    assert chart["start"] + chart["step"] * len(values) == pytest.approx(3.5, abs=0.01)
    assert 60 - values.min() == pytest.approx(float(answer(made, runs).figures[0][2].split(" ")[0]), abs=6)


def test_a_run_whose_speed_was_lost_is_compared_with_nothing(made):
    """A rotor that stands has no ripple, and that is no success."""
    standing = with_signals(
        made, "low-speed", omega_m=lambda run: run.trace["omega_m"] * (run.controller != "pi")
    )
    found = answer(standing, low(standing))
    assert found.change == "" and found.figures[0][0] == "pi"


def test_one_controller_has_one_line_and_one_figure(made):
    alone = Results(made.study, low(made)[:1])
    assert [name for name, *_ in answer(alone, alone.runs).figures] == ["pi"]
    assert [len(chart["series"]) for chart in to_page(pictures(alone, alone.runs))] == [1, 1]
    assert "→" not in re.sub(r"<script.*", "", render(alone), flags=re.S)


def test_infinite_values_have_no_factor(made):
    wild = with_metrics(made, pi={"speed_ripple_rad_s": None})
    assert answer(wild, low(wild)).change == ""


def test_the_guards_hold_is_marked(made):
    """It takes what is learned away for a while: the ripple is back, and a reader asks why."""
    bits = lambda run: 2048.0 * ((run.trace.time > 4) & (run.trace.time < 6)) * (run.controller == "pi-ilc")  # noqa: E731
    guarded = with_signals(made, "low-speed", status=bits)
    held = to_page(pictures(guarded, low(guarded))[1])["held"]
    assert [(round(h["from"], 2), round(h["to"], 2), h["label"]) for h in held] == [
        (4, 6, "the guard holds PI-ILC back")
    ]
    assert pictures(made, low(made))[1].holds == []


def test_a_hold_in_which_the_ripple_rises_is_named_a_test(made):
    """The guard takes away what is learned once, to see what the feedback alone leaves; that is no fault."""

    def speed(run):
        time = run.trace.time
        learns = run.controller == "pi-ilc"
        size = np.where(learns & ~((time > 4) & (time < 6)), 0.1, 1.0)
        return 6.0 + size * np.sin(40 * time)

    bits = lambda run: 2048.0 * ((run.trace.time > 4) & (run.trace.time < 6)) * (run.controller == "pi-ilc")  # noqa: E731
    tested = with_signals(made, "low-speed", status=bits, omega_m=speed, omega_measured=speed)
    held = to_page(pictures(tested, low(tested)))[1]["held"]
    assert [h["label"] for h in held] == ["test: PI-ILC without learning"]


def test_the_first_and_last_trial_of_the_phase_that_began_worst(trials):
    runs = trials.runs
    found = trial_answer(trials, runs)
    (best, first, before), (same, last, after) = found.figures
    error = next(run for run in runs if run.controller == best).metrics["error_rms_rad"]
    scale = {"mrad": 1e-3, "rad": 1.0}
    assert same == best and (first, last) in [
        ("trial 1", "trial 20"),
        ("trial 21", "trial 40"),
        ("trial 41", "trial 60"),
    ]
    for word, text in ((first, before), (last, after)):
        number, unit = text.split(" ")
        assert float(number) * scale[unit] == pytest.approx(error[int(word.split(" ")[1]) - 1], rel=5e-3)
    assert error[int(first.split(" ")[1]) - 1] == max(error[start - 1] for start in (1, 21, 41))
    (chart,) = data_of(render(trials))["scenarios"][0]["answer"]
    drawn = [unpack(series["values"]) for series in chart["series"]]
    assert [series["label"] for series in chart["series"]] == [first, last]
    assert np.sqrt(np.mean(drawn[0] ** 2)) > 5 * np.sqrt(np.mean(drawn[1] ** 2))


def test_the_picture_has_both_curves(made, tmp_path):
    names = {path.name for path in write_plots(replace(made, runs=low(made)), tmp_path)}
    assert {"low-speed-waveforms.png", "low-speed-revolution.png"} <= names


# --- on the page


def test_the_answer_comes_before_all_text_and_tables(made):
    page = re.sub(r"<(style|script).*?</\1>", "", render(made), flags=re.S)
    order = ['class="figures"', 'class="headline"', "Why, and at what cost", "<h2>Numbers", "<h2>Waveforms"]
    order += [made.study.description, "<h2>Settings"]
    places = [page.index(text) for text in order]
    assert places == sorted(places)
    assert page.count("→") == 2  # each scenario's button has its own figures


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("chromium")) as shown:
        shown.devtools("Page.addScriptToEvaluateOnNewDocument", source=RECORD)
        yield shown


@pytest.fixture(scope="module")
def written(made, tmp_path_factory):
    """A motor of 72 pulses a revolution, too many for a phone."""
    page = tmp_path_factory.mktemp("page") / "report.html"
    pulses = lambda run: 60 * RPM + RPM * np.cos(72 * run.trace["theta_m"])  # noqa: E731
    write(with_signals(made, "low-speed", omega_m=pulses), page)
    return page


@pytest.mark.skipif(bool(MISSING), reason=MISSING)
@pytest.mark.parametrize("width", [1300, 400])
def test_the_figures_and_the_picture_are_what_one_sees_first(chromium, written, width):
    chromium.open(written, width)
    above, top, high, drawn = chromium.run("""
      const box = (e) => e.getBoundingClientRect(), plot = document.querySelector(".answer .plot");
      const parts = [...document.querySelectorAll("article:not([hidden]) > *")];
      const first = parts.find((e) => e.checkVisibility()).dataset.part;
      return [first, box(document.querySelector(".figures")).top, box(plot).height, box(plot).top];
    """)
    assert above == "answer" and top < 350 and high >= 360 and drawn < 620


@pytest.mark.skipif(bool(MISSING), reason=MISSING)
def test_a_phone_shows_lines_in_place_of_blocks(chromium, written):
    """Each of the 72 pulses has 9 pixels: there is a part of the revolution. A button has all of it."""
    wide = "return document.querySelector('.answer .u-over').clientWidth"
    for width, degrees in ((1300, 360), (400, 120)):
        chromium.open(written, width)
        assert (
            0.8 * degrees < last_angle(chromium) <= degrees and chromium.run(wide) >= 9 * 72 * degrees / 360
        )
        names = chromium.run(
            "return [...document.querySelectorAll('.answer .zooms button')].map((b) => b.innerText)"
        )
        assert names == ["one revolution", "60°"]
        for n, shown in ((1, 60), (0, 360)):
            chromium.run(f"document.querySelectorAll('.answer .zooms button')[{n}].click()")
            assert 0.8 * shown < last_angle(chromium) <= shown


def last_angle(chromium):
    """The largest number on the first plot's axis of angles."""
    chromium.run("return new Promise((done) => setTimeout(() => done(0), 100))")
    _, _, texts = chromium.run(TEXTS)[0]
    low = max(bottom for text, *_, bottom in texts if text.isdigit())
    return max(int(text) for text, *_, bottom in texts if text.isdigit() and abs(bottom - low) < 2)
