"""Ripple of a plan's and of a found study is of the steady ends of their scenarios."""

from __future__ import annotations

import pytest

from cogless.identify.described import metrics, steady_for

REVERSED = {
    "profile": [["0 s", "2 rad/s"], ["8 s", "2 rad/s"], ["8.4 s", "-2 rad/s"], ["12.4 s", "-2 rad/s"]]
}
SWEPT = {"profile": [["0 s", "2 rad/s"], ["1 s", "30 rad/s"], ["2 s", "-30 rad/s"]]}


@pytest.mark.parametrize(
    ("reference", "duration", "steady"),
    [
        (REVERSED, "12.4 s", 4.0),
        (REVERSED, "14 s", 5.6),
        (SWEPT, "2 s", 0.0),
        ("3 rad/s", "5 s", 5.0),
        ("0 rad/s", "5 s", 0.0),
        ({"offset": "1 rad/s", "amplitude": "1 rad/s", "frequency": "1 Hz"}, "5 s", 0.0),
    ],
)
def test_a_reference_ends_at_a_steady_speed(reference, duration, steady):
    assert steady_for(reference, duration) == pytest.approx(steady)


def test_ripple_is_of_steady_ends_alone():
    both = {
        "slow": {"reference": REVERSED, "duration": "12.4 s"},
        "swept": {"reference": SWEPT, "duration": "2 s"},
    }
    (ripple,) = metrics(both, [72, 12])  # too slow for a revolution
    assert ripple["scenarios"] == ["slow"] and ripple["last"] == "3 s"
    both["fast"] = {"reference": "9 rad/s", "duration": "12 s"}
    ripple, waves = metrics(both, [72, 12])
    assert ripple["scenarios"] == ["slow", "fast"] and waves["scenarios"] == ["fast"]
    assert waves["order"] == [12, 72]
    assert metrics({"swept": both["swept"]}) == []
