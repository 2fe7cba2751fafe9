"""The study of the real motor: its figures come from the data, and learning beats the same feedback."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cogless import load, run_study

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "laas_anti_cogging"
sys.path.append(str(ROOT / "examples"))
SCENARIOS = ("perfect", "eccentric", "calibrated")
has_data = pytest.mark.skipif(not DATA.exists(), reason="the measured data are not part of this repository")


@has_data
def test_cogging_and_friction_are_the_measured_ones() -> None:
    from identify_cogging import holding_current

    coulomb, shape = holding_current(DATA)
    study = load("uomodri")
    motor = study.motor.star()
    assert study.mechanics.coulomb_friction == pytest.approx(coulomb * motor.K_t, rel=0.005)
    for harmonic in motor.cogging:
        amplitude, phase = shape[harmonic.order]
        assert harmonic.torque == pytest.approx(amplitude * motor.K_t, rel=0.02)
        assert np.cos(harmonic.phase - phase) == pytest.approx(-1.0, abs=1e-4)


@has_data
def test_inertia_is_the_identified_one() -> None:
    from identify_cogging import inertia_over_torque_constant

    study = load("uomodri")
    windows = [
        inertia_over_torque_constant(DATA, on, rows) for on in (False, True) for rows in (2, 3, 5, 8, 12, 20)
    ]
    assert study.mechanics.inertia / study.motor.star().K_t == pytest.approx(np.median(windows), rel=0.02)


@pytest.fixture(scope="module")
def ripple() -> dict[tuple[str, str], float]:
    """Speed ripple, rad/s, of a scenario and a controller."""
    compared = [*(f"*/{name}" for name in ("pi", "table", "robust-ilc", "harmonic")), "fast/pi-ilc"]
    runs = run_study(load("uomodri"), compared, jobs=2).runs
    return {(run.scenario, run.controller): float(run.metrics["speed_ripple_rad_s"]) for run in runs}


def ripple_at_speed(controller: str, lead: str) -> float:
    """Speed ripple, rad/s, in the fast scenario with another lead."""
    (run,) = run_study(load("uomodri", {f"controller.{controller}.lead": lead}), [f"fast/{controller}"]).runs
    return float(run.metrics["speed_ripple_rad_s"])


def test_learning_leaves_less_ripple_than_the_feedback_and_the_table_at_every_speed(
    ripple: dict[tuple[str, str], float],
) -> None:
    for scenario in load("uomodri").scenario:
        pi = ripple[scenario, "pi"]
        assert ripple[scenario, "table"] < 0.5 * pi
        assert ripple[scenario, "robust-ilc"] < 0.1 * pi
        assert ripple[scenario, "robust-ilc"] < 0.5 * ripple[scenario, "table"]


def test_harmonic_with_nothing_to_tune_leaves_least_where_cogging_is_strong(
    ripple: dict[tuple[str, str], float],
) -> None:
    assert load("uomodri").controller["harmonic"].tuning.rule == "auto"
    for scenario in ("1-rev-s", "fast"):
        assert ripple[scenario, "harmonic"] < 0.7 * ripple[scenario, "robust-ilc"]
    assert ripple["slow", "harmonic"] < 0.15 * ripple["slow", "pi"]


def test_dead_time_compensation_leaves_a_tenth_of_a_revolution_a_minute() -> None:
    runs = run_study(load("uomodri-dead-time"), ["as-it-is/pi-afc", "compensated/pi-afc"], jobs=2).runs
    before, after = (float(run.metrics["speed_ripple_rad_s"]) * 60 / (2 * np.pi) for run in runs)
    assert before > 0.5
    assert after < 0.1


def test_an_encoder_off_the_middle_costs_nothing_once_its_error_is_learned() -> None:
    study = load("uomodri-eccentric")
    runs = run_study(study, [f"{name}/pi-ilc" for name in SCENARIOS], jobs=2).runs
    perfect, eccentric, calibrated = (float(run.metrics["speed_ripple_rad_s"]) for run in runs)
    assert eccentric > 1.5 * perfect
    assert calibrated < 1.3 * perfect


def test_without_its_lead_learning_is_of_no_use_at_high_speed(ripple: dict[tuple[str, str], float]) -> None:
    """At 4 rev/s the cogging of order 72 lies at 288 Hz, beyond the speed loop's crossover."""
    assert ripple["fast", "pi-ilc"] < 0.1 * ripple["fast", "pi"]
    assert ripple_at_speed("pi-ilc", "0 s") > 3.0 * ripple["fast", "pi-ilc"]


def test_the_tables_lead_makes_up_for_the_current_loop(ripple: dict[tuple[str, str], float]) -> None:
    assert load("uomodri").controller["table"].lead == pytest.approx(0.6e-3)
    assert ripple["fast", "table"] < ripple_at_speed("table", "0 s")
