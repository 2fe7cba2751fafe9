"""A law of chosen orders in a run: what it leaves, what is recorded and kept of it, and a fault."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import studies
from cogless import load, run_study
from cogless.control_library import Status
from cogless.report.charts import to_page
from cogless.report.map_charts import maps
from cogless.results import Results, Run

SPEED = 2 * np.pi  # rad/s
JUMP = {"kind": "angle-jump", "angle": "30 deg", "time": "3 s", "duration": "0.5 s"}


@functools.cache
def made() -> Results:
    changes = {"scenario.1-rev-s.duration": "4 s", "scenario.1-rev-s.faults": [JUMP], "metric": []}
    return run_study(load("uomodri", {**changes, **studies.AFC}), ["1-rev-s/pi", "1-rev-s/pi-afc"])


def run_of(name: str) -> Run:
    return next(run for run in made().runs if run.controller == name)


def amplitude(name: str, order: int) -> float:
    """Of an order of the speed in the last revolution before the fault, rad/s."""
    trace = run_of(name).trace
    rows = trace.window(2, 3)
    wave = (trace["omega_m"][rows] - SPEED) * np.exp(-1j * order * trace["theta_m"][rows])
    return 2 * float(np.abs(np.mean(wave)))


def test_chosen_orders_go_and_the_rest_stays() -> None:
    assert amplitude("pi", 72) > 1.0
    assert amplitude("pi-afc", 72) < 0.01 * amplitude("pi", 72)
    assert amplitude("pi-afc", 216) > 0.3 * amplitude("pi", 216)


def test_its_terms_add_up_to_the_current_that_it_asks_for() -> None:
    trace = run_of("pi-afc").trace
    parts = sum(trace[f"term_{name}"] for name in ("proportional", "integral", "afc"))
    free = (trace["status"].astype(int) & (Status.SATURATED | Status.OFF)) == 0
    np.testing.assert_allclose(parts[free], trace["i_q_ref"][free], atol=1e-5)
    assert np.std(trace["term_afc"]) > 0.1


def test_what_is_learned_is_the_cogging() -> None:
    """0.184 A at order 72 by the data; dead time adds to it. The chart on the page is the same current."""
    run = run_of("pi-afc")
    assert run.map is not None and run.map.law_name == "pi-afc"
    assert run.map.values[2].tolist() == [12, 18, 24, 36, 54, 72, 90, 144]
    current, angle = run.memory["current"], run.memory["angle"]
    order = 2 * abs(np.mean(current * np.exp(-72j * angle)))
    assert order == pytest.approx(np.hypot(*run.map.values[:2, 5]), rel=1e-6)
    assert 0.17 < order < 0.25
    (chart,) = to_page(maps(made(), made().runs))
    (series,) = chart["series"]
    assert max(series["values"]) == pytest.approx(np.max(current), rel=0.01)


def test_learning_waits_while_the_angle_is_wrong() -> None:
    trace = run_of("pi-afc").trace
    status, learned = trace["status"].astype(int), trace["term_afc"]
    jumped = trace.window(3.01, 3.49)
    assert np.all(status[jumped] & Status.FROZEN) and np.std(learned[jumped]) > 0.1
    late = trace.window(3.8, 4.0)
    assert not np.any(status[late] & Status.FROZEN)
