"""Run a study of trials on the native engine: one controller in one scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np

from cogless.design.from_study import design_study
from cogless.errors import StudyError
from cogless.maps import learned_map
from cogless.results import Run
from cogless.results.metrics import Value, result_name
from cogless.results.trial_metrics import evaluate
from cogless.run.advance import ENGINES, Progress, Runner, advance, failures, trace_of
from cogless.run.trial_config import engine_config
from cogless.study import TrialStudy

if TYPE_CHECKING:
    from cogless.design.trial import TrialDesign


def runner(study: TrialStudy, runs: Sequence[tuple[str, str]]) -> Runner:
    """A function that runs a controller of this study in a scenario; designs all the controllers first."""
    return partial(_run, study, design_study(study, runs))


def _run(
    study: TrialStudy,
    designs: Mapping[tuple[str, str], TrialDesign],
    scenario: str,
    controller: str,
    progress: Progress,
    stop: Event,
) -> Run:
    design = designs[scenario, controller]
    engine, drive, ticks, _ = _drive(study, scenario, controller, design)
    state = drive.start()
    divider = 1 if study.drive is None else study.drive.rates.divider
    decimation = divider if study.trace.rate is None else round(divider / (study.trace.rate * study.period))
    recorder = engine.Recorder(drive, decimation, ticks // decimation)

    def when() -> str:
        return f" in trial {state.tick // (divider * study.samples(scenario)) + 1}"

    with failures(study, scenario, controller, when):
        advance(drive, state, recorder, ticks, progress, stop)
    trace = trace_of(drive, recorder)
    learned = drive.stored(state)
    memory = {} if learned is None else {"learned": np.asarray(learned["values"][0])}
    experiment = study.scenario[scenario]
    # metrics are taken on the samples of the trial, whatever rows there are between
    sampled = dataclasses.replace(trace, data=trace.data[:: divider // decimation])
    metrics: dict[str, Value] = {
        result_name(m): evaluate(m, sampled, experiment.trials, experiment.starts)
        for m in study.metrics_in(scenario)
    }
    # the reference that it was learned for is that of the last phase
    motion = learned_map.motion_identity(study.reference(scenario, experiment.phases[-1][1]))
    stored = learned_map.of_run(study, learned, motion)
    return Run(scenario, controller, trace, memory, metrics, design, map=stored)


def drive_of(study: TrialStudy, scenario: str, controller: str) -> tuple[Any, Any, int, dict[str, Any]]:
    """The engine's module, the designed controller with its plant, its ticks, its description; StudyError."""
    designs = design_study(study, [(scenario, controller)])
    return _drive(study, scenario, controller, designs[scenario, controller])


def _drive(
    study: TrialStudy, scenario: str, controller: str, design: TrialDesign
) -> tuple[Any, Any, int, dict[str, Any]]:
    engine = import_module(ENGINES["double" if study.drive is None else study.drive.precision])
    divider = 1 if study.drive is None else study.drive.rates.divider
    ticks = study.samples(scenario) * study.scenario[scenario].trials * divider
    try:
        config = engine_config(study, scenario, controller, design)
        drive = engine.LinearTrials(config) if study.plant is not None else engine.Drive(config)
    except (ValueError, RuntimeError) as error:
        where = f"controller.{controller}: scenario {scenario}"
        raise StudyError(f"{study.source.path}: {where}: {error}") from error
    return engine, drive, ticks, config
