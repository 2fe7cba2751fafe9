"""A load behind a soft shaft in the design: its frequencies, the margins and stability, and what is told."""

from __future__ import annotations

import dataclasses
import io
import math
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import studies
from cogless.design.closed_loop import Linear, oscillation, poles
from cogless.design.design_table import design_table
from cogless.design.speed_loop import CurrentLoop, IdealLoop, SoftShaft, SpeedLoop, margins, speed_loop
from cogless.design.warnings import warnings
from cogless.run.simulate import simulate
from cogless.study import Study

SHAFT = SoftShaft(inertia=2e-3, load_inertia=3e-3, stiffness=200.0, damping=0.05)
CURRENT = CurrentLoop(kp=60.0, ki=6e4, R=3.6, L=0.03, period=1 / 8e3, delay=1)
LOAD_SIDE = {"inertia": "6e-4 kg*m^2", "stiffness": "25 N*m/rad", "damping": "5 mN*m*s/rad", "ratio": 2}
AXIS = {"mechanics.load_side": LOAD_SIDE, "mechanics.inertia": "1e-4 kg*m^2"}


def loop(current: CurrentLoop | IdealLoop = CURRENT, window: int = 0, **shaft: object) -> SpeedLoop:
    shafted = dataclasses.replace(SHAFT, **shaft)
    return SpeedLoop(b=200.0, steps=4, window=window, current=current, shaft=shafted)


@pytest.mark.parametrize("current", [CURRENT, IdealLoop(1 / 8e3)], ids=["current loop", "ideal"])
@pytest.mark.parametrize("on_load", [False, True])
def test_the_plant_is_that_of_two_masses(current: CurrentLoop | IdealLoop, on_load: bool) -> None:
    """Far below half the sampling rate it has the transfer function of continuous time."""
    around = loop(current, on_load=on_load)
    w = 2 * math.pi * np.array([5.0, 20.0, 35.0, 60.0, 80.0])
    s, s_ = 1j * w, SHAFT
    joint = s_.damping * s + s_.stiffness
    top = joint if on_load else s_.load_inertia * s**2 + joint
    both = s_.inertia + s_.load_inertia
    exact = around.b * both * top / (s * (s_.inertia * s_.load_inertia * s**2 + both * joint))
    rigid = around.b / s
    found, of_rigid = around.plant(w)[0], around.rigid.plant(w)[0]
    # what sampling and the current loop add to one mass they add to two
    assert found / of_rigid == pytest.approx(exact / rigid, rel=0.03)


@pytest.mark.parametrize("on_load", [False, True])
@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.05, 1.0])
@pytest.mark.parametrize("window", [0, 4])
def test_margins_say_what_the_poles_say(on_load: bool, damping: float, window: int) -> None:
    around = loop(on_load=on_load, damping=damping, window=window)
    stable = []
    for k in np.geomspace(2e-3, 6.0, 5):
        found = margins(around, k, 5 * k)
        feedback = Linear(ratio=1, k=k, k_i=5 * k)
        assert found.stable == (oscillation(around, feedback) is None), k
        stable.append(found.stable)
        if found.stable and math.isfinite(found.gain_margin):
            top = found.gain_margin
            below, above = (
                poles(around, Linear(ratio=1, k=f * k, k_i=5 * f * k)) for f in (0.99 * top, 1.01 * top)
            )
            assert np.abs(below).max() < 1 + 1e-6 < np.abs(above).max()
    assert not stable[-1]
    assert stable[0] == (not on_load or damping > 0.0)


def test_a_stiff_shaft_has_the_margins_of_one_mass() -> None:
    stiff = loop(stiffness=1e6, damping=10.0)
    found, rigid = margins(stiff, 0.2, 1.0), margins(stiff.rigid, 0.2, 1.0)
    assert found.phase_margin == pytest.approx(rigid.phase_margin, rel=1e-3)
    assert found.crossover == pytest.approx(rigid.crossover, rel=1e-3)


def test_the_load_is_seen_through_the_gear(tmp_path: Path) -> None:
    around = speed_loop(studies.study(tmp_path, AXIS))
    assert around.shaft is not None
    assert around.shaft.antiresonance == pytest.approx(math.sqrt(25 / 6e-4))
    assert around.shaft.resonance == pytest.approx(math.sqrt(25 * (1 / 6e-4 + 1 / (4 * 1e-4))))
    assert around.b == pytest.approx(speed_loop(studies.study(tmp_path)).b)  # the same sum of inertias


def test_design_tells_where_the_shaft_swings(tmp_path: Path) -> None:
    page = io.StringIO()
    Console(file=page, width=300).print(design_table(studies.study(tmp_path, AXIS)))
    assert "antiresonance at 32.49 Hz and a resonance at 51.37 Hz" in page.getvalue()
    assert "gap closed" not in page.getvalue()
    side = {**LOAD_SIDE, "backlash": "0.1 deg"}
    page = io.StringIO()
    gap = studies.study(tmp_path, {**AXIS, "mechanics.load_side": side})
    Console(file=page, width=300).print(design_table(gap))
    assert "its gap closed" in page.getvalue()
    page = io.StringIO()
    Console(file=page, width=300).print(design_table(studies.study(tmp_path)))
    assert "resonance" not in page.getvalue()


def test_what_the_design_calls_unstable_grows_in_the_simulation(tmp_path: Path) -> None:
    """With the sensor on the load's side the same gains that suit one mass shake two."""
    tuned = {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}
    for side in ("motor", "load"):
        sensor = {"drive.position_sensor": {"kind": "ideal", "side": side}}
        study = studies.study(tmp_path, {**AXIS, "controller.pi": tuned, **sensor})
        assert isinstance(study, Study)
        scenario = next(iter(study.scenario))
        speed = simulate(study, scenario, "pi").trace.part("omega_load", slice(-4000, None))
        told = "\n".join(map(str, warnings(study, scenario, "pi")))
        assert ("unstable" in told) == (side == "load"), told
        assert (np.std(speed) > 1.0) == (side == "load")
