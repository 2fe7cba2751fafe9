"""Each plant of the shipped arena agrees with its `about`: a check exists for every word of it."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogless import load
from cogless.ensemble.arena import RIPPLE_METRIC, TOLD_CASE, learning, prepared
from cogless.ensemble.arena_file import Arena, ArenaPlant, arena_of
from cogless.files import shipped
from cogless.run.simulate import simulate
from cogless.study import Study, TrialStudy, changed
from cogless.study.motor import StepMotor
from cogless.study.position_sensor import Absolute, Counted, Encoder, Hall
from cogless.study.reading import read

RPM = math.pi / 30
PATH = shipped("studies")["arena"]
FILLERS = "a an the and its that at by on of in where once turn this with turns"


@cache
def arena() -> Arena:
    return arena_of(PATH, read(PATH))


@dataclass(frozen=True)
class Plant:
    """A plant with the bar's law. `before`: the plant before it in the file, to which "the same" refers."""

    told: ArenaPlant
    study: Study
    before: Plant | None

    def ripple(self, **changes: Any) -> float:
        """Rms of the bar's true speed error over the plant's window, r/min, with changes of the study."""
        begun = self.told.begin + self.told.window
        alone = {"duration": f"{begun!r} s", "events": [], "faults": []}
        of_case = {f"scenario.{TOLD_CASE}.{key}": value for key, value in alone.items()}
        tables = {k: v for k, v in self.study.source.tables.items() if k != "metric"}
        kept = {TOLD_CASE: tables["scenario"][TOLD_CASE]}
        bare = changed(self.study, {"metric": [], "scenario": kept})
        trace = simulate(changed(bare, of_case | changes), TOLD_CASE, arena().bar).trace
        error = np.asarray(trace["omega_error"])[np.asarray(trace["time"]) > self.told.begin]
        return float(np.sqrt(np.mean(error**2)) / RPM)

    @property
    def speed(self) -> float:
        """The constant reference, r/min."""
        constant_speed = self.study.scenario[TOLD_CASE].constant_speed
        assert constant_speed is not None
        return constant_speed / RPM

    @property
    def counts(self) -> float:
        """Counts of the encoder in a period of the law."""
        sensor = self.study.drive.position_sensor
        assert isinstance(sensor, Encoder)
        return self.speed * RPM / sensor.step / self.study.drive.rates.outer_loop


@cache
def plant(name: str) -> Plant:
    names = list(arena().plant)
    index = names.index(name)
    study, absent = prepared(arena(), name, [arena().bar])
    assert absent == {}
    return Plant(arena().plant[name], study, plant(names[index - 1]) if index else None)


def datasheet(name: str) -> Callable[[Plant, re.Match[str]], bool]:
    return lambda p, _: p.study.source.tables["motor"].get("datasheet") == name


def turns_at(p: Plant, said: re.Match[str]) -> bool:
    return abs(p.speed - float(said[1])) < 1e-6


def cogs(p: Plant, _: re.Match[str]) -> bool:
    """Without cogging, the bar's ripple falls below 0.7 times."""
    return p.ripple(**{"motor.cogging": []}) < 0.7 * p.ripple()


def compensated(p: Plant, _: re.Match[str] | None = None) -> bool:
    """Without the compensation the bar's ripple changes by more than with another seed."""
    table = p.study.source.tables["drive"]
    drive = {key: value for key, value in table.items() if key != "dead_time_compensation"}
    moved, noise = (abs(p.ripple(**other) - p.ripple()) for other in ({"drive": drive}, {"seed": 1}))
    return moved > 5 * noise and moved > 0.02 * p.ripple()


def same(p: Plant, _: re.Match[str]) -> bool:
    """Motor, mechanics and drive are those of the plant before, except for what the next words name."""
    assert p.before is not None
    mine, others = p.study, p.before.study
    method = {"speed_method", "timer"}
    left, right = (
        {**s.drive.model_dump(), "position_sensor": s.drive.position_sensor.model_dump(exclude=method)}
        for s in (mine, others)
    )
    return (mine.motor, mine.mechanics, left) == (others.motor, others.mechanics, right)


def timed(p: Plant, _: re.Match[str]) -> bool:
    """The speed is timed (MT), and the bar's ripple is lower than with counts (M)."""
    sensor = p.study.drive.position_sensor
    counted = p.ripple(**{"drive.position_sensor.speed_method": "M"})
    return isinstance(sensor, Counted) and sensor.speed_method == "MT" and p.ripple() < 0.99 * counted


def never_repeats(p: Plant, _: re.Match[str]) -> bool:
    """The common period of the reference's two frequencies is longer than the run."""
    scenario = p.study.scenario[TOLD_CASE]
    table = p.study.source.tables["scenario"][TOLD_CASE]["reference"]
    assert scenario.slowest < scenario.top_reference
    parts = [Fraction(table[key].removesuffix(" Hz")) for key in ("frequency", "modulation")]
    period = 1 / Fraction(math.gcd(*(int(f * 1000) for f in parts)), 1000)
    return float(period) > scenario.duration


def varies(p: Plant, _: re.Match[str]) -> bool:
    scenario = p.study.scenario[TOLD_CASE]
    return scenario.slowest < scenario.top_reference / 1.2


def arm(p: Plant, _: re.Match[str]) -> bool:
    """A weight turns with the motor, and changes the bar's ripple."""
    waves = [wave for wave in p.study.mechanics.load.harmonics if wave.order == 1]
    return bool(waves) and abs(p.ripple(**{"mechanics.load": "0 N*m"}) / p.ripple() - 1) > 0.05


def off_the_axis(p: Plant, _: re.Match[str]) -> bool:
    sensor = p.study.drive.position_sensor
    assert isinstance(sensor, Counted)
    straight = p.ripple(**{"drive.position_sensor.error": []})
    return abs(sensor.wave(1)) > 1e-3 and straight < p.ripple()


def has_bits(p: Plant, said: re.Match[str]) -> bool:
    sensor = p.study.drive.position_sensor
    return isinstance(sensor, Absolute) and sensor.bits == int(said[1])


def soft_shaft(p: Plant, _: re.Match[str]) -> bool:
    """The load swings against the motor, within what the speed loop sees."""
    side = p.study.mechanics.load_side
    assert side is not None
    stiffness, inertia = side.stiffness / side.ratio**2, side.inertia / side.ratio**2
    swings = math.sqrt(stiffness / inertia) / math.tau
    stiffer = p.ripple(**{"mechanics.load_side.stiffness": f"{100 * side.stiffness!r} N*m/rad",
                          "drive.rates.integration_steps": 8})  # fmt: skip
    return swings < 0.1 * p.study.drive.rates.outer_loop and abs(stiffer / p.ripple() - 1) > 0.02


def gear(p: Plant, _: re.Match[str]) -> bool:
    side = p.study.mechanics.load_side
    return side is not None and side.ratio > 1 and bool(side.gear_errors)


# words of an `about`, and the check of the plant that belongs to each
WORDS: dict[str, Callable[[Plant, re.Match[str]], bool]] = {
    r"motor of Liu 2018": datasheet("liu2018"),
    r"drone motor": datasheet("uomodri"),
    r"gimbal motor": datasheet("gm5208"),
    r"hub motor": datasheet("hoverboard"),
    r"step motor": lambda p, _: isinstance(p.study.motor, StepMotor),
    r"motor(?= with cogging at)": lambda p, _: p.study.motor.star().pole_pairs > 0,
    r"as liu-61": same,
    r"([\d.]+) r/min": turns_at,
    r"([\d.]+) encoder counts per sample": lambda p, said: f"{p.counts:.3g}" == said[1],
    r"speed computed from the times of encoder edges": timed,
    r"with cogging": cogs,
    r"dead time compensated": compensated,
    r"a speed that never repeats": never_repeats,
    r"varying speed": varies,
    r"arm": arm,
    r"\(Verrelli 2016, section 5\)": lambda p, _: p.told.study == "verrelli2016",
    r"eccentric (\d+)-bit encoder": lambda p, said: has_bits(p, said) and off_the_axis(p, said),
    r"Hall sensors": lambda p, _: isinstance(p.study.drive.position_sensor, Hall),
    r"soft shaft": soft_shaft,
    r"gear": gear,
}


@pytest.mark.parametrize("name", arena().plant)
def test_a_plant_is_what_each_word_of_its_about_says(name: str) -> None:
    left = arena().plant[name].about
    for words, holds in WORDS.items():
        for said in re.finditer(words, left):
            assert holds(plant(name), said), said[0]
        left = re.sub(words, " ", left)
    assert set(re.findall(r"[\w']+", left)) <= set(FILLERS.split()), left


def test_a_plant_that_is_the_same_is_compensated_as_the_one_before() -> None:
    """The words "the same" pass on what it says of the drive: the bar's ripple moves on all four drones."""
    drones = [name for name in arena().plant if name.startswith("drone-")]
    assert len(drones) == 4
    for name in drones:
        assert compensated(plant(name)), name


@pytest.mark.parametrize("name", arena().plant)
def test_each_change_of_a_plant_changes_it(name: str) -> None:
    told = arena().plant[name]
    for key in told.changes:
        others = {k: v for k, v in told.changes.items() if k != key}
        without, with_it = (load(told.study, c).model_dump() for c in (others, told.changes))
        assert without != with_it, key


def test_the_trials_are_what_their_about_says() -> None:
    (told,) = arena().trials.values()
    assert told.about.startswith("a motion of Mandra 2019 in 150 trials, between which load, inertia and ")
    study = load(told.study, told.changes)
    assert isinstance(study, TrialStudy) and told.study == "mandra2019"
    (scenario,) = study.scenario.values()
    assert scenario.trials == 150
    changes = [change for _, change in scenario.phases[1:]]
    assert any(change.load_steps for change in changes)
    assert any("mechanics.inertia" in (change.override or {}) for change in changes)
    assert any(change.reference is not None for change in changes)


HELPS = re.compile(r"`([^`]+)` leaves ([\d.]+)")
SETTING = re.compile(r"([\w.]+) = ([^,]+)")


@pytest.mark.parametrize("name", ["liu-60", "liu-61", "liu-900"])
def test_what_the_page_says_would_help_helps_as_much(name: str) -> None:
    """Each change of the column "what would help", applied to the plant with its best law."""
    page = (Path(__file__).parents[2] / "docs" / "studies" / "arena.md").read_text(encoding="utf-8")
    block = re.search(r"<!-- begin limits -->(.*?)<!-- end limits -->", page, re.DOTALL)
    assert block is not None
    rows = (line.strip("| ").split(" | ") for line in block[1].splitlines())
    ((_, label, least, _, helps),) = (row for row in rows if row[0] == name)
    (law,) = (key for key, each in arena().law.items() if each.label == label)
    study, _ = prepared(arena(), name, [law])
    alone = learning(changed(study, {"seed": arena().seeds[0]}), law)

    def ripple(of: Study) -> float:
        value = simulate(of, TOLD_CASE, law).metrics[RIPPLE_METRIC]
        assert isinstance(value, float)
        return value / RPM

    assert ripple(alone) == pytest.approx(float(least), rel=0.01)
    told = HELPS.findall(helps)
    assert told
    for text, left in told:
        changes = {key: tomllib.loads(f"value = {value}")["value"] for key, value in SETTING.findall(text)}
        after = ripple(changed(alone, changes))
        assert after == pytest.approx(float(left), rel=0.01) and after < 0.8 * float(least)
