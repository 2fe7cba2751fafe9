"""A law that learned nothing in its scenario gets no praise for it, and `run` says so before the run."""

import math
import sys
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import studies
from cogless.__main__ import main
from cogless.design.unlearned import foreseen, too_short
from cogless.errors import StudyError
from cogless.report import compare, render, verdicts
from cogless.report.comparison import unlearned
from cogless.results import Results
from cogless.run import simulate
from cogless.study import load

STUDY = (
    f'title = "Too short to learn"\n{studies.IDEAL}'
    + """
[scenario]
short = { duration = "3 s", reference = "10 rpm", initial_speed = "10 rpm" }
long = { duration = "14 s", reference = "10 rpm", controllers = ["pi", "ilc"] }
[controller]
pi = { law = "pi", kp = "0.015 A/rpm", ki = "0.1 A/rpm/s" }
ilc = { law = "pi-ilc", kp = "0.015 A/rpm", ki = "0.1 A/rpm/s", gain = "0.015 A/rpm", q_half_width = 5 }
[controller.over-time]
law = "pi-ilc"
kp = "0.015 A/rpm"
ki = "0.1 A/rpm/s"
gain = "0.015 A/rpm"
memory = "time"
cells = 20000
q_half_width = 5
[controller.late]
law = "pi-ilc"
kp = "0.015 A/rpm"
ki = "0.1 A/rpm/s"
gain = "0.015 A/rpm"
learning_start = "5 s"
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "1 s"
"""
)
HALF = "learning lasts 3 s, which is 0.5 of the law's learning period of 6 s"


def study(folder, changes=None):
    path = folder / "short.toml"
    path.write_text(STUDY)
    return load(path, changes)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return simulate.run_study(study(tmp_path_factory.mktemp("study")))


def run_of(results, scenario, controller):
    return next(r for r in results.runs if (r.scenario, r.controller) == (scenario, controller))


def verdict_of(results, scenario):
    return next(v for v in verdicts(results) if v.scenario == scenario)


def test_less_than_a_period_is_not_learning_however_good_its_number(made):
    """By its numbers the ILC wins: until a period has passed its correction is a higher gain."""
    (line,) = compare(made, "short")
    assert line.values["ilc"] < 0.6 * line.values["pi"]
    assert line.unlearned == {
        "ilc": HALF,
        "over-time": HALF,
        "late": "learning_start is 5 s, but the run ends at 3 s",
    }
    assert line.best == {"pi"}
    found = verdict_of(made, "short")
    assert found.tone == "even" and "nothing was learned: " in found.headline
    assert "less than" not in found.headline
    assert f"ilc learned nothing: {HALF}." in found.details
    assert f"ilc learned nothing: {HALF}" in render(made).replace("&#x27;", "'")


def test_a_run_of_two_periods_is_praised(made):
    (line,) = compare(made, "long")
    assert line.unlearned == {} and line.best == {"ilc"}
    found = verdict_of(made, "long")
    assert found.tone == "better" and "ilc leaves" in found.headline


def test_one_that_learned_is_ranked_and_one_that_did_not_is_named(made):
    """Both in one scenario: the number of the one that did not learn is the best."""
    runs = [run_of(made, "long", name) for name in ("pi", "ilc")]
    other = replace(run_of(made, "short", "over-time"), scenario="long", metrics={"ripple_rad_s": 1e-6})
    both = replace(made, runs=[*runs, other])
    found = verdict_of(both, "long")
    assert "ilc leaves" in found.headline and found.tone == "better"
    assert f"over-time learned nothing: {HALF}." in found.details
    assert "over-time" not in " ".join(d for d in found.details if "learned nothing" not in d)
    assert compare(both, "long")[0].best == {"ilc"}


def test_alone_too(made):
    alone = Results(made.study, [run_of(made, "short", "ilc")])
    details = verdict_of(alone, "short").details
    assert details == ["There is nothing to compare.", f"ilc learned nothing: {HALF}."]


def test_a_baseline_that_learned_nothing_stays_the_baseline(tmp_path, made):
    other = study(tmp_path, {"controller.ilc.baseline": True})
    runs = [run_of(made, "short", name) for name in ("pi", "ilc")]
    found = verdict_of(Results(other, runs), "short")
    assert "no controller beats ilc" in found.headline
    assert f"ilc learned nothing: {HALF}." in found.details


def test_frozen_all_the_time(made):
    """By the status, not by what the study hopes for."""
    run = run_of(made, "long", "ilc")
    assert unlearned(made, run) is None
    data = run.trace.data.copy()
    data[:, run.trace.names.index("status")] = 4
    frozen = replace(run, trace=replace(run.trace, data=data))
    assert unlearned(made, frozen) == "its learning was frozen all the time"
    data[-500:, run.trace.names.index("status")] = 0
    late = replace(run, trace=replace(run.trace, data=data))
    assert unlearned(made, late) == "learning lasts 0.5 s, which is 0.083 of the law's learning period of 6 s"


def test_a_rotor_that_hardly_turns(made):
    run = run_of(made, "long", "ilc")
    data = run.trace.data.copy()
    data[:, run.trace.names.index("theta_m")] *= 0.1
    stuck = replace(run, trace=replace(run.trace, data=data))
    assert unlearned(made, stuck) == "in 12 s the rotor turned by only 0.2 of the law's learning period"


def test_foreseen_by_the_reference(tmp_path):
    known = study(tmp_path)
    assert [foreseen(known, "short", name) for name in ("pi", "ilc", "over-time")] == [None, HALF, HALF]
    assert foreseen(known, "long", "ilc") is None
    electrical = study(tmp_path, {"controller.ilc.period": "electrical"})
    assert foreseen(electrical, "short", "ilc") is None
    assert foreseen(study(tmp_path, {"scenario.short.duration": "6.1 s"}), "short", "ilc") is None
    small = study(
        tmp_path,
        {
            "controller.over-time.cells": 1000,
            "scenario.long.reference": "100 rpm",
            "scenario.long.controllers": ["over-time"],
        },
    )
    assert foreseen(small, "long", "over-time") is None
    assert (
        foreseen(small, "short", "over-time") == "a period at 10 rpm has 6000 samples, more than cells = 1000"
    )


def test_a_path_that_turns_back_is_learned_over_the_angle_only(tmp_path):
    """To and fro by 60 degrees: a map meets what it learned, a delay of a whole turn doesn't within 3 s."""
    swing = {"amplitude": "10 rpm", "offset": "0 rpm", "frequency": "1 Hz"}
    back = study(tmp_path, {"scenario.short.reference": swing})
    assert foreseen(back, "short", "ilc") is None
    travel = 3 * 4 * 10 / 60 / (2 * math.pi)  # turns
    assert (
        foreseen(back, "short", "over-time")
        == f"learning lasts 3 s, which is {travel:.2g} of the law's learning period"
    )


@pytest.mark.parametrize(
    ("speed", "found"),
    [
        ("0.5 rad/s", "the reference never reaches omega_min"),
        ("20 rad/s", None),
        ("2 rad/s", "learning lasts 3 s, which is 0.95"),
    ],
)
def test_laws_that_learn_in_angle(tmp_path, speed, found):
    text = STUDY.replace('"10 rpm"', f'"{speed}"') + (
        '[controller.space]\nlaw = "space-speed"\nk = "0.1 A*s/rad"\neta_bar = "1 rad/s"\nmu_alpha = 0.1\n'
        'omega_min = "1 rad/s"\nperiod = { of = "mechanical" }\n'
    )
    path = tmp_path / "space.toml"
    path.write_text(text)
    why = foreseen(load(path), "short", "space")
    assert why == found or (found and why.startswith(found))
    assert foreseen(load(path, {"controller.space.learning": False}), "short", "space") is None


def test_run_says_so_before_it_runs(tmp_path, monkeypatch, capsys):
    """Here the run itself never begins."""

    def never(*_, **__):
        raise StudyError("never")

    study(tmp_path)
    monkeypatch.setattr("cogless.run.simulate.run_study", never)
    only = ("--only", "*/ilc", "-o", str(tmp_path / "out"))
    monkeypatch.setattr(sys, "argv", ["cogless", "run", str(Path(tmp_path) / "short.toml"), *only])
    with pytest.raises(SystemExit):
        main()
    warning = f"Warning: controller.ilc: learns nothing in short: {HALF}.\n"
    assert capsys.readouterr().err.startswith(warning)


def test_without_traces_nothing_is_said(made):
    bare = [replace(r, trace=replace(r.trace, data=np.zeros((0, len(r.trace.names))))) for r in made.runs]
    assert compare(Results(made.study, bare), "short")[0].unlearned == {}


def said(*turned, over_angle=True, omega=(1.0,)):
    """Of a rotor that turns to these shares of a period of half a revolution, one after the other, in 5 s.

    `omega`: reference, relative to one that would turn once through the period.
    """
    law = SimpleNamespace(over_angle=over_angle, by_order=False, cells=100)
    theta = np.pi * np.concatenate([np.linspace(*ends, 101) for ends in pairwise((0.0, *turned))])
    return too_short(law, Fraction(1, 2), theta, 5.0, np.pi / 5 * np.array(omega))


def test_nearly_a_period_is_one():
    assert said(0.996) is said(-0.996) is said(0.996, over_angle=False) is None
    for turned in (0.99, -0.99):
        assert (
            said(turned)
            == said(turned, over_angle=False)
            == "learning lasts 5 s, which is 0.99 of the law's learning period of 5 s"
        )


def test_a_speed_that_varies_has_no_length_of_a_period():
    assert said(0.7, omega=(1.0, 1.01)) == "learning lasts 5 s, which is 0.7 of the law's learning period"
    assert (
        said(0.7, omega=(-1.0, -1.0))
        == said(0.7)
        == "learning lasts 5 s, which is 0.7 of the law's learning period of 5 s"
    )
    assert (
        said(0.7, omega=(0.0, 0.0))
        == said(0.7, omega=())
        == "learning lasts 5 s, which is 0.7 of the law's learning period"
    )


def test_a_rotor_that_turns_less_than_half_of_its_way_is_said_not_to_follow():
    assert said(0.49) == "in 5 s the rotor turned by only 0.49 of the law's learning period"
    assert said(0.51) == "learning lasts 5 s, which is 0.51 of the law's learning period of 5 s"
    assert said(0.49, omega=(1.0, 1.01)) == "learning lasts 5 s, which is 0.49 of the law's learning period"


def test_turning_back_by_more_than_a_cell_passes_angles_twice():
    """A delay line adds up both ways."""
    assert said(0.6, 0.585) is said(-0.6, -0.585) is None
    assert (
        said(0.6, 0.595)
        == said(-0.6, -0.595)
        == "learning lasts 5 s, which is 0.6 of the law's learning period of 5 s"
    )
    assert (
        said(0.6, 0.3, over_angle=False)
        == "learning lasts 5 s, which is 0.9 of the law's learning period of 5 s"
    )
    assert said(0.6, 0.2, over_angle=False) is None
