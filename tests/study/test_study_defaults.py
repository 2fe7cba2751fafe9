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
from cogless.study.laws.law import Base, Commissioning, Tuning
from cogless.study.laws.microstepping import AngleCorrection, Wave
from cogless.study.laws.trial import SignalFilter
from cogless.study.table import Quantity, Table
from cogless.study.trial_study import EitherWay

GIVEN: dict[str, float | bool] = {
    "identify.config.Column.scale": 1.0,
    "identify.config.Column.sign": 1,
    "printer.axis.Axis.belt_pitch": 0.002,
    "printer.axis.Axis.ramp_speed": 0.2,
    "study.base.TraceSettings.file_rate": 1000.0,
    "study.base.Target.weight": 1.0,
    "study.laws.anti_cogging.AntiCogging.cells": 720,
    "study.laws.law.Commissioning.revolutions": 1,
    "study.laws.law.Learning.cells": 1024,
    "study.laws.law.Learning.forgetting": 1.0,
    "study.laws.law.Tuning.phase_margin": radians(45),
    "study.drive.CurrentLoop.decoupling": True,
    "study.drive.CurrentReference.voltage_share": 0.95,
    "study.drive.CurrentSensors.range": 10.0,
    "study.drive.CurrentSensors.sensors": 3,
    "study.drive.Drive.guard": True,
    "study.drive.EncoderTable.limit": radians(2),
    "study.drive.EncoderTable.time_constant": 0.5,
    "study.drive.Inverter.computation_delay": 1,
    "study.drive.Rates.integration_steps": 1,
    "study.mechanics.Belt.damping_ratio": 0.05,
    "study.mechanics.Belt.pitch": 0.002,
    "study.mechanics.LoadSide.ratio": 1.0,
    "study.drive.Quality.longest": 60.0,
    "study.laws.microstepping.Microstepping.microsteps": 256,
    "study.laws.pi_afc.PiAfc.omega_min": 0.01,
    "study.linear_plant.LinearPlant.input_limit": 1000000.0,
    "study.position_sensor.Counted.window": 16,
    "study.position_sensor.Encoder.timer": 100000000.0,
    "study.position_sensor.Hall.edges": 6,
    "study.position_sensor.Hall.timer": 1000000.0,
    "study.position_sensor.Resolver.bits": 14,
    "study.laws.space.Period.parts": 1,
    "study.laws.space.Period.turns": 1,
    "study.laws.space.SpaceLearning.cells": 1024,
    "study.laws.space.SpaceLearning.k_pp": 10.0,
    "study.laws.space.SpaceLearning.learning": True,
    "study.laws.space.SpaceLearning.omega_min": 0.01,
    "study.laws.space.SpaceLearning.q_half_width": 5,
    "study.laws.space.SpacePosition.hand_over": True,
    "study.laws.space.SpacePosition.ramp": 1.0,
    "study.motor.StepMotor.i_f": 1.0,
    "study.saturation.MotorTemperature.reference": 20.0,
    "study.saturation.MotorTemperature.resistance_coefficient": 0.00393,
    "study.laws.trial.DesignSettings.sensor": True,
    "study.laws.trial.DesignSettings.initial_error": 0.1,
    "study.laws.trial.NormOptimalIlc.change_weight": 0.01,
    "study.laws.trial.NormOptimalIlc.feedforward": True,
    "study.laws.trial.NormOptimalIlc.integral": True,
    "study.laws.trial.ObserverIlc.feedforward": True,
    "study.laws.trial.ObserverIlc.learning": True,
    "study.laws.trial.SignalFilter.order": 2,
    "study.laws.trial.TrialIlc.feedforward": True,
    "study.laws.trial.TrialIlc.integral": True,
    "study.laws.trial.TrialIlc.learning": True,
    "study.laws.trial.TrialLaw.guard": True,
    "study.laws.trial.TrialLaw.learned_limit": 1000000.0,
    "study.mechanics.Accelerometer.logs": 1,
    "study.mechanics.Accelerometer.rate": 3200.0,
    "study.base.Hold.share": 1.0,
    "study.base.Tune.budget": 200,
    "study.base.Tune.variants": 32,
}


BOUNDS = {
    "identify.config.Column.scale": "gt 0",
    "printer.axis.Axis.pulley_teeth": "ge 4",
    "ensemble.arena_file.Arena.seeds": "ge 0 lt 4294967296",
    "study.base.StudyBase.seed": "ge 0 lt 18446744073709551616",
    "study.base.Target.weight": "gt 0",
    "study.laws.anti_cogging.AntiCogging.cells": "ge 4 le 65535",
    "study.laws.law.Commissioning.revolutions": "ge 1 le 100",
    "study.laws.law.Learning.cells": "ge 4 le 16777216",
    "study.laws.law.Learning.forgetting": "gt 0 le 1",
    "study.laws.law.Learning.q_half_width": "ge 0",
    "study.laws.microstepping.Microstepping.microsteps": "ge 1 le 1024",
    "study.laws.microstepping.Wave.order": "ge 1 le 1000",
    "study.laws.periodic.RobustIlc.q": "ge 0",
    "study.drive.CurrentReference.voltage_share": "gt 0 le 1",
    "study.drive.CurrentSensors.bits": "ge 0 le 32",
    "study.drive.Rates.integration_steps": "ge 1 le 10000",
    "study.laws.harmonic.Harmonic.base": "ge 1 le 65535",
    "study.mechanics.GearError.order": "ge 1 le 10000",
    "study.mechanics.Accelerometer.logs": "ge 1 le 100",
    "study.mechanics.Accelerometer.rate_error": "ge 0 le 0.1",
    "study.mechanics.Belt.damping_ratio": "ge 0 lt 1",
    "study.mechanics.Belt.pulley_teeth": "ge 4 le 1000",
    "study.mechanics.LoadSide.ratio": "gt 0",
    "study.mechanics.TorqueHarmonic.order": "ge 1 le 10000",
    "study.metric.Metric.order": "gt 0",
    "study.drive.Quality.outlier": "ge 0",
    "study.motor.Cogging.order": "ge 1 le 10000",
    "study.motor.FluxHarmonic.order": "ge 1 le 10000",
    "study.motor.Motor.pole_pairs": "ge 1 le 1000",
    "study.motor.Motor.slots": "ge 3 le 10000",
    "study.motor.TorqueRipple.order": "ge 1 le 10000",
    "study.datasheet.AngleFile.orders": "ge 1 le 10000",
    "study.linear_plant.LinearPlant.input_limit": "gt 0 le 1000000000000",
    "study.linear_plant.LinearPlant.load_noise": "ge 0 le 1000000000000",
    "study.linear_plant.LinearPlant.noise": "ge 0 le 1000000000000",
    "study.position_sensor.Absolute.bits": "ge 1 le 31",
    "study.position_sensor.Absolute.positions": "ge 2 le 2147483648",
    "study.position_sensor.AngleOrder.order": "ge 1 le 1000",
    "study.position_sensor.Counted.window": "ge 1 le 100000",
    "study.position_sensor.Encoder.lines": "ge 1 le 10000000",
    "study.position_sensor.Hall.edges": "ge 1 le 6",
    "study.position_sensor.Resolver.bits": "ge 1 le 32",
    "study.laws.space.Period.parts": "ge 1 le 65535",
    "study.laws.space.Period.turns": "ge 1 le 65535",
    "study.laws.space.SpaceLearning.cells": "ge 4 le 16777216",
    "study.laws.space.SpaceLearning.q_half_width": "ge 0",
    "study.motor.StepMotor.teeth": "ge 1 le 1000",
    "study.laws.trial.DesignSettings.initial_error": "gt 0",
    "study.laws.trial.DesignSettings.input_weight": "gt 0",
    "study.laws.trial.FilteredLaw.shift": "ge 1 le 65534",
    "study.laws.trial.NormOptimalIlc.change_weight": "gt 0",
    "study.laws.trial.ObserverIlc.pole": "ge 0 lt 1",
    "study.laws.trial.SignalFilter.order": "ge 1 le 4",
    "study.laws.trial.TrialLaw.learned_limit": "gt 0 le 1000000000000",
    "study.trial_study.Change.trial": "ge 2",
    "study.trial_study.Deviations.initial_state": "ge 0 le 1000000000000",
    "study.trial_study.TrialConditions.load_steps": "ge 0",
    "study.trial_study.TrialScenario.trials": "ge 1 le 100000",
    "study.base.Hold.share": "gt 0 le 1",
    "study.base.Together.correlation": "ge -1 le 1",
    "study.base.Tune.budget": "ge 2",
    "study.base.Tune.over": "gt 0 lt 1",
    "study.base.Tune.variants": "ge 1",
}


def models(base: type[Table]) -> Iterator[type[Table]]:
    for model in base.__subclasses__():
        yield model
        yield from models(model)


@pytest.fixture(scope="module")
def shipped() -> dict[str, type[Table]]:
    """The model of every table, by its name."""
    for module in pkgutil.walk_packages(cogless.study.__path__, "cogless.study."):
        import_module(module.name)
    import_module("cogless.ensemble.arena_file")
    import_module("cogless.identify.config")
    import_module("cogless.printer.axis")
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
        of_controllers = (AngleCorrection, Base, Commissioning, GivenFeedback, SignalFilter, Tuning, Wave)
        si = issubclass(model, of_controllers)
        for name, field in model.model_fields.items():
            for each in marks(field.annotation, field.metadata):
                if isinstance(each, Quantity):
                    assert each.bare == (si or isinstance(each, EitherWay)), f"{table}.{name}"
