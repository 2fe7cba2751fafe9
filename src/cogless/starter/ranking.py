"""Find which guesses of a study matter most: short runs have one guess at a time at an end of its range.

What counts is the answer that the user gets: whether the speed is held, and the ripple that `harmonic`
leaves. Guesses that decide whether a speed is held come first. All others follow, in the order of their
largest ripple over their smallest, at the speed where this is largest. Each change is made in the study, as
by `--set`: the design follows.

Where the design says that the ripple of one run is partly chance, the guesses with the largest effects are
tried with further seeds. Then an effect counts only as far as it exceeds what the seeds change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cogless.control_library import NOTICED, SAFE_OUTPUT
from cogless.design.answers import doubt, other_seeds
from cogless.design.law_rules import unstable_feedback
from cogless.errors import StudyError
from cogless.results import Run
from cogless.results.held_speed import Miss, speed_miss, unevenness
from cogless.run.settings_search import Shortfall
from cogless.run.simulate import RunError, rollout
from cogless.starter.sheet import Guess
from cogless.study import Study, changed

LEARNING_LAW, BASELINE_LAW = "harmonic", "pi"
RUN_TICKS_MOST = 250_000  # periods of the current loop in a short run, at most
LAST_SHARE = 1 / 3  # share of a short run in which the ripple is taken
ALIKE_RATIO = 1.05  # ripples of a run and of its short run count as equal up to this ratio
# What the outcome of a run and the metrics of a draft are computed from.
OUTCOME_SIGNALS = ("omega_ref", "omega_m", "theta_m", "status", "i_d", "i_q")
AT_ONCE = 8  # variants in a batch; progress is reported after each batch

Report = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A run's answer. `ripple`: rms, rad/s. `why`: why the speed is not held; "" if it is.

    `uneven`: the rotor turns in jerks, with the right mean, whether or not that counts as held. `error`: a
    share of the speed, how far a speed is from being held.
    """

    ripple: float
    why: str
    uneven: bool = False
    error: float = math.inf
    of_seeds: tuple[Outcome, ...] = ()  # of runs with other seeds, where one run is partly chance

    @property
    def holds(self) -> bool:
        return not self.why

    @property
    def all_seeds(self) -> tuple[Outcome, ...]:
        return (self, *self.of_seeds)

    @property
    def surely_holds(self) -> bool:
        """Whether the speed is held with each seed."""
        return all(answer.holds for answer in self.all_seeds)

    @property
    def never_holds(self) -> bool:
        return not any(answer.holds for answer in self.all_seeds)

    @property
    def ripple_range(self) -> tuple[float, float]:
        """The least and the largest ripple of the seeds with which the speed is held, rad/s."""
        ripples = [answer.ripple for answer in self.all_seeds if answer.holds]
        return min(ripples), max(ripples)


Outcomes = Mapping[str, Outcome]  # A scenario's name is the key.


def shortfall(study: Study, answers: Outcomes) -> Shortfall:
    """What runs at all these speeds lack: less is better."""
    ratios = [
        answer.ripple / study.scenario[scenario].top_reference
        for scenario, answer in answers.items()
        if answer.holds
    ]
    errors = [answer.error for answer in answers.values() if not answer.holds]
    return Shortfall(len(errors), max(ratios, default=math.inf), max(errors, default=0.0))


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What a guess changes in a scenario.

    `nominal`: without a change. `outcomes`: by the label of the guess's variant.
    """

    guess: Guess
    scenario: str
    nominal: Outcome
    outcomes: Mapping[str, Outcome]

    @property
    def answers(self) -> tuple[Outcome, ...]:
        return (self.nominal, *self.outcomes.values())

    @property
    def decides(self) -> bool:
        """Whether one value of the guess holds the speed with each seed, and another one with no seed."""
        surely = any(answer.surely_holds for answer in self.answers)
        return surely and any(answer.never_holds for answer in self.answers)

    @property
    def held_outcomes(self) -> list[tuple[str, Outcome]]:
        """The outcomes that hold the speed with each seed, by label, the least ripple first.

        The label of the study without a change is "".
        """
        answers = [("", self.nominal), *self.outcomes.items()]
        return sorted(
            (item for item in answers if item[1].surely_holds), key=lambda item: item[1].ripple_range
        )

    @property
    def ripples(self) -> tuple[float, float]:
        """The least and the largest ripple of the answers that hold the speed, rad/s; nan if none does.

        With several seeds, an answer has a range of ripples. Then these are the lowest upper end and the
        highest lower end of the ranges: only what the seeds do not explain lies between them. If the first is
        not less than the second, the guess has no clear effect.
        """
        ranges = [answer.ripple_range for _, answer in self.held_outcomes]
        if not ranges:
            return math.nan, math.nan
        return min(high for _, high in ranges), max(low for low, _ in ranges)

    @property
    def size(self) -> tuple[bool, float]:
        """The sorting key of guesses: whether this one decides, and its largest ripple over its least."""
        low, high = self.ripples
        return self.decides, max(1.0, high / low) if low > 0 else 1.0


@dataclass(frozen=True, kw_only=True)
class AtSpeed:
    """Outcomes in one scenario of a study with all its guesses as they are."""

    learned: Outcome
    baseline: Outcome


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """Outcomes by scenario, and the effects of the guesses in each scenario, the largest first.

    `duration`: that of the short runs, s, if their outcome is clearly another than the full run's; else 0.
    `seeds`: the seeds of the runs in scenarios where one run is partly chance; only effects that were tried
    with all of them count there. `chance`: the outcomes there without a change, with all seeds.
    """

    at_speeds: Mapping[str, AtSpeed]
    effects: tuple[Effect, ...]
    duration: float = 0.0
    seeds: tuple[int, ...] = ()
    chance: Outcomes = field(default_factory=dict)

    @property
    def lost(self) -> list[str]:
        """The scenarios whose speed neither law holds."""
        return [name for name, at in self.at_speeds.items() if not (at.learned.holds or at.baseline.holds)]

    @property
    def hopeless(self) -> list[str]:
        """The scenarios whose speed `harmonic` does not hold, whichever guess is changed."""
        effects = {name: [e for e in self.effects if e.scenario == name] for name in self.at_speeds}
        return [
            name
            for name, of_guesses in effects.items()
            if of_guesses and not any(answer.holds for effect in of_guesses for answer in effect.answers)
        ]

    def largest(self, scenarios: Collection[str]) -> list[Effect]:
        """The largest effect of each guess in these scenarios, of those that have any effect."""
        of_guesses: dict[str, Effect] = {}
        for effect in self.effects:
            if effect.scenario in scenarios and effect.size != (False, 1.0):
                of_guesses.setdefault(effect.guess.key, effect)
        return [*of_guesses.values()]


def rank(
    study: Study, guesses: Sequence[Guess], progress: Report = lambda share: None, count: int = 3
) -> Ranking:
    """Run the study, and again with each guess changed. A refused or failed variant holds no speed.

    The runs with a changed guess are short, unless a speed is held only in a full run. `count`: guesses in
    each scenario that are tried with further seeds, where one run is partly chance.
    """
    (learned,), (base,) = (outcomes([study], law) for law in (LEARNING_LAW, BASELINE_LAW))
    short = shortened(study)
    (nominal,) = (learned,) if short is study else outcomes([short], LEARNING_LAW)
    # Where learning takes longer than the short run, the full run counts.
    slow = [name for name in study.scenario if learned[name].holds and not nominal[name].holds]
    nominal = {name: learned[name] if name in slow else nominal[name] for name in study.scenario}
    lengths = ((short, [name for name in study.scenario if name not in slow]), (study, slow))
    changes = [change for guess in guesses for change in guess.variants.values()]
    rest = iter([*_variants([length for length in lengths if length[1]], changes, progress)])
    variants = [(guess, {label: next(rest) for label in guess.variants}) for guess in guesses]
    effects = [
        Effect(
            guess=guess,
            scenario=scenario,
            nominal=nominal[scenario],
            outcomes={label: answers[scenario] for label, answers in of_guess.items()},
        )
        for guess, of_guess in variants
        for scenario in study.scenario
    ]
    effects.sort(key=lambda effect: effect.size, reverse=True)
    doubted = [name for name in study.scenario if doubt(study, LEARNING_LAW, name)]
    seeds = other_seeds(study) if doubted else ()
    chance: dict[str, Outcome] = {}
    for name in doubted:
        largest = [effect for effect in effects if effect.scenario == name][:count]
        length = study if name in slow else short
        chance[name], tried = _tried_by_seeds(length, name, nominal[name], largest, seeds)
        effects = [effect for effect in effects if effect.scenario != name] + tried
    effects.sort(key=lambda effect: effect.size, reverse=True)
    alike = all(_is_alike(learned[scenario], nominal[scenario]) for scenario in learned)
    return Ranking(
        at_speeds={name: AtSpeed(learned=learned[name], baseline=base[name]) for name in study.scenario},
        effects=tuple(effects),
        duration=0.0 if alike else max(scenario.duration for scenario in short.scenario.values()),
        seeds=(study.seed, *seeds) if seeds else (),
        chance=chance,
    )


def _tried_by_seeds(
    study: Study, scenario: str, nominal: Outcome, effects: Sequence[Effect], seeds: Sequence[int]
) -> tuple[Outcome, list[Effect]]:
    """`nominal` and `effects` of one scenario, each outcome with `of_seeds` from runs with these seeds."""
    changes = [{}, *(change for effect in effects for change in effect.guess.variants.values())]
    answers = [nominal, *(answer for effect in effects for answer in effect.outcomes.values())]
    able = [
        place for place, change in enumerate(changes) if not isinstance(_changed(study, change), StudyError)
    ]
    variants = [changed(study, {**changes[place], "seed": seed}) for place in able for seed in seeds]
    others = iter([of_seed[scenario] for of_seed in outcomes(variants, LEARNING_LAW, [scenario])])
    for place in able:
        answers[place] = replace(answers[place], of_seeds=tuple(next(others) for _ in seeds))
    nominal, *rest = answers
    answer = iter(rest)
    return nominal, [
        replace(effect, nominal=nominal, outcomes={label: next(answer) for label in effect.outcomes})
        for effect in effects
    ]


def _is_alike(one: Outcome, other: Outcome) -> bool:
    if not (one.holds and other.holds):
        return one.holds == other.holds
    return abs(math.log(one.ripple / other.ripple)) <= math.log(ALIKE_RATIO)


def shortened(study: Study) -> Study:
    """The study with runs of at most RUN_TICKS_MOST periods.

    If this makes them shorter, metrics are taken in their last third, and metrics of orders are left out.
    """
    full = max(scenario.duration for scenario in study.scenario.values())
    duration = min(full, RUN_TICKS_MOST / study.drive.rates.current_loop)
    if duration == full:
        return study
    last = LAST_SHARE * duration
    metrics = [
        {**table, "last": f"{last:.6g} s"}
        for table in study.source.tables["metric"]
        if table["kind"] != "order"
    ]
    durations = {f"scenario.{name}.duration": f"{duration:.6g} s" for name in study.scenario}
    return changed(study, {**durations, "metric": metrics})


def _variants(
    lengths: Sequence[tuple[Study, Collection[str]]], changes: Sequence[Mapping[str, Any]], progress: Report
) -> Iterator[Outcomes]:
    """The outcomes of each change. `lengths`: studies with other durations, and the scenarios of each."""
    for begin in range(0, len(changes), AT_ONCE):
        batch: list[dict[str, Outcome]] = [{} for _ in changes[begin : begin + AT_ONCE]]
        for study, scenarios in lengths:
            variants = [_changed(study, change) for change in changes[begin : begin + AT_ONCE]]
            accepted = [variant for variant in variants if not isinstance(variant, StudyError)]
            answers = iter(outcomes(accepted, LEARNING_LAW, scenarios))
            for of_change, variant in zip(batch, variants, strict=True):
                if isinstance(variant, StudyError):
                    of_change |= dict.fromkeys(scenarios, Outcome(ripple=math.nan, why=str(variant)))
                else:
                    of_change |= next(answers)
        yield from batch
        progress(min(1.0, (begin + AT_ONCE) / len(changes)))


def _changed(study: Study, change: Mapping[str, Any]) -> Study | StudyError:
    try:
        return changed(study, change)
    except StudyError as error:
        return error


def outcomes(
    variants: Sequence[Study], controller: str, scenarios: Collection[str] | None = None
) -> list[Outcomes]:
    """By scenario, the outcome of a run of each study with one controller. `scenarios`: None: in all."""
    if not variants:
        return []
    names = [*variants[0].scenario] if scenarios is None else scenarios
    try:
        results = rollout(variants, [f"{name}/{controller}" for name in names], signals=OUTCOME_SIGNALS)
    except RunError as error:
        results = error.all_results
    by_scenario = [{run.scenario: run for run in result.runs} for result in results]
    return [
        {name: outcome(variant, runs.get(name)) for name in names}
        for variant, runs in zip(variants, by_scenario, strict=True)
    ]


def outcome(study: Study, run: Run | None) -> Outcome:
    """The outcome of a run, in its last part, where the study's metrics are taken. `run`: None: it failed."""
    if run is None:
        return Outcome(ripple=math.nan, why="the run failed")
    ripple = float(np.asarray(run.metrics["speed_ripple_rad_s"]))
    late = run.trace.window(float(run.trace.time[-1]) - (study.metric[0].last or 0.0), math.inf)
    ratio = unevenness(run.trace.part("omega_ref", late), run.trace.part("omega_m", late))
    speed = speed_miss(run, late)
    why, error = _why(study, run, late, speed), math.inf if speed is None else speed.error
    return Outcome(ripple=ripple, why=why, uneven=ratio is not None, error=error)


def _why(study: Study, run: Run, late: slice, speed: Miss | None) -> str:
    status = np.nan_to_num(run.trace.part("status", late)).astype(int)
    if np.any(status & int(SAFE_OUTPUT)):
        causes = [words for bit, words in NOTICED.items() if np.any(status & int(bit))]
        return f"the drive switches off{f' ({causes[0]})' if causes else ''}"
    if speed is not None and speed.kind == "mean":
        return f"the mean speed is {100 * speed.value / speed.target:.3g} % of the reference"
    if speed is not None:
        return "the rotor turns in jerks" if speed.kind == "error" else "the speed isn't finite"
    return unstable_feedback(study, run.controller) or ""
