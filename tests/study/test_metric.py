"""A metric's name among results, the direction that is better, and the window that its keys decide."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.errors import StudyError
from cogless.study.metric import Metric, result_name, whole_revolutions
from cogless.study.metric_checks import _span


def metric(**keys: Any) -> Metric:
    return Metric.model_validate({"name": "m", "kind": "rms", "signal": "omega_m", **keys})


def settling(event: float, **keys: Any) -> Metric:
    return metric(kind="settling", event=f"{event!r} s", band="2 rpm", **keys)


def test_a_name_among_results_ends_with_its_unit_once() -> None:
    assert result_name(metric()) == "m_rad_s"
    assert result_name(metric(name="speed_rad_s")) == "speed_rad_s"
    assert result_name(metric(signal="tau_load")) == "m_N_m"
    assert result_name(metric(signal="alpha_ref")) == "m_rad_s2"
    assert result_name(metric(signal="status")) == "m"


def test_a_band_is_better_left_late_unless_said_otherwise() -> None:
    left = {"kind": "exceeds", "band": "2 rpm", "event": "0.1 s"}
    assert metric().better_direction == "lower"
    assert metric(better="higher").better_direction == "higher"
    assert metric(**left).better_direction == "higher"
    assert metric(**left, better="lower").better_direction == "lower"


def test_numbers_of_a_metric_are_si_and_its_unit_is_what_is_shown() -> None:
    found = metric(unit="rpm", limit="5 rpm", better="lower")
    assert found.unit == "rpm" and found.limit == pytest.approx(5 * math.pi / 30)
    assert settling(0.1, smooth="2 ms").smooth == pytest.approx(2e-3)
    with pytest.raises(ValueError, match='expected no such key, since kind = "rms"'):
        metric(smooth="2 ms")
    with pytest.raises(ValueError, match='expected no such key, since better = "none"'):
        metric(limit="5 rpm", better="none")


def test_the_last_part_of_a_run_is_all_of_a_shorter_one() -> None:
    assert metric(last="0.5 s").span(2.0) == (1.5, 2.0)
    assert metric(last="0.5 s").span(0.4) == (0.0, 0.4)
    assert metric(window=["0.1 s", "0.3 s"]).span(2.0) == (0.1, 0.3)
    assert metric().span(2.0) is None
    with pytest.raises(ValueError, match="expected an end after the beginning"):
        metric(window=["0.1 s", "0.1 s"])


def test_an_event_s_window_ends_at_the_next_one(tmp_path: Path) -> None:
    """Events at 0.1, 0.2 and 0.26 s of 0.35 s; a time that differs by rounding is the same event."""
    events = [{"time": f"{time} s", "load": "0.2 N*m"} for time in (0.1, 0.2, 0.26)]
    changes = {"scenario.step.duration": "0.35 s", "scenario.step.events": events}
    study = studies.study(tmp_path, changes)
    step = study.scenario["step"]
    for event, lasts in ((0.1, 0.1), (0.2, 0.06), (0.26, 0.09), (0.1 - 1e-12, 0.1)):
        key, span = _span(study, settling(event), step)
        assert (key, span) == ("event", pytest.approx(lasts))
    near = [off for off in (-1.1e-9, -9e-10, 9e-10, 1.1e-9) if step.has_event(0.1 + off)]
    assert near == [-9e-10, 9e-10]
    assert _span(study, metric(), step) == ("window", 0.35)
    assert _span(study, metric(last="0.2 s"), step) == ("last", pytest.approx(0.2))
    assert _span(study, metric(window=["0.1 s", "0.25 s"]), step) == ("window", pytest.approx(0.15))


def test_parts_of_an_order_need_several_revolutions() -> None:
    assert whole_revolutions([1.0, 2.0, 6.0]) == 1
    assert whole_revolutions([0.5, 1 / 3]) == 6


@pytest.mark.parametrize(("frame", "turns"), [("mechanical", 1), ("electrical", 4)])
def test_an_order_needs_a_revolution_but_for_two_rows(tmp_path: Path, frame: str, turns: int) -> None:
    """At 60 r/min; or but for a thousandth of it, which is more than two rows at 15 kHz."""
    whole = {"name": "o", "kind": "order", "signal": "omega_m", "order": 1, "frame": frame}
    rows, thousandth = 2 / 500, 1e-3 / turns
    for rate, missing, enough in (
        ("500 Hz", 0.95 * rows, True),
        ("500 Hz", 1.05 * rows, False),
        ("15 kHz", 0.95 * thousandth, True),
        ("15 kHz", 1.05 * thousandth, False),
    ):
        length = 1 / turns - missing
        changes = {"metric": [{**whole, "scenarios": ["low"]}], "scenario.low.duration": f"{length:.9f} s"}
        changes["trace.rate"] = rate
        if enough:
            studies.study(tmp_path, changes)
        else:
            expected = f"expected a window of 1 or more {frame} revolutions at the top speed of scenario "
            expected += '"low", not of '
            with pytest.raises(StudyError, match=expected):
                studies.study(tmp_path, changes)
