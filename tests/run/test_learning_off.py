"""The best law with its learning off is a PI with the same gains: in results, report and on the terminal."""

import json

import pytest
from commands import cogless

import studies
from cogless.report import render, with_learning_off
from cogless.run.simulate import learning_off, run_study
from cogless.study import load
from cogless.study.reading import changed

GAINS = {"kp": "0.015 A/rpm", "ki": "0.3 A/rpm/s"}
LEARNS = {
    "scenario.low.duration": "3 s",
    "controller.pi": {"law": "pi", "kp": "0.004 A/rpm", "ki": "0.03 A/rpm/s", "baseline": True},
    "controller.same": {"law": "pi", **GAINS},
    "controller.fair": {"law": "harmonic", **GAINS, "base": 6},
    "metric.0.window": ["2 s", "3 s"],
    "metric.0.scenarios": ["low"],
}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = studies.write(tmp_path_factory.mktemp("study"))
    return changed(load(path), LEARNS)


def test_learning_off_is_the_run_of_a_pi_with_the_same_gains(study):
    results = with_learning_off(run_study(study, ["low/*"]))
    ripple = {run.controller: run.metrics["speed_ripple_rad_s"] for run in results.runs}
    assert ripple["fair"] < 0.5 * ripple["same"] < ripple["pi"]
    off = results.learning_off["low"]
    assert (off.controller, off.metric, off.order) == ("fair", "speed_ripple_rad_s", None)
    assert off.value == pytest.approx(ripple["same"], rel=1e-3)
    page = render(results)
    assert "fair, learning off" in page and "less than with learning off (" in page


def test_a_law_that_does_not_learn_has_no_such_run(study):
    assert learning_off(study, "low", "pi") is None


def test_the_command_says_what_the_feedback_alone_leaves(study, capsys, tmp_path):
    """With the learning so slow that nothing comes of it, the gain is the feedback's."""
    path = studies.write(tmp_path)
    text = path.read_text().replace('duration = "0.4 s"', 'duration = "3 s"')
    text = text.replace('kp = "0.015 A/rpm"\nki = "0.3 A/rpm/s"', 'kp = "0.004 A/rpm"\nki = "0.03 A/rpm/s"')
    learner = 'law = "harmonic"\nbase = 6\nkp = "0.015 A/rpm"\nki = "0.3 A/rpm/s"\nlearning_start = "2.9 s"'
    rule = 'law = "pi"\ntuning = { rule = "phase-margin", phase_margin = "60 deg" }'
    assert rule in text
    path.write_text(
        text.replace(rule, learner).replace('["0.1 s", "0.3 s"]', '["2 s", "2.9 s"]\nscenarios = ["low"]')
    )
    code, out, _ = cogless(capsys, "run", path, "--only", "low/*", "--no-limits", "-o", tmp_path / "out")
    flat = " ".join(out.split())
    assert code == 0 and "as much as with learning off (" in flat and "its feedback, not its learning" in flat
    assert "fair, learning off" in flat
    (entry,) = json.loads((tmp_path / "out" / "results.json").read_text())["learning_off"]
    assert entry["controller"] == "fair" and entry["scenario"] == "low"
    page = (tmp_path / "out" / "report.html").read_text()
    assert '<div class="figures">' in page and "as much as with learning off</strong>" in page
