"""The shipped studies of drives as they are on a bench, against closed forms and the uOmodri board's log."""

import math
from typing import Any

import numpy as np
import pytest

from cogless import load, run_study
from cogless.study import Study

RPM = 2 * math.pi / 60


def metrics(study: Any, *runs: str) -> dict[str, Any]:
    """Metrics by controller."""
    return {run.controller: run.metrics for run in run_study(study, list(runs), jobs=2).runs}


def test_the_bench_has_the_speeds_of_its_log_without_being_fitted() -> None:
    """The log's filtered speed has a standard deviation of 3.30 rad/s without and 0.81 with its table."""
    made = metrics(load("uomodri-bench", {"scenario.1-rev-s.duration": "6 s"}), "*")
    assert made["p"]["speed_as_logged_rad_s"] == pytest.approx(3.30, rel=0.2)
    assert made["table"]["speed_as_logged_rad_s"] == pytest.approx(0.81, rel=0.3)
    (order_72,) = made["p"]["order_as_logged_rad_s"]
    assert order_72 == pytest.approx(2.70, rel=0.15)  # the log's, by examples/identify_cogging.py
    assert made["p"]["mean_speed_rad_s"] < 0.9 * 2 * math.pi  # friction, and no integral


def test_the_benchs_table_is_the_holding_current_of_the_motors_harmonics() -> None:
    study = load("uomodri-bench")
    assert isinstance(study, Study)
    start = getattr(study.controller["table"], "start", None)
    assert start is not None
    table, motor = start.over_angle, study.motor.star()
    angle = np.array(table.angle)
    torque = sum((c.torque or 0.0) * np.sin(c.order * angle + c.phase) for c in motor.cogging)
    np.testing.assert_allclose(np.array(table.value), -torque / motor.K_t, atol=1e-5)


def test_a_gimbal_follows_its_encoder_and_loses_its_cogging() -> None:
    """An error of 0.3 deg once a revolution moves the speed of 40 r/min by 0.3 deg times that."""
    study = load("gimbal", {"scenario.scan.duration": "25 s"})
    made = metrics(study, "scan/pi", "scan/pi-ilc", "scan/table")
    by_order = {
        name: dict(zip((1, 2, 12, 14, 84), m["speed_order_rad_s"], strict=True)) for name, m in made.items()
    }
    for orders in by_order.values():
        assert orders[1] == pytest.approx(math.radians(0.3) * 40 * RPM, rel=0.05)
    for name in ("pi-ilc", "table"):
        assert by_order[name][12] < 0.1 * by_order["pi"][12]
        assert by_order[name][84] < 0.5 * by_order["pi"][84]


def test_in_position_friction_holds_and_without_it_the_rotor_swings_within_a_count() -> None:
    study, count = load("gimbal"), 2 * math.pi / 2**14
    for run in run_study(study, ["hold/pi", "hold-floating/pi"]).runs:
        jitter, seen = run.metrics["jitter_3_sigma_rad"], run.metrics["jitter_3_sigma_as_measured_rad"]
        assert jitter == pytest.approx(3 * run.metrics["jitter_rms_rad"])
        if run.scenario == "hold":
            assert jitter < 0.01 * count and seen < 1e-12
        else:
            assert 0.2 * count < jitter < count < seen < 3 * count  # at most 3/2 of the jump, and its error
    (fine,) = run_study(load("gimbal", {"drive.position_sensor.bits": 18}), ["hold-floating/pi"]).runs
    assert fine.metrics["jitter_3_sigma_rad"] < 0.8 * 0.4 * count


def test_a_hub_motor_learns_what_90_steps_a_revolution_show_and_no_more() -> None:
    made = metrics(load("hub-motor", {"scenario.walk.duration": "28 s"}), "walk/*")
    orders = {name: m["speed_order_rad_s"] for name, m in made.items()}
    for name in ("pi-ilc", "pi-afc"):
        assert made[name]["speed_ripple_rad_s"] < 0.1 * made["pi"]["speed_ripple_rad_s"]
        assert np.all(np.array(orders[name][:2]) < 0.1 * np.array(orders["pi"][:2]))  # 1 and 2
        assert orders[name][3] == pytest.approx(orders["pi"][3], rel=0.1)  # 30


def test_what_an_encoder_off_the_middle_does_to_knowledge_and_to_learning() -> None:
    """Whoever learns follows the encoder: 0.5 deg times 60 r/min.

    A table that knows the cogging at the true angle is read at another one: its order 72 is modulated by 72
    times 0.5 deg, and sidebands are left.
    """
    laws = ("known-table", "knows-and-learns", "pi-afc")
    study = load("on-the-bench")
    good = metrics(study, *(f"as-known/{law}" for law in laws))
    off = metrics(study, *(f"eccentric/{law}" for law in laws))
    for law in ("knows-and-learns", "pi-afc"):
        assert off[law]["speed_order_rad_s"][0] == pytest.approx(math.radians(0.5) * 60 * RPM, rel=0.03)
    assert off["known-table"]["speed_ripple_rad_s"] > 3 * good["known-table"]["speed_ripple_rad_s"]
    assert off["pi-afc"]["speed_ripple_rad_s"] > 5 * good["pi-afc"]["speed_ripple_rad_s"]
    seen = off["knows-and-learns"]["speed_ripple_as_measured_rad_s"]
    assert seen < 0.5 * off["knows-and-learns"]["speed_ripple_rad_s"]


def test_on_a_soft_shaft_learning_that_would_grow_is_stopped_and_a_wider_q_filter_repairs_it() -> None:
    # what grows is above the feedback's ripple from 7 s on; by 12 s it has to be gone
    study = load("on-the-bench", {"scenario.soft-shaft.duration": "14 s"})
    made = metrics(study, "soft-shaft/pi", "soft-shaft/pi-ilc", "soft-shaft/pi-afc")
    wide = metrics(load("on-the-bench", {"controller.pi-ilc.q_half_width": 3}), "soft-shaft/pi-ilc")
    last = {name: m["speed_ripple_rad_s"] for name, m in made.items()}
    assert last["pi-ilc"] < 1.1 * last["pi"]
    assert last["pi-afc"] < 0.1 * last["pi"]
    assert wide["pi-ilc"]["speed_ripple_rad_s"] < 0.1 * last["pi"]


def test_knowledge_helps_from_the_start_and_a_warm_motor_harms_neither() -> None:
    study = load(
        "on-the-bench",
        {f"scenario.{name}.duration": "4 s" for name in ("as-known", "eccentric", "warm", "soft-shaft")},
    )
    made = metrics(study, "warm/pi", "warm/pi-ilc", "warm/knows-and-learns", "warm/known-table")
    first = {name: m["ripple_at_first_rad_s"] for name, m in made.items()}
    last = {name: m["speed_ripple_rad_s"] for name, m in made.items()}
    assert first["knows-and-learns"] < 0.3 * first["pi-ilc"]
    assert last["known-table"] < 0.2 * last["pi"]
    assert last["knows-and-learns"] < 0.5 * last["known-table"]
