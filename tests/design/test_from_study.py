"""Errors and ranges of a design, in the keys of the study."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cogless.design.trials import from_study
from cogless.design.trials.model import DesignError
from cogless.study.laws.trial import StateIlc, TrialIlc


@pytest.mark.parametrize(
    ("message", "plant", "key"),
    [
        ("samples: 2: expected more", None, "scenario.s.duration"),
        ("K_s: expected more", None, "controller.ilc.K_s"),
        ("static_gain: expected more", None, "controller.ilc.N"),
        ("feedforward: expected more", None, "controller.ilc.feedforward"),
        ("state_weight: expected more", None, "design.state_weight"),
        ("nominal: expected more", None, "design.nominal"),
        ("nominal: expected more", [], "plant.parameter"),
        ("nominal: expected more", [1], "plant.vertex"),
        ("model: expected more", [1], "plant.model"),
        ("range.J: expected more", [], "design.range.J"),
        ("range: expected more", [], "plant.parameter"),
        ("output: expected more", [], "plant.C"),
        ("period: expected more", [], "plant.period"),
        ("vertex 2: expected more", [1], "plant.vertex"),
        ("vertex: expected more", [], "plant"),
        ("vertex: expected more", None, "design.vertex"),
    ],
)
def test_a_design_s_error_names_the_study_s_own_key(message: str, plant: Any, key: str) -> None:
    given = None if plant is None else SimpleNamespace(vertex=plant, parameter=[] if plant else ["J"])
    study: Any = SimpleNamespace(
        source=SimpleNamespace(path="a.toml"), plant=given, trial_law={"ilc": TrialIlc}.get
    )
    text = message.partition(": ")[2]
    found = from_study._study_error(DesignError(message), study, "s", "ilc")
    assert str(found) == f"a.toml: {key}: {text}"


def test_the_older_law_has_names_of_its_own_for_its_gains() -> None:
    study: Any = SimpleNamespace(
        source=SimpleNamespace(path="a.toml"), plant=None, trial_law={"older": StateIlc}.get
    )
    for key, own in (("K_s", "K_stab"), ("K_3", "K_ilc"), ("shift", "shift")):
        found = from_study._study_error(DesignError(f"{key}: expected more"), study, "s", "older")
        assert str(found) == f"a.toml: controller.older.{own}: expected more"
    nobody = from_study._study_error(DesignError("K_s: expected more"), study, "", "")
    assert str(nobody) == "a.toml: design.K_s: expected more"


def test_values_outside_the_ranges_of_a_design_are_told() -> None:
    """A parameter without a range has its nominal value alone; rounding at an end is inside."""
    known = {
        "J": SimpleNamespace(range=(1.0, 2.0), nominal=1.5),
        "B": SimpleNamespace(range=None, nominal=3.0),
    }
    overrides = (None, {"J": 2.0 * (1 + 1e-10), "B": 3.0}, {"J": 2.1, "other": 1.0}, {"J": 0.9, "B": 3.1})
    phases = [(10 * n, SimpleNamespace(override=each)) for n, each in enumerate(overrides)]
    study: Any = SimpleNamespace(
        plant=SimpleNamespace(parameter=known), scenario={"s": SimpleNamespace(phases=phases)}
    )
    assert from_study._outside(study, "s") == (
        "scenario s, from trial 20: J is 2.1, outside the design's 1 to 2",
        "scenario s, from trial 30: J is 0.9, outside the design's 1 to 2",
        "scenario s, from trial 30: B is 3.1, outside the design's 3 to 3",
    )
