"""Warm and saturating motors in batches, in an override and from trial to trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine import drive_of, signals, trial_config

import studies
from cogless import _simulator_f64, rollout
from cogless.run.simulate import simulate

HOT = {"winding": "80 degC", "magnet": "60 degC", "flux_coefficient": "-0.0011 1/K"}
HEATING = {"ambient": "20 degC", "winding_capacity": "2 J/K", "magnet_capacity": "9 J/K"}
SATURATION = {"q": {"current": ["0 A", "1 A", "3 A"], "inductance": ["30 mH", "30 mH", "25 mH"]}}


@pytest.mark.parametrize(
    ("change", "together"),
    [
        ({"motor.temperature": HOT}, True),
        ({"motor.temperature": {**HOT, "heating": HEATING}}, False),
        ({"motor.saturation": SATURATION}, False),
    ],
)
def test_what_runs_in_lanes_says_so_and_gives_the_same(
    tmp_path: Path, change: dict[str, Any], together: bool
) -> None:
    many = [studies.study(tmp_path, {**change, "seed": seed}) for seed in range(2)]
    for study, found in zip(many, rollout(many, ["low/fair"], jobs=1), strict=True):
        run = found.runs[0]
        assert (run.lanes > 1) == together
        assert run.trace.data.tobytes() == simulate(study, "low", "fair").trace.data.tobytes()


def test_a_scenario_starts_warm(tmp_path: Path) -> None:
    study = studies.study(
        tmp_path,
        {"motor.temperature": {"winding": "20 degC"}, "scenario.low.override": {"motor.temperature": HOT}},
    )
    warm, cold = (simulate(study, name, "fair").trace for name in ("low", "step"))
    assert (warm["temperature_magnet"] == 60.0).all()
    assert (cold["temperature_magnet"] == 20.0).all()


def test_temperatures_go_on_from_trial_to_trial() -> None:
    """All else begins anew with each trial."""
    temperature = {
        "winding": 20.0,
        "magnet": 20.0,
        "reference": 20.0,
        "resistance_coefficient": 0.00393,
        "flux_coefficient": -0.0011,
        "drifts": True,
        "ambient": 20.0,
        "winding_capacity": 0.5,
        "magnet_capacity": 1.0,
        "winding_to_ambient": 0.1,
        "winding_to_magnet": 0.1,
        "magnet_to_ambient": 0.1,
    }
    reference = (0.5 * (1 - np.cos(np.linspace(0, 2 * np.pi, 80)))).tolist()
    phase = {"reference": reference, "motor": {"temperature": temperature}}
    drive = drive_of(_simulator_f64, trial_config(3, [phase]))
    x = signals(drive, _simulator_f64, 3 * 80 * 20)
    begins = np.flatnonzero(np.diff(x["trial"])) + 1
    assert len(begins) == 2
    assert (np.diff([20.0, *x["temperature_winding"][begins]]) > 0.005).all()
    assert np.abs(np.diff(x["temperature_winding"])).max() < 0.005
