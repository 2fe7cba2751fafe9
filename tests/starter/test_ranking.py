"""The guesses that `cogless new` names are those with the largest effect in a sweep of their own."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drafts import drafted_by_rules, request, written

from cogless.run.simulate import simulate
from cogless.starter import Effect, Outcome, rank
from cogless.starter.ranking import RUN_TICKS_MOST, shortened
from cogless.starter.sheet import Guess
from cogless.study import Study, changed, load


def ripple(study: Study) -> float:
    """Ripple that harmonic leaves in the last third, as a share of the reference; from the trace itself."""
    trace = simulate(study, "slow", "harmonic").trace
    late = np.asarray(trace["omega_m"])[2 * len(trace.time) // 3 :]
    reference = study.scenario["slow"].top_reference
    if abs(np.mean(late) / reference - 1) > 0.05 or np.std(late) > 0.5 * reference:
        return math.inf
    return float(np.std(late)) / reference


def test_the_three_guesses_named_are_those_with_the_largest_effect(tmp_path: Path) -> None:
    made, study = written(tmp_path, request("gm5208", "generic", "as5048"))
    ranking = rank(study, made.guesses)
    short = shortened(study)
    length = f"{short.scenario['slow'].duration:.6g} s"
    last = f"{(short.metric[0].last or 0.0):.6g} s"

    def swept(change: dict[str, Any]) -> float:
        """As `--set` does it, from the file."""
        window = {f"metric.{n}.last": last for n in range(len(study.metric))}
        return ripple(load(tmp_path / "mine.toml", {"scenario.slow.duration": length, **window, **change}))

    nominal = swept({})
    sizes = {}
    for guess in made.guesses:
        found = [nominal, *(swept(dict(change)) for change in guess.variants.values())]
        sizes[guess.name] = math.inf if math.inf in found else max(found) / min(found)
    largest = sorted(sizes, key=lambda name: sizes[name], reverse=True)[:3]
    assert {effect.guess.name for effect in ranking.effects[:3]} == set(largest)
    for effect in ranking.effects[:3]:
        low, high = effect.ripples
        assert effect.decides or high / low == pytest.approx(sizes[effect.guess.name], rel=0.25)
    assert sizes[largest[0]] > 2  # the order is not by chance


def effect(*ripples: float, nominal: float = 1.0) -> Effect:
    """NaN: the speed is not held."""

    def answer(value: float) -> Outcome:
        return Outcome(ripple=value, why="it stops" if math.isnan(value) else "")

    guess = Guess(key="key", name="name", span="", variants={})
    outcomes = {str(n): answer(value) for n, value in enumerate(ripples)}
    return Effect(guess=guess, scenario="slow", nominal=answer(nominal), outcomes=outcomes)


def test_what_decides_comes_before_what_changes_the_ripple() -> None:
    sizes = [effect(1.0, 1.1).size, effect(0.1, 10).size, effect(math.nan, 1.0).size]
    assert sizes == sorted(sizes)
    assert effect(math.nan, 1.0).decides and not effect(0.1, 10).decides
    assert effect(math.nan, math.nan, nominal=math.nan).size == (False, 1.0)
    assert effect(0.5, 2.0).ripples == (0.5, 2.0)


def test_a_variant_that_is_refused_holds_no_speed(tmp_path: Path) -> None:
    _, study = written(tmp_path, request("gm5208", "generic", "as5048"))
    bad = Guess(key="motor.R_s", name="bad", span="", variants={"-1 ohm": {"motor.R_s": "-1 ohm"}})
    (found,) = rank(study, [bad]).effects
    assert not found.outcomes["-1 ohm"].holds and "motor.R_s" in found.outcomes["-1 ohm"].why
    assert found.decides and found.nominal.holds


def test_guesses_are_tried_for_as_long_as_learning_takes(tmp_path: Path) -> None:
    """A step motor turns in jerks until harmonic has learned, which takes longer than the short runs."""
    made, study = written(
        tmp_path, request("nema17", "stepper", "as5047", speed="5 rpm", detent_torque="30 mN*m")
    )
    short = shortened(study)
    assert short.scenario["slow"].duration == RUN_TICKS_MOST / study.drive.rates.current_loop
    assert math.isinf(ripple(short)) and math.isfinite(ripple(study))
    few = [guess for guess in made.guesses if guess.key in ("drive.inverter.dead_time", "motor.R_s")]
    ranking = rank(study, few)
    assert ranking.at_speeds["slow"].learned.holds and ranking.duration == 0
    assert ranking.effects[0].guess.key == "drive.inverter.dead_time" and ranking.effects[0].decides
    assert math.isinf(ripple(load(tmp_path / "mine.toml", {"drive.inverter.dead_time": "1000 ns"})))


def seeded(*ripples: float) -> Outcome:
    """An outcome with these ripples, one a seed. NaN: the speed is not held."""
    first, *others = (Outcome(ripple=value, why="it stops" if math.isnan(value) else "") for value in ripples)
    return replace(first, of_seeds=tuple(others))


def test_an_effect_counts_as_far_as_it_exceeds_what_seeds_change() -> None:
    guess = Guess(key="key", name="name", span="", variants={})

    def size(nominal: Outcome, variant: Outcome) -> tuple[bool, float]:
        return Effect(guess=guess, scenario="slow", nominal=nominal, outcomes={"end": variant}).size

    assert size(seeded(0.879, 0.332, 0.4), seeded(0.35, 0.8, 0.5)) == (False, 1.0)  # one seed: 2.5 times
    assert size(seeded(0.3, 0.4, 0.35), seeded(0.9, 0.6, 0.8)) == (False, pytest.approx(1.5))
    assert size(seeded(0.3, 0.4, 0.35), seeded(math.nan, 0.3, 0.4)) == (False, 1.0)  # one seed: it decides
    assert size(seeded(0.3, 0.4, 0.35), seeded(*[math.nan] * 3))[0]


def test_where_a_run_is_partly_chance_guesses_are_ranked_by_several_seeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An encoder of 14 bits gives a third of a count per sample at 5 r/min; at 60 r/min it gives four."""
    drafted_by_rules(monkeypatch)
    own = {"kv": 224, "speed": 5, "bus_voltage": 24}
    made, study = written(tmp_path, request("own", "generic", "as5047", **own))
    few = [guess for guess in made.guesses if guess.key in ("mechanics.inertia", "motor.slots")]
    ranking = rank(study, few, count=1)
    assert ranking.seeds == (0, 1, 2) and len(ranking.effects) == 1
    (effect,) = ranking.effects
    short = shortened(study)
    answers = {"": (effect.nominal, {})}
    answers |= {label: (effect.outcomes[label], change) for label, change in effect.guess.variants.items()}
    for outcome, change in answers.values():
        of_seeds = [ripple(changed(short, {**change, "seed": seed})) for seed in ranking.seeds]
        assert [answer.holds for answer in outcome.all_seeds] == [math.isfinite(size) for size in of_seeds]
        top = short.scenario["slow"].top_reference
        for answer, size in zip(outcome.all_seeds, of_seeds, strict=True):
            assert not answer.holds or answer.ripple / top == pytest.approx(size, rel=0.25)
    assert ranking.chance["slow"] == effect.nominal
    faster = changed(study, {"scenario.slow.reference": "60 rpm"})
    sure = rank(faster, few[:1], count=1)
    assert sure.seeds == () and not sure.effects[0].nominal.of_seeds
