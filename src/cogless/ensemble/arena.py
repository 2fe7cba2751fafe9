"""Run an arena: every law on every plant, in each of its cases.

This module also defines what happens in each case, and what is measured there.

In the first case the plant is the one that the laws assume, and the run has a load's step and a fault. In
three further cases the plant differs from what the laws assume. Some plants also run for an hour as assumed,
which shows what drifts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from cogless.design.auto import automatic, known_orders, missing
from cogless.design.law_rules import rules_of
from cogless.ensemble.arena_file import Arena, ArenaPlant
from cogless.errors import StudyError
from cogless.results import AnyResults
from cogless.results.limits import Limits
from cogless.results.metrics import Value
from cogless.run.limit_search import limits
from cogless.run.simulate import RunError, rollout
from cogless.study import AnyStudy, Study, changed
from cogless.study import load as load_study
from cogless.study.messages import dotted
from cogless.study.metric import EACH_PHASE, result_name
from cogless.study.reading import find, speed_study, trial_study, with_tables

TOLD_CASE, LATE, HEAVY, LIGHT, HOUR = "told", "late", "heavy", "light", "hour"
RIPPLE_METRIC = "ripple_rad_s"  # a metric's name in results.json
UNTOLD = (LATE, HEAVY, LIGHT)
INERTIA_RATIOS = {HEAVY: 1.5, LIGHT: 0.5}  # true inertia over the inertia that the laws assume
DROPOUT = "50 ms"  # the fault lasts this long: no angle is measured
HOUR_TIME, HOUR_END = 3600.0, 60.0  # s: the length of the run, and of the end that is measured
HOUR_TRACE_RATE = 20.0  # Hz, rounded later: rate of the trace over the hour
SLOW_TURNS = 1.1  # turns at the slowest speed that the window of the orders must cover


def scenarios(base: Study, plant: ArenaPlant) -> dict[str, dict[str, Any]]:
    """Tables of the scenarios: the assumed plant with step and fault, and three plants that differ."""
    own = base.source.tables["scenario"][plant.scenario]
    taken = {key: own[key] for key in ("reference", "initial_speed", "load", "override") if key in own}
    if plant.reference is not None:
        taken["reference"] = plant.reference
    if isinstance(taken["reference"], str):
        taken["initial_speed"] = taken["reference"]
    override = taken.pop("override", {})
    load = base.scenario[plant.scenario].load or base.mechanics.load
    step = plant.begin + plant.learn
    off, fault = step + plant.hold, step + 2 * plant.hold
    events = [
        {"time": f"{step!r} s", "load": f"{load.torque + plant.load!r} N*m"},
        {"time": f"{off!r} s", "load": f"{load.torque!r} N*m"},
    ]
    told_tables = {
        **taken,
        "override": override,
        "duration": f"{fault + plant.hold!r} s",
        "events": events,
        "faults": [{"kind": "angle-missing", "time": f"{fault!r} s", "duration": DROPOUT}],
    }
    short = {**taken, "duration": f"{step!r} s"}
    late = {"drive.bus.delay_command": f"{1 / base.drive.rates.outer_loop!r} s"}
    of_inertia = {
        case: {"mechanics.inertia": f"{share * base.mechanics.inertia!r} kg*m^2"}
        for case, share in INERTIA_RATIOS.items()
    }
    untold = {LATE: late, **of_inertia}
    return {TOLD_CASE: told_tables} | {
        case: {**short, "override": override | untold[case]} for case in UNTOLD
    }


def metrics(study: Study, plant: ArenaPlant) -> list[dict[str, Any]]:
    """The arena's columns as metrics of a study."""

    def s(time: float) -> str:
        return f"{time!r} s"

    at = plant.begin + plant.learn
    end = at + 3 * plant.hold
    learned = [s(at - plant.window), s(at)]
    step = {"signal": "omega_error", "event": s(at), "smooth": s(plant.smooth)}
    recovered = [s(end - min(plant.window, plant.hold / 2)), s(end)]
    of_error = {"signal": "omega_error", "unit": "rpm"}
    only_told = {"scenarios": [TOLD_CASE]}
    slowest = study.scenario[TOLD_CASE].slowest
    turn = max(plant.window, SLOW_TURNS * math.tau / slowest) if slowest else math.inf
    orders = {
        "kind": "order",
        "order": known_orders(study, next(iter(study.controller))),
        "window": [s(at - turn), s(at)],
    }
    pieces = {"window": [s(plant.begin), s(at)], "smooth": s(plant.smooth)}
    return [
        {"name": "ripple", "kind": "rms", "window": learned, **of_error},
        *([{"name": "orders", **orders, **of_error, **only_told}] if turn <= plant.learn else []),
        {"name": "dip", "kind": "dip", **step, "unit": "rpm", **only_told},
        {"name": "settling", "kind": "settling", "band": f"{plant.band!r} rad/s", **step, **only_told},
        {
            "name": "time_to_learn",
            "kind": "time-to-learn",
            "signal": "omega_error",
            "band": f"{plant.target!r} rad/s",
            **pieces,
            **only_told,
        },
        {"name": "copper_loss", "kind": "copper-loss", "window": learned, **only_told},
        {"name": "chattering", "kind": "chattering", "window": learned, **only_told},
        {"name": "after_fault", "kind": "rms", "window": recovered, **of_error, **only_told},
    ]


def learning(study: Study, law: str) -> Study:
    """A study of one law's ripple: TOLD_CASE until the law has learned, without step and fault."""
    scenario = study.source.tables["scenario"][TOLD_CASE]
    end = scenario["events"][0]["time"]
    short = {key: value for key, value in scenario.items() if key not in ("events", "faults")}
    (ripple,) = (metric for metric in study.source.tables["metric"] if metric["name"] == "ripple")
    tables = study.source.tables | {
        "scenario": {TOLD_CASE: {**short, "duration": end}},
        "controller": {law: study.source.tables["controller"][law]},
        "metric": [ripple],
    }
    return with_tables(study, tables)


def hour(study: Study) -> Study:
    """A study of the ripple at the end of an hour: TOLD_CASE, longer, without step and fault."""
    scenario = study.source.tables["scenario"][TOLD_CASE]
    long = {key: value for key, value in scenario.items() if key not in ("events", "faults")}
    # with an odd divider, the trace's rows don't return to the same angles: few rows give a good rms
    rate = study.drive.rates.current_loop / (
        2 * round(study.drive.rates.current_loop / HOUR_TRACE_RATE / 2) + 1
    )
    ripple = {"kind": "rms", "signal": "omega_error", "last": f"{HOUR_END!r} s", "unit": "rpm"}
    tables = study.source.tables | {
        "trace": {"rate": f"{rate!r} Hz"},
        "scenario": {HOUR: {**long, "duration": f"{HOUR_TIME!r} s"}},
        "metric": [{"name": "after_hour", **ripple}],
    }
    return with_tables(study, tables)


SEED_ANGLE_STEP = 137.508  # deg, from one seed's initial angle to the next seed's

ArenaProgress = Callable[[str, int], None]


@dataclass(frozen=True)
class ArenaRun:
    """A finished run. `case`: one of `scenarios`."""

    plant: str
    case: str
    law: str
    seed: int
    metrics: Mapping[str, Value]


@dataclass(frozen=True)
class ArenaTrialRun:
    """A finished run of trials. `metrics`: those with a number for each phase, by name in results.json."""

    trials: str
    law: str
    label: str
    kind: str  # the law's name
    seed: int
    metrics: Mapping[str, list[float]]


@dataclass(frozen=True)
class ArenaResults:
    """All runs of an arena. `absent`: why a law was not run on a plant, by (plant, law)."""

    arena: Arena
    runs: Sequence[ArenaRun]
    absent: Mapping[tuple[str, str], str]
    settings: Mapping[tuple[str, str], Mapping[str, Any]]  # controllers' tables, with auto's numbers
    before: Mapping[tuple[str, str], float]  # s, length of the run in which a table was learned
    trials: Sequence[ArenaTrialRun]
    limits: Mapping[str, Limits]  # by plant: what limits the ripple of its best law, first seed
    interrupted: bool = False  # by Ctrl-C: an unfinished plant or study of trials has no runs


def run_arena(
    arena: Arena,
    only: Sequence[str] | None = None,
    progress: ArenaProgress | None = None,
    jobs: int = 1,
    find_limits: bool = False,
) -> ArenaResults:
    """Run an arena, or only its pairs PLANT/LAW that match a pattern in `only`.

    `progress`: called with each plant and the number of plants before it. `find_limits`: find what limits the
    best law on each plant, by further runs. A law is `absent` from a plant if the rule auto has no numbers
    for it there, or if a run fails. Ctrl-C keeps the plants that are finished. StudyError: a plant or a law
    can't be prepared.
    """
    runs: list[ArenaRun] = []
    absent: dict[tuple[str, str], str] = {}
    settings: dict[tuple[str, str], Mapping[str, Any]] = {}
    before: dict[tuple[str, str], float] = {}
    limited: dict[str, Limits] = {}
    trials: list[ArenaTrialRun] = []
    interrupted = False
    try:
        for done, (plant, laws) in enumerate(chosen(arena, only).items()):
            if progress is not None:
                progress(plant, done)
            study, why = prepared(arena, plant, laws)
            absent_laws = {(plant, law): reason for law, reason in why.items()}
            studies = [(seed, _seeded(study, seed)) for seed in arena.seeds]
            if arena.plant[plant].hour:
                studies.append((arena.seeds[0], hour(studies[0][1])))
            rolled = _rolled([seeded for _, seeded in studies], jobs)
            of_plant: list[ArenaRun] = []
            for (seed, seeded), results in zip(studies, rolled, strict=True):
                of_plant += [
                    ArenaRun(plant, run.scenario, run.controller, seed, run.metrics) for run in results.runs
                ]
                runs_done = {(run.scenario, run.controller) for run in results.runs}
                lost = {
                    law
                    for case in seeded.scenario
                    for law in seeded.controller
                    if (case, law) not in runs_done
                }
                absent_laws |= {(plant, law): "fails on the way" for law in sorted(lost)}
            limited |= _limits_of_best(plant, studies[0][1], of_plant, jobs) if find_limits else {}
            runs += of_plant
            absent |= absent_laws
            settings |= {(plant, law): study.source.tables["controller"][law] for law in study.controller}
            for law, controller in study.controller.items():
                if controller.commissioning is not None:
                    before[plant, law] = controller.commissioning.duration
        for name in arena.trials:
            if not only or any(fnmatchcase(name, pattern.partition("/")[0]) for pattern in only):
                trials += _trials(arena, name, jobs)
    except KeyboardInterrupt:
        interrupted = True
    return ArenaResults(
        arena=arena,
        runs=runs,
        absent=absent,
        settings=settings,
        before=before,
        trials=trials,
        limits=limited,
        interrupted=interrupted,
    )


def _limits_of_best(plant: str, study: Study, runs: Sequence[ArenaRun], jobs: int) -> dict[str, Limits]:
    """By plant: what limits the law with the least mean ripple over seeds; empty if no law ran."""
    ripples: dict[str, list[float]] = {}
    for run in runs:
        value = run.metrics.get(RIPPLE_METRIC) if (run.plant, run.case) == (plant, TOLD_CASE) else None
        if isinstance(value, float):
            ripples.setdefault(run.law, []).append(value)
    if not ripples:
        return {}
    best = min(ripples, key=lambda law: sum(ripples[law]) / len(ripples[law]))
    alone = learning(study, best)
    (run_of_best,) = rollout([alone], jobs=1, keep_traces=False)[0].runs
    best_limits = limits(alone, run_of_best, alone.metric[0], jobs=jobs)
    return {} if best_limits is None else {plant: best_limits}


def _trials(arena: Arena, name: str, jobs: int) -> list[ArenaTrialRun]:
    """Run all controllers of a study of trials, with each seed."""
    trials = arena.trials[name]
    path = find(trials.study, "studies", "study", arena.path.parent, f"{arena.path}: trials.{name}.study: ")
    refusal = f"{arena.path}: trials.{name}.study: expected a study of trials"
    study = trial_study(load_study(path, trials.changes), refusal)
    of_phases = {result_name(m) for m in study.metric if m.kind in EACH_PHASE}
    runs = []
    studies = [changed(study, {"seed": seed}) for seed in arena.seeds]
    for seed, results in zip(arena.seeds, _rolled(studies, jobs), strict=True):
        for run in results.runs:
            values = {n: v for n, v in run.metrics.items() if n in of_phases and isinstance(v, list)}
            law = study.controller[run.controller]
            kind = str(getattr(law, "law", ""))
            runs.append(
                ArenaTrialRun(
                    trials=name,
                    law=run.controller,
                    label=study.label(run.controller),
                    kind=kind,
                    seed=seed,
                    metrics=values,
                )
            )
    return runs


def chosen(arena: Arena, only: Sequence[str] | None) -> dict[str, list[str]]:
    """The laws to run on each plant. StudyError: a pattern that matches nothing.

    A pattern for trials, NAME/*, chooses no plant.
    """
    pairs = [(plant, law) for plant in arena.plant for law in arena.law]
    for pattern in only or ():
        of_trials = any(fnmatchcase(name, pattern.partition("/")[0]) for name in arena.trials)
        if not of_trials and not any(fnmatchcase("/".join(pair), pattern) for pair in pairs):
            names = f"plants {', '.join(arena.plant)} and laws {', '.join(arena.law)}"
            raise StudyError(f'{arena.path}: --only: "{pattern}": expected PLANT/LAW of the {names}')
    laws_of: dict[str, list[str]] = {}
    for plant, law in pairs:
        if not only or any(fnmatchcase(f"{plant}/{law}", pattern) for pattern in only):
            laws_of.setdefault(plant, []).append(law)
    return laws_of


def prepared(arena: Arena, name: str, laws: Sequence[str]) -> tuple[Study, dict[str, str]]:
    """The study of a plant with those of these laws that can run, and by law why another can't."""
    plant = arena.plant[name]
    path = find(plant.study, "studies", "study", arena.path.parent, f"{arena.path}: plant.{name}.study: ")
    refusal = f'{arena.path}: plant.{name}.scenario: "{plant.scenario}": expected'
    base = speed_study(load_study(path, plant.changes), f"{refusal} a study of speed")
    if plant.scenario not in base.scenario:
        raise StudyError(f"{refusal} {', '.join(base.scenario)}")
    controllers = {law: _controller(arena, plant, law) for law in laws}
    absent = {
        law: "the arena's gains for this plant are for another kind of feedback than this law's"
        for law, table in controllers.items()
        if table is None
    }
    present = {law: table for law, table in controllers.items() if table is not None}
    if not present:
        raise StudyError(
            f"{arena.path}: plant.{name}: expected a law that can use the gains given for this plant"
        )
    shared_tables = ("title", "motor", "mechanics", "drive", "assumption")
    tables = {key: table for key, table in base.source.tables.items() if key in shared_tables}
    tables |= {
        "trace": {"rate": f"{base.drive.rates.speed_loop!r} Hz"},
        "scenario": scenarios(base, plant),
        "controller": present,
    }
    tuned, why = _tuned(with_tables(base, tables), absent)
    return changed(tuned, {"metric": metrics(tuned, plant)}), why


def _tuned(study: Study, absent: dict[str, str]) -> tuple[Study, dict[str, str]]:
    """The study with the numbers of the rule auto, without the laws that have none; and why, by law."""
    changes: dict[str, Any] = {}
    lost = {}
    for name in missing(study):
        try:
            own_keys, values = study.source.tables["controller"][name], automatic(study, name)
        except StudyError as error:
            lost[name] = error.text_without(f"{study.source.path}: controller.{name}.tuning")
            continue
        changes |= {dotted(("controller", name, key)): v for key, v in values.items() if key not in own_keys}
    for name in study.controller:
        refused = rules_of(study, name).refused()
        if refused is not None:
            lost[name] = refused
    if lost:
        tables = dict(study.source.tables)
        tables["controller"] = {k: v for k, v in tables["controller"].items() if k not in lost}
        study = with_tables(study, tables)
    return (changed(study, changes) if changes else study), absent | lost


def _controller(arena: Arena, plant: ArenaPlant, name: str) -> dict[str, Any] | None:
    """A law's table for a plant; None if the plant gives a feedback by hand that the law can't use."""
    table, law = dict(arena.laws[name]), arena.law[name]
    if law.learns and "learning_start" in type(law).model_fields:
        table = {"learning_start": f"{plant.begin!r} s", **table}
    if plant.feedback is None or law.code is not None:
        return table
    if not law.has_pi or law.holds_position or not law.is_auto:
        return None
    if "phase_margin" in table["tuning"]:  # the law asks for a feedback of its own
        return None
    return table | plant.feedback.model_dump()


def _seeded(study: Study, seed: int) -> Study:
    """The study with this seed of the noise, and with an initial angle that depends on the seed."""
    angle = f"{SEED_ANGLE_STEP * seed % 360!r} deg"
    return changed(
        study, {"seed": seed} | {f"scenario.{case}.initial_angle": angle for case in study.scenario}
    )


def _rolled(studies: Sequence[AnyStudy], jobs: int) -> list[AnyResults]:
    """The results of all studies, without the runs that fail. KeyboardInterrupt: Ctrl-C ended a run."""
    try:
        results = rollout(studies, jobs=jobs, keep_traces=False)
    except RunError as error:  # a law fails; all other runs are finished
        return error.all_results
    if any(result.interrupted for result in results):
        raise KeyboardInterrupt
    return results
