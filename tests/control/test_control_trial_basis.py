"""What was learned for one reference, moved to another by the C library, against the transcription."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from reference.trial_basis import carried, functions

SAMPLES = 300
TIME = np.arange(SAMPLES) / 500


def move(begin: float, end: float, way: float) -> np.ndarray:
    s = np.clip((TIME - begin) / (end - begin), 0, 1)
    return way * s**3 * (10 - 15 * s + 6 * s**2)


OLD = move(0.05, 0.3, 2.0) - move(0.32, 0.55, 1.5)
NEW = move(0.1, 0.25, -0.8) + move(0.3, 0.5, 1.1)


class Law:
    def __init__(self, library: ControlLibrary, v: np.ndarray, **change: Any) -> None:
        fields = {
            "samples": SAMPLES,
            "states": 2,
            "k_1": [-90.0, -1.0],
            "c": [1.0, 0.0],
            "n": 90.0,
            "k_2": 1.3,
        }
        fields |= {"through_integrator": True, "k_3": 0.5, "shift": 2, "limit": 10.0, "learned_limit": 1.0}
        fields |= {"unguarded": True, **change}
        self.lib, self.library = library.lib, library
        self.law, self.config = library.new("cgl_trial"), library.new("cgl_trial_config", **fields)
        length = 3 * SAMPLES
        self.memory, memory = library.array(np.full(length, np.nan))
        assert self.lib.cgl_trial_init(self.law, self.config, memory, length) == 0
        self.memory[:SAMPLES] = v

    @property
    def v(self) -> np.ndarray:
        return self.memory[:SAMPLES].copy()

    def begin(self, y_ref: np.ndarray) -> None:
        self.y_ref = self.library.array(y_ref)
        self.lib.cgl_trial_begin(self.law, self.y_ref[1])

    def carry(self, y_ref: np.ndarray) -> bool:
        return bool(self.lib.cgl_trial_carry(self.law, self.library.array(y_ref)[1]))


@pytest.fixture(params=["float", "double"])
def library(request: Any) -> ControlLibrary:
    return control_library(request.param)


def learned(seed: int = 5) -> np.ndarray:
    """A part of each function, a load, and noise, as a v."""
    rng = np.random.default_rng(seed)
    w = functions(OLD) @ [0.4, 3e3, 20.0, 0.2, 2e3] + 0.05 * rng.normal(size=SAMPLES)
    return np.linalg.solve(90 * np.eye(SAMPLES) + 1.3 * np.tri(SAMPLES, k=-1), w)


@pytest.mark.parametrize("change", [{}, {"through_integrator": False}, {"n": -2.0, "k_2": -0.1}])
def test_it_is_the_transcription(library: ControlLibrary, change: dict[str, Any]) -> None:
    v = learned()
    law = Law(library, v, **change)
    law.begin(OLD)
    assert law.carry(NEW)
    n, k_2 = change.get("n", 90.0), change.get("k_2", 1.3) * change.get("through_integrator", True)
    wanted = carried(v, OLD, NEW, n, k_2)
    assert np.abs(wanted - v).max() > 0.5 * np.abs(v).max()
    # third differences of a float reference of 2 rad: 4e-7 rad each, where the jerk has 2e-5
    within = 2e-10 if library.real is np.float64 else 3e-3
    assert np.abs(law.v - wanted).max() <= within * np.abs(wanted - v).max()


def test_what_the_functions_explain_moves_and_a_load_stays(library: ControlLibrary) -> None:
    """An input of inertia, friction, delay and load becomes that of the new motion, but for rounding."""
    theta = np.array([0.3, 2e3, 15.0, 0.1, 1.5e3])
    law = Law(library, functions(OLD) @ theta / 90, through_integrator=False)
    law.begin(OLD)
    assert law.carry(NEW)
    within = 1e-9 if library.real is np.float64 else 2e-3
    assert np.abs(90 * law.v - functions(NEW) @ theta).max() <= within * np.abs(functions(NEW) @ theta).max()


def test_what_cannot_be_told_from_a_load_stays(library: ControlLibrary) -> None:
    """With a ramp the speed is as constant as a load is, and at rest there is nothing to learn from."""
    for old in (2 * TIME, np.ones(SAMPLES)):
        v = np.full(SAMPLES, 0.01)
        law = Law(library, v, through_integrator=False)
        law.begin(old)
        assert law.carry(NEW)
        assert law.v[5:-5] == pytest.approx(v[5:-5], abs=2e-4)


def test_there_and_back_changes_nothing(library: ControlLibrary) -> None:
    v = learned()
    law = Law(library, v)
    law.begin(OLD)
    assert law.carry(OLD)
    assert law.v == pytest.approx(v, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "old", "new"),
    [
        ({}, None, NEW),
        ({"n": 0.0}, OLD, NEW),
        ({"k_2": -1.3}, OLD, NEW),  # the integral's inverse grows
        ({"k_2": 180.0}, OLD, NEW),
        ({}, np.where(TIME > 0.3, np.nan, OLD), NEW),
        ({}, OLD, np.where(TIME > 0.3, np.inf, NEW)),
    ],
)
def test_where_it_cannot_move_everything_stays(
    library: ControlLibrary, change: dict[str, Any], old: np.ndarray | None, new: np.ndarray
) -> None:
    law = Law(library, learned(), **change)
    before = law.v
    if old is not None:
        law.begin(old)
    assert not law.carry(new)
    assert np.array_equal(law.v, before)


def test_v_stays_within_its_limit_and_the_last_trial_teaches_no_more(library: ControlLibrary) -> None:
    law = Law(library, learned(), learned_limit=0.02)
    law.memory[:SAMPLES] = np.clip(law.v, -0.02, 0.02)
    law.begin(OLD)
    point, out = library.new("cgl_trial_input", x=[0.0, 0.0], learn=True), library.new("cgl_trial_output")
    for _ in range(SAMPLES):
        law.lib.cgl_trial_step(law.law, point, out)
    assert law.carry(50 * NEW)
    assert np.abs(law.v).max() == np.float32(0.02) or np.abs(law.v).max() == 0.02
    assert not law.lib.cgl_trial_end(law.law)


def test_the_guard_measures_anew(library: ControlLibrary) -> None:
    law = Law(library, learned(), unguarded=False)
    law.begin(OLD)
    law.law.guard.best, law.law.guard.strikes = 1.0, 3
    assert law.carry(NEW)
    assert law.law.guard.best < 0 and law.law.guard.strikes == 0
