"""The factor per period that `cogless design` predicts, against simulations that learn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cogless import load, run_study
from cogless.design.learning import learning

# without quantisation and forgetting, so that growth and decay can be seen over many periods
CLEAN: dict[str, Any] = {
    "drive.position_sensor.lines": 1_000_000,
    "drive.current_sensors.gain_error": [0.0, 0.0, 0.0],
    "controller.pi-ilc.forgetting": 1.0,
    "controller.pi-ilc.learning_start": "1 s",
    "controller.pi-ilc.cells": 8192,  # so many that interpolation between them doesn't filter
    "trace.rate": "1 kHz",
}


def growth(changes: dict[str, Any], frequency: float, begin: float, end: float) -> float:
    """Factor per period of the error's component at a frequency, over so many seconds of the run."""
    study = load("liu2018", {**CLEAN, **changes})
    (run,) = run_study(study, ["60-rpm/pi-ilc"]).runs
    time, error = run.trace["time"], run.trace["omega_error"]
    period, amplitudes = 0.25, []  # 60 r/min, 4 pole pairs
    for start in np.arange(begin, end, period):
        rows = (time >= start) & (time < start + period)
        amplitudes.append(abs(np.mean(error[rows] * np.exp(-2j * np.pi * frequency * time[rows]))))
    slope = np.polyfit(np.arange(len(amplitudes)), np.log(amplitudes), 1)[0]
    return float(np.exp(slope))


@pytest.mark.parametrize(("gain", "lead"), [("0.02 A/rpm", "0 s"), ("0.015 A/rpm", "6 ms")])
def test_growth_is_the_predicted_one(gain: str, lead: str) -> None:
    changes = {"controller.pi-ilc.gain": gain, "controller.pi-ilc.lead": lead}
    found = learning(load("liu2018", {**CLEAN, **changes}), "pi-ilc")
    assert found is not None
    assert found.factor > 1.02
    frequency = round(found.frequency / 4.0) * 4.0  # whole orders of the electrical revolution
    assert growth(changes, frequency, 2.5, 4.5) == pytest.approx(found.factor, rel=0.03)


def test_a_lead_makes_every_frequency_decay() -> None:
    with_lead, without = (
        learning(load("uomodri", {"controller.pi-ilc.lead": lead}), "pi-ilc") for lead in ("0.4 ms", "0 s")
    )
    assert with_lead is not None
    assert without is not None
    assert with_lead.factor < 1.001
    assert without.factor > 1.2


def test_only_learning_laws_have_a_factor() -> None:
    study = load("uomodri")
    assert learning(study, "pi") is None
    assert learning(study, "table") is None
    assert learning(study, "robust-ilc") is not None
