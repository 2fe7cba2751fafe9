"""Keys of a study of trials that a page might change: the learning, and of each phase its load and plant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from cogless.design.from_study import design_study, uncertain_plant
from cogless.live.blobs import blobs, held
from cogless.live.candidates import PLANT, Candidate, looked_up, made, quoted
from cogless.report.trials.phases import groups, phases
from cogless.run.simulate import Pair
from cogless.study import TrialStudy
from cogless.study.drive import IdealCurrentLoop
from cogless.study.plant import LinearPlant
from cogless.study.reading import Changes, changed
from cogless.study.trial_controller import (
    FilteredLaw,
    ObserverIlc,
    QFilter,
    StateIlc,
    TrialIlc,
    TrialLaw,
)

OF_TRIALS = "Trials"
SHIFT_MOST = 16  # samples: a slider of the shift reaches this at least
WEIGHT = "input_weight of all feedback (learning gains stay)"
WEIGHT_SHARES = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0)  # of the study's value: each is a design of its own


def trial_candidates(study: TrialStudy) -> Iterator[Candidate]:
    """The keys that a page might change, those of controllers first; keys.py finds where each lands."""
    for name in dict.fromkeys(controller for _, controller in held(study)):
        yield from _of_controller(study, name)
    yield from _weight(study)
    for scenario in dict.fromkeys(scenario for scenario, _ in held(study)):
        yield from _of_scenario(study, scenario)
    for group, key, low, high in PLANT:
        if key.startswith("drive."):
            owner, last, value = looked_up(study, study.source.tables, key)
            if owner is not None and value is not None:
                yield from made(key, key, group, owner, last, value, (low, high))


def pinned(study: TrialStudy) -> tuple[TrialStudy, Changes]:
    """The study with what its designs chose for learning written out, and these values by key.

    Then the filter, the shift and the weight each move numbers of their own, and K_3 stays where it is. A
    controller for which this would change a bit stays as it is.
    """
    pins: dict[str, Any] = {}
    for name in dict.fromkeys(controller for _, controller in held(study)):
        run = next(pair for pair in held(study) if pair[1] == name)
        own = _chosen(study, run)
        if own and _same_law(study, changed(study, own), run):
            pins |= own
    return (changed(study, pins) if pins else study), pins


def _chosen(study: TrialStudy, run: Pair) -> Changes:
    """The values that a controller's design chose, by key; empty for a law without a design."""
    law, where = study.controller[run[1]], f"controller.{quoted(run[1])}"
    if not isinstance(law, TrialLaw) or not getattr(law, "learning", True):
        return {}
    design = design_study(study, [run])[run]
    gain, cutoff, q = _gain(law), design.gains.cutoff, design.q_filter
    if isinstance(law, ObserverIlc):
        observer = design.gains.observer
        chosen = {"pole": observer.pole if observer is not None else None, "cutoff": _hertz(cutoff)}
        return {f"{where}.{key}": x for key, x in chosen.items() if x and getattr(law, key) is None}
    if not gain or not design.K_3:
        return {}
    pins: dict[str, Any] = {f"{where}.{gain}": design.K_3} if getattr(law, gain) is None else {}
    if isinstance(law, TrialIlc) and not isinstance(law.shift, int):
        pins[f"{where}.shift"] = design.shift
    own = getattr(law, "q_filter", None)
    if q is not None and cutoff and not isinstance(getattr(own, "cutoff", None), float):
        about = {"order": len(q.b) - 1, "ends": "odd" if q.odd else "even", "acts_on": design.filtered}
        pins[f"{where}.q_filter"] = {"cutoff": _hertz(cutoff), **about}
    return pins


def _gain(law: TrialLaw) -> str:
    """The key of a law's learning gain; "" if it has none."""
    return "K_ilc" if isinstance(law, StateIlc) else "K_3" if isinstance(law, TrialIlc) else ""


def _hertz(frequency: float | None) -> str | None:
    return None if frequency is None else f"{frequency!r} Hz"


def _same_law(study: TrialStudy, other: TrialStudy, run: Pair) -> bool:
    """Whether two studies give a run the same bytes."""
    return blobs(study, *run)["run"].data == blobs(other, *run, study)["run"].data


def _of_controller(study: TrialStudy, name: str) -> Iterator[Candidate]:
    """Keys that leave the feedback's gains as they are, or that move these alone."""
    law, where = study.controller[name], f"controller.{quoted(name)}"
    if not isinstance(law, TrialLaw) or not getattr(law, "learning", True):
        return
    if isinstance(law, ObserverIlc):
        for key, value, ends in (("cutoff", _hertz(law.cutoff), (0.3, 2.0)), ("pole", law.pole, (0.3, 2.0))):
            if value is not None:
                yield from made(f"{where}.{key}", key, name, law, key, value, ends, controller=name)
        return
    if not isinstance(law, FilteredLaw):
        return
    run = next(pair for pair in held(study) if pair[1] == name)
    gain = _gain(law)
    given, K_3 = getattr(law, gain) is not None, design_study(study, [run])[run].K_3
    # Of an update that the design chooses as a whole, since the study says nothing of it, K_3 is only a part.
    chosen = "auto" in law.choice and law.q_filter is None and law.shift is None
    if K_3 and not chosen:
        yield from made(f"{where}.{gain}", gain, name, law, gain, K_3, (0.0, 2.0), controller=name)
    q = law.q_filter
    stays = f" ({gain} stays)" if given else ""
    learns = not isinstance(law, TrialIlc) or law.learning
    if isinstance(q, QFilter) and (given or q.acts_on == "error") and learns:
        own = study.source.tables["controller"][name]["q_filter"]
        key, label = f"{where}.q_filter.cutoff", "q_filter.cutoff" + stays * (q.acts_on == "signal")
        yield from made(key, label, name, q, "cutoff", own["cutoff"], (0.3, 2.0), controller=name)
    if given and isinstance(law, TrialIlc) and isinstance(law.shift, int):
        least = uncertain_plant(study).relative_degree
        span = (float(least), float(max(4 * law.shift, SHIFT_MOST)), "")
        yield from made(
            f"{where}.shift", f"shift{stays}", name, law, "shift", law.shift, span, controller=name
        )


def _weight(study: TrialStudy) -> Iterator[Candidate]:
    """The weight of the input, with the learning gains as they are: only its ratio to the states' counts."""
    laws = [study.controller[name] for name in dict.fromkeys(controller for _, controller in held(study))]
    designed = [
        law for law in laws if isinstance(law, FilteredLaw) and not law.model_dump().get(_feedback(law))
    ]
    learning = [law for law in designed if getattr(law, "learning", True)]
    if not designed or any(getattr(law, _gain(law)) is None for law in learning):
        return
    weight = study.design.input_weight
    stops = tuple(sorted({weight, *(float(f"{weight * share:.3g}") for share in WEIGHT_SHARES)}))
    key = "design.input_weight"
    for candidate in made(key, WEIGHT, OF_TRIALS, study.design, "input_weight", weight, (0.1, 10.0)):
        low, high = stops[0], stops[-1]
        yield replace(candidate, stops=stops, low=low, high=high, least=low, most=high)


def _feedback(law: FilteredLaw) -> str:
    """The key of a law's own feedback gains."""
    return "K_stab" if isinstance(law, StateIlc) else "K_s"


def _of_scenario(study: TrialStudy, scenario: str) -> Iterator[Candidate]:
    where, own = f"scenario.{quoted(scenario)}", study.source.tables["scenario"][scenario]
    experiment = study.scenario[scenario]
    fewest = float(max(experiment.starts))
    ends = (fewest, 2.0 * experiment.trials, "")
    yield from made(
        f"{where}.trials", "trials", OF_TRIALS, experiment, "trials", own["trials"], ends, scenario
    )
    yield from _of_phase(study, scenario, where, own, "")
    alone = {group.start for group in groups(phases(experiment)) if len(group.phases) == 1}
    for n, change in enumerate(own.get("changes", ())):
        if change["trial"] not in alone:
            continue  # one of many changes alike
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
