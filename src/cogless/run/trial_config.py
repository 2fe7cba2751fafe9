"""Describe a run of trials for the engine: a nested dict for one controller in one scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cogless.c_layout import control_layout
from cogless.design.trials.model import Model, sampled
from cogless.run.drive_config import drive_config, mechanics_config, motor_config, own_law_config

if TYPE_CHECKING:
    from cogless.design.trials.gains import TrialParameters
    from cogless.study import TrialStudy
    from cogless.study.linear_plant import LinearPlant
    from cogless.study.trial_study import TrialConditions


def engine_config(
    study: TrialStudy, scenario: str, controller: str, design: TrialParameters | None
) -> dict[str, Any]:
    """The engine's description of one run, with the complete conditions of each phase.

    `design`: gains of a law of trials; None for a user's law. Gains and assumed motor parameters come from
    the study without overrides: the controller doesn't know what changes between trials. StudyError: the
    design found no learning gain.
    """
    if design is not None and design.no_K_3 is not None:
        raise design.no_K_3
    experiment = study.scenario[scenario]
    samples = study.samples(scenario)
    law = own_law_config(study, controller) if design is None else _law(study, scenario, controller, design)
    if study.plant is not None:
        return {
            "C": list(study.plant.C),
            "period": study.plant.period,
            "samples": samples,
            "count": experiment.trials,
            "noise": list(study.plant.state_noise),
            "load_noise": study.plant.load_noise,
            "seed": study.seed,
            "phases": [_linear_phase(study, study.plant, scenario, *phase) for phase in experiment.phases],
            "controller": law,
        }
    assert study.drive is not None and study.motor is not None
    assert study.mechanics is not None
    driven = study.hardware(scenario)[0].motor.star()
    phases = [_drive_phase(study, scenario, index, *phase) for index, phase in enumerate(experiment.phases)]
    return {
        "trials": {"samples": samples, "count": experiment.trials, "phases": phases},
        "seed": study.seed,
        "energy": study.trace.energy,
        "drive": drive_config(study.drive, study.motor.star(), driven, study.mechanics, learns=False),
        "faults": [fault.model_dump() for fault in experiment.faults],
        "controller": law,
    }


def _law(study: TrialStudy, scenario: str, name: str, design: TrialParameters) -> dict[str, Any]:
    law, ahead, q = study.trial_law(name), design.feedforward, design.q_filter
    num, den, preview = (ahead.num, ahead.den, ahead.preview) if ahead else ((), (), 0)
    b, a = (q.b, q.a) if q else ((), ())
    if study.plant is not None:
        limit, precision = study.plant.input_limit, "double"
    else:
        assert study.drive is not None
        limit, precision = study.drive.current_loop.current_limit, study.drive.precision
    values = {
        "samples": study.samples(scenario),
        "states": study.states,
        "k_1": design.K_1,
        "k_2": design.K_2,
        "n": design.N,
        "c": design.C,
        "through_integrator": design.through_integrator,
        "k_3": design.K_3,
        "shift": design.shift,
        "feedforward": {
            "numerator": len(num),
            "denominator": len(den),
            "preview": preview,
            "num": num,
            "den": den,
        },
        "q_filter": {"order": max(len(b) - 1, 0), "b": b, "a": a, "odd": q is not None and q.odd},
        "filter_signal": design.filtered == "signal",
        "observer": {
            "response": design.gains.observer.response if design.gains.observer else 0.0,
            "pole": design.gains.observer.pole if design.gains.observer else 0.0,
        },
        "learning_matrix": None,  # not in the C struct: it is an entry of its own, below
        "limit": limit,
        "learned_limit": law.learned_limit,
        "unguarded": not law.guard,
    }
    config = control_layout(precision).pack("cgl_trial_config", values)
    return {
        "law": "trial",
        "config": config,
        "learning_matrix": design.learning_matrix,
        "basis_functions": law.basis_functions,
    }


def _drive_phase(
    study: TrialStudy, scenario: str, index: int, first: int, conditions: TrialConditions
) -> dict[str, Any]:
    hardware = study.hardware(scenario)[index]
    reference = study.reference(scenario, conditions)
    return {
        "from": first - 1,
        "reference": reference.tolist(),
        "initial_angle": float(reference[0])
        if conditions.initial_angle is None
        else conditions.initial_angle,
        "initial_speed": conditions.initial_speed or 0.0,
        "motor": motor_config(hardware.motor.star()),
        "mechanics": mechanics_config(hardware.mechanics),
        "load": hardware.load.model_dump(),
        "load_steps": [
            {"sample": sample, "torque": torque} for sample, torque in conditions.load_steps or ()
        ],
        "each_trial": _each_trial(conditions, 0),
    }


def _each_trial(conditions: TrialConditions, states: int) -> dict[str, Any] | None:
    """Form and size of each random deviation between trials; None if all trials are alike.

    `states`: number of a linear plant's states; 0 for a drive.
    """
    spread = conditions.each_trial
    if spread is None or spread.empty:
        return None

    def deviation(key: str) -> dict[str, Any]:
        form, size = spread.form_of(key)
        return {"form": form, "size": size or 0.0}

    if not states:
        return {key: deviation(key) for key in ("initial_angle", "initial_speed", "load")}
    form, sizes = spread.form_of("initial_state")
    starts = [{"form": form, "size": size} for size in sizes or (0.0,) * states]
    return {"initial_state": starts, "load": deviation("load")}


def _linear_phase(
    study: TrialStudy, plant: LinearPlant, scenario: str, first: int, conditions: TrialConditions
) -> dict[str, Any]:
    A, B = plant.matrices_at(conditions.override or {})
    if plant.model == "continuous":
        model = sampled(Model.from_arrays(A, B), plant.period, "exact")
        A, B = model.A.tolist(), model.B[:, 0].tolist()
    load = np.zeros(study.samples(scenario))
    for sample, amount in conditions.load_steps or ():
        load[sample:] = amount
    return {
        "from": first - 1,
        "reference": study.reference(scenario, conditions).tolist(),
        "A": A,
        "B": B,
        "load": load.tolist(),
        "initial_state": list(conditions.initial_state or (0.0,) * study.states),
        "each_trial": _each_trial(conditions, study.states),
    }
