"""The report where something breaks: what the verdict says of it, and where the waveforms open."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import cogless
import studies
from cogless.report import render, verdict, verdicts, write_plots
from cogless.results import Results

DROPOUT = {"kind": "angle-missing", "time": "0.3 s", "duration": "20 ms"}
FAST = {"duration": "0.8 s", "reference": "600 rpm", "initial_speed": "600 rpm"}


def made_of(folder, *faults):
    """A PI that has these faults, beside itself without any."""
    changes = {f"scenario.low.{key}": value for key, value in FAST.items()}
    for name, value in {**FAST, "faults": list(faults)}.items():
        changes[f"scenario.faulty.{name}"] = value
    changes["metric"] = [{"name": "ripple", "kind": "ripple-rms", "signal": "omega_m", "unit": "rpm",
                          "window": ["0.5 s", "0.8 s"], "scenarios": ["low", "faulty"]}]  # fmt: skip
    return cogless.run_study(studies.study(folder, changes), only=["low/*", "faulty/*"])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return made_of(tmp_path_factory.mktemp("study"), DROPOUT)


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    faults = [{**DROPOUT, "time": f"{0.1 + 0.15 * k} s", "duration": "5 ms"} for k in range(4)]
    return made_of(tmp_path_factory.mktemp("study"), *faults)


def changed(results, **values):
    """With other responses of "pi" where it's faulty."""

    def one(run):
        if (run.scenario, run.controller) != ("faulty", "pi"):
            return run
        return replace(run, faults=[replace(found, **values) for found in run.faults])

    return replace(results, runs=[one(run) for run in results.runs])


def verdict_on(results):
    return next(verdict for verdict in verdicts(results) if verdict.scenario == "faulty")


def without_twin(results):
    return replace(results, runs=[run for run in results.runs if run.scenario == "faulty"])


def scenario_of(results, name="faulty"):
    page = render(results)
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])
    return data["scenarios"][results.scenarios.index(name)]


# --- verdict


def test_the_verdict_says_what_broke_and_what_came_of_it(made):
    found = verdict_on(made)
    assert found.headline == (
        "0.3 s: position sensor gives no number for 20 ms. "
        "Afterwards the ripple is about the same as without the fault."
    )
    (told,) = found.paragraphs
    said = dict(told.sentences)
    assert list(said) == ["pi", "fair"] and told.heading == ""
    sentence = said["pi"].replace("\N{NO-BREAK SPACE}", " ")
    assert sentence.startswith("check trips at once (angle missing); output safe for 2")
    assert re.search(
        r"speed off by up to [\d.]+ rpm; ripple .* before, .* after, .* without the fault", sentence
    )
    assert re.search(r"largest current [\d.]+ A \(limit 3 A\)\.$", sentence)
    assert "learning" not in sentence  # a PI doesn't
    assert found.details[0].startswith("At 600 rpm, ")  # the comparison follows


def test_nothing_broken_nothing_said(made):
    low = verdicts(made)[0]
    assert low.scenario == "low" and low.paragraphs == () and "broke" not in low.headline
    assert verdict(made, "faulty") == verdict_on(made)


def test_without_a_like_scenario_the_ripple_before_is_the_measure(made):
    alone = without_twin(made)
    assert verdict_on(alone).headline.endswith("Afterwards the ripple is about the same as before.")
    assert "without the fault" not in dict(verdict_on(alone).paragraphs[0].sentences)["pi"]
    usual = alone.runs[0].faults[0].ripple_before
    assert (
        "more ripple than before: pi 2.00 times"
        in verdict_on(changed(alone, ripple_after=2 * usual)).headline
    )
    unknown = verdict_on(changed(alone, before=None, ripple_before=None))
    assert unknown.tone != "better" and unknown.headline.endswith(", where this can be judged.")


def test_a_rotor_that_stands_afterwards_has_no_small_ripple(made):
    def stalled(run):
        if run.scenario != "faulty":
            return run
        trace = run.trace
        data = trace.data.copy()
        data[trace.time > 0.3, trace.names.index("omega_m")] = 0.0
        return replace(run, trace=replace(trace, data=data))

    found = verdict_on(replace(made, runs=[stalled(run) for run in made.runs]))
    assert found.tone == "worse"
    assert (
        "Afterwards the speed is not held: pi (mean 0 of 600 rpm), fair (mean 0 of 600 rpm)."
        in found.headline
    )
    assert "afterwards mean 0 of 600 rpm" in dict(found.paragraphs[0].sentences)["pi"]


def test_many_faults(many):
    assert len(verdict_on(many).paragraphs) == 4
    assert [zoom["name"] for zoom in scenario_of(many)["zooms"]][-4:] == [
        "fault at 0.1 s", "fault at 0.25 s", "fault at 0.4 s", "fault at 0.55 s"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"safe": 0.0995}, "output safe for 0.0995 s"),
        ({"safe": 0.0994}, "output safe for 99.4 ms"),
        ({"safe": 999.96}, "output safe for 1e+03 s"),
        ({"safe": 12345.6}, "output safe for 12346 s"),
        (
            {"not_learning": 0.5, "saturated": 0.25},
            "learning paused for 0.5 s; output at its limit for 0.25 s",
        ),
        ({"largest_error": 2 * np.pi}, "speed off by up to 60.0 rpm"),
        ({"largest_error": np.inf}, "speed off by up to not finite rpm"),
        ({"noticed_after": None}, "no check trips"),
        ({"noticed_after": 0.08, "noticed": ("stuck", "speed")}, "check trips after 80 ms (stuck, speed)"),
        ({"largest_current": 2.5}, "largest current 2.50 A (limit 3 A)."),
    ],
)
def test_the_response_in_words(made, values, says):
    said = dict(verdict_on(changed(made, **values)).paragraphs[0].sentences)["pi"]
    assert f"; {says}" in f"; {said}".replace("\N{NO-BREAK SPACE}", " ")


def test_a_fault_to_the_end_is_not_judged(tmp_path):
    found = verdict_on(made_of(tmp_path, {**DROPOUT, "duration": "1e300 s"}))
    assert found.headline.startswith("0.3 s: position sensor gives no number to the end.")
    assert found.tone != "better"


def test_without_traces_the_verdict_has_what_is_known(made):
    empty = [replace(run, trace=replace(run.trace, data=run.trace.data[:0])) for run in made.runs]
    found = verdict_on(replace(made, runs=empty))
    assert "output safe for" in dict(found.paragraphs[0].sentences)["pi"].replace("\N{NO-BREAK SPACE}", " ")
    assert "check trips" in render(replace(made, runs=empty))


def test_a_study_without_metrics_has_its_faults(made):
    study = made.study.model_copy(update={"metric": ()})
    bare = Results(study, [replace(run, metrics={}) for run in made.runs])
    assert [verdict.scenario for verdict in verdicts(bare)] == ["faulty"]


# --- plots


def test_the_waveforms_open_on_the_first_fault(made):
    shown = scenario_of(made)
    (first,) = [zoom for zoom in shown["zooms"] if zoom.get("first")]
    assert first["name"] == "fault at 0.3 s"
    assert first["from"] < 0.3 and first["to"] > 0.32 + 0.099  # a turn after it
    assert shown["marks"] == [
        {"from": 0.3, "to": pytest.approx(0.32), "label": "position sensor gives no number"}
    ]
    assert not any("fault" in zoom["name"] for zoom in scenario_of(made, "low")["zooms"])


def test_the_status_has_names(made):
    lanes = {lane["name"]: lane["runs"] for lane in scenario_of(made)["strip"]}
    assert {"safe output", "angle missing"} <= set(lanes) and "not learning" not in lanes
    assert [run["controller"] for run in lanes["angle missing"]] == [0, 1]
    assert lanes["angle missing"][0]["spans"] == pytest.approx([0.3, 0.32], abs=2e-4)
    assert scenario_of(made, "low")["strip"] == []


def test_faults_have_finer_points(made, monkeypatch):
    from cogless.report import waveforms

    monkeypatch.setattr(waveforms, "WAVEFORM_POINTS_LEAST", 200)
    monkeypatch.setattr(waveforms, "SPEED_PAGE_POINTS", 6_000)
    monkeypatch.setattr(waveforms, "POINTS_FINE", 24_000)
    shown = scenario_of(made)
    starts = [detail["start"] for detail in shown["waveforms"]["details"]]
    assert starts[0] == pytest.approx(shown["zooms"][-1]["from"], abs=2e-3) and starts == sorted(starts)
    for panel in shown["waveforms"]["panels"]:
        assert all(len(series["details"]) == len(starts) for series in panel["series"])


def test_pictures_are_of_the_fault(made, tmp_path, monkeypatch):
    monkeypatch.setattr(FigureCanvasAgg, "print_png", lambda canvas, path, metadata: path.touch())
    assert tmp_path / "faulty-waveforms.png" in write_plots(made, tmp_path)
