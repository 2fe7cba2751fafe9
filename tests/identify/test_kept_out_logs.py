"""The study that identify writes predicts the ripple of a log that was kept out, on a plant of its own."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SEED = 7


@pytest.mark.parametrize("kind", ["gear", "wheel"])
def test_a_kept_out_log_ripples_as_predicted(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gear's friction varies over the angle, and the wheel's falls with the speed."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import identify_predicted as predicted  # type: ignore[import-not-found]

    plant = sys.modules["identify_plant"]
    (motor,) = [one for one in predicted.motors_of(SEED) if one.kind == kind]
    (raw,) = plant.simulated([motor], SEED)
    estimate, ratios = predicted.compared(SEED, motor, raw, 1000.0)
    for name, goal in predicted.GOALS.items():
        assert ratios[name] == pytest.approx(1.0, abs=goal)
    assert {wave.order: wave.size.value / estimate.values["c"].value for wave in estimate.friction} == {
        order: pytest.approx(share, rel=0.05) for order, share, _ in motor.friction_waves
    }
    if motor.stribeck:
        assert estimate.values["stribeck"].times(motor.K_t).value == pytest.approx(motor.stribeck, rel=0.3)
