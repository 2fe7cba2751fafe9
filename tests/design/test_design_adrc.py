"""Active disturbance rejection as a linear feedback: its response, and bandwidths for a phase margin."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reference.adrc import Adrc

from cogless import load, run_study
from cogless.design.laws import adrc as rule
from cogless.design.laws.adrc import OBSERVER_RATIO, response
from cogless.design.margins import UNSTABLE, Margins
from cogless.design.summary import design
from cogless.errors import StudyError


def adrc(phase_margin: str = "45 deg", **more: float) -> dict[str, Any]:
    """Changes of a study: the law with its rule."""
    return {
        "controller.adrc": {"law": "adrc", "tuning": {"rule": "auto", "phase_margin": phase_margin}, **more}
    }


@pytest.mark.parametrize("w", [3.0, 40.0, 700.0])
def test_the_response_is_that_of_the_law(w: float) -> None:
    """A sine of the measured speed through the transcription, after its start has died away."""
    law = Adrc(300.0, 50.0, 200.0, 1e-3, 1e9)
    n = np.arange(round(40 * math.tau / w * 1e3) + 4000)
    current = np.array([law.step(0.0, float(x)) for x in np.sin(w * n * 1e-3)])
    last = slice(len(n) // 2, None)
    angle = w * n[last] * 1e-3
    basis = np.stack(
        [np.sin(angle), np.cos(angle), np.ones(len(angle))], axis=1
    )  # the integral keeps a constant
    (real, imaginary, _), *_ = np.linalg.lstsq(basis, current[last], rcond=None)
    expected = response(np.array([w]), 1e-3, 300.0, 50.0, 200.0)[0]
    assert complex(real, imaginary) == pytest.approx(expected, rel=1e-6)


def test_the_rule_gives_the_phase_margin() -> None:
    study = load("uomodri", adrc(phase_margin="52 deg"))
    found = design(study, "adrc")
    assert found.rule == "auto" and found.margins is not None
    assert found.margins.stable and math.degrees(found.margins.phase_margin) == pytest.approx(52, abs=0.01)
    assert found.gains["omega_o"].value == pytest.approx(OBSERVER_RATIO * found.gains["omega_c"].value)


def test_a_margin_that_the_observers_lag_forbids_is_told() -> None:
    with pytest.raises(StudyError, match=r"controller\.adrc\.tuning: expected a loop that reaches this"):
        load("uomodri", adrc(phase_margin="70 deg"))


def test_at_the_same_margin_it_is_softer_than_a_pi() -> None:
    """The observer's lag costs bandwidth; it holds the speed all the same."""
    changes = {**adrc(), "controller.pi.tuning.phase_margin": "45 deg", "scenario.fast.duration": "5 s"}
    runs = {
        run.controller: run.metrics
        for run in run_study(load("uomodri", changes), ["fast/adrc", "fast/pi"]).runs
    }
    ripple = {name: found["speed_ripple_rad_s"] for name, found in runs.items()}
    assert ripple["pi"] < ripple["adrc"] < 3 * ripple["pi"]


def test_an_observer_faster_than_its_samples_is_refused() -> None:
    with pytest.raises(StudyError, match=r"controller\.adrc\.omega_o: .*expected less than 10000 rad/s"):
        load("uomodri", adrc(omega_o=10001.0))


T = 1e-3


@pytest.mark.parametrize(("edge", "omega_c"), [(0.3, 150.0), (0.9, 450.0), (2.0, 500.0)])
def test_bandwidths_are_the_largest_with_the_margin(
    monkeypatch: pytest.MonkeyPatch, edge: float, omega_c: float
) -> None:
    """Here the margin falls with the bandwidth. The observer has four times that, 2 rad a sample at most."""

    def margins(loop: Any, b: float, omega_c: float, omega_o: float) -> Margins:
        assert omega_o == 4 * omega_c and b == 7.0
        share = omega_c / 500.0
        return Margins(True, 1.0, 1.0 + edge - share, 2.0, 1.0) if share <= 0.95 or edge > 1 else UNSTABLE

    monkeypatch.setattr(rule, "adrc_margins", margins)
    loop: Any = SimpleNamespace(period=T)
    find = rule.bandwidths.__wrapped__
    assert find(loop, 7.0, 1.0) == pytest.approx((omega_c, 4 * omega_c))
    with pytest.raises(ValueError, match="expected a loop that reaches this phase margin with some gains"):
        find(loop, 7.0, 4.0)
