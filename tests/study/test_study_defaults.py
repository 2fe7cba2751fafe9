"""What a study means where it says nothing, and the numbers that it may say.

Another default would change each study that relies on it; another bound would refuse one, or fail it later.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from math import radians
from typing import Annotated, Any, get_args, get_origin

import pytest
from pydantic.fields import FieldInfo

import cogless.study
from cogless.ensemble.arena_file import GivenFeedback
from cogless.study.controller import Base, Commissioning, Tuning
from cogless.study.table import Quantity, Table
from cogless.study.trial_controller import SignalFilter
from cogless.study.trial_study import EitherWay

GIVEN: dict[str, float | bool] = {
    "identify.config.Column.scale": 1.0,
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
    "study.trial_controller.DesignSettings.sensor": True,
    "study.trial_controller.DesignSettings.initial_error": 0.1,
    "study.trial_controller.NormOptimalIlc.change_weight": 0.01,
    "study.trial_controller.NormOptimalIlc.feedforward": True,
    "study.trial_controller.NormOptimalIlc.integral": True,
    "study.trial_controller.ObserverIlc.feedforward": True,
    "study.trial_controller.ObserverIlc.learning": True,
    "study.trial_controller.SignalFilter.order": 2,
    "study.trial_controller.TrialIlc.feedforward": True,
    "study.trial_controller.TrialIlc.integral": True,
    "study.trial_controller.TrialIlc.learning": True,
    "study.trial_controller.TrialLaw.guard": True,
    "study.trial_controller.TrialLaw.learned_limit": 1000000.0,
    "study.vary.Hold.share": 1.0,
    "study.vary.Tune.budget": 200,
    "study.vary.Tune.variants": 32,
}


BOUNDS = {
    "identify.config.Column.scale": "gt 0",
    "study.arena.Arena.seeds": "ge 0 lt 4294967296",
    "study.base.StudyBase.seed": "ge 0 lt 18446744073709551616",
    "study.calibration.Target.weight": "gt 0",
    "study.controller.AntiCogging.cells": "ge 4 le 65535",
    "study.controller.Commissioning.revolutions": "ge 1 le 100",
    "study.controller.Learning.cells": "ge 4 le 16777216",
    "study.controller.Learning.forgetting": "gt 0 le 1",
    "study.controller.Learning.q_half_width": "ge 0",
    "study.controller.RobustIlc.q": "ge 0",
    "study.drive.CurrentSensors.bits": "ge 0 le 32",
    "study.drive.Rates.integration_steps": "ge 1 le 10000",
    "study.harmonic.Harmonic.base": "ge 1 le 65535",
    "study.mechanics.GearError.order": "ge 1 le 10000",
    "study.mechanics.LoadSide.ratio": "gt 0",
    "study.mechanics.TorqueHarmonic.order": "ge 1 le 10000",
    "study.metric.Metric.order": "gt 0",
    "study.monitor.Quality.outlier": "ge 0",
    "study.motor.Cogging.order": "ge 1 le 10000",
    "study.motor.FluxHarmonic.order": "ge 1 le 10000",
    "study.motor.Motor.pole_pairs": "ge 1 le 1000",
    "study.motor.Motor.slots": "ge 3 le 10000",
    "study.motor.TorqueRipple.order": "ge 1 le 10000",
    "study.motor_tables.AngleFile.orders": "ge 1 le 10000",
    "study.plant.LinearPlant.input_limit": "gt 0 le 1000000000000",
    "study.plant.LinearPlant.load_noise": "ge 0 le 1000000000000",
    "study.plant.LinearPlant.noise": "ge 0 le 1000000000000",
    "study.position_sensor.Absolute.bits": "ge 1 le 31",
    "study.position_sensor.Absolute.positions": "ge 2 le 2147483648",
    "study.position_sensor.AngleOrder.order": "ge 1 le 1000",
    "study.position_sensor.Counted.window": "ge 1 le 100000",
    "study.position_sensor.Encoder.lines": "ge 1 le 10000000",
    "study.position_sensor.Hall.edges": "ge 1 le 6",
    "study.position_sensor.Resolver.bits": "ge 1 le 32",
    "study.space_controller.Period.parts": "ge 1 le 65535",
    "study.space_controller.Period.turns": "ge 1 le 65535",
    "study.space_controller.SpaceLearning.cells": "ge 4 le 16777216",
    "study.space_controller.SpaceLearning.q_half_width": "ge 0",
    "study.step_motor.StepMotor.teeth": "ge 1 le 1000",
    "study.trial_controller.DesignSettings.initial_error": "gt 0",
    "study.trial_controller.DesignSettings.input_weight": "gt 0",
    "study.trial_controller.FilteredLaw.shift": "ge 1 le 65534",
    "study.trial_controller.NormOptimalIlc.change_weight": "gt 0",
    "study.trial_controller.ObserverIlc.pole": "ge 0 lt 1",
    "study.trial_controller.SignalFilter.order": "ge 1 le 4",
    "study.trial_controller.TrialLaw.learned_limit": "gt 0 le 1000000000000",
    "study.trial_scenario.Change.trial": "ge 2",
    "study.trial_scenario.Deviations.initial_state": "ge 0 le 1000000000000",
    "study.trial_scenario.TrialConditions.load_steps": "ge 0",
    "study.trial_scenario.TrialScenario.trials": "ge 1 le 100000",
    "study.vary.Hold.share": "gt 0 le 1",
    "study.vary.Together.correlation": "ge -1 le 1",
    "study.vary.Tune.budget": "ge 2",
    "study.vary.Tune.over": "gt 0 lt 1",
    "study.vary.Tune.variants": "ge 1",
}


def models(base: type[Table]) -> Iterator[type[Table]]:
    for model in base.__subclasses__():
        yield model
        yield from models(model)


@pytest.fixture(scope="module")
def shipped() -> dict[str, type[Table]]:
    """The model of every table, by its name."""
    for module in pkgutil.iter_modules(cogless.study.__path__):
        import_module(f"cogless.study.{module.name}")
    import_module("cogless.identify.config")
    return {
        f"{each.__module__}.{each.__name__}".removeprefix("cogless."): each
        for each in models(Table)
        if each.__module__.startswith("cogless.")
        and getattr(import_module(each.__module__), each.__name__, None) is each  # none made while running
    }


def marks(annotation: Any, metadata: Any = ()) -> Iterator[Any]:
    """What a field's type is annotated with, at any depth."""
    for each in (*metadata, *(annotation.__metadata__ if get_origin(annotation) is Annotated else ())):
        yield from marks(None, each.metadata) if isinstance(each, FieldInfo) else (each,)
    for inner in get_args(annotation):
        yield from marks(inner)


def test_what_is_left_out_is_zero_or_off_apart_from_these(shipped: dict[str, type[Table]]) -> None:
    found: dict[str, Any] = {
        f"{table}.{name}": field.default
        for table, model in shipped.items()
        for name, field in model.model_fields.items()
        if name in model.__annotations__ and isinstance(field.default, bool | int | float) and field.default
    }
    assert found == {name: pytest.approx(value, rel=1e-12) for name, value in GIVEN.items()}


def test_plain_numbers_have_these_bounds(shipped: dict[str, type[Table]]) -> None:
    found = {}
    for table, model in shipped.items():
        for name, field in model.model_fields.items():
            told = [
                f"{sign} {getattr(each, sign)}".removesuffix(".0")
                for each in marks(field.annotation, field.metadata)
                for sign in ("ge", "gt", "le", "lt")
                if getattr(each, sign, None) is not None
            ]
            if told and name in model.__annotations__:
                found[f"{table}.{name}"] = " ".join(told)
    assert found == BOUNDS


def test_a_number_is_in_si_in_a_controller_s_table_and_needs_a_unit_elsewhere(
    shipped: dict[str, type[Table]],
) -> None:
    """In trials both are right, since their plant may be a drive, with units, or one without."""
    for table, model in shipped.items():
        si = issubclass(model, (Base, Commissioning, GivenFeedback, SignalFilter, Tuning))
        for name, field in model.model_fields.items():
            for each in marks(field.annotation, field.metadata):
                if isinstance(each, Quantity):
                    assert each.bare == (si or isinstance(each, EitherWay)), f"{table}.{name}"
