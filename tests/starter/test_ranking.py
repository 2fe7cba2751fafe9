"""The guesses that `cogless new` names are those with the largest effect in a sweep of their own."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drafts import request, written

from cogless.run.simulate import simulate
from cogless.starter import Effect, Outcome, rank
from cogless.starter.ranking import RUN_TICKS_MOST, shortened
from cogless.starter.sheet import Guess
from cogless.study import Study, load


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
