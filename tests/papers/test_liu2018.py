"""The shipped study of Liu 2018 shows what the paper says, with ripple calibrated on the PI rows alone."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from cogless import load, run_study
from cogless.results import Run

RPM = np.pi / 30.0
# Tables IV, VI, VII and II: PI at orders 1, 2, 6, r/min
PI_ROWS = {
    "60-rpm": (1.25, 1.38, 4.87),
    "60-rpm-30-load": (1.48, 2.10, 5.15),
    "60-rpm-78-load": (1.52, 2.89, 6.98),
    "900-rpm": (2.49, 0.20, 0.89),
}
LAWS = ("pi", "pi-ilc", "robust-ilc")


@cache
def runs(*names: str, **changes: Any) -> dict[str, Run]:
    results = run_study(load("liu2018", changes or None), list(names), jobs=2)
    return {f"{run.scenario}/{run.controller}": run for run in results.runs}


def steady() -> dict[str, Run]:
    return runs(*(f"{scenario}/{law}" for scenario in PI_ROWS for law in LAWS))


def steps() -> dict[str, Run]:
    return runs(*(f"{speed}-step/{law}" for speed in ("60-rpm", "900-rpm") for law in ("pi-fair", *LAWS[1:])))


@pytest.mark.parametrize("scenario", PI_ROWS)
def test_ripple_is_calibrated_on_the_pi_rows(scenario: str) -> None:
    orders = np.array(steady()[f"{scenario}/pi"].metrics["speed_order_rad_s"]) / RPM
    # at 900 r/min a count is 6 r/min; by where the counts fall, order 2 is 0.25 to 0.27 r/min
    counts = 0.02 if scenario == "900-rpm" else 0.0
    assert orders == pytest.approx(PI_ROWS[scenario], rel=0.06, abs=0.06 + counts)


@pytest.mark.parametrize("scenario", ["60-rpm", "60-rpm-30-load", "60-rpm-78-load"])
def test_pi_then_pi_ilc_then_robust_ilc_at_every_order_and_load(scenario: str) -> None:
    pi, ilc, robust = (np.array(steady()[f"{scenario}/{law}"].metrics["speed_order_rad_s"]) for law in LAWS)
    assert np.all(pi > ilc)
    assert np.all(ilc > robust)


@pytest.mark.parametrize("speed", ["60-rpm", "900-rpm"])
def test_load_step_dips_and_settles_as_published(speed: str) -> None:
    robust, ilc = (steps()[f"{speed}-step/{law}"].metrics for law in ("robust-ilc", "pi-ilc"))
    assert 18.0 < robust["dip_rad_s"] / RPM < 24.0
    assert 34.0 < ilc["dip_rad_s"] / RPM < 44.0
    assert 0.34 < robust["settling_s"] < 0.46


@pytest.mark.parametrize("speed", ["60-rpm", "900-rpm"])
def test_a_fair_pi_dips_no_deeper_than_robust_ilc_by_much(speed: str) -> None:
    """The published PI is the weak one: re-tuned, the same feedback without learning comes close."""
    fair, robust = (steps()[f"{speed}-step/{law}"].metrics["dip_rad_s"] for law in ("pi-fair", "robust-ilc"))
    assert fair < 1.25 * robust


def test_the_terms_sum_to_the_command_and_learning_adds_little_of_it() -> None:
    trace = steady()["60-rpm/robust-ilc"].trace
    terms = {name: trace[name] for name in trace.names if name.startswith("term_")}
    assert np.abs(sum(terms.values()) - trace["i_q_ref"]).max() <= 1e-5
    rms = {name: float(np.sqrt(np.mean(term[len(term) // 2 :] ** 2))) for name, term in terms.items()}
    assert rms["term_f_hat"] + rms["term_r_hat"] < 0.02 * (rms["term_linear"] + rms["term_switching"])


def test_law_29_as_printed_diverges_and_forgetting_cures_it() -> None:
    long = runs("60-rpm-long/pi-ilc-printed", "60-rpm-long/pi-ilc")
    printed, cured = long["60-rpm-long/pi-ilc-printed"].metrics, long["60-rpm-long/pi-ilc"].metrics
    assert 10.0 < printed["diverges_after_s"] < 25.0  # 16.8 s; the path depends on single counts
    assert cured["diverges_after_s"] is None
    assert cured["late_ripple_rad_s"] < 0.1 * printed["late_ripple_rad_s"]


@pytest.mark.parametrize("scenario", ["60-rpm", "60-rpm-30-load", "60-rpm-78-load", "900-rpm"])
def test_the_lead_that_design_names_removes_the_ripple_that_the_paper_leaves(scenario: str) -> None:
    found = runs(f"{scenario}/pi-ilc-lead", f"{scenario}/robust-ilc", f"{scenario}/pi-ilc", f"{scenario}/pi")
    ripple = {run.controller: float(run.metrics["speed_ripple_rad_s"]) for run in found.values()}
    assert ripple["pi-ilc-lead"] < 0.55 * min(ripple["pi"], ripple["pi-ilc"], ripple["robust-ilc"])


def test_the_lead_holds_in_the_long_run() -> None:
    (run,) = runs("60-rpm-long/pi-ilc-lead").values()
    assert run.metrics["diverges_after_s"] is None
    assert run.metrics["late_ripple_rad_s"] < 4.0 * RPM
