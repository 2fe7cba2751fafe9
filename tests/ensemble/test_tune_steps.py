"""A tuning's steps one by one: what is tuned together, over which variants, and whose learning grows."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ensembles
import numpy as np
import pytest

import studies
from cogless.design.kinds import DESIGNS
from cogless.ensemble import search as searching
from cogless.ensemble import sweep_table, variants
from cogless.ensemble import tune as tuning
from cogless.ensemble.sweep_table import Column, Sweep
from cogless.ensemble.variants import Ensemble, draw, seeds
from cogless.errors import StudyError
from cogless.study import TrialStudy

KEYS = """
[tune]
minimise = "ripple"
variants = 4
[tune.keys]
"""
KP = 'controller.pi.kp = ["0.005 A/rpm", "0.06 A/rpm"]\n'
DRIVE = 'drive.current_loop.current_limit = ["1 A", "4 A"]\n'


def study(folder: Path, keys: str = KP, changes: dict[str, Any] | None = None, tune: str = KEYS) -> Any:
    return studies.study(folder, changes, ensembles.TEXT + tune + keys)


def test_settings_are_checked_on_four_times_as_many_fresh_variants(tmp_path: Path) -> None:
    """Those that are tuned over the nominal plant are checked on sixteen seeds."""
    found = study(tmp_path)
    searched, fresh = tuning.ensembles(found)
    assert (searched.count, fresh.count) == (4, 16)
    assert searched.drawn == draw(found, 4).drawn and fresh.drawn == draw(found, 16, fresh=1).drawn
    nominal = study(tmp_path, tune=KEYS.replace("variants = 4", 'over = "nominal"'))
    searched, fresh = tuning.ensembles(nominal)
    assert (searched.count, searched.drawn, searched.axes, fresh.axes) == (1, {}, (), ())
    assert (fresh.count, fresh.drawn) == (16, {"seed": seeds(nominal, 16, fresh=1)})
    assert seeds(nominal, 2, fresh=1) == [5 + 1 + 2**32, 5 + 2 + 2**32]
    assert variants.draw(found, 1).count == len(variants.draw(found, 1).drawn["mechanics.inertia"]) == 1


def test_keys_of_controllers_are_tuned_for_each_and_others_for_all(tmp_path: Path) -> None:
    ilc = KP.replace("pi.kp", "pi-ilc.kp")
    one, other = tuning.subjects(study(tmp_path, KP + ilc))
    assert [(each.name, [knob.key for knob in each.knobs], each.pairs) for each in (one, other)] == [
        ("pi", ["controller.pi.kp"], [("low", "pi")]),
        ("pi-ilc", ["controller.pi-ilc.kp"], [("low", "pi-ilc")]),
    ]
    (every,) = tuning.subjects(study(tmp_path, DRIVE))
    assert (every.name, every.pairs) == ("all", [("low", "pi"), ("low", "pi-ilc")])
    (joint,) = tuning.subjects(study(tmp_path, ilc + DRIVE))
    assert (len(joint.knobs), joint.pairs) == (2, [("low", "pi-ilc")])


def test_a_range_may_begin_or_end_at_the_study_s_own_value(tmp_path: Path) -> None:
    for limits, start in (('"0.015 A/rpm", "0.06 A/rpm"', 0.0), ('"0.005 A/rpm", "0.015 A/rpm"', 1.0)):
        (subject,) = tuning.subjects(study(tmp_path, f"controller.pi.kp = [{limits}]\n"))
        (knob,) = subject.knobs
        assert knob.start_share == pytest.approx(start)
        exact = tuning._values(subject, {knob.key: knob.start_share})
        assert exact == {knob.key: "0.015 A/rpm"} and knob.start_text == "0.015 A/rpm"
        assert tuning._values(subject, {knob.key: 0.5})[knob.key] == knob.value_at(0.5)


def test_a_plain_number_of_a_controller_is_si_in_the_unit_of_its_range(tmp_path: Path) -> None:
    """Such as those that the rule auto gives, which are in no file."""
    kp = 0.015 * 30 / math.pi
    text = ensembles.TEXT.replace('kp = "0.015 A/rpm"', f"kp = {kp!r}", 1) + KEYS
    (subject,) = tuning.subjects(studies.study(tmp_path, None, text + KP))
    (knob,) = subject.knobs
    assert (knob.start, knob.unit) == (pytest.approx(0.015), "A/rpm")
    with pytest.raises(StudyError, match='A": expected a gain of the speed loop') as error:
        tuning.subjects(studies.study(tmp_path, None, text + KP.replace("A/rpm", "A")))
    assert str(error.value).startswith(f"{tmp_path}/study.toml: tune: controller.pi.kp: ")


def test_what_is_tuned_has_to_be_measured_where_it_runs(tmp_path: Path) -> None:
    other = {"duration": "0.3 s", "reference": "300 rpm", "controllers": ["pi-ilc"]}
    found = study(tmp_path, changes={"scenario.high": other})
    (ripple, *_) = found.metric
    away = found.model_copy(update={"metric": (ripple.model_copy(update={"scenarios": ("high",)}),)})
    with pytest.raises(StudyError) as error:
        tuning.subjects(away)
    assert str(error.value) == (
        f'{tmp_path / "study.toml"}: tune.minimise: "ripple": expected a metric of a scenario in which '
        "pi runs"
    )
    with pytest.raises(StudyError, match=r'tune.hold: "x": expected one of none$'):
        tuning.column_of(found.model_copy(update={"metric": ()}), "x", "hold")


def test_a_limit_is_turned_so_that_less_is_better(tmp_path: Path) -> None:
    found = study(tmp_path)
    dimension = found.metric[0].dimension
    for wanted, sign in (("lower", 1), ("higher", -1)):
        metric = SimpleNamespace(
            better_direction=wanted, dimension=dimension, name="ripple", kind="ripple-rms"
        )
        limit = tuning.hold_limit(found, Column(metric), "30 rpm")
        assert limit == pytest.approx(sign * np.pi)


def test_growth_is_the_largest_that_is_sure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def grows(*forecasts: Any) -> float:
        told = dict(enumerate(forecasts))
        speed = replace(DESIGNS["speed"], forecast=lambda study, name: told[name])
        monkeypatch.setattr(tuning, "DESIGNS", {**DESIGNS, "speed": speed})
        return tuning.growth(study(tmp_path), told)

    def said(kind: str, factor: float | None) -> Any:
        return SimpleNamespace(kind=kind, worst=None if factor is None else SimpleNamespace(factor=factor))

    assert grows() == grows(None, said("settles", 0.5), said("may grow", 3.0)) == 0.0
    assert grows(said("grows", 1.25), None, said("feedback unstable", 1.5)) == 0.5
    assert grows(said("grows", 1.25), said("unstable", None)) == 1.0
    trials = TrialStudy.model_construct()
    assert tuning.growth(trials, ["x"]) == 0.0


def test_controllers_stand_beside_what_was_tuned_of_them(tmp_path: Path) -> None:
    found = study(tmp_path, changes={"controller.pi.baseline": True, "controller.pi.label": "Mine"})
    (subject,) = tuning.subjects(found)
    ensemble = Ensemble((), {}, 2)
    before, after = (
        Sweep(found, ensemble, subject.pairs, sweep_table.columns(found), np.full((2, 1, 3), x), {})
        for x in (1.0, 2.0)
    )
    score = tuning.Score(0.0, 1.0)
    tuned = tuning.Tuned(subject, {"controller.pi.kp": "0.02 A/rpm"}, score, score, before, after)
    both = tuning.side_by_side(found, [tuned])
    assert both.pairs == [("low", "pi"), ("low", "pi-tuned")]
    assert np.array_equal(both.values, np.stack([np.full((2, 3), x) for x in (1.0, 2.0)], axis=1))
    assert (both.study.label("pi"), both.study.label("pi-tuned")) == ("Mine", "Mine tuned")
    rpm = np.pi / 30
    gains = [both.study.controller[name].kp * rpm for name in ("pi", "pi-tuned")]
    assert gains == pytest.approx([0.015, 0.02])
    assert not both.study.controller["pi-tuned"].baseline and both.errors == {}


def test_a_generation_grows_with_the_logarithm_of_the_keys(tmp_path: Path) -> None:
    """A single key has a search of its own; a seed may be a long number."""
    pytest.importorskip("optuna", reason="needs the extra cogless[tune]")
    for count, batch in ((1, 4), (2, 6), (5, 8)):
        start = {f"k{n}": 0.5 for n in range(count)}
        with searching.opened(tmp_path / f"{count}", {}, start, seed=2**40 + 1) as search:
            sizes: list[int] = []

            def score(many: Any, sizes: list[int] = sizes) -> list[float]:
                sizes.append(len(many))
                return [sum((x - 0.5) ** 2 for x in one.values()) for one in many]

            assert search.batch == batch
            assert search.run(score, 2 * batch, lambda tried, best: None) == start  # nothing is better
            assert sizes == [1, batch, batch - 1]


def test_a_column_is_a_number_of_a_run() -> None:
    metric: Any = SimpleNamespace(name="error", kind="final-error", dimension=SimpleNamespace(unit=""))
    name = sweep_table.result_name(metric)
    for place, value, found in (
        (None, 3.0, 3.0),
        (None, None, None),
        (None, np.inf, None),
        (None, [1.0, 2.0], 2.0),
        (0, [1.0, 2.0], 1.0),
        (1, [1.0, None], None),
        (2, [1.0, 2.0], None),
    ):
        assert Column(metric, place).number_in({name: value}) == found
    assert Column(metric).number_in({}) is None
    assert (Column(metric, 0, "2").spoken, Column(metric).spoken) == ("error.2", "error")
