"""The sensor's own error, which no law can see, is told apart in trace, metrics and verdict."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import synthetic
from engine import run

import studies
from cogless.report import verdicts
from cogless.report.comparison import compare
from cogless.report.speed_verdict import sensor
from cogless.report.tables import late_table
from cogless.results import Results
from cogless.results.windows import late
from cogless.run import simulate
from cogless.study import load
from cogless.study.metric import SIGNAL_DIMENSIONS

TURN = 2 * math.pi
OFF = math.radians(0.5)
ENCODER = {
    "kind": "encoder",
    "counts": 20000.0,
    "speed_method": "MT",
    "timer": 1e9,
    "error": [{"order": 1, "amplitude": OFF, "phase": 0.3}],
}
STUDY = (
    f'title = "An encoder that is off centre"\n{studies.IDEAL}'
    + """
position_sensor = { kind = "encoder", lines = 20000, speed_method = "MT", eccentricity = "0.5 deg" }
[scenario]
turn = { duration = "4 s", reference = "60 rpm", initial_speed = "60 rpm" }
[controller.pi]
law = "space-position"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
learning = false
[controller.learning]
law = "space-position"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
period = { of = "mechanical" }
mu_alpha = 0.2
[[metric]]
name = "angle_error"
kind = "rms"
signal = "theta_error"
last = "1 s"
[[metric]]
name = "sensor"
kind = "rms"
signal = "theta_sensor_error"
last = "1 s"
"""
)


@pytest.mark.parametrize("speed", [30.0, -30.0])
def test_the_measured_angle_is_recorded_unwrapped(speed):
    steady = {"mechanics": {"inertia": 1e6}, "controller": {"kp": 0.0, "ki": 0.0}}
    x = run({**steady, "initial_speed": speed, "drive": {"position_sensor": ENCODER}}, 0.5)
    assert abs(x["theta_m"][-1]) > 2 * TURN
    count = TURN / 20000
    expected = OFF * np.sin(x["theta_m"] + 0.3)
    # counted down to the last whole count
    assert np.all(np.abs(x["theta_measured"] - x["theta_m"] - expected + count / 2) <= count / 2 + 1e-9)


def test_an_ideal_sensor_measures_the_angle_itself():
    x = run({"initial_speed": -41.0}, 0.5)
    assert x["theta_measured"] == pytest.approx(x["theta_m"], abs=1e-9)


def test_the_true_error_is_what_is_seen_and_the_sensors(made):
    trace = made.runs[0].trace
    for name in ("theta", "omega"):
        assert trace.unit(f"{name}_sensor_error") == SIGNAL_DIMENSIONS[f"{name}_sensor_error"].unit
        seen, own = trace[f"{name}_error_measured"], trace[f"{name}_sensor_error"]
        assert trace[f"{name}_error"] == pytest.approx(seen + own, abs=1e-12)
        assert f"{name}_sensor_error" not in trace.names  # derived, not recorded


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "eccentric.toml"
    path.write_text(STUDY)
    return simulate.run_study(load(path))


def test_laws_that_follow_a_sensor_leave_its_error(made):
    """0.5 deg / sqrt(2) under each of them, all of it the sensor's own; in what they see they differ.

    The headline has what a user of the motor gets, a sentence below it what the laws see.
    """
    for one in made.runs:
        assert one.metrics["angle_error_rad"] == pytest.approx(OFF / math.sqrt(2), rel=0.01)
        assert one.metrics["sensor_rad"] == pytest.approx(OFF / math.sqrt(2), rel=0.01)
    part = sensor(made, "turn", compare(made, "turn")[0])
    for share in part.shares.values():
        assert share == pytest.approx(1.0, abs=0.02)
    for one in made.runs:
        seen = np.sqrt(np.mean(one.trace["theta_error_measured"][-1001:] ** 2))
        assert part.seen.values[one.controller] == pytest.approx(np.rad2deg(seen), rel=1e-6)
    (found,) = verdicts(made)
    assert "all are alike: " in found.headline and "0.354 deg" in found.headline
    start = "Most of the true angle error comes from the sensor's own error, which no law can see"
    assert found.details[0].startswith(start)
    assert " 0.354 deg (100 %)" in found.details[0] and "The measured values show: " in found.details[0]


def with_sensor(results, shares):
    """The results with a sensor that shows only what isn't its own: that share of the true ripple."""

    def one(run):
        data = run.trace.data.copy()
        true = run.trace["omega_m"] - run.trace["omega_ref"]
        seen = run.trace["omega_ref"] + (1 - shares.get(run.controller, 0.0)) * true
        data[:, run.trace.names.index("omega_measured")] = seen
        return replace(run, trace=replace(run.trace, data=data))

    return replace(results, runs=[one(run) for run in results.runs])


@pytest.fixture(scope="module")
def ripples(tmp_path_factory):
    return synthetic.results(synthetic.study(tmp_path_factory.mktemp("study")), rate=5000)


def test_without_an_error_of_the_sensor_nothing_is_said(ripples):
    line = compare(ripples, "low-speed")[3]
    part = sensor(ripples, "low-speed", line)
    assert line.name == "speed_ripple" and set(part.shares.values()) == {0.0}
    assert part.seen.values == line.values
    assert "sensor" not in " ".join(verdicts(ripples)[0].details)


def test_steps_of_an_encoder_are_no_error_that_a_law_leaves(ripples):
    """It sees far more than there is, and a little of that is in its true error."""
    part = sensor(
        with_sensor(ripples, {"pi": -3.0, "fair-pi": 2.5, "pi-ilc": -1.0}),
        "low-speed",
        compare(ripples, "low-speed")[3],
    )
    assert not any(part.dominates(c) for c in part.shares)


def test_the_share_is_of_the_square(ripples):
    """With E = M + S and S = s E, M is (1 - s) E."""
    part = sensor(
        with_sensor(ripples, {"pi": 0.25, "fair-pi": 0.75, "pi-ilc": 1.2}),
        "low-speed",
        compare(ripples, "low-speed")[3],
    )
    assert part.shares == pytest.approx({"pi": 1 - 0.75**2, "fair-pi": 1 - 0.25**2, "pi-ilc": 1 - 0.2**2})
    assert [part.dominates(c) for c in part.shares] == [False, True, True]
    assert part.percent("pi-ilc") == "96 %"


@pytest.mark.parametrize("place", [0, 3, 4])
def test_shares_of_orders_too(ripples, place):
    part = sensor(
        with_sensor(ripples, {"pi": 0.9, "fair-pi": 0.9, "pi-ilc": 0.9}),
        "low-speed",
        line := compare(ripples, "low-speed")[place],
    )
    if place == 4:  # of the torque
        assert part is None
        return
    assert list(part.shares.values()) == pytest.approx([0.99] * 3, rel=1e-6)
    assert part.seen.values["pi"] == pytest.approx(0.1 * line.values["pi"], rel=1e-6)


def test_where_the_sensor_dominates_all_the_true_ripple_is_the_headline(ripples):
    """Truly the ILC is the best by far; of what is seen the PI leaves least."""
    found = verdicts(with_sensor(ripples, {"pi": 0.999, "fair-pi": 0.9, "pi-ilc": 0.9}))[0]
    assert found.headline == verdicts(ripples)[0].headline and found.tone == "better"
    seen = "PI-ILC 0.157 rpm, PI re-tuned 0.517 rpm and PI as published 0.0118 rpm."
    whole = "PI-ILC 1.57 rpm (99 %), PI re-tuned 5.17 rpm (99 %) and PI as published 11.8 rpm (100 %)."
    assert found.details[0].endswith(f"{whole} The measured values show: {seen}")


def test_where_it_dominates_some_the_true_error_decides(ripples):
    found = verdicts(with_sensor(ripples, {"pi-ilc": 0.98, "pi": 0.01, "fair-pi": 0.01}))[0]
    assert found.headline.startswith("At 60 rpm, PI-ILC leaves 1.57 rpm of speed ripple, 7.52 times less")
    assert found.details[0].endswith(
        "its share of the mean square): PI-ILC 1.57 rpm (100 %). The measured values show: PI-ILC 0.0314 rpm."
    )


def test_of_one_controller(ripples):
    alone = Results(ripples.study, [run for run in ripples.runs if run.controller == "pi-ilc"])
    found = verdicts(with_sensor(alone, {"pi-ilc": 0.98}))[0]
    assert found.headline == "At 60 rpm, speed ripple: PI-ILC 1.57 rpm."
    assert found.details[1].startswith("Most of the true speed ripple comes from the sensor's own error")


def test_a_sensor_that_gives_no_number_says_nothing(ripples):
    broken = with_sensor(ripples, {"pi": math.nan})
    assert sensor(broken, "low-speed", compare(broken, "low-speed")[3]) is None


def test_late_in_a_run_that_turns_jitter_is_of_the_errors(made):
    text = re.sub(r"<[^>]+>", "|", late_table(made, made.runs))
    for name, signal in (("", "theta_error"), (" as measured", "theta_error_measured")):
        row = re.search(rf"position jitter{name}, rms(.*?)position jitter", text, re.DOTALL)[1]
        told = [float(value) for value in re.findall(r"([\d.]+) deg", row)]
        here = [np.rad2deg(np.std(run.trace[signal][late(made, run)])) for run in made.runs]
        assert told == pytest.approx(here, rel=5e-3)
