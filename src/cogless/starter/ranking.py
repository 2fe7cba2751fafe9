"""Which guesses of a study matter most: each at the ends of its range, one at a time, by short runs.

What counts is the answer that the user gets: whether the speed is held, and the ripple that `harmonic`
leaves. A guess whose range changes the first comes before all others; these are in the order of the factor
between the largest and the smallest ripple. A change is one of the study, as by `--set`: the design follows.
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
RUN_TICKS_MOST = 250_000  # a run has no more
LAST_SHARE = 1 / 3  # of a run, in which the ripple is taken
ALIKE_RATIO = 1.05  # of the ripple of a run to that of a shorter one, which then tells as much
AT_ONCE = 8  # variants in a batch, between which progress is told

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
    """What a guess changes. `outcomes`: what comes of each of its variants."""

    guess: Guess
    nominal: Outcome
    outcomes: Mapping[str, Outcome]

    @property
    def answers(self) -> tuple[Outcome, ...]:
        return (self.nominal, *self.outcomes.values())

    @property
    def decides(self) -> bool:
        """Whether it depends on the guess that the speed is held."""
        return len({answer.holds for answer in self.answers}) > 1

    @property
    def ripples(self) -> tuple[float, float]:
        """The least and the largest ripple among those that hold the speed, rad/s; nan if none does."""
        ripples = [answer.ripple for answer in self.answers if answer.holds]
        return (min(ripples), max(ripples)) if ripples else (math.nan, math.nan)

    @property
    def size(self) -> tuple[bool, float]:
        """What guesses are ordered by: whether it decides, and the factor between its ripples."""
        low, high = self.ripples
        return self.decides, high / low if low > 0 else 1.0


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """Answers of a study with all its guesses as they are, and the effects of the guesses, largest first.

    `duration`: of the runs of the effects, s, where they are shorter than the study's and leave clearly more
    or less; 0 where they are not.
    """

    learned: Outcome
    baseline: Outcome
    effects: tuple[Effect, ...]
    duration: float = 0.0


def rank(study: Study, guesses: Sequence[Guess], progress: Report = lambda share: None) -> Ranking:
    """Run the study, and again with each guess changed. A variant that is refused or fails holds no speed."""
    short = shortened(study)
    (scenario,) = short.scenario
    changes: list[Mapping[str, Any]] = [
        {},
        *(change for guess in guesses for change in guess.variants.values()),
    ]
    nominal, *others = _variants(short, scenario, changes, progress)
    rest = iter(others)
    effects = [
        Effect(guess=guess, nominal=nominal, outcomes={label: next(rest) for label in guess.variants})
        for guess in guesses
    ]
    is_short = short.scenario[scenario].duration < study.scenario[scenario].duration
    (learned,) = outcomes([study], scenario, LEARNING_LAW) if is_short else (nominal,)
    (base,) = outcomes([study], scenario, BASELINE_LAW)
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


def shortened(study: Study) -> Study:
    """The study's first scenario alone, with a run of at most RUN_TICKS_MOST periods.

    Where that is shorter than the study's, the metrics are taken in the last third of it.
    """
    name, scenario = next(iter(study.scenario.items()))
    if len(study.scenario) > 1:
        study = changed(study, {"scenario": {name: study.source.tables["scenario"][name]}})
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
        return changed(study, change) if change else study
    except StudyError as error:
        return error


def outcomes(variants: Sequence[Study], scenario: str, controller: str) -> list[Outcome]:
    """What comes of a run of each study."""
    if not variants:
        return []
    try:
        results = rollout(variants, [f"{scenario}/{controller}"])
    except RunError as error:
        results = error.all_results
    runs = (next(iter(result.runs), None) for result in results)
    return [outcome(variant, run) for variant, run in zip(variants, runs, strict=True)]


def outcome(study: Study, run: Run | None) -> Outcome:
    """What came of a run, over the last part of it in which the study's metrics are taken."""
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
