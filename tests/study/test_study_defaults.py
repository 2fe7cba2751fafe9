"""What a study means where it says nothing: another default would change every study that relies on it."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from math import radians
from typing import Any

import pytest

import cogless.study
from cogless.study.table import Table

GIVEN: dict[str, float | bool] = {
    "identify.config.Column.sign": 1,
    "study.base.TraceSettings.file_rate": 1000.0,
    "study.calibration.Target.weight": 1.0,
    "study.controller.AntiCogging.cells": 720,
    "study.controller.Commissioning.revolutions": 1,
    "study.controller.Learning.cells": 1024,
    "study.controller.Learning.forgetting": 1.0,
    "study.controller.Tuning.phase_margin": radians(45),
    "study.drive.CurrentLoop.decoupling": True,
    "study.drive.CurrentSensors.range": 10.0,
    "study.drive.CurrentSensors.sensors": 3,
    "study.drive.Drive.guard": True,
    "study.drive.EncoderTable.limit": radians(2),
    "study.drive.EncoderTable.time_constant": 0.5,
    "study.drive.Inverter.computation_delay": 1,
    "study.drive.Rates.integration_steps": 1,
    "study.mechanics.LoadSide.ratio": 1.0,
    "study.monitor.Quality.longest": 60.0,
    "study.pi_afc.PiAfc.omega_min": 0.01,
    "study.plant.LinearPlant.input_limit": 1000000.0,
    "study.position_sensor.Counted.window": 16,
    "study.position_sensor.Encoder.timer": 100000000.0,
    "study.position_sensor.Hall.edges": 6,
    "study.position_sensor.Hall.timer": 1000000.0,
    "study.position_sensor.Resolver.bits": 14,
    "study.space_controller.Period.parts": 1,
    "study.space_controller.Period.turns": 1,
    "study.space_controller.SpaceLearning.cells": 1024,
    "study.space_controller.SpaceLearning.k_pp": 10.0,
    "study.space_controller.SpaceLearning.learning": True,
    "study.space_controller.SpaceLearning.omega_min": 0.01,
    "study.space_controller.SpaceLearning.q_half_width": 5,
    "study.space_controller.SpacePosition.hand_over": True,
    "study.space_controller.SpacePosition.ramp": 1.0,
    "study.step_motor.StepMotor.i_f": 1.0,
    "study.temperature.MotorTemperature.reference": 20.0,
    "study.temperature.MotorTemperature.resistance_coefficient": 0.00393,
    "study.trial_controller.DesignSettings.initial_error": 0.1,
    "study.trial_controller.NormOptimalIlc.change_weight": 0.01,
    "study.trial_controller.NormOptimalIlc.feedforward": True,
    "study.trial_controller.NormOptimalIlc.integral": True,
    "study.trial_controller.ObserverIlc.feedforward": True,
    "study.trial_controller.ObserverIlc.learning": True,
    "study.trial_controller.QFilter.order": 2,
    "study.trial_controller.TrialIlc.feedforward": True,
    "study.trial_controller.TrialIlc.integral": True,
    "study.trial_controller.TrialIlc.learning": True,
    "study.trial_controller.TrialLaw.learned_limit": 1000000.0,
    "study.vary.Hold.share": 1.0,
    "study.vary.Tune.budget": 200,
    "study.vary.Tune.variants": 32,
}


def models(base: type[Table]) -> Iterator[type[Table]]:
    for model in base.__subclasses__():
        yield model
        yield from models(model)


def test_what_is_left_out_is_zero_or_off_apart_from_these() -> None:
    for module in pkgutil.iter_modules(cogless.study.__path__):
        import_module(f"cogless.study.{module.name}")
    import_module("cogless.identify.config")
    found: dict[str, Any] = {
        f"{model.__module__.removeprefix('cogless.')}.{model.__name__}.{name}": field.default
        for model in models(Table)
        if model.__module__.startswith("cogless.")
        for name, field in model.model_fields.items()
        if name in model.__annotations__ and isinstance(field.default, bool | int | float) and field.default
    }
    assert found == {name: pytest.approx(value, rel=1e-12) for name, value in GIVEN.items()}
