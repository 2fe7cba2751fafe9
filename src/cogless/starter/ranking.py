"""Find which guesses of a study matter most: short runs have one guess at a time at an end of its range.

What counts is the answer that the user gets: whether the speed is held, and the ripple that `harmonic`
leaves. Guesses that decide whether the speed is held come first. All others follow, in the order of their
largest ripple over their smallest. Each change is made in the study, as by `--set`: the design follows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cogless.control_library import NOTICED, SAFE_OUTPUT
from cogless.design.law_rules import unstable_feedback
from cogless.errors import StudyError
from cogless.results import Run
from cogless.results.held_speed import miss, unevenness
from cogless.run.simulate import RunError, rollout
from cogless.starter.sheet import Guess
from cogless.study import Study, changed

LEARNING_LAW, BASELINE_LAW = "harmonic", "pi"
RUN_TICKS_MOST = 250_000  # periods of the current loop in a short run, at most
LAST_SHARE = 1 / 3  # share of a short run in which the ripple is taken
ALIKE_RATIO = 1.05  # ripples of a run and of its short run count as equal up to this ratio
AT_ONCE = 8  # variants in a batch; progress is reported after each batch

Report = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A run's answer. `ripple`: rms, rad/s. `why`: why the speed is not held; "" if it is.

    `uneven`: the rotor turns in jerks, with the right mean, whether or not that counts as held.
    """

    ripple: float
    why: str
    uneven: bool = False

    @property
    def holds(self) -> bool:
        return not self.why


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What a guess changes. `nominal`: without a change. `outcomes`: by the label of the guess's variant."""

    guess: Guess
    nominal: Outcome
    outcomes: Mapping[str, Outcome]

    @property
    def answers(self) -> tuple[Outcome, ...]:
        return (self.nominal, *self.outcomes.values())

    @property
    def decides(self) -> bool:
        """Whether the guess decides if the speed is held."""
        return len({answer.holds for answer in self.answers}) > 1

    @property
    def ripples(self) -> tuple[float, float]:
        """The least and the largest ripple of the runs that hold the speed, rad/s; nan if none does."""
        ripples = [answer.ripple for answer in self.answers if answer.holds]
        return (min(ripples), max(ripples)) if ripples else (math.nan, math.nan)

    @property
    def size(self) -> tuple[bool, float]:
        """The sorting key of guesses: whether this one decides, and its largest ripple over its least."""
        low, high = self.ripples
        return self.decides, high / low if low > 0 else 1.0


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """Outcomes of a study with all its guesses as they are, and the effects of the guesses, largest first.

    `duration`: that of the short runs, s, if their outcome is clearly another than the full run's; else 0.
    """

    learned: Outcome
    baseline: Outcome
    effects: tuple[Effect, ...]
    duration: float = 0.0


def rank(study: Study, guesses: Sequence[Guess], progress: Report = lambda share: None) -> Ranking:
    """Run the study, and again with each guess changed. A refused or failed variant holds no speed.

    The runs with a changed guess are short, unless the speed is held only in a full run.
    """
    full = with_first_scenario(study)
    short = shortened(full)
    (scenario,) = full.scenario
    (learned,), (base,) = (outcomes([full], scenario, law) for law in (LEARNING_LAW, BASELINE_LAW))
    (nominal,) = (learned,) if short is full else outcomes([short], scenario, LEARNING_LAW)
    if learned.holds and not nominal.holds:
        short, nominal = full, learned  # Learning takes longer than the short run.
    changes = [change for guess in guesses for change in guess.variants.values()]
    rest = iter([*_variants(short, scenario, changes, progress)])
    effects = [
        Effect(guess=guess, nominal=nominal, outcomes={label: next(rest) for label in guess.variants})
        for guess in guesses
    ]
    effects.sort(key=lambda effect: effect.size, reverse=True)
    return Ranking(
        learned=learned,
        baseline=base,
        effects=tuple(effects),
        duration=0.0 if _is_alike(learned, nominal) else short.scenario[scenario].duration,
    )


def _is_alike(one: Outcome, other: Outcome) -> bool:
    if not (one.holds and other.holds):
        return one.holds == other.holds
    return abs(math.log(one.ripple / other.ripple)) <= math.log(ALIKE_RATIO)


def with_first_scenario(study: Study) -> Study:
    """The study with its first scenario alone."""
    name = next(iter(study.scenario))
    if len(study.scenario) == 1:
        return study
    return changed(study, {"scenario": {name: study.source.tables["scenario"][name]}})


def shortened(study: Study) -> Study:
    """A study of one scenario with a run of at most RUN_TICKS_MOST periods.

    If the run gets shorter by this, metrics are taken in its last third, and metrics of orders are left out.
    """
    ((name, scenario),) = study.scenario.items()
    duration = min(scenario.duration, RUN_TICKS_MOST / study.drive.rates.current_loop)
    if duration == scenario.duration:
        return study
    last = LAST_SHARE * duration
    metrics = [
        {**table, "last": f"{last:.6g} s"}
        for table in study.source.tables["metric"]
        if table["kind"] != "order"
    ]
    return changed(study, {f"scenario.{name}.duration": f"{duration:.6g} s", "metric": metrics})


def _variants(
    study: Study, scenario: str, changes: Sequence[Mapping[str, Any]], progress: Report
) -> Iterator[Outcome]:
    for begin in range(0, len(changes), AT_ONCE):
        batch = [_changed(study, change) for change in changes[begin : begin + AT_ONCE]]
        variants = [variant for variant in batch if not isinstance(variant, StudyError)]
        answers = iter(outcomes(variants, scenario, LEARNING_LAW))
        for variant in batch:
            if isinstance(variant, StudyError):
                yield Outcome(ripple=math.nan, why=str(variant))
            else:
                yield next(answers)
        progress(min(1.0, (begin + AT_ONCE) / len(changes)))


def _changed(study: Study, change: Mapping[str, Any]) -> Study | StudyError:
    try:
        return changed(study, change)
    except StudyError as error:
        return error


def outcomes(variants: Sequence[Study], scenario: str, controller: str) -> list[Outcome]:
    """The outcome of a run of each study, with one scenario and controller."""
    if not variants:
        return []
    try:
        results = rollout(variants, [f"{scenario}/{controller}"])
    except RunError as error:
        results = error.all_results
    runs = (next(iter(result.runs), None) for result in results)
    return [outcome(variant, run) for variant, run in zip(variants, runs, strict=True)]


def outcome(study: Study, run: Run | None) -> Outcome:
    """The outcome of a run, in its last part, where the study's metrics are taken. `run`: None: it failed."""
    if run is None:
        return Outcome(ripple=math.nan, why="the run failed")
    ripple = float(np.asarray(run.metrics["speed_ripple_rad_s"]))
    late = run.trace.window(float(run.trace.time[-1]) - (study.metric[0].last or 0.0), math.inf)
    ratio = unevenness(run.trace.part("omega_ref", late), run.trace.part("omega_m", late))
    return Outcome(ripple=ripple, why=_why(study, run, late), uneven=ratio is not None)


def _why(study: Study, run: Run, late: slice) -> str:
    status = np.nan_to_num(run.trace.part("status", late)).astype(int)
    if np.any(status & int(SAFE_OUTPUT)):
        causes = [words for bit, words in NOTICED.items() if np.any(status & int(bit))]
        return f"the drive switches off{f' ({causes[0]})' if causes else ''}"
    speed = miss(run.trace.part("omega_ref", late), run.trace.part("omega_m", late))
    if speed is not None and speed.kind == "mean":
        return f"the mean speed is {100 * speed.value / speed.target:.3g} % of the reference"
    if speed is not None:
        return "the rotor turns in jerks" if speed.kind == "error" else "the speed isn't finite"
    return unstable_feedback(study, run.controller) or ""
