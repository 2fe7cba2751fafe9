"""Parts of the page as HTML: a line's cells, verdicts with faults, gains of laws that lack some."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic

from cogless.report import page, tables
from cogless.report.comparison import Line
from cogless.report.markup import DASH
from cogless.report.trials import _gains
from cogless.report.verdicts import Paragraph, ScenarioVerdict
from cogless.results import Results, Run
from cogless.results.trace import Trace


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Results of a run of each controller, without rows."""
    study = synthetic.study(tmp_path_factory.mktemp("study"))
    empty = Trace(("time",), ("s",), np.empty((0, 1)))
    return Results(study, [Run("low-speed", name, empty) for name in ("pi", "fair-pi", "pi-ilc")])


def line(**more):
    values = {"pi": 2.0, "fair-pi": 1.0, "pi-ilc": 0.5}
    about = {"frame": "mechanical", "better": "lower", "unit": "rpm", "values": values} | more
    return Line("speed_ripple", "ripple-rms", "omega_m", None, **about)


def test_a_line_marks_the_best_and_who_missed_and_has_ratios_to_the_baseline():
    cells = re.findall(
        r'<td class="(\w*)"><span class="value">(.*?)</span>(.*?)</td>',
        tables._cells(line(missed={"pi-ilc": "mean 0"}), ["pi", "fair-pi", "pi-ilc"], "pi"),
    )
    ratio = ' <span class="ratio">\u00d7\u202f0.50</span>'
    assert cells == [("", "2.00 rpm", ""), ("best", "1.00 rpm", ratio), ("missed", "0.500 rpm", "")]
    assert "ratio" not in tables._cells(line(better="none"), ["pi", "fair-pi"], "pi")


def test_a_scenario_without_metrics_says_so(made):
    assert "No metric is taken in low-speed." in tables.line_table(made, made.runs, [])
    full = tables.line_table(made, made.runs, [line(missed={"pi-ilc": "mean 0"})])
    assert "No metric" not in full and "PI-ILC did not hold the speed in speed ripple: mean 0" in full
    assert full.count("<tr>") == 2 and "speed ripple</th>" in full


def test_the_details_have_the_faults_and_a_line_for_each_sentence(made):
    more = [Paragraph("", [("pi", "once")]), Paragraph("More.", [])]
    told = [Paragraph("2 s: <a>", [("pi", "holds."), ("pi-ilc", "stops.")]), *more]
    text = page._details(ScenarioVerdict("low-speed", "even", "A & B.", ["One <b>.", "Two."], told), made)
    assert '<p class="fault">2 s: &lt;a&gt;</p><dl class="told"><dt ' in text
    assert re.findall(r"<dd>(.*?)</dd>", text) == ["holds.", "stops.", "once"]
    assert text.count('<p class="fault">') == 2 and text.count("<dl") == 2
    assert re.findall(r"<li>(.*?)</li>", text) == ["One &lt;b&gt;.", "Two."]
    assert page._details(None, made) == ""
    assert page._details(ScenarioVerdict("low-speed", "even", "A.", []), made) == ""


def design(**more):
    about = {
        "K_1": [1.5, 0.25], "K_2": 0.0, "N": 2.0, "K_3": 0.0, "learning_matrix": None, "shift": 3,
        "through_integrator": True, "q_filter": None, "filtered": "error", "feedforward": None,
        "gains": SimpleNamespace(feedback=None, learning=None),
    }  # fmt: skip
    return SimpleNamespace(**about | more)


def test_gains_that_a_law_lacks_have_a_dash():
    drive = SimpleNamespace(plant=None, drive=object())
    assert dict(_gains(drive, design())) == {
        "K_1, theta_m (A/rad)": "1.5",
        "K_1, omega_m (A·s/rad)": "0.25",
        "K_2, integrator (A/rad)": DASH,
        "N (A/rad)": "2",
        "K_3": DASH,
        "feedforward": DASH,
        "K_1 and K_2 from": "given",
    }
    plant = SimpleNamespace(plant=SimpleNamespace(names=("x", "y")), drive=None)
    matrix = dict(_gains(plant, design(learning_matrix=np.zeros((4, 5)), through_integrator=False, K_2=3.0)))
    assert matrix == {
        "K_1, x": "1.5",
        "K_1, y": "0.25",
        "K_2, integrator": "3",
        "N": "2",
        "learning matrix": "4 x 5",
        "learned signal into": "input",
        "shift r (samples)": "3",
        "feedforward": DASH,
        "K_1 and K_2 from": "given",
    }
    q = SimpleNamespace(b=np.array([0.5, 0.5]), a=np.array([1.0]))
    filtered = dict(_gains(plant, design(K_3=0.125, q_filter=q, filtered="signal")))
    assert (filtered["K_3"], filtered["learned signal into"]) == ("0.125", "input and integrator")
    assert (filtered["Q filter b"], filtered["Q filter a"]) == ("0.5, 0.5", "1")
    assert filtered["Q filter acts on"] == "the learned signal"
    assert filtered["K_3 from"] == "given, or chosen by frequency"
