"""The data of each run that a page needs: the engine's packed description, and what the page itself reads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cogless.live.packed import Packed, pack
from cogless.results.metrics import Conditions
from cogless.run.drive_config import engine_config
from cogless.run.plan import plan
from cogless.study import AnyStudy, Study, for_scenario
from cogless.study.controller import AntiCogging, OwnLaw, Startable

OFF = 1e9  # s, a learning_start that never comes

Pair = tuple[str, str]  # scenario, controller


def held(study: Study) -> list[Pair]:
    """The runs that a page can hold: all but those of a user's own law, which is no part of the engine."""
    return [pair for pair in every(study) if not isinstance(study.controller[pair[1]], OwnLaw)]


def own_laws(study: AnyStudy) -> list[str]:
    """What a page leaves out because it is a user's own code, a sentence per controller."""
    own = [name for name, law in study.controller.items() if isinstance(law, OwnLaw)]
    return [f"{study.label(name)}: its law is code of its own, which the page doesn't run." for name in own]


def every(study: Study) -> Iterator[Pair]:
    return ((scenario, name) for scenario in study.scenario for name in study.controllers_in(scenario))


def blobs(study: Study, scenario: str, controller: str) -> dict[str, Packed]:
    """The packed descriptions of a run: "run", and "learn" if a commissioning run comes before it.

    StudyError or ValueError: the study's values don't make a run.
    """
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


def _packed(study: Study, description: dict[str, Any]) -> Packed:
    return pack(description, study.drive.precision)
