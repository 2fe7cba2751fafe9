"""The report: verdict and table from the numbers, waveforms that keep peaks, spectra, one offline page."""

import json
import re
import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import synthetic

from cogless.report import Line, compare, render, verdicts, write
from cogless.report.comparison import factor_text, number
from cogless.report.packing import pack, thin, unpack
from cogless.report.plots import write_plots
from cogless.report.spectra import order_spectrum
from cogless.results import Results, Run


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return synthetic.results(synthetic.study(tmp_path_factory.mktemp("study")), rate=5000)


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


# --- numbers


def test_lines_are_in_display_units_with_the_best_marked(made):
    lines = compare(made, "low-speed")
    sixth = lines[2]
    assert sixth.title == "speed orders: order 6 (electrical)"
    assert sixth.text("pi") == "4.80 rpm" and sixth.best == {"pi-ilc"}
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
    assert line(a=None, b=2.0).best == {"b"}
    assert line(a=1.0).best == set()


def test_ratio_says_nothing_where_there_is_none():
    assert line(a=None, b=2.0).ratio("a", "b") is None
    assert line(a=1.0, b=0.0).ratio("a", "b") is None
    assert line(a=1.0).ratio("a", "b") is None
    assert line(a=None).text("a") == "never"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.46123, "0.461"),
        (48.37, "48.4"),
        (1234.5, "1234"),
        (0.001234, "0.00123"),
        (1e-7, "1e-07"),
        (0, "0"),
        (-3.14159, "-3.14"),
    ],
)
def test_number(value, text):
    assert number(value) == text


def test_factor():
    assert [factor_text(x) for x in (0.0961, 1.03, 250.3)] == [
        "\u00d7\u202f0.096",
        "\u00d7\u202f1.03",
        "\u00d7\u202f250",
    ]


# --- verdict


def test_verdict_names_winner_ratio_and_the_fair_bar(made):
    low, step = verdicts(made, "rpm")
    assert low.tone == "better"
    assert low.headline == (
        "At 60 rpm, PI-ILC leaves 0.461 rpm of speed order 6 (electrical), "
        "10.4 times less than PI as published (4.80 rpm)."
    )
    assert "4.12 times less than the best without learning, PI re-tuned (1.90 rpm)" in " ".join(low.details)
    assert step.tone == "even"  # the winner there doesn't learn
    assert "PI re-tuned doesn't learn; the best that does is PI-ILC" in " ".join(step.details)
    assert "In settling, PI as published and PI re-tuned never settled." in step.details


def test_verdict_names_the_costs(made):
    pi = made.runs[0].metrics
    costly = with_metrics(
        made, pi_ilc={"copper_loss_W": 1.03 * pi["copper_loss_W"], "chattering_A": 4.1 * pi["chattering_A"]}
    )
    details = " ".join(verdicts(costly, "rpm")[0].details)
    assert "PI-ILC costs +3 % copper loss (" in details
    assert "and 4.10 times the chattering (" in details
    assert "None of the" not in details


def test_verdict_is_honest_when_learning_loses(made):
    orders = {"speed_orders_rad_s": [0.1, 0.1, 0.9]}
    worse = with_metrics(made, pi_ilc=orders, fair_pi={"speed_orders_rad_s": [0.1, 0.1, 0.8]})
    low = verdicts(worse, "rpm")[0]
    assert low.tone == "worse"
    assert low.headline.startswith("At 60 rpm, no controller beats PI as published: it leaves 4.80 rpm of")
    assert low.headline.endswith("the next, PI re-tuned, 7.64 rpm (worse: 1.59 times as much).")
    assert "PI-ILC 8.59 rpm (worse: 1.79 times as much)" in " ".join(low.details)


def test_verdict_with_zeros(made):
    none = {"speed_orders_rad_s": [0.0, 0.0, 0.0]}
    low = verdicts(with_metrics(made, pi_ilc=none), "rpm")[0]
    assert (
        low.tone == "better" and "PI-ILC leaves 0 rpm of" in low.headline and "against PI as" in low.headline
    )
    low = verdicts(with_metrics(made, pi=none), "rpm")[0]
    assert low.tone == "worse" and low.headline.endswith("(worse).")
    low = verdicts(with_metrics(made, pi=none, pi_ilc=none, fair_pi=none), "rpm")[0]
    assert low.tone == "even"


def test_verdict_when_nothing_changes(made):
    same = {"speed_orders_rad_s": made.runs[0].metrics["speed_orders_rad_s"]}
    low = verdicts(with_metrics(made, pi_ilc=same, fair_pi=same), "rpm")[0]
    assert low.tone == "even" and "all are alike" in low.headline


def test_verdict_without_baseline_or_runs(made):
    alone = Results(made.study, [run for run in made.runs if run.controller == "pi-ilc"], interrupted=True)
    assert "nothing to compare" in " ".join(verdicts(alone, "rpm")[0].details)
    assert verdicts(Results(made.study, []), "rpm") == []


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
    assert order_spectrum(np.sin(theta * 9) * 30, theta, 48, pole_pairs=4) is None


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


def test_page_is_one_offline_file(made):
    page = render(made)
    checker = Checker()
    checker.feed(page)
    assert checker.open == [] and checker.loaded == []
    assert "url(" not in page and "@import" not in page
    assert len(page) < 3_000_000
    assert page.index("10.4 times less") < page.index('class="numbers"') < page.index('id="waveforms"')
    for text in (
        "seed 7",
        "numpy",
        "Not in the datasheet",
        "2.5e-4 kg*m^2",
        "[controller.pi-ilc]",
        "(baseline)",
    ):
        assert text in page


def test_page_data(made):
    low, step = data_of(render(made))["scenarios"]
    titles = [panel["title"] for panel in low["waveforms"]["panels"]]
    assert len(titles) == 4 and titles[-1].startswith("Learnt part")
    assert all(panel["unit"] for panel in low["waveforms"]["panels"])
    assert [zoom["name"] for zoom in low["zooms"]] == ["whole run", "after start-up", "last revolution"]
    assert [zoom["name"] for zoom in step["zooms"]] == ["whole run", "last revolution", "event at 2 s"]
    electrical, mechanical = low["spectra"]
    assert electrical["series"][0]["values"][5] == pytest.approx(4.8, rel=1e-3)
    assert 18 in mechanical["orders"]
    assert "early" in electrical["series"][2] and "early" not in electrical["series"][0]
    assert len(low["maps"]) == 1 and low["maps"][0]["x"] == "electrical angle (°)"
    assert low["events"] == [] and len(step["events"]) == 1
    event = step["events"][0]
    assert event["start"] == pytest.approx(-0.1, abs=2e-3)
    assert event["panels"][0]["title"] == "Speed, load to 0.6 N·m at 2 s"


def test_waveforms_lie_in_time(made):
    """The first value of a waveform stands for the run's start, the last for its end."""
    waveforms = data_of(render(made))["scenarios"][0]["waveforms"]
    reference, speed = waveforms["panels"][0]["series"][:2]
    assert reference["dash"] and np.all(unpack(reference["values"]) == pytest.approx(60))
    values = unpack(speed["values"])
    end = waveforms["start"] + waveforms["step"] * (len(values) - 1)
    assert end == pytest.approx(10, abs=0.01) and waveforms["start"] == pytest.approx(0, abs=0.01)
    first_above_30 = waveforms["start"] + waveforms["step"] * int(np.argmax(values > 30))
    assert first_above_30 == pytest.approx(0.05 * np.log(2), abs=0.01)


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
    def short(run):
        trace = replace(run.trace, data=run.trace.data[:rows])
        return Run(run.scenario, run.controller, trace, run.memory, {})

    page = render(Results(made.study, [short(run) for run in made.runs]))
    assert "Nothing to judge by" in page


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


def test_page_is_quick_and_small(tmp_path):
    results = synthetic.results(synthetic.study(tmp_path))
    begun = time.perf_counter()
    write(results, tmp_path / "report.html")
    assert time.perf_counter() - begun < 1.0  # about 0.1 s on a free machine
    assert (tmp_path / "report.html").stat().st_size < 3_000_000


def test_plots(made, tmp_path):
    written = write_plots(made, tmp_path)
    assert {path.name for path in written} == {
        f"{scenario}-{kind}.png"
        for scenario in ("low-speed", "step-on")
        for kind in ("waveforms", "spectra", "map")
    }
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)
    assert sorted(tmp_path.iterdir()) == sorted(written)
