"""The data of each run that a page needs: the engine's packed description, and what the page itself reads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cogless.design.from_study import design_study, retuned
from cogless.live.packed import Packed, pack
from cogless.results.metrics import Conditions
from cogless.run.drive_config import engine_config
from cogless.run.plan import plan
from cogless.run.simulate import Pair
from cogless.run.trial_config import engine_config as trial_config
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.controller import AntiCogging, OwnLaw, Startable
from cogless.study.trial_controller import NormOptimalIlc

OFF = 1e9  # s, a learning_start that never comes


def held(study: AnyStudy) -> list[Pair]:
    """The runs that a page can hold: all but those of the laws that `left_out` names."""
    return [pair for pair in every(study) if not _why_not(study, pair[1])]


def left_out(study: AnyStudy) -> list[str]:
    """The controllers that a page leaves out and why, a sentence for each."""
    return [f"{study.label(name)}: {why}." for name in study.controller if (why := _why_not(study, name))]


def _why_not(study: AnyStudy, name: str) -> str:
    if isinstance(study.controller[name], OwnLaw):
        return "its law is code of its own, which the page doesn't run"
    if isinstance(study.controller[name], NormOptimalIlc):
        return "its learning matrix, of a number for each two samples, is too large for a page"
    run = next((pair for pair in every(study) if pair[1] == name), None)
    if isinstance(study, TrialStudy) and run is not None:
        refused = design_study(study, [run]).refused.get(run)
        return "" if refused is None else f"not designed: {refused.within(study.source.path)}"
    return ""


def every(study: AnyStudy) -> Iterator[Pair]:
    return ((scenario, name) for scenario in study.scenario for name in study.controllers_in(scenario))


def precision(study: AnyStudy) -> str:
    """The precision of the control laws; a linear plant has them in double precision."""
    return study.drive.precision if study.drive is not None else "double"


def blobs(study: AnyStudy, scenario: str, controller: str, like: AnyStudy | None = None) -> dict[str, Packed]:
    """The packed descriptions of a run: "run", and "learn" if a commissioning run comes before it.

    `like`: the study of which this one is a changed copy. In trials its designs are reused.
    StudyError or MisfitError: the study's values don't make a run.
    """
    if isinstance(study, TrialStudy):
        return {"run": _trials(study, scenario, controller, like)}
    made = {"run": _blob(study, scenario, controller)}
    law = study.controller[controller]
    if isinstance(law, AntiCogging) and law.calibration is not None:
        description = engine_config(study, scenario, controller, "learn")
        # as long as plan.py waits for it
        longest = 3 * law.calibration.duration * study.drive.rates.current_loop
        made["learn"] = _packed(study, description | {"page": {"ticks": math.ceil(longest)}})
    return made


def _blob(study: Study, scenario: str, controller: str) -> Packed:
    here, law = for_scenario(study, scenario), study.controller[controller]
    conditions, rates = Conditions.of(study, scenario), here.drive.rates
    page: dict[str, Any] = {
        "ticks": round(here.scenario[scenario].duration * rates.current_loop),
        "decimation": round(rates.current_loop / here.trace_rate),
        "divider": rates.divider,
        "pole_pairs": conditions.pole_pairs,
        "R_s": conditions.R_s,
        "power_factor": conditions.power_factor,
        "speed_period": conditions.speed_period,
        "events": list(conditions.events),
        "unit": float(np.float32(law.unit)) if study.drive.precision == "single" else float(law.unit),
        "ratio": law.ratio(here.motor.pole_pairs),
    }
    if isinstance(law, Startable) and law.start is not None:
        learned = plan(study, scenario, controller).learned
        page["learned"] = np.asarray(learned, np.float64)
    return _packed(study, engine_config(study, scenario, controller) | {"page": page})


def _trials(study: TrialStudy, scenario: str, controller: str, like: AnyStudy | None) -> Packed:
    run, conditions, experiment = (
        (scenario, controller),
        Conditions.of(study, scenario),
        study.scenario[scenario],
    )
    design = retuned(study, run, like) if isinstance(like, TrialStudy) else design_study(study, [run])[run]
    rates = None if study.drive is None else study.drive.rates
    divider = 1 if rates is None else rates.divider
    sampled = 1 / study.period if rates is None else rates.current_loop
    page = {
        "trials": experiment.trials,
        "ticks": study.samples(scenario) * divider,  # of a trial
        "decimation": divider if study.trace.rate is None else round(sampled / study.trace.rate),
        "divider": divider,
        "pole_pairs": conditions.pole_pairs,
        "starts": [int(start) for start in conditions.starts],
    }
    return _packed(study, trial_config(study, scenario, controller, design) | {"page": page})


def _packed(study: AnyStudy, description: dict[str, Any]) -> Packed:
    return pack(description, precision(study))
