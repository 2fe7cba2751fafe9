"""Keys of a study of trials that a page might change: the learning, and of each phase its load and plant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cogless.design.from_study import design_study
from cogless.live.blobs import held
from cogless.live.candidates import PLANT, Candidate, looked_up, made, quoted
from cogless.study import TrialStudy
from cogless.study.drive import IdealCurrentLoop
from cogless.study.plant import LinearPlant
from cogless.study.trial_controller import FilteredLaw, QFilter, StateIlc, TrialIlc

OF_TRIALS = "Trials"


def trial_candidates(study: TrialStudy) -> Iterator[Candidate]:
    """The keys that a page might change, those of controllers first; keys.py finds where each lands."""
    for name in dict.fromkeys(controller for _, controller in held(study)):
        yield from _of_controller(study, name)
    for scenario in dict.fromkeys(scenario for scenario, _ in held(study)):
        yield from _of_scenario(study, scenario)
    for group, key, low, high in PLANT:
        if key.startswith("drive."):
            owner, last, value = looked_up(study, study.source.tables, key)
            if owner is not None and value is not None:
                yield from made(key, key, group, owner, last, value, (low, high))


def _of_controller(study: TrialStudy, name: str) -> Iterator[Candidate]:
    """Keys that leave the feedback's gains as they are: those come from matrix inequalities, in seconds."""
    law, where = study.controller[name], f"controller.{quoted(name)}"
    if not isinstance(law, FilteredLaw):
        return
    run = next(pair for pair in held(study) if pair[1] == name)
    gain = "K_ilc" if isinstance(law, StateIlc) else "K_3"
    K_3 = design_study(study, [run])[run].K_3
    # of an update that the design chooses as a whole, since the study says nothing of it, K_3 is only a part
    chosen = "auto" in law.choice and law.q_filter is None and law.shift is None
    if K_3 and not chosen:
        yield from made(f"{where}.{gain}", gain, name, law, gain, K_3, (0.0, 2.0), controller=name)
    q = law.q_filter
    if isinstance(q, QFilter) and q.acts_on == "error" and (not isinstance(law, TrialIlc) or law.learning):
        cutoff = study.source.tables["controller"][name]["q_filter"]["cutoff"]
        key = f"{where}.q_filter.cutoff"
        yield from made(key, "q_filter.cutoff", name, q, "cutoff", cutoff, (0.3, 2.0), controller=name)


def _of_scenario(study: TrialStudy, scenario: str) -> Iterator[Candidate]:
    where, own = f"scenario.{quoted(scenario)}", study.source.tables["scenario"][scenario]
    experiment = study.scenario[scenario]
    fewest = float(max(experiment.starts))
    ends = (fewest, 2.0 * experiment.trials, "")
    yield from made(
        f"{where}.trials", "trials", OF_TRIALS, experiment, "trials", own["trials"], ends, scenario
    )
    yield from _of_phase(study, scenario, where, own, "")
    for n, change in enumerate(own.get("changes", ())):
        yield from _of_phase(
            study, scenario, f"{where}.changes.{n}", change, f", from trial {change['trial']}"
        )
    overridden = own.get("override", {})
    if study.plant is not None:
        for name, parameter in study.plant.parameter.items():
            value = overridden.get(name, parameter.nominal)
            yield from made(
                f"{where}.override.{quoted(name)}",
                name,
                "Plant",
                parameter,
                "value",
                value,
                (0.5, 2.0),
                scenario,
            )
        return
    for group, key, low, high in PLANT:
        owner, last, value = looked_up(study, study.source.tables, key)
        if (
            not key.startswith("drive.")
            and not _unfelt(study, key)
            and owner is not None
            and value is not None
        ):
            value = overridden.get(key, value)
            yield from made(
                f'{where}.override."{key}"', key, group, owner, last, value, (low, high), scenario
            )


def _unfelt(study: TrialStudy, key: str) -> bool:
    """Whether an ideal current loop makes no difference of this value."""
    electrical = ("R_s", "L_", "resistance", "inductance")
    ideal = study.drive is not None and isinstance(study.drive.current_loop, IdealCurrentLoop)
    return ideal and key.removeprefix("motor.").startswith(electrical)


def _of_phase(
    study: TrialStudy, scenario: str, where: str, own: dict[str, Any], when: str
) -> Iterator[Candidate]:
    """The loads of a phase, and the values that it gives the plant."""
    experiment = study.scenario[scenario]
    for n, (_, load) in enumerate(own.get("load_steps", ())):
        key = f"{where}.load_steps.{n}.1"
        yield from made(key, f"load{when}", OF_TRIALS, experiment, "load_steps", load, (0.0, 2.0), scenario)
    if not when:
        return
    for key, value in own.get("override", {}).items():
        owner: Any = None
        last: str | int = "value"
        if isinstance(study.plant, LinearPlant):
            owner = study.plant.parameter.get(key)
        elif isinstance(key, str):
            owner, last, _ = looked_up(study, study.source.tables, key)
        if owner is not None:
            path = f'{where}.override."{key}"' if "." in key else f"{where}.override.{key}"
            yield from made(path, f"{key}{when}", OF_TRIALS, owner, last, value, (0.5, 2.0), scenario)
