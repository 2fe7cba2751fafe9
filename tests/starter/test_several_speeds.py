"""A first study with several speeds: each of them counts in what `cogless new` chooses and ranks."""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drafts import request, written

from cogless.design.answers import doubt
from cogless.run.simulate import simulate
from cogless.starter import Draft, Effect, Outcome, Ranking, draft, holding_settings, parse_speeds
from cogless.starter.motor_rules import is_balanced
from cogless.starter.ranking import shortfall
from cogless.starter.sensor_choice import fit_observer
from cogless.starter.sheet import Guess
from cogless.study import Study, changed, load


def drafted(
    folder: Path, motor: str, drive: str, encoder: str, *speeds: float, **numbers: Any
) -> tuple[Draft, Study]:
    first, *others = speeds
    of = request(motor, drive, encoder, speed=first, **numbers)
    return written(folder, replace(of, faster=parse_speeds([str(speed) for speed in others])))


def error(study: Study, scenario: str) -> float:
    """The rms of harmonic's speed error / the reference, where metrics are taken; from the trace itself."""
    trace = simulate(study, scenario, "harmonic").trace
    last = trace.time >= trace.time[-1] - (study.metric[0].last or 0.0)
    reference = study.scenario[scenario].top_reference
    return float(np.sqrt(np.mean((np.asarray(trace["omega_m"])[last] / reference - 1) ** 2)))


def test_the_speed_method_is_the_best_at_the_worst_speed(tmp_path: Path) -> None:
    """At 5 r/min the rotor is lost with either observer. That at 20 r/min it is held decides."""
    _, study = drafted(tmp_path, "nema17", "stepper", "as5047", 5, 20)
    by_rule = {f"drive.position_sensor.{key}": value for key, value in fit_observer(study).items()}
    stops = math.sqrt(0.5)  # a sine of this rms stops the rotor
    assert error(study, "at_20_rpm") < stops < error(changed(study, by_rule), "at_20_rpm")
    assert error(study, "at_5_rpm") > stops


def test_timed_edges_replace_an_observer_that_is_worse_at_the_worst_speed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rule takes timed edges here. With a slow observer in its place, the runs find them."""
    slow = {"speed_method": "observer", "observer_bandwidth": "30 Hz"}
    monkeypatch.setattr(sys.modules[draft.__module__], "fit_observer", lambda study: slow)
    _, study = drafted(tmp_path, "own", "generic", "incremental", 60, 300, cpr=20_000)
    sensor = study.source.tables["drive"]["position_sensor"]
    assert sensor["speed_method"] == "MT" and sensor["timer"] == "100000 kHz"
    observed = {key: value for key, value in sensor.items() if key != "timer"} | slow
    other = changed(study, {"drive.position_sensor": observed})
    worst, worst_observed = (max(error(of, name) for name in study.scenario) for of in (study, other))
    assert worst < 0.8 * worst_observed


def outcome(ripple: float, why: str = "") -> Outcome:
    """A run's answer; ripple in r/min."""
    return Outcome(ripple=ripple * math.pi / 30, why=why)


def test_a_lost_speed_is_worse_than_any_ripple_and_a_ripple_counts_by_its_speed() -> None:
    study = load(Path(__file__).parents[2] / "examples" / "my_motor.toml")
    table = study.source.tables["scenario"]["slow"]
    both = {"slow": table, "fast": {**table, "reference": "300 rpm"}}
    study = changed(study, {"scenario": both})
    coarse = {"slow": outcome(6), "fast": outcome(9)}  # 20 and 3 % of 30 and 300 r/min
    fine = {"slow": outcome(0.3), "fast": outcome(45)}  # 1 and 15 %
    lost = {"slow": outcome(0.1), "fast": outcome(0.1, "it stops")}
    assert shortfall(study, coarse)[:2] == (0, pytest.approx(0.2))
    assert shortfall(study, fine) < shortfall(study, coarse) < shortfall(study, lost)


def test_a_guess_counts_by_its_largest_effect_over_the_speeds() -> None:
    def effect(key: str, scenario: str, *answers: Outcome) -> Effect:
        guess = Guess(key=key, name=key, span="", variants={})
        return Effect(guess=guess, scenario=scenario, nominal=answers[0], outcomes={"": answers[1]})

    effects = [
        effect("friction", "fast", outcome(1), outcome(1, "it stops")),
        effect("inertia", "slow", outcome(1), outcome(5)),
        effect("friction", "slow", outcome(1), outcome(2)),
        effect("noise", "slow", outcome(1), outcome(1.0)),
    ]
    ranking = Ranking(at_speeds={}, effects=tuple(effects))

    def largest(*scenarios: str) -> list[tuple[str, str]]:
        return [(each.guess.key, each.scenario) for each in ranking.largest(scenarios)]

    assert largest("slow", "fast") == [("friction", "fast"), ("inertia", "slow")]
    assert largest("slow") == [("inertia", "slow"), ("friction", "slow")]


def test_a_setting_that_is_offered_holds_a_speed_that_was_lost(tmp_path: Path) -> None:
    _, study = drafted(tmp_path, "nema17", "stepper", "as5047", 20)
    settings = holding_settings(study, ["slow"])
    assert settings.changes and settings.outcomes["slow"].holds
    assert error(changed(study, settings.changes), "slow") < 0.5 < math.sqrt(0.5) < error(study, "slow")
    assert "dead-time compensation" in settings.vain
    compensated = changed(study, {"drive.dead_time_compensation": {"band": "6 mA"}})
    assert error(compensated, "slow") > math.sqrt(0.5)


def test_a_setting_that_was_not_tried_is_not_called_vain(tmp_path: Path) -> None:
    """The speed loop runs as often as the current loop already."""
    numbers = {"holding_torque": 0.45, "rated_current": 1.7, "speed_rate": "20 kHz"}
    _, study = drafted(tmp_path, "nema17", "stepper", "as5600", 20, **numbers)
    assert error(study, "slow") > math.sqrt(0.5)
    settings = holding_settings(study, ["slow"])
    assert "the rate of the speed loop" not in settings.vain and "a slower current loop" in settings.vain


def test_no_setting_is_tried_against_the_bus_voltage(tmp_path: Path) -> None:
    numbers = {"pole_pairs": 4, "kv": 17, "resistance": 1.5, "bits": 17}
    _, study = drafted(tmp_path, "own", "generic", "absolute", 600, **numbers)
    assert holding_settings(study, ["slow"]).vain == ()


@pytest.mark.parametrize(("motor", "poles"), [("gm5208", 14), ("hoverboard", 30), ("mandra2019", 6)])
def test_the_slots_of_a_shipped_motor_are_ranked_unless_its_datasheet_has_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, motor: str, poles: int
) -> None:
    made, study = written(tmp_path, request(motor, "generic", "as5047"))
    (guess,) = (guess for guess in made.guesses if guess.key == "motor.slots")
    assert guess.variants
    for change in guess.variants.values():
        slots, waves = change["motor.slots"], change["motor.cogging"]
        assert slots != study.motor.slots and is_balanced(slots, poles // 2)
        assert waves[0]["order"] == math.lcm(slots, poles) and "motor.pole_pairs" not in change
        assert changed(study, change).motor.slots == slots
    for known in (
        request(motor, "generic", "as5047", slots=study.motor.slots),
        request("uomodri", "odrive", "hall"),
    ):
        assert all(guess.key != "motor.slots" for guess in written(tmp_path, known)[0].guesses)


def test_a_doubt_of_one_speed_is_not_a_doubt_of_another(tmp_path: Path) -> None:
    """14 bits give 16384 counts in 30 s: with 1 kHz half a count per sample at 2 r/min, 16 at 60 r/min."""
    _, study = drafted(tmp_path, "gimbal", "simplefoc", "as5048", 2, 60)
    assert doubt(study, "harmonic", "at_2_rpm").startswith(
        "at 2 rpm the position sensor gives 0.55 counts per"
    )
    assert doubt(study, "harmonic", "at_60_rpm") == ""
