"""The designs of a study of trials, from its uncertain plant, its weights and its controllers' settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from cogless.design.changes import either, helping
from cogless.design.trials.gains import (
    TrialDesign,
    TrialGains,
    TrialParameters,
    TrialSettings,
    design_gains,
    design_trial,
    needs_K_3,
    other_choices,
    random_amplification,
    scenario_prediction,
    trial_parameters,
)
from cogless.design.trials.model import DesignError, Discretisation, Model, sampled
from cogless.design.trials.polytope import UncertainPlant, from_parameters, from_vertices
from cogless.design.trials.prediction import Conditions, Prediction
from cogless.design.trials.random_errors import Disturbances
from cogless.design.trials.sensing import Sensor, sensed
from cogless.errors import StudyError
from cogless.study import TrialStudy
from cogless.study.laws.trial import UNCERTAIN
from cogless.study.linear_plant import LinearPlant
from cogless.study.mechanics import Mechanics
from cogless.study.motor import Motor
from cogless.study.position_sensor import Counted, Hall
from cogless.study.reading import Changes, Remark
from cogless.study.trial_study import EachTrial, TrialConditions
from cogless.units import TURN

SAMPLE_ROUNDING = 1e-9  # relative error of a value at the end of its range
ANGLE_OUTPUT = np.array([1.0, 0.0])  # C of a drive, whose states are angle and speed
OTHER_CHOICES = 4  # number of choices of shift and filter, tried where the best would end above the feedback
Pair = tuple[str, str]  # scenario, controller


class Designs(dict[Pair, TrialDesign]):
    """Designs by (scenario, controller). `without`: errors of pairs without a design; look-ups raise them."""

    def __init__(self) -> None:
        super().__init__()
        self.without: dict[Pair, StudyError] = {}

    def __missing__(self, pair: Pair) -> TrialDesign:
        if pair in self.without:
            raise self.without[pair]
        raise KeyError(pair)

    @property
    def refused(self) -> dict[Pair, StudyError]:
        """Why a controller can't run: it has no design, or its design has no learning gain."""
        gainless = {pair: design.no_K_3 for pair, design in self.items() if design.no_K_3 is not None}
        return {**self.without, **gainless}


# Settings of a design that a study has in a controller's table; the others are in "plant" or "design".
OF_CONTROLLER = (
    "K_s",
    "N",
    "K_3",
    "shift",
    "change_weight",
    "q_filter",
    "static_gain",
    "feedforward",
    "pole",
)
# The key of a study's linear plant for each setting of a design.
OF_PLANT = {"model": "model", "range": "parameter", "nominal": "parameter", "output": "C", "period": "period"}


def design_study(study: TrialStudy, runs: Sequence[tuple[str, str]]) -> Designs:
    """A design for each (scenario, controller) whose law learns over trials. Equal settings share one.

    A controller that can't be designed is in `without`, with an error that names the file and the key. If
    only the learning gain K_3 doesn't exist, the design has everything else and the reason. StudyError: the
    plant's description is wrong for all of them.
    """
    return study.once(_design, tuple(runs))


def _design(study: TrialStudy, runs: Sequence[tuple[str, str]]) -> Designs:
    designs = _designs(study, runs)
    for run, design in designs.items():
        exact = design.certificate.exact
        if exact is not None and not exact.stable and design.certificate.design.stable:
            remark = _better_sampled(study, run)
            notes = (*design.notes, *([remark] if remark is not None else []))
            designs[run] = replace(design, notes=notes)
    return designs


def _better_sampled(study: TrialStudy, run: tuple[str, str]) -> Remark | None:
    """A change of design model or period that makes the exactly sampled loop stable.

    None: no change that was tried does.
    """
    exact: Changes = {"design.discretisation": "exact"}
    faster: Changes
    if study.plant is not None:
        faster = {"plant.period": f"{study.period / 2:.6g} s"}
    else:
        faster = {"drive.rates.position_loop": f"{2 / study.period:.6g} Hz"}

    def cured(other: TrialStudy) -> bool:
        certificate = _designs(other, [run])[run].certificate
        return certificate.deciding.stable

    cures = helping(study, (exact, faster), cured)
    return Remark(f"within a trial the loop is stable with {either(cures)}", cures) if cures else None


def _designs(study: TrialStudy, runs: Sequence[tuple[str, str]]) -> Designs:
    with _as_study_error(study):
        plant = uncertain_plant(study)
    designs = Designs()
    designed: list[tuple[TrialSettings, TrialGains | DesignError]] = []
    outside = {scenario: _outside(study, scenario) for scenario, _ in runs}
    settings_by_run = {run: settings_of(study, *run) for run in runs if study.controller[run[1]].of_trials}
    # designs that need K_3 come first: the others can then reuse their gains without K_3
    for (scenario, name), settings in sorted(
        settings_by_run.items(), key=lambda item: not needs_K_3(item[1])
    ):
        try:
            with _as_study_error(study, scenario, name):
                design = _designed(study, scenario, name, plant, settings, designed)
        except StudyError as error:
            designs.without[scenario, name] = error
            continue
        beyond = outside[scenario]
        notes = [_in_study(remark, study, scenario, name) for remark in design.notes]
        notes += map(Remark, beyond)
        if design.no_K_3 is not None:
            notes.append(Remark(str(design.gains.no_K_3), design.no_K_3.cures))
        designs[scenario, name] = replace(design, notes=tuple(notes), beyond=beyond, limit=_limit(study))
    return designs


def _designed(
    study: TrialStudy,
    scenario: str,
    name: str,
    plant: UncertainPlant,
    settings: TrialSettings,
    designed: list[tuple[TrialSettings, TrialGains | DesignError]],
) -> TrialDesign:
    """The design of one controller. `designed`: settings with their gains, or with why there are none."""
    gains = next((g for other, g in designed if same_gains(settings, other)), None)
    if gains is None:
        try:
            gains = design_gains(plant, settings)
        except DesignError as error:
            gains = error
        designed.append((settings, gains))
    if isinstance(gains, DesignError):
        raise gains
    missing = gains.no_K_3 if needs_K_3(settings) else None
    design = design_trial(plant, replace(settings, learning=False) if missing else settings, gains)
    no_K_3 = None if missing is None else _study_error(missing, study, scenario, name)
    prediction = _predicted(study, scenario, plant, settings, design)
    if settings.chooses and prediction is not None and prediction.ends_above:
        for other in islice(other_choices(plant, settings, gains), OTHER_CHOICES):
            tried = design_trial(plant, settings, other)
            predicted = _predicted(study, scenario, plant, settings, tried)
            if predicted is not None and not predicted.ends_above:
                design, prediction = tried, predicted
                break
    amplify = None
    if prediction is not None and design.learns:
        amplify = partial(random_amplification, plant, settings, design.gains)
    return replace(design, no_K_3=no_K_3, prediction=prediction, amplify=amplify)


def _predicted(
    study: TrialStudy, scenario: str, plant: UncertainPlant, settings: TrialSettings, design: TrialDesign
) -> Prediction | None:
    """The prediction for the scenario; None if a plant is unstable, or if there is no K_3 to learn with."""
    certificate = design.certificate
    if not certificate.deciding.stable or (design.gains.no_K_3 is not None and needs_K_3(settings)):
        return None
    return scenario_prediction(plant, settings, design.gains, _phases(study, scenario))


def _phases(study: TrialStudy, scenario: str) -> list[Conditions]:
    """The phases of a scenario as a linear plant sees them: loads in the unit of the input.

    Each phase has its own plant, if that is within the design's ranges.
    """
    phases = []
    inside = not _outside(study, scenario)
    experiment = study.scenario[scenario]
    ends = (*experiment.starts[1:], experiment.trials + 1)
    for index, (first, conditions) in enumerate(experiment.phases):
        reference = study.reference(scenario, conditions)
        load = np.zeros(len(reference))
        unit, start = 1.0, np.zeros(study.states)
        if study.plant is not None:
            start[:] = conditions.initial_state or 0.0
        else:
            hardware = study.hardware(scenario)[index]
            unit = hardware.motor.star().K_t
            load += hardware.load.torque
            angle = conditions.initial_angle
            start[:] = reference[0] if angle is None else angle, conditions.initial_speed or 0.0
        steps = conditions.load_steps or ()
        for sample, amount in steps:
            load[sample:] = amount
        simulated = _simulated(study, scenario, index, conditions) if inside else None
        random = _random(study, conditions, unit)
        phases.append(
            Conditions(reference, load / unit, start, ends[index] - first, plant=simulated, random=random)
        )
    return phases


def _simulated(study: TrialStudy, scenario: str, index: int, conditions: TrialConditions) -> Model:
    """The plant of a phase, exactly sampled; a drive's plant is as the law sees it."""
    if study.plant is not None:
        A, B = study.plant.matrices_at(conditions.override or {})
        if study.plant.model == "discrete":
            return Model.from_arrays(A, B)
    else:
        hardware = study.hardware(scenario)[index]
        A, B = _axis(_uncertain(hardware.mechanics, hardware.motor))
    plant = sampled(Model.from_arrays(A, B), study.period, "exact")
    return plant if study.drive is None else sensed(plant, ANGLE_OUTPUT, study.period, sensor_of(study))


def _axis(values: Mapping[str, float]) -> tuple[list[list[float]], list[float]]:
    """(37) of Mandra 2019: angle and speed of a drive with these `_uncertain` values."""
    J, B, K_t = values.values()
    return [[0.0, 1.0], [0.0, -B / J]], [0.0, K_t / J]


def _random(study: TrialStudy, conditions: TrialConditions, unit: float) -> Disturbances | None:
    """What differs from trial to trial as a linear plant sees it; None where all trials are alike.

    `unit`: a load in the study's unit per unit of the input.
    """
    plant, spread = study.plant, conditions.each_trial or EachTrial()
    start = np.zeros(study.states)
    if plant is not None:
        start[:] = spread.deviations("initial_state") or 0.0
        noise, load_noise = np.array(plant.state_noise), plant.load_noise
    else:
        for i, key in enumerate(("initial_angle", "initial_speed")):
            start[i] = sum(spread.deviations(key))
        noise, load_noise = None, 0.0
    load = sum(spread.deviations("load")) / unit
    if not (np.any(start) or load or load_noise or (noise is not None and np.any(noise))):
        return None
    return Disturbances(start, load, load_noise, noise)


def _limit(study: TrialStudy) -> float:
    """The limit of the input, in the input's unit."""
    if study.plant is not None:
        return study.plant.input_limit
    assert study.drive is not None
    return study.drive.current_loop.current_limit


def _in_study(remark: Remark, study: TrialStudy, scenario: str, controller: str) -> Remark:
    """The remark with the study's keys in its cures, in place of the names of the design's settings."""
    return replace(remark, cures=tuple(_changes(cure, study, scenario, controller) for cure in remark.cures))


def _changes(cure: Changes, study: TrialStudy, scenario: str, controller: str) -> Changes:
    return {_key(name, study, scenario, controller): value for name, value in cure.items()}


def retuned(study: TrialStudy, run: tuple[str, str], like: TrialStudy) -> TrialParameters:
    """The parameters of a law, where a study differs from `like` in a few values, without a certificate.

    Gains of the design of `like` are reused where they are right. Raises StudyError as `design_study`.
    """
    alike = all(
        getattr(study, key) == getattr(like, key) for key in ("plant", "motor", "mechanics", "design")
    )
    settings, before = settings_of(study, *run), settings_of(like, *run)
    alike = alike and sensor_of(study) == sensor_of(like)
    alike = alike and study.period == like.period and _same_feedback(settings, before)
    chooses_otherwise = (settings.chooses or before.chooses) and _update(settings) != _update(before)
    other_K_3 = settings.K_3 is not None and not chooses_otherwise
    with _as_study_error(study, *run):
        if alike and (other_K_3 or same_gains(settings, before)):
            gains = like.once(_own_gains, run)
            if settings.K_3 is not None:
                gains = replace(gains, K_3=settings.K_3)
            return trial_parameters(uncertain_plant(like), settings, gains)  # the same plant, made once
        return trial_parameters(uncertain_plant(study), settings, _gains_alone(study, settings))


def _own_gains(study: TrialStudy, run: tuple[str, str]) -> TrialGains:
    """A controller's gains; they need no certificate unless the scenario decides which are chosen."""
    settings = settings_of(study, *run)
    return design_study(study, [run])[run].gains if settings.chooses else _gains_alone(study, settings)


def _gains_alone(study: TrialStudy, settings: TrialSettings) -> TrialGains:
    """A controller's gains as `design_study` finds them; feedback that controllers share is designed once.

    DesignError as `design_gains`.
    """
    chosen = settings.K_3 is None or settings.chooses
    if settings.kind == "observer" or (chosen and needs_K_3(settings)):
        return design_gains(uncertain_plant(study), settings)
    runs = ((scenario, name) for scenario in study.scenario for name in study.controllers_in(scenario))
    laws = (run for run in runs if study.controller[run[1]].of_trials)
    first = next(run for run in laws if _same_feedback(settings, settings_of(study, *run)))
    return replace(study.once(_feedback_gains, first), K_3=settings.K_3)


def _feedback_gains(study: TrialStudy, run: tuple[str, str]) -> TrialGains:
    return design_gains(uncertain_plant(study), replace(settings_of(study, *run), learning=False))


def _outside(study: TrialStudy, scenario: str) -> tuple[str, ...]:
    """Warnings of parameter values in a scenario that are outside the ranges of the design."""
    warnings = []
    for index, (first, conditions) in enumerate(study.scenario[scenario].phases):
        if study.plant is not None:
            parameters = study.plant.parameter
            values: dict[str, float] = {
                k: v for k, v in (conditions.override or {}).items() if k in parameters
            }
            ranges = {
                k: parameters[k].range or (parameters[k].nominal, parameters[k].nominal) for k in values
            }
        else:
            hardware = study.hardware(scenario)[index]
            values = _uncertain(hardware.mechanics, hardware.motor)
            ranges = dict(study.design.range)
        for key, (low, high) in ranges.items():
            if not low * (1 - SAMPLE_ROUNDING) <= values[key] <= high * (1 + SAMPLE_ROUNDING):
                where = f"scenario {scenario}, from trial {first}: {key} is {values[key]:.4g}"
                warnings.append(f"{where}, outside the design's {low:.4g} to {high:.4g}")
    return tuple(warnings)


def uncertain_plant(study: TrialStudy) -> UncertainPlant:
    """The uncertain plant: a linear plant with its ranges or vertices, or a drive.

    A drive is (37) of Mandra 2019, with ranges of inertia, friction and K_t.
    """
    return study.once(_uncertain_plant, ())


def _uncertain_plant(study: TrialStudy, _: tuple[()]) -> UncertainPlant:
    if study.plant is not None:
        return _linear(study.plant, study)
    assert study.motor is not None and study.mechanics is not None
    values = _uncertain(study.mechanics, study.motor)

    def model(ranged: Mapping[str, float]) -> tuple[list[list[float]], list[float]]:
        return _axis({key: ranged.get(key, value) for key, value in values.items()})

    plant = from_parameters(model, study.design.range, ANGLE_OUTPUT, study.period, _inequalities(study))
    return plant.seen_by(sensor_of(study))


def sensor_of(study: TrialStudy) -> Sensor:
    """What the design knows of the drive's position sensor, and of a bus before the law."""
    drive, certified = study.drive, study.design.sensor
    if drive is None:
        return Sensor()
    sensor, late = drive.position_sensor, 0.0 if drive.bus is None else drive.bus.mean_delay
    smoothed = TURN * (drive.speed_filter or 0.0)
    if isinstance(sensor, Hall):
        assert study.motor is not None
        step = sensor.step(study.motor.pole_pairs)
        return Sensor(latency=late, speed_filter=smoothed, step=step, certified=certified)
    if not isinstance(sensor, Counted):
        return Sensor(latency=late, speed_filter=smoothed, certified=certified)
    window = sensor.periods(drive.rates.divider) / drive.rates.current_loop
    return Sensor(
        latency=late + sensor.latency,
        window=window,
        bandwidth=sensor.bandwidth,
        speed_filter=smoothed,
        step=sensor.step,
        timed=sensor.timed,
        certified=certified,
    )


def _uncertain(mechanics: Mechanics, motor: Motor) -> dict[str, float]:
    """Values of the drive's parameters for which a design may have a range."""
    stiff = mechanics.stiff
    numbers = (stiff.inertia, stiff.viscous_friction, motor.star().K_t)
    return dict(zip(UNCERTAIN, numbers, strict=True))


def settings_of(study: TrialStudy, scenario: str, name: str) -> TrialSettings:
    """Settings of a controller's design: all inputs of the design besides the plant."""
    law, design = study.trial_law(name), study.design
    same = {field.name for field in fields(TrialSettings)}
    own: dict[str, Any] = {key: value for key, value in law if key in same}
    return TrialSettings(
        samples=study.samples(scenario),
        Q=design.Q,
        R=design.input_weight,
        gamma=design.initial_state,
        f=design.initial_state if design.initial_change is None else design.initial_change,
        g=design.initial_error,
        inverted=design.discretisation or "exact",
        limit=_limit(study) if study.design.sensor else None,
        **own | law.design_settings,
    )


def _linear(plant: LinearPlant, study: TrialStudy) -> UncertainPlant:
    if plant.vertex:
        vertices = [(vertex.A, vertex.B) for vertex in plant.vertex]
        continuous = plant.model == "continuous"
        return from_vertices(vertices, plant.C, plant.period, continuous, _inequalities(study))
    ranges = {name: p.range for name, p in plant.parameter.items() if p.range is not None}
    nominal = {name: plant.parameter[name].nominal for name in ranges}
    how = _inequalities(study) if plant.model == "continuous" else None
    return from_parameters(plant.matrices_at, ranges, plant.C, plant.period, how, nominal)


def _inequalities(study: TrialStudy) -> Discretisation:
    """How the models in the inequalities are sampled: by Euler, with which a polytope stays one."""
    return study.design.discretisation or "euler"


def same_gains(settings: TrialSettings, other: TrialSettings) -> bool:
    """Whether gains that were designed for `other` are right for `settings` too."""

    def learning(s: TrialSettings) -> tuple[Any, ...]:
        return s.K_3, *_update(s)

    same = _same_feedback(settings, other)
    return same and (not needs_K_3(settings) or (needs_K_3(other) and learning(settings) == learning(other)))


def _update(s: TrialSettings) -> tuple[Any, ...]:
    """What K_3 is designed for. A shift or filter that is chosen suits one length of trials."""
    on_signal = s.filter_acts_on == "signal" or s.chooses
    q_filter = (s.cutoff, s.filter_order, s.ends, s.filter_acts_on) if on_signal else None
    return s.shift, q_filter, s.samples if s.chooses else None


def _same_feedback(settings: TrialSettings, other: TrialSettings) -> bool:
    def feedback(s: TrialSettings) -> tuple[Any, ...]:
        kind = s.kind if s.kind in ("state", "observer") else None
        limit = s.limit if s.kind == "observer" else None
        return kind, s.K_s, s.N, s.feedforward, s.inverted, s.pole, limit

    return feedback(settings) == feedback(other)


@contextmanager
def _as_study_error(study: TrialStudy, scenario: str = "", controller: str = "") -> Iterator[None]:
    """Turns a DesignError into a StudyError that names the file and the study's own key."""
    try:
        yield
    except DesignError as error:
        raise _study_error(error, study, scenario, controller) from error


def _study_error(error: DesignError, study: TrialStudy, scenario: str, controller: str) -> StudyError:
    """The StudyError for a DesignError, with the file and the study's own key."""
    text, key = error.text_without(error.key), _key(error.key, study, scenario, controller)
    cures = (_changes(cure, study, scenario, controller) for cure in error.cures)
    return StudyError(f"{study.source.path}: {key}: {text}").advising(*cures)


def _key(of: str, study: TrialStudy, scenario: str, controller: str) -> str:
    """The study's key for a setting of the design."""
    if of == "samples":
        return f"scenario.{scenario}.duration"
    if of in OF_CONTROLLER and controller:
        return f"controller.{controller}.{study.trial_law(controller).DESIGN_KEYS.get(of, of)}"
    if study.plant is not None:
        without_parameters = OF_PLANT.get(of) == "parameter" and not study.plant.parameter
        if of.startswith("vertex") or without_parameters:
            return "plant.vertex" if study.plant.vertex else "plant"
    return f"plant.{OF_PLANT[of]}" if study.plant is not None and of in OF_PLANT else f"design.{of}"
