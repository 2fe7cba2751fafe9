"""What is said of learning holds in each scenario: its plant, its counts, its ripple; against runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cogless import changed, load
from cogless.design.ripple import ripple as foreseen
from cogless.design.speed_loop import speed_loop
from cogless.design.summary import design
from cogless.design.verdict import Verdict, judged, verdict
from cogless.design.warnings import warnings
from cogless.run.simulate import simulate
from cogless.study import Study

Changes = dict[str, Any]
OTHER = {"mechanics.inertia": "1.5e-4 kg*m^2", "motor.K_t": "0.5 N*m/A"}


def liu(override: Changes, changes: Changes | None = None) -> Study:
    """Liu's motor at 120 r/min under a law that learns in angle."""
    scenario = {"duration": "12 s", "reference": "120 rpm", "initial_speed": "120 rpm", "override": override}
    return load("liu2018-varying", {"scenario.varying": scenario, "metric": [], **(changes or {})})


def known(study: Study, name: str) -> Verdict:
    found = verdict(study, name)
    assert found is not None
    return found


def ripple(study: Study, scenario: str, name: str) -> float:
    """RMS of the true speed about its mean in the last 4 s, rad/s."""
    trace = simulate(study, scenario, name).trace
    end = float(trace.time[-1])
    return float(np.std(trace["omega_m"][trace.window(end - 4, end)]))


def test_learning_is_judged_with_the_plant_of_the_scenario() -> None:
    """The controller isn't told of an override; whoever reads the verdict is, and the run agrees."""
    told, other = liu({}), liu(OTHER)
    assert known(told, "angle").kind == "settles"
    found = known(other, "angle")
    assert found.kind == "grows"
    assert found.in_words() in str(warnings(other, "varying", "angle")[0])
    without = changed(other, {"controller.angle.learning": False})
    alone = changed(other, {"drive.guard": False})
    of_feedback = ripple(without, "varying", "angle")
    assert ripple(alone, "varying", "angle") > 3 * of_feedback
    assert ripple(other, "varying", "angle") < 1.25 * of_feedback  # the guard stops it
    assert ripple(told, "varying", "angle") < of_feedback


def test_the_report_s_criterion_is_of_the_same_plant() -> None:
    (loop,) = judged(liu(OTHER), "varying", "angle")
    assert loop.plant.b == pytest.approx(0.5 / 1.5e-4)
    assert loop.worst().factor > 1.5


def test_only_the_scenario_that_is_worst_is_named() -> None:
    study = load(
        "liu2018-varying",
        {
            "scenario.light": {"duration": "5 s", "reference": "120 rpm", "override": OTHER},
            "scenario.varying.duration": "5 s",
            "metric": [],
        },
    )
    assert "in scenario light" in known(study, "angle").short()


def test_a_wrong_belief_is_no_true_motor() -> None:
    """A seventh of the flux believed makes the rule's gains seven times as large: the loop isn't stable."""
    study = load("liu2018", {"drive.belief.psi_f": "10 mWb"})
    told, true = speed_loop(study), speed_loop(study, "60-rpm")
    assert true.b == pytest.approx(study.motor.star().K_t / study.mechanics.inertia)
    assert told.b < 0.2 * true.b
    (line,) = [line for line in map(str, warnings(study, "60-rpm", "pi-fair")) if "feedback" in line]
    assert line.startswith("controller.pi-fair: feedback unstable, at ")
    assert "Hz in scenario" in line
    assert not any("feedback" in str(line) for line in warnings(load("liu2018"), "60-rpm", "pi-fair"))


@pytest.mark.parametrize(
    ("speed", "changes", "harms"),
    [
        ("2 rev/s", {"forgetting": 0.5, "gain": "0.05 A*s/rad"}, False),
        ("6 rev/s", {"forgetting": 0.7, "gain": "0.05 A*s/rad"}, False),
        ("6.5 rev/s", {"forgetting": 0.6, "gain": "0.3 A*s/rad"}, True),
    ],
)
def test_what_learning_leaves_is_foretold(speed: str, changes: Changes, harms: bool) -> None:
    """From the orders of motor and load; where it leaves more than its feedback, that's said."""
    law = {f"controller.pi-ilc.{key}": value for key, value in {"lead": "0 s", **changes}.items()}
    only = {"s": {"duration": "6 s", "reference": speed, "initial_speed": speed}}
    perfect = {
        "drive.position_sensor": {"kind": "ideal"},
        "drive.inverter.dead_time": "0 s",
        "drive.guard": False,  # the law alone is judged
    }
    slow = {"drive.current_loop.bandwidth": "400 Hz"} if harms else {}
    quiet = {"drive.current_sensors": {}, "scenario": only, "metric": []}
    study = load("uomodri", {**perfect, **law, **slow, **quiet})
    found = known(study, "pi-ilc")
    assert found.kind == "settles" and found.fine == (not harms) == (found.ratio <= 1.25)
    off = changed(study, {"controller.pi-ilc.learning_start": "1000 s"})
    measured = ripple(study, "s", "pi-ilc") / ripple(off, "s", "pi-ilc")
    # close to growing, what interpolation lags counts too
    assert measured > 1.25 if harms else measured == pytest.approx(found.ratio, rel=0.02)
    leaves = f"{found.ratio:.2g} times the speed ripple of its feedback alone"
    line = f"controller.pi-ilc: settles, but leaves {leaves}"
    assert (line in map(str, warnings(study, "s", "pi-ilc"))) == harms


FEW = {"drive.position_sensor.lines": 4096, "metric": []}


def test_a_law_that_hands_its_integral_over_is_compared_with_the_feedback_that_has_it() -> None:
    """Without learning the integral stays, and leaves less of a slow order than k_omega and k_theta alone."""
    law = {"law": "space-position", "frame": "mechanical", "period": {"of": "mechanical"}, "cells": 128}
    law |= {"tuning": {"rule": "phase-margin", "phase_margin": "45 deg"}, "mu_alpha": 0.1, "q_half_width": 8}
    turn = {"duration": "16 s", "reference": "1 rev/s", "initial_speed": "1 rev/s"}
    perfect = {"drive.position_sensor": {"kind": "ideal"}, "drive.inverter.dead_time": "0 s", "metric": []}
    plain = {"motor.cogging": [{"order": 12, "torque": "0.5 mN*m"}], "mechanics.coulomb_friction": "0 N*m"}
    only = {"scenario": {"turn": turn}, "controller": {"mine": law}, "drive.current_sensors": {}}
    study = load("uomodri", {**perfect, **plain, **only, "drive.guard": False})
    found = known(study, "mine")
    (loop,) = judged(study, "turn", "mine")
    off = ripple(changed(study, {"controller.mine.learning": False}), "turn", "mine")
    assert off == pytest.approx(foreseen(loop, 16.0).without, rel=0.01)
    assert ripple(study, "turn", "mine") / off == pytest.approx(found.ratio, rel=0.05)
    assert found.in_words() == "settles, but leaves 4.2 times the speed ripple of its feedback alone"


@pytest.mark.parametrize(("rpm", "method", "told"), [(1, "MT", True), (10, "MT", False), (1, "M", True)])
def test_too_few_edges_for_the_loop_are_told(rpm: int, method: str, told: bool) -> None:
    """16,384 counts: at 1 r/min an edge comes every 3.7 ms, at ten times the speed often enough."""
    slow = {"reference": f"{rpm} rpm", "initial_speed": f"{rpm} rpm", "duration": "8 s"}
    study = load("uomodri", {**FEW, "drive.position_sensor.speed_method": method, "scenario": {"slow": slow}})
    lines = [line for line in map(str, warnings(study, "slow", "pi")) if "edge comes" in line]
    assert bool(lines) == told
    trace = simulate(study, "slow", "pi").trace
    rows = trace.window(4, 8)
    low = float(np.min(trace["omega_m"][rows])) / float(np.mean(trace["omega_ref"][rows]))
    bias = float(np.mean(trace["omega_measured"][rows]) / np.mean(trace["omega_m"][rows])) - 1
    assert (low < 0.05) == told  # it stops and goes
    assert (bias > 0.15) == (told and method == "MT")
    if told and method == "MT":
        assert lines[0].startswith(
            "controller.pi: at 1 rpm a sensor edge comes every 3.7 ms; the loop's crossover is 121 Hz: "
        )
        assert (
            "the phase margin without this lag is 60 deg; when the rotor stops and goes, the measured"
            in lines[0]
        )
        assert (
            "drive.position_sensor.lines = 22903 (another sensor) would be enough by calculation" in lines[0]
        )  # 4.7 times the counts, and a fifth more
        assert not known(study, "pi-ilc").fine
        several = changed(
            study, {"scenario.fast": {**slow, "reference": "60 rpm", "initial_speed": "60 rpm"}}
        )
        remark = warnings(several, "fast", "pi")[0]
        assert str(remark).startswith(
            "controller.pi: in scenario slow: at 1 rpm a sensor edge comes every 3.7 ms"
        )


def test_twice_the_counts_that_help_do_help() -> None:
    slow = {"reference": "1 rpm", "initial_speed": "1 rpm", "duration": "6 s"}
    lines = {"drive.position_sensor.lines": round(4.8 * 4096), "scenario": {"slow": slow}, "metric": []}
    study = load("uomodri", lines)
    assert not [line for line in warnings(study, "slow", "pi") if "edge" in line]
    trace = simulate(study, "slow", "pi").trace
    rows = trace.window(3, 6)
    bias = float(np.mean(trace["omega_measured"][rows]) / np.mean(trace["omega_m"][rows])) - 1
    assert abs(bias) < 0.02


@pytest.mark.parametrize("start", ["0 s", "2 s"])
def test_a_speed_law_whose_load_is_beyond_eta_bar_may_not_learn(start: str) -> None:
    """Law (4) has no integral: its error under load counts as a transient, unless it learned before."""
    arm = {"duration": "4 s", "reference": "3 rad/s", "initial_speed": "3 rad/s", "load": "4 N*m"}
    law = {"controller.proven.k": 7.0, "controller.proven.learning_start": start}
    study = load("verrelli2016-speed", {"scenario": {"arm": arm}, **law, "metric": []})
    found = known(study, "proven")
    assert not found.fine and "below eta_bar, so it may never learn" in found.in_words()
    trace = simulate(study, "arm", "proven").trace
    learned = float(np.max(np.abs(trace["term_alpha"])))
    assert learned == 0.0 if start == "2 s" else learned > 1.0


def test_a_proof_of_continuous_time_is_not_said_to_hold_where_the_sampled_loop_does_not() -> None:
    rates = {"drive.rates.speed_loop": "1 kHz", "drive.rates.current_loop": "10 kHz"}
    for changes, holds in (({}, True), (rates, False)):
        found = design(load("verrelli2016-speed", changes), "proven")
        assert found.learning is not None and found.theorem is not None
        assert found.theorem.holds == holds == (found.learning.kind == "settles")
        assert ("the proof holds" in found.theorem.verdict()) == holds
